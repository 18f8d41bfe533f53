//! How many samples lie on smooth surfaces that are no planes, where sprites with depth could stand for them:
//! `cargo bench --bench smooth_share -- FILE.ldi... [--error-px E]`, captures of `--error-px 0`.
//!
//! After what is flat has become pictures on planes, each block of 8x8 face pixels is searched for surfaces whose inverse depth is
//! a polynomial of the pixel within the bound, of degree 1 and of degree 2, in at least half of its pixels. Of those of degree 2 a
//! sprite with depth can be drawn backward where nothing folds: where inverse depth times the farthest eye's distance changes by
//! less than a pixel from pixel to pixel. Sprites of larger blocks consist of such; so what is counted is more than they can have.

#![allow(missing_docs, reason = "a benchmark is run, not read as a library")]

use headbox::ldi::LayeredDepthImage;
use headbox::packed::PackedCube;
use headbox::primitives::{Bound, choose};
use std::path::{Path, PathBuf};

/// Face pixels a side of a block.
const BLOCK_PX: u32 = 8;

/// Of its 64 pixels, how many a surface must show in: fewer are cheaper as samples (8.5 bytes each, a texel has 4).
const LEAST_PIXELS: usize = 32;

/// Relative error of inverse depth, a pixel away, of what a packed normal says; as for seeds of planes.
const NORMAL_ERROR: f64 = 0.18 / 512.0;

/// Coefficients of 1, x, y, x^2, xy, y^2.
const MOST_TERMS: usize = 6;

fn main() {
    let (mut files, mut error_px) = (Vec::new(), 0.5);
    let mut args = std::env::args().skip(1).filter(|a| a != "--bench");
    while let Some(arg) = args.next() {
        match arg.as_str() {
            "--error-px" => error_px = args.next().and_then(|v| v.parse().ok()).expect("a number"),
            _ => files.push(PathBuf::from(arg)),
        }
    }
    println!(
        "file | samples | on planes, % | left, % | in blocks of degree 1, % | of degree 2, not 1, % | that do not fold, %"
    );
    files.iter().for_each(|file| study(file, error_px));
}

fn study(file: &Path, error_px: f64) {
    let cube = PackedCube::read(file).expect("a cube LDI");
    let mut ldi = cube.unpack();
    let set = choose(&mut ldi, error_px);
    let bound = Bound::new(error_px, cube.info.half_size_m, cube.face_size_px);
    let mut found = Found::default();
    for face in &ldi.faces {
        for (y, x) in blocks(face.size_px).flat_map(|y| blocks(face.size_px).map(move |x| (y, x))) {
            let found_here = Block::new(face, &bound, [x, y]).smooth(cube.info.half_size_m);
            found = found + found_here;
        }
    }
    let left = cube.depth_pixel_count() - set.samples as usize;
    let share = |count: usize| 100.0 * count as f64 / cube.depth_pixel_count() as f64;
    println!(
        "{} | {} | {:.1} | {:.1} | {:.1} | {:.1} | {:.1}",
        file.file_stem().and_then(|s| s.to_str()).unwrap_or("-"),
        cube.depth_pixel_count(),
        share(set.samples as usize),
        share(left),
        share(found.affine),
        share(found.curved),
        share(found.unfolded)
    );
}

fn blocks(size_px: u32) -> impl Iterator<Item = u32> {
    (0..size_px).step_by(BLOCK_PX as usize)
}

/// Numbers of samples.
#[derive(Clone, Copy, Default)]
struct Found {
    /// On surfaces of degree 1.
    affine: usize,
    /// On surfaces of degree 2, and on none of degree 1.
    curved: usize,
    /// Of these, where nothing folds.
    unfolded: usize,
}

impl std::ops::Add for Found {
    type Output = Self;

    fn add(self, other: Self) -> Self {
        Self {
            affine: self.affine + other.affine,
            curved: self.curved + other.curved,
            unfolded: self.unfolded + other.unfolded,
        }
    }
}

/// A sample as blocks see it: position in face pixels from the block's middle, inverse depth and its change along both, 1/m.
struct Point {
    pixel: usize,
    x: f64,
    y: f64,
    q: f64,
    slope: [f64; 2],
    tolerance: f64,
}

struct Block {
    points: Vec<Point>,
    /// Of the face.
    focal_px: f64,
}

/// An inverse depth as a polynomial of the face position.
#[derive(Clone, Copy, Default)]
struct Polynomial([f64; MOST_TERMS]);

impl Polynomial {
    fn at(&self, x: f64, y: f64) -> f64 {
        self.0.iter().zip(terms(x, y)).map(|(c, t)| c * t).sum()
    }

    fn slope(&self, x: f64, y: f64) -> [f64; 2] {
        let [_, cx, cy, cxx, cxy, cyy] = self.0;
        [cx + 2.0 * cxx * x + cxy * y, cy + cxy * x + 2.0 * cyy * y]
    }

    /// How far a sample is from all that the surface has within its pixel.
    fn distance(&self, point: &Point) -> f64 {
        let within = 0.5 * self.slope(point.x, point.y).iter().map(|s| s.abs()).sum::<f64>();
        ((point.q - self.at(point.x, point.y)).abs() - within).max(0.0)
    }

