//! The area of a pixel over which the light of a surface sample is taken.

use super::pool::same_surface;
use super::shade::SurfaceSample;
use crate::accumulate::accumulator::Accumulator;
use crate::spec::CaptureSpec;
use crate::surfaces::surface_samples::FaceSurfaces;
use glam::Vec3;
use headbox_core::cube_face::Face;
use headbox_trace::bvh::{Ray, Tracer};
use headbox_trace::light::{LightSample, LitPoint};
use rayon::prelude::*;

/// The area over which the light of a surface sample is taken: the part of its triangle in the
/// pixel, as seen from the centre, so that edges of shadows are smooth. It ends where another
/// surface of the pixel stands on it: beyond may be the bright inside of a lamp, or the sunlit
/// ground outside a room.
///
/// Outside its triangle and beside steps, it is what the centre sees of the sample's class and
/// depth bin: one sample may stand for a slat of a shutter and the panel in its shade.
pub(super) struct SamplingArea<'a> {
    pub(super) tracer: &'a Tracer,
    pub(super) spec: &'a CaptureSpec,
    pub(super) sample: &'a SurfaceSample,
    pub(super) triangle: [Vec3; 3],
    /// A point of the surface that a ray has met.
    pub(super) representative: LitPoint,
    /// True if there is no other sample in the pixel.
    pub(super) is_alone: bool,
    /// See [`beside_steps`].
    pub(super) is_beside_step: bool,
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
        let on_triangle = intersect_triangle(through, self.triangle);
        if (self.is_beside_step || on_triangle.is_none())
            && let Some(point) = self.visible_point(through)
        {
            return point;
        }
        let [a, b, c] = self.triangle;
        let position = on_triangle
            .map(|[u, v]| a + (b - a) * u + (c - a) * v)
            .filter(|&position| self.is_alone || self.is_reachable(position));
        LitPoint {
            position: position.unwrap_or(self.representative.position),
            ..self.representative
        }
    }

    /// The point that the centre sees in a direction of eye depth 1, if it belongs to the sample.
    fn visible_point(&self, direction: Vec3) -> Option<LitPoint> {
        let bins = self.spec.depth_bins();
        let ray = Ray {
            origin: Vec3::ZERO,
            direction,
            t_min: self.spec.half_size_m as f32,
            t_max: (1.0 / bins.inverse_depth(f64::from(self.sample.bin))) as f32,
        };
        let hit = self.tracer.closest(&ray)?;
        let (class, _) = Accumulator::class_of_hit(self.tracer, direction, hit.primitive);
        let (bin, _) = bins.place(1.0 / hit.t);
        (class == self.sample.class && bin == self.sample.bin)
            .then(|| LitPoint::from_hit(self.tracer, &ray, &hit).0)
    }

    /// Returns true if no occluder stands on the surface between the representative and a position.
    fn is_reachable(&self, position: Vec3) -> bool {
        /// Height of the ray between them over the surface, as a share of its length: low enough
        /// for what stands on the surface, and above its own unevenness.
        const HEIGHT: f32 = 0.25;
        let direction = position - self.representative.position;
        let height = HEIGHT * direction.length();
        let ray = Ray {
            origin: self.representative.ray_origin() + self.representative.normal * height,
            direction,
            t_min: 0.0,
            t_max: 1.0,
        };
        !self.tracer.occluded(&ray)
    }
}

