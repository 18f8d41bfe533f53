//! Lamps of glTF files and the exposure, compared with closed forms.

use super::sky::{SAMPLES, floor, light_on};
use crate::folder::Folder;
use glam::{DVec3, Vec3, dvec3};
use headbox_core::color::exposure::Exposure;
use headbox_core::color::luminance;
use headbox_scene::load::LoadOptions;
use headbox_scene::scene::{Lamp, Reach, Scene, Sky, Sun};
use headbox_trace::bvh::Tracer;
use headbox_trace::light::{LightSample, Lighting, LitPoint};
use std::f64::consts::PI;
use std::sync::Arc;

#[test]
fn lamps_light_by_the_formula() {
    let position = dvec3(1.0, 2.0, -0.5);
    let at = Vec3::new(0.2, 0.0, 0.3);
    let offset = position - at.as_dvec3();
    let (distance2, cos) = (offset.length_squared(), offset.y / offset.length());
    let lit = |reach: Reach| {
        let scene = Scene {
            lamps: vec![Lamp {
                intensity: [10.0, 5.0, 1.0],
                reach,
            }],
            ..floor()
        };
        let (light, error) = light_on(scene, at);
        assert!(
            error < 1e-3 * light.x.max(1.0),
            "a lamp makes no noise where nothing bounces: {error}"
        );
        f64::from(light.x)
    };
    // Rays start 0.4 mm above a floor of 100 m, relative to the 2 m to the lamp; the ramp of a cone
    // multiplies the error by ten.
    let close = |found: f64, expected: f64| {
        assert!(
            (found - expected).abs() < 2e-3 * expected,
            "{found} for {expected}"
        );
    };
    close(
        lit(Reach::Point {
            position,
            range_m: f32::INFINITY,
        }),
        10.0 * cos / distance2 / PI,
    );
    let range_m = 3.0;
    let window = 1.0 - (distance2 / 9.0).powi(2);
    close(
        lit(Reach::Point { position, range_m }),
        10.0 * cos / distance2 / PI * window,
    );
    assert_eq!(
        lit(Reach::Point {
            position,
            range_m: 2.0
        }),
        0.0,
        "out of its range"
    );
    let direction = offset.normalize().as_vec3();
    close(lit(Reach::Distant { direction }), 10.0 * cos / PI);
    // The axis points straight down; the point is 22 degrees off it, half way between the cosines
    // of the ramp.
    let [inner, outer] = [(cos + 0.05) as f32, (cos - 0.05) as f32];
    let spot = |cosines| Reach::Spot {
        position,
        range_m: f32::INFINITY,
        axis: Vec3::NEG_Y,
        cosines,
    };
    close(
        lit(spot([inner, outer])),
        10.0 * cos / distance2 / PI * 0.25,
    );
    close(
        lit(spot([cos as f32 - 0.01, outer])),
        10.0 * cos / distance2 / PI,
    );
    assert_eq!(
        lit(spot([0.999, cos as f32 + 0.01])),
        0.0,
        "outside of its cone"
    );
}

#[test]
fn many_lamps_bounce_light_of_all() {
    // The floor is lit by two lamps; a point 1 m above it that faces down sees only the lit floor.
    let lamp = |x: f64, power: f32| Lamp {
        intensity: [power; 3],
        reach: Reach::Point {
            position: dvec3(x, 3.0, 0.0),
            range_m: f32::INFINITY,
        },
    };
    let bounced = |lamps: Vec<Lamp>| {
        let tracer = Tracer::new(Arc::new(Scene { lamps, ..floor() }), DVec3::ZERO);
        let mut lighting = Lighting::unmetered(&tracer, 1);
        lighting.exposure = 1e-3; // no bounce is cut as too bright
        let point = LitPoint {
            position: Vec3::Y,
            normal: Vec3::NEG_Y,
            shading_normal: Vec3::NEG_Y,
            extent: 100.0,
        };
        let one = |index| {
            Vec3::from(lighting.radiosity_per_albedo(
                &tracer,
                &point,
                &LightSample { stream: 1, index },
            ))
        };
        (0..SAMPLES).map(one).sum::<Vec3>().x / SAMPLES as f32
    };
    let (one, other) = (
        bounced(vec![lamp(1.0, 8.0)]),
        bounced(vec![lamp(-2.0, 3.0)]),
    );
    let both = bounced(vec![lamp(1.0, 8.0), lamp(-2.0, 3.0)]);
    // A lamp is drawn with probability proportional to its contribution, so either draw gives the
    // sum of both without noise.
    assert!(
        (both - one - other).abs() < 1e-3 * both,
        "{both} for {one} + {other}"
    );
}

