//! Leave-one-out test of an image set with depth: views rendered from the others are compared with
//! their photographs (E12's protocol, for S12).
//!
//! Every N-th view is left out. It is then rendered from the others: by `nearest`, the nearest view
//! warped alone; by `live-3`, the three nearest views merged (S24 builds this during movement; the
//! time to rebuild it from images in memory is measured too); by `ldi`, all views merged into one
//! cube; and by view-dependent geometry with each texturing variant (E9). Errors are measured at
//! pixels that all variants cover, so that leaving out difficult pixels is no advantage; the
//! coverage of each variant is reported, too. Frames have the photograph's exposure. The pose of
//! the left-out camera was estimated together with the others, as is usual for sets without
//! surveyed cameras.

use super::held_out::{
    HOLE, HeldOutComparison, HeldOutFrame, HeldOutRow, HoldOutError, VariantRows, pinhole_camera,
    reproject, sheets_sentence,
};
use crate::machine::{Machine, commit};
use crate::table::{Table, figure, percent};
use glam::DVec3;
use headbox_core::camera::Camera;
use headbox_core::progress::Progress;
use headbox_cube::pack::{CubeLdi, SplatIndexLayout, Split};
use headbox_cube::render::{RenderSettings, Renderer};
use headbox_images::{Exposure, ImageSet, LoadedView, Registration, View};
use headbox_ldi::from_images::{ImageSetCapture, NearestImages};
use headbox_photos::view_geometry::{
    GeometryRenderer, GeometryResources, GeometrySettings, RankWeights, Texturing, ViewGeometry,
    WaitPolicy,
};
use image::RgbImage;
use serde::Serialize;
use std::time::Instant;

/// Results of the leave-one-out test of an image set with depth.
#[derive(Clone, Debug, Serialize)]
pub struct ImagesReport {
    /// Machine of the measurement.
    pub machine: Machine,
    /// Commit of the program, see [`commit`].
    pub commit: String,
    /// Interval of the left-out views.
    pub hold_out: usize,
    /// Rows for each view and variant.
    pub rows: Vec<HeldOutRow>,
    /// Rows for each view and each set of ranking weights (E6), compared at pixels that all of them
    /// cover.
    pub weights: Vec<HeldOutRow>,
}

/// A photograph and its frames for visual comparison.
pub struct SideBySide {
    /// Name of the view.
    pub view: String,
    /// The photograph.
    pub photograph: RgbImage,
    /// Frames of each of the [`variants`]; holes are magenta.
    pub frames: Vec<RgbImage>,
}

/// Compared ranking weights of distance, angle and visibility (C26: the paper names none), with the
/// default texturing.
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

/// Cubes: from the nearest view, from the [`NearestImages::COUNT`] nearest views, from all views.
const CUBES: [&str; 3] = ["nearest", "live-3", "ldi"];

/// Returns the names of the variants: cubes, and texturing variants of view-dependent geometry.
pub fn variants() -> impl Iterator<Item = &'static str> + Clone {
    CUBES.into_iter().chain(Texturing::ALL.map(Texturing::name))
}

/// Settings of view-dependent geometry.
pub struct Geometry {
    /// Settings of frames; the texturing variant is ignored.
    pub settings: GeometrySettings,
    /// Resources for opening the set.
    pub resources: GeometryResources,
}

/// Measures a set; `show` receives every view's frames. With `hold_out` 1 the views are left out
/// one at a time, otherwise every `hold_out`-th view at once.
///
/// # Errors
/// See [`HoldOutError`].
pub fn measure(
    set: &ImageSet,
    job: &ImageSetCapture,
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
    let mut test = HoldOutTest {
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
        test.geometry.leave_out(left_out);
        let others: Vec<&View> = (0..views.len())
            .filter(|i| !left_out.contains(i))
            .map(|i| views[i])
            .collect();
        let all = test.cube(job.centre, &others)?;
        let others = ImageSet {
            views: others.into_iter().cloned().collect(),
            ..set.clone()
        };
        let mut near = NearestImages::new(others, job.clone(), NearestImages::DEFAULT_BUDGET)?;
        for &i in left_out {
            test.measure_view(i, &mut near, &all, show)?;
        }
    }
    Ok(ImagesReport {
        machine: Machine::here(),
        commit: commit(),
        hold_out,
        rows: test.rows,
        weights: test.weights,
    })
}

