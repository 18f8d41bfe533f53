//! Sky images as light, compared with closed forms.

use crate::folder::Folder;
use glam::{DVec3, Vec3, dvec3};
use headbox_core::color::luminance;
use headbox_scene::material::Material;
use headbox_scene::scene::{Scene, Sky, SkyGradient, SkyPicture, Triangle};
use headbox_trace::bvh::Tracer;
use headbox_trace::light::{LightSample, Lighting, LitPoint};
use std::f64::consts::{PI, TAU};
use std::sync::Arc;

pub(super) const SAMPLES: u32 = 4096;

/// A floor of albedo 1 about the origin, facing up, without light.
pub(super) fn floor() -> Scene {
    let corner = |x: f64, z: f64| dvec3(x * 100.0, 0.0, z * 100.0);
    let triangle = |vertices| Triangle {
        vertices,
        material: 0,
    };
    Scene {
        positions: vec![
            corner(-1.0, -1.0),
            corner(-1.0, 1.0),
            corner(1.0, 1.0),
            corner(1.0, -1.0),
        ],
        triangles: vec![triangle([0, 1, 2]), triangle([0, 2, 3])],
        materials: vec![Material {
            albedo: [1.0; 3],
            ..Material::default()
        }],
        ..Scene::default()
    }
}

/// Mean of the light on the floor, seen from above, and its standard error for independent samples.
pub(super) fn light_on(scene: Scene, at: Vec3) -> (Vec3, f32) {
    let tracer = Tracer::new(Arc::new(scene), DVec3::ZERO);
    let lighting = Lighting::unmetered(&tracer, 1);
    let point = LitPoint {
        position: at,
        normal: Vec3::Y,
        shading_normal: Vec3::Y,
        extent: 100.0,
    };
    let (mut sum, mut squares) = (Vec3::ZERO, 0.0);
    for index in 0..SAMPLES {
        let light = Vec3::from(lighting.radiosity_per_albedo(
            &tracer,
            &point,
            &LightSample { stream: 3, index },
        ));
        sum += light;
        squares += luminance(light.to_array()).powi(2);
    }
    let mean = sum / SAMPLES as f32;
    let variance = squares / SAMPLES as f32 - luminance(mean.to_array()).powi(2);
    (mean, (variance.max(0.0) / SAMPLES as f32).sqrt())
}

fn picture(width: u32, radiance: impl Fn(u32, u32) -> [f32; 3]) -> SkyPicture {
    let texels = (0..width / 2)
        .flat_map(|y| (0..width).map(move |x| (x, y)))
        .map(|(x, y)| radiance(x, y));
    SkyPicture::new([width, width / 2], texels.collect(), 0.0).expect("a sky")
}

fn floor_under(picture: SkyPicture) -> Scene {
    Scene {
        sky: Some(Sky::Picture(Arc::new(picture))),
        ..floor()
    }
}

/// Irradiance over pi on level ground from texel (x, y) of a picture with a radiance of 1 there:
/// the integral of the cosine over its solid angle, over pi.
fn texel_irradiance(width: u32, y: u32) -> f64 {
    let sin2 = |y: u32| (f64::from(y) * TAU / f64::from(width)).sin().powi(2);
    TAU / f64::from(width) * (sin2(y + 1) - sin2(y)) / 2.0 / PI
}

#[test]
fn white_furnace_floor_equals_sky() {
    for width in [2, 6, 64] {
        let (light, error) = light_on(
            floor_under(picture(width, |_, _| [2.0, 1.0, 0.5])),
            Vec3::ZERO,
        );
        // Half of the directions sampled by the sky lie below the floor: a sample varies by less
        // than its mean.
        let tolerance = 4.0 / (SAMPLES as f32).sqrt();
        assert!(
            (light - Vec3::new(2.0, 1.0, 0.5)).abs().max_element() < tolerance,
            "{width}: {light}, {error}"
        );
        let gradient = Scene {
            sky: Some(Sky::Gradient(SkyGradient::uniform([2.0, 1.0, 0.5]))),
            ..floor()
        };
        assert!(
            (light - light_on(gradient, Vec3::ZERO).0)
                .abs()
                .max_element()
                < tolerance
        );
    }
}

