//! Regions: samples of one face that lie on one plane, grown from seeds over neighbouring pixels
//! and across layers.

use super::bound::Bound;
use super::fit::{Affine, Fit};
use crate::model::samples::{DepthPixel, LayeredDepthImage};
use crate::pack::Plane;

/// Stands for no region.
pub(super) const NOBODY: u32 = u32::MAX;

/// Pixels from seed to seed.
const SEED_STEP: u32 = 4;

/// Pixels around a seed, to each side, from which its plane is first fitted.
const SEED_REACH: i64 = 3;

/// Number of the 49 pixels about a seed that must lie on its plane.
const SEED_SUPPORT: usize = 24;

/// Relative error of inverse depth, a pixel away, of a plane through a sample by its normal alone:
/// 3 degrees of a packed normal at 74 degrees to the line of sight, over half of a face of 1024
/// pixels.
const NORMAL_ERROR: f64 = 0.18 / 512.0;

/// A plane, and where it is.
#[derive(Clone, Debug)]
pub(super) struct Region {
    pub(super) plane: Plane,
    /// The same on this face.
    pub(super) affine: Affine,
    /// Pixels (row-major) that hold samples of it.
    pub(super) pixels: Vec<u32>,
}

/// The samples of a face, and whose they are.
pub(super) struct Grower<'a> {
    pub(super) face: &'a LayeredDepthImage,
    /// Tolerance of each sample's inverse depth, 1/m.
    pub(super) tolerance: Vec<f32>,
    /// Region of each sample, or [`NOBODY`].
    pub(super) owner: Vec<u32>,
    pub(super) regions: Vec<Region>,
    /// Last visit of each pixel.
    visited: Vec<u32>,
    visit: u32,
    queue: Vec<u32>,
}

