//! Merges samples of many images, or of rays, pixel by pixel into layers (S12, R11, P2, D1, D2,
//! C11).
//!
//! *Similar depth* is measured in inverse depth, so that it needs no tuning per model (D2). Samples
//! are merged image by image, in this order on any number of threads.

use super::free_space::FreeSpace;
use super::row_samples::{ImageSample, RowSamples};
use crate::merge::clusters::SAME_COLOR_LEVELS;
use crate::surfaces::rows::split_lengths;
use glam::{DVec3, Vec3};
use headbox_core::color::srgb_table::encode_srgb;
use headbox_core::cube_face::Face;
use headbox_cube::model::parameters::MergeRule;
use headbox_cube::model::samples::{DepthPixel, EncodedNormal, LayeredDepthImage};
use rayon::prelude::*;

/// A depth pixel that samples are being merged into.
#[derive(Clone, Copy, Debug)]
struct Layer {
    inverse_depth: f32,
    normal: EncodedNormal,
    /// Linear colour.
    color: Vec3,
    weight: f32,
    area: f32,
    /// The last image with a sample in the layer, and the number of images that have one.
    image: u32,
    images: u32,
    /// The previous layer of its pixel, or [`NONE`].
    next: u32,
}

/// End of a list of layers.
const NONE: u32 = u32::MAX;

/// The layers of a cube that samples are being merged into.
pub struct LayerCube {
    face_px: u32,
    policy: MergePolicy,
    /// Layers of each row of each face.
    rows: Vec<LayerRow>,
}

/// Policy for merging samples of one pixel.
#[derive(Clone, Copy)]
struct MergePolicy {
    rule: MergeRule,
    /// Difference of inverse depths that counts as similar, 1/m.
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
    /// An empty cube. Inverse depths that differ by at most `tolerance`, 1/m, count as similar.
    pub fn new(face_px: u32, rule: MergeRule, tolerance: f32) -> Self {
        let rows = vec![LayerRow::default(); 6 * face_px as usize];
        Self {
            face_px,
            policy: MergePolicy { rule, tolerance },
            rows,
        }
    }

    /// Merges batches of samples into the layers, in order. The layers do not depend on how samples
    /// are divided into batches.
    pub fn add(&mut self, batches: &[RowSamples]) {
        let face_px = self.face_px as usize;
        let policy = self.policy;
        self.rows
            .par_iter_mut()
            .enumerate()
            .for_each(|(number, row)| {
                if row.heads.is_empty() {
                    row.reserve(batches, number);
                }
                for batch in batches {
                    for samples in batch.row(number) {
                        row.add(samples, batch.image, policy, face_px);
                    }
                }
            });
    }

    /// Drops layers in front of others that more images show, if more images see through them than
    /// show them. `centre`: that of the cube, world metres; `tolerance`: of inverse depth, 1/m.
    pub(super) fn drop_contradicted(&mut self, views: &[FreeSpace], centre: DVec3, tolerance: f32) {
        let face_px = self.face_px;
        let drop_from_row = |(number, row): (usize, &mut LayerRow)| {
            let (face, y) = (number / face_px as usize, number % face_px as usize);
            let Some(face) = Face::ALL.get(face) else {
                return;
            };
            row.retain(|x, layer| {
                let ray = face.direction(x as f64 + 0.5, y as f64 + 0.5, face_px);
                let point = centre + ray / f64::from(layer.inverse_depth);
                let contradicting = views.iter().filter(|view| view.contains(point, tolerance));
                contradicting.count() <= layer.images as usize
            });
        };
        self.rows.par_iter_mut().enumerate().for_each(drop_from_row);
    }

    /// Memory of the faces that [`Self::finish`] returns, bytes.
    pub(super) fn finished_bytes(&self) -> usize {
        let offsets = size_of::<u32>() * 6 * (self.face_px as usize).pow(2);
        let layers: usize = self.rows.iter().map(|row| row.layers.len()).sum();
        offsets + size_of::<DepthPixel>() * layers
    }

