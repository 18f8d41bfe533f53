//! A sky from an equirectangular picture (`.hdr`, `.exr`), with tables for importance sampling.
//!
//! The middle of the picture is north: -Z of the world, which is +Y in a file with Z up. Azimuths
//! increase to the right, from north to east (+X).
//!
//! Texels are sampled by luminance times solid angle (Pharr, Jakob and Humphreys 2023, "Physically
//! Based Rendering", 12.5), rows first, so that the density of a direction is the luminance there
//! over the sum of all: it needs no table.
//!
//! A sun in the picture can be removed from its light (`sky_sun`). It stays visible.

use super::sky_file::{describe_cut_light, read_exr, read_hdr, sanitise};
use super::sky_sun::SunSpot;
use crate::load::extension_of;
use glam::Vec3;
use headbox_core::color::luminance;
use std::f32::consts::{PI, TAU};
use std::fmt;
use std::hash::{DefaultHasher, Hasher};
use std::path::{Path, PathBuf};

/// Error of reading a picture of the sky.
#[derive(Debug, thiserror::Error)]
pub enum SkyError {
    /// The file could not be read.
    #[error("{}: {cause}", path.display())]
    Unreadable {
        /// The file.
        path: PathBuf,
        /// The cause.
        cause: String,
    },
    /// The picture is not twice as wide as high.
    #[error(
        "{width}x{height} pixels; an equirectangular picture of the sky is twice as wide as high"
    )]
    Shape {
        /// Columns.
        width: u32,
        /// Rows.
        height: u32,
    },
    /// A texel is negative, infinite or NaN.
    #[error("the pixel in column {x} of row {y} is {value}; radiance is finite and not negative")]
    Texel {
        /// Column, from 0.
        x: u32,
        /// Row, from 0.
        y: u32,
        /// Its first invalid value.
        value: f32,
    },
}

/// Radiance by direction, linear RGB.
#[derive(Clone, PartialEq)]
pub struct SkyPicture {
    width: u32,
    height: u32,
    /// Radiance, linear RGB, top row first.
    texels: Vec<[f32; 3]>,
    /// Rotation about the up axis, from north to east.
    turn_rad: f32,
    /// Sun that is removed from the light.
    sun: Option<SunSpot>,
    tables: Tables,
}

/// Cumulative distributions for sampling texels.
#[derive(Clone, Default, PartialEq)]
struct Tables {
    /// Cumulative share of the rows in the power.
    rows: Vec<f32>,
    /// Cumulative share of the texels in their row, for all rows.
    columns: Vec<f32>,
    /// Integral of luminance over all directions.
    power: f32,
}

impl fmt::Debug for SkyPicture {
    /// Size, turn and a digest of the texels.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mut hash = DefaultHasher::new();
        hash.write(bytemuck::cast_slice(&self.texels));
        let (width, height, turn_deg, sun) = (
            self.width,
            self.height,
            self.turn_rad.to_degrees(),
            &self.sun,
        );
        write!(
            f,
            "SkyPicture({width}x{height}, {turn_deg} degrees, {sun:?}, {:016x})",
            hash.finish()
        )
    }
}

impl SkyPicture {
    /// Reads an `.hdr` or `.exr` file and rotates it about the up axis, from north to east.
    /// Negative values, left by resampling and colour conversion, become 0; infinite ones (suns in
    /// half floats) become the largest half float.
    ///
    /// # Errors
    /// [`SkyError::Unreadable`], which names the file.
    pub fn read(path: &Path, turn_deg: f64) -> Result<Self, SkyError> {
        Ok(Self::read_with_notes(path, turn_deg)?.0)
    }

    /// Same as [`Self::read`]; also returns notes on light that the file lacks or that was changed,
    /// one sentence each.
    ///
    /// # Errors
    /// See [`Self::read`].
    pub fn read_with_notes(path: &Path, turn_deg: f64) -> Result<(Self, Vec<String>), SkyError> {
        let unreadable = |cause: String| SkyError::Unreadable {
            path: path.to_path_buf(),
            cause,
        };
        let (size, mut texels) = match extension_of(path).as_str() {
            "exr" => read_exr(path),
            "hdr" => read_hdr(path),
            _ => Err(
                "not a kind of sky that is read; give an equirectangular .hdr or .exr picture"
                    .into(),
            ),
        }
        .map_err(unreadable)?;
        let notes = describe_cut_light(path, &texels);
        texels
            .iter_mut()
            .for_each(|texel| *texel = texel.map(sanitise));
        let picture = Self::new(size, texels, turn_deg);
        Ok((
            picture.map_err(|cause| unreadable(cause.to_string()))?,
            notes,
        ))
    }

