//! Frames left out of an image set, judged against their photographs (E12's protocol, for S12).
//!
//! Every N-th view is left out. It is then shown from the others: by `nearest`, the one view
//! nearest to it warped alone, by `live-3`, the three nearest merged (what S24 builds while one
//! moves; how long it takes anew with images in memory is measured too), by `ldi`, all of them
//! merged into one cube, and by view-dependent geometry in each of its ways of texturing (E9).
//! Errors are taken where all show something, so that none gains by leaving out what is hard; the
//! share that each covers stands beside them. Frames are exposed as the photograph was. Where its
//! camera stood is estimated with that of the others, as is usual for sets without surveyed
//! cameras.

use super::held_out::{
    GainedFrame, HOLE, HeldOut, HeldOutComparison, HoldOutError, Rows, camera_of, photograph,
};
use crate::machine::{Machine, commit};
use crate::table::{Table, figure, percent};
use glam::DVec3;
use headbox_core::camera::Camera;
use headbox_core::progress::Progress;
use headbox_cube::model::samples::CubeSamples;
use headbox_cube::pack::{CubeLdi, SplatIndexLayout, Split};
use headbox_cube::render::{RenderSettings, Renderer};
use headbox_images::{ImageSet, LoadedView, Registration, View};
use headbox_ldi::from_images::{ImagesJob, NearImages};
use headbox_photos::view_geometry::{
    GeometryRenderer, GeometryResources, GeometrySettings, RankWeights, Texturing, ViewGeometry,
    WaitPolicy,
};
use image::RgbImage;
use serde::Serialize;
use std::time::Instant;

/// All rows, and where they were measured.
#[derive(Clone, Debug, Serialize)]
pub struct ImagesReport {
    /// The computer.
    pub machine: Machine,
    /// The program.
    pub commit: String,
    /// A view in so many was left out.
    pub hold_out: usize,
    /// A row for each view and variant.
    pub rows: Vec<HeldOut>,
    /// A row for each view and each of some weights of ranking (E6), judged where all of these show
    /// something.
    pub weights: Vec<HeldOut>,
}

/// A frame and its photograph side by side, for looking at.
pub struct SideBySide {
    /// The view's name.
    pub view: String,
    /// The photograph.
    pub photograph: RgbImage,
    /// One for each of the [`variants`]; magenta where nothing is known.
    pub frames: Vec<RgbImage>,
}

/// Weights of ranking that are compared, of distance, angle and visibility (C26: the paper names
/// none), by the default way of texturing.
const WEIGHTS: [(&str, [f64; 3]); 7] = [
    ("1 : 1 : 1", [1.0, 1.0, 1.0]),
    ("3 : 1 : 1", [3.0, 1.0, 1.0]),
    ("1 : 3 : 1", [1.0, 3.0, 1.0]),
    ("1 : 1 : 3", [1.0, 1.0, 3.0]),
    ("0 : 1 : 1", [0.0, 1.0, 1.0]),
    ("1 : 0 : 1", [1.0, 0.0, 1.0]),
    ("1 : 1 : 0", [1.0, 1.0, 0.0]),
];

/// Errors of the paper's texturing variants at its castle's gate, levels of 255 (E-N3).
const IN_PAPER: [(Texturing, f64); 4] = [
    (Texturing::Nearest, 26.5),
    (Texturing::Single, 12.8),
    (Texturing::Multi, 12.4),
    (Texturing::Blended, 11.8),
];

/// Cubes that show a view: of the nearest other one alone, of the [`NearImages::COUNT`] nearest, of
/// all.
const CUBES: [&str; 3] = ["nearest", "live-3", "ldi"];

/// Ways to show a view: by cubes, and by view-dependent geometry.
pub fn variants() -> impl Iterator<Item = &'static str> + Clone {
    CUBES
        .into_iter()
        .chain(Texturing::ALL.into_iter().map(|(name, _)| name))
}

/// Settings of view-dependent geometry.
pub struct Geometry {
    /// Settings of frames; the texturing variant is ignored.
    pub settings: GeometrySettings,
    /// Resources for opening the set.
    pub resources: GeometryResources,
}