/// State of a leave-one-out test.
struct HoldOutTest<'a> {
    set: &'a ImageSet,
    job: &'a ImageSetCapture,
    views: &'a [&'a View],
    progress: &'a dyn Progress,
    renderer: Renderer,
    geometry: ViewGeometry,
    geometry_ms: f64,
    settings: GeometrySettings,
    geometry_renderer: GeometryRenderer,
    rows: Vec<HeldOutRow>,
    weights: Vec<HeldOutRow>,
}

/// A cube of an image set with its times.
struct SetCube {
    cube: CubeLdi,
    /// Time to build it from files, ms.
    build_ms: f64,
    /// Time to rebuild it from images in memory, ms; NaN if not measured.
    rebuild_ms: f64,
}

impl HoldOutTest<'_> {
    fn cube(&self, centre: DVec3, views: &[&View]) -> Result<SetCube, HoldOutError> {
        let started = Instant::now();
        let job = ImageSetCapture {
            centre,
            ..self.job.clone()
        };
        let samples = job.run(self.set, views, self.progress)?;
        let cube = CubeLdi::pack(&samples, SplatIndexLayout::Normal, Split::Auto)?;
        Ok(SetCube {
            cube,
            build_ms: started.elapsed().as_secs_f64() * 1e3,
            rebuild_ms: f64::NAN,
        })
    }

    /// Builds the cube of the `chosen` views from files, and again from memory.
    fn near_cube(
        &self,
        near: &mut NearestImages,
        chosen: &[usize],
    ) -> Result<SetCube, HoldOutError> {
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

    /// Renders and compares view `i`.
    fn measure_view(
        &mut self,
        i: usize,
        near: &mut NearestImages,
        all: &SetCube,
        show: &mut dyn FnMut(SideBySide),
    ) -> Result<(), HoldOutError> {
        let view = self.views[i];
        let exposure = view
            .registration
            .map_or(Exposure::EVEN, |registration| registration.exposure);
        // The photograph keeps its exposure, which the frames are given.
        let registration = view.registration.map(|registration| Registration {
            exposure: Exposure::EVEN,
            ..registration
        });
        let held = View {
            registration,
            ..view.clone()
        }
        .load()?;
        let Some(camera) = pinhole_camera(&held) else {
            return Ok(());
        };
        let (photograph, visible) = reproject(&held, &camera);
        let chosen = near.nearest(&camera, NearestImages::COUNT);
        let nearest = self.near_cube(near, &chosen[..1])?;
        let few = self.near_cube(near, &chosen)?;
        let mut frames = Vec::new();
        for cube in [&nearest, &few, all] {
            frames.push(self.draw_cube(cube, &camera, exposure));
        }
        for texturing in Texturing::ALL {
            let settings = GeometrySettings {
                texturing,
                ..self.settings
            };
            frames.push(self.draw_geometry(settings, &camera, exposure));
        }
        let weighted = WEIGHTS.map(|(_, [distance, angle, visibility])| {
            let weights = RankWeights {
                distance,
                angle,
                visibility,
            };
            let settings = GeometrySettings {
                weights,
                ..self.settings
            };
            self.draw_geometry(settings, &camera, exposure)
        });
        let edges = near_edges(&held, &camera);
        let scene = self.set.folder.display().to_string();
        let comparison = |frames: &[HeldOutFrame]| {
            HeldOutComparison::covered_by_all(
                &scene,
                &view.name,
                &photograph,
                &visible,
                &edges,
                frames,
            )
        };
        self.rows
            .extend(comparison(&frames).rows(variants(), &frames));
        let names = WEIGHTS.map(|(name, _)| name);
        self.weights
            .extend(comparison(&weighted).rows(names, &weighted));
        show(SideBySide {
            view: view.name.clone(),
            photograph,
            frames: frames.into_iter().map(|frame| frame.picture).collect(),
        });
        Ok(())
    }

    /// Draws a cube.
    fn draw_cube(&mut self, built: &SetCube, camera: &Camera, exposure: Exposure) -> HeldOutFrame {
        let cube = &built.cube;
        let settings = RenderSettings {
            hole_color_srgb: HOLE,
            keep_holes: true,
            ..RenderSettings::default()
        };
        self.renderer.render(cube, camera, &settings);
        self.renderer.render(cube, camera, &settings);
        let (frame, stats) = self.renderer.render_with_stats(cube, camera, &settings);
        let hole = Some(HOLE);
        HeldOutFrame {
            rebuild_ms: built.rebuild_ms,
            ..HeldOutFrame::new(
                frame,
                exposure,
                hole,
                stats.frame_ms,
                built.build_ms,
                cube.bytes(),
            )
        }
    }

    /// Draws view-dependent geometry.
    fn draw_geometry(
        &mut self,
        settings: GeometrySettings,
        camera: &Camera,
        exposure: Exposure,
    ) -> HeldOutFrame {
        self.geometry_renderer
            .render(&self.geometry, camera, &settings, WaitPolicy::Wait);
        let (frame, stats) =
            self.geometry_renderer
                .render(&self.geometry, camera, &settings, WaitPolicy::Wait);
        HeldOutFrame::new(
            frame,
            exposure,
            Some(HOLE),
            stats.frame_ms,
            self.geometry_ms,
            self.geometry.bytes(),
        )
    }
}