    /// The six faces.
    pub fn finish(self) -> Vec<LayeredDepthImage> {
        let side = self.face_px as usize;
        let finish_face = |(&face, rows): (&Face, &[LayerRow])| {
            let mut image = LayeredDepthImage::empty(face, self.face_px);
            let total = rows.iter().map(|row| row.layers.len()).sum();
            let unset = DepthPixel {
                inverse_depth: 0.0,
                normal: EncodedNormal::Z,
                color_srgb: [0; 4],
            };
            image.samples = vec![unset; total];
            let places = split_lengths(&mut image.samples, rows.iter().map(|row| row.layers.len()));
            let mut before = 0;
            let mut pending = Vec::with_capacity(side);
            for ((row, samples), ends) in rows
                .iter()
                .zip(places)
                .zip(image.offsets[1..].chunks_exact_mut(side))
            {
                pending.push((row, ends, before, samples));
                before += row.layers.len() as u32;
            }
            pending
                .into_par_iter()
                .for_each(|(row, ends, before, samples)| row.finish(before, ends, samples));
            image
        };
        Face::ALL
            .par_iter()
            .zip(self.rows.par_chunks(side))
            .map(finish_face)
            .collect()
    }
}

/// Returns the memory of the layers for samples if none of them merge, bytes.
pub(super) fn max_layer_bytes(batches: &[RowSamples]) -> usize {
    let counts = batches.iter().map(RowSamples::max_count);
    size_of::<Layer>() * counts.sum::<usize>()
}

impl LayerRow {
    /// Reserves memory for the first image's samples of row `number`. Most later samples merge with
    /// these, because other images see the same surfaces.
    fn reserve(&mut self, batches: &[RowSamples], number: usize) {
        let Some(image) = batches.first().map(|batch| batch.image) else {
            return;
        };
        let first_image = batches.iter().take_while(|batch| batch.image == image);
        let count: usize = first_image
            .flat_map(|batch| batch.row(number))
            .map(<[ImageSample]>::len)
            .sum();
        self.layers.reserve(count + count / 2);
    }

    /// Merges samples of an image into the layers.
    fn add(&mut self, samples: &[ImageSample], image: u32, policy: MergePolicy, face_px: usize) {
        if self.heads.is_empty() {
            self.heads = vec![NONE; face_px];
        }
        for sample in samples {
            let Some(head) = self.heads.get_mut(sample.column as usize) else {
                continue;
            };
            insert(&mut self.layers, head, sample, image, policy);
        }
    }

    /// Keeps the layers behind which no layer is of more images, and those of a column for which
    /// `is_kept` returns true.
    fn retain(&mut self, is_kept: impl Fn(usize, &Layer) -> bool) {
        let mut kept = Vec::with_capacity(self.layers.len());
        let mut pixel = Vec::new();
        for (column, head) in self.heads.iter_mut().enumerate() {
            let mut index = std::mem::replace(head, NONE);
            pixel.clear();
            while let Some(layer) = self.layers.get(index as usize) {
                pixel.push(*layer);
                index = layer.next;
            }
            for layer in pixel.iter().rev() {
                let is_behind = |other: &Layer| other.inverse_depth < layer.inverse_depth;
                let is_doubtful = pixel
                    .iter()
                    .any(|other| is_behind(other) && other.images > layer.images);
                if !is_doubtful || is_kept(column, layer) {
                    let next = std::mem::replace(head, kept.len() as u32);
                    kept.push(Layer { next, ..*layer });
                }
            }
        }
        self.layers = kept;
    }

    /// Writes depth pixels, by pixel and farthest first, and the end offset of each pixel; `before`
    /// is the number of depth pixels before the row.
    fn finish(&self, before: u32, ends: &mut [u32], samples: &mut [DepthPixel]) {
        let mut done = 0;
        let mut pixel = Vec::new();
        if self.heads.is_empty() {
            ends.fill(before);
            return;
        }
        for (&head, end) in self.heads.iter().zip(ends) {
            pixel.clear();
            let mut index = head;
            while let Some(layer) = self.layers.get(index as usize) {
                pixel.push(layer);
                index = layer.next;
            }
            if pixel.len() > 1 {
                pixel.reverse();
                pixel.sort_by(|a, b| a.inverse_depth.total_cmp(&b.inverse_depth));
            }
            for layer in &pixel {
                samples[done] = layer.finish();
                done += 1;
            }
            *end = before + done as u32;
        }
    }
}