const LAMPS: &str = r#"{"asset":{"version":"2.0"},"extensionsUsed":["KHR_lights_punctual"],"extensionsRequired":["KHR_lights_punctual"],
"extensions":{"KHR_lights_punctual":{"lights":[
{"type":"point","intensity":10,"color":[1,0.5,0.25],"range":8},
{"type":"spot","intensity":4,"spot":{"innerConeAngle":0.2,"outerConeAngle":0.5}},
{"type":"directional","intensity":6},{"type":"directional","intensity":60},
{"type":"point","intensity":-1},{"type":"neon"},{"type":"point","intensity":0}]}},
"nodes":[{"mesh":0},{"translation":[1,2,3],"scale":[2,2,2],"extensions":{"KHR_lights_punctual":{"light":0}}},
{"rotation":[-0.70710678,0,0,0.70710678],"children":[3]},{"translation":[0,0,5],"extensions":{"KHR_lights_punctual":{"light":1}}},
{"extensions":{"KHR_lights_punctual":{"light":2}}},{"rotation":[-0.70710678,0,0,0.70710678],"extensions":{"KHR_lights_punctual":{"light":3}}},
{"extensions":{"KHR_lights_punctual":{"light":4}}},{"extensions":{"KHR_lights_punctual":{"light":5}}},
{"extensions":{"KHR_lights_punctual":{"light":6}}},{"extensions":{"KHR_lights_punctual":{"light":7}}}],
"meshes":[{"primitives":[{"attributes":{"POSITION":0}}]}],
"accessors":[{"bufferView":0,"componentType":5126,"count":3,"type":"VEC3"}],
"bufferViews":[{"buffer":0,"byteLength":36}],
"buffers":[{"byteLength":36,"uri":"data:application/octet-stream;base64,AAAAAAAAAAAAAAAAAACAPwAAAAAAAAAAAAAAAAAAgD8AAAAA"}]}"#;

#[test]
fn gltf_lamps_replace_default_sun() {
    let folder = Folder::new();
    folder.write("lamps.gltf", LAMPS);
    let options = LoadOptions {
        unit_m: Some(0.5),
        ..LoadOptions::default()
    };
    let scene = folder.load_with("lamps.gltf", &options).expect("read");
    let close = |a: Vec3, b: Vec3| assert!((a - b).length() < 1e-6, "{a} for {b}");
    let [point, spot, distant] = scene.lamps[..] else {
        panic!("{:?}", scene.lamps)
    };
    assert_eq!(point.intensity, [10.0, 5.0, 2.5]);
    assert_eq!(
        point.reach,
        Reach::Point {
            position: dvec3(0.5, 1.0, 1.5),
            range_m: 4.0
        }
    );
    // Rotated by -90 degrees about X: -Z points down, and objects at +Z hang above.
    let Reach::Spot {
        position,
        range_m,
        axis,
        cosines,
    } = spot.reach
    else {
        panic!("{spot:?}")
    };
    close(axis, Vec3::NEG_Y);
    close(position.as_vec3(), Vec3::new(0.0, 2.5, 0.0));
    assert_eq!(
        (range_m, cosines),
        (f32::INFINITY, [0.2f32.cos(), 0.5f32.cos()])
    );
    let Reach::Distant { direction } = distant.reach else {
        panic!("{distant:?}")
    };
    close(direction, Vec3::Z);
    let sun = scene.sun.expect("the strongest light from afar");
    close(sun.direction, Vec3::Y);
    assert_eq!(sun.irradiance, [60.0; 3]);
    let brighter = 60.0 / luminance(Sun::default().irradiance);
    assert_eq!(
        scene.sky,
        Some(Sky::default().times(brighter)),
        "the sky goes with its sun"
    );
    let notes = scene.summary.notes.join("; ");
    assert!(
        notes.contains("4 lights of the file light") && notes.contains("3 damaged lights"),
        "{notes}"
    );
}

#[test]
fn exposure_is_metered_or_as_specified() {
    let exposed = |factor: f32, exposure: Exposure| {
        let (sun, sky) = (Sun::default(), Sky::default());
        let sun = Sun {
            irradiance: sun.irradiance.map(|c| c * factor),
            ..sun
        };
        let scene = Scene {
            sun: Some(sun),
            sky: Some(sky.times(factor)),
            exposure,
            ..floor()
        };
        Lighting::measure(&Tracer::new(Arc::new(scene), DVec3::Y), 1).exposure
    };
    let usual = exposed(1.0, Exposure::default());
    assert_eq!(exposed(1.0, Exposure::Auto(-2.0)), usual / 4.0);
    assert_eq!(exposed(1.0, Exposure::Stops(3.0)), 8.0);
    // The same image for any factor between lux and radiance units.
    for factor in [1e-4, 3e4] {
        let off = exposed(factor, Exposure::default()) * factor / usual;
        assert!((off - 1.0).abs() < 0.01, "{factor}: {off}");
    }
}
