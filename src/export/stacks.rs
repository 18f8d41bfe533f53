//! Deep pixels of a face in the *tidy* form of compositing programs.

use crate::pieces;
use crate::points::surfels;
use headbox_core::color::tone::ToneMap;
use headbox_core::cube_face::Face;
use headbox_cube::pack::CubeLdi;

/// Deep sample of a pixel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Deep {
    /// Eye depth of the face's camera, metres.
    pub(super) depth_m: f32,
    /// Premultiplied linear red, green and blue (1 is white), and alpha.
    pub(super) rgba: [f32; 4],
}

impl Deep {
    fn new(depth_m: f64, [r, g, b, a]: [u8; 4], tone: ToneMap) -> Self {
        let alpha = f32::from(a) / 255.0;
        let [r, g, b] = [r, g, b].map(|c| tone.exposed(c) * alpha);
        Self {
            depth_m: depth_m as f32,
            rgba: [r, g, b, alpha],
        }
    }

    /// Composites this sample over another.
    pub(super) fn over(self, behind: Self) -> Self {
        let transmittance = 1.0 - self.rgba[3];
        Self {
            rgba: std::array::from_fn(|i| self.rgba[i] + transmittance * behind.rgba[i]),
            ..self
        }
    }
}

/// Deep samples of all pixels of a face.
pub(super) struct Stacks {
    /// Offset of each pixel's samples, row by row from the top, and finally the total number.
    pub(super) offsets: Vec<u32>,
    /// Samples, nearest first within a pixel, no two at one depth, none behind an opaque one.
    pub(super) samples: Vec<Deep>,
}

impl Stacks {
    /// Collects depth pixels, texels of plane textures, and the environment behind them.
    pub(super) fn new(cube: &CubeLdi, face: Face) -> Self {
        let face_px = cube.face_size_px;
        let distance = surfels::environment_distance(cube);
        let tone = cube.info.tone;
        let pieces = pieces::face_pieces(cube, face);
        let mut stacks = Self {
            offsets: vec![0],
            samples: Vec::with_capacity(pieces.len()),
        };
        let mut rest = pieces.iter().peekable();
        for (at, (y, x)) in
            (0u32..).zip((0..face_px).flat_map(|y| (0..face_px).map(move |x| (y, x))))
        {
            let direction = face.direction(f64::from(x) + 0.5, f64::from(y) + 0.5, face_px);
            let sky = cube.environment.sample(direction.as_vec3());
            while let Some(piece) = rest.next_if(|piece| piece.at == at) {
                stacks.push_behind(Deep::new(1.0 / piece.inverse_depth, piece.color_srgb, tone));
            }
            if let Some([r, g, b]) = sky {
                stacks.push_behind(Deep::new(distance, [r, g, b, 255], tone));
            }
            stacks.offsets.push(stacks.samples.len() as u32);
        }
        stacks
    }

    /// Appends a sample behind those of the last pixel.
    fn push_behind(&mut self, sample: Deep) {
        let first = self.offsets[self.offsets.len() - 1] as usize;
        match self.samples[first..].last_mut() {
            Some(front) if front.rgba[3] >= 1.0 => {}
            Some(front) if front.depth_m == sample.depth_m => *front = front.over(sample),
            _ => self.samples.push(sample),
        }
    }

    /// Returns the samples of the pixel with index `at`, row by row.
    pub(super) fn pixel(&self, at: usize) -> &[Deep] {
        &self.samples[self.offsets[at] as usize..self.offsets[at + 1] as usize]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn colours_match_stored_light() {
        for (tone, brightest) in [
            (ToneMap::SrgbClipped, 1.0),
            (ToneMap::SrgbCompressed, ToneMap::BRIGHTEST),
        ] {
            let levels = [0.25, 1.0, brightest].map(|light| tone.level(light));
            let [r, g, b] = levels;
            let deep = Deep::new(2.0, [r, g, b, 255], tone);
            for (found, light) in deep.rgba.into_iter().zip([0.25, 1.0, brightest, 1.0]) {
                assert!(
                    (found / light - 1.0).abs() < 0.05,
                    "{tone}: {found}, not {light}; steps of 8 bits"
                );
            }
        }
    }
}
