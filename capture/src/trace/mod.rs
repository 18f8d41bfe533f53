//! Ray tracing: the tree, its traversal, and the intersection of rays with triangles.

use glam::Vec3;

/// A ray in the tracer's local frame (world axes, metres, relative to the tracer's origin).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ray {
    /// Start.
    pub origin: Vec3,
    /// Direction, need not be normalised.
    pub direction: Vec3,
    /// Hits nearer than this (in units of the direction's length) are not seen.
    pub t_min: f32,
    /// Hits farther than this are not seen.
    pub t_max: f32,
}

/// Where a ray met a triangle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hit {
    /// Distance in units of the ray direction's length.
    pub t: f32,
    /// Index into [`crate::Scene::triangles`].
    pub primitive: u32,
    /// Barycentric weight of the triangle's second vertex.
    pub u: f32,
    /// Barycentric weight of the triangle's third vertex.
    pub v: f32,
}
