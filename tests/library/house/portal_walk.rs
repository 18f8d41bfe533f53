//! A walk through three rooms: geometry against truth, at doors, in walls and without images;
//! files, tours and paths. For backdrops see `portal_backdrops.rs`.

use super::three_rooms::{
    QUALITY, camera, house, poses, rooms, stocked, three_rooms, truth, wrong_share,
};
use glam::dvec3;
use headbox_core::random::Rng;
use headbox_house::backdrop::{Backdrop, BackdropError, BackdropKind, BackdropQuality, PortalSide};
use headbox_house::file;
use headbox_house::house::{House, HouseError};
use headbox_house::settings::{Division, Near, WalkSettings};
use headbox_house::store::{BackdropBuilder, Store};
use headbox_house::tour::Tour;
use headbox_house::visit::likely_backdrops;
use headbox_house::walk::Walker;
use headbox_house::walk_path::WalkPath;
use headbox_model::PortalModel;
use headbox_raster::PixelContent;
use std::sync::Arc;

#[test]
fn geometry_alone_is_truth() {
    let (house, store, mut walker) = (house(), Store::new(0), Walker::new());
    for camera in poses() {
        let (frame, stats) = walker.frame(&house, &store, &camera, &WalkSettings::default());
        assert_eq!(frame.hole_count(), 0);
        assert!(stats.cell.is_some() && stats.geometry_cells >= 2);
        let wrong = wrong_share(frame, &truth(&house, &camera), |_| true);
        assert!(wrong < 0.001, "{wrong}");
    }
}

#[test]
fn frames_independent_of_division() {
    let house = house();
    let store = stocked(&house, BackdropKind::WindowLdi);
    let camera = poses()[1];
    let frame = |threads: usize, division: Division| {
        let settings = WalkSettings {
            backdrops: Some(BackdropKind::WindowLdi),
            near: Near::Distance(0.5),
            division,
            ..WalkSettings::default()
        };
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(threads)
            .build()
            .expect("threads");
        let mut walker = Walker::new();
        let drawn = pool.install(|| walker.frame(&house, &store, &camera, &settings).0.clone());
        assert!(walker.stats().portals >= 1);
        drawn
    };
    let reference = frame(1, Division::Bands);
    for (threads, division) in [(3, Division::Bands), (2, Division::Portals)] {
        assert_eq!(frame(threads, division), reference, "{division:?}");
    }
}

#[test]
fn missing_backdrop_is_geometry_until_built() {
    let house = Arc::new(house());
    let store = Arc::new(Store::new(1 << 30));
    let mut walker = Walker::new();
    let near = Near::Distance(0.5);
    let settings = WalkSettings {
        backdrops: Some(BackdropKind::Texture),
        near,
        ..WalkSettings::default()
    };
    let camera = poses()[0];
    let (frame, stats) = walker.frame(&house, &store, &camera, &settings);
    assert_eq!(
        (frame.hole_count(), stats.portals, stats.missing.is_empty()),
        (0, 0, false)
    );
    let geometry = frame.clone();
    let alone = walker
        .frame(
            &house,
            &store,
            &camera,
            &WalkSettings {
                backdrops: None,
                ..settings
            },
        )
        .0;
    assert_eq!(alone.color, geometry.color);

    let builder = BackdropBuilder::new(Arc::clone(&house), Arc::clone(&store), QUALITY);
    let wanted = likely_backdrops(&house, camera.eye(), BackdropKind::Texture);
    assert_eq!(
        wanted[0].0,
        PortalSide { portal: 0, side: 0 },
        "the door of the eye's own room first"
    );
    builder.request(wanted);
    builder.wait();
    let (_, stats) = walker.frame(&house, &store, &camera, &settings);
    assert_eq!(
        (stats.portals, stats.missing.len(), stats.geometry_cells),
        (1, 0, 1)
    );
}

