//! An f64 oracle of the warp, one pixel after the other, and tests of the kernel against it.

use super::depth_rows::{LEAST_COSINE, LEAST_NEIGHBORS, STEEPEST};
use super::footprint::{MAX_REACH_PX, OVERLAP, POINT_PX, WarpTarget};
use super::row_samples::{ImageSample, RowSamplePool, RowSamples};
use glam::{DMat3, DVec2, DVec3, dvec2};
use headbox_core::color::srgb8_from_linear;
use headbox_core::cube_face::Face;
use headbox_core::random::Rng;
use headbox_core::simd;
use headbox_images::{Distortion, Lens, LoadedView, Pinhole, Pose};

/// Distance from a threshold within which either side is accepted: several roundings of f32.
const EITHER: f64 = 2e-3;

/// Relative tolerance of inverse depth: sums of rays of about 1, and a shift along a slope, in f32.
const RELATIVE_DEPTH: f64 = 2e-5;

/// Relative tolerance of weights and areas: differences of rays of neighbours, which f32 holds to
/// four digits.
const RELATIVE_AREA: f64 = 2e-3;

/// Tolerance of interpolated colours: two roundings of at most half a level, where the oracle has
/// none, and weights in parts of 256.
const LEVELS: f64 = 2.0;

/// Tolerance of a normal, radians: its direction in f32, and its encoding.
const ANGLE: f64 = 2e-3;

/// The expected sample of a face pixel.
struct ExpectedSample {
    row: usize,
    column: u32,
    inverse_depth: f64,
    weight: f64,
    area: f64,
    normal: DVec3,
    levels: [f64; 3],
    /// False if it is so near to a threshold that it may be absent.
    is_certain: bool,
}

struct Oracle<'a> {
    target: &'a WarpTarget,
    view: &'a LoadedView,
}

/// The surface at a pixel: the point, the steps to the next pixels right and down, and the unit
/// normal.
struct OracleSurface {
    point: DVec3,
    steps: [DVec3; 2],
    normal: DVec3,
    is_certain: bool,
}

