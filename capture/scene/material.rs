//! Materials and textures: diffuse colour, emission, gloss and cut-out.

use glam::Vec4;
use headbox_core::color::linear_levels;
use headbox_core::image::texels::bilinear;
use serde::{Deserialize, Serialize};
use std::sync::Arc;

/// Cut-out: the surface has holes where the alpha of `texture` times the opacity of the vertices
/// ([`crate::scene::Scene::opacities`]) is below `threshold`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Cutout {
    /// Index into [`crate::scene::Scene::textures`] of the texture whose alpha channel is tested;
    /// without one its alpha is 1.
    pub texture: Option<u32>,
    /// Least alpha of the opaque part.
    pub threshold: f32,
}

/// Glossy reflection: a normalised lobe about the mirror direction, a power of the cosine
/// (Lafortune and Willems 1994, "Using the Modified Phong Reflectance Model for Physically Based
/// Rendering").
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Gloss {
    /// Specular reflectance, linear RGB in 0..1; the sum with the albedo is at most 1.
    pub reflectance: [f32; 3],
    /// Exponent of the cosine: the larger, the sharper the reflection.
    pub exponent: f32,
}

/// A diffuse material with optional gloss; two-sided unless it says otherwise. Only truth and the
/// cameras of lumigraphs render the gloss; representations with one colour per sample, such as a
/// cube LDI, omit it.
#[derive(Clone, Debug, PartialEq)]
pub struct Material {
    /// The name in the file.
    pub name: String,
    /// Diffuse albedo, linear RGB in 0..1; multiplies the texture and the vertex colour.
    pub albedo: [f32; 3],
    /// Albedo texture: index into [`crate::scene::Scene::textures`].
    pub albedo_texture: Option<u32>,
    /// Emitted radiance, linear RGB.
    pub emission: [f32; 3],
    /// Emission texture, multiplies `emission`: index into [`crate::scene::Scene::textures`].
    pub emission_texture: Option<u32>,
    /// Gloss, if any.
    pub gloss: Option<Gloss>,
    /// Cut-out, if any.
    pub cutout: Option<Cutout>,
    /// True if the surface is absent for every ray that meets its back, whether the ray belongs to
    /// a camera or to light: what a point sees of it is also what keeps light from that point. It
    /// emits light only from its front.
    pub single_sided: bool,
}

impl Default for Material {
    fn default() -> Self {
        Self {
            name: "default".into(),
            albedo: [0.6; 3],
            albedo_texture: None,
            emission: [0.0; 3],
            emission_texture: None,
            gloss: None,
            cutout: None,
            single_sided: false,
        }
    }
}

/// Continuation of a texture beyond its edges along an axis.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub enum Wrap {
    /// The texture repeats.
    #[default]
    Repeat,
    /// The texture repeats, every other time mirrored.
    Mirror,
    /// The texels at the edge continue.
    Clamp,
}

/// Wrapping and interpolation of a texture.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub struct Sampler {
    /// Wrapping along columns and along rows.
    pub wrap: [Wrap; 2],
    /// True if a sample is the nearest texel, false if it is interpolated between four.
    pub nearest: bool,
}

impl Sampler {
    /// Returns the two texels of `size` along an axis between which the texture coordinate `t` lies
    /// (0 is the left or upper edge), and the weight of the second. `axis` is 0 along columns, 1
    /// along rows.
    pub fn neighbours(self, axis: usize, t: f32, size: u32) -> (usize, usize, f32) {
        let wrap = self.wrap[axis % 2];
        if !self.nearest && wrap == Wrap::Repeat {
            return neighbours(t, size);
        }
        let x = if t.is_finite() { t * size as f32 } else { 0.0 };
        if self.nearest {
            let texel = wrap.texel(floor(x), size);
            return (texel, texel, 0.0);
        }
        let first = floor(x - 0.5);
        let weight = (x - 0.5 - first).clamp(0.0, 1.0);
        (
            wrap.texel(first, size),
            wrap.texel(first + 1.0, size),
            weight,
        )
    }
}