#[test]
fn crossing_door_changes_cell_once() {
    let house = house();
    let store = stocked(&house, BackdropKind::Texture);
    let mut walker = Walker::new();
    // Wide enough that both doors are always open.
    let near = Near::Distance(5.0);
    let settings = WalkSettings {
        backdrops: Some(BackdropKind::Texture),
        near,
        ..WalkSettings::default()
    };
    let mut cells = Vec::new();
    for step in 0..=200 {
        let x = 3.5 + f64::from(step) * 0.005;
        // Exactly on the portal's plane at step 100.
        let camera = camera(dvec3(x, 1.5, 2.0), dvec3(9.0, 1.4, 2.1));
        let (frame, stats) = walker.frame(&house, &store, &camera, &settings);
        assert_eq!((frame.hole_count(), stats.portals), (0, 0), "at {x}");
        cells.push(stats.cell);
        if step % 20 == 0 {
            let wrong = wrong_share(frame, &truth(&house, &camera), |_| true);
            assert!(wrong < 0.001, "{wrong} at {x}");
        }
    }
    assert_eq!((cells[0], cells[200]), (Some(0), Some(1)));
    assert_eq!(
        cells.windows(2).filter(|pair| pair[0] != pair[1]).count(),
        1,
        "the cell changes once"
    );
}

#[test]
fn eye_in_wall_sees_all_geometry() {
    let (house, store, mut walker) = (house(), Store::new(0), Walker::new());
    for eye in [dvec3(2.0, 9.0, 2.0), dvec3(-1.0, 1.0, 2.0)] {
        let camera = camera(eye, dvec3(6.0, 1.0, 2.1));
        let (frame, stats) = walker.frame(&house, &store, &camera, &WalkSettings::default());
        assert_eq!((stats.cell, stats.geometry_cells), (None, 3));
        assert!(wrong_share(frame, &truth(&house, &camera), |_| true) < 0.001);
    }
}

#[test]
fn house_file_round_trips() {
    let house = house();
    let store = stocked(&house, BackdropKind::Textures);
    for (key, backdrop) in stocked(&house, BackdropKind::WindowLdi).all() {
        assert!(store.insert(key, backdrop));
    }
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("a.house");
    file::write(&path, &house, &store, &QUALITY).expect("written");
    let (again, stored, quality) = file::read(&path, 1 << 30).expect("read");
    assert_eq!((stored.all(), quality), (store.all(), QUALITY));
    assert_eq!(
        (&again.plan().cells, &again.plan().portals),
        (&house.plan().cells, &house.plan().portals)
    );
    let mut walker = Walker::new();
    let settings = WalkSettings {
        backdrops: Some(BackdropKind::WindowLdi),
        near: Near::Distance(0.5),
        ..WalkSettings::default()
    };
    let camera = poses()[1];
    let expected = walker.frame(&house, &store, &camera, &settings).0.clone();
    assert_eq!(
        walker.frame(&again, &stored, &camera, &settings).0,
        &expected
    );
    let (_, nothing, _) = file::read(&path, 10).expect("read");
    assert!(nothing.all().is_empty(), "nothing fits into ten bytes");

    let good = std::fs::read(&path).expect("bytes");
    let pictures = stored
        .all()
        .into_iter()
        .map(|(_, backdrop)| match &*backdrop {
            Backdrop::Cubes(cubes) => cubes.iter().map(|cube| cube.planes.samples).sum(),
            _ => 0,
        });
    assert!(
        pictures.sum::<u64>() > 1000,
        "walls behind doors are pictures"
    );
    assert_eq!(good[12..16], 2u32.to_le_bytes());
    file::write(
        &path,
        &house,
        &stocked(&house, BackdropKind::Textures),
        &QUALITY,
    )
    .expect("written");
    assert_eq!(
        std::fs::read(&path).expect("bytes")[12..16],
        1u32.to_le_bytes(),
        "older programs read it"
    );
    let mut random = Rng::keyed(4);
    for _ in 0..60 {
        let mut bad = good.clone();
        let at = (random.unit() * bad.len() as f64) as usize;
        if random.unit() < 0.5 {
            bad.truncate(at);
        } else {
            bad[at] ^= 1 << (random.unit() * 8.0) as u32;
        }
        std::fs::write(&path, &bad).expect("written");
        // A flipped bit in the padding between sections changes nothing; every other one is an
        // error that names the file.
        match file::read(&path, 1 << 30) {
            Ok((_, stored, _)) => assert_eq!(stored.all(), store.all()),
            Err(error) => assert!(error.to_string().contains("a.house"), "{error}"),
        }
    }
}

