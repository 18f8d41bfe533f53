//! Sprites with depth, alone or among cube LDIs and models, as a [`View`].

use crate::compose::{ComposeSettings, ComposeStats, Composer, Composition};
use crate::{RenderOptions, SpritePlane, SpriteSampling, SpriteSet, SpriteVariant};
use glam::DVec3;
use headbox_core::file_frame::FileFrame;
use headbox_core::frame::Frame;
use headbox_core::view::paint::{expose, figure, hole_legend, paint_holes};
use headbox_core::view::{
    EXPOSURE, FrameReport, FrameRequest, Navigation, OVERLAY, RENDERING, Rendered, Setting,
    SettingValues, Stage, StartView, Statistics, View,
};
use headbox_cube::render::RenderSettings;
use headbox_cube::render::footprint::splat::SplatKernel;
use headbox_cube::view::CubeView;
use serde_json::json;
use std::time::Instant;

/// Name of the representation.
pub const KIND: &str = "sprites";

/// Maximum number of gap-filling steps.
const MAX_FILL_STEPS: u32 = 64;

/// Smallest orbit radius as a share of the distance between the pivot and the first eye position.
const NEAREST_SHARE: f64 = 0.1;

/// Overlays, the default first.
const OVERLAYS: [&str; 2] = ["none", "holes"];

/// Variant names of the papers, each with ours.
const ALIASES: [(&str, &str); 4] = [
    ("crude", "one-pass"),
    ("field", "shift-field"),
    ("affine", "affine-parallax"),
    ("forward", "forward-color"),
];

/// Texture filters, the default first.
const SAMPLINGS: [(&str, SpriteSampling); 2] = [
    ("bilinear", SpriteSampling::Bilinear),
    ("nearest", SpriteSampling::Nearest),
];

/// Initial view of a [`LayersView`], and axes and unit of the cameras that it exports.
#[derive(Clone, Copy, Debug)]
pub struct LayersStart {
    /// Initial view.
    pub view: StartView,
    /// Default frame size, pixels.
    pub size_px: [u32; 2],
    /// Axes and unit.
    pub file_frame: FileFrame,
}

/// View of sprites, cube LDIs and polygon models in one world, composited in one frame.
pub struct LayersView {
    layers: Composition,
    start: LayersStart,
    /// Pivot of the orbit, world metres; `None` unless all layers come from one sprite file.
    pivot: Option<DVec3>,
    composer: Composer,
    frame: Frame,
    painted: Frame,
    stats: ComposeStats,
    options: RenderOptions,
}

impl LayersView {
    /// Creates the view of a sprite file; `None` if it has no sprites.
    pub fn from_sprites(set: SpriteSet) -> Option<Self> {
        let start = Self::start_of_sprites(&set)?;
        let pivot = start.view.eye + start.view.forward * middle_depth(&set)?;
        let layers = Composition::new(set, Vec::new());
        Some(Self {
            pivot: Some(pivot),
            ..Self::from_layers(layers, start)
        })
    }

    /// Creates the view of layers of any kind.
    pub fn from_layers(layers: Composition, start: LayersStart) -> Self {
        Self {
            layers,
            start,
            pivot: None,
            composer: Composer::default(),
            frame: Frame::default(),
            painted: Frame::default(),
            stats: ComposeStats::default(),
            options: RenderOptions::default(),
        }
    }

    /// The layers.
    pub fn layers(&self) -> &Composition {
        &self.layers
    }

    /// Returns the initial view: the first sprite's camera; `None` without sprites.
    pub fn start_of_sprites(set: &SpriteSet) -> Option<LayersStart> {
        let camera = set.sprites().first()?.sprite().sprite().camera();
        Some(LayersStart {
            view: StartView::from_camera(camera),
            size_px: [camera.width(), camera.height()],
            file_frame: set.info.frame,
        })
    }

