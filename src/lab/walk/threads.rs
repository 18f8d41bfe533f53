//! Speed-up by threads over one thread that draws in bands. It is measured for each [`Division`];
//! for the sheets of R6 and the fragments of R14 and P5 it is derived from the balance of samples
//! among processors (imbalance is the only loss there).

use super::{MeasureError, share};
use crate::baselines::fragments::FragmentRenderer;
use crate::turns::{run_in_turns, time_ms};
use glam::DVec3;
use headbox_core::camera::Camera;
use headbox_cube::pack::CubeLdi;
use headbox_house::backdrop::{Backdrop, BackdropKind};
use headbox_house::house::House;
use headbox_house::settings::{Division, WalkSettings};
use headbox_house::store::Store;
use headbox_house::variant::HouseVariant;
use headbox_house::walk::Walker;
use headbox_raster::PixelContent;
use rayon::ThreadPool;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use std::ops::Range;
use std::sync::Arc;

/// Maximum number of poses: few suffice for a ratio of sums.
const POSES: usize = 24;

/// Frames of each pose, of which the fastest counts.
const REPEATS: u32 = 3;

/// Measured divisions of the walker (`None` for fragments), with the names of the speed-up behind
/// portals and of the whole frame.
const DIVISIONS: [(Option<Division>, &str, Option<&str>); 3] = [
    (
        Some(Division::Portals),
        "portals: each portal's backdrop on a thread",
        None,
    ),
    (None, "fragments of each backdrop", None),
    (
        Some(Division::Bands),
        "tiles: bands of each backdrop",
        Some("whole frame, backdrops in bands"),
    ),
];

/// Speed-up of one division of the work among processors.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ThreadRow {
    /// Name of the division.
    pub division: String,
    /// True if the speed-up was measured, false if derived from the samples of each processor.
    pub by_the_clock: bool,
    /// Number of processors.
    pub processors: usize,
    /// Speed relative to one processor.
    pub speedup: f64,
}

/// Measures the speed-ups for one kind of LDI among the variants, preferably
/// [`BackdropKind::WindowLdi`]; empty without an LDI.
pub(super) fn speedups(
    house: &House,
    store: &Store,
    cameras: &[Camera],
    variants: &[HouseVariant],
) -> Result<Vec<ThreadRow>, MeasureError> {
    let has = |kind: &BackdropKind| variants.iter().any(|variant| variant.kind == Some(*kind));
    let Some(kind) = [
        BackdropKind::WindowLdi,
        BackdropKind::Ldi,
        BackdropKind::CellLdi,
    ]
    .into_iter()
    .find(has) else {
        return Ok(Vec::new());
    };
    let settings = WalkSettings {
        backdrops: Some(kind),
        ..WalkSettings::default()
    };
    let cameras: Vec<Camera> = cameras
        .iter()
        .step_by(cameras.len().div_ceil(POSES).max(1))
        .copied()
        .collect();
    let threads = rayon::current_num_threads();
    let [one_thread, all_threads] = [pool(1)?, pool(threads)?];
    let renderer = |pool, division| DividedRenderer {
        pool,
        division,
        fragments: Vec::new(),
    };
    let mut renderers = vec![renderer(&one_thread, Some(Division::Bands))];
    renderers.extend(DIVISIONS.map(|(division, ..)| renderer(&all_threads, division)));
    let times = times(house, store, &cameras, &settings, &mut renderers);
    let measured = |division: &str, speedup| ThreadRow {
        division: division.into(),
        by_the_clock: true,
        processors: threads,
        speedup,
    };
    let mut rows = Vec::new();
    let one = times[0];
    for (&(_, name, frame_name), all) in DIVISIONS.iter().zip(&times[1..]) {
        rows.push(measured(name, share(one[0], all[0])));
        rows.extend(frame_name.map(|name| measured(name, share(one[1], all[1]))));
    }
    for processors in [2, 4] {
        let mut sheets = Balance::default();
        let mut fragments = Balance::default();
        for camera in &cameras {
            for backdrop in Walker::shown(house, store, camera, &settings) {
                let Backdrop::Cubes(cubes) = &*backdrop else {
                    continue;
                };
                for cube in cubes {
                    divide(cube, camera.eye(), processors, &mut sheets, &mut fragments);
                }
            }
        }
        for (division, balance) in [
            ("sheets about the epipole", sheets),
            ("fragments", fragments),
        ] {
            rows.push(ThreadRow {
                division: division.into(),
                by_the_clock: false,
                processors,
                speedup: share(balance.all as f64, balance.slowest as f64),
            });
        }
    }
    Ok(rows)
}

