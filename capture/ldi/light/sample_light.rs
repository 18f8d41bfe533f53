//! Takes the light samples of the surface samples of a face.
//!
//! Soft light is pooled over surfaces ([`super::pool`]). A surface sample in the middle of a wall
//! shares light samples with thousands of neighbours and hardly ever takes one of its own; one on a
//! leaf takes them all. A first round of few light samples measures how far light can be pooled
//! about each surface sample, and its variance; the rest go where the remaining error would show.
//! Radiance beyond a light sample's first ray is shared by all light samples of a round that arrive
//! in one cell of space ([`Arrival`]). Sunlight is sampled by [`super::sunlight`].

use super::pool::{
    BlockSurvey, BlockWindows, Blocks, ClassStatistics, GatheredLight, PooledLight, Pooling,
};
use super::shade::{Shader, SurfaceSample};
use crate::surfaces::distribute::{SampleRange, distribute_samples};
use crate::surfaces::rows::{self, Row};
use crate::surfaces::surface_samples::FaceSurfaces;
use glam::Vec3;
use headbox_core::color::luminance;
use headbox_core::cube_face::Face;
use headbox_core::progress::Progress;
use headbox_trace::light::{Arrival, LightSample, srgb_slope};
use headbox_trace::sampler::random4;
use rayon::prelude::*;
use std::sync::atomic::{AtomicU32, Ordering};

/// Maximum number of samples of the radiance beyond a cell of arrivals.
const MAX_CELL_SAMPLES: usize = 8;

/// Number of rounds of soft light; each advances the progress by the rows of the face.
pub(crate) const ROUNDS: u64 = 2;

/// Number of samples of the first round in the widest window, as a multiple of the light samples of
/// a depth pixel.
const FIRST_ROUND: f32 = 32.0;

/// Error of a colour, sRGB levels, at which no more samples are taken with one light sample per
/// depth pixel; with more, it falls with the root of their number.
const ENOUGH_LEVELS: f32 = 0.5;

/// Error of the colour of a surface without texture, sRGB levels, above which blotches are visible
/// and more samples are taken than elsewhere; scaled like [`ENOUGH_LEVELS`]. Textures mask them.
const BLOTCH_LEVELS: f32 = 1.6;

/// Maximum number of samples of a depth pixel against blotches where its surface fills its window,
/// as a multiple of the light samples of a depth pixel, for each pixel of the width of a face; in
/// proportion less where it fills less. The rehearsal of a capture, whose faces are narrow, takes
/// no more samples than without it.
const BLOTCH_SAMPLES: f32 = 2.5 / 1024.0;

/// The gathered light samples of a face.
pub(crate) struct FaceLightSamples {
    /// The gathered light of each surface sample.
    pub(crate) gathered: Vec<GatheredLight>,
    blocks: Blocks,
    classes: ClassStatistics,
}

/// Takes the light samples of a face and sets [`SurfaceSample::sun`]. Returns early, with a result
/// that must not be used, if the capture is cancelled.
pub(crate) fn sample_light(
    surfaces: &mut FaceSurfaces,
    face: Face,
    shader: &Shader,
) -> FaceLightSamples {
    let light = FaceLight {
        face,
        shader,
        size_px: surfaces.size_px,
        progress: shader.capture.options.progress,
    };
    light.light_by_sun(surfaces);
    light.sample_soft(surfaces)
}

/// Pools the light samples of all faces (in their order) for one face, and sets
/// [`SurfaceSample::soft`]. Drops the face's own gathered samples.
pub(crate) fn pool_light(
    surfaces: &mut FaceSurfaces,
    face: Face,
    samples: &mut [FaceLightSamples],
) {
    let gathered = std::mem::take(&mut samples[face.index()].gathered);
    let blocks = Face::ALL.map(|face| samples.get(face.index()).map(|light| &light.blocks));
    let own_blocks = &samples[face.index()].blocks;
    let windows = BlockWindows::new(face, surfaces.size_px, own_blocks, blocks);
    let mut classes = ClassStatistics::default();
    for light in samples.iter() {
        classes.absorb(&light.classes);
    }
    let pooled = Pooling::new(surfaces, face).pool(gathered, &windows, &classes.variances());
    for (sample, pooled) in surfaces.samples.iter_mut().zip(pooled) {
        sample.soft = pooled.light;
    }
}

/// Lighting of one face.
pub(super) struct FaceLight<'a> {
    pub(super) face: Face,
    pub(super) shader: &'a Shader<'a>,
    pub(super) size_px: u32,
    progress: &'a dyn Progress,
}

/// Limits of the number of light samples of a surface sample.
#[derive(Clone, Copy)]
struct SampleLimits {
    /// Maximum for a small error.
    max: f32,
    /// Maximum against blotches.
    blotched: f32,
}

