//! Promises of composed frames (S25, D14): sprites, cube LDIs and polygons.

use super::files::card;
use super::oracle::look;
use glam::{DVec3, Vec2, Vec3, dvec3};
use headbox::Capture;
use headbox_core::camera::Camera;
use headbox_core::color::tone::ToneMap;
use headbox_core::environment::Environment;
use headbox_core::frame::Frame;
use headbox_core::metrics::psnr_db;
use headbox_core::progress::Silent;
use headbox_cube::model::parameters::CaptureParameters;
use headbox_cube::pack::{CubeLdi, SplatIndexLayout, Split};
use headbox_cube::planes;
use headbox_cube::render::{RenderSettings, Renderer};
use headbox_ldi::capture::SceneCapture;
use headbox_ldi::scene_source::SceneSource;
use headbox_ldi::spec::{CaptureSpec, RunOptions};
use headbox_scene::material::Material;
use headbox_scene::scene::{Scene, Triangle};
use headbox_sprite::compose::{ComposeSettings, Composer, Composition, Layer, Polygons};
use headbox_sprite::{Displacement, Sprite, SpritePlane, SpriteSet, SpriteWithDepth};
use headbox_trace::bvh::Tracer;
use headbox_trace::light::Lighting;
use image::{Rgba, RgbaImage};
use std::sync::Arc;

#[test]
fn sprites_and_a_cube_are_composed_back_to_front() {
    // A captured wall of checks in the plane z = 0, seen from z = 3.
    let source = SceneSource::new("builtin:bump");
    let scene = Arc::new(source.open().expect("built in"));
    let centre = dvec3(0.0, 0.0, 3.0);
    let tracer = Tracer::new(Arc::clone(&scene), centre);
    let spec = CaptureSpec {
        face_size_px: 32,
        parameters: CaptureParameters::unlit(6, 4),
        ..CaptureSpec::new(source, centre, 0.5)
    };
    let lighting = Lighting::unmetered(&tracer, 0);
    let (ldi, _) = SceneCapture::new(&spec, &tracer, &lighting, &RunOptions::default())
        .run()
        .expect("captured");
    let cube = CubeLdi::pack(&ldi, SplatIndexLayout::Normal, Split::Auto).expect("packed");

    let (before, behind) = (dvec3(1.2, 0.0, 1.8), dvec3(0.0, 0.0, -2.0));
    let set = SpriteSet::new(vec![
        card([0, 0, 255, 255], before, DVec3::Z),
        card([255, 0, 0, 255], behind, DVec3::Z),
        card([0, 255, 0, 255], dvec3(0.0, 40.0, 0.0), DVec3::Z),
    ]);
    let composition = Composition::new(set, vec![cube]);
    let order = composition.back_to_front(centre);
    let place = |layer| {
        order
            .iter()
            .position(|&l| l == layer)
            .expect("every layer is drawn")
    };
    assert_eq!(order.len(), 4);
    assert!(place(Layer::Sprite(1)) < place(Layer::Cube(0)), "{order:?}");
    assert!(place(Layer::Cube(0)) < place(Layer::Sprite(0)), "{order:?}");

    let (mut composer, mut frame) = (Composer::default(), Frame::default());
    let mut seen = |eye: DVec3, at: DVec3| {
        let stats = composition.render(
            &mut composer,
            &look(eye, at, 32),
            &ComposeSettings::default(),
            &mut frame,
        );
        assert_eq!(stats.outcomes.len(), 3);
        frame.color[16 * 32 + 16]
    };
    assert_eq!(
        seen(centre, before),
        [0, 0, 255, 255],
        "the blue card hides the wall"
    );
    let [red, green, blue, alpha] = seen(centre, DVec3::ZERO);
    assert!(
        alpha == 255 && red < 255 && green > 0 && blue > 0,
        "beside it the wall hides the red card"
    );
}

