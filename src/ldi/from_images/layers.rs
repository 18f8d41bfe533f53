//! Samples of many images, or of rays, merged pixel by pixel into layers (S12, R11, P2, D1, D2, C11).
//!
//! *Similar depth* is measured in inverse depth, so that it needs no tuning per model (D2). Samples come image by image and are
//! merged in this order, whatever the threads do.

use crate::capture::rig::Face;
use crate::ldi::merge::{MergeRule, SAME_COLOR_LEVELS};
use crate::ldi::{DepthPixel, EncodedNormal, LayeredDepthImage};
use crate::srgb::encode_srgb;
use glam::Vec3;
use rayon::prelude::*;

/// What an image, or a ray, says of a pixel.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Sample {
    /// Number of the pixel: face, row and column, in this order of significance.
    pub(crate) pixel: u32,
    /// About the cube's centre, 1/m.
    pub(crate) inverse_depth: f32,
    /// World axes, turned toward where it was seen from.
    pub(crate) normal: EncodedNormal,
    /// Linear.
    pub(crate) color: Vec3,
    /// What it counts for in a mean.
    pub(crate) weight: f32,
    /// Of the surface that a pixel of its image covers, up to one factor for all (C10).
    pub(crate) area: f32,
    /// Which image it is of; image 0 is pinned (C11).
    pub(crate) image: u32,
}

/// Depth pixels in the making.
#[derive(Clone, Copy, Debug)]
struct Layer {
    inverse_depth: f32,
    normal: EncodedNormal,
    /// Linear.
    color: Vec3,
    weight: f32,
    area: f32,
    image: u32,
}

/// The layers of a cube, which grow as samples come.
pub(crate) struct LayerCube {
    face_px: u32,
    rule: MergeRule,
    /// The difference of inverse depths that counts as similar, 1/m.
    tolerance: f32,
    /// Of each row of each face.
    rows: Vec<LayerRow>,
}

/// One row of a face: the pixel of every layer, and the layers, by pixel.
#[derive(Clone, Debug, Default)]
struct LayerRow {
    pixels: Vec<u32>,
    layers: Vec<Layer>,
}

/// Samples by row of the cube; those of a row in the order in which they came.
pub(crate) struct RowSamples {
    /// The first row that has any.
    first: usize,
    /// Where those of each row from there on begin, and the end.
    starts: Vec<u32>,
    samples: Vec<Sample>,
}

impl RowSamples {
    /// Of a cube with faces of `face_px` pixels a side.
    pub(crate) fn new(samples: &[Sample], face_px: u32) -> Self {
        let mut places: Vec<u32> = samples.iter().map(|sample| sample.pixel / face_px).collect();
        let first = places.iter().copied().min().unwrap_or(0);
        let rows = places.iter().max().map_or(0, |last| last + 1 - first);
        places.iter_mut().for_each(|row| *row -= first);
        let (starts, order) = by_place(&places, rows as usize);
        let samples = order.into_iter().map(|i| samples[i as usize]).collect();
        Self { first: first as usize, starts, samples }
    }

    /// Those of a row: face and row, in this order of significance.
    fn of_row(&self, row: usize) -> &[Sample] {
        let ends = row.checked_sub(self.first).and_then(|row| self.starts.get(row..row + 2));
        ends.map_or(&[], |ends| &self.samples[ends[0] as usize..ends[1] as usize])
    }
}

/// Sorts things by their places, of which there are `count`: where those of each place begin, and the end; and the numbers of the
/// things, those of one place in order.
fn by_place(places: &[u32], count: usize) -> (Vec<u32>, Vec<u32>) {
    let starts = starts(places.iter().map(|&place| place as usize), count);
    let (mut next, mut order) = (starts.clone(), vec![0; places.len()]);
    for (thing, &place) in (0..).zip(places) {
        let next = &mut next[place as usize];
        order[*next as usize] = thing;
        *next += 1;
    }
    (starts, order)
}

/// Where things of each of `count` places begin once they are sorted, and the end.
fn starts(places: impl Iterator<Item = usize>, count: usize) -> Vec<u32> {
    let mut starts = vec![0u32; count + 1];
    places.for_each(|place| starts[place + 1] += 1);
    let mut total = 0;
    for start in &mut starts {
        total += *start;
        *start = total;
    }
    starts
}

impl LayerCube {
    /// An empty cube.
    pub(crate) fn new(face_px: u32, rule: MergeRule, tolerance: f32) -> Self {
        Self { face_px, rule, tolerance, rows: vec![LayerRow::default(); 6 * face_px as usize] }
    }