    /// Creates a sky from its columns and rows and their radiance, top row first.
    ///
    /// # Errors
    /// [`SkyError::Shape`], also if the number of texels does not match the size;
    /// [`SkyError::Texel`].
    pub fn new(
        [width, height]: [u32; 2],
        texels: Vec<[f32; 3]>,
        turn_deg: f64,
    ) -> Result<Self, SkyError> {
        let count = u64::from(width) * u64::from(height);
        if height == 0 || u64::from(width) != 2 * u64::from(height) || count != texels.len() as u64
        {
            return Err(SkyError::Shape { width, height });
        }
        let is_radiance = |c: &f32| c.is_finite() && *c >= 0.0;
        if let Some((at, &value)) = texels
            .as_flattened()
            .iter()
            .enumerate()
            .find(|(_, c)| !is_radiance(c))
        {
            let (x, y) = ((at / 3) as u32 % width, (at / 3) as u32 / width);
            return Err(SkyError::Texel { x, y, value });
        }
        let turn_rad = turn_deg.rem_euclid(360.0).to_radians() as f32;
        Ok(Self::tabulated([width, height], texels, turn_rad, None))
    }

    fn tabulated(
        [width, height]: [u32; 2],
        texels: Vec<[f32; 3]>,
        turn_rad: f32,
        sun: Option<SunSpot>,
    ) -> Self {
        let mut picture = Self {
            width,
            height,
            texels,
            turn_rad,
            sun,
            tables: Tables::default(),
        };
        picture.tables = Tables::new(&picture);
        picture
    }

    /// Removes a sun from the light of the picture.
    pub(super) fn without_light_of(self, sun: SunSpot) -> Self {
        Self::tabulated(self.size(), self.texels, self.turn_rad, Some(sun))
    }

    /// Number of columns and rows.
    pub fn size(&self) -> [u32; 2] {
        [self.width, self.height]
    }

    /// Radiance of the texels, top row first.
    pub fn texels(&self) -> &[[f32; 3]] {
        &self.texels
    }

    /// Rotation about the up axis, from north to east, degrees.
    pub fn turn_deg(&self) -> f64 {
        f64::from(self.turn_rad).to_degrees()
    }

    /// Returns the sky with its radiance multiplied by `factor`.
    pub fn times(&self, factor: f32) -> Self {
        let texels = self
            .texels
            .iter()
            .map(|texel| texel.map(|c| c * factor))
            .collect();
        Self::tabulated(
            self.size(),
            texels,
            self.turn_rad,
            self.sun.map(|sun| sun.times(factor)),
        )
    }

    /// Returns a picture with at most `columns` columns, whose texels are means of those they
    /// replace.
    pub fn reduced(&self, columns: u32) -> Self {
        let size = [
            self.width.min(columns.max(2) & !1),
            self.height.min((columns / 2).max(1)),
        ];
        let span = |at: u32, to: u32, from: u32| {
            let edge = |at: u32| u64::from(at) * u64::from(from);
            (edge(at) / u64::from(to)) as u32..edge(at + 1).div_ceil(u64::from(to)) as u32
        };
        let mean = |at: u32| {
            let (xs, ys) = (
                span(at % size[0], size[0], self.width),
                span(at / size[0], size[1], self.height),
            );
            let count = (xs.len() * ys.len()) as f32;
            let inner = ys.flat_map(|y| xs.clone().map(move |x| Vec3::from(self.texel(x, y))));
            (inner.sum::<Vec3>() / count).to_array()
        };
        Self::tabulated(
            size,
            (0..size[0] * size[1]).map(mean).collect(),
            self.turn_rad,
            self.sun,
        )
    }

    /// Solid angle of each texel of a row, steradians.
    pub(super) fn solid_angle(&self, y: u32) -> f64 {
        let cos = |y: u32| (f64::from(y) * std::f64::consts::PI / f64::from(self.height)).cos();
        (cos(y) - cos(y + 1)) * std::f64::consts::TAU / f64::from(self.width)
    }

    pub(super) fn texel(&self, x: u32, y: u32) -> [f32; 3] {
        self.texels[y as usize * self.width as usize + x as usize]
    }

    /// Radiance of a texel for lighting: without the sun.
    fn light(&self, x: u32, y: u32) -> [f32; 3] {
        let texel = self.texel(x, y);
        let Some(sun) = &self.sun else { return texel };
        sun.remove_from(texel, || self.direction([x as f32 + 0.5, y as f32 + 0.5]))
    }

    /// Unit direction of a point of the picture, in texels.
    pub(super) fn direction(&self, [x, y]: [f32; 2]) -> Vec3 {
        let azimuth = (x / self.width as f32 - 0.5) * TAU + self.turn_rad;
        let (sin, cos) = (y / self.height as f32 * PI).sin_cos();
        Vec3::new(sin * azimuth.sin(), cos, -sin * azimuth.cos())
    }

