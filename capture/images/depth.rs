//! Depth files and the meaning of their values.

use super::ImagesError;
use super::depth_files::{self, DepthFormat};
use exr::prelude::{Encoding, Image, LineOrder, SpecificChannels, WritableImage};
use headbox_core::depth_kind::DepthKind;
use headbox_core::files::write_whole;
use headbox_core::image::orientation::{self, Orientation};
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
    /// EXR, 16-bit grey image, TIFF, NPY, or `.bin` map of COLMAP.
    pub path: PathBuf,
    /// Channel of an EXR, or `None` for the one with depth; R, G, B or A of a colour image of
    /// integers.
    pub channel: Option<String>,
    /// Kind of depth that a value times `unit_m` is.
    pub kind: DepthKind,
    /// Metres per stored integer, unless [`Self::is_share`].
    pub unit_m: f32,
    /// Metres per stored floating-point number.
    pub float_unit_m: f32,
    /// For [`DepthKind::WindowDepth`]: entries (2, 2) and (2, 3) of the clip matrix, which also
    /// show reversed depth.
    pub window: Option<[f64; 2]>,
    /// True if zero means infinitely far (Seurat) instead of unknown.
    pub zero_is_far: bool,
    /// True if integers are fractions of the largest of their type (Seurat), so that 0 and 65535
    /// are depths.
    pub is_share: bool,
    /// Standard deviation of inverse depth, 1/m, if the depth was estimated from the photographs
    /// ([`super::dense_depth`]). Such depth belongs to the undistorted lens and needs no
    /// registration.
    pub estimated_deviation: Option<f32>,
    /// Properties that the set's files do not specify.
    pub assumed: AssumedDepth,
}

/// Properties of depth files that a set does not specify, so that its reader assumes those of its
/// format; [`super::ImageSet::open`] compares them with the depth itself.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct AssumedDepth {
    /// True if [`DepthSource::kind`] is assumed.
    pub kind: bool,
    /// True if [`DepthSource::unit_m`] and [`DepthSource::float_unit_m`] are assumed.
    pub unit: bool,
}

impl DepthSource {
    /// Creates a source of eye depth or ray distance in units of `unit_m`, integer or not.
    pub fn metres(path: PathBuf, kind: DepthKind, unit_m: f32) -> Self {
        Self {
            path,
            channel: None,
            kind,
            unit_m,
            float_unit_m: unit_m,
            window: None,
            zero_is_far: false,
            is_share: false,
            estimated_deviation: None,
            assumed: AssumedDepth::default(),
        }
    }

    /// Creates a source whose kind and unit are not specified: integers in millimetres,
    /// floating-point numbers in metres.
    pub fn assumed(path: PathBuf, kind: DepthKind) -> Self {
        Self {
            float_unit_m: 1.0,
            assumed: AssumedDepth {
                kind: true,
                unit: true,
            },
            ..Self::metres(path, kind, 0.001)
        }
    }

    /// Returns the near and the far plane of the clip matrix, in its unit; the far one may be
    /// infinite. `None` without a matrix.
    pub(super) fn clip_range(&self) -> Option<[f64; 2]> {
        let [a, b] = self.window?;
        // Depth where the window depth is 0 and 1; they are swapped if it is reversed.
        let ends = [b / (a - 1.0), b / (a + 1.0)];
        let [low, high] = [ends[0].min(ends[1]), ends[0].max(ends[1])];
        let far = if low > 0.0 { high } else { f64::INFINITY };
        let near = if low > 0.0 { low } else { high };
        (near > 0.0 && near.is_finite()).then_some([near, far])
    }

