//! Samples of many images, or of rays, merged pixel by pixel into layers (S12, R11, P2, D1, D2, C11).
//!
//! *Similar depth* is measured in inverse depth, so that it needs no tuning per model (D2). Samples come image by image and are
//! merged in this order, whatever the threads do.

use super::piles::{RowSamples, Sample};
use crate::merge::clusters::SAME_COLOR_LEVELS;
use crate::surfaces::rows::pieces;
use glam::Vec3;
use headbox_core::cube_face::Face;
use headbox_core::srgb_table::encode_srgb;
use headbox_cube::model::parameters::MergeRule;
use headbox_cube::model::samples::{DepthPixel, EncodedNormal, LayeredDepthImage};
use rayon::prelude::*;

/// A depth pixel in the making.
#[derive(Clone, Copy, Debug)]
struct Layer {
    inverse_depth: f32,
    normal: EncodedNormal,
    /// Linear.
    color: Vec3,
    weight: f32,
    area: f32,
    image: u32,
    /// Another layer of its pixel, an earlier one, or [`NONE`].
    next: u32,
}

/// No layer.
const NONE: u32 = u32::MAX;

/// The layers of a cube, which grow as samples come.
pub struct LayerCube {
    face_px: u32,
    conflict: Conflict,
    /// Of each row of each face.
    rows: Vec<LayerRow>,
}

/// What becomes of samples that meet.
#[derive(Clone, Copy)]
struct Conflict {
    rule: MergeRule,
    /// The difference of inverse depths that counts as similar, 1/m.
    tolerance: f32,
}

/// One row of a face: a list of layers for each pixel.
#[derive(Clone, Debug, Default)]
struct LayerRow {
    /// The last layer of each pixel, or [`NONE`]; empty until the first sample.
    heads: Vec<u32>,
    layers: Vec<Layer>,
}

impl LayerCube {
    /// An empty cube.
    pub fn new(face_px: u32, rule: MergeRule, tolerance: f32) -> Self {
        let rows = vec![LayerRow::default(); 6 * face_px as usize];
        Self {
            face_px,
            conflict: Conflict { rule, tolerance },
            rows,
        }
    }

    /// Merges samples into the layers, pile after pile. One that is cut into other piles gives the same layers.
    pub fn add(&mut self, piles: &[RowSamples]) {
        let (face_px, conflict) = (self.face_px as usize, self.conflict);
        self.rows
            .par_iter_mut()
            .enumerate()
            .for_each(|(number, row)| {
                if row.heads.is_empty() {
                    row.expect(piles, number);
                }
                for pile in piles {
                    for samples in pile.row(number) {
                        row.add(samples, pile.image, conflict, face_px);
                    }
                }
            });
    }

    /// The six faces.
    pub fn finish(self) -> Vec<LayeredDepthImage> {
        let side = self.face_px as usize;
        let finished = |(&face, rows): (&Face, &[LayerRow])| {
            let mut image = LayeredDepthImage::empty(face, self.face_px);
            let total = rows.iter().map(|row| row.layers.len()).sum();
            let nothing = DepthPixel {
                inverse_depth: 0.0,
                normal: EncodedNormal::Z,
                color_srgb: [0; 4],
            };
            image.samples = vec![nothing; total];
            let places = pieces(&mut image.samples, rows.iter().map(|row| row.layers.len()));
            let (mut before, mut parts) = (0, Vec::with_capacity(side));
            for ((row, samples), ends) in rows
                .iter()
                .zip(places)
                .zip(image.offsets[1..].chunks_exact_mut(side))
            {
                parts.push((row, ends, before, samples));
                before += row.layers.len() as u32;
            }
            parts
                .into_par_iter()
                .for_each(|(row, ends, before, samples)| row.finish(before, ends, samples));
            image
        };
        Face::ALL
            .par_iter()
            .zip(self.rows.par_chunks(side))
            .map(finished)
            .collect()
    }
}

impl LayerRow {
    /// Makes room for the first image's samples of row `number`: as others see the same, most of what comes later falls onto these.
    fn expect(&mut self, piles: &[RowSamples], number: usize) {
        let Some(image) = piles.first().map(|pile| pile.image) else {
            return;
        };
        let of_first = piles.iter().take_while(|pile| pile.image == image);
        let count: usize = of_first
            .flat_map(|pile| pile.row(number))
            .map(<[Sample]>::len)
            .sum();
        self.layers.reserve(count + count / 2);
    }

