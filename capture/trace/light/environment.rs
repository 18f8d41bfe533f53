//! The environment cube map of a scene's sky under its exposure.

use super::Lighting;
use glam::Vec3;
use headbox_core::environment::Environment;
use headbox_scene::scene::Sky;

impl Lighting {
    /// The sky's radiance under this exposure, in faces of `size_px` texels; `reached` tells by a
    /// texel's index (see [`Environment::texels`]) whether a miss reached it.
    pub fn environment_where(
        &self,
        size_px: u32,
        reached: impl Fn(usize) -> bool + Sync,
    ) -> Environment {
        /// Directions along each side of a texel.
        const SUPERSAMPLING: u32 = 4;
        // A picture of the sky may be finer than this map: each texel is the mean of what it
        // covers.
        let side = if matches!(self.sky, Some(Sky::Picture(_))) {
            SUPERSAMPLING
        } else {
            1
        };
        let stored = |directions: &mut dyn Iterator<Item = Vec3>| {
            let sum = directions
                .map(|direction| Vec3::from(self.miss_radiance(direction)))
                .sum::<Vec3>();
            self.stored(sum / (side * side) as f32)
        };
        Environment::from_radiance(size_px, side, stored, reached)
    }

    /// The whole sky; of size 0 where there is none.
    pub fn environment(&self) -> Environment {
        let size_px = match &self.sky {
            None => return Environment::default(),
            // A smooth gradient needs no more.
            Some(Sky::Gradient(_)) => 128,
            Some(Sky::Picture(_)) => 512,
        };
        self.environment_where(size_px, |_| true)
    }
}
