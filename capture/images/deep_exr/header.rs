//! Header of a file with one deep scanline part, and conversion of stored values.

use super::compress::DeepCompression;
use super::{DeepChannel, DeepImage, DeepKind, DeepView, FieldError, field_error};
use exr::prelude::f16;

const MAGIC: u32 = 20_000_630;

/// Version 2, and the flags for names beyond 31 bytes, deep data and several parts.
const VERSION: u32 = 2;
const LONG_NAMES: u32 = 0x400;
const DEEP: u32 = 0x800;
const PARTS: u32 = 0x1000;

/// Type of the only supported kind of part.
const DEEP_SCANLINE: &str = "deepscanline";

/// Attributes of [`DeepView`].
const ENVIRONMENT: &str = "envmap";
const ENVIRONMENT_CUBE: u8 = 1;
const WORLD_TO_CAMERA: &str = "worldToCamera";
const WORLD_TO_NDC: &str = "worldToNDC";

/// Maximum numbers of rows, columns and pixels.
const MAX_SIDE: i64 = 1 << 20;
const MAX_PIXELS: i64 = 1 << 28;

pub(super) struct Header {
    pub(super) compression: DeepCompression,
    pub(super) size_px: [u32; 2],
    pub(super) origin_px: [i32; 2],
    pub(super) stored_px: [u32; 2],
    pub(super) channels: Vec<(String, DeepKind)>,
    pub(super) view: DeepView,
    /// Offset of the byte after the header.
    pub(super) end: usize,
}

/// Bounds-checked reader of numbers; errors name the truncated field.
pub(super) struct Cursor<'a> {
    pub(super) bytes: &'a [u8],
    pub(super) position: usize,
}

impl<'a> Cursor<'a> {
    pub(super) fn take(&mut self, count: u64, field: &str) -> Result<&'a [u8], FieldError> {
        let end = usize::try_from(count)
            .ok()
            .and_then(|count| self.position.checked_add(count));
        let taken = end.and_then(|end| Some((end, self.bytes.get(self.position..end)?)));
        let (end, taken) = taken.ok_or_else(|| {
            field_error(
                field,
                "is truncated, or has an offset beyond the end of the file",
            )
        })?;
        self.position = end;
        Ok(taken)
    }

    fn array<const N: usize>(&mut self, field: &str) -> Result<[u8; N], FieldError> {
        let mut array = [0; N];
        array.copy_from_slice(self.take(N as u64, field)?);
        Ok(array)
    }

    pub(super) fn u64(&mut self, field: &str) -> Result<u64, FieldError> {
        Ok(u64::from_le_bytes(self.array(field)?))
    }

    pub(super) fn i32(&mut self, field: &str) -> Result<i32, FieldError> {
        Ok(i32::from_le_bytes(self.array(field)?))
    }

    fn text(&mut self, field: &str) -> Result<String, FieldError> {
        let rest = self.bytes.get(self.position..).unwrap_or_default();
        let length = rest.iter().take(256).position(|&byte| byte == 0);
        let length = length.ok_or_else(|| field_error(field, "has a name without an end"))?;
        self.position += length + 1;
        Ok(String::from_utf8_lossy(&rest[..length]).into_owned())
    }
}

