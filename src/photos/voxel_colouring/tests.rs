//! Voxel colouring beside a slow, obvious one, and a solid that it must find.

use super::*;
use glam::DMat3;
use headbox_core::cube_face::Face;
use headbox_cube::model::depth_bins::DepthBins;
use headbox_cube::model::samples::LayeredDepthImage;
use headbox_images::{Distortion, Pinhole, Pose};
use std::sync::Mutex;

const SIZE: [u32; 2] = [48, 36];

/// A patterned ball before black.
const BALL: (DVec3, f64) = (DVec3::new(0.0, 0.0, -2.0), 0.5);

fn pattern(p: DVec3) -> [u8; 4] {
    let wave = |c: f64| {
        (7.0 * p.x + 4.0 * p.y + c).sin() * 50.0 + (5.0 * p.y - 8.0 * p.z - c).cos() * 40.0 + 150.0
    };
    let [r, g, b] = [0.0, 1.0, 2.0].map(|c| wave(c) as u8);
    [r, g, b, 255]
}

/// Intersects a ray from `eye` with the ball.
fn meet(eye: DVec3, ray: DVec3) -> Option<DVec3> {
    let (to, radius) = (BALL.0 - eye, BALL.1);
    let along = ray.dot(to) / ray.length_squared();
    let aside = (to - ray * along).length_squared();
    (aside < radius * radius)
        .then(|| eye + ray * (along - ((radius * radius - aside) / ray.length_squared()).sqrt()))
}

/// A photograph of the ball from so many degrees to the right.
fn photograph(degrees: f64) -> LoadedView {
    let turn = DMat3::from_rotation_y(degrees.to_radians());
    let eye = BALL.0 + turn * DVec3::Z * 2.0 + DVec3::Y * 0.1 * (degrees * 7.0).sin();
    let pinhole = Pinhole {
        focal_px: [70.0; 2],
        principal_px: [24.0, 18.0],
        distortion: Distortion::default(),
    };
    let lens = Lens::Pinhole(pinhole);
    let color = |i: u32| {
        let ray = turn
            * lens.ray(
                [f64::from(i % SIZE[0]) + 0.5, f64::from(i / SIZE[0]) + 0.5],
                SIZE,
            );
        meet(eye, ray).map_or([0, 0, 0, 255], pattern)
    };
    let color = (0..SIZE[0] * SIZE[1]).map(color).collect();
    LoadedView {
        size_px: SIZE,
        lens,
        pose: Pose {
            eye,
            world_from_eye: turn,
        },
        color,
        depth: Vec::new(),
    }
}

fn photographs() -> Vec<LoadedView> {
    [0.0, -12.0, 12.0, -25.0, 25.0, -38.0, 38.0, 140.0]
        .map(photograph)
        .to_vec()
}

fn job(face_size_px: u32) -> PhotographsJob {
    PhotographsJob {
        centre: DVec3::ZERO,
        half_size_m: 0.2,
        face_size_px,
        agreement: PhotographsJob::AGREEMENT,
        backdrop: Backdrop::Auto,
    }
}

fn colored(job: &PhotographsJob, views: &[LoadedView]) -> Vec<LayeredDepthImage> {
    let (sweep, depths) = job.sweep(views.to_vec());
    sweep.run(&depths, &job.passes(), &headbox_core::progress::Silent)
}

/// The pixels of a face's ray, by the definition alone: `f64`, one candidate after the other,
/// claims as lists of flags.
struct Oracle<'a> {
    job: &'a PhotographsJob,
    views: &'a [LoadedView],
    backdrop: Vec<Vec<bool>>,
    /// Dark pixels beside others.
    rim: Vec<Vec<bool>>,
    claimed: Vec<Vec<bool>>,
}

type Candidate = (usize, u32, u32);