#[test]
fn bright_texel_lights_by_solid_angle() {
    const WIDTH: u32 = 512;
    for y in [2, 60, 120] {
        let bright = 1e5;
        let sky = picture(WIDTH, |x, at| {
            if (x, at) == (77, y) {
                [bright; 3]
            } else {
                [0.01; 3]
            }
        });
        let expected = f64::from(bright) * texel_irradiance(WIDTH, y) + 0.01;
        let (light, error) = light_on(floor_under(sky), Vec3::ZERO);
        let off = (f64::from(light.x) - expected).abs();
        assert!(
            off < 4.0 * f64::from(error) + 1e-4 * expected,
            "row {y}: {light} for {expected}, +- {error}"
        );
        // Cosine-weighted rays alone would hit it once in 100,000. Tolerance: half of its light.
        assert!(
            f64::from(error) < 0.02 * expected,
            "row {y}: +- {error} of {expected}"
        );
    }
}

#[test]
fn sky_image_lights_from_its_direction() {
    // One bright texel in the middle row of the upper half, a quarter of a turn east of the middle:
    // a wall that faces east is lit.
    let sky = |turn: f64| {
        let mut texels = vec![[0.0; 3]; 64 * 32];
        texels[10 * 64 + 48] = [100.0; 3];
        SkyPicture::new([64, 32], texels, turn).expect("a sky")
    };
    for (turn, toward) in [
        (0.0, Vec3::X),
        (90.0, Vec3::Z),
        (-90.0, Vec3::NEG_Z),
        (450.0, Vec3::Z),
    ] {
        let sky = sky(turn);
        let (direction, radiance) = sky.sample([0.4, 0.6]).expect("not black");
        assert_eq!(radiance, [100.0; 3]);
        let level = Vec3::new(direction.x, 0.0, direction.z).normalize();
        assert!(level.dot(toward) > 0.99, "{turn}: {direction}");
        assert_eq!(sky.radiance(direction), [100.0; 3]);
        assert_eq!(sky.radiance(-direction), [0.0; 3]);
        // A camera sees it in the same direction, and half of it half way to the next texel.
        let [seen, ..] = sky.seen(direction);
        assert!(seen > 20.0, "{seen}");
    }
    assert!(
        picture(2, |_, _| [0.0; 3]).sample([0.5; 2]).is_none(),
        "a black sky"
    );
}

#[test]
fn sky_draw_density_matches_pdf() {
    let sky = picture(32, |x, y| {
        [((x * 7 + y * 3) % 11) as f32, 1.0, (y % 4) as f32]
    });
    // The mean of one over the density over all draws is the solid angle of all directions.
    let mut sum = 0.0;
    for i in 0..SAMPLES {
        let square = [
            (i as f32 + 0.5) / SAMPLES as f32,
            (i as f32 * 0.618_034).fract(),
        ];
        let (direction, radiance) = sky.sample(square).expect("not black");
        assert!((direction.length() - 1.0).abs() < 1e-5);
        sum += 1.0 / f64::from(sky.density(radiance));
    }
    let sphere = sum / f64::from(SAMPLES);
    // Densities differ by at most a factor of ten; 4096 draws, stratified in one of two dimensions.
    assert!((sphere / (2.0 * TAU) - 1.0).abs() < 0.03, "{sphere}");
}

#[test]
fn sun_in_sky_image_lights_as_sun() {
    const WIDTH: u32 = 1024;
    let (sun_y, size) = (100, 3);
    let is_sun = |x: u32, y: u32| x.abs_diff(300) < size && y.abs_diff(sun_y) < size;
    let whole = picture(WIDTH, |x, y| {
        if is_sun(x, y) {
            [3e4, 2e4, 1e4]
        } else {
            [0.5; 3]
        }
    });
    let expected: f64 = 0.5
        + (sun_y + 1 - size..sun_y + size)
            .map(|y| 5.0 * (3e4 - 0.5) * texel_irradiance(WIDTH, y))
            .sum::<f64>();
    let before = light_on(floor_under(whole.clone()), Vec3::ZERO);
    let (rest, sun) = whole.without_sun();
    let sun = sun.expect("a sun");
    let toward = rest.radiance(sun.direction);
    assert!(toward[0] < 1.0, "its light is taken out: {toward:?}");
    assert!(rest.seen(sun.direction)[0] > 1e4, "an eye still sees it");
    let radius_deg = sun.angular_radius_rad.to_degrees();
    assert!(
        (0.6..1.4).contains(&radius_deg),
        "five texels of a third of a degree: {radius_deg}"
    );
    let after = light_on(
        Scene {
            sun: Some(sun),
            ..floor_under(rest)
        },
        Vec3::ZERO,
    );
    for (name, (light, error)) in [("in the picture", before), ("taken out", after)] {
        let off = (f64::from(light.x) - expected).abs() / expected;
        assert!(
            off < 0.01 + 4.0 * f64::from(error) / expected,
            "{name}: {light} for {expected}"
        );
    }
    assert!(
        after.1 < before.1,
        "and with less noise: {} and {}",
        after.1,
        before.1
    );
    // A wide bright window is not a sun.
    let (_, none) = picture(256, |x, y| {
        if x < 64 && y < 40 {
            [50.0; 3]
        } else {
            [0.5; 3]
        }
    })
    .without_sun();
    assert_eq!(none, None);
}

