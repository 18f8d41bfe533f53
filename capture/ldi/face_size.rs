//! Chooses the resolution of faces: as fine as the frames to be rendered from them, and no finer
//! (inventory S1; `docs/primitives.md`).
//!
//! A face pixel on the axis is 2 / size wide at depth 1, and from the centre 2 f / size pixels of a
//! frame of focal length f. An eye at b sees a point P larger than the centre does by |P| / |P -
//! b|. A sample lies within half of its width, so with a width of 2 E frame pixels nothing is
//! sampled coarser than E; finer faces would not show in any frame.

use crate::spec::CaptureSpec;
use glam::Vec3;
use headbox_core::random::Rng;
use headbox_cube::model::validate::MAX_FACE_SIZE_PX;
use headbox_cube::planes::DEFAULT_ERROR_PX;
use headbox_trace::bvh::{Ray, Tracer};
use headbox_trace::sampler::Strata;

/// Number of sampled pairs of an eye and a direction.
const PAIRS: usize = 4096;

/// Share of these pairs for which faces are fine enough. The remaining surfaces are so close to
/// some eyes that faces for them would have many times the pixels.
const SHARE: f64 = 0.9;

/// Face sizes are multiples of this number of pixels.
const STEP_PX: f64 = 16.0;

/// Returns the pixels along a side of faces from which frames of a focal length (pixels) show no
/// sample coarser than `error_px`, for nearly all eyes in a headbox about the tracer's origin. A
/// pure function of the scene and the headbox.
fn face_size_px(tracer: &Tracer, half_size_m: f64, focal_px: f64, error_px: f64) -> u32 {
    let mut random = Rng::keyed(0xface);
    let mut magnifications: Vec<f64> = (0..PAIRS)
        .map(|_| {
            let direction = random.in_ball().normalize_or_zero();
            let eye = random.in_cube(half_size_m);
            let ray = Ray {
                origin: Vec3::ZERO,
                direction: direction.as_vec3(),
                t_min: 0.0,
                t_max: f32::INFINITY,
            };
            // A direction without a surface is at infinity, where no movement magnifies anything.
            tracer.closest(&ray).map_or(1.0, |hit| {
                let point = direction * f64::from(hit.t);
                point.length() / (point - eye).length()
            })
        })
        .filter(|magnification| magnification.is_finite())
        .collect();
    let rank = (magnifications.len() as f64 * SHARE) as usize;
    let magnification = if magnifications.is_empty() {
        1.0
    } else {
        *magnifications
            .select_nth_unstable_by(rank, f64::total_cmp)
            .1
    };
    let size_px = focal_px * magnification / error_px;
    ((size_px / STEP_PX).ceil() * STEP_PX).clamp(STEP_PX, f64::from(MAX_FACE_SIZE_PX)) as u32
}

/// Sets the face size of a capture for frames of a focal length, pixels, and its strata so that the
/// number of rays for each face pixel stays the same. An error that is not positive stands for the
/// default.
pub fn choose_face_size(spec: &mut CaptureSpec, tracer: &Tracer, focal_px: f64, error_px: f64) {
    let error_px = if error_px > 0.0 {
        error_px
    } else {
        DEFAULT_ERROR_PX
    };
    let size_px = face_size_px(tracer, spec.half_size_m, focal_px, error_px);
    spec.parameters.strata = scaled_strata(spec.parameters.strata, spec.face_size_px, size_px);
    spec.face_size_px = size_px;
}

/// Number of strata along each dimension that gives faces of `size_px` as many rays for each pixel
/// as `strata` gives faces of `old_size_px`.
fn scaled_strata(strata: u32, old_size_px: u32, size_px: u32) -> u32 {
    // Rays grow with the fourth power of strata, face pixels with the second of a face's side.
    let strata = f64::from(strata) * (f64::from(size_px) / f64::from(old_size_px.max(1))).sqrt();
    strata
        .round()
        .clamp(1.0, f64::from(Strata::MAX_PER_DIMENSION)) as u32
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DVec3;
    use headbox_scene::material::Material;
    use headbox_scene::scene::Scene;
    use headbox_scene::scene::Triangle;
    use std::sync::Arc;

    /// A closed cube about the origin with this half edge, metres.
    fn room(half_m: f64) -> Tracer {
        let positions = (0..8).map(|i| {
            DVec3::from_array([0, 1, 2].map(|axis| f64::from((i >> axis & 1) * 2 - 1) * half_m))
        });
        let quads = [
            [0, 1, 3, 2],
            [4, 5, 7, 6],
            [0, 1, 5, 4],
            [2, 3, 7, 6],
            [0, 2, 6, 4],
            [1, 3, 7, 5],
        ];
        let triangles = quads
            .into_iter()
            .flat_map(|[a, b, c, d]| [[a, b, c], [a, c, d]]);
        let scene = Scene {
            positions: positions.collect(),
            triangles: triangles
                .map(|vertices| Triangle {
                    vertices,
                    material: 0,
                })
                .collect(),
            materials: vec![Material::default()],
            ..Scene::default()
        };
        Tracer::new(Arc::new(scene), DVec3::ZERO)
    }

    #[test]
    fn face_size_follows_frames_and_distance() {
        // From the centre a face pixel is 2 f / size frame pixels wide: 2 E of them where nothing
        // comes nearer.
        let sizes = [0.5, 0.25].map(|error_px| face_size_px(&room(1e6), 0.4, 665.0, error_px));
        assert_eq!(sizes, [1344, 2672], "665 / E, to multiples of 16");
        assert_eq!(face_size_px(&room(1e6), 0.4, 415.7, 0.5), 832);
        // Walls 2 m away, eyes within 0.4 m: magnified up to 1.25 times straight ahead, and at
        // worst 1.53 times.
        let near = face_size_px(&room(2.0), 0.4, 665.0, 0.5);
        assert!((1400..1330 * 5 / 4).contains(&near), "{near}");
        assert_eq!(face_size_px(&room(1e6), 0.4, 1e9, 0.5), MAX_FACE_SIZE_PX);
    }

    #[test]
    fn strata_keep_rays_per_pixel() {
        for (size, strata) in [(1024, 32), (256, 16), (4096, 64), (2048, 45), (1, 1)] {
            assert_eq!(scaled_strata(32, 1024, size), strata);
        }
        assert_eq!(scaled_strata(128, 1024, 8192), 128, "the maximum");
    }
}