    /// Settings of sprites without other layers.
    pub fn sprite_settings() -> Vec<Setting> {
        let selected = SpriteVariant::ALL
            .iter()
            .position(|variant| *variant == SpriteVariant::default())
            .unwrap_or(0);
        vec![
            Setting::choice_at(
                "variant",
                "Variant",
                "Method of drawing parallax inside a sprite: two passes, which the papers recommend, or a \
                 baseline for comparison (no unit).",
                &SpriteVariant::ALL.map(SpriteVariant::name),
                selected,
            )
            .with_flag("variant")
            .with_aliases(&ALIASES)
            .folded_under(RENDERING),
            Setting::choice(
                "sampling",
                "Sampling",
                "Texture filter: bilinear, or the nearest texel (no unit).",
                &SAMPLINGS.map(|(name, _)| name),
            )
            .with_flag("sampling")
            .folded_under(RENDERING),
            Setting::count(
                "fill",
                "Gap filling",
                "Number of steps, one cell each, that fill gaps inside sprites; 0 leaves them open (a number of cells).",
                RenderOptions::default().fill_steps,
                0..=MAX_FILL_STEPS,
            )
            .with_flag("fill-steps")
            .folded_under(RENDERING),
            overlay_setting(),
            Setting::exposure(),
        ]
    }

    /// Settings of several layers, in addition to those of each kind.
    pub fn layer_settings() -> Vec<Setting> {
        let by_depth = Setting::toggle(
            "by-depth",
            "By depth",
            "Composes layers pixel by pixel, by depth, instead of back to front: slower, but correct where layers \
             intersect. Models are always composed by depth.",
            false,
        );
        let by_depth = by_depth.with_flag("by-depth").folded_under(RENDERING);
        vec![by_depth, overlay_setting()]
    }
}

fn overlay_setting() -> Setting {
    Setting::choice(
        OVERLAY,
        "Overlay",
        "Content of the image: the frame, or the frame with uncovered pixels in magenta.",
        &OVERLAYS,
    )
    .with_flag(OVERLAY)
}

/// Returns the median eye depth of the sprites' planes at the centre of the first sprite's image,
/// metres: an orbit about that depth shows parallax in both directions. 1 m if no plane is there;
/// `None` without sprites.
fn middle_depth(set: &SpriteSet) -> Option<f64> {
    let camera = set.sprites().first()?.sprite().sprite().camera();
    let [x, y] = [camera.width(), camera.height()].map(|size| f64::from(size) / 2.0);
    let depth = |plane: &SpritePlane| 1.0 / plane.inverse_depth(camera, x, y);
    let sprites = set.sprites().iter();
    let mut depths: Vec<f64> = sprites
        .map(|sprite| depth(sprite.sprite().sprite().plane()))
        .filter(|depth| *depth > 0.0 && depth.is_finite())
        .collect();
    depths.sort_by(f64::total_cmp);
    Some(depths.get(depths.len() / 2).copied().unwrap_or(1.0))
}

impl LayersView {
    fn has_sprites(&self) -> bool {
        !self.layers.sprites().sprites().is_empty()
    }

    fn compose_settings(&self, request: &FrameRequest) -> Result<ComposeSettings, String> {
        let values = &request.settings;
        let mut settings = ComposeSettings::default();
        if self.has_sprites() {
            settings.sprites = sprite_options(values)?;
        }
        if !self.layers.cubes().is_empty() {
            settings.cubes = RenderSettings {
                kernel: SplatKernel::ALL
                    .get(values.choice("kernel")?)
                    .copied()
                    .unwrap_or_default(),
                keep_holes: values.toggle("keep-holes")?,
                ..settings.cubes
            };
        }
        if self.pivot.is_none() {
            settings.by_depth = values.toggle("by-depth")?;
        }
        Ok(settings)
    }
}

fn sprite_options(values: &SettingValues) -> Result<RenderOptions, String> {
    Ok(RenderOptions {
        variant: SpriteVariant::ALL
            .get(values.choice("variant")?)
            .copied()
            .unwrap_or_default(),
        sampling: SAMPLINGS
            .get(values.choice("sampling")?)
            .map_or(SpriteSampling::default(), |(_, sampling)| *sampling),
        fill_steps: values.number("fill")? as u32,
    })
}

