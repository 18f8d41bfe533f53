//! The tracer against a brute-force oracle: Möller-Trumbore in `f64` over every triangle.

use super::oracle::{
    OracleHit, bits, grid, levels, oracle_hits, rays_for, scene_from_triangles, soup, sphere,
};
use glam::{DVec3, Vec3, dvec3, vec3};
use headbox_core::random::Rng;
use headbox_scene::scene::Scene;
use headbox_trace::bvh::{Hit, PACKET, Ray, RayPacket, Tracer};
use std::sync::Arc;

/// Relative error of `t` and of where a ray passes a triangle's border: `f32` positions relative to
/// the ray's origin carry 2^-24, the shear and the edge functions a few times that. In units of the
/// scene's extent.
const TOLERANCE: f64 = 3e-6;

/// Margin ([`OracleHit::margin`]) above which oracle hits must be found: the tolerance over the
/// size of the smallest triangles (a hundredth of the extent).
const SURE_MARGIN: f64 = TOLERANCE * 100.0;

/// Cosine below which oracle hits are not compared: grazing angles multiply the error along the
/// ray.
const LEAST_FACING: f64 = 0.01;

/// Asserts that the tracer finds the oracle's closest distance, unless the ray passes within the
/// tolerance of a triangle's border.
fn assert_closest(tracer: &Tracer, oracle: &[OracleHit], ray: &Ray, hit: Option<Hit>, extent: f64) {
    let tolerance = TOLERANCE / LEAST_FACING * extent;
    let along = tolerance / f64::from(ray.direction.length());
    let sure = oracle
        .iter()
        .filter(|h| h.margin > SURE_MARGIN)
        .map(|h| h.t)
        .fold(f64::INFINITY, f64::min);
    let Some(hit) = hit else {
        assert!(
            sure == f64::INFINITY,
            "a hit at {sure} was missed by {ray:?}"
        );
        return;
    };
    let t = f64::from(hit.t);
    assert!(
        t <= sure + along,
        "{ray:?} found {t}, but there is a hit at {sure}"
    );
    let known = oracle.iter().find(|h| h.primitive == hit.primitive);
    let known =
        known.unwrap_or_else(|| panic!("{ray:?} found {hit:?}, which the oracle does not know"));
    if known.facing > LEAST_FACING {
        assert!(
            (known.t - t).abs() <= along,
            "{ray:?} found {hit:?} for {known:?}"
        );
        let [a, b, c] = tracer.triangle(hit.primitive).map(|p| p.as_dvec3());
        let on_triangle = a + (b - a) * f64::from(hit.u) + (c - a) * f64::from(hit.v);
        let on_ray = ray.origin.as_dvec3() + ray.direction.as_dvec3() * t;
        assert!(
            on_triangle.distance(on_ray) <= tolerance,
            "u and v weigh the second and third vertex"
        );
    }
}

/// Checks every entry point at every SIMD level against the oracle and against each other, bit for
/// bit.
fn check(scene: Scene, origin: DVec3, rays: &[Ray], extent: f64) {
    let scene = Arc::new(scene);
    let tracers: Vec<Tracer> = levels()
        .into_iter()
        .map(|level| Tracer::with_level(scene.clone(), origin, level))
        .collect();
    let triangles: Vec<[DVec3; 3]> = (0..scene.triangles.len() as u32)
        .map(|i| tracers[0].triangle(i).map(|p| p.as_dvec3()))
        .collect();
    let mut found = 0;
    for ray in rays {
        let oracle = oracle_hits(&triangles, ray);
        let hit = tracers[0].closest(ray);
        found += usize::from(hit.is_some());
        assert_closest(&tracers[0], &oracle, ray, hit, extent);
        for tracer in &tracers {
            assert_eq!(
                bits(tracer.closest(ray)),
                bits(hit),
                "closest at every level"
            );
            assert_eq!(
                tracer.occluded(ray),
                hit.is_some(),
                "occluded agrees with closest"
            );
            let mut all = Vec::new();
            tracer.all_hits(ray, &mut |hit| all.push(hit));
            assert_eq!(
                bits(all.first().copied()),
                bits(hit),
                "the first of all hits is the closest"
            );
            assert!(
                all.is_sorted_by(|a, b| (a.t, a.primitive) < (b.t, b.primitive)),
                "each hit once, in order"
            );
            for sure in oracle.iter().filter(|h| h.margin > SURE_MARGIN) {
                assert!(
                    all.iter().any(|h| h.primitive == sure.primitive),
                    "all_hits lacks {sure:?} on {ray:?}"
                );
            }
            let known = |h: &Hit| oracle.iter().any(|o| o.primitive == h.primitive);
            assert!(
                all.iter().all(known),
                "all_hits knows no hits that the oracle does not"
            );
        }
    }
    assert!(
        found * 10 > rays.len(),
        "a test whose rays all miss shows nothing: {found} of {}",
        rays.len()
    );
    assert_packets_agree(&tracers, rays);
}

