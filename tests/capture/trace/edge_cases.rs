//! Edge cases of the tracer: the range of `t`, cut-outs, invalid input.

use super::oracle::{bits, scene_from_triangles};
use glam::{DVec3, Vec2, Vec3, dvec3, vec3};
use headbox_scene::material::{Cutout, Material, Texture};
use headbox_scene::scene::Scene;
use headbox_scene::scene::Triangle;
use headbox_trace::bvh::{HitPacket, PACKET, Ray, RayPacket, Tracer};
use std::sync::Arc;

const GOOD: [DVec3; 3] = [
    dvec3(-1.0, -1.0, -2.0),
    dvec3(1.0, -1.0, -2.0),
    dvec3(0.0, 1.0, -2.0),
];
const AHEAD: Ray = Ray {
    origin: Vec3::ZERO,
    direction: Vec3::NEG_Z,
    t_min: 0.0,
    t_max: f32::INFINITY,
};

#[test]
fn the_range_of_t_is_closed() {
    let tracer = Tracer::new(Arc::new(scene_from_triangles(&[GOOD])), DVec3::ZERO);
    let hits = |t_min, t_max| {
        let ray = Ray {
            t_min,
            t_max,
            ..AHEAD
        };
        let packet = tracer.closest_packet(&RayPacket::from_rays(&[ray; PACKET]));
        assert_eq!(bits(packet.hit(15)), bits(tracer.closest(&ray)));
        tracer.occluded(&ray)
    };
    assert!(hits(0.0, f32::INFINITY) && hits(2.0, 2.0) && hits(0.0, 2.0) && hits(2.0, 3.0));
    assert!(!hits(0.0, 1.999) && !hits(2.001, 3.0) && !hits(3.0, 1.0) && !hits(-1.0, 3.0));
}

/// Two quads of two triangles, at z = -1 and -2; the left half of the first one's texture is a
/// hole.
fn cutout_scene() -> Scene {
    let texels = [[255, 255, 255, 0], [255, 255, 255, 255]];
    let texels: Vec<[u8; 4]> = (0..64).map(|i| texels[usize::from(i % 8 >= 4)]).collect();
    let quad = |z: f64| {
        let p = [[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]].map(|[x, y]| dvec3(x, y, z));
        [[p[0], p[1], p[2]], [p[0], p[2], p[3]]]
    };
    let mut scene = scene_from_triangles(&[quad(-1.0), quad(-2.0)].concat());
    let uv = |p: &DVec3| Vec2::new((p.x as f32 + 1.0) / 2.0, (p.y as f32 + 1.0) / 2.0);
    scene.texcoords = scene.positions.iter().map(uv).collect();
    scene.textures = vec![Texture::new(8, 8, texels).expect("8x8")];
    let cutout = Some(Cutout {
        texture: Some(0),
        threshold: 0.5,
    });
    scene.materials.push(Material {
        cutout,
        ..Material::default()
    });
    scene
        .triangles
        .iter_mut()
        .take(2)
        .for_each(|t| t.material = 1);
    scene
}

#[test]
fn cutouts_let_rays_through_where_alpha_is_low() {
    let scene = cutout_scene();
    let opaque = Scene {
        texcoords: Vec::new(),
        ..scene.clone()
    };
    let [tracer, opaque] = [scene, opaque].map(|scene| Tracer::new(Arc::new(scene), DVec3::ZERO));
    let rays: Vec<Ray> = (0..PACKET)
        .map(|k| Ray {
            origin: vec3((k as f32 + 0.5) / 8.0 - 1.0, 0.3, 0.0),
            t_max: 1.5,
            ..AHEAD
        })
        .collect();
    let packet = RayPacket::from_rays(&rays);
    // Half a texel on either side of the hole's border (and of the texture's, which wraps) is
    // blended.
    for k in (1..7).chain(9..15) {
        let expected = (k >= 8).then_some(1.0);
        assert_eq!(tracer.closest(&rays[k]).map(|h| h.t), expected, "ray {k}");
        assert_eq!(tracer.occluded(&rays[k]), k >= 8);
        assert_eq!(tracer.closest_packet(&packet).hit(k).map(|h| h.t), expected);
        assert_eq!(tracer.occluded_packet(&packet) >> k & 1 == 1, k >= 8);
        assert_eq!(
            opaque.closest(&rays[k]).map(|h| h.t),
            Some(1.0),
            "no texture coordinates: opaque"
        );
        let far = Ray {
            t_max: 9.0,
            ..rays[k]
        };
        assert_eq!(
            tracer.closest(&far).map(|h| h.t),
            Some(if k >= 8 { 1.0 } else { 2.0 })
        );
    }
}