/// A plane that is worth growing.
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
            let of = |s: &DepthPixel| bound.tolerance(d, f64::from(s.inverse_depth)) as f32;
            tolerance.extend(face.pixel(p % size, p / size).iter().map(of));
        }
        let owner = vec![NOBODY; face.samples.len()];
        let visited = vec![0; (size * size) as usize];
        let (regions, queue) = (Vec::new(), Vec::new());
        Self {
            face,
            tolerance,
            owner,
            regions,
            visited,
            visit: 0,
            queue,
        }
    }

    /// Finds all regions of at least `least` samples, best seeds first.
    pub(super) fn grow_all(&mut self, least: usize) {
        self.take_infinity();
        let mut seeds: Vec<Seed> = self.seeds();
        seeds.sort_by(|a, b| b.score.total_cmp(&a.score).then(a.pixel.cmp(&b.pixel)));
        for seed in &seeds {
            self.grow(seed, least);
        }
    }

    /// The samples of a pixel: indices of the first, and after the last.
    fn samples_of(&self, pixel: u32) -> std::ops::Range<usize> {
        self.face.offsets[pixel as usize] as usize..self.face.offsets[pixel as usize + 1] as usize
    }

    fn middle(&self, pixel: u32) -> [f64; 2] {
        [
            f64::from(pixel % self.face.size_px) + 0.5,
            f64::from(pixel / self.face.size_px) + 0.5,
        ]
    }

    /// True if a sample that is still free lies on a plane.
    #[inline(always)]
    fn fits(&self, affine: &Affine, [x, y]: [f64; 2], i: usize) -> bool {
        let q = f64::from(self.face.samples[i].inverse_depth);
        self.owner[i] == NOBODY && affine.distance(x, y, q) <= f64::from(self.tolerance[i])
    }

    /// Assigns samples so far away that no eye sees them move to the plane at infinity.
    fn take_infinity(&mut self) {
        let mut pixels = Vec::new();
        for pixel in 0..self.face.size_px.pow(2) {
            for i in self.samples_of(pixel) {
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

    fn seeds(&self) -> Vec<Seed> {
        let lattice = || (SEED_STEP / 2..self.face.size_px).step_by(SEED_STEP as usize);
        let mut seeds = Vec::new();
        for (y, x) in lattice().flat_map(|y| lattice().map(move |x| (y, x))) {
            let pixel = y * self.face.size_px + x;
            for i in self.samples_of(pixel).filter(|i| self.owner[*i] == NOBODY) {
                seeds.extend(self.seed(pixel, i));
            }
        }
        seeds
    }

    /// The plane about a sample: first by its normal, then by least squares over those that lie on
    /// it.
    fn seed(&self, pixel: u32, i: usize) -> Option<Seed> {
        let size = self.face.size_px;
        let [x, y] = self.middle(pixel);
        let slope = self
            .face
            .inverse_depth_slope(x, y, &self.face.samples[i], 8.0);
        let q = f64::from(self.face.samples[i].inverse_depth);
        let mut affine = Affine {
            origin: [x, y],
            at: glam::DVec3::new(q, q * slope.x, q * slope.y),
        };
        let (column, row) = (i64::from(pixel % size), i64::from(pixel / size));
        let mut score = 0.0;
        for round in 0..3 {
            let mut fit = Fit::new([x, y]);
            let (mut support, mut misfit) = (0, 0.0);
            for (dy, dx) in (-SEED_REACH..=SEED_REACH)
                .flat_map(|dy| (-SEED_REACH..=SEED_REACH).map(move |dx| (dy, dx)))
            {
                let inside = |v: i64| (0..i64::from(size)).contains(&v);
                if !inside(column + dx) || !inside(row + dy) {
                    continue;
                }
                let other = ((row + dy) * i64::from(size) + column + dx) as u32;
                let at = self.middle(other);
                let doubt = if round == 0 {
                    q * NORMAL_ERROR * (dx * dx + dy * dy) as f64
                } else {
                    0.0
                };
                let mut found = false;
                for k in self.samples_of(other).filter(|k| self.owner[*k] == NOBODY) {
                    let (value, tolerance) = (
                        f64::from(self.face.samples[k].inverse_depth),
                        self.tolerance[k],
                    );
                    let off = affine.distance(at[0], at[1], value);
                    if off <= f64::from(tolerance) + doubt {
                        fit.add(at[0], at[1], value);
                        misfit += (value - affine.inverse_depth(at[0], at[1])).abs()
                            / f64::from(tolerance);
                        found = true;
                    }
                }
                support += usize::from(found);
            }
            if support < SEED_SUPPORT {
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

    fn grow(&mut self, seed: &Seed, least: usize) {
        let middle = self.middle(seed.pixel);
        if !self
            .samples_of(seed.pixel)
            .any(|i| self.fits(&seed.affine, middle, i))
        {
            return;
        }
        let Some((fit, count, _)) = self.spread(seed.affine, seed.pixel, true) else {
            return;
        };
        if count < least {
            return;
        }
        let mut affine = fit;
        for round in 0..2 {
            let (face, size) = (self.face.face, self.face.size_px);
            let plane = Plane::from_inverse_depth(face, size, affine.coefficients());
            let [q, along_x, along_y] = plane.inverse_depth(face, size);
            let rounded = Affine {
                origin: [0.0; 2],
                at: glam::DVec3::new(q, along_x, along_y),
            };
            let Some((refined, count, pixels)) = self.spread(rounded, seed.pixel, false) else {
                return;
            };
            if count < least {
                return;
            }
            if round == 1 {
                self.take(Region {
                    plane,
                    affine: rounded,
                    pixels,
                });
                return;
            }
            affine = refined;
        }
    }

    /// Makes all samples of the region's pixels that lie on its plane its own.
    fn take(&mut self, region: Region) {
        let id = self.regions.len() as u32;
        for &pixel in &region.pixels {
            let middle = self.middle(pixel);
            for i in self.samples_of(pixel) {
                if self.fits(&region.affine, middle, i) {
                    self.owner[i] = id;
                }
            }
        }
        self.regions.push(region);
    }

    /// All pixels with free samples on a plane that are reached from one of them, how many samples
    /// they are, and the plane of least squares through those. While it `adapts`, the plane is
    /// fitted anew whenever twice as many are known.
    fn spread(
        &mut self,
        mut affine: Affine,
        from: u32,
        adapts: bool,
    ) -> Option<(Affine, usize, Vec<u32>)> {
        let size = self.face.size_px;
        self.visit += 1;
        let mut queue = std::mem::take(&mut self.queue);
        queue.clear();
        queue.push(from);
        self.visited[from as usize] = self.visit;
        let mut fit = Fit::new(self.middle(from));
        let (mut next, mut count, mut refit_at, mut pixels) = (0, 0, 32, Vec::new());
        while let Some(&pixel) = queue.get(next) {
            next += 1;
            let [x, y] = self.middle(pixel);
            let before = count;
            for i in self.samples_of(pixel) {
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
        Some((fit.solve()?, count, pixels))
    }
}