#[test]
fn captures_do_not_depend_on_threads() {
    let house = house();
    let at = PortalSide { portal: 0, side: 1 };
    for kind in [
        BackdropKind::Ldi,
        BackdropKind::WindowLdi,
        BackdropKind::Textures,
    ] {
        let capture = |threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new()
                .num_threads(threads)
                .build()
                .expect("threads");
            pool.install(|| Backdrop::capture(&house, at, kind, &QUALITY))
                .expect("a capture")
        };
        assert_eq!(capture(1), capture(3), "{kind:?}");
    }
}

#[test]
fn bad_models_and_numbers_are_refused() {
    let error = |change: fn(&mut PortalModel)| {
        let mut model = three_rooms();
        change(&mut model);
        House::new(model).expect_err("broken on purpose")
    };
    assert!(matches!(error(|m| m.cells.clear()), HouseError::NoCells));
    assert!(matches!(
        error(|m| m.portals[1].cells = [1, 9]),
        HouseError::PortalCells {
            portal: 1,
            count: 3,
            ..
        }
    ));
    assert!(matches!(
        error(|m| m.portals[0].cells = [1, 1]),
        HouseError::PortalCells { portal: 0, .. }
    ));
    assert!(matches!(
        error(|m| m.portals[0].polygon.truncate(2)),
        HouseError::PortalShape(0)
    ));
    assert!(matches!(
        error(|m| m.scene.triangles.clear()),
        HouseError::Scene(_)
    ));
    let house = house();
    let capture = |portal: u32, quality: BackdropQuality| {
        Backdrop::capture(
            &house,
            PortalSide { portal, side: 0 },
            BackdropKind::WindowLdi,
            &quality,
        )
        .expect_err("refused")
    };
    assert!(matches!(capture(7, QUALITY), BackdropError::NoPortal(7)));
    assert!(matches!(
        capture(
            0,
            BackdropQuality {
                face_px: 0,
                ..QUALITY
            }
        ),
        BackdropError::Quality(_)
    ));
    assert!(matches!(
        capture(
            0,
            BackdropQuality {
                radius_m: f64::NAN,
                ..QUALITY
            }
        ),
        BackdropError::Quality(_)
    ));
}

#[test]
fn path_enters_every_room() {
    let house = house();
    let path = WalkPath {
        poses: 90,
        size: [32, 24],
        ..WalkPath::default()
    };
    let cameras = path.cameras(&house).expect("valid cameras");
    assert_eq!(cameras.len(), 90);
    let mut cells: Vec<u32> = cameras
        .iter()
        .filter_map(|camera| house.find_cell(camera.eye()))
        .collect();
    assert_eq!(cells.len(), 90, "never in a wall");
    cells.sort_unstable();
    cells.dedup();
    assert_eq!(cells, [0, 1, 2]);
    assert_eq!(
        cameras,
        path.cameras(&house).expect("valid cameras"),
        "the same each time"
    );
    let other = WalkPath { seed: 3, ..path }
        .cameras(&house)
        .expect("valid cameras");
    assert_ne!(cameras, other);
    assert!(
        WalkPath {
            size: [0, 0],
            ..path
        }
        .cameras(&house)
        .is_err()
    );
}

