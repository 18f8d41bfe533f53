//! Depth files and the meaning of their values.

use super::ImagesError;
use super::exr_layer::ExrLayer;
use exr::prelude::{Encoding, Image, LineOrder, SpecificChannels, WritableImage};
use headbox_core::depth_kind::DepthKind;
use headbox_core::files::write_whole;
use headbox_core::image::codec::{self, MAX_PIXELS};
use std::io;
use std::path::{Path, PathBuf};

/// Maximum distance of a window depth from that of an infinite far plane to count as infinitely
/// far: the resolution of 32 bits; that of 16 is coarser.
const INFINITELY_FAR: f64 = 1e-6;

/// One depth value for each pixel, of any kind.
#[derive(Clone, Debug, PartialEq)]
pub struct DepthPicture {
    /// Width, pixels.
    pub width: u32,
    /// Height, pixels.
    pub height: u32,
    /// Values, row-major.
    pub values: Vec<f32>,
}

/// Writes depth as an EXR file with the single 32-bit channel `Z`.
///
/// # Errors
/// If the file cannot be written.
pub fn write_depth_exr(depth: &DepthPicture, path: &Path) -> io::Result<()> {
    let width = depth.width as usize;
    let value = |x: usize, y: usize| depth.values.get(y * width + x).copied().unwrap_or(f32::NAN);
    let channels = SpecificChannels::build()
        .with_channel("Z")
        .with_pixel_fn(|pixel: exr::math::Vec2<usize>| (value(pixel.x(), pixel.y()),));
    // Blocks in a fixed order, so that the bytes do not depend on threads.
    let encoding = Encoding {
        line_order: LineOrder::Increasing,
        ..Encoding::FAST_LOSSLESS
    };
    let size = (width, depth.height as usize);
    let image = Image::from_encoded_channels(size, encoding, channels);
    write_whole(path, |writer| {
        image.write().to_buffered(writer).map_err(io::Error::other)
    })
}

/// Depth file of a view and the meaning of its values.
#[derive(Clone, Debug, PartialEq)]
pub struct DepthSource {
    /// EXR, 16-bit grey image, or `.bin` map of COLMAP.
    pub path: PathBuf,
    /// Channel of an EXR, or `None` for `Z`, else `Y`, `R`, or the only one; R, G, B or A of a
    /// colour image of integers.
    pub channel: Option<String>,
    /// Kind of depth that a value times `unit_m` is.
    pub kind: DepthKind,
    /// Metres per stored value (per step in integer images); 1/65535 for window depth in 16 bits.
    pub unit_m: f32,
    /// For [`DepthKind::WindowDepth`]: entries (2, 2) and (2, 3) of the clip matrix, which also
    /// show reversed depth.
    pub window: Option<[f64; 2]>,
    /// True if zero means infinitely far (Seurat) instead of unknown.
    pub zero_is_far: bool,
    /// True if integers are fractions of 1 (Seurat), so that 0 and 65535 are depths.
    pub is_share: bool,
    /// Standard deviation of inverse depth, 1/m, if the depth was estimated from the photographs
    /// ([`super::dense_depth`]). Such depth belongs to the undistorted lens and needs no
    /// registration.
    pub estimated_deviation: Option<f32>,
}

impl DepthSource {
    /// Creates a source of eye depth or ray distance in units of `unit_m`.
    pub fn metres(path: PathBuf, kind: DepthKind, unit_m: f32) -> Self {
        Self {
            path,
            channel: None,
            kind,
            unit_m,
            window: None,
            zero_is_far: false,
            is_share: false,
            estimated_deviation: None,
        }
    }