impl Oracle<'_> {
    fn ray(&self, x: i64, y: i64) -> DVec3 {
        self.view.pose.world_from_eye
            * self
                .view
                .lens
                .ray([x as f64 + 0.5, y as f64 + 0.5], self.view.size_px)
    }

    fn inverse_depth(&self, x: i64, y: i64) -> Option<f64> {
        let [x, y] = [(x, 0), (y, 1)].map(|(c, axis)| {
            u32::try_from(c)
                .ok()
                .filter(|c| *c < self.view.size_px[axis])
        });
        self.view
            .depth_at(x?, y?)
            .map(|depth| f64::from(1.0 / depth))
    }

    fn surface(&self, x: i64, y: i64) -> Option<OracleSurface> {
        let own = self.inverse_depth(x, y)?;
        let noise = f64::from(self.target.noise);
        let tolerance = 3.0 * noise
            + f64::from(STEEPEST) / self.view.lens.pixels_per_radian(self.view.size_px) * own;
        let change = |dx: i64, dy: i64| {
            let change = self.inverse_depth(x + dx, y + dy)? - own;
            (change.abs() <= tolerance).then_some(change)
        };
        let around = (-1..=1)
            .flat_map(|dy| (-1..=1).map(move |dx| (dx, dy)))
            .filter(|offset| *offset != (0, 0));
        let neighbors = around.filter(|(dx, dy)| change(*dx, *dy).is_some()).count();
        if noise > 0.0 && neighbors < LEAST_NEIGHBORS as usize {
            return None;
        }
        let slope = |before: Option<f64>, after: Option<f64>| match (before, after) {
            (Some(before), Some(after)) => (after - before) / 2.0,
            (before, after) => after.unwrap_or(0.0) - before.unwrap_or(0.0),
        };
        let ray = self.ray(x, y);
        let step = |next: DVec3, slope: f64| ((next - ray) - ray * (slope / own)) / own;
        let steps = [
            step(self.ray(x + 1, y), slope(change(-1, 0), change(1, 0))),
            step(self.ray(x, y + 1), slope(change(0, -1), change(0, 1))),
        ];
        let normal = steps[1].cross(steps[0]).normalize();
        let normal = if normal.dot(ray) > 0.0 {
            -normal
        } else {
            normal
        };
        let cosine = -normal.dot(ray.normalize());
        let least = f64::from(LEAST_COSINE);
        if noise > 0.0 && cosine < least - EITHER {
            return None;
        }
        let is_certain = noise == 0.0 || cosine > least + EITHER;
        Some(OracleSurface {
            point: ray / own + self.view.pose.eye - self.target.centre,
            steps,
            normal,
            is_certain,
        })
    }

    /// The expected samples of pixel (x, y).
    fn expected(&self, x: u32, y: u32) -> Vec<ExpectedSample> {
        let mut samples = Vec::new();
        let Some(surface) = self.surface(x.into(), y.into()) else {
            return samples;
        };
        let home = Face::containing(surface.point);
        let (position, [a, b], ..) = self.project(&surface, home);
        let reach = (a.abs() + b.abs()) * (0.5 * f64::from(OVERLAP));
        let widest = reach.max_element() - f64::from(POINT_PX);
        let size = f64::from(self.target.face_px);
        if widest < EITHER {
            samples.extend(self.point_samples(&surface, home, [x, y], widest < -EITHER));
        }
        if widest > -EITHER {
            let margin = (position - reach)
                .min_element()
                .min(size - (position + reach).max_element());
            for face in Face::ALL {
                let neighbor = face != home && face.normal() != -home.normal();
                if face == home
                    || (neighbor && margin < EITHER && surface.point.dot(face.normal()) > 1e-6)
                {
                    let is_certain = widest > EITHER && (face == home || margin < -EITHER);
                    self.fill(&surface, face, [x, y], is_certain, &mut samples);
                }
            }
        }
        samples
    }

    /// Position on a face, steps, inverse depth, and the change of inverse depth over the steps.
    fn project(&self, surface: &OracleSurface, face: Face) -> (DVec2, [DVec2; 2], f64, DVec2) {
        let half = f64::from(self.target.face_px) / 2.0;
        let project_point = |point: DVec3| {
            let depth = point.dot(face.normal());
            dvec2(
                half * (1.0 + point.dot(face.right()) / depth),
                half * (1.0 - point.dot(face.up()) / depth),
            )
        };
        let q = 1.0 / surface.point.dot(face.normal());
        // Central difference along a step.
        let steps = surface.steps.map(|step| {
            let tiny = 1e-6 / step.length().max(1e-12) * surface.point.length();
            (project_point(surface.point + step * tiny)
                - project_point(surface.point - step * tiny))
                / (2.0 * tiny)
        });
        let slopes = surface.steps.map(|step| -step.dot(face.normal()) * q * q);
        (
            project_point(surface.point),
            steps,
            q,
            DVec2::from_array(slopes),
        )
    }

    fn sample(
        &self,
        surface: &OracleSurface,
        face: Face,
        pixel: [i64; 2],
        inverse_depth: f64,
        color_position: DVec2,
    ) -> ExpectedSample {
        let toward = surface.point - (self.view.pose.eye - self.target.centre);
        let levels = self
            .view
            .color_at([color_position.x + 0.5, color_position.y + 0.5]);
        ExpectedSample {
            row: face.index() * self.target.face_px as usize + pixel[1] as usize,
            column: pixel[0] as u32,
            inverse_depth,
            weight: -surface.normal.dot(toward.normalize()) / toward.length_squared(),
            area: surface.steps[0].cross(surface.steps[1]).length(),
            normal: surface.normal,
            levels: levels.expect("the pixel that sees the surface is not masked"),
            is_certain: surface.is_certain,
        }
    }

    /// The samples of a minified pixel.
    fn point_samples(
        &self,
        surface: &OracleSurface,
        face: Face,
        [x, y]: [u32; 2],
        is_certain: bool,
    ) -> Vec<ExpectedSample> {
        let (position, [a, b], q, slopes) = self.project(surface, face);
        let last = i64::from(self.target.face_px) - 1;
        let most = (f64::from(self.target.tolerance) / 2.0).min(q / 2.0);
        // Near the border of two pixels, a sample may fall into either.
        let candidates = |c: f64| {
            let mut pixels: Vec<i64> = [c - EITHER, c + EITHER]
                .map(|c| (c.floor() as i64).clamp(0, last))
                .to_vec();
            pixels.dedup();
            pixels
        };
        let columns = candidates(position.x);
        let rows = candidates(position.y);
        let is_unique = is_certain && columns.len() == 1 && rows.len() == 1;
        let pixels = rows
            .iter()
            .flat_map(|&row| columns.iter().map(move |&column| [column, row]));
        let sample = |[column, row]: [i64; 2]| {
            let offset = dvec2(column as f64 + 0.5, row as f64 + 0.5) - position;
            let within = dvec2(offset.perp_dot(b), a.perp_dot(offset)) / a.perp_dot(b);
            let q = q + slopes.dot(within).clamp(-most, most);
            let mut sample =
                self.sample(surface, face, [column, row], q, dvec2(x.into(), y.into()));
            sample.weight *= a.perp_dot(b).abs().clamp(1e-3, 1.0);
            sample.is_certain &= is_unique;
            sample
        };
        pixels.map(sample).collect()
    }

    /// Appends the samples of a magnified pixel.
    fn fill(
        &self,
        surface: &OracleSurface,
        face: Face,
        [x, y]: [u32; 2],
        is_certain: bool,
        samples: &mut Vec<ExpectedSample>,
    ) {
        let (middle, [a, b], q, slopes) = self.project(surface, face);
        let reach = (a.abs() + b.abs()).max_element().ceil() as i64 + 1;
        let size = i64::from(self.target.face_px);
        let around = |c: f64| (c as i64 - reach).max(0)..(c as i64 + reach + 1).min(size);
        for row in around(middle.y) {
            for column in around(middle.x) {
                let offset = dvec2(column as f64 + 0.5, row as f64 + 0.5) - middle;
                let within = dvec2(offset.perp_dot(b), a.perp_dot(offset)) / a.perp_dot(b);
                let inside = 0.5 * f64::from(OVERLAP) - within.abs().max_element();
                let excess = offset.abs().max_element() - f64::from(MAX_REACH_PX);
                let inverse_depth = q + slopes.dot(within);
                if inside < -EITHER || excess > EITHER || inverse_depth <= 0.0 {
                    continue;
                }
                let position = dvec2(f64::from(x), f64::from(y)) + within;
                let last = DVec2::from_array(self.view.size_px.map(|side| f64::from(side) - 1.0));
                let position = position.clamp(DVec2::ZERO, last);
                let mut sample = self.sample(surface, face, [column, row], inverse_depth, position);
                sample.is_certain &= is_certain && inside > EITHER && excess < -EITHER;
                samples.push(sample);
            }
        }
    }
}