fn pool(threads: usize) -> Result<ThreadPool, rayon::ThreadPoolBuildError> {
    rayon::ThreadPoolBuilder::new().num_threads(threads).build()
}

/// A thread pool and a division of the work to time.
struct DividedRenderer<'a> {
    pool: &'a ThreadPool,
    /// `None` for fragments, which are drawn without the walker and not copied into the frame.
    division: Option<Division>,
    /// One renderer for each backdrop.
    fragments: Vec<FragmentRenderer>,
}

impl DividedRenderer<'_> {
    /// Draws a frame; returns the times of the backdrops and of the frame, ms. `views`: the
    /// backdrops of the frame.
    fn draw(
        &mut self,
        house: &House,
        store: &Store,
        camera: &Camera,
        settings: &WalkSettings,
        walker: &mut Walker,
        views: &[(Arc<Backdrop>, Camera)],
    ) -> [f64; 2] {
        if let Some(division) = self.division {
            let settings = WalkSettings {
                division,
                ..*settings
            };
            return self.pool.install(|| {
                let stats = walker.frame(house, store, camera, &settings).1;
                [stats.backdrop_ms, stats.frame_ms]
            });
        }
        let count = self.pool.current_num_threads() as u32;
        self.fragments.resize_with(
            views.len().max(self.fragments.len()),
            FragmentRenderer::default,
        );
        let mut draw = || {
            let renderers = self.fragments.par_iter_mut().zip(views).with_max_len(1);
            renderers.for_each(|(renderer, (backdrop, camera))| {
                let Backdrop::Cubes(cubes) = &**backdrop else {
                    return;
                };
                for cube in cubes {
                    renderer.render(cube, camera, &settings.warp, count);
                }
            });
        };
        let ms = time_ms(|| self.pool.install(&mut draw));
        [ms, ms]
    }
}

/// Returns the backdrops of a walker's last frame, each with a camera cropped to its pixels.
fn views(
    house: &House,
    store: &Store,
    camera: &Camera,
    settings: &WalkSettings,
    walker: &Walker,
) -> Vec<(Arc<Backdrop>, Camera)> {
    let width = camera.width();
    let backdrops = (0..).zip(Walker::shown(house, store, camera, settings));
    let visible = backdrops.filter_map(|(number, backdrop)| {
        // Empty at first.
        let mut columns = Range {
            start: u32::MAX,
            end: 0,
        };
        let mut rows = columns.clone();
        let marker = PixelContent::Marker(number);
        let pixels = 0..width * camera.height();
        for i in pixels.filter(|i| walker.last().seen(*i as usize) == marker) {
            let (x, y) = (i % width, i / width);
            columns = columns.start.min(x)..columns.end.max(x + 1);
            rows = rows.start.min(y)..rows.end.max(y + 1);
        }
        Some((backdrop, camera.cropped(columns, rows).ok()?))
    });
    visible.collect()
}

