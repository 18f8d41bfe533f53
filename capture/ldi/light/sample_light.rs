//! Takes the light samples of the surface samples of a face.
//!
//! Soft light is pooled over surfaces ([`super::pool`]). A surface sample in the middle of a wall
//! shares light samples with thousands of neighbours and hardly ever takes one of its own; one on a
//! leaf takes them all. A first round of few light samples measures how far light can be pooled
//! about each surface sample, and its variance; the rest go where the remaining error would show.
//! Radiance beyond a light sample's first ray is shared by all light samples of a round that arrive
//! in one cell of space ([`Arrival`]). Sunlight is sampled by [`super::sunlight`].

use super::cell_radiance::{PartialSample, SampledRow};
use super::pool::{
    BlockSurvey, BlockWindows, Blocks, ClassStatistics, GatheredLight, NormalGradients,
    PooledLight, Pooling,
};
use super::sampling_area::{SamplingArea, beside_steps};
use super::shade::{Shader, SurfaceSample};
use crate::surfaces::distribute::{SampleRange, distribute_samples};
use crate::surfaces::rows::{self, Row};
use crate::surfaces::surface_samples::FaceSurfaces;
use glam::Vec3;
use headbox_core::color::luminance;
use headbox_core::cube_face::Face;
use headbox_core::progress::Progress;
use headbox_trace::light::{Arrival, LightSample, LitPoint, srgb_slope};
use headbox_trace::sampler::random4;
use rayon::prelude::*;

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
    /// The gathered light of each surface sample, with smooth shading that at its plane normal.
    pub(crate) gathered: Vec<GatheredLight>,
    blocks: Blocks,
    /// Gradients, if the scene has smoothly shaded surfaces.
    gradients: Option<NormalGradients>,
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
        beside_steps: beside_steps(surfaces),
    };
    light.light_by_sun(surfaces);
    light.sample_soft(surfaces)
}

/// Pools the light samples of all faces (in their order) for one face, and sets
/// [`SurfaceSample::soft`]. Drops the face's own gathered samples.
pub(crate) fn pool_light(
    surfaces: &mut FaceSurfaces,
    face: Face,
    shader: &Shader,
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
    let pooling = Pooling::new(surfaces, face);
    let gradients = samples[face.index()].gradients.as_ref();
    let factors = gradients.map(|it| it.factors(&pooling, face, shader));
    let pooled = pooling.pool(gathered, &windows, &classes.variances());
    for (i, (sample, pooled)) in surfaces.samples.iter_mut().zip(pooled).enumerate() {
        sample.soft = pooled.light * factors.as_ref().map_or(1.0, |factors| factors[i]);
    }
}

/// Lighting of one face.
pub(super) struct FaceLight<'a> {
    pub(super) face: Face,
    pub(super) shader: &'a Shader<'a>,
    pub(super) size_px: u32,
    pub(super) progress: &'a dyn Progress,
    /// For each sample of the face, true if it is [beside a step](beside_steps).
    pub(super) beside_steps: Vec<bool>,
}

/// Limits of the number of light samples of a surface sample.
#[derive(Clone, Copy)]
struct SampleLimits {
    /// Maximum for a small error.
    max: f32,
    /// Maximum against blotches.
    blotched: f32,
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
    /// `all`, its index, its pixel, and the results of its row. Returns these, row after row. Each
    /// row advances the progress by `steps`.
    pub(super) fn for_each_surface<P: Send, R: Default + Send>(
        &self,
        offsets: &[u32],
        all: &mut [P],
        steps: u64,
        visit: impl Fn(&mut P, usize, [u32; 2], &mut R) + Sync,
    ) -> Vec<R> {
        let size = self.size_px;
        let visit_row = |(y, (first, row)): (usize, Row<P>)| {
            let mut results = R::default();
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

    /// The area over which the light of a sample is taken; `i` is its index, and (x, y) its pixel.
    pub(super) fn sampling_area<'s>(
        &'s self,
        sample: &'s SurfaceSample,
        i: usize,
        [x, y]: [u32; 2],
        offsets: &[u32],
    ) -> SamplingArea<'s> {
        let pixel = y as usize * self.size_px as usize + x as usize;
        let tracer = self.shader.capture.tracer;
        SamplingArea {
            tracer,
            spec: self.shader.capture.spec,
            sample,
            triangle: tracer.triangle(sample.primitive),
            representative: self.shader.representative(sample),
            is_alone: offsets[pixel + 1] - offsets[pixel] == 1,
            is_beside_step: self.beside_steps[i],
        }
    }