/// An image of a room's walls and floor with a pillar in front, some of whose pixels are unknown
/// and others masked.
fn view(lens: Lens, size_px: [u32; 2], pose: Pose, noise: f32) -> LoadedView {
    let mut random = Rng::new(7);
    let mut unit = move || random.unit() as f32;
    let mut color = Vec::new();
    let mut depth = Vec::new();
    for (x, y) in (0..size_px[1]).flat_map(|y| (0..size_px[0]).map(move |x| (x, y))) {
        let ray = pose.world_from_eye * lens.ray([f64::from(x) + 0.5, f64::from(y) + 0.5], size_px);
        let plane = |normal: DVec3, distance: f64| {
            let t = (distance - normal.dot(pose.eye)) / normal.dot(ray);
            (t > 0.0).then_some(t)
        };
        let pillar =
            plane(DVec3::new(0.3, 0.1, 1.0), -1.6).filter(|t| (pose.eye + ray * *t).x.abs() < 0.25);
        let walls = [
            (DVec3::new(0.2, 0.0, 1.0), -3.0),
            (DVec3::Y, -1.1),
            (DVec3::X, 2.5),
            (DVec3::NEG_Z, -2.0),
        ];
        let t = pillar
            .into_iter()
            .chain(walls.into_iter().filter_map(|(n, d)| plane(n, d)))
            .fold(f64::INFINITY, f64::min);
        let inverse = 1.0 / t as f32 + noise * (unit() - 0.5);
        let is_known = unit() > 0.03;
        depth.push(if is_known {
            1.0 / inverse.max(1e-4)
        } else {
            f32::NAN
        });
        let wave =
            |k: f64| (127.0 + 120.0 * (k * f64::from(x) * 0.05 + f64::from(y) * 0.07).sin()) as u8;
        color.push([
            wave(1.0),
            wave(-0.7),
            wave(2.0),
            if unit() > 0.02 { 255 } else { 0 },
        ]);
    }
    LoadedView {
        size_px,
        lens,
        pose,
        color,
        depth,
    }
}