/// Times the backdrops and the whole frames of each renderer in turns, ms: the least of each pose,
/// summed over poses.
fn times(
    house: &House,
    store: &Store,
    cameras: &[Camera],
    settings: &WalkSettings,
    renderers: &mut [DividedRenderer],
) -> Vec<[f64; 2]> {
    let mut walker = Walker::new();
    let mut sums = vec![[0.0; 2]; renderers.len()];
    for camera in cameras {
        walker.frame(house, store, camera, settings);
        let views = views(house, store, camera, settings, &walker);
        let times = run_in_turns(renderers, REPEATS, |_, renderer| {
            Some(renderer.draw(house, store, camera, settings, &mut walker, &views))
        });
        for (sum, times) in sums.iter_mut().zip(times) {
            for (i, sum) in sum.iter_mut().enumerate() {
                *sum += times
                    .iter()
                    .map(|time| time[i])
                    .fold(f64::INFINITY, f64::min);
            }
        }
    }
    sums
}

/// Total number of samples, and number of samples of the busiest processor, both summed over
/// segments, which are drawn one after the other.
#[derive(Default)]
struct Balance {
    all: u64,
    slowest: u64,
}

impl Balance {
    /// Adds a segment whose parts are assigned, the largest first, to the least loaded processor.
    fn add(&mut self, mut parts: Vec<u64>, processors: usize) {
        parts.sort_unstable_by(|a, b| b.cmp(a));
        let mut loads = vec![0; processors.max(1)];
        for part in parts {
            self.all += part;
            if let Some(least) = loads.iter_mut().min() {
                *least += part;
            }
        }
        self.slowest += loads.into_iter().max().unwrap_or(0);
    }
}

/// Divides each segment of a cube at its epipole into sheets, and each sheet into one fragment of
/// equal area per processor, along lines through the epipole.
fn divide(
    cube: &CubeLdi,
    eye: DVec3,
    processors: usize,
    sheets: &mut Balance,
    fragments: &mut Balance,
) {
    for segment in &cube.segments {
        let face = segment.face;
        let from_centre = eye - cube.info.centre;
        let depth = face.normal().dot(from_centre);
        // An epipole at infinity is moved so far away that lines through it are nearly parallel.
        let depth = if depth.abs() > 1e-9 { depth } else { 1e-9 };
        let half = f64::from(cube.face_size_px) / 2.0;
        let epipole = [
            half * (1.0 + face.right().dot(from_centre) / depth),
            half * (1.0 - face.up().dot(from_centre) / depth),
        ];
        // Angle about the epipole and samples of each pixel, by sheet.
        let mut pixels: [Vec<(f64, u64)>; 4] = Default::default();
        let counts = segment.row_counts.chunks(segment.width as usize + 1);
        for (y, row) in (segment.y0..).zip(counts) {
            let dy = f64::from(y) + 0.5 - epipole[1];
            for (x, ends) in (segment.x0..).zip(row.windows(2)) {
                let dx = f64::from(x) + 0.5 - epipole[0];
                let sheet = usize::from(dx >= 0.0) + 2 * usize::from(dy >= 0.0);
                let angle = dy.abs().atan2(dx.abs());
                pixels[sheet].push((angle, u64::from(ends[1] - ends[0])));
            }
        }
        let sum = |pixels: &[(f64, u64)]| pixels.iter().map(|pixel| pixel.1).sum::<u64>();
        sheets.add(
            pixels.iter().map(|pixels| sum(pixels)).collect(),
            processors,
        );
        let mut parts = Vec::new();
        for sheet in &mut pixels {
            sheet.sort_by(|a, b| a.0.total_cmp(&b.0));
            parts.extend(
                sheet
                    .chunks(sheet.len().div_ceil(processors).max(1))
                    .map(sum),
            );
        }
        fragments.add(parts, processors);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn largest_part_bounds_speedup() {
        let mut balance = Balance::default();
        balance.add(vec![1, 7, 2, 2], 2);
        assert_eq!((balance.all, balance.slowest), (12, 7));
        balance.add(vec![3, 3, 3, 3], 2);
        assert_eq!((balance.all, balance.slowest), (24, 13));
    }
}
