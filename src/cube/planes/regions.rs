//! Region growing: finds the samples of a face that lie on one plane, from seeds over neighbouring
//! pixels and across layers.

use super::bound::Bound;
use super::fit::{Affine, Fit};
use crate::model::samples::{DepthPixel, LayeredDepthImage};
use crate::pack::Plane;
use glam::DVec3;

/// Region index of samples in no region.
pub(super) const NO_REGION: u32 = u32::MAX;

/// Minimum number of samples of a region.
const MIN_REGION_SAMPLES: usize = 48;

/// Distance between seeds, pixels.
const SEED_STEP: u32 = 4;

/// Radius of the square window in which the plane of a seed is fitted, pixels.
const SEED_RADIUS: i64 = 3;

/// Minimum number of the 49 pixels of a seed's window that have samples on its plane.
const MIN_SEED_SUPPORT: usize = 24;

/// Relative error of inverse depth, one pixel away, of the tangent plane of a sample: 3 degrees of
/// a packed normal at 74 degrees to the line of sight, over half of a face of 1024 pixels.
const NORMAL_ERROR: f64 = 0.18 / 512.0;

/// A plane, and the pixels that it covers.
#[derive(Clone, Debug)]
pub(super) struct Region {
    pub(super) plane: Plane,
    /// Inverse depth of the plane on the face.
    pub(super) affine: Affine,
    /// Pixels (row-major) with samples of the region.
    pub(super) pixels: Vec<u32>,
}

/// Assignment of the samples of a face to regions.
pub(super) struct Grower<'a> {
    pub(super) face: &'a LayeredDepthImage,
    /// Tolerance of each sample's inverse depth, 1/m.
    pub(super) tolerance: Vec<f32>,
    /// Width of a depth bin, 1/m.
    pub(super) bin: f64,
    /// Region of each sample, or [`NO_REGION`].
    pub(super) owner: Vec<u32>,
    pub(super) regions: Vec<Region>,
    /// For each pixel, the last flood fill that visited it.
    visited: Vec<u32>,
    /// Number of flood fills.
    visit: u32,
    queue: Vec<u32>,
}

/// A plane through a pixel's samples, to grow a region from.
struct Seed {
    /// Score of its fit and extent; larger is better.
    score: f64,
    pixel: u32,
    affine: Affine,
}

impl<'a> Grower<'a> {
    pub(super) fn new(face: &'a LayeredDepthImage, bound: &Bound) -> Self {
        let size = face.size_px;
        let mut tolerance = Vec::with_capacity(face.samples.len());
        for p in 0..size * size {
            let d = face
                .face
                .direction(f64::from(p % size) + 0.5, f64::from(p / size) + 0.5, size);
            let tolerance_at =
                |s: &DepthPixel| bound.tolerance(d, f64::from(s.inverse_depth)) as f32;
            tolerance.extend(face.pixel(p % size, p / size).iter().map(tolerance_at));
        }
        Self {
            face,
            tolerance,
            bin: bound.bin(size),
            owner: vec![NO_REGION; face.samples.len()],
            regions: Vec::new(),
            visited: vec![0; (size * size) as usize],
            visit: 0,
            queue: Vec::new(),
        }
    }

    /// Finds all regions, best seeds first.
    pub(super) fn grow_all(&mut self) {
        self.claim_infinity();
        let mut seeds = self.find_seeds();
        seeds.sort_by(|a, b| b.score.total_cmp(&a.score).then(a.pixel.cmp(&b.pixel)));
        for seed in &seeds {
            if let Some(region) = self.grow(seed) {
                self.claim(region);
            }
        }
    }

    /// Returns the indices of a pixel's samples.
    fn sample_range(&self, pixel: u32) -> std::ops::Range<usize> {
        self.face.offsets[pixel as usize] as usize..self.face.offsets[pixel as usize + 1] as usize
    }

    fn centre(&self, pixel: u32) -> [f64; 2] {
        let size = self.face.size_px;
        [pixel % size, pixel / size].map(|v| f64::from(v) + 0.5)
    }

    /// Returns true if a sample is unassigned and lies on a plane.
    #[inline(always)]
    fn fits(&self, affine: &Affine, [x, y]: [f64; 2], i: usize) -> bool {
        let q = f64::from(self.face.samples[i].inverse_depth);
        self.owner[i] == NO_REGION && affine.distance(x, y, q) <= f64::from(self.tolerance[i])
    }

    /// Assigns samples so distant that their parallax is within the bound to the plane at infinity.
    fn claim_infinity(&mut self) {
        let mut pixels = Vec::new();
        for pixel in 0..self.face.size_px.pow(2) {
            for i in self.sample_range(pixel) {
                if self.tolerance[i] >= self.face.samples[i].inverse_depth {
                    self.owner[i] = self.regions.len() as u32;
                    if pixels.last() != Some(&pixel) {
                        pixels.push(pixel);
                    }
                }
            }
        }
        if !pixels.is_empty() {
            self.regions.push(Region {
                plane: Plane::default(),
                affine: Affine::default(),
                pixels,
            });
        }
    }

    fn find_seeds(&self) -> Vec<Seed> {
        let lattice = || (SEED_STEP / 2..self.face.size_px).step_by(SEED_STEP as usize);
        let mut seeds = Vec::new();
        for (y, x) in lattice().flat_map(|y| lattice().map(move |x| (y, x))) {
            let pixel = y * self.face.size_px + x;
            for i in self.unassigned(pixel) {
                seeds.extend(self.fit_seed(pixel, i));
            }
        }
        seeds
    }

    fn unassigned(&self, pixel: u32) -> impl Iterator<Item = usize> {
        self.sample_range(pixel)
            .filter(|i| self.owner[*i] == NO_REGION)
    }