/// Returns a mask of the pixels near a depth edge of the view.
fn near_edges(view: &LoadedView, camera: &Camera) -> Vec<bool> {
    /// Relative difference of depths between neighbours of different surfaces.
    const EDGE: f32 = 0.1;
    /// Distance from an edge that counts as near, px.
    const NEAR_PX: usize = 6;
    let [width, height] = view.size_px.map(|side| side as usize);
    let depth = |x: usize, y: usize| view.depth.get(y * width + x).copied().unwrap_or(f32::NAN);
    let is_edge = |a: f32, b: f32| (a - b).abs() > EDGE * a.min(b);
    let mut near = vec![false; camera.width() as usize * camera.height() as usize];
    for (x, y) in (0..height.saturating_sub(1))
        .flat_map(|y| (0..width.saturating_sub(1)).map(move |x| (x, y)))
    {
        let here = depth(x, y);
        if !(is_edge(here, depth(x + 1, y)) || is_edge(here, depth(x, y + 1))) {
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
    /// Formats a summary with tables.
    pub fn summary(&self) -> String {
        let rows = |variant: &str| VariantRows::new(&self.rows, variant);
        let header = [
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
        let mut table = Table::new(header);
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
             photographs where all ways show something.\nCompared with the nearest image alone, the LDI of the {} nearest is {}, \
             that of all images {}; it covers {} of the photograph instead of {}.\n{}\nCommit {}, {}, {} threads, {}.\n\n{table}\n\
             Mean absolute differences over that of the nearest picture as it is:\n\n{}\nWeights of distance, angle and visibility by \
             which cameras are ranked ({}), judged where all of them show something:\n\n{}",
            ldi.count(),
            self.hold_out,
            NearestImages::COUNT,
            better_or_worse(live.psnr_db() - nearest.psnr_db()),
            better_or_worse(ldi.psnr_db() - nearest.psnr_db()),
            percent(ldi.mean(|row| row.covered)),
            percent(nearest.mean(|row| row.covered)),
            sheets_sentence(),
            self.commit,
            self.machine.processor,
            self.machine.threads,
            self.machine.simd,
            self.paper_table(),
            Texturing::default().name(),
            self.weights_table(),
        )
    }

    /// Formats the errors of the texturing variants relative to the nearest image, and the paper's.
    fn paper_table(&self) -> Table {
        let mut table = Table::new([
            "variant",
            "in the picture",
            "at edges",
            "in the paper, at its gate",
        ]);
        let rows = |texturing: Texturing| VariantRows::new(&self.rows, texturing.name());
        let [(nearest, paper), ..] = IN_PAPER;
        let relative = |texturing: Texturing, mad: fn(&HeldOutRow) -> f64| {
            rows(texturing).mean(mad) / rows(nearest).mean(mad)
        };
        for (texturing, mad) in IN_PAPER {
            table.row([
                texturing.name().into(),
                format!("{:.3}", relative(texturing, |row| row.mad)),
                format!("{:.3}", relative(texturing, |row| row.mad_at_edges)),
                format!("{:.3}", mad / paper),
            ]);
        }
        table
    }

    fn weights_table(&self) -> Table {
        let mut table = Table::new(["weights", "PSNR dB", "FLIP", "MAD", "covered"]);
        for (name, _) in WEIGHTS {
            let rows = VariantRows::new(&self.weights, name);
            table.row([&[name.into()][..], &rows.errors()].concat());
        }
        table
    }
}
/// Describes a difference in PSNR, dB.
fn better_or_worse(difference_db: f64) -> String {
    let which = if difference_db < 0.0 {
        "worse"
    } else {
        "better"
    };
    format!("{:.2} dB {which}", difference_db.abs())
}