#[test]
fn lone_cube_composes_to_own_frame() {
    let scene = headbox::Scene::open("builtin:poles").expect("built in");
    let cube = Capture::new(&scene)
        .face_size(64)
        .strata(6)
        .error_px(0.0)
        .run()
        .expect("captured");
    let (eye, settings) = (
        cube.center() + dvec3(0.1, 0.05, 0.0),
        ComposeSettings::default(),
    );
    let camera = Camera::look_at(eye, eye + dvec3(0.3, 0.2, -1.0), DVec3::Y, 90.0, [120, 90])
        .expect("valid");
    // Holes of a cube among other layers stay open: another layer may be visible there.
    let open = RenderSettings {
        keep_holes: true,
        ..settings.cubes
    };
    let alone = Renderer::new().render(&cube, &camera, &open).clone();
    let partial = alone
        .coverage
        .iter()
        .filter(|pixel| (2..255).contains(&pixel.splat_share()))
        .count();
    let mut composed = Frame::default();
    let composition = Composition::new(SpriteSet::new(vec![]), vec![cube]);
    let stats = composition.render(&mut Composer::default(), &camera, &settings, &mut composed);
    assert_eq!(stats.hole_pixels, alone.hole_count());
    assert_eq!(composed.coverage, alone.coverage);
    // Shares of 1 and 2 of 255 count as 3 in a frame.
    for ((composed, alone), coverage) in
        composed.color.iter().zip(&alone.color).zip(&alone.coverage)
    {
        assert!(
            composed == alone || coverage.splat_share() == 3,
            "{composed:?}, not {alone:?}, at {coverage:?}"
        );
    }
    assert!(
        partial > 20,
        "only {partial} pixels show the environment behind splats"
    );
}

/// Adds a parallelogram with its own material.
fn add_board(scene: &mut Scene, corner: DVec3, along: DVec3, up: DVec3, albedo: [f32; 3]) {
    let (first, material) = (scene.positions.len() as u32, scene.materials.len() as u32);
    scene
        .positions
        .extend([corner, corner + along, corner + along + up, corner + up]);
    let count = scene.positions.len();
    scene.materials.push(Material {
        albedo,
        ..Material::default()
    });
    for vertices in [[0, 1, 2], [0, 2, 3]] {
        scene.triangles.push(Triangle {
            vertices: vertices.map(|v: u32| first + v),
            material,
        });
    }
    // Non-empty attribute lists have an entry for each position.
    let fill = |is_kept: bool| if is_kept { count } else { 0 };
    scene
        .normals
        .resize(fill(!scene.normals.is_empty()), Vec3::ZERO);
    scene
        .texcoords
        .resize(fill(!scene.texcoords.is_empty()), Vec2::ZERO);
    scene
        .colors
        .resize(fill(!scene.colors.is_empty()), Vec3::ONE);
}

/// Adds a slanted board among the poles that intersects the ground, and one behind most poles.
fn boards(scene: &mut Scene) {
    add_board(
        scene,
        dvec3(-2.0, -0.5, -5.0),
        dvec3(3.0, 0.0, -2.0),
        dvec3(0.2, 1.8, 0.6),
        [0.8, 0.2, 0.1],
    );
    add_board(
        scene,
        dvec3(-9.0, 0.0, -20.0),
        dvec3(18.0, 0.0, 3.0),
        dvec3(0.0, 4.0, 0.0),
        [0.1, 0.3, 0.8],
    );
}

fn board_model() -> Polygons {
    let mut scene = Scene {
        materials: vec![Material::default()],
        ..Scene::default()
    };
    boards(&mut scene);
    Polygons::new(scene).expect("a valid scene")
}

/// Ray-traced frame of a scene of unlit surfaces.
fn trace_frame(scene: &Arc<Scene>, camera: &Camera) -> image::RgbImage {
    let tracer = Tracer::new(Arc::clone(scene), camera.eye());
    headbox_trace::truth::render(
        &tracer,
        &Lighting::unmetered(&tracer, 0),
        false,
        camera,
        32,
        &Silent,
    )
    .rgb()
}

/// Maximum loss of PSNR by boards among samples, dB.
const BOARDS_DB: f64 = 1.3;

/// Minimum loss of PSNR if the boards are pasted over the samples: poles are in front of them.
const PASTED_DB: f64 = 1.5;