/// Measures a set; `show` is given every view's frames. With `hold_out` 1 each view is left out
/// alone, else every `hold_out`-th at once.
///
/// # Errors
/// See [`HoldOutError`].
pub fn measure(
    set: &ImageSet,
    job: &ImagesJob,
    geometry: &Geometry,
    hold_out: usize,
    progress: &dyn Progress,
    show: &mut dyn FnMut(SideBySide),
) -> Result<ImagesReport, HoldOutError> {
    let views: Vec<&View> = set.views_with_depth().collect();
    if views.len() < 2 {
        return Err(HoldOutError::TooFew {
            found: views.len(),
            what: "views with depth",
            least: 2,
        });
    }
    let hold_out = hold_out.clamp(1, views.len());
    let rounds: Vec<Vec<usize>> = match hold_out {
        1 => (0..views.len()).map(|i| vec![i]).collect(),
        n => vec![(n / 2..views.len()).step_by(n).collect()],
    };
    let started = Instant::now();
    let opened = ViewGeometry::open(set, &views, &geometry.resources, progress)?;
    let geometry_ms = started.elapsed().as_secs_f64() * 1e3;
    let mut bench = Bench {
        set,
        job,
        views: &views,
        progress,
        renderer: Renderer::new(),
        geometry: opened,
        geometry_ms,
        settings: GeometrySettings {
            hole_color_srgb: HOLE,
            ..geometry.settings
        },
        geometry_renderer: GeometryRenderer::new(),
        rows: Vec::new(),
        weights: Vec::new(),
    };
    for left_out in &rounds {
        bench.geometry.leave_out(left_out);
        let kept: Vec<&View> = (0..views.len())
            .filter(|i| !left_out.contains(i))
            .map(|i| views[i])
            .collect();
        let all = bench.cube(job.centre, &kept)?;
        let others = ImageSet {
            views: kept.iter().map(|&view| view.clone()).collect(),
            ..set.clone()
        };
        let mut near = NearImages::new(others, job.clone(), NearImages::DEFAULT_BUDGET)?;
        for &i in left_out {
            bench.judge(i, &mut near, &all, show)?;
        }
    }
    Ok(ImagesReport {
        machine: Machine::here(),
        commit: commit(),
        hold_out,
        rows: bench.rows,
        weights: bench.weights,
    })
}

struct Bench<'a> {
    set: &'a ImageSet,
    job: &'a ImagesJob,
    views: &'a [&'a View],
    progress: &'a dyn Progress,
    renderer: Renderer,
    geometry: ViewGeometry,
    geometry_ms: f64,
    settings: GeometrySettings,
    geometry_renderer: GeometryRenderer,
    rows: Vec<HeldOut>,
    weights: Vec<HeldOut>,
}

/// A cube, and how long it took.
struct SetCube {
    cube: CubeLdi,
    /// From files.
    build_ms: f64,
    /// From images in memory; NaN where it is not made anew.
    rebuild_ms: f64,
}

