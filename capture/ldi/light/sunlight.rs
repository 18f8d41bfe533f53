//! Takes the samples of the sun and other sharp lights: one everywhere, and more where neighbours
//! on one surface disagree on it, which is at the edges of its shadows.

use super::pool::same_surface;
use super::sample_light::FaceLight;
use super::shade::SurfaceSample;
use crate::surfaces::rows::{self, Row};
use crate::surfaces::surface_samples::FaceSurfaces;
use glam::Vec3;
use headbox_core::color::luminance;
use headbox_trace::light::{LightSample, LitPoint};
use headbox_trace::sampler::random4;
use rayon::prelude::*;

/// Number of samples of the sun at the edge of a shadow, as a multiple of the light samples of a
/// depth pixel.
const SUN_AT_EDGE: u32 = 2;

/// Number of neighbours on its surface that a sample needs to detect the edge of a shadow.
const ENOUGH_NEIGHBOURS: u32 = 4;

/// A requested sample of the sun: the index of its surface sample, the point and the sample.
type SunRequest = (u32, (LitPoint, LightSample));

impl FaceLight<'_> {
    /// Sets [`SurfaceSample::sun`] of all surface samples, if the scene has sharp light.
    pub(super) fn light_by_sun(&self, surfaces: &mut FaceSurfaces) {
        if !self.shader.capture.lighting.has_sharp_light() {
            return;
        }
        self.sample_sun(surfaces, 0, |_| 1);
        let edges = self.count_edge_samples(surfaces);
        self.sample_sun(surfaces, 1, |i| edges[i]);
    }

    /// Sample `number` of `count` of the sun for a surface sample in pixel (x, y). Surface samples
    /// of one class with the same count share a sequence.
    fn sun_sample(
        &self,
        surface: &SurfaceSample,
        [x, y]: [u32; 2],
        before: u32,
        number: u32,
        count: u32,
    ) -> LightSample {
        let [stream, ..] = random4([
            self.face.index() as u32,
            u32::from(surface.class),
            0x5111 + before,
            count,
        ]);
        LightSample {
            stream,
            index: morton(x, y).wrapping_mul(count).wrapping_add(number),
        }
    }

    /// Takes `count` samples of the sun at each surface sample, by its index, in addition to
    /// `before`.
    fn sample_sun(
        &self,
        surfaces: &mut FaceSurfaces,
        before: u32,
        count: impl Fn(usize) -> u32 + Sync,
    ) {
        let tracer = self.shader.capture.tracer;
        let lighting = self.shader.capture.lighting;
        let offsets = &surfaces.offsets;
        let request = |surface: &mut SurfaceSample,
                       i: usize,
                       pixel: [u32; 2],
                       requests: &mut Vec<SunRequest>| {
            let more = count(i);
            if more == 0 {
                return;
            }
            let area = self.sampling_area(surface, i, pixel, offsets);
            for number in 0..more {
                let sample = self.sun_sample(surface, pixel, before, number, more);
                let point = area.point(&sample, self.face, pixel, self.size_px);
                requests.push((i as u32, (point, sample)));
            }
        };
        let rows = self.for_each_surface(offsets, &mut surfaces.samples, 0, request);
        let light_row = |(row, (first, surfaces)): (Vec<SunRequest>, Row<SurfaceSample>)| {
            let (indices, requests): (Vec<u32>, Vec<_>) = row.into_iter().unzip();
            let mut light = &*lighting.sharp_radiosities(tracer, &requests);
            for same in indices.chunk_by(|a, b| a == b) {
                let surface = &mut surfaces[same[0] as usize - first];
                let taken = same.len() as u32;
                let (own_light, rest) = light.split_at(same.len());
                let share_before = before as f32 / (before + taken) as f32;
                surface.sun = surface.sun * share_before
                    + own_light.iter().sum::<Vec3>()
                        * (lighting.exposure / (before + taken) as f32);
                light = rest;
            }
        };
        let surfaces = rows::split_rows(&surfaces.offsets, self.size_px, &mut surfaces.samples);
        rows.into_par_iter().zip(surfaces).for_each(light_row);
    }

    /// Number of additional samples of the sun that each surface sample needs.
    fn count_edge_samples(&self, surfaces: &FaceSurfaces) -> Vec<u32> {
        let size = self.size_px;
        let light_samples = self.shader.light_samples();
        let row = |y: u32| {
            let window = |c: u32| c.saturating_sub(1)..(c + 2).min(size);
            let mut counts = Vec::new();
            for x in 0..size {
                for surface in surfaces.pixel(x, y) {
                    let level = luminance(surface.sun.to_array());
                    let mut low = level;
                    let mut high = level;
                    let mut neighbours = 0;
                    for other in window(y)
                        .flat_map(|ny| window(x).flat_map(move |nx| surfaces.pixel(nx, ny)))
                    {
                        if same_surface(surface, other) {
                            let level = luminance(other.sun.to_array());
                            low = low.min(level);
                            high = high.max(level);
                            neighbours += 1;
                        }
                    }
                    // On one surface, only a shadow changes the sun by a quarter from pixel to
                    // pixel.
                    counts.push(if low < 0.75 * high {
                        (SUN_AT_EDGE * light_samples).saturating_sub(1)
                    } else if neighbours <= ENOUGH_NEIGHBOURS {
                        light_samples.saturating_sub(1)
                    } else {
                        0
                    });
                }
            }
            counts
        };
        let rows: Vec<Vec<u32>> = (0..size).into_par_iter().map(row).collect();
        rows.concat()
    }
}

/// The index of pixel (x, y) on the Morton curve.
fn morton(x: u32, y: u32) -> u32 {
    let spread = |mut c: u32| {
        c = (c | c << 8) & 0x00ff_00ff;
        c = (c | c << 4) & 0x0f0f_0f0f;
        c = (c | c << 2) & 0x3333_3333;
        (c | c << 1) & 0x5555_5555
    };
    spread(x) | spread(y) << 1
}