#[test]
fn tour_requests_missing_within_budget() {
    let one = Backdrop::capture(
        &house(),
        PortalSide { portal: 0, side: 0 },
        BackdropKind::Texture,
        &QUALITY,
    )
    .expect("a capture");
    let settings = WalkSettings {
        backdrops: Some(BackdropKind::Texture),
        near: Near::Distance(0.5),
        ..WalkSettings::default()
    };
    for (room_for, wanted) in [(1, 1), (2, 2), (100, 3)] {
        let store = Arc::new(Store::new(one.bytes() * room_for));
        let mut tour = Tour::new(Arc::new(house()), Arc::clone(&store), QUALITY, settings);
        let (frame, stats) = tour.frame(&poses()[0]);
        assert_eq!(
            (frame.hole_count(), stats.portals),
            (0, 0),
            "geometry until there is an image"
        );
        tour.wait();
        assert_eq!(
            store.all().len(),
            wanted,
            "the likeliest, as far as they fit"
        );
        for _ in 0..3 {
            let stats = tour.frame(&poses()[0]).1;
            assert_eq!(
                (stats.portals, stats.missing.len()),
                (1, 0),
                "the door in sight is not thrown out for others"
            );
            tour.wait();
        }
    }
}

#[test]
fn only_smooth_views_become_sprites() {
    let wall = rooms(Some([dvec3(3.45, 0.0, 0.1), dvec3(3.65, 2.45, 3.9)]));
    let wall = House::new(wall).expect("a valid model");
    let at = PortalSide { portal: 0, side: 1 };
    let capture = |house: &House| {
        Backdrop::capture(house, at, BackdropKind::Sprite, &QUALITY).expect("a capture")
    };
    let pillar = rooms(Some([dvec3(3.4, 0.0, 1.8), dvec3(3.6, 2.4, 2.1)]));
    let pillar = House::new(pillar).expect("a valid model");
    assert!(matches!(capture(&pillar), Backdrop::Cubes(_)));
    assert!(
        matches!(
            capture(&House::new(rooms(None)).expect("a valid model")),
            Backdrop::Cubes(_)
        ),
        "too deep"
    );
    let sprite = capture(&wall);
    assert!(matches!(sprite, Backdrop::Sprite(_)));

    let store = Store::new(1 << 30);
    assert!(store.insert((at, BackdropKind::Sprite), Arc::new(sprite)));
    let settings = WalkSettings {
        backdrops: Some(BackdropKind::Sprite),
        near: Near::Distance(0.5),
        ..WalkSettings::default()
    };
    let camera = poses()[2];
    let mut walker = Walker::new();
    let (frame, stats) = walker.frame(&wall, &store, &camera, &settings);
    assert!(
        stats.portals == 1 && stats.hole_pixels * 10 < stats.backdrop_pixels,
        "{stats:?}"
    );
    let (frame, shown) = (frame.clone(), walker.last().clone());
    let behind = |i: usize| matches!(shown.seen(i), PixelContent::Marker(_));
    let expected = truth(&wall, &camera);
    let shown: Vec<usize> = (0..frame.color.len())
        .filter(|&i| behind(i) && !frame.coverage[i].is_hole())
        .collect();
    let off: u32 = shown
        .iter()
        .map(|&i| u32::from(expected[i][1].abs_diff(frame.color[i][1])))
        .sum();
    let mean = f64::from(off) / shown.len() as f64;
    assert!(mean < SPRITE_OFF_LEVELS, "{mean}");

    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("a.house");
    file::write(&path, &wall, &store, &QUALITY).expect("written");
    assert_eq!(
        file::read(&path, 1 << 30).expect("read").1.all(),
        store.all()
    );
}

/// Mean difference of a sprite from truth, green levels: in a frame this small the mip levels of
/// the texture blur the squares of the wall, which differ by 7 to 38 levels.
const SPRITE_OFF_LEVELS: f64 = 16.0;
