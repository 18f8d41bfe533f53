//! Paths of light: next-event estimation at each vertex and the ray to the next.

use super::guiding::guide::{Aim, Directions};
use super::{LightSample, Lighting, LitPoint};
use crate::bvh::{Ray, Tracer};
use glam::Vec3;
use headbox_core::bounces::Bounces;

/// Number of bounces after which Russian roulette starts.
const ROULETTE_BOUNCES: u32 = 3;

/// Throughput below which a path is likely to end. Ending brighter ones would save little time, and
/// make specks of those that reach a lamp.
const ROULETTE_THROUGHPUT: f32 = 0.25;

/// Number of the last bounce whose ray is guided. Guided rays weigh up to four, and the product of
/// their weights over many bounces would vary without bound.
pub(super) const LAST_GUIDED_BOUNCE: u32 = 2;

/// Number of random decisions at each vertex of a path: sun, emitter, direction, survival.
const DECISIONS: u32 = 4;

/// Dimension of the direction of a path's first ray.
pub(super) const FIRST_DIRECTION: u32 = 2;

/// State of a light path.
pub(super) struct Path {
    /// Current vertex.
    pub(super) point: LitPoint,
    /// Product of the albedos so far.
    pub(super) throughput: Vec3,
    /// Product of the importance weights of guided and aimed rays.
    pub(super) weight: f32,
    /// Light gathered so far.
    pub(super) sum: Vec3,
    /// Sum of the [gradients](LitPoint::normal_gradient) of the light that reaches the first vertex
    /// directly.
    pub(super) gradient: Vec3,
}

/// Light that arrives at a point.
#[derive(Clone, Copy, Default)]
pub(super) struct IncidentLight {
    /// Radiosity per albedo.
    pub(super) light: Vec3,
    /// Unit direction from which it comes.
    pub(super) direction: Vec3,
}

/// Number of a vertex along its path.
#[derive(Clone, Copy)]
pub(super) struct Vertex {
    /// Number of bounces before it.
    bounce: u32,
    /// True if no light is gathered beyond the ray that leaves it.
    is_last: bool,
}

impl Vertex {
    /// Dimension of its first random decision.
    fn dimension(self) -> u32 {
        self.bounce.wrapping_mul(DECISIONS)
    }
}

impl Path {
    pub(super) fn new(point: &LitPoint) -> Self {
        Self {
            point: *point,
            throughput: Vec3::ONE,
            weight: 1.0,
            sum: Vec3::ZERO,
            gradient: Vec3::ZERO,
        }
    }

    /// Adds light at the current vertex.
    fn add(&mut self, light: Vec3) {
        self.sum += self.throughput * light * self.weight;
    }

    /// Adds the gradient of light at the current vertex if that is the first one.
    fn add_gradient(&mut self, vertex: Vertex, incident: &IncidentLight) {
        if vertex.bounce == 0 {
            let light = incident.light * self.weight;
            self.gradient += self.point.normal_gradient(light, incident.direction);
        }
    }

    /// Adds light that arrives at the current vertex, and its gradient.
    fn add_incident(&mut self, vertex: Vertex, light: Vec3, direction: Vec3) {
        self.add(light);
        self.add_gradient(vertex, &IncidentLight { light, direction });
    }
}

impl Lighting {
    /// Returns the number of the last vertex of a path, if the path is not ended before.
    fn last_bounce(&self) -> u32 {
        match self.bounces {
            Bounces::Full => u32::MAX,
            Bounces::Exactly(number) => number,
        }
    }

    /// Returns vertex `bounce` of a path with this lighting's number of bounces.
    pub(super) fn vertex(&self, bounce: u32) -> Vertex {
        Vertex {
            bounce,
            is_last: bounce == self.last_bounce(),
        }
    }

    /// Traces a path from its vertex `bounce` on.
    pub(super) fn follow(
        &self,
        tracer: &Tracer,
        path: &mut Path,
        bounce: u32,
        sample: &LightSample,
    ) {
        for bounce in bounce..=self.last_bounce() {
            let vertex = self.vertex(bounce);
            if self.light_vertex(tracer, path, vertex, sample).is_none() {
                return;
            }
        }
    }

    /// Traces a path from its vertex 1 until it ends or reaches a cell for which `find` returns the
    /// light that has bounced before, or `None`. Returns that light, which the path's sum excludes,
    /// and the factor of its contribution.
    pub(super) fn follow_to_cell<T>(
        &self,
        tracer: &Tracer,
        path: &mut Path,
        sample: &LightSample,
        find: impl Fn(&LitPoint) -> Option<T>,
    ) -> Option<(T, Vec3)> {
        for bounce in 1..=self.last_bounce() {
            if let Some(light) = find(&path.point) {
                let factor = path.throughput * path.weight;
                let vertex = Vertex {
                    bounce,
                    is_last: true,
                };
                self.light_vertex(tracer, path, vertex, sample);
                return Some((light, factor));
            }
            self.light_vertex(tracer, path, self.vertex(bounce), sample)?;
        }
        None
    }