/// Asserts that packets give the same bits as single rays, at every SIMD level.
fn assert_packets_agree(tracers: &[Tracer], rays: &[Ray]) {
    for chunk in rays.chunks(PACKET) {
        let mut packet = RayPacket::from_rays(chunk);
        packet.active &= !(1 << 5); // an inactive ray in the middle
        let expected: Vec<Option<Hit>> = (0..PACKET)
            .map(|k| packet.ray(k).and_then(|ray| tracers[0].closest(&ray)))
            .collect();
        for tracer in tracers {
            let (hits, blocked) = (
                tracer.closest_packet(&packet),
                tracer.occluded_packet(&packet),
            );
            for (k, &expected) in expected.iter().enumerate() {
                assert_eq!(
                    bits(hits.hit(k)),
                    bits(expected),
                    "packets agree with single rays"
                );
                assert_eq!(blocked >> k & 1 == 1, expected.is_some());
                if expected.is_none() {
                    assert_eq!((hits.t[k], hits.primitive[k]), (f32::INFINITY, u32::MAX));
                }
            }
        }
    }
}

#[test]
fn random_soup_at_three_scales() {
    for (seed, scale) in [(1, 1.0), (2, 1e-3), (3, 1e4)] {
        let mut random = Rng::keyed(seed);
        let scene = scene_from_triangles(&soup(&mut random, 700, 0.15, scale));
        let rays = rays_for(&mut random, 600, scale);
        check(scene, DVec3::ZERO, &rays, scale);
    }
}

#[test]
fn a_closed_mesh_with_many_leaves() {
    let mut random = Rng::keyed(8);
    let mut triangles = sphere(5);
    triangles.extend(
        sphere(3)
            .into_iter()
            .map(|t| t.map(|p| p * 0.4 + dvec3(0.2, 0.1, 0.0))),
    );
    check(
        scene_from_triangles(&triangles),
        DVec3::ZERO,
        &rays_for(&mut random, 160, 1.0),
        1.0,
    );
}

#[test]
fn large_offsets_vanish_with_the_origin() {
    let offset = dvec3(1e5, -3e5, 7e4);
    let mut random = Rng::keyed(4);
    let triangles: Vec<_> = soup(&mut random, 300, 0.2, 1.0)
        .into_iter()
        .map(|t| t.map(|p| p + offset))
        .collect();
    check(
        scene_from_triangles(&triangles),
        offset,
        &rays_for(&mut random, 300, 1.0),
        1.0,
    );
}

#[test]
fn grids_and_rays_along_the_planes_of_boxes() {
    let mut random = Rng::keyed(5);
    let mut rays = rays_for(&mut random, 200, 1.0);
    // Axis-parallel rays through vertices and edges, which are also the borders of boxes.
    for i in 0..208 {
        let [p, q] = [0, 1].map(|_| (random.below(25) as f32) / 24.0 - 0.5);
        let q = if i % 2 == 0 {
            q
        } else {
            random.unit() as f32 - 0.5
        };
        let direction = [
            Vec3::NEG_Z,
            vec3(-0.0, 0.0, -2.0),
            vec3(1e-30, -1e-20, -1.0),
        ][i / 16 % 3];
        rays.push(Ray {
            origin: vec3(p, q, 0.75),
            direction,
            t_min: 0.0,
            t_max: 9.0,
        });
    }
    check(scene_from_triangles(&grid(24)), DVec3::ZERO, &rays, 1.0);
}

#[test]
fn ray_in_plane_of_flat_box_hits_beyond_it() {
    // The floor's triangles have boxes of zero height; the ray runs in the floor and hits a wall on
    // it.
    let mut triangles = grid(8)
        .into_iter()
        .map(|t| t.map(|p| dvec3(p.x, 0.0, p.y)))
        .collect::<Vec<_>>();
    triangles.push([
        dvec3(0.4, 0.0, -1.0),
        dvec3(0.4, 0.0, 1.0),
        dvec3(0.4, 1.0, 0.0),
    ]);
    let wall = triangles.len() as u32 - 1;
    let tracer = Tracer::new(Arc::new(scene_from_triangles(&triangles)), DVec3::ZERO);
    for z in [0.0, 0.125, -0.3] {
        let ray = Ray {
            origin: vec3(-0.45, 0.0, z),
            direction: Vec3::X,
            t_min: 0.0,
            t_max: f32::INFINITY,
        };
        assert_eq!(tracer.closest(&ray).map(|h| h.primitive), Some(wall));
    }
}

