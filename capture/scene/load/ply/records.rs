//! Records of a PLY: numbers as text or in either byte order.

use super::header::{Element, Format, Header, Type};
use crate::load::lines::number;

/// Reads the records of a file in order.
pub(super) struct Records<'a> {
    rest: &'a [u8],
    format: Format,
}

/// Values of a record.
#[derive(Default)]
pub(super) struct Record {
    /// Values of all properties.
    values: Vec<f64>,
    /// End of each property in `values`.
    ends: Vec<usize>,
}

impl Record {
    /// Returns the values of a property.
    pub(super) fn list(&self, property: usize) -> &[f64] {
        let start = property
            .checked_sub(1)
            .map_or(0, |before| self.ends[before]);
        &self.values[start..self.ends[property]]
    }

    /// Returns the first value of a property; NaN if it has none.
    pub(super) fn value(&self, property: usize) -> f64 {
        self.list(property).first().copied().unwrap_or(f64::NAN)
    }

    /// Returns the values of several properties.
    pub(super) fn values<const N: usize>(&self, properties: [usize; N]) -> [f64; N] {
        properties.map(|property| self.value(property))
    }
}

impl<'a> Records<'a> {
    pub(super) fn new(bytes: &'a [u8], header: &Header) -> Self {
        Self {
            rest: &bytes[header.end..],
            format: header.format,
        }
    }

    /// Calls `visit` with each record of an element.
    ///
    /// # Errors
    /// A description of the defect.
    pub(super) fn read(
        &mut self,
        element: &Element,
        mut visit: impl FnMut(&Record),
    ) -> Result<(), String> {
        if element.properties.is_empty() {
            return Ok(());
        }
        let mut record = Record::default();
        for index in 0..element.count {
            record.values.clear();
            record.ends.clear();
            self.read_record(element, &mut record).map_err(|cause| {
                format!(
                    "{} {index} of {}: {cause}; the file is damaged or incomplete",
                    element.name, element.count
                )
            })?;
            visit(&record);
        }
        Ok(())
    }

    fn read_record(&mut self, element: &Element, record: &mut Record) -> Result<(), String> {
        for property in &element.properties {
            let count = match property.count {
                Some(count) => self.next(count)?,
                None => 1.0,
            };
            let least = match self.format {
                Format::Ascii => 2,
                _ => property.value.size(),
            };
            // A text needs no space behind its last number.
            if !(count >= 0.0 && count * least as f64 <= self.rest.len() as f64 + 1.0) {
                return Err(format!(
                    "its list \"{}\" has {count} numbers",
                    property.name
                ));
            }
            record.values.reserve_exact(count as usize);
            for _ in 0..count as usize {
                let value = self.next(property.value)?;
                record.values.push(value);
            }
            record.ends.push(record.values.len());
        }
        Ok(())
    }

    fn next(&mut self, kind: Type) -> Result<f64, String> {
        if self.format == Format::Ascii {
            return self.next_word();
        }
        let (bytes, rest) = self
            .rest
            .split_at_checked(kind.size())
            .ok_or("the file ends there")?;
        self.rest = rest;
        let mut little = [0; 8];
        for (i, &byte) in bytes.iter().enumerate() {
            let at = if self.format == Format::LittleEndian {
                i
            } else {
                bytes.len() - 1 - i
            };
            little[at] = byte;
        }
        let [a, b, c, d, ..] = little;
        Ok(match kind {
            Type::I8 => f64::from(a as i8),
            Type::U8 => f64::from(a),
            Type::I16 => f64::from(i16::from_le_bytes([a, b])),
            Type::U16 => f64::from(u16::from_le_bytes([a, b])),
            Type::I32 => f64::from(i32::from_le_bytes([a, b, c, d])),
            Type::U32 => f64::from(u32::from_le_bytes([a, b, c, d])),
            Type::F32 => f64::from(f32::from_le_bytes([a, b, c, d])),
            Type::F64 => f64::from_le_bytes(little),
        })
    }

    fn next_word(&mut self) -> Result<f64, String> {
        let text = self.rest.trim_ascii_start();
        let end = text
            .iter()
            .position(u8::is_ascii_whitespace)
            .unwrap_or(text.len());
        let (word, rest) = text.split_at(end);
        self.rest = rest;
        if word.is_empty() {
            return Err("the file ends there".into());
        }
        let word = String::from_utf8_lossy(word);
        number(&word).ok_or_else(|| {
            let shown: String = word.chars().take(40).collect();
            if word.contains(',') {
                format!("\"{shown}\" is not a number; write 0.5 without a decimal comma")
            } else {
                format!("\"{shown}\" is not a number")
            }
        })
    }
}
