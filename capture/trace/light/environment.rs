//! The environment cube map of a scene's sky under its exposure.

use super::Lighting;
use glam::Vec3;
use headbox_core::environment::Environment;
use headbox_scene::scene::Sky;

impl Lighting {
    /// Renders the sky's radiance under this exposure into faces of `size_px` texels. `reached`
    /// returns true if a ray that missed the scene reached the texel of an index (see
    /// [`Environment::texels`]).
    pub fn environment_where(
        &self,
        size_px: u32,
        reached: impl Fn(usize) -> bool + Sync,
    ) -> Environment {
        /// Number of samples along each side of a texel.
        const SUPERSAMPLING: u32 = 4;
        // The sky image may be finer than this map: each texel is the mean over its footprint.
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

    /// Renders the whole sky; empty without a sky.
    pub fn environment(&self) -> Environment {
        let size_px = match &self.sky {
            None => return Environment::default(),
            // Sufficient for a smooth gradient.
            Some(Sky::Gradient(_)) => 128,
            Some(Sky::Picture(_)) => 512,
        };
        self.environment_where(size_px, |_| true)
    }
}
