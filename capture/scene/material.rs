//! Materials and textures: diffuse colour, emission, gloss and cut-out.

use glam::Vec4;
use headbox_core::color::linear_levels;
use headbox_core::image::texels::bilinear;

/// Cut-out: the surface has holes where the alpha of `texture` is below `threshold`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Cutout {
    /// Index into [`crate::scene::Scene::textures`]; its alpha channel is tested.
    pub texture: u32,
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

/// A two-sided diffuse material with optional gloss. Only truth and the cameras of lumigraphs
/// render the gloss; representations with one colour per sample, such as a cube LDI, omit it.
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
        }
    }
}

/// An image that repeats in both directions. Texture coordinate (0, 0) is the **bottom** left
/// corner of the image (as in OBJ; the glTF loader flips); row 0 of `texels` is the top row.
#[derive(Clone, Debug, PartialEq)]
pub struct Texture {
    width: u32,
    height: u32,
    texels: Vec<[u8; 4]>,
}

impl Texture {
    /// Creates a texture from sRGB texels with straight alpha, top row first. `None` unless
    /// `texels` has exactly `width * height > 0` entries.
    pub fn new(width: u32, height: u32, texels: Vec<[u8; 4]>) -> Option<Self> {
        let count = usize::try_from(u64::from(width) * u64::from(height)).ok()?;
        (count > 0 && texels.len() == count).then_some(Self {
            width,
            height,
            texels,
        })
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
            texels,
        }
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

    /// Samples bilinearly: linear RGB and straight alpha.
    pub fn sample(&self, u: f32, v: f32) -> [f32; 4] {
        let ((x0, x1, fx), (y0, y1, fy)) =
            (neighbours(u, self.width), neighbours(1.0 - v, self.height));
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
}
