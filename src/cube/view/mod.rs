//! A cube LDI as a [`View`]: settings, overlays and statistics.
//!
//! | file | content |
//! |---|---|
//! | `overlay` | overlays: false colours instead of a frame's colours |
//! | `effort` | overlays of rendering effort: footprints, overdraw, clipping |
//! | `variation` | parts of the LDI, or recoloured by depth, layer, face, segment, primitive |

mod effort;
mod overlay;
#[cfg(test)]
mod tests;
mod variation;

use self::overlay::{Overlay, paint_coverage, paint_epipole};
use self::variation::{FACE_NAMES, Variation, Variations};
use crate::pack::CubeLdi;
use crate::render::footprint::splat::SplatKernel;
use crate::render::{FrameStats, RenderSettings, Renderer};
use glam::DVec3;
use headbox_core::cube_face::Face;
use headbox_core::file_frame::FileFrame;
use headbox_core::frame::Frame;
use headbox_core::headbox::Headbox;
use headbox_core::view::paint::{expose, figure, paint_holes};
use headbox_core::view::{
    EXPOSURE, Figure, FrameReport, FrameRequest, OVERLAY, Origin, RENDERING, Rendered, Setting,
    SettingValues, Stage, StartView, Statistics, View, level_up,
};
use serde_json::json;
use std::sync::Arc;

/// Name of the representation.
pub const KIND: &str = "cube LDI";

/// A cube LDI with its renderer.
pub struct CubeView {
    cube: Arc<CubeLdi>,
    variations: Variations,
    renderer: Renderer,
    /// The last frame, if it differs from the renderer's: with an overlay or another exposure.
    painted: Frame,
    stats: FrameStats,
}

impl CubeView {
    /// Creates a view of `cube`.
    pub fn new(cube: impl Into<Arc<CubeLdi>>) -> Self {
        Self {
            cube: cube.into(),
            variations: Variations::default(),
            renderer: Renderer::new(),
            painted: Frame::default(),
            stats: FrameStats::default(),
        }
    }

    /// The cube.
    pub fn cube(&self) -> &Arc<CubeLdi> {
        &self.cube
    }

    /// Replaces the cube.
    pub fn show(&mut self, cube: Arc<CubeLdi>) {
        self.cube = cube;
        self.variations.clear();
    }

    /// Returns the number of overlays in [`Self::setting_table`], for views that add their own.
    pub fn overlay_count(&self) -> usize {
        Overlay::ALL.len()
    }

    /// Returns the settings of cube LDIs.
    pub fn setting_table() -> Vec<Setting> {
        let overlays = Overlay::ALL.map(|(name, _)| name);
        let mut settings = vec![
            Setting::choice(
                "kernel",
                "Footprints",
                "Footprint kernel that draws samples as pixels (no unit).",
                &SplatKernel::ALL.map(SplatKernel::name),
            )
            .with_flag("variant")
            .folded_under(RENDERING),
            Setting::choice(
                OVERLAY,
                "Overlay",
                "Content of the image: the frame; its holes in magenta; the coverage of each pixel by splats \
                 (black 0 to white 1); depth pixels coloured by distance from the centre of the headbox (red \
                 near, blue far), layer (orange first), face, near and far segment, or primitive; the width of \
                 the nearest footprint (px); the overdraw of each pixel (a count); the samples that clipping \
                 removes, on the unfolded faces.",
                &overlays,
            )
            .with_flag(OVERLAY),
            Setting::toggle(
                "clip",
                "Clipping",
                "Leaves out what is known to be outside the view; without it every depth pixel is warped, for the same frame.",
                true,
            )
            .folded_under(RENDERING),
            Setting::toggle(
                "keep-holes",
                "Keep holes",
                "Leaves small holes open instead of filling them from the background around them.",
                false,
            )
            .with_flag("keep-holes")
            .folded_under(RENDERING),
            Setting::exposure(),
            Setting::toggle(
                "epipole",
                "Epipole",
                "Marks where the centre of the headbox projects to: a cross ahead of the eye, a ring behind it.",
                false,
            )
            .folded_under(RENDERING),
        ];
        let part = |id, label: &str| {
            Setting::toggle(
                id,
                label,
                "Draws this part of the LDI; holes show where nothing else is.",
                true,
            )
            .folded_under("Parts")
        };
        settings.extend(FACE_NAMES.map(|(id, name)| part(id, &format!("Face {name}"))));
        settings.extend([
            part("near", "Near segments"),
            part("far", "Far segments"),
            part("planes", "Pictures on planes"),
        ]);
        settings
    }