impl Bench<'_> {
    fn cube(&self, centre: DVec3, views: &[&View]) -> Result<SetCube, HoldOutError> {
        let started = Instant::now();
        let job = ImagesJob {
            centre,
            ..self.job.clone()
        };
        let cube: CubeSamples = job.run(self.set, views, self.progress)?;
        let cube = CubeLdi::pack(&cube, SplatIndexLayout::Normal, Split::Auto)?;
        Ok(SetCube {
            cube,
            build_ms: started.elapsed().as_secs_f64() * 1e3,
            rebuild_ms: f64::NAN,
        })
    }

    /// The cube of images near a view: from files, and once more from memory.
    fn near(&self, near: &mut NearImages, chosen: &[usize]) -> Result<SetCube, HoldOutError> {
        let views: Vec<&View> = chosen.iter().map(|&i| &near.views()[i]).collect();
        let centre = views
            .first()
            .map_or(self.job.centre, |view| view.color_pose().eye);
        let from_files = self.cube(centre, &views)?;
        near.cube(chosen)?;
        let started = Instant::now();
        let cube = CubeLdi::pack(&near.cube(chosen)?, SplatIndexLayout::Normal, Split::Auto)?;
        Ok(SetCube {
            cube,
            rebuild_ms: started.elapsed().as_secs_f64() * 1e3,
            ..from_files
        })
    }

    fn judge(
        &mut self,
        i: usize,
        near: &mut NearImages,
        all: &SetCube,
        show: &mut dyn FnMut(SideBySide),
    ) -> Result<(), HoldOutError> {
        let view = self.views[i];
        let gain = view
            .registration
            .map_or([1.0; 3], |registration| registration.gain);
        // As it was exposed: frames are then exposed alike.
        let registration = view.registration.map(|registration| Registration {
            gain: [1.0; 3],
            ..registration
        });
        let held = View {
            registration,
            ..view.clone()
        }
        .load()?;
        let Some(camera) = camera_of(&held) else {
            return Ok(());
        };
        let (photograph, visible) = photograph(&held, &camera);
        let chosen = near.nearest(&camera, NearImages::COUNT);
        let [alone, few] = [self.near(near, &chosen[..1])?, self.near(near, &chosen)?];
        let mut drawn: Vec<GainedFrame> = [&alone, &few, all]
            .into_iter()
            .map(|cube| self.draw(cube, &camera, gain))
            .collect();
        let by_texturing = |(_, texturing)| GeometrySettings {
            texturing,
            ..self.settings
        };
        let ways = Texturing::ALL.map(by_texturing);
        drawn.extend(ways.map(|settings| self.draw_geometry(settings, &camera, gain)));
        let weighed = WEIGHTS.map(|(_, [distance, angle, visibility])| {
            let weights = RankWeights {
                distance,
                angle,
                visibility,
            };
            self.draw_geometry(
                GeometrySettings {
                    weights,
                    ..self.settings
                },
                &camera,
                gain,
            )
        });
        let edges = near_edges(&held, &camera);
        let scene = self.set.folder.display().to_string();
        for (names, drawn, to) in [
            (
                &variants().collect::<Vec<_>>(),
                drawn.as_slice(),
                &mut self.rows,
            ),
            (
                &WEIGHTS.map(|(name, _)| name).to_vec(),
                weighed.as_slice(),
                &mut self.weights,
            ),
        ] {
            let judge = HeldOutComparison::where_all_show(
                &scene,
                &view.name,
                &photograph,
                (&visible, &edges),
                drawn,
            );
            to.extend(
                names
                    .iter()
                    .zip(drawn)
                    .map(|(name, drawn)| judge.row(name, drawn)),
            );
        }
        let frames = drawn.into_iter().map(|drawn| drawn.picture).collect();
        show(SideBySide {
            view: view.name.clone(),
            photograph,
            frames,
        });
        Ok(())
    }

    /// Draws a cube.
    fn draw(&mut self, built: &SetCube, camera: &Camera, gain: [f32; 3]) -> GainedFrame {
        let cube = &built.cube;
        let settings = RenderSettings {
            hole_color_srgb: HOLE,
            keep_holes: true,
            ..RenderSettings::default()
        };
        self.renderer.render(cube, camera, &settings);
        self.renderer.render(cube, camera, &settings);
        let (frame, stats) = self.renderer.render_with_stats(cube, camera, &settings);
        let drawn = GainedFrame::new(frame, gain, Some(HOLE)).took(
            stats.frame_ms,
            built.build_ms,
            cube.bytes(),
        );
        GainedFrame {
            rebuild_ms: built.rebuild_ms,
            ..drawn
        }
    }

    /// Draws view-dependent geometry in a way.
    fn draw_geometry(
        &mut self,
        settings: GeometrySettings,
        camera: &Camera,
        gain: [f32; 3],
    ) -> GainedFrame {
        self.geometry_renderer
            .render(&self.geometry, camera, &settings, WaitPolicy::Wait);
        let (frame, stats) =
            self.geometry_renderer
                .render(&self.geometry, camera, &settings, WaitPolicy::Wait);
        GainedFrame::new(frame, gain, Some(HOLE)).took(
            stats.frame_ms,
            self.geometry_ms,
            self.geometry.bytes(),
        )
    }
}

