//! Houses in the window: walked, lit and refused.

use super::{figure, render};
use crate::open;
use headbox_core::camera::Camera;
use headbox_house::backdrop::BackdropQuality;
use headbox_house::house::House;
use headbox_house::store::Store;
use headbox_house::variant::HouseVariant;
use headbox_house::walk_path::WalkPath;
use headbox_viewer::{Control, Navigation, Pose, Refinement};
use std::path::Path;

/// Writes a plain house without backdrops, in a file that requests the coarsest ones.
fn write_house(file: &Path) -> House {
    let house = House::new(headbox_scenes::house(3, 0)).unwrap();
    let quality = BackdropQuality {
        face_px: 16,
        window_face_px: 16,
        texture_px: 16,
        images: 1,
        strata: 3,
        rays: 2,
        ..BackdropQuality::default()
    };
    headbox_house::file::write(file, &house, &Store::new(0), &quality).unwrap();
    house
}

fn pose_from_camera(camera: &Camera) -> Pose {
    Pose::looking_at(camera.eye(), camera.eye() + camera.forward(), 60.0)
}

#[test]
fn house_is_walked_between_rooms() {
    let dir = tempfile::tempdir().unwrap();
    let file = dir.path().join("bare.house");
    let house = write_house(&file);
    let mut source = open(file.to_str().unwrap()).unwrap();
    assert_eq!(
        (source.navigation(), source.bounds()),
        (Navigation::Walk, None)
    );
    let start = source.start_pose();
    let first = house.find_cell(start.eye).unwrap();
    let model = house.plan();
    let floor = model.cells[first as usize].space[0].floor_y;
    assert!(
        Some(first) != model.outside && (start.eye.y - floor - 1.6).abs() < 1e-9,
        "{start:?} in cell {first}"
    );
    let plan = source.plan().unwrap();
    let here = plan
        .room_at(start.eye)
        .map(|room| plan.rooms[room].name.as_str());
    assert_eq!(
        (here, plan.openings.len()),
        (
            Some(model.cells[first as usize].name.as_str()),
            model.portals.len()
        )
    );

    let mut cells = std::collections::BTreeSet::new();
    for camera in (WalkPath {
        poses: 24,
        ..WalkPath::default()
    })
    .cameras(&house)
    .unwrap()
    {
        let (pixels, report) = render(&mut *source, pose_from_camera(&camera), &[]);
        let cell = house.find_cell(camera.eye());
        let name = cell.map_or("in a wall", |cell| model.cells[cell as usize].name.as_str());
        assert!(
            report.facts.iter().any(|fact| fact.text.starts_with(name)),
            "{name}: {:?}",
            report.facts
        );
        assert_eq!(report.refinement, Refinement::Done);
        let colors: std::collections::BTreeSet<_> = pixels.iter().collect();
        assert!(
            colors.len() > 20,
            "{camera:?} sees {} colours",
            colors.len()
        );
        assert!(
            pixels.iter().all(|pixel| pixel[3] == 255),
            "a closed house has no holes"
        );
        cells.insert(cell);
    }
    assert!(cells.len() > 5, "{cells:?}");
}

#[test]
fn built_in_house_is_lit_later() {
    let mut source = open("builtin:house").unwrap();
    assert_eq!(source.navigation(), Navigation::Walk);
    let (start, plan) = (source.start_pose(), source.plan().unwrap());
    let here = plan.rooms[plan.room_at(start.eye).unwrap()].name.clone();
    let (_, report) = render(&mut *source, start, &[]);
    assert!(
        report.facts[0].text.starts_with(&here),
        "{here}: {:?}",
        report.facts
    );
    // Dropping the source does not wait for the running light bake.
    assert!(matches!(report.refinement, Refinement::Later(_)));
}

#[test]
fn every_house_variant_shows_backdrops() {
    let dir = tempfile::tempdir().unwrap();
    let file = dir.path().join("bare.house");
    write_house(&file);
    let mut source = open(file.to_str().unwrap()).unwrap();
    let start = source.start_pose();
    let Control::Choice { options, selected } = source.settings().remove(0).control else {
        panic!("a choice")
    };
    assert_eq!(
        (options.len(), selected),
        (HouseVariant::ALL.len(), 0),
        "geometry first: the file has nothing else"
    );
    let (geometry, _) = render(&mut *source, start, &[("variant", "geometry")]);
    for variant in &options {
        let settings = [("variant", variant.as_str())];
        let (mut pixels, mut report) = render(&mut *source, start, &settings);
        while report.refinement != Refinement::Done {
            std::thread::yield_now();
            (pixels, report) = render(&mut *source, start, &settings);
        }
        let [portals, missing] =
            ["portals as backdrops", "backdrops missing"].map(|name| figure(&report, name));
        assert_eq!(
            (portals > Some(0.0), missing),
            (variant != "geometry", Some(0.0)),
            "{variant}"
        );
        assert_eq!(pixels != geometry, variant != "geometry", "{variant}");
        let holes = figure(&report, "hole pixels").unwrap();
        assert!(
            holes < 0.2 * pixels.len() as f64,
            "{variant}: {holes} holes"
        );
    }
    let settings = [("variant", "window-ldi"), ("overlay", "backdrops")];
    let overlaid = render(&mut *source, start, &settings).0;
    let grey = overlaid
        .iter()
        .filter(|&&[r, g, b, _]| r == g && g == b)
        .count();
    assert!(
        grey > 0 && grey < overlaid.len(),
        "geometry is grey, backdrops are not"
    );
}

#[test]
fn damaged_house_is_refused() {
    let dir = tempfile::tempdir().unwrap();
    let file = dir.path().join("damaged.house");
    std::fs::write(&file, "not a house").unwrap();
    let message = open(file.to_str().unwrap()).err().unwrap().to_string();
    assert!(
        message.contains("damaged.house") && !message.contains('\n'),
        "{message}"
    );
}