/// Compares the kernel with the oracle: every certain sample is present, and no other sample is.
fn compare(target: &WarpTarget, view: &LoadedView, name: &str) {
    let [width, height] = view.size_px;
    let oracle = Oracle { target, view };
    let mut expected: Vec<ExpectedSample> = (0..height)
        .flat_map(|y| (0..width).map(move |x| (x, y)))
        .flat_map(|(x, y)| oracle.expected(x, y))
        .collect();
    expected.sort_by_key(|one| (one.row, one.column));
    let batches = target.warp(view, 3, &RowSamplePool::default());
    let mut used = vec![false; expected.len()];
    let mut count = 0;
    for row in 0..6 * target.face_px as usize {
        for sample in batches.iter().flat_map(|batch| batch.row(row)).flatten() {
            count += 1;
            let column = u32::from(sample.column);
            let first = expected.partition_point(|one| (one.row, one.column) < (row, column));
            let candidates = (first..expected.len())
                .take_while(|&i| (expected[i].row, expected[i].column) == (row, column));
            let near = |a: f64, b: f64, tolerance: f64| (a - b).abs() <= tolerance * b.abs();
            let is_same = |i: &usize| {
                let one = &expected[*i];
                let levels = (0..3).all(|c| {
                    let [low, high] = [-LEVELS, LEVELS]
                        .map(|d| (one.levels[c] + d).clamp(0.0, 255.0).round() as u8);
                    (low..=high).contains(&srgb8_from_linear(sample.color.linear()[c]))
                });
                near(
                    sample.inverse_depth.into(),
                    one.inverse_depth,
                    RELATIVE_DEPTH,
                ) && near(sample.weight.into(), one.weight, RELATIVE_AREA)
                    && near(sample.area.into(), one.area, RELATIVE_AREA)
                    && sample.normal.decode().as_dvec3().angle_between(one.normal) < ANGLE
                    && levels
            };
            let unused: Vec<usize> = candidates.filter(|&i| !used[i]).collect();
            // Certain samples first: two patches may give a pixel nearly the same sample.
            let matched = unused
                .iter()
                .copied()
                .filter(|&i| expected[i].is_certain)
                .find(is_same);
            let matched = matched.or_else(|| unused.iter().copied().find(is_same));
            let describe_all = || {
                let describe = |&i: &usize| {
                    let one = &expected[i];
                    format!(
                        "q {} w {} a {} n {} c {:?}",
                        one.inverse_depth, one.weight, one.area, one.normal, one.levels
                    )
                };
                unused.iter().map(describe).collect::<Vec<_>>().join("\n")
            };
            let i = matched.unwrap_or_else(|| {
                panic!(
                    "{name}: row {row}: {sample:?} n {} is none of\n{}",
                    sample.normal.decode(),
                    describe_all()
                )
            });
            used[i] = true;
        }
    }
    let absent = expected
        .iter()
        .zip(&used)
        .filter(|(one, used)| one.is_certain && !**used)
        .count();
    assert_eq!(absent, 0, "{name}: absent samples, of {}", expected.len());
    assert!(count > (width * height) as usize / 2, "{name}: {count}");
}

#[test]
fn kernel_matches_the_oracle_at_every_level() {
    let pinhole = Lens::Pinhole(Pinhole {
        focal_px: [52.0, 50.0],
        principal_px: [30.3, 20.1],
        distortion: Distortion::default(),
    });
    let pose = Pose {
        eye: DVec3::new(0.13, 0.21, -0.17),
        world_from_eye: DMat3::from_rotation_y(0.4) * DMat3::from_rotation_x(-0.2),
    };
    for (name, lens, size) in [
        ("pinhole", pinhole, [61, 43]),
        ("panorama", Lens::Equirectangular, [64, 32]),
    ] {
        for noise in [0.0, 2e-3] {
            let view = view(lens, size, pose, noise);
            // Minified, about the same size, magnified.
            for face_px in [24, 96, 230] {
                let tolerance = 0.02;
                let centre = DVec3::new(-0.05, 0.02, 0.03);
                for level in simd::levels() {
                    let target = WarpTarget {
                        centre,
                        face_px,
                        tolerance,
                        noise,
                        level,
                    };
                    compare(
                        &target,
                        &view,
                        &format!("{name}, noise {noise}, {face_px} px, {}", simd::name(level)),
                    );
                }
            }
        }
    }
}

