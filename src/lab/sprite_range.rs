//! Range of each variant of sprite rendering: FLIP against truth over the eye's displacement.

use super::chart::{Axis, Chart, ChartPoint, Series};
use super::report::subject::ReportError;
use headbox_core::camera::Camera;
use headbox_core::frame::Frame;
use headbox_core::metrics;
use headbox_core::progress::Silent;
use headbox_sprite::compose::{ComposeSettings, Composer, Composition};
use headbox_sprite::{
    PreparedSprite, RenderOptions, SlabCapture, SpriteSet, SpriteTransfer, SpriteVariant,
};
use headbox_trace::truth;
use std::fmt::Write;

/// Increase of mean FLIP over that at the sprites' camera that a viewer notices: at this error the
/// ground that a sprite lacks beside and behind a bust is plain to see.
pub const VISIBLE: f64 = 0.03;

/// Displacements of the eye, in shares of the distance to the target.
const SHARES: [f64; 9] = [0.0, 0.025, 0.05, 0.1, 0.15, 0.2, 0.3, 0.4, 0.5];

/// Errors at one displacement of the eye.
#[derive(Clone, Debug, PartialEq)]
pub struct RangePlace {
    /// Distance of the eye from the sprites' camera, metres.
    pub displacement_m: f64,
    /// Largest displacement of a point relative to its sprite's plane, pixels of the sprites.
    pub parallax_px: f64,
    /// Share of the frame that the default variant does not cover.
    pub hole_share: f64,
    /// Mean FLIP of each variant, in the order of [`SpriteVariant::ALL`].
    pub flips: [f64; SpriteVariant::ALL.len()],
}

/// Errors of sprites over the displacement of the eye.
#[derive(Clone, Debug, PartialEq)]
pub struct SpriteRange {
    /// Errors by increasing displacement.
    pub places: Vec<RangePlace>,
}

impl SpriteRange {
    /// Draws `set`, captured by `reference`, in every variant while the eye moves to the right and
    /// a little up and looks at the same point, and compares with truth with the rays, light and
    /// size of the capture. `None` if no sprite's plane is straight ahead.
    ///
    /// # Errors
    /// [`ReportError::Camera`] and [`ReportError::Metric`] for numbers out of range.
    pub fn measure(
        capture: &SlabCapture,
        reference: &Camera,
        set: SpriteSet,
    ) -> Result<Option<Self>, ReportError> {
        let Some(distance) = distance_ahead(&set, reference) else {
            return Ok(None);
        };
        let look_at = reference.eye() + reference.forward() * distance;
        let [right, up] = [0, 1].map(|axis| reference.world_from_eye().col(axis));
        let (width, height) = (reference.width(), reference.height());
        let layers = Composition::new(set, Vec::new());
        let (mut composer, mut frame) = (Composer::default(), Frame::default());
        let mut places = Vec::new();
        for share in SHARES {
            let displacement_m = share * distance;
            let eye = reference.eye() + (right + up * 0.3) * displacement_m;
            let target = Camera::look_at(eye, look_at, up, reference.fov_y_deg(), [width, height])?;
            let SlabCapture {
                tracer,
                lighting,
                lit,
                samples,
                ..
            } = *capture;
            let truth = truth::render(tracer, lighting, lit, &target, samples, &Silent).rgb();
            let mut flips = [0.0; SpriteVariant::ALL.len()];
            let mut hole_share = 0.0;
            for (flip, variant) in flips.iter_mut().zip(SpriteVariant::ALL) {
                let sprites = RenderOptions {
                    variant,
                    ..RenderOptions::default()
                };
                let settings = ComposeSettings {
                    sprites,
                    ..ComposeSettings::default()
                };
                let stats = layers.render(&mut composer, &target, &settings, &mut frame);
                if variant == SpriteVariant::default() {
                    hole_share = stats.hole_pixels as f64 / frame.color.len().max(1) as f64;
                }
                *flip = metrics::compare(&truth, &frame.to_rgb()?)?.flip;
            }
            places.push(RangePlace {
                displacement_m,
                parallax_px: largest_parallax_px(layers.sprites(), &target),
                hole_share,
                flips,
            });
        }
        Ok(Some(Self { places }))
    }

