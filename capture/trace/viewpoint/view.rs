//! Where to look.

use super::cast;
use crate::bvh::Tracer;
use glam::{DVec3, Vec3};

/// Directions around the horizon that are tried.
const AZIMUTHS: u32 = 16;
/// Rays across and up a view that is tried.
const RAYS: [u32; 2] = [24, 16];
/// Half the width and half the height of a view, as tangents: 62 by 44 degrees.
const HALF_VIEW: [f64; 2] = [0.6, 0.4];
/// A view that reaches this share of the best is as good, and the one nearest to straight ahead
/// (-Z) is taken: people expect to look where a scene's maker looked.
const AS_GOOD: f64 = 0.8;

/// A direction to look in.
#[derive(Clone, Copy, Debug)]
pub(super) struct View {
    /// How much there is to see.
    pub(super) interest: f64,
    /// A unit vector, world axes.
    pub(super) ahead: DVec3,
}

/// The horizontal direction with the most to see from a world position: the one in whose view
/// depth, orientation and colour change most from ray to ray, weighted by how far one can see; a
/// blank wall and an empty sky have nothing of either. Every default camera is this one. A unit
/// vector, world axes.
pub fn suggest_view(tracer: &Tracer, world: DVec3) -> DVec3 {
    best_view(tracer, world).ahead
}

/// As [`suggest_view`].
pub(super) fn best_view(tracer: &Tracer, world: DVec3) -> View {
    let views = (0..AZIMUTHS).map(|i| {
        let angle = f64::from(i) / f64::from(AZIMUTHS) * std::f64::consts::TAU;
        let ahead = DVec3::new(angle.sin(), 0.0, -angle.cos());
        (
            i.min(AZIMUTHS - i),
            View {
                interest: interest(tracer, world, ahead),
                ahead,
            },
        )
    });
    let views: Vec<(u32, View)> = views.collect();
    let best = views
        .iter()
        .map(|(_, view)| view.interest)
        .fold(0.0, f64::max);
    let as_good = views
        .into_iter()
        .filter(|(_, view)| view.interest >= AS_GOOD * best);
    // The first of equals.
    as_good.min_by_key(|(turn, _)| *turn).map_or(
        View {
            interest: 0.0,
            ahead: DVec3::NEG_Z,
        },
        |(_, view)| view,
    )
}

/// What a ray sees.
#[derive(Clone, Copy)]
struct Seen {
    distance_m: f64,
    normal: Vec3,
    albedo: Vec3,
}

/// A ray of a view.
struct Ray {
    seen: Option<Seen>,
    /// Its solid angle, over that of a ray straight ahead.
    share: f64,
}

/// How much there is to see in a direction.
fn interest(tracer: &Tracer, world: DVec3, ahead: DVec3) -> f64 {
    let right = ahead.cross(DVec3::Y);
    let [columns, rows] = RAYS;
    let place = |i: u32, count: u32| f64::from(2 * i + 1) / f64::from(count) - 1.0;
    let rays: Vec<Ray> = (0..rows * columns)
        .map(|i| {
            let (x, y) = (
                place(i % columns, columns) * HALF_VIEW[0],
                place(i / columns, rows) * HALF_VIEW[1],
            );
            // The solid angle: perspective stretches what is off the axis.
            let share = (1.0 + x * x + y * y).powf(-1.5);
            Ray {
                seen: look(tracer, world, ahead + right * x + DVec3::Y * y),
                share,
            }
        })
        .collect();
    let at = |x: u32, y: u32| &rays[(y * columns + x) as usize];
    let across = (0..rows).flat_map(|y| (1..columns).map(move |x| (at(x - 1, y), at(x, y))));
    let up = (1..rows).flat_map(|y| (0..columns).map(move |x| (at(x, y - 1), at(x, y))));
    let change: f64 = across
        .chain(up)
        .map(|(a, b)| a.share * difference(a.seen, b.seen))
        .sum();
    let [low, high] = tracer.scene().bounds();
    let far = (high - low).length().max(f64::MIN_POSITIVE);
    // Distances count by their logarithm, from a thousandth of the scene's diagonal to all of it.
    let openness = |ray: &Ray| {
        ray.share
            * ray.seen.map_or(0.0, |seen| {
                (1.0 + (seen.distance_m / far).log10() / 3.0).clamp(0.0, 1.0)
            })
    };
    let open: f64 = rays.iter().map(openness).sum::<f64>() / rays.len() as f64;
    change * open
}

fn look(tracer: &Tracer, world: DVec3, direction: DVec3) -> Option<Seen> {
    let hit = cast(tracer, world, direction.as_vec3())?;
    let surface = tracer.scene().surface(hit.primitive, hit.u, hit.v);
    Some(Seen {
        distance_m: f64::from(hit.t) * direction.length(),
        normal: tracer.scene().geometric_normal(hit.primitive),
        albedo: Vec3::from(surface.albedo),
    })
}

/// How much two neighbouring rays see of different things, 0 to 3.
fn difference(a: Option<Seen>, b: Option<Seen>) -> f64 {
    let (a, b) = match (a, b) {
        (Some(a), Some(b)) => (a, b),
        (None, None) => return 0.0,
        // An outline before the sky.
        _ => return 1.0,
    };
    let depth = ((a.distance_m / b.distance_m).ln().abs() * 2.0).min(1.0);
    let turn = f64::from(1.0 - a.normal.dot(b.normal).abs()).clamp(0.0, 1.0);
    let color = f64::from((a.albedo - b.albedo).abs().max_element() * 2.0).min(1.0);
    depth + turn + color
}