impl<'a> Oracle<'a> {
    fn new(job: &'a PhotographsJob, views: &'a [LoadedView]) -> Self {
        let dark = job.dark(views).expect("a dark backdrop");
        let [width, height] = SIZE.map(i64::from);
        let is_dark = |view: &LoadedView, x: i64, y: i64| {
            let outside = x < 0 || y < 0 || x >= width || y >= height;
            outside
                || view.color[(y * width + x) as usize][..3]
                    .iter()
                    .all(|level| *level <= dark)
        };
        let around = |view: &LoadedView, i: i64| {
            (-1..=1).all(|dy| (-1..=1).all(|dx| is_dark(view, i % width + dx, i / width + dy)))
        };
        let pixels = || 0..width * height;
        let is_rim =
            |view: &LoadedView, i: i64| is_dark(view, i % width, i / width) && !around(view, i);
        let rim = views
            .iter()
            .map(|view| pixels().map(|i| is_rim(view, i)).collect())
            .collect();
        let backdrop = views
            .iter()
            .map(|view| pixels().map(|i| around(view, i)).collect())
            .collect();
        let claimed = vec![vec![false; (width * height) as usize]; views.len()];
        Self {
            job,
            views,
            backdrop,
            rim,
            claimed,
        }
    }

    fn point(&self, (face, x, y): Candidate, depth: f64) -> DVec3 {
        Face::ALL[face].direction(
            f64::from(x) + 0.5,
            f64::from(y) + 0.5,
            self.job.face_size_px,
        ) * depth
    }

    /// Returns the pixel in which a view sees a point from inside the shell.
    fn seen(&self, view: usize, point: DVec3, depth: f64) -> Option<([f64; 2], bool, usize)> {
        let pose = self.views[view].pose;
        let [x, y, _] = self.views[view]
            .lens
            .project(pose.to_eye(point + self.job.centre), SIZE)?;
        let inside = x >= 0.0 && y >= 0.0 && x < f64::from(SIZE[0]) && y < f64::from(SIZE[1]);
        let within = (pose.eye - self.job.centre).abs().max_element() < depth;
        inside.then(|| ([x, y], within, y as usize * SIZE[0] as usize + x as usize))
    }

    /// Variance and colour.
    fn evidence(&self, candidate: Candidate, depth: f64, pass: &Pass) -> Option<(f64, DVec3)> {
        let point = self.point(candidate, depth);
        let mut colors = Vec::new();
        for view in 0..self.views.len() {
            let Some((position, within, pixel)) = self.seen(view, point, depth) else {
                continue;
            };
            if self.backdrop[view][pixel] {
                return None;
            }
            if within && !self.claimed[view][pixel] && !self.rim[view][pixel] {
                colors.push(DVec3::from(
                    self.views[view].color_at(position).expect("inside"),
                ));
            }
        }
        let count = colors.len() as f64;
        let mean = colors.iter().sum::<DVec3>() / count;
        let variance = colors
            .iter()
            .map(|color| color.distance_squared(mean))
            .sum::<f64>()
            / count;
        (colors.len() >= pass.min_views)
            .then(|| (variance.min(f64::from(pass.max_variance())), mean))
    }

    fn claim(&mut self, candidate: Candidate, depth: f64) {
        let point = self.point(candidate, depth);
        for view in 0..self.views.len() {
            let Some(([x, y], true, own)) = self.seen(view, point, depth) else {
                continue;
            };
            let distance = self.views[view].pose.eye.distance(point + self.job.centre);
            let reach = depth / f64::from(self.job.face_size_px) * 70.0 / distance;
            for (i, claimed) in self.claimed[view].iter_mut().enumerate() {
                let column = (i % SIZE[0] as usize) as f64 + 0.5;
                let row = (i / SIZE[0] as usize) as f64 + 0.5;
                *claimed |= i == own || ((column - x).abs() <= reach && (row - y).abs() <= reach);
            }
        }
    }