    /// Returns the default view of a cube LDI: from the centre, in the direction of its header, or
    /// toward the side with the most depth pixels.
    pub fn default_view(cube: &CubeLdi) -> StartView {
        StartView {
            eye: cube.info.centre,
            forward: cube.info.ahead.unwrap_or_else(|| richest_side(cube)),
            up: level_up(cube.info.up),
            fov_y_deg: cube.info.fov_y_deg.unwrap_or(60.0),
        }
    }
}

/// Returns the horizontal direction toward the face with the most depth pixels; -Z if there are
/// none.
fn richest_side(cube: &CubeLdi) -> DVec3 {
    let depth_pixels = |side: Face| -> usize {
        let segments = cube.segments.iter().filter(|s| s.face == side);
        segments.map(|s| s.depth_pixels.len()).sum()
    };
    let sides = [Face::PosX, Face::NegX, Face::PosZ, Face::NegZ];
    sides
        .into_iter()
        .max_by_key(|&side| depth_pixels(side))
        .map_or(DVec3::NEG_Z, Face::normal)
}

fn render_settings(request: &FrameRequest) -> Result<RenderSettings, String> {
    let values = &request.settings;
    Ok(RenderSettings {
        kernel: SplatKernel::ALL
            .get(values.choice("kernel")?)
            .copied()
            .unwrap_or_default(),
        unclipped: !values.toggle("clip")?,
        keep_holes: values.toggle("keep-holes")?,
        depth: request.depth,
        ..RenderSettings::default()
    })
}

fn variation(values: &SettingValues, overlay: Overlay) -> Result<Variation, String> {
    let mut faces = [true; 6];
    for (shown, (id, _)) in faces.iter_mut().zip(FACE_NAMES) {
        *shown = values.toggle(id)?;
    }
    Ok(Variation {
        faces,
        near: values.toggle("near")?,
        far: values.toggle("far")?,
        planes: values.toggle("planes")?,
        meaning: overlay.meaning(),
    })
}

