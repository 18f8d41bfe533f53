//! Sprites with depth in the window: tilted by orbiting.

use crate::overlays::overlay::{Overlay, paint_holes};
use glam::DVec3;
use headbox_core::file_frame::FileFrame;
use headbox_core::frame::Frame;
use headbox_sprite::compose::{ComposeSettings, Composer, Composition};
use headbox_sprite::{RenderOptions, SpriteSampling, SpriteSet, SpriteVariant};
use headbox_viewer::{
    Figure, FrameReport, FrameRequest, FrameSource, Navigation, Pose, Setting, SettingValues, Stage,
};
use std::path::Path;

/// Most steps of gap filling on offer.
const MAX_FILL_STEPS: u32 = 8;

/// Overlays of sprites.
const OVERLAYS: [(&str, Overlay); 2] = [("none", Overlay::None), ("holes", Overlay::Holes)];

/// The orbit comes as near to its pivot as this share of the distance of the camera that took the
/// picture.
const NEAREST_SHARE: f64 = 0.1;

/// All sprites of a file, drawn over each other.
pub(super) struct SpriteSource {
    title: String,
    layers: Composition,
    start: Pose,
    pivot: DVec3,
    composer: Composer,
    frame: Frame,
}

impl SpriteSource {
    /// `None` if the set is empty: there is nothing to look at.
    pub(super) fn new(set: SpriteSet, file: &Path) -> Option<Self> {
        let first = set.sprites().first()?.sprite().sprite();
        let camera = first.camera();
        let fov_y_deg = 2.0
            * (f64::from(camera.height()) / 2.0 / camera.focal_px())
                .atan()
                .to_degrees();
        // The middle of the sprites in depth: there parallax goes both ways.
        let middle = [
            f64::from(camera.width()) / 2.0,
            f64::from(camera.height()) / 2.0,
        ];
        let depth = |plane: &headbox_sprite::SpritePlane| {
            1.0 / plane.inverse_depth(camera, middle[0], middle[1])
        };
        let mut depths: Vec<f64> = set
            .sprites()
            .iter()
            .map(|s| depth(s.sprite().sprite().plane()))
            .collect();
        depths.retain(|depth| *depth > 0.0 && depth.is_finite());
        depths.sort_by(f64::total_cmp);
        let distance = depths.get(depths.len() / 2).copied().unwrap_or(1.0);
        let pivot = camera.eye() + camera.forward() * distance;
        let start = Pose::looking_at(camera.eye(), pivot, fov_y_deg);
        let title = format!("{} (sprites)", crate::file_name::file_name(file));
        let layers = Composition::new(set, Vec::new());
        Some(Self {
            title,
            start,
            pivot,
            layers,
            composer: Composer::default(),
            frame: Frame::default(),
        })
    }
}

fn options(values: &SettingValues) -> Result<RenderOptions, String> {
    let variant = SpriteVariant::ALL
        .get(values.choice("variant")?)
        .copied()
        .unwrap_or_default();
    let sampling = if values.toggle("nearest")? {
        SpriteSampling::Nearest
    } else {
        SpriteSampling::default()
    };
    Ok(RenderOptions {
        variant,
        sampling,
        fill_steps: values.number("fill")? as u32,
    })
}

impl FrameSource for SpriteSource {
    fn title(&self) -> String {
        self.title.clone()
    }

    fn start_pose(&self) -> Pose {
        self.start
    }

    fn navigation(&self) -> Navigation {
        Navigation::Orbit {
            pivot: self.pivot,
            nearest: self.pivot.distance(self.start.eye) * NEAREST_SHARE,
        }
    }

    fn speed_m_per_s(&self) -> f64 {
        self.pivot.distance(self.start.eye) / 2.0
    }

    fn file_frame(&self) -> FileFrame {
        self.layers.sprites().info.frame
    }

    fn settings(&self) -> Vec<Setting> {
        let names = SpriteVariant::ALL.map(SpriteVariant::name);
        let chosen = SpriteVariant::ALL
            .iter()
            .position(|v| *v == SpriteVariant::default())
            .unwrap_or(0);
        let tip = "How parallax inside a sprite is drawn: two passes are the papers' recommendation, the others what it is \
                   measured against (no unit).";
        let options = names.map(str::to_owned).to_vec();
        let control = headbox_viewer::Control::Choice {
            options,
            selected: chosen,
        };
        let fill = RenderOptions::default().fill_steps;
        vec![
            Setting::new("variant", "Variant", tip, control),
            Setting::toggle(
                "nearest",
                "Nearest texel",
                "Takes the nearest texel instead of four (bilinear).",
                false,
            ),
            Setting::count(
                "fill",
                "Gap filling",
                "Cells by which gaps after the first pass are filled; 0 leaves them open (a number of cells).",
                fill,
                0..=MAX_FILL_STEPS,
            ),
            Setting::choice(
                "overlay",
                "Overlay",
                "What is painted: the frame, or where no sprite is, in magenta.",
                &OVERLAYS.map(|(name, _)| name),
            ),
        ]
    }

    fn render(
        &mut self,
        request: &FrameRequest,
        pixels: &mut [[u8; 4]],
    ) -> Result<FrameReport, String> {
        let settings = ComposeSettings {
            sprites: options(&request.settings)?,
            ..ComposeSettings::default()
        };
        let stats = self.layers.render(
            &mut self.composer,
            &request.camera,
            &settings,
            &mut self.frame,
        );
        let (_, overlay) = OVERLAYS
            .get(request.settings.choice("overlay")?)
            .unwrap_or(&OVERLAYS[0]);
        match overlay {
            Overlay::Holes => paint_holes(&self.frame, pixels),
            _ => pixels.copy_from_slice(&self.frame.color),
        }
        let share = 1.0 - stats.hole_pixels as f64 / pixels.len().max(1) as f64;
        Ok(FrameReport {
            stages: vec![
                Stage {
                    name: "sprites",
                    ms: stats.sprites_ms,
                },
                Stage {
                    name: "compose",
                    ms: stats.compose_ms,
                },
            ],
            figures: vec![
                Figure {
                    name: "number of sprites",
                    value: self.layers.sprites().sprites().len() as f64,
                    unit: "",
                },
                Figure {
                    name: "pixels covered",
                    value: share * 100.0,
                    unit: "%",
                },
            ],
            facts: vec![crate::facts::simd_fact()],
            legend: overlay.legend(),
            ..FrameReport::default()
        })
    }
}