    /// Point of the picture in a unit direction: x from 0 to the width, y from 0 to the height.
    fn project(&self, direction: Vec3) -> [f32; 2] {
        let azimuth = direction.x.atan2(-direction.z) - self.turn_rad;
        let x = (azimuth / TAU + 0.5).rem_euclid(1.0) * self.width as f32;
        [
            x,
            direction.y.clamp(-1.0, 1.0).acos() / PI * self.height as f32,
        ]
    }

    /// Radiance that lights surfaces from a unit direction (world axes): that of the nearest texel,
    /// without the sun.
    pub fn radiance(&self, direction: Vec3) -> [f32; 3] {
        let [x, y] = self.project(direction);
        self.light(
            (x as u32).min(self.width - 1),
            (y as u32).min(self.height - 1),
        )
    }

    /// Radiance of the visible background in a unit direction (world axes): bilinear, with the sun.
    pub fn seen(&self, direction: Vec3) -> [f32; 3] {
        let [x, y] = self.project(direction).map(|c| c - 0.5);
        let (left, top) = (x.floor(), y.floor());
        let (u, v) = (x - left, y - top);
        let texel = |dx: i64, dy: i64| {
            let x = (left as i64 + dx).rem_euclid(i64::from(self.width)) as u32;
            let y = (top as i64 + dy).clamp(0, i64::from(self.height) - 1) as u32;
            Vec3::from(self.texel(x, y))
        };
        let row = |dy: i64| texel(0, dy).lerp(texel(1, dy), u);
        row(0).lerp(row(1), v).to_array()
    }

    /// Probability density of [`Self::sample`] for a direction with this radiance, 1/sr.
    pub fn density(&self, radiance: [f32; 3]) -> f32 {
        if self.tables.power > 0.0 {
            luminance(radiance) / self.tables.power
        } else {
            0.0
        }
    }

    /// Samples a direction by its radiance from two numbers in [0, 1); also returns that radiance.
    /// `None` if the sky is black.
    pub fn sample(&self, [u, v]: [f32; 2]) -> Option<(Vec3, [f32; 3])> {
        let Tables {
            rows,
            columns,
            power,
        } = &self.tables;
        if *power <= 0.0 {
            return None;
        }
        let (y, v) = invert_cdf(rows, v);
        let row = y * self.width as usize;
        let (x, u) = invert_cdf(&columns[row..row + self.width as usize], u);
        // Uniform over the solid angle of the texel.
        let cos = |y: usize| (y as f32 / self.height as f32 * PI).cos();
        let height = cos(y) + (cos(y + 1) - cos(y)) * v;
        let azimuth = ((x as f32 + u) / self.width as f32 - 0.5) * TAU + self.turn_rad;
        let radius = (1.0 - height * height).max(0.0).sqrt();
        let direction = Vec3::new(radius * azimuth.sin(), height, -radius * azimuth.cos());
        Some((direction, self.light(x as u32, y as u32)))
    }

    /// Integral of the light's luminance over all directions.
    pub(super) fn power(&self) -> f32 {
        self.tables.power
    }
}

impl Tables {
    fn new(picture: &SkyPicture) -> Self {
        let (mut rows, mut columns) = (Vec::new(), Vec::with_capacity(picture.texels.len()));
        let mut power = 0.0;
        for y in 0..picture.height {
            let first = columns.len();
            let mut row = 0.0;
            columns.extend((0..picture.width).map(|x| {
                row += f64::from(luminance(picture.light(x, y)));
                row as f32
            }));
            let whole = (row as f32).max(f32::MIN_POSITIVE);
            columns[first..].iter_mut().for_each(|sum| *sum /= whole);
            power += row * picture.solid_angle(y);
            rows.push(power);
        }
        let whole = power.max(f64::MIN_POSITIVE);
        Self {
            rows: rows.into_iter().map(|sum| (sum / whole) as f32).collect(),
            columns,
            power: power as f32,
        }
    }
}

/// Inverts a cumulative distribution: returns the entry for `number` in [0, 1), and the position
/// within the entry, 0..1.
fn invert_cdf(shares: &[f32], number: f32) -> (usize, f32) {
    let at = shares
        .partition_point(|&share| share <= number)
        .min(shares.len() - 1);
    let before = if at == 0 { 0.0 } else { shares[at - 1] };
    let within = (number - before) / (shares[at] - before);
    let within = if within.is_finite() {
        within.clamp(0.0, 1.0)
    } else {
        0.5
    };
    (at, within)
}
