//! Several sprites of one scene, and the order in which an eye sees them.

use crate::DisplacementFormat;
use crate::{Outcome, PreparedSprite, RenderOptions, SpriteLayer, SpriteRenderer, SpriteWithDepth};
use glam::DVec3;
use headbox_core::camera::Camera;
use headbox_core::environment::Environment;
use headbox_core::file_frame::FileFrame;
use headbox_core::light_parameters::LightParameters;
use serde::{Deserialize, Serialize};

/// Source of the sprites; stored in the `.sprite` file.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct SpriteInfo {
    /// The scene or the pictures, as given on the command line; empty if there is no telling.
    pub source: String,
    /// Axes and unit of the source.
    #[serde(flatten)]
    pub frame: FileFrame,
    /// The scene's light, where it is not its own.
    #[serde(default)]
    pub light: LightParameters,
}

/// Sprites that are drawn together.
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
    /// Bytes of pictures, displacements and the environment in memory.
    pub fn bytes(&self) -> u64 {
        let sprite = |prepared: &PreparedSprite| {
            let sprite = prepared.sprite();
            let displacement = sprite.displacement();
            let (width, height) = displacement.size();
            let cell = match displacement.format() {
                DisplacementFormat::I8 => 1,
                DisplacementFormat::I16 => 2,
                DisplacementFormat::F32 => 4,
            };
            sprite.sprite().color().as_raw().len() as u64
                + u64::from(width) * u64::from(height) * cell
        };
        self.sprites().iter().map(sprite).sum::<u64>()
            + size_of_val(&self.environment.texels[..]) as u64
    }

    /// Prepares sprites for drawing.
    pub fn new(sprites: Vec<SpriteWithDepth>) -> Self {
        Self {
            info: SpriteInfo::default(),
            environment: Environment::default(),
            sprites: sprites.into_iter().map(PreparedSprite::new).collect(),
        }
    }

    /// Adds the sprites of another set; info and environment stay.
    pub fn append(&mut self, other: Self) {
        self.sprites.extend(other.sprites);
    }

    /// The sprites as given.
    pub fn sprites(&self) -> &[PreparedSprite] {
        &self.sprites
    }

    /// Indices of the sprites in the order in which to draw them for an eye, back to front. A
    /// sprite that lies wholly beyond the plane of another, as the eye sees it, is drawn before it;
    /// where that leaves a choice (or contradicts itself, as overlapping sprites can), the one
    /// whose middle is farther is drawn first.
    pub fn back_to_front(&self, eye: DVec3) -> Vec<usize> {
        let shapes: Vec<SpriteExtent> = self
            .sprites
            .iter()
            .map(|s| SpriteExtent::new(s.sprite(), eye))
            .collect();
        let mut left: Vec<usize> = (0..shapes.len()).collect();
        left.sort_by(|&a, &b| {
            shapes[b]
                .distance
                .total_cmp(&shapes[a].distance)
                .then(a.cmp(&b))
        });
        let mut order = Vec::with_capacity(left.len());
        while !left.is_empty() {
            let free = |&a: &usize| {
                left.iter()
                    .all(|&b| a == b || !shapes[b].is_behind(&shapes[a]))
            };
            let next = left.iter().position(free).unwrap_or(0);
            order.push(left.remove(next));
        }
        order
    }

    /// Draws all sprites over each other into `frame`, which takes the target's size. Returns the
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

/// Extent of a sprite's visible part, for ordering.
struct SpriteExtent {
    /// Points of the visible surface, world.
    points: Vec<DVec3>,
    /// Unit normal towards the eye, and offset, of its plane.
    plane: (DVec3, f64),
    /// From the eye to the mean of the points, metres.
    distance: f64,
}

/// Sample points along each side of a sprite.
const SAMPLES_PER_SIDE: u32 = 9;

/// Points of the visible surface of a sprite, world: what tells its order among others.
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
        let plane = sprite.sprite().plane().facing(eye);
        let mean = points.iter().sum::<DVec3>() / points.len().max(1) as f64;
        Self {
            points,
            plane: (plane.normal, plane.offset),
            distance: (mean - eye).length(),
        }
    }

    /// Returns true if this shape must be drawn before `other`: it lies beyond the other's plane,
    /// or the other in front of its own.
    fn is_behind(&self, other: &Self) -> bool {
        let sides = |shape: &Self, (normal, offset): (DVec3, f64)| {
            let distances = shape.points.iter().map(|p| normal.dot(*p) + offset);
            distances.fold([f64::MAX, f64::MIN], |[low, high], d| {
                [low.min(d), high.max(d)]
            })
        };
        let (mine, theirs) = (sides(self, other.plane), sides(other, self.plane));
        // The surfaces have depth of their own about their planes: only what is clearly on one side
        // decides.
        let (own, others) = (sides(self, self.plane), sides(other, other.plane));
        mine[1] < others[0] || theirs[0] > own[1]
    }
}