    /// Adds next-event estimation of radiosity per albedo at the path's vertex. Light from the sky
    /// and from emissive triangles is weighted against rays in `directions`, if these sample it
    /// too.
    pub(super) fn add_direct(
        &self,
        tracer: &Tracer,
        path: &mut Path,
        sample: &LightSample,
        vertex: Vertex,
        directions: Option<&Directions<'_>>,
    ) {
        let dimension = vertex.dimension();
        let point = path.point;
        let emitter = self.emitter_light(tracer, &point, sample, dimension, directions);
        path.add_gradient(vertex, &emitter);
        let mut direct = emitter.light;
        if let Some(directions) = directions {
            let sky = self.sky_light(tracer, &point, sample, dimension, directions);
            path.add_gradient(vertex, &sky);
            direct += sky.light;
        }
        if vertex.bounce > 0 {
            direct += self.sun_light(tracer, &point, sample, dimension);
            direct += self.lamp_light(tracer, &point, sample, dimension);
        }
        path.add(direct);
    }

    /// Returns true if the ray from a vertex samples only the sky: it is the last of a path that has
    /// bounced, and there are no emissive triangles. These are sampled by rays as well, because
    /// next-event estimation alone has a variance without bound near one.
    fn samples_only_sky(&self, vertex: Vertex) -> bool {
        vertex.bounce > 0 && vertex.is_last && self.fill.radiance == 0.0 && self.emitters.is_empty()
    }

    /// Adds the light at the path's vertex and moves the path to the next hit. Returns the distance
    /// to it, metres; `None` if the path ends.
    pub(super) fn light_vertex(
        &self,
        tracer: &Tracer,
        path: &mut Path,
        vertex: Vertex,
        sample: &LightSample,
    ) -> Option<f32> {
        // A last ray that samples only the sky is not traced in a scene without one.
        let is_traced = self.sky.is_some() || !self.samples_only_sky(vertex);
        let directions = is_traced.then(|| {
            if vertex.bounce <= LAST_GUIDED_BOUNCE {
                self.directions(&path.point)
            } else {
                self.unguided_directions(&path.point)
            }
        });
        self.add_direct(tracer, path, sample, vertex, directions.as_ref());
        self.trace_next_ray(tracer, path, vertex, sample, &directions?)
    }

    /// Traces the ray that continues the path, adds the light along it, and moves the path to its
    /// hit (see [`Self::light_vertex`]).
    pub(super) fn trace_next_ray(
        &self,
        tracer: &Tracer,
        path: &mut Path,
        vertex: Vertex,
        sample: &LightSample,
        directions: &Directions<'_>,
    ) -> Option<f32> {
        let dimension = vertex.dimension() + FIRST_DIRECTION;
        let aim = directions.sample(tracer, sample, dimension);
        self.trace_ray(tracer, path, vertex, sample, directions, &aim)
    }

    /// Same as [`Self::trace_next_ray`], for a sampled direction.
    pub(super) fn trace_ray(
        &self,
        tracer: &Tracer,
        path: &mut Path,
        vertex: Vertex,
        sample: &LightSample,
        directions: &Directions<'_>,
        aim: &Aim,
    ) -> Option<f32> {
        let point = path.point;
        let direction = aim.direction;
        let cos = direction.dot(point.shading_normal);
        // A ray may be below the geometric surface about a tilted shading normal, or be aimed
        // there.
        if direction.dot(point.normal) <= 0.0 || aim.is_aimed() && cos <= 0.0 {
            return None;
        }
        let ray = Ray::new(point.ray_origin(), direction);
        let hit = if self.samples_only_sky(vertex) {
            // The last ray is only an occlusion test.
            if tracer.occluded(&ray) {
                return None;
            }
            None
        } else {
            tracer.closest(&ray)
        };
        path.weight *= directions.weight(tracer, aim, cos, hit.as_ref())?;
        let Some(hit) = hit else {
            let sky = self.sky_light_from_miss(tracer, &point, direction, directions);
            path.add_incident(vertex, sky + self.fill.radiance, direction);
            return None;
        };
        if self.fill.radiance > 0.0 {
            let openness = (hit.t / self.fill.reach_m).min(1.0);
            let fill = Vec3::splat(self.fill.radiance * openness * openness);
            path.add_incident(vertex, fill, direction);
        }
        let (next, surface) = LitPoint::from_hit(tracer, &ray, &hit);
        let emitted = self.emitter_light_from_hit(tracer, &point, &ray, &hit, &surface, directions);
        path.add_incident(vertex, emitted, direction);
        path.point = next;
        path.throughput *= Vec3::from_array(surface.albedo);
        if vertex.bounce >= ROULETTE_BOUNCES {
            let survive = (path.throughput.max_element() / ROULETTE_THROUGHPUT).min(0.95);
            if sample.single(vertex.dimension() + 3) >= survive {
                return None;
            }
            path.throughput /= survive;
        }
        Some(hit.t)
    }
}