    /// Merges samples of an image into the layers.
    fn add(&mut self, samples: &[Sample], image: u32, conflict: Conflict, face_px: usize) {
        if self.heads.is_empty() {
            self.heads = vec![NONE; face_px];
        }
        for sample in samples {
            let Some(head) = self.heads.get_mut(sample.column as usize) else {
                continue;
            };
            insert(&mut self.layers, head, sample, image, conflict);
        }
    }

    /// Writes depth pixels, by pixel and farthest first, and where those of each pixel end, if so many come before the row.
    fn finish(&self, before: u32, ends: &mut [u32], samples: &mut [DepthPixel]) {
        let (mut done, mut of_pixel) = (0, Vec::new());
        if self.heads.is_empty() {
            ends.fill(before);
            return;
        }
        for (&head, end) in self.heads.iter().zip(ends) {
            of_pixel.clear();
            let mut at = head;
            while let Some(layer) = self.layers.get(at as usize) {
                of_pixel.push(layer);
                at = layer.next;
            }
            if of_pixel.len() > 1 {
                of_pixel.reverse();
                of_pixel.sort_by(|a, b| a.inverse_depth.total_cmp(&b.inverse_depth));
            }
            for layer in &of_pixel {
                samples[done] = layer.finish();
                done += 1;
            }
            *end = before + done as u32;
        }
    }
}

/// Adds a sample to the layers of its pixel, of which the last is `head`. Samples come image by image, the central one first.
#[inline]
fn insert(
    layers: &mut Vec<Layer>,
    head: &mut u32,
    sample: &Sample,
    image: u32,
    conflict: Conflict,
) {
    let (mut nearest, mut least, mut at) = (NONE, conflict.tolerance, *head);
    while let Some(layer) = layers.get(at as usize) {
        let apart = (layer.inverse_depth - sample.inverse_depth).abs();
        // Of equals the earliest, which comes last.
        if apart <= least {
            (nearest, least) = (at, apart);
        }
        at = layer.next;
    }
    let mut push = |layers: &mut Vec<Layer>| {
        let last = std::mem::replace(head, layers.len() as u32);
        layers.push(Layer::new(sample, image, last));
    };
    let Some(layer) = layers.get_mut(nearest as usize) else {
        return push(layers);
    };
    match conflict.rule {
        MergeRule::Average => layer.average(sample),
        // Samples of one image are all kept: a surface nearly parallel to the pixel's ray. Those of the central image are
        // never displaced.
        MergeRule::SmallerArea if layer.image == image => push(layers),
        MergeRule::SmallerArea if layer.image != 0 && sample.area < layer.area => {
            *layer = Layer::new(sample, image, layer.next);
        }
        MergeRule::SmallerArea => {}
        MergeRule::ColorsApart => {
            let level = |color: Vec3| color.to_array().map(encode_srgb);
            let (a, b) = (level(layer.color), level(sample.color.linear()));
            if (0..3).any(|c| a[c].abs_diff(b[c]) >= SAME_COLOR_LEVELS) {
                push(layers);
            }
        }
    }
}

impl Layer {
    fn new(sample: &Sample, image: u32, next: u32) -> Self {
        let &Sample {
            inverse_depth,
            normal,
            color,
            weight,
            area,
            ..
        } = sample;
        Self {
            inverse_depth,
            normal,
            color: color.linear(),
            weight,
            area,
            image,
            next,
        }
    }

    fn average(&mut self, sample: &Sample) {
        let total = self.weight + sample.weight;
        let share = sample.weight / total;
        self.inverse_depth += (sample.inverse_depth - self.inverse_depth) * share;
        self.color += (sample.color.linear() - self.color) * share;
        if sample.weight > self.weight {
            self.normal = sample.normal;
        }
        self.weight = total;
    }