    /// Fits a plane about a sample: the tangent plane first, then least squares over the samples
    /// that lie on it.
    fn fit_seed(&self, pixel: u32, i: usize) -> Option<Seed> {
        let size = self.face.size_px;
        let [x, y] = self.centre(pixel);
        let sample = &self.face.samples[i];
        let slope = self.face.inverse_depth_slope(x, y, sample, 8.0);
        let q = f64::from(sample.inverse_depth);
        let mut affine = Affine {
            origin: [x, y],
            coefficients: DVec3::new(q, q * slope.x, q * slope.y),
        };
        let (column, row) = (i64::from(pixel % size), i64::from(pixel / size));
        let mut score = 0.0;
        for round in 0..3 {
            let mut fit = Fit::new([x, y]);
            let (mut support, mut misfit) = (0, 0.0);
            for (dy, dx) in (-SEED_RADIUS..=SEED_RADIUS)
                .flat_map(|dy| (-SEED_RADIUS..=SEED_RADIUS).map(move |dx| (dy, dx)))
            {
                let inside = |v: i64| (0..i64::from(size)).contains(&v);
                if !inside(column + dx) || !inside(row + dy) {
                    continue;
                }
                let other = ((row + dy) * i64::from(size) + column + dx) as u32;
                let [x, y] = self.centre(other);
                let normal_error = if round == 0 {
                    q * NORMAL_ERROR * (dx * dx + dy * dy) as f64
                } else {
                    0.0
                };
                let mut is_on_plane = false;
                for k in self.unassigned(other) {
                    let value = f64::from(self.face.samples[k].inverse_depth);
                    let tolerance = f64::from(self.tolerance[k]);
                    if affine.distance(x, y, value) <= tolerance + normal_error {
                        fit.add(x, y, value);
                        misfit += (value - affine.inverse_depth(x, y)).abs() / tolerance;
                        is_on_plane = true;
                    }
                }
                support += usize::from(is_on_plane);
            }
            if support < MIN_SEED_SUPPORT {
                return None;
            }
            score = support as f64 / (1.0 + misfit / fit.count());
            affine = fit.solve()?;
        }
        Some(Seed {
            score,
            pixel,
            affine,
        })
    }

    /// Grows a region from a seed; `None` if it is too small. The plane is refined by flood fills:
    /// one that adapts it, and two with the plane rounded as it is stored.
    fn grow(&mut self, seed: &Seed) -> Option<Region> {
        let centre = self.centre(seed.pixel);
        if !self
            .sample_range(seed.pixel)
            .any(|i| self.fits(&seed.affine, centre, i))
        {
            return None;
        }
        let (adapted, _) = self.flood_fill(seed.affine, seed.pixel, true)?;
        let (_, rounded) = self.round_to_plane(&adapted);
        let (refined, _) = self.flood_fill(rounded, seed.pixel, false)?;
        let (plane, affine) = self.round_to_plane(&refined);
        let (_, pixels) = self.flood_fill(affine, seed.pixel, false)?;
        Some(Region {
            plane,
            affine,
            pixels,
        })
    }

    /// Rounds an affine inverse depth to the precision of a [`Plane`].
    fn round_to_plane(&self, affine: &Affine) -> (Plane, Affine) {
        let (face, size) = (self.face.face, self.face.size_px);
        let plane = Plane::from_inverse_depth(face, size, affine.face_coefficients());
        let rounded = Affine {
            origin: [0.0; 2],
            coefficients: DVec3::from(plane.inverse_depth(face, size)),
        };
        (plane, rounded)
    }

    /// Assigns the unassigned samples in the region's pixels that lie on its plane.
    fn claim(&mut self, region: Region) {
        let id = self.regions.len() as u32;
        for &pixel in &region.pixels {
            let centre = self.centre(pixel);
            for i in self.sample_range(pixel) {
                if self.fits(&region.affine, centre, i) {
                    self.owner[i] = id;
                }
            }
        }
        self.regions.push(region);
    }

    /// Finds the pixels connected to `start` with unassigned samples on a plane, and the
    /// least-squares plane through these samples; `None` if there are too few, or if they lie on a
    /// line. If `adapts`, the plane is refitted whenever the number of samples has doubled.
    fn flood_fill(
        &mut self,
        mut affine: Affine,
        start: u32,
        adapts: bool,
    ) -> Option<(Affine, Vec<u32>)> {
        let size = self.face.size_px;
        self.visit += 1;
        let mut queue = std::mem::take(&mut self.queue);
        queue.clear();
        queue.push(start);
        self.visited[start as usize] = self.visit;
        let mut fit = Fit::new(self.centre(start));
        let (mut next, mut count, mut refit_at) = (0, 0, 32);
        let mut pixels = Vec::new();
        while let Some(&pixel) = queue.get(next) {
            next += 1;
            let [x, y] = self.centre(pixel);
            let before = count;
            for i in self.sample_range(pixel) {
                if self.fits(&affine, [x, y], i) {
                    fit.add(x, y, f64::from(self.face.samples[i].inverse_depth));
                    count += 1;
                }
            }
            if count == before {
                continue;
            }
            pixels.push(pixel);
            if adapts && count >= refit_at {
                affine = fit.solve().unwrap_or(affine);
                refit_at *= 2;
            }
            let (column, row) = (pixel % size, pixel / size);
            for row in row.saturating_sub(1)..(row + 2).min(size) {
                for column in column.saturating_sub(1)..(column + 2).min(size) {
                    let other = row * size + column;
                    if self.visited[other as usize] != self.visit {
                        self.visited[other as usize] = self.visit;
                        queue.push(other);
                    }
                }
            }
        }
        self.queue = queue;
        if count < MIN_REGION_SAMPLES {
            return None;
        }
        Some((fit.solve()?, pixels))
    }
}