#[test]
fn polygons_match_captured_samples() {
    let source = SceneSource::new("builtin:poles");
    let scene = source.open().expect("built in");
    let mut both = scene.clone();
    boards(&mut both);
    let (scene, both) = (Arc::new(scene), Arc::new(both));
    let centre = scene.headbox.expect("it has one").centre;
    let tracer = Tracer::new(Arc::clone(&scene), centre);
    let spec = CaptureSpec {
        face_size_px: 128,
        parameters: CaptureParameters::unlit(8, 8),
        ..CaptureSpec::new(source, centre, 0.5)
    };
    let lighting = Lighting::unmetered(&tracer, 0);
    for error_px in [0.0, 0.5] {
        let (ldi, _) = SceneCapture::new(&spec, &tracer, &lighting, &RunOptions::default())
            .run()
            .expect("captured");
        let cube =
            planes::pack(ldi, SplatIndexLayout::Normal, Split::Auto, error_px).expect("packed");
        let eye = centre + dvec3(0.2, -0.1, 0.15);
        let camera = Camera::look_at(
            eye,
            eye + dvec3(-0.1, -0.15, -1.0),
            DVec3::Y,
            70.0,
            [160, 120],
        )
        .expect("valid");
        let drawn = Renderer::new()
            .render(&cube, &camera, &RenderSettings::default())
            .to_rgb()
            .expect("a picture");
        let alone = psnr_db(&trace_frame(&scene, &camera), &drawn).expect("of one size");
        let composition =
            Composition::new(SpriteSet::new(vec![]), vec![cube]).with_polygons(vec![board_model()]);
        let mut frame = Frame::default();
        let stats = composition.render(
            &mut Composer::default(),
            &camera,
            &ComposeSettings::default(),
            &mut frame,
        );
        assert_eq!(stats.order, [Layer::Cube(0)], "one picture shows both");
        let truth = trace_frame(&both, &camera);
        let composed = psnr_db(&truth, &frame.to_rgb().expect("a picture")).expect("of one size");
        assert!(
            composed > alone - BOARDS_DB,
            "{composed:.2} dB with boards, {alone:.2} without (error_px {error_px})"
        );

        let boards =
            Composition::new(SpriteSet::new(vec![]), vec![]).with_polygons(vec![board_model()]);
        boards.render(
            &mut Composer::default(),
            &camera,
            &ComposeSettings::default(),
            &mut frame,
        );
        let mut pasted = drawn;
        for (i, pixel) in pasted
            .pixels_mut()
            .enumerate()
            .filter(|(i, _)| frame.coverage[*i].splat_share() > 0)
        {
            pixel.0.copy_from_slice(&frame.color[i][..3]);
        }
        let pasted = psnr_db(&truth, &pasted).expect("of one size");
        assert!(
            pasted < composed - PASTED_DB,
            "{composed:.2} dB among the samples, {pasted:.2} before them"
        );
    }
}

/// Minimum PSNR at silhouettes, dB. Coverage is known to a quarter there, so light is off by up to
/// an eighth of the difference; without subpixels by up to half.
const SILHOUETTES_DB: f64 = 36.0;

#[test]
fn silhouettes_of_polygons_are_smooth() {
    let mut scene = Scene {
        materials: vec![Material::default()],
        ..Scene::default()
    };
    boards(&mut scene);
    add_board(
        &mut scene,
        dvec3(-60.0, -60.0, -40.0),
        dvec3(120.0, 0.0, 0.0),
        dvec3(0.0, 120.0, 0.0),
        [0.9; 3],
    );
    let eye = dvec3(0.3, 0.4, 0.2);
    let camera =
        Camera::look_at(eye, dvec3(-0.5, 0.5, -5.0), DVec3::Y, 40.0, [160, 120]).expect("valid");
    let model = Polygons::new(scene.clone()).expect("a valid scene");
    let composition = Composition::new(SpriteSet::new(vec![]), vec![]).with_polygons(vec![model]);
    let mut frame = Frame::default();
    composition.render(
        &mut Composer::default(),
        &camera,
        &ComposeSettings::default(),
        &mut frame,
    );
    let found = psnr_db(
        &trace_frame(&Arc::new(scene), &camera),
        &frame.to_rgb().expect("a picture"),
    )
    .expect("of one size");
    assert!(found > SILHOUETTES_DB, "{found:.2} dB");
}

