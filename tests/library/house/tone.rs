//! The tone curve of a house: the same in geometry, backdrops, truth and files.

use super::three_rooms::{
    QUALITY, camera, poses, stocked, three_rooms, truth, wrong_share, wrong_squares,
};
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

/// Pixels from the border of a square within which backdrops, coarser than the frame, may differ.
const BORDER_PX: i64 = 2;

/// Maximum share of wrong pixels inside squares behind a door: backdrops lack some surfaces.
const WRONG_AT_MOST: f64 = 0.1;

#[test]
fn backdrops_have_the_tone_curve_of_geometry() {
    // From the place of a texture, an image or a sprite to the ceiling behind the door.
    let eye = dvec3(2.5, 1.5, 2.0);
    let camera = camera(eye, dvec3(6.0, 1.7, 2.0));
    for (tone, clips) in [(ToneMap::Neutral, false), (ToneMap::SrgbClipped, true)] {
        let house = bright_house(tone);
        let mut walker = Walker::new();
        let geometry = WalkSettings::default();
        let (frame, _) = walker.frame(&house, &Store::new(0), &camera, &geometry);
        let expected: Vec<[u8; 3]> = frame.color.iter().map(|&[r, g, b, _]| [r, g, b]).collect();
        for kind in [
            BackdropKind::Texture,
            BackdropKind::Image,
            BackdropKind::Ldi,
            BackdropKind::WindowLdi,
            BackdropKind::Sprite,
        ] {
            let settings = WalkSettings {
                backdrops: Some(kind),
                near: Near::Distance(0.1),
                ..geometry
            };
            let store = stocked(&house, kind);
            let frame = walker.frame(&house, &store, &camera, &settings).0.clone();
            let is_behind = |i| matches!(walker.last().seen(i), PixelContent::Marker(_));
            let white = white_pixels(&frame.color, is_behind);
            assert_eq!(white > 0, clips, "{kind:?} {tone}: {white} white pixels");
            let (wrong, judged) = wrong_squares(&frame, &expected, BORDER_PX, is_behind);
            assert!(judged > 100, "{kind:?} {tone}: {judged} pixels are judged");
            assert!(
                wrong < WRONG_AT_MOST,
                "{kind:?} {tone}: {wrong} of {judged}"
            );
        }
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