impl Wrap {
    /// Returns the texel at a whole number of texels from the first.
    fn texel(self, at: f32, size: u32) -> usize {
        let (at, size) = (at as i64, i64::from(size));
        let texel = match self {
            Self::Repeat => at.rem_euclid(size),
            Self::Mirror => {
                let in_period = at.rem_euclid(2 * size);
                in_period.min(2 * size - 1 - in_period)
            }
            Self::Clamp => at.clamp(0, size - 1),
        };
        texel as usize
    }
}

/// An image with its sampler; it repeats in both directions by default. Copies share the texels.
/// Texture coordinate (0, 0) is the **bottom** left
/// corner of the image (as in OBJ; the glTF loader flips); row 0 of `texels` is the top row.
#[derive(Clone, Debug, PartialEq)]
pub struct Texture {
    width: u32,
    height: u32,
    sampler: Sampler,
    texels: Arc<Vec<[u8; 4]>>,
}

impl Texture {
    /// Creates a texture from sRGB texels with straight alpha, top row first. `None` unless
    /// `texels` has exactly `width * height > 0` entries.
    pub fn new(width: u32, height: u32, texels: Vec<[u8; 4]>) -> Option<Self> {
        let count = usize::try_from(u64::from(width) * u64::from(height)).ok()?;
        (count > 0 && texels.len() == count).then_some(Self {
            width,
            height,
            sampler: Sampler::default(),
            texels: Arc::new(texels),
        })
    }

    /// Returns the same image with another sampler; both share the texels.
    pub fn with_sampler(&self, sampler: Sampler) -> Self {
        Self {
            sampler,
            ..self.clone()
        }
    }

    /// Returns true if both are the same image in memory.
    pub fn shares_texels(&self, other: &Self) -> bool {
        Arc::ptr_eq(&self.texels, &other.texels)
    }

    /// Creates a texture from a function of column and row: `texel(x, y)` is sRGB with straight
    /// alpha, row 0 is the top row. A side of 0 becomes 1.
    pub fn from_fn(width: u32, height: u32, texel: impl Fn(u32, u32) -> [u8; 4]) -> Self {
        let (width, height) = (width.max(1), height.max(1));
        let texels = (0..height)
            .flat_map(|y| (0..width).map(move |x| (x, y)))
            .map(|(x, y)| texel(x, y))
            .collect();
        Self {
            width,
            height,
            sampler: Sampler::default(),
            texels: Arc::new(texels),
        }
    }

    /// Wrapping and interpolation.
    pub fn sampler(&self) -> Sampler {
        self.sampler
    }

    /// Width in texels.
    pub fn width(&self) -> u32 {
        self.width
    }

    /// Height in texels.
    pub fn height(&self) -> u32 {
        self.height
    }

    /// The texels, sRGB with straight alpha, row by row from the top.
    pub fn texels(&self) -> &[[u8; 4]] {
        &self.texels
    }

    /// Samples by the sampler: linear RGB and straight alpha.
    pub fn sample(&self, u: f32, v: f32) -> [f32; 4] {
        if self.sampler != Sampler::default() {
            return self.sample_between(
                self.sampler.neighbours(0, u, self.width),
                self.sampler.neighbours(1, 1.0 - v, self.height),
            );
        }
        self.sample_between(neighbours(u, self.width), neighbours(1.0 - v, self.height))
    }

    /// Interpolates between two columns and two rows, each with the weight of the second.
    #[inline(always)]
    fn sample_between(
        &self,
        (x0, x1, fx): (usize, usize, f32),
        (y0, y1, fy): (usize, usize, f32),
    ) -> [f32; 4] {
        let (linear, width) = (linear_levels(), self.width as usize);
        let (above, below) = (y0 * width, y1 * width);
        let four = [
            self.texel(linear, above + x0),
            self.texel(linear, above + x1),
            self.texel(linear, below + x0),
            self.texel(linear, below + x1),
        ];
        bilinear(four, [fx, fy]).to_array()
    }

    /// Decodes a texel to linear RGB and alpha. `linear` is the sRGB decoding table, looked up once
    /// for all texels of a sample.
    #[inline(always)]
    fn texel(&self, linear: &[f32; 256], index: usize) -> Vec4 {
        let [r, g, b, alpha] = self.texels[index];
        let [r, g, b] = [
            linear[usize::from(r)],
            linear[usize::from(g)],
            linear[usize::from(b)],
        ];
        Vec4::new(r, g, b, f32::from(alpha) / 255.0)
    }
}