#[test]
fn cube_sprites_polygons_share_depth() {
    // Two cards that cross each other at x = 0, and a board between the left parts of both.
    let (left_near, right_near) = (dvec3(1.0, 0.0, 1.0), dvec3(-1.0, 0.0, 1.0));
    let cards = || {
        SpriteSet::new(
            [
                (left_near, [255, 0, 0, 255]),
                (right_near, [0, 0, 255, 255]),
            ]
            .map(|(normal, color)| card(color, DVec3::ZERO, normal))
            .into(),
        )
    };
    let eye = dvec3(0.0, 0.0, 4.0);
    let camera = look(eye, DVec3::ZERO, 64);
    let shown = |composition: &Composition, by_depth: bool| {
        let (mut frame, settings) = (
            Frame::default(),
            ComposeSettings {
                by_depth,
                ..ComposeSettings::default()
            },
        );
        composition.render(&mut Composer::default(), &camera, &settings, &mut frame);
        [26, 38].map(|x| frame.color[32 * 64 + x])
    };
    let (red, blue) = ([255, 0, 0, 255], [0, 0, 255, 255]);
    let crossing = Composition::new(cards(), vec![]);
    let [left, right] = shown(&crossing, false);
    assert_eq!(left, right, "laid whole, one card hides the other");
    // A card whose normal leans to the right (+X, +Z) is nearer on its left.
    assert_eq!(shown(&crossing, true), [red, blue]);

    let mut scene = Scene {
        materials: vec![Material::default()],
        ..Scene::default()
    };
    add_board(
        &mut scene,
        dvec3(-2.0, -2.0, 0.0),
        dvec3(1.9, 0.0, 0.0),
        dvec3(0.0, 4.0, 0.0),
        [0.0, 1.0, 0.0],
    );
    let board = Polygons::new(scene).expect("a valid scene");
    let [left, right] = shown(
        &Composition::new(cards(), vec![]).with_polygons(vec![board]),
        false,
    );
    assert_eq!(
        [left, right],
        [red, blue],
        "the board is behind the near card on the left, and not on the right"
    );
}

/// A red board in the left (axis 0) or upper (1) half of an image, with blue sky beside it.
fn half_a_board(axis: usize, camera: Camera, sky: [u8; 4]) -> Composition {
    let image = RgbaImage::from_fn(16, 16, |x, y| {
        let alpha = if [x, y][axis] < 8 { 255 } else { 0 };
        Rgba([255, 0, 0, alpha])
    });
    let sprite = Sprite::new(image, camera, SpritePlane::through(DVec3::ZERO, DVec3::Z));
    let sprite = SpriteWithDepth::new(sprite.expect("valid"), Displacement::zero(16, 16));
    let mut set = SpriteSet::new(vec![sprite.expect("valid")]);
    set.environment = Environment {
        size_px: 2,
        texels: vec![sky; 6 * 4],
    };
    Composition::new(set, vec![])
}

#[test]
fn sky_that_no_camera_saw_is_a_hole() {
    let sky = [0, 0, 255, 255];
    let camera = look(dvec3(0.0, 0.0, 2.0), DVec3::ZERO, 16);
    for axis in 0..2 {
        let composition = half_a_board(axis, camera, sky);
        let holes = |camera: &Camera| {
            let mut frame = Frame::default();
            let settings = ComposeSettings::default();
            let stats = composition.render(&mut Composer::default(), camera, &settings, &mut frame);
            let is_hole: Vec<bool> = frame.coverage.iter().map(|c| c.is_hole()).collect();
            let is_sky = |(is_hole, color): (&bool, &[u8; 4])| !is_hole || *color == sky;
            assert!(is_hole.iter().zip(&frame.color).all(is_sky));
            let count = is_hole.iter().filter(|&&hole| hole).count();
            assert_eq!(stats.hole_pixels, count as u64);
            is_hole
        };
        assert!(!holes(&camera).contains(&true), "its own view is complete");
        let turned = look(camera.eye(), camera.eye() + DVec3::Z, 16);
        assert!(!holes(&turned).contains(&false), "nothing is known behind");
        // From the left or from below, the board no longer hides what is behind its end.
        let moved = [dvec3(0.25, 0.0, 2.0), dvec3(0.0, -0.25, 2.0)][axis];
        for (i, is_hole) in holes(&camera.with_eye(moved)).into_iter().enumerate() {
            let along = [i % 16, i / 16][axis];
            // The board moves by 2.1 pixels.
            assert!(is_hole == (6..8).contains(&along) || along == 5, "{along}");
        }
    }
}