    /// Reads eye depth, or ray distance if that is the kind, in metres: infinite where the file
    /// marks background (infinity in EXR, zero in Seurat's manifests), NaN where unknown (otherwise
    /// zero, negative values, and the largest 16-bit value unless it is a fraction of 1: sensors
    /// write it for "none").
    ///
    /// # Errors
    /// [`ImagesError`] that names the file.
    pub fn read(&self) -> Result<DepthPicture, ImagesError> {
        let channel = self.channel.as_deref();
        let mut picture = match extension(&self.path).as_str() {
            "exr" => read_exr(&self.path, channel, self.unit_m)?,
            "bin" => read_colmap_map(&self.path)?,
            _ => {
                let format = IntegerFormat {
                    eight_bits: false,
                    are_shares: self.is_share,
                    channel,
                };
                read_integers(&self.path, self.unit_m, &format)?
            }
        };
        for value in &mut picture.values {
            let depth = match (self.kind, self.window) {
                // Window depth d is (ndc + 1) / 2, and ndc = -a + b / Z with the clip matrix's a
                // and b (C1).
                (DepthKind::WindowDepth, Some([a, b])) => {
                    let from_infinity = 2.0 * f64::from(*value) - 1.0 + a;
                    if from_infinity.abs() < INFINITELY_FAR {
                        f32::INFINITY
                    } else {
                        (b / from_infinity) as f32
                    }
                }
                _ if self.zero_is_far && *value == 0.0 => f32::INFINITY,
                _ => *value,
            };
            *value = if depth > 0.0 { depth } else { f32::NAN };
        }
        Ok(picture)
    }
}

impl DepthPicture {
    /// Reads depth from EXR (channel `Z`, else `Y`, `R`, or the only one) or from a grey image of 8
    /// or 16 bits such as PNG. Each stored value is multiplied by `unit`: metres per value (0.001
    /// for millimetres in 16-bit PNG), or 1/65535 for window depth in 16 bits. In integer images 0
    /// means unknown and becomes NaN.
    ///
    /// # Errors
    /// [`ImagesError`] that names the file.
    pub fn read(path: &Path, unit: f32) -> Result<Self, ImagesError> {
        if extension(path) == "exr" {
            read_exr(path, None, unit)
        } else {
            let format = IntegerFormat {
                eight_bits: true,
                are_shares: false,
                channel: None,
            };
            read_integers(path, unit, &format)
        }
    }
}

/// Returns the extension in lower case, or an empty string.
pub(super) fn extension(path: &Path) -> String {
    path.extension()
        .map(|extension| extension.to_string_lossy().to_lowercase())
        .unwrap_or_default()
}

fn read_exr(path: &Path, channel: Option<&str>, unit: f32) -> Result<DepthPicture, ImagesError> {
    let bad = |cause: String| ImagesError::invalid_picture(path, cause);
    let layer = ExrLayer::read(path)?;
    let samples = match channel {
        Some(name) => layer
            .channel(name)
            .ok_or_else(|| bad(format!("has no channel {name}")))?,
        None => {
            let usual = ["Z", "Y", "R"]
                .into_iter()
                .find_map(|name| layer.channel(name));
            let usual = usual.or_else(|| layer.only_channel());
            usual.ok_or_else(|| bad("has no channel Z, Y or R with depth".into()))?
        }
    };
    let values = samples.values_as_f32().map(|value| value * unit).collect();
    Ok(DepthPicture {
        width: layer.width,
        height: layer.height,
        values,
    })
}

/// Interpretation of integer images as depth.
struct IntegerFormat<'a> {
    /// True if 8-bit images are accepted.
    eight_bits: bool,
    /// True if the smallest and the largest value are depths.
    are_shares: bool,
    /// Channel of a colour image.
    channel: Option<&'a str>,
}

