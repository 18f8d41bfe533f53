//! Fields of JSON manifests, with errors that name them.

use super::text::read_bytes;
use crate::ImagesError;
use glam::DMat4;
use headbox_core::files::InputFolder;
use serde_json::Value;
use std::path::Path;

/// Reads a JSON file of a set.
pub(crate) fn read(folder: &InputFolder, path: &Path) -> Result<Value, ImagesError> {
    let text = read_bytes(folder, path)?;
    let text = text.strip_prefix(b"\xef\xbb\xbf").unwrap_or(&text);
    let parsed = serde_json::from_slice(text);
    // Python writes NaN and Infinity, which JSON does not have.
    let parsed = parsed.or_else(|error| serde_json::from_slice(&replace_nan(text)).or(Err(error)));
    parsed.map_err(|error| {
        ImagesError::field(
            path,
            "the file",
            format!(
                "is not JSON (line {}, column {})",
                error.line(),
                error.column()
            ),
        )
    })
}

/// Replaces `NaN`, `Infinity` and `-Infinity` outside strings by `null`.
fn replace_nan(text: &[u8]) -> Vec<u8> {
    let mut replaced = Vec::with_capacity(text.len());
    let mut rest = text;
    let mut is_string = false;
    while let Some((&byte, tail)) = rest.split_first() {
        let tokens: [&[u8]; 4] = [b"NaN", b"-NaN", b"-Infinity", b"Infinity"];
        let token = tokens.into_iter().find(|token| rest.starts_with(token));
        match (byte, token) {
            (_, Some(token)) if !is_string => {
                replaced.extend_from_slice(b"null");
                rest = &rest[token.len()..];
                continue;
            }
            (b'\\', _) if is_string => {
                replaced.push(byte);
                replaced.extend(tail.first());
                rest = tail.get(1..).unwrap_or_default();
                continue;
            }
            (b'"', _) => is_string = !is_string,
            _ => {}
        }
        replaced.push(byte);
        rest = tail;
    }
    replaced
}

/// An object of a manifest with its file and path.
#[derive(Clone)]
pub(super) struct JsonObject<'a> {
    pub(super) file: &'a Path,
    pub(super) path: String,
    pub(super) value: &'a Value,
}

impl<'a> JsonObject<'a> {
    pub(super) fn root(file: &'a Path, value: &'a Value) -> Self {
        Self {
            file,
            path: String::new(),
            value,
        }
    }

    /// Returns the path of a field of this object in the file.
    pub(super) fn field_path(&self, key: &str) -> String {
        if self.path.is_empty() {
            key.into()
        } else {
            format!("{}.{key}", self.path)
        }
    }

    pub(super) fn error(&self, key: &str, cause: impl Into<String>) -> ImagesError {
        ImagesError::field(self.file, self.field_path(key), cause)
    }

    pub(super) fn has(&self, key: &str) -> bool {
        self.value.get(key).is_some_and(|value| !value.is_null())
    }

    pub(super) fn object(&self, key: &str) -> Result<JsonObject<'a>, ImagesError> {
        let value = self.value.get(key).filter(|value| value.is_object());
        let value = value.ok_or_else(|| self.error(key, "is missing or not an object"))?;
        Ok(JsonObject {
            file: self.file,
            path: self.field_path(key),
            value,
        })
    }

    pub(super) fn list(&self, key: &str) -> Result<Vec<JsonObject<'a>>, ImagesError> {
        let list = self.value.get(key).and_then(Value::as_array);
        let list = list.ok_or_else(|| self.error(key, "is missing or not a list"))?;
        let item = |(i, value)| JsonObject {
            file: self.file,
            path: self.field_path(&format!("{key}[{i}]")),
            value,
        };
        Ok(list.iter().enumerate().map(item).collect())
    }

    pub(super) fn text(&self, key: &str) -> Result<&'a str, ImagesError> {
        let text = self.value.get(key).and_then(Value::as_str);
        text.ok_or_else(|| self.error(key, "is missing or not a text"))
    }

    pub(super) fn number(&self, key: &str) -> Result<f64, ImagesError> {
        let number = self
            .value
            .get(key)
            .and_then(Value::as_f64)
            .filter(|number| number.is_finite());
        number.ok_or_else(|| self.error(key, "is missing or not a finite number"))
    }

    pub(super) fn number_or(&self, key: &str, default: f64) -> Result<f64, ImagesError> {
        if self.has(key) {
            self.number(key)
        } else {
            Ok(default)
        }
    }

    /// Returns the width or height of an image, pixels.
    pub(super) fn side(&self, key: &str) -> Result<u32, ImagesError> {
        let side = self.number(key)?;
        let allowed = (1.0..=f64::from(headbox_core::camera::Camera::MAX_SIDE_PX)).contains(&side)
            && side.fract() == 0.0;
        if allowed {
            Ok(side as u32)
        } else {
            Err(self.error(key, format!("is {side}, not a width or height in pixels")))
        }
    }

    /// Returns a matrix of 16 numbers, row by row, in one list or in four; the last row, 0 0 0 1,
    /// may be missing.
    pub(super) fn matrix(&self, key: &str) -> Result<DMat4, ImagesError> {
        let wrong = || self.error(key, "must hold 16 or 12 finite numbers, row by row");
        let list = self
            .value
            .get(key)
            .and_then(Value::as_array)
            .ok_or_else(wrong)?;
        let flat: Vec<&Value> = list
            .iter()
            .flat_map(|row| row.as_array().map_or(vec![row], |r| r.iter().collect()))
            .collect();
        let numbers: Option<Vec<f64>> = flat.into_iter().map(Value::as_f64).collect();
        let mut numbers = numbers.ok_or_else(wrong)?;
        if numbers.len() == 12 {
            numbers.extend([0.0, 0.0, 0.0, 1.0]);
        }
        let numbers: [f64; 16] = numbers.try_into().map_err(|_| wrong())?;
        Ok(DMat4::from_cols_array(&numbers).transpose())
    }
}