    /// Candidates that are kept, with their depths, of one face.
    fn run(mut self, face: usize, depths: &[f64], passes: &[Pass]) -> Vec<(Candidate, f64)> {
        let side = self.job.face_size_px;
        let all: Vec<Candidate> = (0..side * side)
            .map(|i| (face, i % side, i / side))
            .collect();
        let mut kept = Vec::new();
        for pass in passes {
            let mut runs: Vec<Vec<(f64, f64)>> = vec![Vec::new(); all.len()];
            for depth in depths.iter().copied().chain([f64::INFINITY]) {
                let evidence: Vec<_> = all
                    .iter()
                    .map(|&candidate| {
                        depth
                            .is_finite()
                            .then(|| self.evidence(candidate, depth, pass))
                            .flatten()
                    })
                    .collect();
                let mut ended = Vec::new();
                for (i, &candidate) in all.iter().enumerate() {
                    let (_, x, y) = candidate;
                    let near = |at: u32| at.saturating_sub(1)..(at + 2).min(side);
                    let window: Vec<f64> = near(y)
                        .flat_map(|row| near(x).map(move |column| row * side + column))
                        .filter_map(|other| evidence[other as usize].map(|found| found.0))
                        .collect();
                    let mean = window.iter().sum::<f64>() / window.len() as f64;
                    let agreed =
                        evidence[i].is_some() && mean <= f64::from(pass.agreeing_variance());
                    if agreed {
                        runs[i].push((mean, depth));
                    }
                    if !runs[i].is_empty()
                        && (!agreed || runs[i].len() == pass.longest_run as usize)
                    {
                        let best = runs[i]
                            .drain(..)
                            .reduce(|a, b| if b.0 < a.0 { b } else { a })
                            .expect("a run");
                        ended.push((candidate, best.1));
                    }
                }
                ended
                    .iter()
                    .for_each(|(candidate, depth)| self.claim(*candidate, *depth));
                kept.extend(ended);
            }
        }
        kept
    }
}

/// Candidates for which rounding to `f32` may decide otherwise: those on a threshold, and what
/// follows from them.
const ROUNDED: f64 = 0.02;

#[test]
fn sweep_matches_definition() {
    let (job, views) = (job(48), photographs());
    let (sweep, depths) = job.sweep(views.clone());
    let depths: Vec<f64> = depths.into_iter().step_by(2).collect();
    let faces = sweep.run(&depths, &job.passes(), &headbox_core::progress::Silent);
    let face = Face::NegZ.index();
    let similar = DepthBins::new(job.half_size_m, job.face_size_px).inverse_depth(1.0);
    let expected = Oracle::new(&job, &views).run(face, &depths, &job.passes());
    let (mut total, mut same) = (0, 0);
    for y in 0..48 {
        for x in 0..48 {
            let mut of_pixel: Vec<f64> = expected
                .iter()
                .filter(|(candidate, _)| *candidate == (face, x, y))
                .map(|(_, depth)| 1.0 / depth)
                .collect();
            of_pixel.sort_by(|a, b| b.total_cmp(a));
            let mut nearest = f64::INFINITY;
            of_pixel.retain(|q| {
                let distinct = nearest - q > similar;
                nearest = if distinct { *q } else { nearest };
                distinct
            });
            let found: Vec<f64> = faces[face]
                .pixel(x, y)
                .iter()
                .rev()
                .map(|sample| f64::from(sample.inverse_depth))
                .collect();
            total += usize::from(!of_pixel.is_empty() || !found.is_empty());
            let equal = found.len() == of_pixel.len()
                && found
                    .iter()
                    .zip(&of_pixel)
                    .all(|(a, b)| (a / b - 1.0).abs() < 1e-6);
            same += usize::from(equal && !found.is_empty());
        }
    }
    assert!(total > 90, "{total} pixels");
    assert!(
        (total - same) as f64 <= ROUNDED * total as f64,
        "{same} of {total} pixels are as expected"
    );
}

#[test]
fn ball_is_reconstructed() {
    let (job, views) = (job(140), photographs());
    let faces = colored(&job, &views);
    let face = &faces[Face::NegZ.index()];
    let (mut on_ball, mut found, mut colors) = (0, 0, 0.0);
    for (x, y) in (0..140).flat_map(|y| (0..140).map(move |x| (x, y))) {
        let ray = Face::NegZ.direction(f64::from(x) + 0.5, f64::from(y) + 0.5, 140);
        let nearest = face.pixel(x, y).last();
        let Some(point) = meet(DVec3::ZERO, ray) else {
            continue;
        };
        on_ball += 1;
        let Some(sample) = nearest else { continue };
        // Between cameras 25 degrees apart a pixel of parallax is 0.06 m of depth.
        if (1.0 / f64::from(sample.inverse_depth) + point.z).abs() < 0.07 {
            found += 1;
            colors += (0..3)
                .map(|c| f64::from(sample.color_srgb[c].abs_diff(pattern(point)[c])))
                .sum::<f64>()
                / 3.0;
        }
    }
    let elsewhere: usize = faces
        .iter()
        .filter(|face| face.face != Face::NegZ)
        .map(|face| face.samples.len())
        .sum();
    // Its rim, seen edge-on, is not told by three.
    assert!(
        on_ball > 800 && found * 5 > on_ball * 4,
        "{found} of {on_ball} pixels"
    );
    assert!(
        colors / f64::from(found) < 8.0,
        "{} levels",
        colors / f64::from(found)
    );
    assert_eq!(elsewhere, 0);
}

