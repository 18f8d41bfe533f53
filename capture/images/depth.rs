//! Depth in files, and what it means.

use super::ImagesError;
use super::exr_layer::ExrLayer;
use exr::prelude::{Image, SpecificChannels, WritableImage};
use headbox_core::depth_kind::DepthKind;
use headbox_core::files::write_whole;
use headbox_core::image_file;
use headbox_core::image_file::MAX_PIXELS;
use std::io;
use std::path::{Path, PathBuf};

/// Window depth so near to what an infinite far plane has is infinitely far: 32 bits, and sixteen all the more, tell no more.
const INFINITELY_FAR: f64 = 1e-6;

/// A depth per pixel, whatever it means.
#[derive(Clone, Debug, PartialEq)]
pub struct DepthPicture {
    /// Columns.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// Row-major.
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
        .with_pixel_fn(|at: exr::math::Vec2<usize>| (value(at.x(), at.y()),));
    let image = Image::from_channels((width, depth.height as usize), channels);
    write_whole(path, |writer| {
        image.write().to_buffered(writer).map_err(io::Error::other)
    })
}

/// Where a view's depth is, and what its values mean.
#[derive(Clone, Debug, PartialEq)]
pub struct DepthSource {
    /// EXR, a grey picture of 16 bits, or a `.bin` map of COLMAP.
    pub path: PathBuf,
    /// Channel of an EXR; `None` for `Z`, or else `Y`, `R`, or the only one. Of a picture of integers with colours R, G, B or A.
    pub channel: Option<String>,
    /// What a value means once it is multiplied by `unit_m`.
    pub kind: DepthKind,
    /// Metres per stored value (in integer pictures, per step); 1/65535 for window depth in 16 bits.
    pub unit_m: f32,
    /// For [`DepthKind::WindowDepth`]: entries (2, 2) and (2, 3) of the clip matrix, which also tell reversed depth.
    pub window: Option<[f64; 2]>,
    /// Whether zero is infinitely far (Seurat's), not unknown.
    pub zero_is_far: bool,
    /// Whether integers are shares of 1 (Seurat's), all of which say something.
    pub is_share: bool,
    /// Of depth that was found from the pictures themselves ([`super::dense_depth`]), which belongs to the ideal lens and needs no
    /// registration: the standard deviation of inverse depth, 1/m.
    pub found: Option<f32>,
}

impl DepthSource {
    /// Eye depth, or ray distance, in metres.
    pub fn metres(path: PathBuf, kind: DepthKind, unit_m: f32) -> Self {
        Self {
            path,
            channel: None,
            kind,
            unit_m,
            window: None,
            zero_is_far: false,
            is_share: false,
            found: None,
        }
    }