/// A light sample after its first ray.
struct PartialSample {
    /// Index of the surface sample.
    surface: u32,
    /// See [`Arrival::cell`].
    cell: u64,
    /// Light gathered before the arrival.
    before: Vec3,
    arrival: Arrival,
}

impl GatheredLight {
    /// Adds an exposed light sample.
    fn add(&mut self, light: Vec3) {
        let level = luminance(light.to_array());
        self.light += light;
        self.squares += level * level;
    }
}

impl FaceLight<'_> {
    /// Calls `visit` for each surface sample of the face, rows in parallel, with its element of
    /// `all`, its index, its pixel, and a list for results. Returns the lists, row after row. Each
    /// row advances the progress by `steps`.
    pub(super) fn for_each_surface<P: Send, T: Send>(
        &self,
        offsets: &[u32],
        all: &mut [P],
        steps: u64,
        visit: impl Fn(&mut P, usize, [u32; 2], &mut Vec<T>) + Sync,
    ) -> Vec<Vec<T>> {
        let size = self.size_px;
        let visit_row = |(y, (first, row)): (usize, Row<P>)| {
            let mut results = Vec::new();
            let pixels = &offsets[y * size as usize..][..=size as usize];
            if self.progress.is_cancelled() {
                return results;
            }
            for (x, ends) in (0..).zip(pixels.windows(2)) {
                for i in ends[0] as usize..ends[1] as usize {
                    visit(&mut row[i - first], i, [x, y as u32], &mut results);
                }
            }
            self.progress.advance(steps);
            results
        };
        let rows = rows::split_rows(offsets, size, all);
        rows.into_par_iter().enumerate().map(visit_row).collect()
    }

    /// Samples soft light: all light except that straight from the sun.
    fn sample_soft(&self, surfaces: &FaceSurfaces) -> FaceLightSamples {
        let light_samples = self.shader.light_samples() as f32;
        let (mut blocks, membership) = Blocks::new(surfaces);
        let classes = surfaces.classes();
        let mut gathered = vec![GatheredLight::default(); surfaces.samples.len()];
        let windows =
            |blocks: &Blocks| BlockWindows::new(self.face, self.size_px, blocks, [None; 6]);
        let survey = BlockSurvey::new(
            self.face,
            self.size_px,
            &blocks,
            &windows(&blocks),
            &membership,
        );
        let first_round = FIRST_ROUND * light_samples;
        let requested: Vec<f32> = (0..surfaces.samples.len())
            .into_par_iter()
            .map(|i| (first_round / survey.widest(i)).min(1.0))
            .collect();
        let ranges = distribute_samples(surfaces, &classes, &requested);
        self.gather(surfaces, &survey, 0, ranges, &mut gathered);
        blocks.fill(&membership, &gathered);
        let variances = ClassStatistics::new(&classes, &gathered).variances();
        let pooled = survey.pool(&windows(&blocks), &variances);
        let request = |(i, sample): (usize, &SurfaceSample)| {
            let limits = SampleLimits {
                max: survey.max_samples(i, light_samples),
                blotched: self.blotch_limit(survey.share(i)),
            };
            self.missing_samples(sample, &pooled[survey.index(i)], limits)
        };
        let requested: Vec<f32> = surfaces
            .samples
            .par_iter()
            .enumerate()
            .map(request)
            .collect();
        let ranges = distribute_samples(surfaces, &classes, &requested);
        self.gather(surfaces, &survey, 1, ranges, &mut gathered);
        blocks.fill(&membership, &gathered);
        FaceLightSamples {
            classes: ClassStatistics::new(&classes, &gathered),
            gathered,
            blocks,
        }
    }

    /// Maximum number of samples against blotches of a surface that fills `share` of its window.
    fn blotch_limit(&self, share: f32) -> f32 {
        BLOTCH_SAMPLES * self.size_px as f32 * self.shader.light_samples() as f32 * share
    }

    /// Number of additional samples that bring the error of a colour down to [`ENOUGH_LEVELS`], or
    /// without texture at least to [`BLOTCH_LEVELS`], within the limits of each.
    fn missing_samples(
        &self,
        sample: &SurfaceSample,
        pooled: &PooledLight,
        limits: SampleLimits,
    ) -> f32 {
        let lit = SurfaceSample {
            soft: pooled.light,
            ..*sample
        };
        let shown = luminance(lit.color().to_array());
        let albedo = luminance(sample.albedo.map(|c| f32::from(c) / 65_535.0));
        // Variance of the colour with one light sample per surface sample, squared sRGB levels.
        let variance = (255.0 * albedo * srgb_slope(shown)).powi(2) * pooled.variance
            / pooled.support.max(1.0);
        let light_samples = self.shader.light_samples() as f32;
        let needed = |levels: f32| light_samples * variance / (levels * levels);
        let mut wanted = needed(ENOUGH_LEVELS).min(limits.max);
        let scene = self.shader.capture.tracer.scene();
        if scene.paint(sample.primitive).texture().is_none() {
            wanted = wanted.max(needed(BLOTCH_LEVELS).min(limits.blotched));
        }
        let taken = pooled.samples / pooled.support.max(1.0);
        (wanted - taken).max(0.0)
    }

    /// Takes the samples of soft light of a round: those of its range for each surface sample.
    fn gather(
        &self,
        surfaces: &FaceSurfaces,
        survey: &BlockSurvey,
        round: u32,
        ranges: Vec<SampleRange>,
        gathered: &mut [GatheredLight],
    ) {
        let tracer = self.shader.capture.tracer;
        let lighting = self.shader.capture.lighting;
        let begin = |gathered: &mut GatheredLight,
                     i: usize,
                     pixel: [u32; 2],
                     partial: &mut Vec<PartialSample>| {
            let surface = &surfaces.samples[i];
            let SampleRange { first, count } = ranges[i];
            if count == 0 {
                return;
            }
            let area = self.shader.sampling_area(surface);
            let stream = self.stream(surface, 0x50f7 + round);
            for number in 0..count {
                let sample = LightSample {
                    stream,
                    index: first.wrapping_add(number),
                };
                let point = area.point(&sample, self.face, pixel, self.size_px);
                let (before, arrival) = lighting.before(tracer, &point, &sample);
                let Some(arrival) = arrival else {
                    gathered.add(before * lighting.exposure);
                    continue;
                };
                gathered.nearness += arrival.weight / arrival.distance_m.max(survey.width_m(i));
                match arrival.cell() {
                    Some(cell) => partial.push(PartialSample {
                        surface: i as u32,
                        cell,
                        before,
                        arrival,
                    }),
                    None => {
                        let light = before
                            + arrival.contribution(lighting.beyond(tracer, &arrival, &sample));
                        gathered.add(light * lighting.exposure);
                    }
                }
            }
            gathered.samples += count as f32;
        };
        let rows = self.for_each_surface(&surfaces.offsets, gathered, 1, begin);
        let beyond = self.light_beyond(round, &rows);
        let add = |((first, gathered), (row, beyond)): (
            Row<GatheredLight>,
            (&Vec<PartialSample>, Vec<Vec3>),
        )| {
            for (partial, beyond) in row.iter().zip(beyond) {
                let light = partial.before + partial.arrival.contribution(beyond);
                gathered[partial.surface as usize - first].add(light * lighting.exposure);
            }
        };
        let gathered = rows::split_rows(&surfaces.offsets, self.size_px, gathered);
        gathered
            .into_par_iter()
            .zip(rows.par_iter().zip(beyond))
            .for_each(add);
    }

    /// The random stream that the light samples of one kind share on all surface samples of a
    /// class.
    fn stream(&self, surface: &SurfaceSample, kind: u32) -> u32 {
        random4([self.face.index() as u32, u32::from(surface.class), kind, 1])[0]
    }

    /// The radiance beyond the arrivals of the samples of each row, in a round.
    fn light_beyond(&self, round: u32, rows: &[Vec<PartialSample>]) -> Vec<Vec<Vec3>> {
        let tracer = self.shader.capture.tracer;
        let lighting = self.shader.capture.lighting;
        let mut count = 0;
        let mut firsts: Vec<u32> = Vec::with_capacity(rows.len());
        for row in rows {
            firsts.push(count);
            count += row.len() as u32;
        }
        let cell_keys = |(first, row): (&u32, &Vec<PartialSample>)| -> Vec<(u64, u32, u32)> {
            // Representatives of a cell are drawn in a fixed order that is unrelated to position.
            (*first..)
                .zip(row)
                .map(|(i, partial)| (partial.cell, i.wrapping_mul(0x9e37_79b9), i))
                .collect()
        };
        let cell_keys: Vec<Vec<_>> = firsts.par_iter().zip(rows).map(cell_keys).collect();
        let mut order = rows::concat(&cell_keys, |row| row);
        order.par_sort_unstable();
        let cells: Vec<&[(u64, u32, u32)]> = order.chunk_by(|a, b| a.0 == b.0).collect();
        // The cell of each sample, written by the thread that has the cell.
        let sample_cells: Vec<AtomicU32> = order.par_iter().map(|_| AtomicU32::new(0)).collect();
        let cell_light = |(number, cell): (usize, &&[(u64, u32, u32)])| {
            for &(_, _, i) in cell.iter() {
                sample_cells[i as usize].store(number as u32, Ordering::Relaxed);
            }
            if self.progress.is_cancelled() {
                return Vec3::ZERO;
            }
            // Copied first, so that the cache misses of the arrivals overlap.
            let mut drawn = [None; MAX_CELL_SAMPLES];
            for (arrival, &(_, _, i)) in drawn.iter_mut().zip(*cell) {
                let row = firsts.partition_point(|&first| first <= i) - 1;
                *arrival = Some(rows[row][(i - firsts[row]) as usize].arrival);
            }
            let [stream, ..] = random4([cell[0].0 as u32, (cell[0].0 >> 32) as u32, 0xce11, round]);
            let light = |(index, arrival): (u32, &Arrival)| {
                lighting.beyond(tracer, arrival, &LightSample { stream, index })
            };
            (0..).zip(drawn.iter().flatten()).map(light).sum::<Vec3>()
                / cell.len().min(MAX_CELL_SAMPLES) as f32
        };
        let light: Vec<Vec3> = cells.par_iter().enumerate().map(cell_light).collect();
        let sample_light_beyond =
            |i: usize| light[sample_cells[i].load(Ordering::Relaxed) as usize];
        let row_light = |(&first, row): (&u32, &Vec<PartialSample>)| {
            (first as usize..)
                .take(row.len())
                .map(sample_light_beyond)
                .collect()
        };
        firsts.par_iter().zip(rows).map(row_light).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::capture::SceneCapture;
    use crate::scene_source::SceneSource;
    use crate::spec::{CaptureSpec, RunOptions};
    use glam::{DVec3, Vec2, dvec3};
    use headbox_scene::material::{Material, Texture};
    use headbox_scene::scene::{Scene, Triangle};
    use headbox_trace::bvh::Tracer;
    use headbox_trace::light::Lighting;

    /// Requested samples of a grey surface, without texture and with one, whose light has
    /// `variance` after one sample per depth pixel of a window of 100.
    fn requested_samples(size_px: u32, variance: f32, share: f32) -> [f32; 2] {
        let scene = Scene {
            positions: vec![
                dvec3(-1.0, 0.0, -2.0),
                dvec3(1.0, 0.0, -2.0),
                dvec3(0.0, 1.0, -2.0),
            ],
            texcoords: vec![Vec2::ZERO; 3],
            triangles: [0, 1]
                .map(|material| Triangle {
                    vertices: [0, 1, 2],
                    material,
                })
                .to_vec(),
            materials: vec![
                Material::default(),
                Material {
                    albedo_texture: Some(0),
                    ..Material::default()
                },
            ],
            textures: vec![Texture::from_fn(2, 2, |_, _| [128; 4])],
            ..Scene::default()
        };
        let tracer = Tracer::new(std::sync::Arc::new(scene), DVec3::ZERO);
        let lighting = Lighting::unmetered(&tracer, 0);
        let mut spec = CaptureSpec::new(SceneSource::new("wall"), DVec3::ZERO, 0.5);
        spec.parameters.light_samples = 4;
        let options = RunOptions::default();
        let shader = Shader {
            capture: SceneCapture::new(&spec, &tracer, &lighting, &options),
            geometry_only: false,
        };
        let light = FaceLight {
            face: Face::NegZ,
            shader: &shader,
            size_px,
            progress: options.progress,
        };
        let pooled = PooledLight {
            light: Vec3::splat(0.4),
            variance,
            samples: 100.0,
            support: 100.0,
        };
        let limits = SampleLimits {
            max: 1.0,
            blotched: light.blotch_limit(share),
        };
        [0, 1].map(|primitive| {
            let sample = SurfaceSample {
                primitive,
                albedo: [32_768; 3],
                ..bytemuck::Zeroable::zeroed()
            };
            light.missing_samples(&sample, &pooled, limits)
        })
    }

    #[test]
    fn blotches_sampled_on_plain_surfaces_only() {
        // Light of 0.4 on an albedo of one half is shown with 255 * 0.5 * 1.12 levels per unit, so
        // that a variance of 0.1 over 100 samples is an error of 4.5 levels; 0.8 are wanted.
        let [plain, textured] = requested_samples(1024, 0.1, 1.0);
        assert_eq!(textured, 0.0, "has its one sample");
        assert_eq!(plain, 9.0, "the limit of 2.5 times four samples");
        let [plain, _] = requested_samples(1024, 0.01, 1.0);
        assert!((plain - 2.2).abs() < 0.2, "{plain}: by the error");
        let [plain, _] = requested_samples(1024, 0.1, 0.25);
        assert_eq!(plain, 1.5, "a quarter of the window");
        let [plain, _] = requested_samples(512, 0.1, 1.0);
        assert_eq!(plain, 4.0, "half as wide a face");
        assert_eq!(requested_samples(96, 0.1, 1.0), [0.0; 2], "a rehearsal");
        assert_eq!(requested_samples(1024, 1e-4, 1.0), [0.0; 2], "clean");
    }
}