impl View for CubeView {
    fn kind(&self) -> &'static str {
        KIND
    }

    fn start(&self, _: [u32; 2]) -> StartView {
        Self::default_view(&self.cube)
    }

    fn headbox(&self) -> Option<Headbox> {
        Some(Headbox {
            centre: self.cube.info.centre,
            half_size_m: self.cube.info.half_size_m,
        })
    }

    fn file_frame(&self) -> FileFrame {
        self.cube.info.frame
    }

    fn origin(&self) -> Option<Origin> {
        let info = &self.cube.info;
        Some(Origin {
            scene: info.scene.clone(),
            frame: info.frame,
            light: info.light.clone(),
            headbox: self.headbox()?,
            lit: info.parameters.light_samples > 0,
        })
    }

    fn primitives(&self) -> (u64, &'static str) {
        (self.cube.depth_pixel_count() as u64, "depth pixels")
    }

    fn bytes(&self) -> u64 {
        self.cube.bytes() as u64
    }

    fn settings(&self) -> Vec<Setting> {
        Self::setting_table()
    }

    fn render(&mut self, request: &FrameRequest) -> Result<Rendered<'_>, String> {
        let settings = render_settings(request)?;
        let values = &request.settings;
        let overlay = Overlay::ALL
            .get(values.choice(OVERLAY)?)
            .map_or(Overlay::None, |&(_, overlay)| overlay);
        let (stops, epipole) = (values.number(EXPOSURE)?, values.toggle("epipole")?);
        let cube = self
            .variations
            .get(&self.cube, &variation(values, overlay)?);
        let (_, stats) = self
            .renderer
            .render_with_stats(&cube, &request.camera, &settings);
        self.stats = *stats;
        let mut report = report(&self.stats, &cube);
        report.legend = overlay.legend();
        let is_captured = matches!(overlay, Overlay::None | Overlay::Recolored(_));
        if is_captured && !epipole && stops == 0.0 {
            let frame = self.renderer.frame();
            return Ok(Rendered { frame, report });
        }
        self.painted.clone_from(self.renderer.frame());
        if stops != 0.0 {
            expose(&mut self.painted.color, self.cube.info.tone, stops);
        }
        // The figures of the overlay come first.
        let figures = self.paint(&cube, request, &settings, overlay);
        report.figures.splice(0..0, figures);
        if epipole {
            paint_epipole(&request.camera, cube.info.centre, &mut self.painted.color);
        }
        Ok(Rendered {
            frame: &self.painted,
            report,
        })
    }

    fn statistics(&mut self, request: &FrameRequest) -> Statistics {
        let clipping = render_settings(request)
            .map(|settings| Renderer::new().clip_counts(&self.cube, &request.camera, &settings));
        let mut statistics = json!(self.stats);
        statistics["clipping"] = json!(clipping.ok());
        statistics
    }

    fn level_radiance(&self) -> Option<[f32; 256]> {
        let info = &self.cube.info;
        Some(std::array::from_fn(|level| {
            info.tone.exposed(level as u8) / info.exposure
        }))
    }
}

impl CubeView {
    /// Paints an overlay onto the last frame, and returns its figures.
    fn paint(
        &mut self,
        cube: &CubeLdi,
        request: &FrameRequest,
        settings: &RenderSettings,
        overlay: Overlay,
    ) -> Vec<Figure> {
        let (renderer, camera) = (&mut self.renderer, &request.camera);
        let pixels = &mut self.painted.color;
        match overlay {
            Overlay::None | Overlay::Recolored(_) => {}
            Overlay::Holes => paint_holes(renderer.frame(), pixels),
            Overlay::Coverage => paint_coverage(renderer.frame(), pixels),
            Overlay::Footprints => {
                let overdraw = renderer.overdraw(cube, camera, settings);
                return effort::paint_footprints(&overdraw, pixels);
            }
            Overlay::Overdraw => {
                let overdraw = renderer.overdraw(cube, camera, settings);
                return effort::paint_overdraw(&overdraw, pixels);
            }
            Overlay::Clipping => {
                let clipped = renderer.clipped_segments(cube, camera, settings);
                return effort::paint_clipping(cube, &clipped, renderer.frame(), pixels);
            }
        }
        Vec::new()
    }
}

fn report(stats: &FrameStats, cube: &CubeLdi) -> FrameReport {
    let stages = [
        ("clear", stats.clear_ms),
        ("warp", stats.warp_ms),
        ("finish", stats.finish_ms),
    ];
    let count = |name, value: u64| figure(name, value as f64, "");
    let [to_1_px, to_3_px, to_5_px, above] = stats.by_footprint;
    FrameReport {
        stages: stages.map(|(name, ms)| Stage { name, ms }).to_vec(),
        ms: stats.frame_ms,
        hole_pixels: stats.hole_pixels,
        figures: vec![
            count("depth pixels", cube.depth_pixel_count() as u64),
            count("depth pixels in", stats.depth_pixels_in),
            count("splatted", stats.splatted),
            count("of about 1 px", to_1_px),
            count("of about 3 px", to_3_px),
            count("of about 5 px", to_5_px),
            count("of 7 px or more", above),
            count("hole pixels", stats.hole_pixels),
            figure("face size", cube.face_size_px.into(), "px"),
        ],
        ..FrameReport::default()
    }
}