    /// Merges samples into the layers, pile after pile. One that is cut into other piles gives the same layers.
    pub(crate) fn add(&mut self, piles: &[RowSamples]) {
        let (face_px, rule, tolerance) = (self.face_px as usize, self.rule, self.tolerance);
        self.rows.par_iter_mut().enumerate().for_each(|(number, row)| {
            let piles: Vec<&[Sample]> = piles.iter().map(|pile| pile.of_row(number)).collect();
            let first = number * face_px;
            let came = || piles.iter().copied().flatten();
            let Some(any) = came().next() else { return };
            let starts = starts(came().map(|sample| sample.pixel as usize - first), face_px);
            let (mut next, mut samples) = (starts.clone(), vec![any; starts[face_px] as usize]);
            for sample in came() {
                let next = &mut next[sample.pixel as usize - first];
                samples[*next as usize] = sample;
                *next += 1;
            }
            row.add(&samples, rule, tolerance);
        });
    }

    /// The six faces.
    pub(crate) fn finish(self) -> Vec<LayeredDepthImage> {
        let side = self.face_px as usize;
        let rows: Vec<&[LayerRow]> = self.rows.chunks(side).collect();
        let finished = |(&face, rows): (&Face, &[LayerRow])| {
            let mut image = LayeredDepthImage::empty(face, self.face_px);
            let first = (face.index() * side * side) as u32;
            for pixel in rows.iter().flat_map(|row| &row.pixels) {
                image.offsets[(pixel - first) as usize + 1] += 1;
            }
            let mut total = 0;
            for offset in &mut image.offsets {
                total += *offset;
                *offset = total;
            }
            let samples: Vec<Vec<DepthPixel>> =
                rows.par_iter().map(|row| row.layers.iter().map(Layer::finish).collect()).collect();
            image.samples = samples.concat();
            image
        };
        Face::ALL.par_iter().zip(rows).map(finished).collect()
    }
}

impl LayerRow {
    /// Merges samples, by pixel, into the layers.
    fn add(&mut self, samples: &[&Sample], rule: MergeRule, tolerance: f32) {
        let mut merged = Self {
            pixels: Vec::with_capacity(self.pixels.len() + samples.len() / 2),
            layers: Vec::with_capacity(self.pixels.len() + samples.len() / 2),
        };
        let (mut there, mut of_pixel) = (0, Vec::new());
        for new in samples.chunk_by(|a, b| a.pixel == b.pixel) {
            let pixel = new[0].pixel;
            // Both are in order: what lies before is passed once.
            let before = there + self.pixels[there..].iter().take_while(|&&p| p < pixel).count();
            let after = before + self.pixels[before..].iter().take_while(|&&p| p == pixel).count();
            merged.pixels.extend_from_slice(&self.pixels[there..before]);
            merged.layers.extend_from_slice(&self.layers[there..before]);
            of_pixel.clear();
            of_pixel.extend_from_slice(&self.layers[before..after]);
            new.iter().for_each(|sample| insert(&mut of_pixel, sample, rule, tolerance));
            if of_pixel.len() > 1 {
                of_pixel.sort_by(|a, b| a.inverse_depth.total_cmp(&b.inverse_depth));
            }
            merged.pixels.extend(of_pixel.iter().map(|_| pixel));
            merged.layers.extend_from_slice(&of_pixel);
            there = after;
        }
        merged.pixels.extend_from_slice(&self.pixels[there..]);
        merged.layers.extend_from_slice(&self.layers[there..]);
        *self = merged;
    }
}

/// Adds a sample to the layers of its pixel. Samples come image by image, the central one first.
fn insert(layers: &mut Vec<Layer>, sample: &Sample, rule: MergeRule, tolerance: f32) {
    let apart = |layer: &Layer| (layer.inverse_depth - sample.inverse_depth).abs();
    let nearest = layers.iter_mut().min_by(|a, b| apart(a).total_cmp(&apart(b)));
    let Some(layer) = nearest.filter(|layer| apart(layer) <= tolerance) else {
        layers.push(Layer::new(sample));
        return;
    };
    match rule {
        MergeRule::Average => layer.average(sample),
        // Samples of one image are all kept: a surface nearly parallel to the pixel's ray. Those of the central image are
        // never displaced.
        MergeRule::SmallerArea if layer.image == sample.image => layers.push(Layer::new(sample)),
        MergeRule::SmallerArea if layer.image != 0 && sample.area < layer.area => *layer = Layer::new(sample),
        MergeRule::SmallerArea => {}
        MergeRule::ColorsApart => {
            let level = |color: Vec3| color.to_array().map(encode_srgb);
            let (a, b) = (level(layer.color), level(sample.color));
            if (0..3).any(|c| a[c].abs_diff(b[c]) >= SAME_COLOR_LEVELS) {
                layers.push(Layer::new(sample));
            }
        }
    }
}