    /// Samples soft light: all light except that straight from the sun.
    fn sample_soft(&self, surfaces: &FaceSurfaces) -> FaceLightSamples {
        let light_samples = self.shader.light_samples() as f32;
        let (mut blocks, membership) = Blocks::new(surfaces);
        let classes = surfaces.classes();
        let mut gathered = vec![GatheredLight::default(); surfaces.samples.len()];
        let is_smooth = !self.shader.capture.tracer.scene().normals.is_empty();
        let mut gradients = vec![Vec3::ZERO; if is_smooth { gathered.len() } else { 0 }];
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
        self.gather(
            surfaces,
            &survey,
            0,
            ranges,
            (&mut gathered, &mut gradients),
        );
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
        self.gather(
            surfaces,
            &survey,
            1,
            ranges,
            (&mut gathered, &mut gradients),
        );
        let gradients = is_smooth.then(|| {
            let gradients =
                NormalGradients::new(blocks.clone(), &membership, &gathered, &gradients);
            let pooling = Pooling::new(surfaces, self.face);
            let factors = gradients.factors(&pooling, self.face, self.shader);
            for (gathered, factor) in gathered.iter_mut().zip(factors) {
                gathered.scale(1.0 / factor);
            }
            gradients
        });
        blocks.fill(&membership, &gathered);
        FaceLightSamples {
            classes: ClassStatistics::new(&classes, &gathered),
            gathered,
            blocks,
            gradients,
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
    /// Adds their gradients, unless that list is empty.
    fn gather(
        &self,
        surfaces: &FaceSurfaces,
        survey: &BlockSurvey,
        round: u32,
        ranges: Vec<SampleRange>,
        (gathered, gradients): (&mut [GatheredLight], &mut [Vec3]),
    ) {
        let tracer = self.shader.capture.tracer;
        let lighting = self.shader.capture.lighting;
        let begin =
            |gathered: &mut GatheredLight, i: usize, pixel: [u32; 2], row: &mut SampledRow| {
                let surface = &surfaces.samples[i];
                let SampleRange { first, count } = ranges[i];
                if count == 0 {
                    return;
                }
                let area = self.sampling_area(surface, i, pixel, &surfaces.offsets);
                let stream = self.stream(surface, 0x50f7 + round);
                let mut gradient = Vec3::ZERO;
                for number in 0..count {
                    let sample = LightSample {
                        stream,
                        index: first.wrapping_add(number),
                    };
                    let point = area.point(&sample, self.face, pixel, self.size_px);
                    let first = lighting.first_segment(tracer, &point, &sample);
                    gradient += first.gradient;
                    let Some(arrival) = first.arrival else {
                        gathered.add(first.light * lighting.exposure);
                        continue;
                    };
                    gathered.nearness += arrival.weight / arrival.distance_m.max(survey.width_m(i));
                    match arrival.cell() {
                        Some(cell) => row.partial.push(PartialSample {
                            surface: i as u32,
                            cell,
                            before: first.light,
                            arrival,
                        }),
                        None => {
                            let beyond =
                                arrival.contribution(lighting.beyond(tracer, &arrival, &sample));
                            gradient += arrival_gradient(&point, &arrival, beyond);
                            gathered.add((first.light + beyond) * lighting.exposure);
                        }
                    }
                }
                if gradient != Vec3::ZERO {
                    row.gradients.push((i as u32, gradient * lighting.exposure));
                }
                gathered.samples += count as f32;
            };
        let rows = self.for_each_surface(&surfaces.offsets, gathered, 1, begin);
        let beyond = self.light_beyond(round, &rows);
        let finished = rows.par_iter().zip(&beyond);
        let add = |((first, gathered), (row, beyond)): (
            Row<GatheredLight>,
            (&SampledRow, &Vec<Vec3>),
        )| {
            for (partial, beyond) in row.partial.iter().zip(beyond) {
                let light = partial.before + partial.arrival.contribution(*beyond);
                gathered[partial.surface as usize - first].add(light * lighting.exposure);
            }
        };
        let gathered = rows::split_rows(&surfaces.offsets, self.size_px, gathered);
        gathered.into_par_iter().zip(finished.clone()).for_each(add);
        if gradients.is_empty() {
            return;
        }
        let add_gradients =
            |((first, gradients), (row, beyond)): (Row<Vec3>, (&SampledRow, &Vec<Vec3>))| {
                for &(surface, gradient) in &row.gradients {
                    gradients[surface as usize - first] += gradient;
                }
                for (partial, beyond) in row.partial.iter().zip(beyond) {
                    let surface = &surfaces.samples[partial.surface as usize];
                    let point = self.shader.representative(surface);
                    let light = partial.arrival.contribution(*beyond) * lighting.exposure;
                    gradients[partial.surface as usize - first] +=
                        arrival_gradient(&point, &partial.arrival, light);
                }
            };
        let gradients = rows::split_rows(&surfaces.offsets, self.size_px, gradients);
        gradients
            .into_par_iter()
            .zip(finished)
            .for_each(add_gradients);
    }

    /// The random stream that the light samples of one kind share on all surface samples of a
    /// class.
    fn stream(&self, surface: &SurfaceSample, kind: u32) -> u32 {
        random4([self.face.index() as u32, u32::from(surface.class), kind, 1])[0]
    }
}

/// Gradient of light that reaches a point from an arrival.
fn arrival_gradient(point: &LitPoint, arrival: &Arrival, light: Vec3) -> Vec3 {
    let direction = (arrival.position() - point.position).normalize_or_zero();
    point.normal_gradient(light, direction)
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
            beside_steps: Vec::new(),
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