/// Relative tolerance of light: 64 samples per vertex of its surroundings, an image of 64 rows of
/// these, and the mean over vertices: an eighth.
const LIT_SHARE: f64 = 0.125;

#[test]
fn polygons_lit_by_surrounding_cube() {
    let opened = headbox::Scene::open("builtin:interior").expect("built in");
    let mut cube = Capture::new(&opened)
        .face_size(96)
        .strata(8)
        .light_samples(2)
        .run()
        .expect("captured");
    // Frames blend compressed light, which loses some of it where bright and dark meet: 16 % here,
    // where levels of the neutral curve stand for more light than was captured.
    for (tone, share) in [
        (ToneMap::SrgbClipped, LIT_SHARE),
        (ToneMap::SrgbCompressed, 1.5 * LIT_SHARE),
    ] {
        cube.info.tone = tone;
        assert_box_is_lit(&cube, share);
    }
}

/// Asserts that a closed box in the centre of a cube is lit by the radiance of the cube's frames.
fn assert_box_is_lit(cube: &CubeLdi, share: f64) {
    let centre = cube.info.centre;
    // A closed box: on an open surface the brighter of both sides would count.
    let side = 0.02;
    let normals = [
        DVec3::X,
        DVec3::NEG_X,
        DVec3::Z,
        DVec3::NEG_Z,
        DVec3::Y,
        DVec3::NEG_Y,
    ];
    let mut scene = Scene {
        materials: vec![Material::default()],
        ..Scene::default()
    };
    for normal in normals {
        let along = normal.any_orthonormal_vector() * side;
        let up = normal.cross(along);
        add_board(
            &mut scene,
            centre + (normal * side - along - up) / 2.0,
            along,
            up,
            [0.5; 3],
        );
    }
    let model = Polygons::lit_by(scene, cube, &Silent).expect("lit");
    let composition = Composition::new(SpriteSet::new(vec![]), vec![]).with_polygons(vec![model]);
    for normal in normals {
        // So close to the box that it fills the frame.
        let eye = centre + normal * side;
        let camera = Camera::look_at(eye, centre, normal.any_orthonormal_vector(), 40.0, [16, 16])
            .expect("valid");
        let mut frame = Frame::default();
        composition.render(
            &mut Composer::default(),
            &camera,
            &ComposeSettings::default(),
            &mut frame,
        );
        let found = cube.info.tone.exposed(frame.color[8 * 16 + 8][1]);
        let expected = (0.5 * irradiance_over_pi(cube, centre, normal)).min(1.0);
        assert!(
            (f64::from(found) / expected - 1.0).abs() < share,
            "toward {normal}: {found}, not {expected}"
        );
    }
}

/// Irradiance over pi, green, from a cube at a point: the sum over a frame along the normal up to
/// 80 degrees, beyond which cosines leave 3 %.
fn irradiance_over_pi(cube: &CubeLdi, eye: DVec3, normal: DVec3) -> f64 {
    let camera = Camera::look_at(
        eye,
        eye + normal,
        normal.any_orthonormal_vector(),
        160.0,
        [400, 400],
    )
    .expect("valid");
    let mut renderer = Renderer::new();
    let frame = renderer.render(cube, &camera, &RenderSettings::default());
    let (mut sum, mut all) = (0.0, 0.0);
    for (i, color) in frame.color.iter().enumerate() {
        let direction = camera.direction((i % 400) as f64 + 0.5, (i / 400) as f64 + 0.5);
        // A pixel's solid angle is proportional to the cube of the cosine, and its irradiance to
        // the cosine.
        let weight = direction.length().powi(-4);
        sum += f64::from(cube.info.tone.exposed(color[1])) * weight;
        all += weight;
    }
    sum / all
}
