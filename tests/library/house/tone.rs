//! The tone curve of a house: the same in geometry, backdrops, truth and files.

use super::three_rooms::{QUALITY, camera, poses, stocked, three_rooms, truth, wrong_share};
use glam::dvec3;
use headbox_core::color::tone::ToneMap;
use headbox_core::progress::Silent;
use headbox_house::backdrop::BackdropKind;
use headbox_house::file;
use headbox_house::house::House;
use headbox_house::make::{MakeOptions, make_house};
use headbox_house::settings::{Near, WalkSettings};
use headbox_house::store::Store;
use headbox_house::walk::Walker;
use headbox_raster::PixelContent;
use headbox_trace::truth;

/// Radiance of the ceiling's brightest square, as baked light near a lamp.
const BRIGHT: f32 = 1.6;

/// Three rooms whose ceilings are up to [`BRIGHT`].
fn bright_house(tone: ToneMap) -> House {
    let mut model = three_rooms();
    model.scene.tone = tone;
    for color in &mut model.scene.colors {
        *color *= BRIGHT;
    }
    House::new(model).expect("a valid model")
}

/// Number of surface pixels at white.
fn white_pixels(colors: &[[u8; 4]], shows: impl Fn(usize) -> bool) -> usize {
    let shown = (0..colors.len()).filter(|&i| shows(i));
    shown.filter(|&i| colors[i][..3] == [255; 3]).count()
}

#[test]
fn bright_walls_are_white_only_without_a_shoulder() {
    // Up at the ceiling of the first room.
    let camera = camera(dvec3(1.0, 1.2, 2.0), dvec3(2.5, 2.5, 2.0));
    let count = (camera.width() * camera.height()) as usize;
    for (tone, white_share) in [(ToneMap::Neutral, 0..1), (ToneMap::SrgbClipped, 50..101)] {
        let house = bright_house(tone);
        let mut walker = Walker::new();
        let settings = WalkSettings::default();
        let (frame, _) = walker.frame(&house, &Store::new(0), &camera, &settings);
        assert!(wrong_share(frame, &truth(&house, &camera), |_| true) < 0.001);
        let supersampled =
            truth::render(house.tracer(), house.lighting(), false, &camera, 8, &Silent);
        for color in [&frame.color, &supersampled.frame.color] {
            let share = 100 * white_pixels(color, |_| true) / count;
            assert!(white_share.contains(&share), "{share} % {tone}");
        }
    }
}

/// Maximum difference between the levels that the curve takes from a backdrop and from geometry, as
/// a share: a texture blurs the borders of bright squares.
const MAX_DIFFERENCE: f64 = 0.2;

/// The neutral curve darkens what a portal shows by the same levels, drawn as geometry or as a
/// backdrop.
#[test]
fn backdrops_have_the_tone_curve_of_geometry() {
    // From the place of a texture, an image or a sprite to the ceiling behind the door.
    let camera = camera(dvec3(2.5, 1.5, 2.0), dvec3(6.0, 1.7, 2.0));
    let [neutral, linear] = [ToneMap::Neutral, ToneMap::SrgbClipped].map(bright_house);
    let mut walker = Walker::new();
    for kind in [
        BackdropKind::Texture,
        BackdropKind::Image,
        BackdropKind::Ldi,
        BackdropKind::WindowLdi,
        BackdropKind::Sprite,
    ] {
        let mut frame = |house: &House, store: &Store| {
            let settings = WalkSettings {
                backdrops: Some(kind),
                near: Near::Distance(0.1),
                ..WalkSettings::default()
            };
            let (frame, _) = walker.frame(house, store, &camera, &settings);
            let color = frame.color.clone();
            let seen = |i| walker.last().seen(i);
            let behind: Vec<usize> = (0..color.len())
                .filter(|i| matches!(seen(*i), PixelContent::Marker(_)))
                .collect();
            (color, behind)
        };
        let (darker, behind) = frame(&neutral, &stocked(&neutral, kind));
        let (brighter, _) = frame(&linear, &stocked(&linear, kind));
        // A portal without a backdrop is passed: geometry.
        let (expected_darker, _) = frame(&neutral, &Store::new(0));
        let (expected_brighter, _) = frame(&linear, &Store::new(0));
        let taken = |brighter: &[[u8; 4]], darker: &[[u8; 4]]| {
            let levels = behind.iter().flat_map(|&i| {
                (0..3).map(move |c| f64::from(brighter[i][c]) - f64::from(darker[i][c]))
            });
            levels.sum::<f64>() / behind.len() as f64
        };
        let found = taken(&brighter, &darker);
        let expected = taken(&expected_brighter, &expected_darker);
        println!("{kind:?}: {found} levels a pixel, {expected} of geometry");
        assert!(
            expected > 1.0 && (found / expected - 1.0).abs() < MAX_DIFFERENCE,
            "{kind:?}: {found} levels a pixel, {expected} of geometry"
        );
        let whites = [&darker, &brighter].map(|color| white_pixels(color, |i| behind.contains(&i)));
        // Where the ceiling meets a wall, splats are up to 7 levels brighter than geometry.
        assert!(
            20 * whites[0] < whites[1],
            "{kind:?}: {whites:?} white pixels"
        );
    }
}

#[test]
fn tone_curve_round_trips_through_file() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("a.house");
    for tone in ToneMap::ALL {
        let house = bright_house(tone);
        file::write(&path, &house, &Store::new(0), &QUALITY).expect("written");
        let (again, ..) = file::read(&path, 0).expect("read");
        assert_eq!(again.lighting(), house.lighting(), "{tone}");
        let frame = |house: &House| {
            let (store, settings) = (Store::new(0), WalkSettings::default());
            let mut walker = Walker::new();
            walker
                .frame(house, &store, &poses()[0], &settings)
                .0
                .clone()
        };
        assert_eq!(frame(&again), frame(&house), "{tone}");
        let bytes = std::fs::read(&path).expect("bytes");
        let is_named = bytes.windows(7).any(|text| text == b"\"tone\":");
        assert_eq!(is_named, tone != ToneMap::SrgbClipped, "as older files");
    }
}

#[test]
fn unlit_house_is_linear() {
    let mut model = three_rooms();
    model.scene.tone = ToneMap::Neutral;
    let options = MakeOptions {
        light: None,
        backdrops: Vec::new(),
        quality: QUALITY,
        budget_bytes: 0,
    };
    let made = make_house(model, &options, &Silent).expect("a house");
    assert_eq!(made.house.lighting().tone, ToneMap::SrgbClipped);
}