    /// Reads eye depth, or ray distance if that is the kind, in metres: infinite where the file
    /// marks background (infinity in EXR, zero in Seurat's manifests), NaN where unknown (otherwise
    /// zero, negative values, and the largest 16-bit value unless it is a fraction of 1: sensors
    /// write it for "none").
    ///
    /// # Errors
    /// [`ImagesError`] that names the file.
    pub fn read(&self) -> Result<DepthPicture, ImagesError> {
        let mut picture = depth_files::read(
            &self.path,
            &DepthFormat {
                unit: (!self.is_share).then_some(self.unit_m),
                float_unit: self.float_unit_m,
                eight_bits: false,
                are_shares: self.is_share,
                channel: self.channel.as_deref(),
            },
        )?;
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
    /// Reads depth from EXR (channel `Z` and others, see [`ExrParts::depth`]), TIFF, NPY, or from a
    /// grey image of 8 or 16 bits such as PNG. Integers are multiplied by `unit`: metres per value
    /// (0.001 for millimetres in 16-bit PNG), or 1/65535 for window depth in 16 bits;
    /// floating-point numbers by `float_unit`. Of integers 0 means unknown and becomes NaN.
    ///
    /// # Errors
    /// [`ImagesError`] that names the file.
    ///
    /// [`ExrParts::depth`]: headbox_core::image::exr_channels::ExrParts::depth
    pub fn read(path: &Path, unit: f32, float_unit: f32) -> Result<Self, ImagesError> {
        Self::read_scaled(path, Some(unit), float_unit)
    }

    /// Same as [`Self::read`] for integers that are fractions of the largest of their type, of any
    /// number of bits, such as window depth.
    ///
    /// # Errors
    /// [`ImagesError`] that names the file.
    pub fn read_fractions(path: &Path, float_unit: f32) -> Result<Self, ImagesError> {
        Self::read_scaled(path, None, float_unit)
    }

    fn read_scaled(path: &Path, unit: Option<f32>, float_unit: f32) -> Result<Self, ImagesError> {
        depth_files::read(
            path,
            &DepthFormat {
                unit,
                float_unit,
                eight_bits: true,
                are_shares: false,
                channel: None,
            },
        )
    }

    /// Returns the depth at the pixels of an image of the same rays and another resolution; `None`
    /// if the sides have different proportions, by more than rounding them explains.
    ///
    /// Between pixels, inverse depth is interpolated, which is linear on planes; at silhouettes and
    /// next to unknown depth the nearest pixel is taken, so that no surface arises between front
    /// and back. Values that are neither eye depth nor distance (window depth) need
    /// `take_nearest`.
    #[must_use]
    pub fn resampled(&self, size_px: [u32; 2], take_nearest: bool) -> Option<Self> {
        let own = [self.width, self.height];
        if own == size_px {
            return Some(self.clone());
        }
        if !has_proportions(own, size_px) || self.values.len() < (own[0] as usize * own[1] as usize)
        {
            return None;
        }
        let positions = |axis: usize| -> Vec<(usize, usize, f64)> {
            let scale = f64::from(own[axis]) / f64::from(size_px[axis]);
            let last = f64::from(own[axis] - 1);
            let position = |i: u32| {
                let at = ((f64::from(i) + 0.5) * scale - 0.5).clamp(0.0, last);
                let low = at as usize;
                (low, (low + 1).min(last as usize), at.fract())
            };
            (0..size_px[axis]).map(position).collect()
        };
        let [columns, rows] = [positions(0), positions(1)];
        let width = self.width as usize;
        let mut values = Vec::with_capacity(columns.len() * rows.len());
        for &(y0, y1, fy) in &rows {
            for &(x0, x1, fx) in &columns {
                let corners = [(x0, y0), (x1, y0), (x0, y1), (x1, y1)];
                let corners = corners.map(|(x, y)| self.values[y * width + x]);
                let nearest = corners[usize::from(fx >= 0.5) + 2 * usize::from(fy >= 0.5)];
                values.push(if take_nearest {
                    nearest
                } else {
                    interpolate(corners, [fx, fy], nearest)
                });
            }
        }
        Some(Self {
            width: size_px[0],
            height: size_px[1],
            values,
        })
    }

    /// Turns the picture.
    #[must_use]
    pub fn turned(&self, orientation: Orientation) -> Self {
        let size = [self.width, self.height];
        let ([width, height], values) = orientation::turn(size, &self.values, orientation);
        Self {
            width,
            height,
            values,
        }
    }
}

/// Largest relative difference of the depths of adjacent pixels of one surface.
const SAME_SURFACE: f32 = 0.1;

/// Interpolates the inverse depths of four pixels, or returns `nearest` unless they belong to one
/// surface.
fn interpolate(corners: [f32; 4], [fx, fy]: [f64; 2], nearest: f32) -> f32 {
    let low = corners.into_iter().fold(f32::INFINITY, f32::min);
    let high = corners.into_iter().fold(f32::NEG_INFINITY, f32::max);
    let is_known = |depth: &f32| depth.is_finite() && *depth > 0.0;
    if !corners.iter().all(is_known) || high > low * (1.0 + SAME_SURFACE) || low == high {
        return nearest;
    }
    let [a, b, c, d] = corners.map(|depth| 1.0 / f64::from(depth));
    let top = a + (b - a) * fx;
    let bottom = c + (d - c) * fx;
    (1.0 / (top + (bottom - top) * fy)) as f32
}

/// Returns true if two sizes have the same proportions: ScanNet's 640x480 of 1296x968 differ by
/// 0.4 %.
pub(super) fn has_proportions(a: [u32; 2], b: [u32; 2]) -> bool {
    const TOLERANCE: f64 = 0.01;
    let [scale_x, scale_y] = [0, 1].map(|axis| f64::from(a[axis]) / f64::from(b[axis]));
    // Rounding of the smaller sides.
    let side = a.iter().chain(&b).min().copied().unwrap_or(1).max(1);
    let tolerance = TOLERANCE.max(0.5 / f64::from(side));
    (scale_x / scale_y - 1.0).abs() <= tolerance
}

/// Returns the extension in lower case, or an empty string.
pub(super) fn extension(path: &Path) -> String {
    path.extension()
        .map(|extension| extension.to_string_lossy().to_lowercase())
        .unwrap_or_default()
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
        let share = 1500.0 * (1.0 / 65_535.0f32);
        assert_eq!(read(&png, true), format!("far 1 {share}"));
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

    #[test]
    fn resampled_depth_is_exact_on_planes() {
        // Inverse depth is linear: 0.2 + 0.004 x + 0.008 y at the pixels of the small picture.
        let small = |x: u32, y: u32| 1.0 / (0.2 + 0.004 * x as f32 + 0.008 * y as f32);
        let pixels = |width: u32, height: u32| {
            (0..height).flat_map(move |y| (0..width).map(move |x| (x, y)))
        };
        let mut picture = DepthPicture {
            width: 8,
            height: 6,
            values: pixels(8, 6).map(|(x, y)| small(x, y)).collect(),
        };
        let large = picture.resampled([32, 24], false).expect("fits");
        for ((x, y), value) in pixels(32, 24).zip(&large.values) {
            let [u, v] = [x, y].map(|at| (f64::from(at) + 0.5) / 4.0 - 0.5);
            if (0.0..=7.0).contains(&u) && (0.0..=5.0).contains(&v) {
                let expected = 1.0 / (0.2 + 0.004 * u + 0.008 * v);
                assert!((f64::from(*value) - expected).abs() < 1e-5, "{x} {y}");
            }
        }
        // A silhouette and an unknown pixel keep the depths that there are.
        picture.values = vec![2.0; 48];
        picture.values[20] = 1.0;
        picture.values[30] = f32::NAN;
        let large = picture.resampled([32, 24], false).expect("fits");
        assert!(
            large
                .values
                .iter()
                .all(|z| *z == 1.0 || *z == 2.0 || z.is_nan())
        );
        assert_eq!(large.values.iter().filter(|z| z.is_nan()).count(), 16);
        assert_eq!(large.values.iter().filter(|z| **z == 1.0).count(), 16);
        assert!(picture.resampled([24, 32], false).is_none());
        assert_eq!(
            picture.resampled([4, 3], false).expect("fits").values.len(),
            12
        );
        assert!(
            has_proportions([640, 480], [1296, 968]) && has_proportions([256, 192], [1920, 1440])
        );
        assert!(!has_proportions([640, 480], [640, 640]));
    }

    #[test]
    fn clip_range_of_any_matrix() {
        let near = 0.5;
        for (far, expected) in [(20.0, 20.0), (1e30, f64::INFINITY)] {
            for sign in [1.0, -1.0] {
                let a = -sign * (far + near) / (far - near);
                let b = -sign * 2.0 * far * near / (far - near);
                let path = PathBuf::from("d.png");
                let range = source(path, DepthKind::EyeDepth, Some([a, b])).clip_range();
                let [found_near, found_far] = range.expect("a range");
                assert!((found_near - near).abs() < 1e-9, "{found_near}");
                assert!(found_far == expected || (found_far / expected - 1.0).abs() < 1e-9);
            }
        }
    }
}