#[test]
fn every_level_gives_equal_samples() {
    let lens = Lens::Equirectangular;
    let pose = Pose {
        eye: DVec3::new(0.1, 0.2, -0.3),
        world_from_eye: DMat3::from_rotation_z(0.3),
    };
    let view = view(lens, [50, 27], pose, 1e-3);
    let mut level_samples = simd::levels().into_iter().map(|level| {
        let target = WarpTarget {
            centre: DVec3::ZERO,
            face_px: 75,
            tolerance: 0.01,
            noise: 1e-3,
            level,
        };
        let batches = target.warp(&view, 0, &RowSamplePool::default());
        let rows = (0..6 * 75).flat_map(|row| {
            batches
                .iter()
                .flat_map(move |batch| batch.row(row).flatten())
        });
        rows.map(|sample| format!("{sample:?}"))
            .collect::<Vec<String>>()
    });
    let first = level_samples.next().expect("a level");
    assert!(first.len() > 1000 && level_samples.all(|other| other == first));
}

/// An image of one colour at a depth of 2 m, from a camera at the origin that is turned by `roll`,
/// radians.
fn uniform_view(size_px: [u32; 2], focal_px: f64, roll: f64) -> LoadedView {
    let pixels = (size_px[0] * size_px[1]) as usize;
    LoadedView {
        size_px,
        lens: Lens::Pinhole(Pinhole {
            focal_px: [focal_px; 2],
            principal_px: size_px.map(|side| f64::from(side) / 2.0),
            distortion: Distortion::default(),
        }),
        pose: Pose {
            eye: DVec3::ZERO,
            world_from_eye: DMat3::from_rotation_z(roll),
        },
        color: vec![[9, 90, 200, 255]; pixels],
        depth: vec![2.0; pixels],
    }
}

/// Warps an image into a cube about the origin.
fn warp_exact(view: &LoadedView, face_px: u32) -> Vec<RowSamples> {
    let target = WarpTarget {
        centre: DVec3::ZERO,
        face_px,
        tolerance: 0.01,
        noise: 0.0,
        level: simd::level(),
    };
    target.warp(view, 0, &RowSamplePool::default())
}

#[test]
fn images_of_one_row_or_column_are_warped() {
    for size_px in [[1, 1], [1, 9], [9, 1], [2, 2]] {
        let pixels = (size_px[0] * size_px[1]) as usize;
        let batches = warp_exact(&uniform_view(size_px, 9.0, 0.0), 40);
        let samples: Vec<_> = (0..240)
            .flat_map(|row| {
                batches
                    .iter()
                    .flat_map(move |batch| batch.row(row).flatten())
            })
            .collect();
        let levels = |sample: &ImageSample| sample.color.linear().to_array().map(srgb8_from_linear);
        assert!(
            samples.len() >= pixels && samples.iter().all(|sample| levels(sample) == [9, 90, 200]),
            "{size_px:?}"
        );
    }
}

#[test]
fn magnified_images_leave_no_gaps() {
    let size_px = [64, 48];
    let face_px = 80;
    for (focal, roll) in [
        (56.0, 0.3),
        (44.0, 1.1),
        (41.0, 0.1),
        (40.0, 0.0),
        (36.0, 0.4),
        (30.0, 0.785),
        (20.0, 0.2),
    ] {
        let view = uniform_view(size_px, focal, roll);
        let batches = warp_exact(&view, face_px);
        for (x, y) in (0..face_px).flat_map(|y| (0..face_px).map(move |x| (x, y))) {
            let ray = Face::NegZ.direction(f64::from(x) + 0.5, f64::from(y) + 0.5, face_px);
            let there = view.lens.project(view.pose.to_eye(ray), size_px);
            let is_inside = |[u, v, _]: [f64; 3]| u > 0.5 && v > 0.5 && u < 63.5 && v < 47.5;
            let row = (Face::NegZ.index() as u32 * face_px + y) as usize;
            let mut samples = batches.iter().flat_map(|batch| batch.row(row)).flatten();
            assert!(
                !there.is_some_and(is_inside)
                    || samples.any(|sample| u32::from(sample.column) == x),
                "{focal}: {x} {y}"
            );
        }
    }
}