    fn finish(&self) -> DepthPixel {
        let [r, g, b] = self.color.to_array().map(encode_srgb);
        DepthPixel {
            inverse_depth: self.inverse_depth,
            normal: self.normal,
            color_srgb: [r, g, b, 255],
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::piles::Light;
    use super::*;
    use headbox_core::color::linear_from_srgb8;

    /// A sample of an image.
    type OfImage = (u32, Sample);

    fn sample(image: u32, inverse_depth: f32, grey: u8, area: f32) -> OfImage {
        let color = Light::new(Vec3::splat(linear_from_srgb8(grey)));
        (
            image,
            Sample {
                inverse_depth,
                color,
                weight: 1.0,
                area,
                ..Sample::NONE
            },
        )
    }

    /// A pile for each run of samples of one image, of a cube of `face_px` pixels a side; pixels are numbered in `column`.
    fn piles(samples: &[OfImage], face_px: u32) -> Vec<RowSamples> {
        let pile = |run: &[OfImage]| {
            let mut pile = RowSamples::new(face_px, run[0].0);
            for &(_, sample) in run {
                let (row, column) = (
                    u32::from(sample.column) / face_px,
                    u32::from(sample.column) % face_px,
                );
                pile.push(
                    row,
                    Sample {
                        column: column as u16,
                        ..sample
                    },
                );
            }
            pile
        };
        samples.chunk_by(|a, b| a.0 == b.0).map(pile).collect()
    }

    fn merged(rule: MergeRule, samples: &[OfImage]) -> Vec<(f32, u8)> {
        let mut cube = LayerCube::new(1, rule, 0.01);
        cube.add(&piles(samples, 1));
        let faces = cube.finish();
        faces[0]
            .samples
            .iter()
            .map(|kept| (kept.inverse_depth, kept.color_srgb[0]))
            .collect()
    }

    #[test]
    fn the_conflict_rules_of_three_papers() {
        let near_and_far = [sample(0, 0.5, 100, 1.0), sample(1, 0.2, 200, 1.0)];
        for rule in [
            MergeRule::Average,
            MergeRule::SmallerArea,
            MergeRule::ColorsApart,
        ] {
            assert_eq!(
                merged(rule, &near_and_far),
                [(0.2, 200), (0.5, 100)],
                "{rule:?}: different depths never meet"
            );
        }
        let (pinned, better, same) = (
            sample(0, 0.5, 10, 3.0),
            sample(1, 0.504, 30, 1.0),
            sample(1, 0.502, 30, 2.0),
        );
        assert_eq!(
            merged(MergeRule::SmallerArea, &[pinned, better]),
            [(0.5, 10)],
            "the central image stays"
        );
        assert_eq!(
            merged(MergeRule::SmallerArea, &[same, sample(2, 0.5, 40, 1.0)]),
            [(0.5, 40)],
            "smaller area"
        );
        assert_eq!(
            merged(MergeRule::SmallerArea, &[sample(2, 0.5, 40, 1.0), same]),
            [(0.5, 40)],
            "in either order"
        );
        assert_eq!(
            merged(MergeRule::SmallerArea, &[same, better]).len(),
            2,
            "one image keeps all of its samples"
        );
        assert_eq!(
            merged(MergeRule::ColorsApart, &[pinned, sample(1, 0.504, 12, 1.0)]),
            [(0.5, 10)],
            "the first stays"
        );
        assert_eq!(
            merged(MergeRule::ColorsApart, &[pinned, better]).len(),
            2,
            "unless colours differ"
        );
        let [(depth, _)] = merged(MergeRule::Average, &[pinned, better])[..] else {
            panic!("one layer")
        };
        assert!((depth - 0.502).abs() < 1e-6, "{depth}");
    }

    #[test]
    fn piles_may_be_cut_anywhere() {
        let samples: Vec<OfImage> = (0..600u32)
            .map(|i| {
                let pixel = i.wrapping_mul(2_654_435_761) % 54;
                let (image, sample) = sample(
                    i / 100,
                    0.1 + (i % 7) as f32 * 0.02,
                    (i % 251) as u8,
                    (i % 13) as f32,
                );
                (
                    image,
                    Sample {
                        column: pixel as u16,
                        ..sample
                    },
                )
            })
            .collect();
        for rule in [
            MergeRule::Average,
            MergeRule::SmallerArea,
            MergeRule::ColorsApart,
        ] {
            let of = |cuts: &[usize]| {
                let mut cube = LayerCube::new(3, rule, 0.015);
                let mut start = 0;
                for &end in cuts {
                    cube.add(&piles(&samples[start..end], 3));
                    start = end;
                }
                cube.finish()
            };
            assert_eq!(of(&[600]), of(&[1, 77, 300, 301, 600]), "{rule:?}");
            let mut cube = LayerCube::new(3, rule, 0.015);
            cube.add(
                &[piles(&samples[..250], 3), piles(&samples[250..], 3)]
                    .into_iter()
                    .flatten()
                    .collect::<Vec<_>>(),
            );
            assert_eq!(of(&[600]), cube.finish(), "{rule:?}");
        }
    }
}
