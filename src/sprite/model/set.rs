//! A set of sprites of one scene, and their drawing order.

use crate::{
    Outcome, PreparedSprite, RenderOptions, SpriteLayer, SpritePlane, SpriteRenderer,
    SpriteWithDepth,
};
use glam::DVec3;
use headbox_core::camera::Camera;
use headbox_core::environment::Environment;
use headbox_core::file_frame::FileFrame;
use headbox_core::light_parameters::LightParameters;
use serde::{Deserialize, Serialize};

/// Source of the sprites; stored in the `.sprite` file.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct SpriteInfo {
    /// The scene or the images, as given on the command line; empty if unknown.
    pub source: String,
    /// Axes and unit of the source.
    #[serde(flatten)]
    pub frame: FileFrame,
    /// Light that the user specified instead of the scene's.
    #[serde(default = "LightParameters::unspecified")]
    pub light: LightParameters,
}

impl Default for SpriteInfo {
    /// Source without light of its own: colours are stored as they are.
    fn default() -> Self {
        Self {
            source: String::new(),
            frame: FileFrame::default(),
            light: LightParameters::unspecified(),
        }
    }
}

/// Sprites that are drawn together, prepared for rendering.
#[derive(Clone, Debug)]
pub struct SpriteSet {
    /// Source of the sprites.
    pub info: SpriteInfo,
    /// Environment behind all sprites; of size 0 if unknown. [`Self::render`] omits it, so that
    /// sprites can be drawn over other layers; [`crate::compose`] draws it.
    pub environment: Environment,
    sprites: Vec<PreparedSprite>,
}

impl SpriteSet {
    /// Returns the size in memory of images, displacements and the environment, bytes.
    pub fn bytes(&self) -> u64 {
        let bytes = |prepared: &PreparedSprite| {
            let sprite = prepared.sprite();
            sprite.sprite().color().as_raw().len() + sprite.displacement().stored_bytes().len()
        };
        let sprites: usize = self.sprites.iter().map(bytes).sum();
        (sprites + size_of_val(&self.environment.texels[..])) as u64
    }

    /// Prepares sprites for rendering.
    pub fn new(sprites: Vec<SpriteWithDepth>) -> Self {
        Self {
            info: SpriteInfo::default(),
            environment: Environment::default(),
            sprites: sprites.into_iter().map(PreparedSprite::new).collect(),
        }
    }

    /// Adds the sprites of another set; `info` and `environment` do not change.
    pub fn append(&mut self, other: Self) {
        self.sprites.extend(other.sprites);
    }

    /// The sprites, in the order in which they were added.
    pub fn sprites(&self) -> &[PreparedSprite] {
        &self.sprites
    }

    /// Returns the indices of the sprites in drawing order for an eye, back to front. A sprite that
    /// lies completely behind the plane of another is drawn before it; among sprites without such a
    /// constraint (or with contradicting constraints, which overlapping sprites can have) the one
    /// whose mean point is farther is drawn first.
    pub fn back_to_front(&self, eye: DVec3) -> Vec<usize> {
        let extents: Vec<SpriteExtent> = self
            .sprites
            .iter()
            .map(|s| SpriteExtent::new(s.sprite(), eye))
            .collect();
        let mut remaining: Vec<usize> = (0..extents.len()).collect();
        remaining.sort_by(|&a, &b| {
            extents[b]
                .distance
                .total_cmp(&extents[a].distance)
                .then(a.cmp(&b))
        });
        let mut order = Vec::with_capacity(remaining.len());
        while !remaining.is_empty() {
            let free = |&a: &usize| {
                remaining
                    .iter()
                    .all(|&b| a == b || !extents[b].is_behind(&extents[a]))
            };
            let next = remaining.iter().position(free).unwrap_or(0);
            order.push(remaining.remove(next));
        }
        order
    }

    /// Draws all sprites back to front into `frame`, which is resized to the target. Returns the
    /// outcome of each sprite, in the order of [`Self::sprites`].
    pub fn render(
        &self,
        renderer: &mut SpriteRenderer,
        target: &Camera,
        options: &RenderOptions,
        frame: &mut SpriteLayer,
    ) -> Vec<Outcome> {
        let mut outcomes = vec![Outcome::Drawn; self.sprites.len()];
        let mut single = SpriteLayer::default();
        frame.reset(target.width(), target.height());
        for index in self.back_to_front(target.eye()) {
            outcomes[index] = renderer.render(&self.sprites[index], target, options, &mut single);
            if outcomes[index] == Outcome::Drawn {
                frame.draw_over(&single);
            }
        }
        outcomes
    }
}

/// Extent of a sprite's visible surface, for ordering.
struct SpriteExtent {
    /// Points of the visible surface, world metres.
    points: Vec<DVec3>,
    /// The sprite's plane, its normal towards the eye.
    plane: SpritePlane,
    /// Distance from the eye to the mean of the points, metres.
    distance: f64,
}

/// Sample points along each side of a sprite.
const SAMPLES_PER_SIDE: u32 = 9;

/// Samples points of a sprite's visible surface, world metres, from which its drawing order
/// follows.
pub fn visible_points(sprite: &SpriteWithDepth) -> Vec<DVec3> {
    let (columns, rows) = sprite.displacement().size();
    let camera = sprite.sprite().camera();
    let color = sprite.sprite().color();
    let along =
        |count: u32| (0..SAMPLES_PER_SIDE).map(move |i| i * (count - 1) / (SAMPLES_PER_SIDE - 1));
    let cells = along(rows).flat_map(|y| along(columns).map(move |x| (x, y)));
    let point = |(x, y): (u32, u32)| {
        let px = (f64::from(x) + 0.5) * f64::from(color.width()) / f64::from(columns);
        let py = (f64::from(y) + 0.5) * f64::from(color.height()) / f64::from(rows);
        let visible = color.get_pixel(px as u32, py as u32).0[3] > 0;
        let depth = sprite.eye_depth(x, y).filter(|_| visible)?;
        Some(camera.eye() + camera.direction(px, py) * depth)
    };
    cells.filter_map(point).collect()
}

impl SpriteExtent {
    fn new(sprite: &SpriteWithDepth, eye: DVec3) -> Self {
        let points = visible_points(sprite);
        let mean = points.iter().sum::<DVec3>() / points.len().max(1) as f64;
        Self {
            points,
            plane: sprite.sprite().plane().facing(eye),
            distance: (mean - eye).length(),
        }
    }

    /// Returns true if this sprite must be drawn before `other`: it lies behind the other's plane,
    /// or the other lies in front of its own.
    fn is_behind(&self, other: &Self) -> bool {
        let range = |extent: &Self, plane: &SpritePlane| {
            let distances = extent.points.iter().map(|p| plane.signed_distance(*p));
            distances.fold([f64::MAX, f64::MIN], |[low, high], d| {
                [low.min(d), high.max(d)]
            })
        };
        let (mine, theirs) = (range(self, &other.plane), range(other, &self.plane));
        // Surfaces have an extent about their own planes: only a surface clearly beyond the extent
        // of the other decides.
        let (own, others) = (range(self, &self.plane), range(other, &other.plane));
        mine[1] < others[0] || theirs[0] > own[1]
    }
}