fn read_integers(
    path: &Path,
    unit: f32,
    format: &IntegerFormat,
) -> Result<DepthPicture, ImagesError> {
    let bad = |cause: String| ImagesError::invalid_picture(path, cause);
    let image =
        codec::read(path, 2 * MAX_PIXELS).map_err(|error| ImagesError::picture(path, error))?;
    let values: Vec<u16> = match &image.image {
        image::DynamicImage::ImageLuma8(grey) if format.eight_bits => {
            grey.as_raw().iter().map(|&v| u16::from(v)).collect()
        }
        image::DynamicImage::ImageLuma8(_) => {
            return Err(bad(
                "has depth in 8 bits, too few for parallax; use 16 bits or EXR".into(),
            ));
        }
        image::DynamicImage::ImageLuma16(grey) => grey.as_raw().clone(),
        image::DynamicImage::ImageRgb16(_) | image::DynamicImage::ImageRgba16(_)
            if format.channel.is_some() =>
        {
            let name = format.channel.unwrap_or_default();
            let channel = ["R", "G", "B", "A"].iter().position(|known| *known == name);
            let channel =
                channel.ok_or_else(|| bad(format!("has no channel {name}, only R, G, B and A")))?;
            image
                .image
                .to_rgba16()
                .pixels()
                .map(|pixel| pixel.0[channel])
                .collect()
        }
        _ => {
            return Err(bad(
                "is not a depth image; expected 8 or 16 bits of grey, or EXR".into(),
            ));
        }
    };
    let is_unknown =
        |v: u16| !format.are_shares && (v == 0 || (!format.eight_bits && v == u16::MAX));
    let value = |v: u16| {
        if is_unknown(v) {
            f32::NAN
        } else {
            f32::from(v) * unit
        }
    };
    let values = values.into_iter().map(value).collect();
    Ok(DepthPicture {
        width: image.image.width(),
        height: image.image.height(),
        values,
    })
}

