//! Light of a capture, which obeys known answers.

use super::room::{Boxes, capture, room, spec, spec_with};
use glam::{DVec3, Vec3, dvec3};
use headbox_core::color::exposure::Exposure;
use headbox_core::color::srgb8_from_linear;
use headbox_core::cube_face::Face;
use headbox_core::headbox::Headbox;
use headbox_cube::model::parameters::CaptureParameters;
use headbox_ldi::spec::CaptureSpec;
use headbox_scene::scene::{Sky, SkyGradient, Sun};
use headbox_trace::bvh::Tracer;
use headbox_trace::light::{LightSample, Lighting, LitPoint};
use std::sync::Arc;

/// Mean of many light samples at a point.
fn light_at(lighting: &Lighting, tracer: &Tracer, position: Vec3, normal: Vec3) -> [f32; 3] {
    const SAMPLES: u32 = 65_536;
    let point = LitPoint {
        position,
        normal,
        shading_normal: normal,
        extent: 100.0,
    };
    let mut sum = Vec3::ZERO;
    for index in 0..SAMPLES {
        let sample = LightSample { stream: 5, index };
        sum += Vec3::from_array(lighting.radiosity_per_albedo(tracer, &point, &sample));
    }
    (sum / SAMPLES as f32).to_array()
}

#[test]
fn light_agrees_with_closed_forms() {
    // A floor of 200 x 200 m under a uniform sky of radiance 0.5 and a sun at 60 degrees from the
    // zenith.
    let mut boxes = Boxes::default();
    let grey = boxes.material([0.5; 3], [0.0; 3]);
    let mut scene = boxes
        .add(dvec3(0.0, -1.0, 0.0), dvec3(100.0, 1.0, 100.0), grey)
        .0;
    scene.sky = Some(Sky::Gradient(SkyGradient::uniform([0.5; 3])));
    let direction = Vec3::new(3f32.sqrt() / 2.0, 0.5, 0.0);
    scene.sun = Some(Sun {
        direction,
        irradiance: [2.0; 3],
        angular_radius_rad: 0.005,
    });
    let tracer = Tracer::new(Arc::new(scene), DVec3::ZERO);
    let lighting = Lighting::unmetered(&tracer, 3);
    let [up, ..] = light_at(&lighting, &tracer, Vec3::ZERO, Vec3::Y);
    // Sky: irradiance pi * 0.5, over pi. Sun: 2 cos 60 / pi. An open, flat floor sends no light
    // back to itself.
    let expected = 0.5 + 2.0 * 0.5 / std::f32::consts::PI;
    assert!((up - expected).abs() < 2e-3, "{up} for {expected}");
    let [down, ..] = light_at(&lighting, &tracer, Vec3::new(0.0, -2.0, 0.0), Vec3::NEG_Y);
    assert!(
        (down - 0.5).abs() < 1e-6,
        "below the floor there is no sun: {down}"
    );
}

#[test]
fn closed_furnace_is_uniform() {
    // Walls of albedo 0.5 that emit 1: radiance is 1 / (1 - 0.5) = 2 in the limit of many bounces,
    // 2 - 0.5^n after n terms. Emission reaches a point by next-event estimation only, so radiosity
    // per albedo must be 2 - 0.5^bounces.
    let mut boxes = Boxes::default();
    let glowing = boxes.material([0.5; 3], [1.0; 3]);
    let scene = Arc::new(boxes.add(DVec3::ZERO, DVec3::splat(2.0), glowing).0);
    let tracer = Tracer::new(scene, DVec3::ZERO);
    for (bounces, expected) in [(0, 1.0), (1, 1.5), (2, 1.75), (12, 2.0)] {
        let mut lighting = Lighting::unmetered(&tracer, bounces);
        lighting.exposure = 1e3; // light far above white is not limited
        let [light, ..] = light_at(&lighting, &tracer, Vec3::new(0.3, -2.0, 0.1), Vec3::Y);
        // 65,536 samples; paths that end near a corner are rare and bright, with a standard
        // deviation of about 3.
        assert!(
            (light - expected).abs() < 4.0 * 3.0 / 256.0,
            "{bounces} bounces: {light} for {expected}"
        );
    }
}

#[test]
fn bounced_light_stays_in_place() {
    // A red wall and a green one, and a lamp under a plate on the floor: the ceiling has all of its
    // light from walls and floor.
    let mut boxes = Boxes::default();
    let grey = boxes.material([0.7; 3], [0.0; 3]);
    let [red, green] =
        [[0.8, 0.05, 0.05], [0.05, 0.8, 0.05]].map(|albedo| boxes.material(albedo, [0.0; 3]));
    let lamp = boxes.material([0.5; 3], [6.0; 3]);
    let boxes = boxes.add(DVec3::ZERO, dvec3(2.0, 1.5, 2.0), grey);
    let boxes = boxes.add(dvec3(1.95, 0.0, 0.0), dvec3(0.04, 1.4, 1.9), red);
    let boxes = boxes.add(dvec3(-1.95, 0.0, 0.0), dvec3(0.04, 1.4, 1.9), green);
    let boxes = boxes.add(dvec3(0.0, -0.9, 0.0), dvec3(0.4, 0.02, 0.4), grey);
    let scene = Arc::new(
        boxes
            .add(dvec3(0.0, -1.4, 0.0), dvec3(0.3, 0.04, 0.3), lamp)
            .0,
    );
    let ldi = capture(&spec_with(|p| p.light_samples = 64), &scene);
    let tracer = Tracer::new(scene, DVec3::ZERO);
    let lighting = Lighting::measure(&tracer, 1);
    let face = &ldi.faces[Face::PosY.index()];
    let more_red = |color: [u8; 3]| i32::from(color[0]) - i32::from(color[1]);
    let [left, right] = [-1.3, 1.3].map(|x| {
        let place = dvec3(x, 1.5, 0.3);
        let [column, row, _] = Face::PosY.project(place, face.size_px);
        let [r, g, b, _] = face
            .pixel(column as u32, row as u32)
            .last()
            .unwrap()
            .color_srgb;
        let light = light_at(&lighting, &tracer, place.as_vec3(), Vec3::NEG_Y);
        let [found, expected] = [[r, g, b], lighting.stored(Vec3::from_array(light) * 0.7)];
        let apart = found
            .iter()
            .zip(expected)
            .map(|(a, b)| a.abs_diff(b))
            .max()
            .unwrap();
        // With the light of one cell for all, the error is 60 levels here.
        assert!(apart < 10, "{found:?} for {expected:?} at {x}");
        more_red(found)
    });
    assert!(
        right > 5 && left < -5,
        "{left} on the left, {right} on the right"
    );
}