/// Finds the samples of a face beside a step: a neighbour of their class lies at about their depth,
/// but in another plane. Returns true for those.
pub(super) fn beside_steps(surfaces: &FaceSurfaces) -> Vec<bool> {
    let size = surfaces.size_px;
    let is_beside = |x: u32, y: u32, sample: &SurfaceSample| {
        let neighbours = [
            (x.wrapping_sub(1), y),
            (x + 1, y),
            (x, y.wrapping_sub(1)),
            (x, y + 1),
        ];
        let inside = neighbours
            .into_iter()
            .filter(|&(x, y)| x < size && y < size);
        inside.flat_map(|(x, y)| surfaces.pixel(x, y)).any(|other| {
            other.class == sample.class
                && other.bin.abs_diff(sample.bin) <= 1
                && !same_surface(other, sample)
        })
    };
    let row = |y: u32| {
        let pixels = (0..size).flat_map(|x| surfaces.pixel(x, y).iter().map(move |it| (x, it)));
        pixels
            .map(|(x, sample)| is_beside(x, y, sample))
            .collect::<Vec<bool>>()
    };
    let rows: Vec<Vec<bool>> = (0..size).into_par_iter().map(row).collect();
    rows.concat()
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
    use crate::scene_source::SceneSource;
    use glam::{DVec3, dvec3};
    use headbox_scene::material::Material;
    use headbox_scene::scene::{Scene, Triangle};

    const SIZE_PX: u32 = 64;

    /// Triangles of one material.
    fn tracer(triangles: &[[DVec3; 3]]) -> Tracer {
        let scene = Scene {
            positions: triangles.concat(),
            triangles: (0..triangles.len() as u32)
                .map(|i| Triangle {
                    vertices: [0, 1, 2].map(|corner| 3 * i + corner),
                    material: 0,
                })
                .collect(),
            materials: vec![Material::default()],
            ..Scene::default()
        };
        Tracer::new(std::sync::Arc::new(scene), DVec3::ZERO)
    }

    fn spec() -> CaptureSpec {
        let mut spec = CaptureSpec::new(SceneSource::new("scene"), DVec3::ZERO, 0.5);
        spec.face_size_px = SIZE_PX;
        spec
    }

    /// A sample of a primitive of the scene that a ray has met at a point of the face -Z.
    fn sample(tracer: &Tracer, primitive: u32, point: Vec3) -> SurfaceSample {
        let normal = tracer.geometric_normal(primitive);
        let plane_normal = -normal * normal.dot(point).signum();
        SurfaceSample {
            class: Accumulator::class_of_hit(tracer, point, primitive).0,
            bin: spec().depth_bins().place(-1.0 / point.z).0,
            primitive,
            plane_normal,
            plane_distance: plane_normal.dot(point),
            ..bytemuck::Zeroable::zeroed()
        }
    }

    /// The number of 64 points of the light of such a sample that satisfy `is_counted`.
    fn count_points(
        tracer: &Tracer,
        (primitive, point): (u32, Vec3),
        pixel: [u32; 2],
        [is_alone, is_beside_step]: [bool; 2],
        is_counted: impl Fn(&LitPoint) -> bool,
    ) -> usize {
        let (sample, spec) = (sample(tracer, primitive, point), spec());
        let area = SamplingArea {
            tracer,
            spec: &spec,
            sample: &sample,
            triangle: tracer.triangle(primitive),
            representative: LitPoint {
                position: point,
                normal: sample.plane_normal,
                shading_normal: sample.plane_normal,
                extent: 20.0,
            },
            is_alone,
            is_beside_step,
        };
        let points = (0..64).map(|index| {
            let sample = LightSample { stream: 1, index };
            area.point(&sample, Face::NegZ, pixel, SIZE_PX)
        });
        points.filter(is_counted).count()
    }

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
        let tracer = tracer(&[floor, wall]);
        let points_beyond = |is_alone: bool| {
            let floor = (0, Vec3::new(0.01, -1.0, -1.7));
            count_points(&tracer, floor, [32, 50], [is_alone, false], |point| {
                point.position.x > 0.02
            })
        };
        assert!(
            points_beyond(true) > 16,
            "the pixel reaches behind the wall"
        );
        assert_eq!(points_beyond(false), 0);
    }

    #[test]
    fn light_of_slats_includes_the_panel_between_them() {
        // A slat fills the upper half of a pixel; a panel stands 2 cm behind it. A pixel at this
        // depth is 6.3 cm high.
        let pixel = [40, 31];
        let quad = |z: f64, [bottom, top]: [f64; 2]| {
            let [a, b, c, d] = [(-9.0, bottom), (9.0, bottom), (9.0, top), (-9.0, top)]
                .map(|(x, y)| dvec3(x, y, z));
            [[a, b, c], [a, c, d]]
        };
        let panel = quad(-2.03, [-9.0, 9.0]);
        let slat = quad(-2.01, [0.5 * 2.01 / 32.0, 0.08]);
        let tracer = tracer(&[panel, slat].concat());
        let on_panel = |point: &LitPoint| point.position.z < -2.02;
        let count = |representative: (u32, Vec3), is_beside_step: bool| {
            count_points(
                &tracer,
                representative,
                pixel,
                [true, is_beside_step],
                on_panel,
            )
        };
        // Half of 64 evenly distributed points, to within four.
        let half = 28..=36;
        let on_slat = (2, Vec3::new(0.54, 0.05, -2.01));
        assert!(
            half.contains(&count(on_slat, false)),
            "outside the slat's triangles"
        );
        let on_panel = (0, Vec3::new(0.54, 0.01, -2.03));
        assert_eq!(count(on_panel, false), 64);
        assert!(half.contains(&count(on_panel, true)));

        let row = |primitive: u32, point: Vec3| sample(&tracer, primitive, point);
        let samples = vec![
            row(on_slat.0, on_slat.1),
            row(on_panel.0, on_panel.1),
            row(on_panel.0, on_panel.1),
            row(on_panel.0, on_panel.1),
        ];
        let surfaces = FaceSurfaces {
            size_px: 2,
            offsets: (0..=4).collect(),
            samples,
        };
        assert_eq!(beside_steps(&surfaces), [true, true, true, false]);
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
