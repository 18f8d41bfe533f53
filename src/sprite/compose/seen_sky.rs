//! The part of the sky that the sprites' cameras saw.
//!
//! Where no sprite covers a pixel, the environment is drawn. That is right only where a camera
//! looked past every surface in the pixel's direction. Elsewhere lies what no sprite shows, such as
//! the ground beside or behind an object: such pixels count as holes.

use crate::SpriteSet;
use glam::{DMat4, DVec2, DVec3, dvec2};
use headbox_core::camera::Camera;
use headbox_core::frame::Coverage;

/// Directions in which the cameras of sprites saw no surface.
pub(super) struct SeenSky {
    images: Vec<SkyImage>,
}

impl SeenSky {
    /// Collects the sky of all cameras of some sprites.
    pub(super) fn new(sprites: &SpriteSet) -> Self {
        let mut skies: Vec<(Camera, Vec<bool>)> = Vec::new();
        for sprite in sprites.sprites() {
            let sprite = sprite.sprite().sprite();
            let is_open = sprite.color().pixels().map(|pixel| pixel.0[3] == 0);
            let own = skies
                .iter_mut()
                .find(|(camera, _)| camera == sprite.camera());
            match own {
                Some((_, is_sky)) => is_sky
                    .iter_mut()
                    .zip(is_open)
                    .for_each(|(is_sky, is_open)| *is_sky &= is_open),
                None => skies.push((*sprite.camera(), is_open.collect())),
            }
        }
        let image = |(camera, is_sky): (Camera, Vec<bool>)| SkyImage::new(camera, &is_sky);
        Self {
            images: skies.into_iter().map(image).collect(),
        }
    }

    /// Turns environment pixels of row `y` of a frame in whose direction no camera saw the sky into
    /// filled holes, and returns their number.
    pub(super) fn mark_unseen(&self, camera: &Camera, y: usize, coverages: &mut [Coverage]) -> u64 {
        let start = camera.direction(0.5, y as f64 + 0.5);
        let step = camera.direction(1.5, y as f64 + 0.5) - start;
        let is_open = |coverage: &Coverage| *coverage == Coverage::ENVIRONMENT;
        let mut unseen = 0;
        for (i, coverages) in coverages.chunks_mut(CHUNK).enumerate() {
            if !coverages.iter().any(is_open) {
                continue;
            }
            let direction = |k: usize| start + step * (i * CHUNK + k) as f64;
            let ends = [direction(0), direction(coverages.len() - 1)];
            let (mut is_whole, mut is_mixed) = (false, false);
            for image in &self.images {
                match image.sees_sky_between(ends) {
                    Some(is_seen) => is_whole |= is_seen,
                    None => is_mixed = true,
                }
            }
            if is_whole {
                continue;
            }
            for (k, coverage) in coverages.iter_mut().enumerate() {
                let is_seen = || {
                    let sees = |image: &SkyImage| image.sees_sky(direction(k));
                    is_mixed && self.images.iter().any(sees)
                };
                if is_open(coverage) && !is_seen() {
                    *coverage = Coverage::FILLED;
                    unseen += 1;
                }
            }
        }
        unseen
    }
}

/// Pixels of a row that are tested together.
const CHUNK: usize = 128;

/// The pixels of a camera that no sprite of it covers.
struct SkyImage {
    camera: Camera,
    image_from_world: DMat4,
    /// Number of pixels of the sky above and left of each corner of a pixel: a summed-area table
    /// of width + 1 columns.
    counts: Vec<u32>,
}

impl SkyImage {
    fn new(camera: Camera, is_sky: &[bool]) -> Self {
        let width = camera.width() as usize;
        let mut counts = vec![0; width + 1];
        for row in is_sky.chunks_exact(width) {
            let above = counts.len() - (width + 1);
            let mut in_row = 0;
            counts.push(0);
            for (x, is_sky) in row.iter().enumerate() {
                in_row += u32::from(*is_sky);
                counts.push(counts[above + x + 1] + in_row);
            }
        }
        Self {
            camera,
            image_from_world: camera.image_from_world(),
            counts,
        }
    }

    /// Returns the number of pixels of the sky in columns and rows from `low` to the one before
    /// `high`.
    fn count(&self, low: [usize; 2], high: [usize; 2]) -> u32 {
        let at = |x: usize, y: usize| self.counts[y * (self.camera.width() as usize + 1) + x];
        (at(high[0], high[1]) + at(low[0], low[1])) - (at(low[0], high[1]) + at(high[0], low[1]))
    }

    /// Returns the position of a direction in the image, px, if it is in front of the camera.
    fn project(&self, direction: DVec3) -> Option<DVec2> {
        let [x, y, _, w] = (self.image_from_world * direction.extend(0.0)).to_array();
        (w > 0.0).then(|| dvec2(x, y) / w)
    }

    fn size(&self) -> DVec2 {
        dvec2(self.camera.width().into(), self.camera.height().into())
    }

    /// Returns the pixel at a position, if it is in the image.
    fn pixel(&self, position: DVec2) -> Option<[usize; 2]> {
        let is_inside = position.cmpge(DVec2::ZERO).all() && position.cmplt(self.size()).all();
        is_inside.then_some([position.x as usize, position.y as usize])
    }

    fn sees_sky(&self, direction: DVec3) -> bool {
        let pixel = self.project(direction).and_then(|at| self.pixel(at));
        pixel.is_some_and(|[x, y]| self.count([x, y], [x + 1, y + 1]) == 1)
    }

    /// Returns whether the camera sees the sky in all directions between two, or in none; `None` if
    /// that is not certain.
    fn sees_sky_between(&self, ends: [DVec3; 2]) -> Option<bool> {
        let [Some(a), Some(b)] = ends.map(|direction| self.project(direction)) else {
            // Directions between two behind the camera are behind it.
            let is_behind = ends.map(|direction| self.project(direction).is_none());
            return (is_behind == [true; 2]).then_some(false);
        };
        if a.max(b).cmplt(DVec2::ZERO).any() || a.min(b).cmpge(self.size()).any() {
            return Some(false);
        }
        let low = self.pixel(a.min(b))?;
        let high = self.pixel(a.max(b))?.map(|last| last + 1);
        let all = (high[0] - low[0]) * (high[1] - low[1]);
        match self.count(low, high) as usize {
            0 => Some(false),
            count if count == all => Some(true),
            _ => None,
        }
    }
}