    /// Formats the errors as comma-separated values with a header.
    pub fn to_csv(&self) -> String {
        let mut csv = String::from("displacement_m,parallax_px,hole_share");
        for variant in SpriteVariant::ALL {
            csv.push(',');
            csv += variant.name();
        }
        for place in &self.places {
            // Writing into a string does not fail.
            let _ = write!(
                csv,
                "\n{:.4},{:.2},{:.4}",
                place.displacement_m, place.parallax_px, place.hole_share
            );
            for flip in place.flips {
                let _ = write!(csv, ",{flip:.4}");
            }
        }
        csv + "\n"
    }

    /// Charts the errors, a line for each variant.
    pub fn chart(&self, name: &str) -> Chart {
        let series = SpriteVariant::ALL.iter().enumerate();
        let series = series.map(|(index, variant)| {
            let points = self.places.iter();
            let points =
                points.map(|place| ChartPoint::new([place.displacement_m, place.flips[index]]));
            Series::line(variant.name(), points.collect(), index)
        });
        Chart {
            title: format!("{name}: range of sprites with depth"),
            note: "The eye moves to the right and a little up from where the sprites were taken, and looks at the same point."
                .into(),
            x: Axis::linear("eye displacement, m"),
            y: Axis::linear("FLIP error (0 = equal)"),
            series: series.collect(),
            front: Vec::new(),
        }
    }

    /// Formats for each variant the displacement up to which its error rises by less than
    /// [`VISIBLE`].
    pub fn sentences(&self) -> Vec<String> {
        let sentence = |(index, variant): (usize, &SpriteVariant)| {
            let start = self.places.first().map_or(0.0, |place| place.flips[index]);
            let last = self
                .places
                .iter()
                .take_while(|place| place.flips[index] < start + VISIBLE)
                .last();
            let (parallax, moved, holes) = last.map_or((0.0, 0.0, 0.0), |place| {
                (place.parallax_px, place.displacement_m, place.hole_share)
            });
            let (default, holes) = if *variant == SpriteVariant::default() {
                (
                    " (default)",
                    format!("; {:.0} % holes there", holes * 100.0),
                )
            } else {
                ("", String::new())
            };
            let name = format!("{}{default}", variant.name());
            format!(
                "{name:<20} FLIP rises by less than {VISIBLE} up to {parallax:.1} px of parallax ({moved:.3} m){holes}"
            )
        };
        SpriteVariant::ALL
            .iter()
            .enumerate()
            .map(sentence)
            .collect()
    }
}

/// Returns the distance to the nearest sprite along the viewing axis, metres; to the nearest plane of
/// a sprite if none is shown there.
fn distance_ahead(set: &SpriteSet, camera: &Camera) -> Option<f64> {
    let shown = |sprite: &PreparedSprite| {
        let sprite = sprite.sprite();
        let (color, (columns, rows)) = (sprite.sprite().color(), sprite.displacement().size());
        let shown = color.get_pixel(camera.width() / 2, camera.height() / 2).0[3] > 0;
        sprite.eye_depth(columns / 2, rows / 2).filter(|_| shown)
    };
    let plane = |sprite: &PreparedSprite| {
        let [x, y] = [camera.width(), camera.height()].map(|size| f64::from(size) / 2.0);
        let depth = 1.0 / sprite.sprite().sprite().plane().inverse_depth(camera, x, y);
        (depth > 0.0 && depth.is_finite()).then_some(depth)
    };
    let nearest = |distance: &dyn Fn(&PreparedSprite) -> Option<f64>| {
        let distances = set.sprites().iter().filter_map(distance);
        distances.min_by(f64::total_cmp)
    };
    nearest(&shown).or_else(|| nearest(&plane))
}

/// Returns the largest displacement of a point relative to its sprite's plane, pixels of the
/// sprites.
fn largest_parallax_px(set: &SpriteSet, target: &Camera) -> f64 {
    let parallax = |sprite: &PreparedSprite| {
        let sprite = sprite.sprite();
        let Ok(transfer) = SpriteTransfer::new(sprite.sprite(), target) else {
            return 0.0;
        };
        let largest = sprite
            .displacement()
            .to_f32()
            .iter()
            .fold(0.0f32, |max, d| max.max(d.abs()));
        transfer.epipole_in_sprite.truncate().length() * f64::from(largest)
    };
    set.sprites().iter().map(parallax).fold(0.0, f64::max)
}