/// Mask of a camera's pixels near a depth edge of the view, or near the border of its depth.
fn near_edges(view: &LoadedView, camera: &Camera) -> Vec<bool> {
    /// Neighbours whose depths differ by more than this share belong to different surfaces.
    const EDGE: f32 = 0.1;
    /// Half of a window's side, pixels.
    const NEAR_PX: usize = 6;
    let [width, height] = view.size_px.map(|side| side as usize);
    let depth = |x: usize, y: usize| view.depth.get(y * width + x).copied().unwrap_or(f32::NAN);
    let parts = |a: f32, b: f32| (a - b).abs() > EDGE * a.min(b);
    let mut near = vec![false; camera.width() as usize * camera.height() as usize];
    for (x, y) in (0..height.saturating_sub(1))
        .flat_map(|y| (0..width.saturating_sub(1)).map(move |x| (x, y)))
    {
        let here = depth(x, y);
        if !(parts(here, depth(x + 1, y)) || parts(here, depth(x, y + 1))) {
            continue;
        }
        let columns = x.saturating_sub(NEAR_PX)..(x + NEAR_PX + 1).min(width);
        for row in y.saturating_sub(NEAR_PX)..(y + NEAR_PX + 1).min(height) {
            near[row * width + columns.start..row * width + columns.end].fill(true);
        }
    }
    near
}

impl ImagesReport {
    /// Some lines and a table.
    pub fn summary(&self) -> String {
        let rows = |variant: &str| Rows::of(&self.rows, variant);
        let head = [
            "variant",
            "PSNR dB",
            "FLIP",
            "MAD",
            "MAD at edges",
            "covered",
            "frame ms",
            "build ms",
            "rebuild ms",
            "MB",
        ];
        let mut table = Table::new(head);
        for variant in variants() {
            let rows = rows(variant);
            table.row([
                variant.into(),
                format!("{:.2}", rows.psnr_db()),
                format!("{:.4}", rows.mean(|row| row.flip)),
                format!("{:.2}", rows.mean(|row| row.mad)),
                format!("{:.2}", rows.mean(|row| row.mad_at_edges)),
                percent(rows.mean(|row| row.covered)),
                figure(rows.mean(|row| row.frame_ms)),
                figure(rows.mean(|row| row.build_ms)),
                match rows.mean(|row| row.rebuild_ms) {
                    ms if ms.is_nan() => "-".into(),
                    ms => figure(ms),
                },
                figure(rows.mean(|row| row.bytes as f64 / 1e6)),
            ]);
        }
        let [nearest, live, ldi] = CUBES.map(rows);
        format!(
            "# Views left out of an image set\n\n{} views left out (1 in {}), shown from the others and judged against their \
             photographs where all ways show something.\nBeside the nearest image alone, the LDI of the {} nearest is {:.2} dB nearer to \
             the photograph, that of all images {:.2} dB; it covers {} of it instead of {}.\nCommit {}, {}, {} threads, {}.\n\n{table}\n\
             Mean absolute differences over that of the nearest picture as it is:\n\n{}\nWeights of distance, angle and visibility by \
             which cameras are ranked ({}), judged where all of them show something:\n\n{}",
            ldi.count(),
            self.hold_out,
            NearImages::COUNT,
            live.psnr_db() - nearest.psnr_db(),
            ldi.psnr_db() - nearest.psnr_db(),
            percent(ldi.mean(|row| row.covered)),
            percent(nearest.mean(|row| row.covered)),
            self.commit,
            self.machine.processor,
            self.machine.threads,
            self.machine.simd,
            self.beside_the_paper(),
            Texturing::default().name(),
            self.weights_table(),
        )
    }

    /// The ways of texturing beside the paper's.
    fn beside_the_paper(&self) -> Table {
        let mut table = Table::new([
            "variant",
            "in the picture",
            "at edges",
            "in the paper, at its gate",
        ]);
        let of = |texturing: Texturing| Rows::of(&self.rows, texturing.name());
        let [(nearest, paper), ..] = IN_PAPER;
        let over = |texturing: Texturing, mad: fn(&HeldOut) -> f64| {
            of(texturing).mean(mad) / of(nearest).mean(mad)
        };
        for (texturing, mad) in IN_PAPER {
            table.row([
                texturing.name().into(),
                format!("{:.3}", over(texturing, |row| row.mad)),
                format!("{:.3}", over(texturing, |row| row.mad_at_edges)),
                format!("{:.3}", mad / paper),
            ]);
        }
        table
    }

    fn weights_table(&self) -> Table {
        let mut table = Table::new(["weights", "PSNR dB", "FLIP", "MAD", "covered"]);
        for (name, _) in WEIGHTS {
            let rows = Rows::of(&self.weights, name);
            table.row([&[name.into()][..], &rows.errors()].concat());
        }
        table
    }
}
