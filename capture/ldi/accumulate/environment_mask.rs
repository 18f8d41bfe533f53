//! The environment mask: directions in which rays left the scene.

use glam::Vec3;
use headbox_core::cube_face::Face;
use headbox_core::environment::Environment;
use headbox_scene::scene::Sky;
use headbox_trace::light::Lighting;
use std::sync::atomic::{AtomicU64, Ordering};

/// Size of the faces of a mask below which the environment has more texels than the mask.
const MIN_SIZE_PX: u32 = 128;

/// A bit for each texel of an environment cube map, set where a ray left the scene.
pub struct EnvironmentMask {
    size_px: u32,
    bits: Vec<AtomicU64>,
}

impl EnvironmentMask {
    /// A mask for faces of `face_size_px` pixels: a quarter of their resolution, because
    /// environments are smooth.
    pub fn new(face_size_px: u32) -> Self {
        let size_px = (face_size_px / 4).clamp(16, 512);
        let words = (6 * size_px as usize * size_px as usize).div_ceil(64);
        Self {
            size_px,
            bits: (0..words).map(|_| AtomicU64::new(0)).collect(),
        }
    }

    /// Marks the texel of a direction (world axes, any length).
    #[inline]
    pub fn mark(&self, direction: Vec3) {
        let (face, [x, y, depth]) = Face::locate(direction);
        let half = self.size_px as f32 / 2.0;
        let texel = |c: f32| ((half * (1.0 + c / depth)) as u32).min(self.size_px - 1);
        let row = face.index() as u32 * self.size_px + texel(-y);
        let index = (row * self.size_px + texel(x)) as usize;
        let bit = 1u64 << (index % 64);
        // Read first: nearly every miss finds its bit set, and a shared read costs no cache line
        // transfer.
        if self.bits[index / 64].load(Ordering::Relaxed) & bit == 0 {
            self.bits[index / 64].fetch_or(bit, Ordering::Relaxed);
        }
    }

    /// The words of the mask, as stored in a shard.
    pub fn words(&self) -> Vec<u64> {
        self.bits
            .iter()
            .map(|word| word.load(Ordering::Relaxed))
            .collect()
    }

    /// Adds the words of another mask of the same size.
    pub fn absorb(&self, words: &[u64]) {
        for (bits, word) in self.bits.iter().zip(words) {
            bits.fetch_or(*word, Ordering::Relaxed);
        }
    }

    /// The environment: the sky's radiance in every direction, with alpha 255 where a ray left the
    /// scene; empty if none did. Twice as many texels along a side if the sky is a picture, and on
    /// small faces, whose texels would blur the horizon over more than a degree.
    pub fn environment(&self, lighting: &Lighting) -> Environment {
        if self.words().iter().all(|&word| word == 0) {
            return Environment::default();
        }
        let is_picture = matches!(lighting.sky, Some(Sky::Picture(_)));
        let finer = if is_picture || self.size_px < MIN_SIZE_PX {
            2
        } else {
            1
        };
        let size_px = self.size_px * finer;
        let is_marked = |texel: usize| {
            let x = texel as u32 % size_px / finer;
            let row = texel as u32 / size_px / finer;
            let index = (row * self.size_px + x) as usize;
            self.bits[index / 64].load(Ordering::Relaxed) >> (index % 64) & 1 == 1
        };
        lighting.environment_where(size_px, is_marked)
    }
}