impl Header {
    pub(super) fn read(bytes: &[u8]) -> Result<Self, FieldError> {
        let mut cursor = Cursor { bytes, position: 0 };
        let [magic, version] = [
            cursor.i32("the first bytes")? as u32,
            cursor.i32("the version")? as u32,
        ];
        if magic != MAGIC {
            return Err(field_error("the first bytes", "are not those of OpenEXR"));
        }
        if version & 0xff != VERSION || version & PARTS != 0 {
            return Err(field_error(
                "the version",
                format!("{version:#x} is not that of a single deep part"),
            ));
        }
        if version & DEEP == 0 {
            let cause = "is that of a flat image, with position most one depth per pixel; open its folder instead, with depth in NAME_depth.exr";
            return Err(field_error("the version", cause));
        }
        let mut kind = None;
        let mut compression = None;
        let mut windows = [None; 2];
        let mut channels = None;
        let mut view = DeepView::default();
        loop {
            let name = cursor.text("the header")?;
            if name.is_empty() {
                break;
            }
            cursor.text(&name)?;
            let length = cursor.i32(&name)?;
            let value = cursor.take(
                u64::try_from(length).map_err(|_| field_error(&name, "has a negative length"))?,
                &name,
            )?;
            match name.as_str() {
                "type" => kind = Some(String::from_utf8_lossy(value).into_owned()),
                "compression" => compression = value.first().copied(),
                "displayWindow" => windows[0] = Some(window(value, &name)?),
                "dataWindow" => windows[1] = Some(window(value, &name)?),
                ENVIRONMENT => view.cube = value == [ENVIRONMENT_CUBE],
                WORLD_TO_CAMERA => view.world_to_camera = Some(matrix(value, &name)?),
                WORLD_TO_NDC => view.world_to_ndc = Some(matrix(value, &name)?),
                "channels" => channels = Some(channel_list(value)?),
                _ => {}
            }
        }
        if kind.as_deref() != Some(DEEP_SCANLINE) {
            return Err(field_error(
                "type",
                format!(
                    "{} is not supported, only {DEEP_SCANLINE}",
                    kind.as_deref().unwrap_or("missing")
                ),
            ));
        }
        let missing = |name: &str| field_error(name, "is missing");
        let code = compression.ok_or_else(|| missing("compression"))?;
        let compression = DeepCompression::from_code(code).ok_or_else(|| {
            field_error("compression", format!("{code} is not valid for deep data"))
        })?;
        let [(_, size_px), (origin_px, stored_px)] = [
            windows[0].ok_or_else(|| missing("displayWindow"))?,
            windows[1].ok_or_else(|| missing("dataWindow"))?,
        ];
        let channels = channels.ok_or_else(|| missing("channels"))?;
        Ok(Self {
            compression,
            size_px,
            origin_px,
            stored_px,
            channels,
            view,
            end: cursor.position,
        })
    }
}

/// Parses a window: corner and size.
fn window(value: &[u8], field: &str) -> Result<([i32; 2], [u32; 2]), FieldError> {
    let mut cursor = Cursor {
        bytes: value,
        position: 0,
    };
    let mut number = || cursor.i32(field);
    let [left, top, right, bottom] = [number()?, number()?, number()?, number()?];
    let [width, height] =
        [(left, right), (top, bottom)].map(|(low, high)| i64::from(high) - i64::from(low) + 1);
    if !(1..=MAX_SIDE).contains(&width)
        || !(1..=MAX_SIDE).contains(&height)
        || width * height > MAX_PIXELS
    {
        return Err(field_error(field, format!("is {width}x{height} pixels")));
    }
    Ok(([left, top], [width as u32, height as u32]))
}

fn matrix(value: &[u8], field: &str) -> Result<[f32; 16], FieldError> {
    let words: &[[u8; 4]] = value.as_chunks().0;
    let words: [[u8; 4]; 16] = words
        .try_into()
        .map_err(|_| field_error(field, "is not a 4x4 matrix"))?;
    Ok(words.map(f32::from_le_bytes))
}

fn channel_list(value: &[u8]) -> Result<Vec<(String, DeepKind)>, FieldError> {
    let mut cursor = Cursor {
        bytes: value,
        position: 0,
    };
    let mut channels = Vec::new();
    loop {
        let name = cursor.text("channels")?;
        if name.is_empty() {
            return if channels.is_empty() {
                Err(field_error("channels", "are missing"))
            } else {
                Ok(channels)
            };
        }
        let field = format!("channel \"{name}\"");
        let kind = match cursor.i32(&field)? {
            0 => DeepKind::Uint,
            1 => DeepKind::Half,
            2 => DeepKind::Float,
            other => return Err(field_error(&field, format!("has an unknown type {other}"))),
        };
        cursor.take(4, &field)?; // linearity flag and padding
        if [cursor.i32(&field)?, cursor.i32(&field)?] != [1, 1] {
            return Err(field_error(&field, "is subsampled"));
        }
        channels.push((name, kind));
    }
}

