//! A folder of images with depth in the window: view-dependent geometry, made anew for each frame.

use crate::background::FewerThreads;
use crate::overlays::geometry_overlay::GeometryOverlay;
use headbox_core::camera::Camera;
use headbox_core::file_frame::FileFrame;
use headbox_photos::view_geometry::{
    GeometryRenderer, GeometrySettings, GeometryStats, Texturing, TimeBudget, ViewGeometry,
    WaitPolicy,
};
use headbox_viewer::{
    Control, Fact, Figure, FrameReport, FrameRequest, FrameSource, Pose, Refinement, Setting, Stage,
};
use std::time::Duration;

/// Interval between two polls of the decoding thread.
const LOOK_AGAIN: Duration = Duration::from_millis(60);

/// Time for a frame while the eye moves, if nothing else is asked for, ms: thirty a second.
const FRAME_MS: u32 = 33;

/// Images, walked through from camera to camera and between them.
pub(super) struct GeometrySource {
    title: String,
    geometry: ViewGeometry,
    renderer: GeometryRenderer,
    start: Pose,
    initial: GeometrySettings,
    threads: FewerThreads,
    budget: TimeBudget,
}

impl GeometrySource {
    pub(super) fn new(
        title: String,
        geometry: ViewGeometry,
        start: &Camera,
        initial: GeometrySettings,
    ) -> Self {
        let (start, renderer) = (crate::start_at(start), GeometryRenderer::new());
        Self {
            title,
            geometry,
            renderer,
            start,
            initial,
            threads: FewerThreads::default(),
            budget: TimeBudget::new(f64::from(FRAME_MS)),
        }
    }

    fn settings_of(&self, request: &FrameRequest) -> Result<GeometrySettings, String> {
        let (_, texturing) = Texturing::ALL
            .get(request.settings.choice("texturing")?)
            .copied()
            .unwrap_or(Texturing::ALL[0]);
        Ok(GeometrySettings {
            texturing,
            cameras: request.settings.number("cameras")? as usize,
            grid_px: request.settings.number("grid")? as f32,
            hole_color_srgb: [0; 3],
            ..self.initial
        })
    }
}

impl FrameSource for GeometrySource {
    fn title(&self) -> String {
        self.title.clone()
    }

    fn start_pose(&self) -> Pose {
        self.start
    }

    fn file_frame(&self) -> FileFrame {
        self.geometry.frame
    }

    fn settings(&self) -> Vec<Setting> {
        let options = Texturing::ALL.map(|(name, _)| name.to_owned()).to_vec();
        let selected = Texturing::ALL
            .iter()
            .position(|(_, texturing)| *texturing == self.initial.texturing)
            .unwrap_or(0);
        vec![
            Setting::new(
                "texturing",
                "Texturing",
                "Whose picture colours the mesh: the nearest as it is, the best alone, the best of each triangle's corners, these \
                 blended, or the mean of the best that see a point (no unit).",
                Control::Choice { options, selected },
            ),
            Setting::count(
                "cameras",
                "Cameras",
                "Cameras whose depth makes the mesh (no unit); fewer while the eye moves, if time is short.",
                self.initial.cameras as u32,
                1..=64,
            ),
            Setting::count(
                "grid",
                "Grid",
                "Pixels between the mesh's nodes; more while the eye moves, if time is short.",
                self.initial.grid_px as u32,
                1..=32,
            ),
            Setting::count(
                "budget",
                "Frame time",
                "Time for a frame while the eye moves, ms: cameras, grid and detail are chosen by it. All that is asked for is drawn once the eye \
                 stands still.",
                FRAME_MS,
                1..=1000,
            ),
            Setting::choice(
                "overlay",
                "Overlay",
                "What is painted: the frame, its holes in magenta, how many cameras see a place, its pixels by camera, by how many cameras own a triangle, the mesh, or \
                 how long pictures have been at hand.",
                &GeometryOverlay::ALL.map(|(name, _)| name),
            ),
            FewerThreads::setting(),
        ]
    }

    fn render(
        &mut self,
        request: &FrameRequest,
        pixels: &mut [[u8; 4]],
    ) -> Result<FrameReport, String> {
        let full = self.settings_of(request)?;
        self.budget.ms = request.settings.number("budget")?;
        let settings = if request.moving {
            self.budget.settings(&full)
        } else {
            full
        };
        let Self {
            geometry,
            renderer,
            threads,
            budget,
            ..
        } = self;
        let draw = || {
            renderer
                .render(geometry, &request.camera, &settings, WaitPolicy::Never)
                .1
        };
        let stats = threads.install(&request.settings, draw)?;
        if request.moving {
            budget.took(stats.frame_ms);
        }
        let (_, overlay) = GeometryOverlay::ALL
            .get(request.settings.choice("overlay")?)
            .copied()
            .unwrap_or(("none", GeometryOverlay::None));
        let legend = overlay.paint(geometry, renderer, pixels);
        let mut facts = vec![crate::facts::simd_fact()];
        if stats.cameras_valid == 0 {
            facts.push(Fact {
                name: "nothing",
                text: geometry.nothing_seen(),
            });
        }
        let told = [("lost", geometry.lost()), ("mended", geometry.mended())];
        facts.extend(told.into_iter().filter_map(|(name, why)| {
            Some(Fact {
                name,
                text: why.into_iter().next()?,
            })
        }));
        let refinement = match stats.pictures_missing {
            0 => Refinement::Done,
            _ => Refinement::Later(LOOK_AGAIN),
        };
        let mut figures = figures(&stats);
        figures.push(figure("grid", f64::from(settings.grid_px), "px"));
        figures.push(figure(
            "memory",
            geometry.bytes() as f64 / f64::from(1 << 20),
            "MiB",
        ));
        Ok(FrameReport {
            stages: stages(&stats),
            figures,
            facts,
            legend,
            refinement,
            ongoing: None,
        })
    }
}

fn stages(stats: &GeometryStats) -> Vec<Stage> {
    let stage = |name, ms| Stage { name, ms };
    vec![
        stage("rank", stats.rank_ms),
        stage("fuse", stats.fuse_ms),
        stage("mesh", stats.mesh_ms),
        stage("texture", stats.texture_ms),
    ]
}

fn figure(name: &'static str, value: f64, unit: &'static str) -> Figure {
    Figure { name, value, unit }
}

fn figures(stats: &GeometryStats) -> Vec<Figure> {
    vec![
        figure("cameras valid", stats.cameras_valid as f64, ""),
        figure("cameras used", stats.cameras_used as f64, ""),
        figure("pictures to come", stats.pictures_missing as f64, ""),
        figure("samples projected", stats.samples as f64, ""),
        figure("triangles drawn", stats.triangles as f64, ""),
        figure("hole pixels", stats.hole_pixels as f64, ""),
    ]
}