#[test]
fn sky_scaling_keeps_energy() {
    let sky = picture(90, |x, y| [(x + y) as f32, 1.0, 3.0]);
    let mean = |sky: &SkyPicture| {
        sky.texels().iter().map(|t| f64::from(t[0])).sum::<f64>() / sky.texels().len() as f64
    };
    let small = sky.times(2.0).reduced(30);
    assert_eq!(small.size(), [30, 15]);
    assert!((mean(&small) - 2.0 * mean(&sky)).abs() < 1e-3);
    assert_eq!(sky.reduced(1000).size(), [90, 45]);
    assert_eq!(sky.reduced(0).size(), [2, 1]);
}

/// A Radiance file of one colour, without compression.
fn hdr(width: u32, height: u32, rgbe: [u8; 4]) -> Vec<u8> {
    let mut file =
        format!("#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y {height} +X {width}\n").into_bytes();
    (0..width * height).for_each(|_| file.extend(rgbe));
    file
}

fn exr(width: usize, height: usize, value: f32) -> Vec<u8> {
    use exr::prelude::{SpecificChannels, WritableImage};
    let channels = SpecificChannels::rgb(|at: exr::math::Vec2<usize>| {
        let v = if at == exr::math::Vec2(1, 0) {
            value
        } else {
            0.25
        };
        (v, 0.5f32, 0.5f32)
    });
    let mut bytes = std::io::Cursor::new(Vec::new());
    let image = exr::prelude::Image::from_channels((width, height), channels);
    image
        .write()
        .to_buffered(&mut bytes)
        .expect("written to memory");
    bytes.into_inner()
}

#[test]
fn skies_are_read_or_refused() {
    let folder = Folder::new();
    // 2^(129 - 136) times 128: a radiance of 1.
    let read = |name: &str, bytes: Vec<u8>| {
        folder.write(name, bytes);
        SkyPicture::read(&folder.path(name), 0.0)
    };
    let sky = read("good.hdr", hdr(4, 2, [128, 64, 0, 129])).expect("a sky");
    assert_eq!((sky.size(), sky.texels()[3]), ([4, 2], [1.0, 0.5, 0.0]));
    let sky = read("good.EXR", exr(4, 2, 7.0)).expect("a sky");
    assert_eq!(
        (sky.texels()[1], sky.texels()[7]),
        ([7.0, 0.5, 0.5], [0.25, 0.5, 0.5])
    );
    let sun = read("inf.exr", exr(4, 2, f32::INFINITY)).expect("a sun in half floats");
    assert_eq!(sun.texels()[1], [65_504.0, 0.5, 0.5]);
    assert_eq!(
        read("negative.exr", exr(4, 2, -1e-3))
            .expect("resampled")
            .texels()[1],
        [0.0, 0.5, 0.5]
    );
    let huge = b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 60000 +X 120000\n".to_vec();
    let wrong = [
        ("square.hdr", hdr(3, 3, [128, 1, 1, 128]), "3x3"),
        ("one.hdr", hdr(1, 1, [128, 1, 1, 128]), "1x1"),
        (
            "cut.hdr",
            hdr(4, 2, [128, 1, 1, 128])[..60].to_vec(),
            "cut.hdr",
        ),
        ("huge.hdr", huge, "120000x60000"),
        ("nan.exr", exr(4, 2, f32::NAN), "column 1 of row 0"),
        ("text.exr", b"no picture".to_vec(), "text.exr"),
        ("picture.png", b"no picture".to_vec(), ".hdr or .exr"),
    ];
    for (name, bytes, says) in wrong {
        let error = read(name, bytes).expect_err(name).to_string();
        assert!(
            error.contains(name) && error.contains(says) && !error.contains('\n'),
            "{name}: {error}"
        );
    }
    let missing = SkyPicture::read(&folder.path("none.hdr"), 0.0)
        .expect_err("missing")
        .to_string();
    assert!(missing.contains("none.hdr"), "{missing}");
}