/// Encodes the header, up to the table of scanlines.
pub(super) fn encode(
    image: &DeepImage,
    channels: &[&DeepChannel],
    compression: DeepCompression,
) -> Vec<u8> {
    let long = if channels.iter().any(|channel| channel.name.len() > 31) {
        LONG_NAMES
    } else {
        0
    };
    let mut out = Vec::new();
    out.extend(MAGIC.to_le_bytes());
    out.extend((VERSION | DEEP | long).to_le_bytes());
    let mut attribute = |name: &str, kind: &str, value: &[u8]| {
        for text in [name, kind] {
            out.extend(text.as_bytes());
            out.push(0);
        }
        out.extend((value.len() as u32).to_le_bytes());
        out.extend(value);
    };
    let mut list = Vec::new();
    for channel in channels {
        list.extend(channel.name.as_bytes());
        list.push(0);
        let kind = channel.kind as u32;
        [kind, 0, 1, 1]
            .into_iter()
            .for_each(|number| list.extend(number.to_le_bytes()));
    }
    list.push(0);
    let window = |[left, top]: [i32; 2], [width, height]: [u32; 2]| {
        let corners = [left, top, left + width as i32 - 1, top + height as i32 - 1];
        corners
            .into_iter()
            .flat_map(i32::to_le_bytes)
            .collect::<Vec<u8>>()
    };
    attribute("channels", "chlist", &list);
    attribute("chunkCount", "int", &image.stored_px[1].to_le_bytes());
    attribute("compression", "compression", &[compression.code()]);
    attribute(
        "dataWindow",
        "box2i",
        &window(image.origin_px, image.stored_px),
    );
    attribute("displayWindow", "box2i", &window([0, 0], image.size_px));
    if image.view.cube {
        attribute(ENVIRONMENT, "envmap", &[ENVIRONMENT_CUBE]);
    }
    attribute("lineOrder", "lineOrder", &[0]);
    attribute("pixelAspectRatio", "float", &1f32.to_le_bytes());
    attribute("screenWindowCenter", "v2f", &[0; 8]);
    attribute("screenWindowWidth", "float", &1f32.to_le_bytes());
    attribute("type", "string", DEEP_SCANLINE.as_bytes());
    attribute("version", "int", &1u32.to_le_bytes());
    for (name, matrix) in [
        (WORLD_TO_CAMERA, image.view.world_to_camera),
        (WORLD_TO_NDC, image.view.world_to_ndc),
    ] {
        if let Some(matrix) = matrix {
            attribute(name, "m44f", &matrix.map(f32::to_le_bytes).concat());
        }
    }
    out.push(0);
    out
}

pub(super) fn put_values(kind: DeepKind, values: &[f32], out: &mut Vec<u8>) {
    for &value in values {
        match kind {
            DeepKind::Uint => out.extend((value as u32).to_le_bytes()),
            DeepKind::Half => out.extend(f16::from_f32(value).to_le_bytes()),
            DeepKind::Float => out.extend(value.to_le_bytes()),
        }
    }
}

pub(super) fn take_values(kind: DeepKind, bytes: &[u8], values: &mut Vec<f32>) {
    let words = bytes.as_chunks().0.iter();
    let halves = bytes.as_chunks().0.iter();
    match kind {
        DeepKind::Uint => values.extend(words.map(|word| u32::from_le_bytes(*word) as f32)),
        DeepKind::Half => values.extend(halves.map(|half| f16::from_le_bytes(*half).to_f32())),
        DeepKind::Float => values.extend(words.map(|word| f32::from_le_bytes(*word))),
    }
}
