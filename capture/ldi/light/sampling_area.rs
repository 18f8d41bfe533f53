//! The area of a pixel over which the light of a surface sample is taken.

use glam::Vec3;
use headbox_core::cube_face::Face;
use headbox_trace::bvh::{Ray, Tracer};
use headbox_trace::light::{LightSample, LitPoint};

/// The area over which the light of a surface sample is taken: the part of its triangle in the
/// pixel, as seen from the centre, so that edges of shadows are smooth. It ends where another
/// surface of the pixel stands on it: beyond may be the bright inside of a lamp, or the sunlit
/// ground outside a room.
pub(super) struct SamplingArea<'a> {
    pub(super) triangle: [Vec3; 3],
    /// A point of the surface that a ray has met.
    pub(super) representative: LitPoint,
    /// Occluders of a pixel with several surfaces.
    pub(super) occluders: Option<&'a Tracer>,
}

impl SamplingArea<'_> {
    /// The point for a sample in pixel (x, y) of a face.
    pub(super) fn point(
        &self,
        sample: &LightSample,
        face: Face,
        [x, y]: [u32; 2],
        size_px: u32,
    ) -> LitPoint {
        let [jx, jy] = sample.jitter();
        let through = face
            .direction(
                f64::from(x) + f64::from(jx),
                f64::from(y) + f64::from(jy),
                size_px,
            )
            .as_vec3();
        let [a, b, c] = self.triangle;
        let position = intersect_triangle(through, self.triangle)
            .map(|[u, v]| a + (b - a) * u + (c - a) * v)
            .filter(|&position| self.is_reachable(position));
        LitPoint {
            position: position.unwrap_or(self.representative.position),
            ..self.representative
        }
    }

    /// Returns true if no occluder stands on the surface between the representative and a position.
    fn is_reachable(&self, position: Vec3) -> bool {
        /// Height of the ray between them over the surface, as a share of its length: low enough
        /// for what stands on the surface, and above its own unevenness.
        const HEIGHT: f32 = 0.25;
        let Some(tracer) = self.occluders else {
            return true;
        };
        let direction = position - self.representative.position;
        let height = HEIGHT * direction.length();
        let ray = Ray {
            origin: self.representative.ray_origin() + self.representative.normal * height,
            direction,
            t_min: 0.0,
            t_max: 1.0,
        };
        !tracer.occluded(&ray)
    }
}

/// Intersects the ray from the local origin along `direction` with a triangle. Returns the weights
/// of its second and third corner.
pub(super) fn intersect_triangle(direction: Vec3, [a, b, c]: [Vec3; 3]) -> Option<[f32; 2]> {
    let (e1, e2) = (b - a, c - a);
    let p = direction.cross(e2);
    let det = e1.dot(p);
    let s = -a;
    let u = s.dot(p) / det;
    let q = s.cross(e1);
    let v = direction.dot(q) / det;
    let t = e2.dot(q) / det;
    // A NaN from an edge-on triangle (det = 0) fails every comparison.
    (u >= 0.0 && v >= 0.0 && u + v <= 1.0 && t > 0.0).then_some([u, v])
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::{DVec3, dvec3};
    use headbox_scene::material::Material;
    use headbox_scene::scene::{Scene, Triangle};

    #[test]
    fn light_is_taken_on_the_near_side_of_what_stands_on_a_surface() {
        // A floor, and a wall across it through the middle of a pixel.
        let floor = [
            dvec3(-9.0, -1.0, 1.0),
            dvec3(9.0, -1.0, 1.0),
            dvec3(0.0, -1.0, -20.0),
        ];
        let wall = [
            dvec3(0.02, -1.0, 0.0),
            dvec3(0.02, -1.0, -20.0),
            dvec3(0.02, 3.0, -20.0),
        ];
        let mut scene = Scene {
            positions: [floor, wall].concat(),
            materials: vec![Material::default()],
            ..Scene::default()
        };
        scene.triangles = [[0, 1, 2], [3, 4, 5]]
            .map(|vertices| Triangle {
                vertices,
                material: 0,
            })
            .to_vec();
        let tracer = Tracer::new(std::sync::Arc::new(scene), DVec3::ZERO);
        const SIZE_PX: u32 = 64;
        let pixel = [32, 50];
        let points_beyond = |occluders: Option<&Tracer>| {
            let area = SamplingArea {
                triangle: tracer.triangle(0),
                representative: LitPoint {
                    position: Vec3::new(0.01, -1.0, -1.7),
                    normal: Vec3::Y,
                    shading_normal: Vec3::Y,
                    extent: 20.0,
                },
                occluders,
            };
            let is_beyond = |&index: &u32| {
                let sample = LightSample { stream: 1, index };
                let point = area.point(&sample, Face::NegZ, pixel, SIZE_PX);
                point.position.x > 0.02
            };
            (0..64).filter(is_beyond).count()
        };
        assert!(
            points_beyond(None) > 16,
            "the pixel reaches behind the wall"
        );
        assert_eq!(points_beyond(Some(&tracer)), 0);
    }

    #[test]
    fn ray_from_the_centre_hits_the_triangle() {
        let triangle = [
            Vec3::new(-1.0, -1.0, -2.0),
            Vec3::new(1.0, -1.0, -2.0),
            Vec3::new(0.0, 2.0, -2.0),
        ];
        let hit = intersect_triangle(Vec3::new(0.1, 0.0, -1.0), triangle).unwrap();
        assert!(
            (hit[0] - 13.0 / 30.0).abs() < 1e-6 && (hit[1] - 1.0 / 3.0).abs() < 1e-6,
            "at (0.2, 0, -2)"
        );
        assert_eq!(
            intersect_triangle(Vec3::new(2.0, 0.0, -1.0), triangle),
            None,
            "beside it"
        );
        assert_eq!(
            intersect_triangle(Vec3::new(0.1, 0.0, 1.0), triangle),
            None,
            "behind the centre"
        );
        assert_eq!(intersect_triangle(Vec3::X, triangle), None, "edge-on");
    }
}