/// Rays that hit nothing by definition.
fn invalid_rays() -> [Ray; 7] {
    [
        Ray {
            origin: vec3(0.0, f32::NAN, 0.0),
            ..AHEAD
        },
        Ray {
            direction: vec3(0.0, f32::NAN, -1.0),
            ..AHEAD
        },
        Ray {
            direction: vec3(f32::INFINITY, 0.0, -1.0),
            ..AHEAD
        },
        Ray {
            direction: Vec3::ZERO,
            ..AHEAD
        },
        Ray {
            origin: vec3(0.0, 0.0, 3e38),
            ..AHEAD
        },
        Ray {
            t_min: f32::NAN,
            ..AHEAD
        },
        Ray {
            t_max: f32::NAN,
            ..AHEAD
        },
    ]
}

#[test]
fn invalid_triangles_are_never_hit() {
    let line = |x: f64| {
        [
            dvec3(-1.0, 0.0, -1.0),
            dvec3(x, 0.0, -1.0),
            dvec3(1.0, 0.0, -1.0),
        ]
    };
    let huge = [
        dvec3(-1e30, 0.0, -1.0),
        dvec3(1e30, -1e30, -1.0),
        dvec3(1e30, 1e30, -1.0),
    ];
    let point = [dvec3(0.1, 0.2, -1.0); 3];
    let triangles = [
        [DVec3::NAN; 3],
        point,
        line(0.0),
        line(f64::INFINITY),
        huge,
        GOOD,
    ];
    let tracer = Tracer::new(Arc::new(scene_from_triangles(&triangles)), DVec3::ZERO);
    assert_eq!(
        tracer.closest(&AHEAD).map(|h| (h.primitive, h.t)),
        Some((5, 2.0))
    );
    assert!(tracer.triangle(0)[0].is_nan());
    let mut scene = scene_from_triangles(&[GOOD]);
    scene.triangles.push(Triangle {
        vertices: [7, 8, 9],
        material: 3,
    });
    let tracer = Tracer::new(Arc::new(scene), DVec3::ZERO);
    assert_eq!(tracer.closest(&AHEAD).map(|h| h.primitive), Some(0));
    assert!(
        tracer.triangle(1)[0].is_nan() && tracer.triangle(2)[0].is_nan(),
        "indices out of range"
    );
}

#[test]
fn invalid_rays_miss_without_affecting_packet() {
    let tracer = Tracer::new(Arc::new(scene_from_triangles(&[GOOD])), DVec3::ZERO);
    for ray in &invalid_rays() {
        assert_eq!(tracer.closest(ray), None, "{ray:?}");
        assert!(!tracer.occluded(ray));
        tracer.all_hits(ray, &mut |hit| panic!("{ray:?} has {hit:?}"));
    }
    let mixed: Vec<Ray> = invalid_rays()
        .into_iter()
        .flat_map(|ray| [ray, AHEAD])
        .chain([AHEAD; 2])
        .collect();
    let packet = RayPacket::from_rays(&mixed);
    let (hits, blocked) = (
        tracer.closest_packet(&packet),
        tracer.occluded_packet(&packet),
    );
    for (k, ray) in mixed.iter().enumerate() {
        assert_eq!(hits.hit(k), tracer.closest(ray));
        assert_eq!(blocked >> k & 1 == 1, tracer.occluded(ray));
    }
    assert_eq!(blocked.count_ones(), 9);
}

#[test]
fn empty_scene_is_a_miss() {
    let packet = RayPacket::from_rays(&[AHEAD; PACKET]);
    for triangles in [&[][..], &[[DVec3::NAN; 3]]] {
        let tracer = Tracer::new(Arc::new(scene_from_triangles(triangles)), DVec3::ZERO);
        assert_eq!(tracer.closest(&AHEAD), None);
        assert!(!tracer.occluded(&AHEAD));
        assert_eq!(tracer.closest_packet(&packet), HitPacket::MISS);
        assert_eq!(tracer.occluded_packet(&packet), 0);
    }
    let tracer = Tracer::new(Arc::new(scene_from_triangles(&[GOOD])), DVec3::ZERO);
    assert_eq!(tracer.closest_packet(&RayPacket::EMPTY), HitPacket::MISS);
}

#[test]
fn a_triangle_too_small_for_its_edge_functions_is_still_hit() {
    // Products of its coordinates are below the smallest f32: every rounded edge function is zero.
    let s = 1e-25;
    let tiny = [dvec3(-s, -s, -1.0), dvec3(s, -s, -1.0), dvec3(0.0, s, -1.0)];
    let tracer = Tracer::new(Arc::new(scene_from_triangles(&[GOOD, tiny])), DVec3::ZERO);
    let packet = RayPacket::from_rays(&[AHEAD; PACKET]);
    assert_eq!(
        tracer.closest(&AHEAD).map(|h| (h.primitive, h.t)),
        Some((1, 1.0))
    );
    assert_eq!(
        bits(tracer.closest_packet(&packet).hit(3)),
        bits(tracer.closest(&AHEAD))
    );
    let short = Ray {
        t_max: 1.5,
        ..AHEAD
    };
    assert!(tracer.occluded(&short));
    assert_eq!(
        tracer.occluded_packet(&RayPacket::from_rays(&[short; PACKET])),
        u16::MAX
    );
    assert!(!tracer.occluded(&Ray {
        t_max: 0.5,
        ..AHEAD
    }));
}