impl Layer {
    fn new(sample: &Sample) -> Self {
        let &Sample { inverse_depth, normal, color, weight, area, image, .. } = sample;
        Self { inverse_depth, normal, color, weight, area, image }
    }

    fn average(&mut self, sample: &Sample) {
        let total = self.weight + sample.weight;
        let share = sample.weight / total;
        self.inverse_depth += (sample.inverse_depth - self.inverse_depth) * share;
        self.color += (sample.color - self.color) * share;
        if sample.weight > self.weight {
            self.normal = sample.normal;
        }
        self.weight = total;
    }

    fn finish(&self) -> DepthPixel {
        let [r, g, b] = self.color.to_array().map(encode_srgb);
        DepthPixel { inverse_depth: self.inverse_depth, normal: self.normal, color_srgb: [r, g, b, 255] }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::capture::linear_from_srgb8;

    fn sample(image: u32, inverse_depth: f32, grey: u8, area: f32) -> Sample {
        let normal = EncodedNormal::new(Vec3::Z);
        let color = Vec3::splat(linear_from_srgb8(grey));
        Sample { pixel: 0, inverse_depth, normal, color, weight: 1.0, area, image }
    }

    fn merged(rule: MergeRule, samples: &[Sample]) -> Vec<(f32, u8)> {
        let mut cube = LayerCube::new(1, rule, 0.01);
        cube.add(&[RowSamples::new(samples, 1)]);
        let faces = cube.finish();
        faces[0].samples.iter().map(|kept| (kept.inverse_depth, kept.color_srgb[0])).collect()
    }

    #[test]
    fn the_conflict_rules_of_three_papers() {
        let near_and_far = [sample(0, 0.5, 100, 1.0), sample(1, 0.2, 200, 1.0)];
        for rule in [MergeRule::Average, MergeRule::SmallerArea, MergeRule::ColorsApart] {
            assert_eq!(merged(rule, &near_and_far), [(0.2, 200), (0.5, 100)], "{rule:?}: different depths never meet");
        }
        let (pinned, better, same) = (sample(0, 0.5, 10, 3.0), sample(1, 0.504, 30, 1.0), sample(1, 0.502, 30, 2.0));
        assert_eq!(merged(MergeRule::SmallerArea, &[pinned, better]), [(0.5, 10)], "the central image stays");
        assert_eq!(merged(MergeRule::SmallerArea, &[same, sample(2, 0.5, 40, 1.0)]), [(0.5, 40)], "smaller area");
        assert_eq!(merged(MergeRule::SmallerArea, &[sample(2, 0.5, 40, 1.0), same]), [(0.5, 40)], "in either order");
        assert_eq!(merged(MergeRule::SmallerArea, &[same, better]).len(), 2, "one image keeps all of its samples");
        assert_eq!(
            merged(MergeRule::ColorsApart, &[pinned, sample(1, 0.504, 12, 1.0)]),
            [(0.5, 10)],
            "the first stays"
        );
        assert_eq!(merged(MergeRule::ColorsApart, &[pinned, better]).len(), 2, "unless colours differ");
        let [(depth, _)] = merged(MergeRule::Average, &[pinned, better])[..] else { panic!("one layer") };
        assert!((depth - 0.502).abs() < 1e-6, "{depth}");
    }

    #[test]
    fn piles_may_be_cut_anywhere() {
        let samples: Vec<Sample> = (0..600u32)
            .map(|i| {
                let pixel = i.wrapping_mul(2_654_435_761) % 54;
                Sample { pixel, ..sample(i / 100, 0.1 + (i % 7) as f32 * 0.02, (i % 251) as u8, (i % 13) as f32) }
            })
            .collect();
        for rule in [MergeRule::Average, MergeRule::SmallerArea, MergeRule::ColorsApart] {
            let of = |cuts: &[usize]| {
                let mut cube = LayerCube::new(3, rule, 0.015);
                let mut start = 0;
                for &end in cuts {
                    cube.add(&[RowSamples::new(&samples[start..end], 3)]);
                    start = end;
                }
                cube.finish()
            };
            assert_eq!(of(&[600]), of(&[1, 77, 300, 301, 600]), "{rule:?}");
            let mut cube = LayerCube::new(3, rule, 0.015);
            cube.add(&[RowSamples::new(&samples[..250], 3), RowSamples::new(&samples[250..], 3)]);
            assert_eq!(of(&[600]), cube.finish(), "{rule:?}");
        }
    }
}