#[test]
fn a_closed_sphere_does_not_leak() {
    let far = [dvec3(300.0, -50.0, 20.0), dvec3(70.0, 3.0, -900.0)];
    for (scale, centre) in [
        (1.0, DVec3::ZERO),
        (1e-3, DVec3::ZERO),
        (1e4, far[0]),
        (1.0, far[1]),
    ] {
        let triangles: Vec<_> = sphere(4)
            .into_iter()
            .map(|t| t.map(|p| p * scale + centre))
            .collect();
        let tracer = Tracer::new(Arc::new(scene_from_triangles(&triangles)), DVec3::ZERO);
        let mut random = Rng::keyed(6);
        for i in 0..triangles.len() {
            let [a, b, c] = tracer.triangle(i as u32);
            let inside = (random.in_ball() * 0.6 * scale + centre).as_vec3();
            let along = random.unit() as f32;
            let rays = [a, b, c, a + (b - a) * along, (b + c) * 0.5].map(|target| Ray {
                origin: inside,
                direction: target - inside,
                t_min: 0.0,
                t_max: f32::INFINITY,
            });
            for ray in &rays {
                let hit = tracer
                    .closest(ray)
                    .unwrap_or_else(|| panic!("{ray:?} leaks"));
                assert!((hit.t - 1.0).abs() < 1e-2, "{hit:?}");
            }
            let hits = tracer.closest_packet(&RayPacket::from_rays(&rays.repeat(3)));
            assert!((0..15).all(|k| hits.hit(k).is_some()), "packets leak");
        }
    }
}

#[test]
fn thin_and_edge_on_triangles_agree_everywhere() {
    // Slivers along a common direction, seen along it: their distances are uncertain, but the same
    // for every entry point.
    let mut random = Rng::keyed(9);
    for scale in [1.0, 1e4] {
        let along = dvec3(0.6, 0.3, -0.74);
        let triangles: Vec<_> = (0..400)
            .map(|_| {
                let (at, across) = (
                    random.in_cube(0.5) * scale,
                    random.in_cube(0.5) * scale * 1e-6,
                );
                [at, at + along * scale * 0.5 + across, at + along * scale]
            })
            .collect();
        let rays: Vec<Ray> = (0..800)
            .map(|i| {
                let target = triangles[i / 2][i % 3];
                let origin =
                    (target - along * scale + random.in_cube(0.5) * scale * 1e-7).as_vec3();
                Ray {
                    origin,
                    direction: target.as_vec3() - origin,
                    t_min: 0.0,
                    t_max: f32::INFINITY,
                }
            })
            .collect();
        let scene = Arc::new(scene_from_triangles(&triangles));
        let tracers: Vec<Tracer> = levels()
            .into_iter()
            .map(|level| Tracer::with_level(scene.clone(), DVec3::ZERO, level))
            .collect();
        assert_packets_agree(&tracers, &rays);
        for ray in &rays {
            let mut first = None;
            tracers[0].all_hits(ray, &mut |hit| first = first.or(Some(hit)));
            assert!(
                tracers
                    .iter()
                    .all(|tracer| bits(tracer.closest(ray)) == bits(first))
            );
        }
    }
}

#[test]
fn lowest_index_wins_equal_hits() {
    let mut random = Rng::keyed(7);
    let mut triangles = soup(&mut random, 40, 0.5, 1.0);
    let copies = triangles.clone();
    for _ in 0..5 {
        triangles.extend(copies.iter().copied());
    }
    let tracer = Tracer::new(Arc::new(scene_from_triangles(&triangles)), DVec3::ZERO);
    for ray in rays_for(&mut random, 400, 1.0) {
        let mut all = Vec::new();
        tracer.all_hits(&ray, &mut |hit| all.push(hit));
        assert_eq!(all.len() % 6, 0, "every copy is hit");
        assert!(tracer.closest(&ray).is_none_or(|hit| hit.primitive < 40));
    }
    // Coincident triangles, more than fit in a leaf.
    let many = vec![
        [
            dvec3(-1.0, -1.0, -2.0),
            dvec3(1.0, -1.0, -2.0),
            dvec3(0.0, 1.0, -2.0)
        ];
        5000
    ];
    let tracer = Tracer::new(Arc::new(scene_from_triangles(&many)), DVec3::ZERO);
    let ray = Ray {
        origin: Vec3::ZERO,
        direction: Vec3::NEG_Z,
        t_min: 0.0,
        t_max: f32::INFINITY,
    };
    assert_eq!(
        tracer.closest(&ray).map(|h| (h.primitive, h.t)),
        Some((0, 2.0))
    );
    let mut count = 0;
    tracer.all_hits(&ray, &mut |_| count += 1);
    assert_eq!(count, 5000);
}
