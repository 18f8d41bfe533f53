//! Default viewing direction.

use super::cast;
use crate::bvh::Tracer;
use glam::{DVec3, Vec3};

/// Number of candidate horizontal directions.
const AZIMUTHS: u32 = 16;
/// Numbers of rays across and up a view.
const RAYS: [u32; 2] = [24, 16];
/// Half the width and half the height of a view, as tangents: 62 by 44 degrees.
const HALF_VIEW: [f64; 2] = [0.6, 0.4];
/// Fraction of the best interest from which a view counts as equally good. Of these, the one
/// nearest to -Z is chosen: the direction that scene authors usually intend.
const AS_GOOD: f64 = 0.8;

/// A candidate viewing direction.
#[derive(Clone, Copy, Debug)]
pub(super) struct View {
    /// Amount of visible variation.
    pub(super) interest: f64,
    /// Unit vector, world axes.
    pub(super) ahead: DVec3,
}

/// Returns the default horizontal viewing direction from a world position, a unit vector in world
/// axes: the one whose view has the largest changes of depth, orientation and colour from ray to
/// ray, times the solid angle that surfaces cover, times the root of their median distance. All
/// default cameras use it.
pub fn suggest_view(tracer: &Tracer, world: DVec3) -> DVec3 {
    best_view(tracer, world).ahead
}

/// Returns the view of [`suggest_view`] with its interest.
pub(super) fn best_view(tracer: &Tracer, world: DVec3) -> View {
    let view = |i: u32| {
        let angle = f64::from(i) / f64::from(AZIMUTHS) * std::f64::consts::TAU;
        let ahead = DVec3::new(angle.sin(), 0.0, -angle.cos());
        let interest = interest(tracer, world, ahead);
        (i.min(AZIMUTHS - i), View { interest, ahead })
    };
    let views: Vec<(u32, View)> = (0..AZIMUTHS).map(view).collect();
    let best = views
        .iter()
        .map(|(_, view)| view.interest)
        .fold(0.0, f64::max);
    let as_good = views
        .into_iter()
        .filter(|(_, view)| view.interest >= AS_GOOD * best);
    as_good.min_by_key(|(turn, _)| *turn).map_or(
        View {
            interest: 0.0,
            ahead: DVec3::NEG_Z,
        },
        |(_, view)| view,
    )
}

/// Surface hit by a ray.
#[derive(Clone, Copy)]
struct VisibleSurface {
    distance_m: f64,
    normal: Vec3,
    albedo: Vec3,
}

/// A ray of a view.
struct ViewRay {
    surface: Option<VisibleSurface>,
    /// Solid angle relative to that of the central ray.
    share: f64,
}

/// Returns the interest of a direction: see [`suggest_view`].
fn interest(tracer: &Tracer, world: DVec3, ahead: DVec3) -> f64 {
    let right = ahead.cross(DVec3::Y);
    let [columns, rows] = RAYS;
    let position = |i: u32, count: u32| f64::from(2 * i + 1) / f64::from(count) - 1.0;
    let rays: Vec<ViewRay> = (0..rows * columns)
        .map(|i| {
            let x = position(i % columns, columns) * HALF_VIEW[0];
            let y = position(i / columns, rows) * HALF_VIEW[1];
            // Solid angle: perspective stretches off-axis pixels.
            let share = (1.0 + x * x + y * y).powf(-1.5);
            ViewRay {
                surface: trace_surface(tracer, world, ahead + right * x + DVec3::Y * y),
                share,
            }
        })
        .collect();
    let ray = |x: u32, y: u32| &rays[(y * columns + x) as usize];
    let across = (0..rows).flat_map(|y| (1..columns).map(move |x| (ray(x - 1, y), ray(x, y))));
    let up = (1..rows).flat_map(|y| (0..columns).map(move |x| (ray(x, y - 1), ray(x, y))));
    let change: f64 = across
        .chain(up)
        .map(|(a, b)| a.share * difference(a.surface, b.surface))
        .sum();
    let mut distances: Vec<f64> = rays
        .iter()
        .filter_map(|ray| Some(ray.surface?.distance_m))
        .collect();
    distances.sort_by(f64::total_cmp);
    let median = distances.get(distances.len() / 2).copied();
    let covered: f64 = rays
        .iter()
        .filter(|ray| ray.surface.is_some())
        .map(|ray| ray.share)
        .sum();
    change * covered * median.unwrap_or(0.0).sqrt()
}

fn trace_surface(tracer: &Tracer, world: DVec3, direction: DVec3) -> Option<VisibleSurface> {
    let hit = cast(tracer, world, direction.as_vec3())?;
    let surface = tracer.scene().surface(hit.primitive, hit.u, hit.v);
    Some(VisibleSurface {
        distance_m: f64::from(hit.t) * direction.length(),
        normal: tracer.scene().geometric_normal(hit.primitive),
        albedo: Vec3::from(surface.albedo),
    })
}

/// Returns the difference of the surfaces of two neighbouring rays, 0 to 3.
fn difference(a: Option<VisibleSurface>, b: Option<VisibleSurface>) -> f64 {
    let (a, b) = match (a, b) {
        (Some(a), Some(b)) => (a, b),
        (None, None) => return 0.0,
        // A silhouette against the background.
        _ => return 1.0,
    };
    let depth = ((a.distance_m / b.distance_m).ln().abs() * 2.0).min(1.0);
    let turn = f64::from(1.0 - a.normal.dot(b.normal).abs()).clamp(0.0, 1.0);
    let color = f64::from((a.albedo - b.albedo).abs().max_element() * 2.0).min(1.0);
    depth + turn + color
}