impl View for LayersView {
    fn kind(&self) -> &'static str {
        if self.pivot.is_some() { KIND } else { "layers" }
    }

    fn start(&self, _: [u32; 2]) -> StartView {
        self.start.view
    }

    fn default_size_px(&self) -> [u32; 2] {
        self.start.size_px
    }

    fn navigation(&self) -> Navigation {
        self.pivot
            .map_or(Navigation::Fly, |pivot| Navigation::Orbit {
                pivot,
                nearest: pivot.distance(self.start.view.eye) * NEAREST_SHARE,
            })
    }

    fn speed_m_per_s(&self) -> f64 {
        self.pivot
            .map_or(1.4, |pivot| pivot.distance(self.start.view.eye) / 2.0)
    }

    fn file_frame(&self) -> FileFrame {
        self.start.file_frame
    }

    fn primitives(&self) -> (u64, &'static str) {
        let sprites = self.layers.sprites().sprites().len() as u64;
        if self.pivot.is_some() {
            return (sprites, "sprites");
        }
        let others = self.layers.cubes().len() + self.layers.polygons().len();
        (sprites + others as u64, "layers")
    }

    fn bytes(&self) -> u64 {
        let cubes = self.layers.cubes().iter();
        self.layers.sprites().bytes() + cubes.map(|cube| cube.bytes() as u64).sum::<u64>()
    }

    fn settings(&self) -> Vec<Setting> {
        if self.pivot.is_some() {
            return Self::sprite_settings();
        }
        let mut settings = Vec::new();
        if self.has_sprites() {
            settings = Self::sprite_settings();
            // Layers of several files may have different tone curves.
            settings.retain(|setting| ![OVERLAY, EXPOSURE].contains(&setting.id));
        }
        if !self.layers.cubes().is_empty() {
            let mut cube_settings = CubeView::setting_table();
            cube_settings.retain(|setting| ["kernel", "keep-holes"].contains(&setting.id));
            settings.extend(cube_settings);
        }
        settings.extend(Self::layer_settings());
        settings
    }

    fn render(&mut self, request: &FrameRequest) -> Result<Rendered<'_>, String> {
        let settings = self.compose_settings(request)?;
        let started = Instant::now();
        self.stats = self.layers.render(
            &mut self.composer,
            &request.camera,
            &settings,
            &mut self.frame,
        );
        let ms = started.elapsed().as_secs_f64() * 1e3;
        self.options = settings.sprites;
        let stats = &self.stats;
        let pixels = self.frame.color.len().max(1) as f64;
        let stages = [
            ("sprites", stats.sprites_ms),
            ("cubes", stats.cubes_ms),
            ("polygons", stats.polygons_ms),
            ("compose", stats.compose_ms),
        ];
        let (count, what) = self.primitives();
        let covered = (1.0 - stats.hole_pixels as f64 / pixels) * 100.0;
        let mut report = FrameReport {
            stages: stages.map(|(name, ms)| Stage { name, ms }).to_vec(),
            ms,
            hole_pixels: stats.hole_pixels,
            figures: vec![
                figure(what, count as f64, ""),
                figure("pixels covered", covered, "%"),
            ],
            ..FrameReport::default()
        };
        if !self.layers.cubes().is_empty() {
            report.figures.extend([
                figure("depth pixels in", stats.depth_pixels_in as f64, ""),
                figure("splatted", stats.splatted as f64, ""),
            ]);
        }
        let mut frame = &self.frame;
        if OVERLAYS.get(request.settings.choice(OVERLAY)?) == Some(&"holes") {
            self.painted.clone_from(&self.frame);
            paint_holes(&self.frame, &mut self.painted.color);
            report.legend = hole_legend();
            frame = &self.painted;
        } else if self.pivot.is_some() {
            let stops = request.settings.number(EXPOSURE)?;
            if stops != 0.0 {
                self.painted.clone_from(&self.frame);
                let tone = self.layers.sprites().info.light.tone;
                expose(&mut self.painted.color, tone, stops);
                frame = &self.painted;
            }
        }
        Ok(Rendered { frame, report })
    }

    fn statistics(&mut self, _: &FrameRequest) -> Statistics {
        json!({
            "outcomes": self.stats.outcomes, "order": self.stats.order, "sprites": self.options,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn aliases_are_those_of_the_variants() {
        for (alias, name) in ALIASES {
            let variant = SpriteVariant::from_name(alias).map(SpriteVariant::name);
            assert_eq!(variant, Some(name), "{alias}");
        }
    }
}