#[test]
fn result_is_independent_of_threads() {
    let (job, views) = (job(72), photographs());
    let on = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(threads)
            .build()
            .expect("a pool");
        pool.install(|| colored(&job, &views))
    };
    assert_eq!(on(1), on(3));
}

/// Total and completed steps of all stages.
#[derive(Default)]
struct Steps(Mutex<Vec<[u64; 2]>>);

impl Progress for Steps {
    fn begin(&self, _: &str, _: &str, total: u64) {
        self.0.lock().expect("locked").push([total, 0]);
    }

    fn advance(&self, steps: u64) {
        self.0.lock().expect("locked").last_mut().expect("begun")[1] += steps;
    }
}

#[test]
fn progress_is_one_stage_in_proportion_to_work() {
    let job = job(72);
    let work = |count: usize| {
        let (sweep, depths) = job.sweep(photographs()[..count].to_vec());
        let steps = Steps::default();
        sweep.run(&depths, &job.passes(), &steps);
        let stages = steps.0.into_inner().expect("unlocked");
        let &[[total, done]] = stages.as_slice() else {
            panic!("{stages:?}");
        };
        assert_eq!(total, done);
        total as f64 / depths.len() as f64
    };
    let (few, all) = (work(4), work(7));
    assert!(few > 0.0 && all > 1.4 * few, "{few} {all}");
}

#[test]
fn blank_photographs_give_empty_cube() {
    let black = LoadedView {
        color: vec![[0, 0, 0, 255]; (SIZE[0] * SIZE[1]) as usize],
        ..photograph(0.0)
    };
    let masked = LoadedView {
        color: vec![[90, 80, 70, 0]; (SIZE[0] * SIZE[1]) as usize],
        ..photograph(0.0)
    };
    let panorama = LoadedView {
        lens: Lens::Equirectangular,
        ..photograph(0.0)
    };
    let one = photograph(0.0);
    for views in [
        vec![],
        vec![one.clone()],
        vec![one; 3],
        vec![black; 3],
        vec![masked; 3],
        vec![panorama; 3],
    ] {
        let samples: usize = colored(&job(40), &views)
            .iter()
            .map(|face| face.samples.len())
            .sum();
        assert_eq!(samples, 0);
    }
}

#[test]
fn omitted_photographs_are_reported() {
    let view = |i: u32, size_px| {
        let pose = Pose {
            eye: DVec3::X * f64::from(i),
            world_from_eye: DMat3::IDENTITY,
        };
        let lens = photograph(0.0).lens;
        View::new(i.to_string(), size_px, lens, pose, "none.png".into(), None)
    };
    let told = |count: u32, size_px: [u32; 2]| {
        let views: Vec<View> = (0..count).map(|i| view(i, size_px)).collect();
        job(16).left_out(&views.iter().collect::<Vec<_>>())
    };
    assert_eq!(told(100, [640, 480]), None);
    // As many of 2^20 pixels as fill it, and three more.
    let room = (PHOTOGRAPHS_BYTES / (Photograph::BYTES_PER_PIXEL << 20)) as u32;
    assert_eq!(told(room, [1024, 1024]), None);
    let sentence = told(room + 3, [1024, 1024]).expect("a sentence");
    assert!(
        sentence.starts_with(&format!("3 of {} photographs", room + 3)),
        "{sentence}"
    );
    assert_eq!(told(0, [640, 480]), None);
}