/// Returns `t.floor()` without the call into libm that processors before SSE4.1 need.
#[inline]
pub fn floor(t: f32) -> f32 {
    if t.abs() >= 8_388_608.0 {
        return t; // too large for a fraction
    }
    let truncated = t as i32 as f32;
    if truncated > t {
        truncated - 1.0
    } else {
        truncated
    }
}

/// Returns the two texels on either side of the texture coordinate `t`, and the weight of the
/// second.
#[inline]
fn neighbours(t: f32, size: u32) -> (usize, usize, f32) {
    let size_f = size as f32;
    let t = if t.is_finite() { t } else { 0.0 };
    // `t - floor(t)` may round up to 1, and half a texel may be missing on the left: both wrap.
    let x = (t - floor(t)) * size_f - 0.5;
    let x = if x < 0.0 { x + size_f } else { x };
    let first = (x as usize).min(size as usize - 1);
    let second = if first + 1 == size as usize {
        0
    } else {
        first + 1
    };
    (first, second, (x - first as f32).clamp(0.0, 1.0))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn texel_centres_are_exact_and_coordinates_wrap() {
        let texels = vec![
            [255, 0, 0, 255],
            [0, 255, 0, 255],
            [0, 0, 255, 0],
            [255, 255, 255, 255],
        ];
        let texture = Texture::new(2, 2, texels).expect("2x2");
        assert_eq!(texture.sample(0.25, 0.75), [1.0, 0.0, 0.0, 1.0], "top left");
        assert_eq!(
            texture.sample(0.25, 0.25),
            [0.0, 0.0, 1.0, 0.0],
            "bottom left"
        );
        assert_eq!(texture.sample(-0.75, 3.75), [1.0, 0.0, 0.0, 1.0], "wrapped");
        assert!(
            texture
                .sample(f32::NAN, f32::INFINITY)
                .iter()
                .all(|c| c.is_finite())
        );
        assert!(Texture::new(0, 0, vec![]).is_none());
        assert!(Texture::new(2, 1, vec![[0; 4]]).is_none());
    }

    #[test]
    fn samplers_wrap_each_axis_and_interpolate_or_not() {
        let texture = Texture::new(2, 1, vec![[255, 0, 0, 255], [0, 0, 255, 51]]).expect("2x1");
        let reds = |wrap: Wrap, nearest: bool| {
            let sampler = Sampler {
                wrap: [wrap, Wrap::Repeat],
                nearest,
            };
            let texture = texture.with_sampler(sampler);
            // Texel centres from one period before to two behind.
            let centres = [-0.75, -0.25, 0.25, 0.75, 1.25, 1.75, 2.25, 2.75];
            centres.map(|u| texture.sample(u, 7.5)[0])
        };
        for nearest in [true, false] {
            let clamped = [1.0, 1.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0];
            assert_eq!(reds(Wrap::Clamp, nearest), clamped);
            let mirrored = [0.0, 1.0, 1.0, 0.0, 0.0, 1.0, 1.0, 0.0];
            assert_eq!(reds(Wrap::Mirror, nearest), mirrored);
            let repeated = [1.0, 0.0, 1.0, 0.0, 1.0, 0.0, 1.0, 0.0];
            assert_eq!(reds(Wrap::Repeat, nearest), repeated);
        }
        let at = |sampler: Sampler, u: f32| texture.with_sampler(sampler).sample(u, 0.5);
        let nearest = Sampler {
            nearest: true,
            ..Sampler::default()
        };
        assert_eq!(at(nearest, 0.49), [1.0, 0.0, 0.0, 1.0]);
        assert_eq!(at(nearest, 0.51)[3], 0.2, "alpha is sampled likewise");
        let clamp = Sampler {
            wrap: [Wrap::Clamp; 2],
            nearest: false,
        };
        assert_eq!(
            at(clamp, 0.0),
            [1.0, 0.0, 0.0, 1.0],
            "no colour of the other edge"
        );
        assert_eq!(at(clamp, 0.5)[0], 0.5);
        for u in [f32::NAN, f32::INFINITY, 1e30, -1e30] {
            assert!(at(clamp, u)[0].is_finite() && at(nearest, u)[0].is_finite());
        }
        assert!(texture.with_sampler(clamp).shares_texels(&texture));
    }
}