    /// The polynomial of least squares with so many terms.
    fn fit(points: &[&Point], count: usize) -> Option<Self> {
        let mut rows = [[0.0; MOST_TERMS + 1]; MOST_TERMS];
        for point in points {
            let t = terms(point.x, point.y);
            for (i, row) in rows.iter_mut().take(count).enumerate() {
                (0..count).for_each(|k| row[k] += t[i] * t[k]);
                row[MOST_TERMS] += t[i] * point.q;
            }
        }
        solve(&mut rows, count).map(Self)
    }
}

fn terms(x: f64, y: f64) -> [f64; MOST_TERMS] {
    [1.0, x, y, x * x, x * y, y * y]
}

/// Elimination with pivots; `None` if there is no single answer.
fn solve(rows: &mut [[f64; MOST_TERMS + 1]; MOST_TERMS], count: usize) -> Option<[f64; MOST_TERMS]> {
    for i in 0..count {
        let pivot = (i..count).max_by(|a, b| rows[*a][i].abs().total_cmp(&rows[*b][i].abs()))?;
        rows.swap(i, pivot);
        if rows[i][i].abs() < 1e-9 {
            return None;
        }
        for k in (0..count).filter(|k| *k != i) {
            let factor = rows[k][i] / rows[i][i];
            let row = rows[i];
            rows[k].iter_mut().zip(row).for_each(|(a, b)| *a -= factor * b);
        }
    }
    Some(std::array::from_fn(|i| if i < count { rows[i][MOST_TERMS] / rows[i][i] } else { 0.0 }))
}

impl Block {
    fn new(face: &LayeredDepthImage, bound: &Bound, [x0, y0]: [u32; 2]) -> Self {
        let size = face.size_px;
        let mut points = Vec::new();
        for (y, x) in (y0..(y0 + BLOCK_PX).min(size)).flat_map(|y| (x0..(x0 + BLOCK_PX).min(size)).map(move |x| (y, x)))
        {
            let d = face.face.direction(f64::from(x) + 0.5, f64::from(y) + 0.5, size);
            for sample in face.pixel(x, y) {
                let (q, n) = (f64::from(sample.inverse_depth), sample.normal.decode().as_dvec3());
                let per_pixel = q * 2.0 / f64::from(size) / n.dot(d);
                points.push(Point {
                    pixel: ((y - y0) * BLOCK_PX + x - x0) as usize,
                    x: f64::from(x - x0) - f64::from(BLOCK_PX - 1) / 2.0,
                    y: f64::from(y - y0) - f64::from(BLOCK_PX - 1) / 2.0,
                    q,
                    slope: [n.dot(face.face.right()) * per_pixel, -n.dot(face.face.up()) * per_pixel],
                    tolerance: bound.tolerance(d, q),
                });
            }
        }
        Self { points, focal_px: f64::from(size) / 2.0 }
    }

    fn smooth(&self, half_size_m: f64) -> Found {
        let [affine, curved] = [3, MOST_TERMS].map(|count| self.surfaces(count));
        let is_curved = |i: &usize| curved[*i].is_some() && affine[*i].is_none();
        let reach_m = half_size_m * 3f64.sqrt();
        let unfolds = |i: &usize| {
            let per_px = curved[*i].map_or([0.0; 2], |p| p.slope(self.points[*i].x, self.points[*i].y));
            per_px[0].hypot(per_px[1]) * reach_m * self.focal_px < 1.0
        };
        let all = 0..self.points.len();
        Found {
            affine: affine.iter().flatten().count(),
            curved: all.clone().filter(is_curved).count(),
            unfolded: all.filter(is_curved).filter(unfolds).count(),
        }
    }

    /// Of each sample, the surface that it lies on, each surface grown from the plane of a sample.
    fn surfaces(&self, count: usize) -> Vec<Option<Polynomial>> {
        let mut owner: Vec<Option<Polynomial>> = vec![None; self.points.len()];
        for (i, seed) in self.points.iter().enumerate() {
            if owner[i].is_some() {
                continue;
            }
            let doubt = |p: &Point| seed.q * NORMAL_ERROR * ((p.x - seed.x).powi(2) + (p.y - seed.y).powi(2));
            let mut surface = Polynomial([
                seed.q - seed.slope[0] * seed.x - seed.slope[1] * seed.y,
                seed.slope[0],
                seed.slope[1],
                0.0,
                0.0,
                0.0,
            ]);
            for round in 0..4 {
                // Planes first, widely: what is curved leaves the plane of its normal.
                let (terms, wide) = if round == 0 { (3, 4.0) } else { (count, if round == 1 { 2.0 } else { 1.0 }) };
                let near: Vec<&Point> = self
                    .points
                    .iter()
                    .filter(|p| surface.distance(p) <= wide * p.tolerance + if round == 0 { doubt(p) } else { 0.0 })
                    .collect();
                let Some(next) = Polynomial::fit(&near, terms) else { break };
                surface = next;
            }
            let on: Vec<usize> = (0..self.points.len())
                .filter(|k| surface.distance(&self.points[*k]) <= self.points[*k].tolerance)
                .collect();
            let mut pixels: Vec<usize> = on.iter().map(|k| self.points[*k].pixel).collect();
            pixels.dedup();
            if pixels.len() >= LEAST_PIXELS {
                on.into_iter().for_each(|k| owner[k] = owner[k].or(Some(surface)));
            }
        }
        owner
    }
}