    /// Reads it: eye depth, or ray distance if that is its kind, in metres; infinite where the file says that nothing is there (infinity in EXR, zero in
    /// Seurat's manifests), NaN where nothing is known (else zero, negative values, and the largest value of 16 bits that is no share, which
    /// sensors write for "none").
    ///
    /// # Errors
    /// [`ImagesError`] that names the file.
    pub fn read(&self) -> Result<DepthPicture, ImagesError> {
        let mut picture = match extension(&self.path).as_str() {
            "exr" => read_exr(&self.path, self.channel.as_deref(), self.unit_m)?,
            "bin" => read_colmap_map(&self.path)?,
            _ => {
                let channel = self.channel.as_deref();
                read_integers(
                    &self.path,
                    self.unit_m,
                    &Integers {
                        eight_bits: false,
                        are_shares: self.is_share,
                        channel,
                    },
                )?
            }
        };
        for value in &mut picture.values {
            let depth = match (self.kind, self.window) {
                // Window depth d is (ndc + 1) / 2, and ndc = -a + b / Z with the clip matrix's a and b (C1).
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
    /// Reads depth from EXR (channel `Z`, or else `Y`, `R`, or the only one) or from a grey picture of 8 or 16 bits such
    /// as PNG. Each stored value is multiplied by `unit`: metres per value (0.001 for millimetres in 16-bit PNG), or
    /// 1/65535 for window depth in 16 bits. In integer pictures 0 means unknown and becomes NaN.
    ///
    /// # Errors
    /// [`ImagesError`] that names the file.
    pub fn read(path: &Path, unit: f32) -> Result<Self, ImagesError> {
        if extension(path) == "exr" {
            read_exr(path, None, unit)
        } else {
            read_integers(
                path,
                unit,
                &Integers {
                    eight_bits: true,
                    are_shares: false,
                    channel: None,
                },
            )
        }
    }
}

pub(super) fn extension(path: &Path) -> String {
    path.extension()
        .map(|extension| extension.to_string_lossy().to_lowercase())
        .unwrap_or_default()
}

fn read_exr(path: &Path, wanted: Option<&str>, unit: f32) -> Result<DepthPicture, ImagesError> {
    let bad = |cause: String| ImagesError::Picture {
        path: path.into(),
        cause,
    };
    let layer = ExrLayer::read(path)?;
    let samples = match wanted {
        Some(name) => layer
            .channel(name)
            .ok_or_else(|| bad(format!("has no channel {name}")))?,
        None => {
            let usual = ["Z", "Y", "R"]
                .into_iter()
                .find_map(|name| layer.channel(name));
            let usual = usual.or_else(|| layer.only_channel());
            usual.ok_or_else(|| bad("has no channel Z, Y or R to take depth from".into()))?
        }
    };
    let values = samples.values_as_f32().map(|value| value * unit).collect();
    Ok(DepthPicture {
        width: layer.width,
        height: layer.height,
        values,
    })
}

/// Which integers are depth.
struct Integers<'a> {
    /// Those of 8 bits too.
    eight_bits: bool,
    /// The least and the largest too.
    are_shares: bool,
    /// Of pictures with colours.
    channel: Option<&'a str>,
}

fn read_integers(path: &Path, unit: f32, which: &Integers) -> Result<DepthPicture, ImagesError> {
    let bad = |cause: String| ImagesError::Picture {
        path: path.into(),
        cause,
    };
    let image = image_file::read(path, 2 * MAX_PIXELS)
        .map_err(|error| ImagesError::picture(path, error))?;
    let values: Vec<u16> = match &image {
        image::DynamicImage::ImageLuma8(grey) if which.eight_bits => {
            grey.as_raw().iter().map(|&v| u16::from(v)).collect()
        }
        image::DynamicImage::ImageLuma8(_) => {
            return Err(bad(
                "depth in 8 bits has 255 steps, too few to move by; give 16 bits, or EXR".into(),
            ));
        }
        image::DynamicImage::ImageLuma16(grey) => grey.as_raw().clone(),
        image::DynamicImage::ImageRgb16(_) | image::DynamicImage::ImageRgba16(_)
            if which.channel.is_some() =>
        {
            let name = which.channel.unwrap_or_default();
            let channel = ["R", "G", "B", "A"].iter().position(|known| *known == name);
            let channel =
                channel.ok_or_else(|| bad(format!("has no channel {name}, only R, G, B and A")))?;
            image
                .to_rgba16()
                .pixels()
                .map(|pixel| pixel.0[channel])
                .collect()
        }
        _ => {
            return Err(bad(
                "depth must be a grey picture of 8 or 16 bits, or EXR".into()
            ));
        }
    };
    let unknown = |v: u16| !which.are_shares && (v == 0 || (!which.eight_bits && v == u16::MAX));
    let value = |v: u16| {
        if unknown(v) {
            f32::NAN
        } else {
            f32::from(v) * unit
        }
    };
    let values = values.into_iter().map(value).collect();
    Ok(DepthPicture {
        width: image.width(),
        height: image.height(),
        values,
    })
}

/// A depth map of COLMAP's dense reconstruction: `width&height&channels&`, then 32-bit floats.
fn read_colmap_map(path: &Path) -> Result<DepthPicture, ImagesError> {
    let bytes = std::fs::read(path).map_err(|cause| ImagesError::io(path, cause))?;
    let bad = |cause: &str| ImagesError::Picture {
        path: path.into(),
        cause: cause.into(),
    };
    let mut rest = bytes.as_slice();
    let mut header = [0usize; 3];
    for number in &mut header {
        let end = rest
            .iter()
            .take(12)
            .position(|&byte| byte == b'&')
            .ok_or_else(|| bad("is no depth map of COLMAP"))?;
        let text = std::str::from_utf8(&rest[..end])
            .ok()
            .and_then(|text| text.parse().ok());
        *number = text.ok_or_else(|| bad("is no depth map of COLMAP"))?;
        rest = &rest[end + 1..];
    }
    let [width, height, channels] = header;
    let count = width
        .checked_mul(height)
        .filter(|&count| count as u64 <= MAX_PIXELS && channels == 1);
    let count = count.ok_or_else(|| bad("is no depth map of COLMAP with one channel"))?;
    if rest.len() != count * 4 {
        return Err(bad("is truncated, or has more bytes than its size says"));
    }
    let values = rest
        .chunks_exact(4)
        .map(|four| f32::from_le_bytes([four[0], four[1], four[2], four[3]]))
        .collect();
    Ok(DepthPicture {
        width: width as u32,
        height: height as u32,
        values,
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

    #[test]
    fn window_depth_of_either_direction_gives_eye_depth() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("d.png");
        let (near, far) = (0.5, 20.0);
        for reversed in [false, true] {
            // Clip matrices of OpenGL, near to -1 and far to 1, and with both exchanged.
            let sign = if reversed { -1.0 } else { 1.0 };
            let (a, b) = (
                -sign * (far + near) / (far - near),
                -sign * 2.0 * far * near / (far - near),
            );
            let depths = [0.6, 1.0, 3.0, 15.0];
            let stored = depths.map(|z: f64| ((-a + b / z + 1.0) / 2.0 * 65_535.0).round() as u16);
            let grey = image::ImageBuffer::<image::Luma<u16>, _>::from_raw(4, 1, stored.to_vec())
                .expect("a picture");
            grey.save(&path).expect("written");
            let read = source(path.clone(), DepthKind::WindowDepth, Some([a, b]))
                .read()
                .expect("read");
            for (found, z) in read.values.iter().zip(depths) {
                // Half a step of 16 bits times dZ/dd = Z^2 (f - n) / (n f) (C1).
                let tolerance = 0.6 / 65_535.0 * z * z * (far - near) / (near * far);
                assert!(
                    (f64::from(*found) - z).abs() < tolerance + 1e-5 * z,
                    "{found} {z} {reversed}"
                );
            }
        }
    }

    #[test]
    fn unknown_depth_is_nan_and_eight_bits_are_refused() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("d.png");
        let grey =
            image::ImageBuffer::<image::Luma<u16>, _>::from_raw(3, 1, vec![0u16, 65_535, 1500]);
        grey.expect("a picture").save(&path).expect("written");
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
    fn infinitely_far_is_told_from_unknown() {
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
        let grey =
            image::ImageBuffer::<image::Luma<u16>, _>::from_raw(3, 1, vec![0u16, 65_535, 1500]);
        grey.expect("a picture").save(&png).expect("written");
        let read = |path: &Path, zero_is_far: bool| {
            // Seurat's shares of 1 are known from the least to the largest.
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
        let far = image::ImageBuffer::<image::Luma<u16>, _>::from_raw(2, 1, vec![0u16, 65_535])
            .expect("a picture");
        far.save(&png).expect("written");
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
    fn depth_maps_of_colmap_are_checked_against_their_length() {
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
