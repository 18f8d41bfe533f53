//! Shares of a pixel that the surfaces of a cluster cover.
//!
//! The number of rays that met a surface in a pixel is random. Where two surfaces of different
//! colours meet, their mean would vary from pixel to pixel, and a thin strip would be dashed. So
//! rays from the centre measure the shares there.

use super::centre_rays::CentreRays;
use crate::accumulate::accumulator::Accumulator;
use crate::capture::SceneCapture;
use crate::light::shade::SurfaceSample;
use headbox_core::color::tone::ToneMap;
use headbox_core::cube_face::Face;
use headbox_cube::model::depth_bins::DepthBins;
use headbox_trace::bvh::{PACKET, Tracer};

/// Minimum difference of two colours, sRGB levels, for the shares that they cover to be measured.
const MIN_DIFFERENCE: u8 = 8;

/// Minimum number of rays that must meet the surfaces of a cluster for their shares to count.
const ENOUGH_RAYS: u32 = 4;

/// Measurement of the shares on a face.
pub(crate) struct ShareMeasure<'a> {
    tracer: &'a Tracer,
    bins: DepthBins,
    rays: CentreRays,
    /// Half of the headbox's edge, metres: rays start where it ends.
    half_size_m: f32,
}

impl<'a> ShareMeasure<'a> {
    pub(crate) fn new(capture: &SceneCapture<'a>, face: Face) -> Self {
        let spec = capture.spec;
        Self {
            tracer: capture.tracer,
            bins: spec.depth_bins(),
            rays: CentreRays {
                face,
                size_px: spec.face_size_px,
            },
            half_size_m: spec.half_size_m as f32,
        }
    }

    /// The number of rays from the centre through a pixel that meet each surface of a cluster,
    /// where their colours differ and the centre sees them.
    pub(super) fn ray_counts(
        &self,
        pixel: [u32; 2],
        cluster: &[SurfaceSample],
        tone: ToneMap,
    ) -> Option<Vec<u32>> {
        if !is_mixed(cluster, tone) {
            return None;
        }
        let packet = self
            .rays
            .packet(pixel, 0, [self.half_size_m, f32::INFINITY]);
        let hits = self.tracer.closest_packet(&packet);
        let mut counts = vec![0; cluster.len()];
        for k in 0..PACKET {
            let (Some(ray), Some(hit)) = (packet.ray(k), hits.hit(k)) else {
                continue;
            };
            let (class, _) = Accumulator::class_of_hit(self.tracer, ray.direction, hit.primitive);
            let bin = self.bins.place(1.0 / hit.t).0;
            let met = cluster
                .iter()
                .zip(0..)
                .filter(|(sample, _)| sample.class == class)
                .map(|(sample, i)| (sample.bin.abs_diff(bin), i))
                .min();
            if let Some((0..=1, i)) = met {
                counts[i] += 1;
            }
        }
        (counts.iter().sum::<u32>() >= ENOUGH_RAYS).then_some(counts)
    }
}

/// Returns true if colours in a cluster differ visibly.
fn is_mixed(cluster: &[SurfaceSample], tone: ToneMap) -> bool {
    let [first, others @ ..] = cluster else {
        return false;
    };
    let first = tone.levels(first.color());
    others.iter().any(|other| {
        let other = tone.levels(other.color());
        (0..3).any(|c| other[c].abs_diff(first[c]) >= MIN_DIFFERENCE)
    })
}

#[cfg(test)]
mod tests {
    use crate::capture::SceneCapture;
    use crate::scene_source::SceneSource;
    use crate::spec::{CaptureSpec, RunOptions};
    use glam::{DVec3, Vec3, dvec3};
    use headbox_core::cube_face::Face;
    use headbox_scene::material::Material;
    use headbox_scene::scene::{Scene, Triangle};
    use headbox_trace::bvh::Tracer;
    use headbox_trace::light::Lighting;
    use std::sync::Arc;

    const SIZE: u32 = 96;
    /// Eye depth of the wall, metres.
    const DISTANCE_M: f64 = 2.0;
    const DARK: f32 = 0.05;

    /// A dark wall with a white strip that fills the given rows of pixels.
    fn wall_with_strip(rows: [f64; 2]) -> Scene {
        let material = |albedo: f32| Material {
            albedo: [albedo; 3],
            ..Material::default()
        };
        let mut scene = Scene {
            materials: vec![material(DARK), material(1.0)],
            ..Scene::default()
        };
        let height = |row: f64| DISTANCE_M * (1.0 - 2.0 * row / f64::from(SIZE));
        let [top, bottom] = rows.map(height);
        for (high, low, material) in [(3.0, top, 0), (top, bottom, 1), (bottom, -3.0, 0)] {
            let first = scene.positions.len() as u32;
            let corners = [(-3.0, low), (3.0, low), (3.0, high), (-3.0, high)];
            scene
                .positions
                .extend(corners.map(|(x, y)| dvec3(x, y, -DISTANCE_M)));
            for corners in [[0, 1, 2], [0, 2, 3]] {
                scene.triangles.push(Triangle {
                    vertices: corners.map(|corner| first + corner),
                    material,
                });
            }
        }
        scene
    }

    #[test]
    fn strip_narrower_than_a_pixel_is_not_dashed() {
        const ROW: u32 = 40;
        // 16 evenly distributed rays count the share of the strip to within two of them.
        const TOLERANCE: f32 = 2.0 / 16.0;
        for share in [0.25, 0.5] {
            let start = f64::from(ROW) + 0.3;
            let scene = wall_with_strip([start, start + share]);
            let tracer = Tracer::new(Arc::new(scene), DVec3::ZERO);
            let lighting = Lighting::unmetered(&tracer, 0);
            let mut spec = CaptureSpec::new(SceneSource::new("wall"), DVec3::ZERO, 0.5);
            spec.face_size_px = SIZE;
            spec.parameters.light_samples = 0;
            // About nine rays for each pixel, as in default captures.
            (spec.parameters.strata, spec.parameters.rays_per_stratum) = (16, 8);
            spec.parameters.novelty = 0.0;
            let options = RunOptions::default();
            let capture = SceneCapture::new(&spec, &tracer, &lighting, &options);
            let cube = capture.run().expect("no file").0;
            let levels = [-TOLERANCE, TOLERANCE].map(|error| {
                let white = share as f32 + error;
                lighting
                    .tone
                    .levels(Vec3::splat(white + DARK * (1.0 - white)))[0]
            });
            let face = &cube.faces[Face::NegZ.index()];
            for x in 0..SIZE {
                let [sample] = face.pixel(x, ROW) else {
                    panic!("{x}: one surface");
                };
                let level = sample.color_srgb[0];
                assert!(
                    (levels[0]..=levels[1]).contains(&level),
                    "{share}, column {x}: {level}, not {levels:?}"
                );
            }
        }
    }
}