#[test]
fn fill_light_only_in_dark_rooms() {
    let mut boxes = Boxes::default();
    let grey = boxes.material([0.5; 3], [0.0; 3]);
    let closed = Arc::new(boxes.add(DVec3::ZERO, DVec3::splat(2.0), grey).0);
    let lighting = Lighting::measure(&Tracer::new(Arc::clone(&closed), DVec3::ZERO), 1);
    assert!(lighting.fill.radiance > 0.0 && lighting.exposure.is_finite());
    let ldi = capture(&spec_with(|p| p.light_samples = 16), &closed);
    let bright = ldi
        .faces
        .iter()
        .flat_map(|f| &f.samples)
        .filter(|s| s.color_srgb[0] > 60)
        .count();
    let all: usize = ldi.faces.iter().map(|f| f.samples.len()).sum();
    assert!(bright * 10 > all * 9, "{bright} of {all} can be seen");
    let lighting = Lighting::measure(&Tracer::new(room(), DVec3::ZERO), 1);
    assert_eq!(lighting.fill.radiance, 0.0, "a room with a lamp needs none");
}

#[test]
fn unlit_capture_shows_albedo() {
    let ldi = capture(&spec_with(|p| p.light_samples = 0), &room());
    let exposure = ldi.info.exposure;
    let wall = [0.7, 0.6, 0.5].map(|c| srgb8_from_linear(c * exposure));
    let corner = ldi.faces[Face::NegX.index()]
        .pixel(24, 24)
        .last()
        .unwrap()
        .color_srgb;
    for c in 0..3 {
        assert!(corner[c].abs_diff(wall[c]) <= 1, "{corner:?} for {wall:?}");
    }
}

#[test]
fn sun_shadow_edge_is_one_pixel() {
    // A floor 1 m below the headbox's centre, and a slab that shades half of it: the sun stands in
    // the plane x = 0.
    let mut boxes = Boxes::default();
    let white = boxes.material([0.8; 3], [0.0; 3]);
    let boxes = boxes.add(dvec3(0.0, -2.0, 0.0), dvec3(8.0, 1.0, 8.0), white);
    let mut scene = boxes
        .add(dvec3(3.0, 4.0, 0.0), dvec3(3.0, 0.1, 40.0), white)
        .0;
    let direction = Vec3::new(0.0, 0.8, 0.6);
    scene.sun = Some(Sun {
        direction,
        irradiance: [2.0; 3],
        angular_radius_rad: 1e-4,
    });
    scene.headbox = Some(Headbox {
        centre: DVec3::ZERO,
        half_size_m: 0.2,
    });
    scene.exposure = Exposure::Stops(1.0); // the lit floor is just below white
    let parameters = CaptureParameters {
        light_samples: 1,
        seed: 7,
        ..CaptureParameters::unlit(8, 24)
    };
    let ldi = capture(
        &CaptureSpec {
            face_size_px: 128,
            parameters,
            ..spec()
        },
        &Arc::new(scene),
    );
    let face = &ldi.faces[Face::NegY.index()];
    let level = |x: u32, y: u32| {
        face.pixel(x, y)
            .first()
            .map(|sample| i32::from(sample.color_srgb[0]))
    };
    let (mut lit, mut dark) = (Vec::new(), Vec::new());
    // The edge runs through the middle of the face: the slab begins at x = 0.
    for (x, y) in (8..120)
        .flat_map(|y| (8..120).map(move |x| (x, y)))
        .filter(|(x, _)| !(63..65).contains(x))
    {
        let side = if x < 64 { &mut lit } else { &mut dark };
        side.extend(level(x, y));
    }
    let ends = |levels: &[i32]| {
        [
            levels.iter().min().copied().unwrap(),
            levels.iter().max().copied().unwrap(),
        ]
    };
    let ([lit_low, lit_high], [dark_low, dark_high]) = (ends(&lit), ends(&dark));
    assert!(
        lit_low > dark_high + 80 || dark_low > lit_high + 80,
        "{lit_low}..{lit_high} and {dark_low}..{dark_high}"
    );
    assert!(
        lit_high - lit_low < 3 && dark_high - dark_low < 3,
        "{lit_low}..{lit_high} and {dark_low}..{dark_high}"
    );
}
