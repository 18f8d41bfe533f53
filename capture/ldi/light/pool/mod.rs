//! Soft light pooled over a surface: neighbouring depth pixels of one plane share their light samples.
//!
//! Light from the sky, from lamps and from bounces varies slowly over a surface but is noisy per sample. So it is kept apart from
//! albedo, and each part takes the mean over a window of its surface: parts of the same kind
//! ([`crate::accumulate::accumulator::Accumulator::class`]: material, side, octant) in the same plane, in whatever layer and on whatever face. How
//! wide the window is, is decided part by part, from narrow to wide:
//!
//! * The wider window's mean counts as far as it agrees with the narrower one's within the noise of both (Katkovnik 1999, "A new
//!   method for varying adaptive bandwidth selection": intersecting confidence intervals). Edges of shadows stay.
//! * It counts as far as what irradiance may change over it is less than the noise of the narrower one: by the harmonic mean of
//!   the distances to what light comes from, with which Ward, Rubinstein and Clear (1988, "A ray tracing solution for diffuse
//!   interreflection") bound the gradient of irradiance. Contact shadows stay.
//!
//! The same windows say, block by block, where samples are wanted ([`survey`]). They are chosen for some places at a time ([`beside`]).
//!
//! Where light comes from so near that nothing wider would count, it is averaged along the line across which light changes ([`along`]).
//!
//! The narrowest window on large surfaces is a sum over dilated rows and columns ([`narrow`]), as in the a-trous wavelet transform
//! (Dammertz et al. 2010, "Edge-avoiding a-trous wavelet transform for fast global illumination filtering"); all others are made once
//! for a block of pixels ([`blocks`], [`around`]), each of twice the width of the one before, and know no borders of faces.
//! Sunlight, whose shadows have edges, and albedo are never pooled.

mod along;
mod around;
mod beside;
mod blocks;
mod narrow;
mod surface;
mod survey;
#[cfg(test)]
mod tests;
mod window;

pub(super) use around::Windows;
use beside::{Place, pooled};
pub(super) use blocks::Blocks;
pub(crate) use surface::same_surface;
pub(super) use survey::Survey;

use crate::surfaces::surface_samples::FaceParts;
use glam::Vec3;
use headbox_core::color::luminance;
use headbox_core::cube_face::Face;
use rayon::prelude::*;
use surface::Surface;
use window::FEW_SAMPLES;

/// What the light samples of a part found.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Gathered {
    /// Sum of the samples, exposed.
    pub(super) light: Vec3,
    /// Sum of their squared luminances.
    pub(super) squares: f32,
    /// Sum of one over the distance to what each sample's first ray met, 1/m.
    pub(super) nearness: f32,
    /// How many there are.
    pub(super) samples: f32,
}

/// What pooling made of them.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Pooled {
    /// Radiosity per albedo.
    pub(super) light: Vec3,
    /// Variance of the luminance of a single sample.
    pub(super) variance: f32,
    /// Samples of the window, about.
    pub(super) samples: f32,
    /// Parts of the window, about: those over which the mean is as good as that over all of a box.
    pub(super) parts: f32,
}

/// Windows over the second smallest blocks: some 500 pixels.
const SMALL_LEVEL: usize = 1;

/// How the soft light of a face is pooled.
pub(super) struct Pooling<'a> {
    parts: &'a FaceParts,
    /// Of each part.
    pixels: Vec<[u16; 2]>,
    surfaces: Vec<Surface>,
    /// Width of the parts' pixels on their surfaces, metres.
    widths: Vec<f32>,
}

impl<'a> Pooling<'a> {
    pub(super) fn new(parts: &'a FaceParts, face: Face) -> Self {
        let surfaces: Vec<Surface> = parts.parts.par_iter().map(Surface::of).collect();
        let (size_px, pixels) = (parts.size_px, parts.pixels());
        let width = |(surface, pixel): (&Surface, &[u16; 2])| {
            surface.pixel_width(face, middle(*pixel), size_px)
        };
        let widths = surfaces.par_iter().zip(&pixels).map(width).collect();
        Self {
            parts,
            pixels,
            surfaces,
            widths,
        }
    }

    /// The light of each part over its window, by what was gathered on the face and windows over blocks; samples of a class vary as is
    /// `expected` of it.
    pub(super) fn pool(
        &self,
        gathered: &[Gathered],
        windows: &Windows,
        expected: &[f32],
    ) -> Vec<Pooled> {
        let place = |part: usize| {
            let (surface, position, width_m) = (
                &self.surfaces[part],
                middle(self.pixels[part]),
                self.widths[part],
            );
            Place {
                surface,
                position,
                width_m,
                expected: expected[surface.class as usize],
            }
        };
        pooled(
            self.surfaces.len(),
            place,
            windows,
            Some(&self.narrow(gathered)),
        )
    }
}

/// The middle of a pixel, pixels.
fn middle(pixel: [u16; 2]) -> [f32; 2] {
    pixel.map(|c| f32::from(c) + 0.5)
}

/// What samples found by class of surface.
pub(super) struct Classes {
    /// Samples, light, squares.
    sums: Vec<[f64; 3]>,
}

impl Default for Classes {
    fn default() -> Self {
        Self {
            sums: vec![[0.0; 3]; 1 << 16],
        }
    }
}

impl Classes {
    /// What parts of these classes have gathered.
    pub(super) fn of(classes: &[u16], gathered: &[Gathered]) -> Self {
        let mut all = Self::default();
        for (&class, g) in classes
            .iter()
            .zip(gathered)
            .filter(|(_, g)| g.samples > 0.0)
        {
            let found = [g.samples, luminance(g.light.to_array()), g.squares].map(f64::from);
            let sums = &mut all.sums[usize::from(class)];
            sums.iter_mut()
                .zip(found)
                .for_each(|(sum, found)| *sum += found);
        }
        all
    }

    /// Adds those of another face.
    pub(super) fn absorb(&mut self, other: &Self) {
        for (sums, others) in self.sums.iter_mut().zip(&other.sums) {
            sums.iter_mut()
                .zip(others)
                .for_each(|(sum, other)| *sum += other);
        }
    }

    /// Variance of the luminance of single samples by class of surface, and of all where there are few of a class.
    pub(super) fn variances(&self) -> Vec<f32> {
        let mut all = [0.0f64; 3];
        for sums in &self.sums {
            all.iter_mut().zip(sums).for_each(|(all, sum)| *all += sum);
        }
        let variance = |[samples, light, squares]: [f64; 3]| {
            let per_sample = 1.0 / samples.max(1e-20);
            (squares * per_sample - (light * per_sample).powi(2)).max(0.0)
        };
        let few = f64::from(FEW_SAMPLES);
        let of_class =
            |of: &[f64; 3]| ((variance(*of) * of[0] + variance(all) * few) / (of[0] + few)) as f32;
        self.sums.iter().map(of_class).collect()
    }
}