/// Adds a sample to the layers of its pixel, of which the last is `head`. Samples must be added
/// image by image, the central one first.
#[inline]
fn insert(
    layers: &mut Vec<Layer>,
    head: &mut u32,
    sample: &ImageSample,
    image: u32,
    policy: MergePolicy,
) {
    let mut nearest = NONE;
    let mut least = policy.tolerance;
    let mut index = *head;
    while let Some(layer) = layers.get(index as usize) {
        let difference = (layer.inverse_depth - sample.inverse_depth).abs();
        // On a tie, the earliest layer wins; it comes last in the list.
        if difference <= least {
            nearest = index;
            least = difference;
        }
        index = layer.next;
    }
    let mut push = |layers: &mut Vec<Layer>| {
        let last = std::mem::replace(head, layers.len() as u32);
        layers.push(Layer::new(sample, image, last));
    };
    let Some(layer) = layers.get_mut(nearest as usize) else {
        return push(layers);
    };
    match policy.rule {
        MergeRule::Average => layer.average(sample, image),
        // All samples of one image are kept: they are of a surface nearly parallel to the pixel's
        // ray. Those of the central image are never replaced.
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
    fn new(sample: &ImageSample, image: u32, next: u32) -> Self {
        let &ImageSample {
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
            images: 1,
            next,
        }
    }

    fn average(&mut self, sample: &ImageSample, image: u32) {
        self.images += u32::from(self.image != image);
        self.image = image;
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
    use super::super::row_samples::LinearColor16;
    use super::*;
    use headbox_core::color::linear_from_srgb8;
    use headbox_fixtures::plane_view;

    /// An image number and a sample.
    type NumberedSample = (u32, ImageSample);

    fn sample(image: u32, inverse_depth: f32, grey: u8, area: f32) -> NumberedSample {
        let color = LinearColor16::new(Vec3::splat(linear_from_srgb8(grey)));
        (
            image,
            ImageSample {
                inverse_depth,
                color,
                weight: 1.0,
                area,
                ..ImageSample::NONE
            },
        )
    }

    /// A batch for each run of samples of one image, of a cube of `face_px` pixels along a side;
    /// `column` holds the number of the pixel.
    fn batches(samples: &[NumberedSample], face_px: u32) -> Vec<RowSamples> {
        let batch = |run: &[NumberedSample]| {
            let mut batch = RowSamples::new(face_px, run[0].0);
            for &(_, sample) in run {
                let pixel = u32::from(sample.column);
                let column = (pixel % face_px) as u16;
                batch.push(pixel / face_px, ImageSample { column, ..sample });
            }
            batch
        };
        samples.chunk_by(|a, b| a.0 == b.0).map(batch).collect()
    }

    fn merge(rule: MergeRule, samples: &[NumberedSample]) -> Vec<(f32, u8)> {
        let mut cube = LayerCube::new(1, rule, 0.01);
        cube.add(&batches(samples, 1));
        let faces = cube.finish();
        faces[0]
            .samples
            .iter()
            .map(|layer| (layer.inverse_depth, layer.color_srgb[0]))
            .collect()
    }

    #[test]
    fn merge_rules_follow_the_papers() {
        let near_and_far = [sample(0, 0.5, 100, 1.0), sample(1, 0.2, 200, 1.0)];
        for rule in [
            MergeRule::Average,
            MergeRule::SmallerArea,
            MergeRule::ColorsApart,
        ] {
            assert_eq!(
                merge(rule, &near_and_far),
                [(0.2, 200), (0.5, 100)],
                "{rule:?}: different depths never meet"
            );
        }
        let pinned = sample(0, 0.5, 10, 3.0);
        let better = sample(1, 0.504, 30, 1.0);
        let same = sample(1, 0.502, 30, 2.0);
        assert_eq!(
            merge(MergeRule::SmallerArea, &[pinned, better]),
            [(0.5, 10)],
            "the central image stays"
        );
        assert_eq!(
            merge(MergeRule::SmallerArea, &[same, sample(2, 0.5, 40, 1.0)]),
            [(0.5, 40)],
            "smaller area"
        );
        assert_eq!(
            merge(MergeRule::SmallerArea, &[sample(2, 0.5, 40, 1.0), same]),
            [(0.5, 40)],
            "in either order"
        );
        assert_eq!(
            merge(MergeRule::SmallerArea, &[same, better]).len(),
            2,
            "one image keeps all of its samples"
        );
        assert_eq!(
            merge(MergeRule::ColorsApart, &[pinned, sample(1, 0.504, 12, 1.0)]),
            [(0.5, 10)],
            "the first stays"
        );
        assert_eq!(
            merge(MergeRule::ColorsApart, &[pinned, better]).len(),
            2,
            "unless colours differ"
        );
        let [(depth, _)] = merge(MergeRule::Average, &[pinned, better])[..] else {
            panic!("one layer")
        };
        assert!((depth - 0.502).abs() < 1e-6, "{depth}");
    }

    #[test]
    fn layers_that_more_images_see_through_are_dropped() {
        const MINUS_Z: u16 = 5;
        let at = |(image, inverse_depth)| {
            let (image, sample) = sample(image, inverse_depth, 90, 1.0);
            let column = MINUS_Z;
            (image, ImageSample { column, ..sample })
        };
        let view = |distance| FreeSpace::new(&plane_view(DVec3::ZERO, distance, [48, 36]));
        let kept = |samples: &[(u32, f32)], distances: &[f64]| -> Vec<f32> {
            let samples: Vec<NumberedSample> = samples.iter().copied().map(at).collect();
            let views: Vec<FreeSpace> = distances.iter().copied().map(view).collect();
            let mut cube = LayerCube::new(1, MergeRule::Average, 0.01);
            cube.add(&batches(&samples, 1));
            cube.drop_contradicted(&views, DVec3::ZERO, 0.01);
            let face = &cube.finish()[usize::from(MINUS_Z)];
            face.samples.iter().map(|it| it.inverse_depth).collect()
        };
        let floating = [(0, 1.0), (1, 0.25), (2, 0.25)];
        assert_eq!(kept(&floating, &[1.0, 4.0, 4.0]), [0.25]);
        assert_eq!(
            kept(&floating, &[1.0, 4.0, 1.0]),
            [0.25, 1.0],
            "one against one"
        );
        assert_eq!(
            kept(&floating, &[1.0, 1.0, 1.0]),
            [0.25, 1.0],
            "not seen through"
        );
        let both = [(0, 1.0), (1, 1.0), (2, 0.25), (3, 0.25)];
        assert_eq!(
            kept(&both, &[4.0; 4]),
            [0.25, 1.0],
            "as many images show it as the other"
        );
        let many_in_one = [(0, 1.0), (0, 1.0), (0, 1.0), (1, 0.25), (2, 0.25)];
        assert_eq!(
            kept(&many_in_one, &[1.0, 4.0, 4.0]),
            [0.25],
            "images count, not samples"
        );
    }

    #[test]
    fn layers_are_independent_of_batches() {
        let samples: Vec<NumberedSample> = (0..600u32)
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
                    ImageSample {
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
            let merge_cut = |cuts: &[usize]| {
                let mut cube = LayerCube::new(3, rule, 0.015);
                let mut start = 0;
                for &end in cuts {
                    cube.add(&batches(&samples[start..end], 3));
                    start = end;
                }
                cube.finish()
            };
            let whole = merge_cut(&[600]);
            assert_eq!(whole, merge_cut(&[1, 77, 300, 301, 600]), "{rule:?}");
            let mut cube = LayerCube::new(3, rule, 0.015);
            cube.add(
                &[batches(&samples[..250], 3), batches(&samples[250..], 3)]
                    .into_iter()
                    .flatten()
                    .collect::<Vec<_>>(),
            );
            assert_eq!(whole, cube.finish(), "{rule:?}");
        }
    }
}