/// Reads a depth map of COLMAP's dense reconstruction: `width&height&channels&`, then 32-bit
/// floats.
fn read_colmap_map(path: &Path) -> Result<DepthPicture, ImagesError> {
    let bytes = std::fs::read(path).map_err(|cause| ImagesError::io(path, cause))?;
    let bad = |cause: &str| ImagesError::invalid_picture(path, cause);
    let mut rest = bytes.as_slice();
    let mut header = [0usize; 3];
    for number in &mut header {
        let end = rest
            .iter()
            .take(12)
            .position(|&byte| byte == b'&')
            .ok_or_else(|| bad("is not a COLMAP depth map"))?;
        let text = std::str::from_utf8(&rest[..end])
            .ok()
            .and_then(|text| text.parse().ok());
        *number = text.ok_or_else(|| bad("is not a COLMAP depth map"))?;
        rest = &rest[end + 1..];
    }
    let [width, height, channels] = header;
    let count = width
        .checked_mul(height)
        .filter(|&count| count as u64 <= MAX_PIXELS && channels == 1);
    let count = count.ok_or_else(|| bad("is not a COLMAP depth map with one channel"))?;
    if rest.len() != count * 4 {
        return Err(bad(
            "has a length that does not match the size in its header",
        ));
    }
    let words = rest.as_chunks().0.iter();
    Ok(DepthPicture {
        width: width as u32,
        height: height as u32,
        values: words.map(|word| f32::from_le_bytes(*word)).collect(),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn source(path: PathBuf, kind: DepthKind, window: Option<[f64; 2]>) -> DepthSource {
        let shares = DepthSource::metres(path, kind, 1.0 / 65_535.0);
        DepthSource {
            window,
            is_share: true,
            ..shares
        }
    }

    /// Saves one row of a 16-bit grey image.
    fn save_grey(path: &Path, values: &[u16]) {
        image::ImageBuffer::<image::Luma<u16>, _>::from_raw(
            values.len() as u32,
            1,
            values.to_vec(),
        )
        .expect("a picture")
        .save(path)
        .expect("written");
    }

    #[test]
    fn window_depth_normal_and_reversed() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("d.png");
        let near = 0.5;
        let far = 20.0;
        for reversed in [false, true] {
            // OpenGL clip matrices: near to -1 and far to 1, and reversed.
            let sign = if reversed { -1.0 } else { 1.0 };
            let a = -sign * (far + near) / (far - near);
            let b = -sign * 2.0 * far * near / (far - near);
            let depths = [0.6, 1.0, 3.0, 15.0];
            let stored = depths.map(|z: f64| ((-a + b / z + 1.0) / 2.0 * 65_535.0).round() as u16);
            save_grey(&path, &stored);
            let read = source(path.clone(), DepthKind::WindowDepth, Some([a, b]))
                .read()
                .expect("read");
            for (depth, z) in read.values.iter().zip(depths) {
                // Half a step of 16 bits times dZ/dd = Z^2 (f - n) / (n f) (C1).
                let tolerance = 0.6 / 65_535.0 * z * z * (far - near) / (near * far);
                assert!(
                    (f64::from(*depth) - z).abs() < tolerance + 1e-5 * z,
                    "{depth} {z} {reversed}"
                );
            }
        }
    }

    #[test]
    fn sixteen_bits_unknown_is_nan_eight_refused() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("d.png");
        save_grey(&path, &[0, 65_535, 1500]);
        let read = DepthSource::metres(path.clone(), DepthKind::EyeDepth, 0.001)
            .read()
            .expect("read");
        assert!(
            read.values[0].is_nan()
                && read.values[1].is_nan()
                && (read.values[2] - 1.5).abs() < 1e-6
        );
        image::GrayImage::new(2, 2).save(&path).expect("written");
        let error = DepthSource::metres(path, DepthKind::EyeDepth, 0.001)
            .read()
            .expect_err("refused")
            .to_string();
        assert!(
            error.contains("d.png") && error.contains("8 bits"),
            "{error}"
        );
    }

    #[test]
    fn infinite_depth_distinct_from_unknown() {
        let folder = tempfile::tempdir().expect("a folder");
        let [exr, png] = ["d.exr", "d.png"].map(|name| folder.path().join(name));
        let values = vec![f32::INFINITY, f32::NAN, 0.0, -1.0, 2.0];
        write_depth_exr(
            &DepthPicture {
                width: 5,
                height: 1,
                values,
            },
            &exr,
        )
        .expect("written");
        save_grey(&png, &[0, 65_535, 1500]);
        let read = |path: &Path, zero_is_far: bool| {
            // Seurat's fractions of 1 are all valid, from the smallest to the largest.
            let metres = DepthSource::metres(path.into(), DepthKind::EyeDepth, 0.5);
            let source = DepthSource {
                zero_is_far,
                is_share: zero_is_far,
                ..metres
            };
            let word = |value: f32| match value {
                _ if value.is_nan() => "unknown".to_owned(),
                f32::INFINITY => "far".to_owned(),
                depth => format!("{depth}"),
            };
            source
                .read()
                .expect("read")
                .values
                .into_iter()
                .map(word)
                .collect::<Vec<_>>()
                .join(" ")
        };
        assert_eq!(read(&exr, false), "far unknown unknown unknown 1");
        assert_eq!(read(&exr, true), "far unknown far unknown 1");
        assert_eq!(read(&png, false), "unknown unknown 750");
        assert_eq!(read(&png, true), "far 32767.5 750");
        save_grey(&png, &[0, 65_535]);
        // Infinite far planes, and reversed ones.
        for (window, expected) in [
            ([-1.0, -0.2], [0.1, f32::INFINITY]),
            ([1.0, 0.2], [f32::INFINITY, 0.1]),
        ] {
            let read = source(png.clone(), DepthKind::WindowDepth, Some(window))
                .read()
                .expect("read")
                .values;
            assert!(
                (read[0] - expected[0]).abs() < 1e-6 || read[0] == expected[0],
                "{read:?}"
            );
            assert!(
                (read[1] - expected[1]).abs() < 1e-6 || read[1] == expected[1],
                "{read:?}"
            );
        }
    }

    #[test]
    fn colmap_map_length_checked() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("a.jpg.geometric.bin");
        let mut bytes = b"2&1&1&".to_vec();
        bytes.extend(
            1.5f32
                .to_le_bytes()
                .into_iter()
                .chain((-1f32).to_le_bytes()),
        );
        std::fs::write(&path, &bytes).expect("written");
        let source = DepthSource::metres(path.clone(), DepthKind::EyeDepth, 1.0);
        let read = source.read().expect("read");
        assert!(read.values[0] == 1.5 && read.values[1].is_nan());
        for broken in [&bytes[..9], b"99999999&99999999&1&", b"x", b""] {
            std::fs::write(&path, broken).expect("written");
            assert!(source.read().is_err());
        }
    }
}
