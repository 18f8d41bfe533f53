//! Image sets with bad or missing data.

use super::{DEFAULT, SIZE, frame, off_the_pattern, open, opened, settings};
use crate::view_geometry::*;
use glam::{DMat3, DVec3};
use headbox_core::depth_kind::DepthKind;
use headbox_fixtures::{frame_at, make_view, plane_view, saved};
use headbox_images::{DepthSource, LoadedView, Pose, View};

#[test]
fn hard_sets_give_a_frame() {
    let camera = frame_at(DVec3::new(0.05, 0.0, 0.1), SIZE);
    let plane = || plane_view(DVec3::ZERO, 3.0, SIZE);
    let turned = |turn: DMat3| LoadedView {
        pose: Pose {
            eye: DVec3::ZERO,
            world_from_eye: turn,
        },
        ..plane()
    };
    let holes = |of: u32| {
        make_view(
            DVec3::ZERO,
            move |x, y| {
                if (x / 7 + y / 5) % of == 0 {
                    f32::NAN
                } else {
                    2.0
                }
            },
            |_, _| [90; 3],
            SIZE,
        )
    };
    let depth = |depth: f32| make_view(DVec3::ZERO, move |_, _| depth, |_, _| [90; 3], SIZE);
    let sets: [(&str, Vec<LoadedView>, bool); 9] = [
        ("one camera", vec![plane()], true),
        ("identical poses", vec![plane(), plane(), plane()], true),
        (
            "one with a wrong pose",
            vec![plane(), turned(DMat3::from_rotation_z(2.0))],
            true,
        ),
        (
            "all looking away",
            vec![turned(DMat3::from_rotation_y(3.1))],
            false,
        ),
        ("depth with holes", vec![holes(3)], true),
        ("depth that is mostly holes", vec![holes(1)], false),
        ("no depth at all", vec![depth(f32::NAN)], false),
        ("all at one point", vec![depth(1e-6)], false),
        ("very far", vec![depth(1e7)], true),
    ];
    for (name, views, shows) in sets {
        let (_folder, geometry) = opened(&views, &DEFAULT);
        for texturing in Texturing::ALL {
            let (frame, stats) = frame(&geometry, &camera, &settings(texturing));
            let covered = frame
                .coverage
                .iter()
                .filter(|coverage| !coverage.is_hole())
                .count();
            // The picture as it is needs no depth but to be ranked.
            let shows = shows || (texturing == Texturing::Nearest && stats.cameras_valid > 0);
            assert_eq!(covered > 0, shows, "{name}, {texturing:?}: {stats:?}");
            assert_eq!(stats.hole_pixels as usize + covered, frame.color.len());
        }
        assert!(geometry.nothing_seen().contains("sees"));
    }
    let behind = frame_at(DVec3::new(0.0, 0.0, -10.0), SIZE);
    let (_folder, geometry) = opened(&[plane()], &DEFAULT);
    let (empty, stats) = frame(&geometry, &behind, &settings(Texturing::Blended));
    assert_eq!(
        (stats.cameras_valid, empty.hole_count()),
        (0, 96 * 72),
        "everything is behind the eye"
    );
    assert!(empty.color.iter().all(|color| *color == [255, 0, 255, 255]));
}

#[test]
fn sets_without_depth_are_refused() {
    let folder = tempfile::tempdir().expect("a folder");
    let mut view = saved(&plane_view(DVec3::ZERO, 3.0, SIZE), folder.path(), "a");
    view.depth = None;
    let refused = open(
        folder.path(),
        std::slice::from_ref(&view),
        &DEFAULT,
        1 << 20,
    )
    .err()
    .expect("refused")
    .to_string();
    assert!(refused.contains("none of its 1 views"), "{refused}");
    view.depth = Some(DepthSource::metres(
        folder.path().join("absent.exr"),
        DepthKind::EyeDepth,
        1.0,
    ));
    let refused = open(folder.path(), &[view], &DEFAULT, 1 << 20)
        .err()
        .expect("refused")
        .to_string();
    assert!(refused.contains("absent.exr"), "{refused}");
}

#[test]
fn vanished_camera_is_replaced_by_next_best() {
    let folder = tempfile::tempdir().expect("a folder");
    let eyes = [0.0, 0.1, 0.2].map(|x| DVec3::new(x, 0.0, 0.0));
    let views: Vec<View> = eyes
        .iter()
        .zip(["a", "b", "c"])
        .map(|(eye, name)| saved(&plane_view(*eye, 3.0, SIZE), folder.path(), name))
        .collect();
    // Nothing fits: every frame reads its pictures anew.
    let geometry = open(folder.path(), &views, &DEFAULT, 0).expect("opens");
    let camera = frame_at(DVec3::ZERO, SIZE);
    std::fs::remove_file(&views[0].color).expect("removed");
    let (shown, stats) = frame(&geometry, &camera, &settings(Texturing::Blended));
    let (worst, _) = off_the_pattern(&shown, &camera, -3.0);
    assert!(
        stats.cameras_used == 2 && worst <= 3,
        "{stats:?}, off by {worst}"
    );
    assert!(
        geometry.pictures.lost().len() == 1 && geometry.pictures.lost()[0].contains("a.png"),
        "{:?}",
        geometry.pictures.lost()
    );
    for view in &views[1..] {
        std::fs::remove_file(&view.color).expect("removed");
    }
    // A frame that needs none of them lets all go.
    frame(
        &geometry,
        &frame_at(DVec3::new(0.0, 0.0, -9.0), SIZE),
        &settings(Texturing::Blended),
    );
    let (empty, stats) = frame(&geometry, &camera, &settings(Texturing::Blended));
    assert_eq!(
        (
            stats.cameras_used,
            empty.hole_count(),
            geometry.pictures.lost().len()
        ),
        (0, 96 * 72, 3)
    );
}

#[test]
fn left_out_cameras_take_no_part() {
    let eyes = [0.0, 0.2].map(|x| DVec3::new(x, 0.0, 0.0));
    let (_folder, mut geometry) = opened(&eyes.map(|eye| plane_view(eye, 3.0, SIZE)), &DEFAULT);
    let camera = frame_at(DVec3::ZERO, SIZE);
    assert_eq!(
        frame(&geometry, &camera, &settings(Texturing::Blended))
            .1
            .cameras_used,
        2
    );
    geometry.leave_out(&[0]);
    assert_eq!(
        frame(&geometry, &camera, &settings(Texturing::Blended))
            .1
            .cameras_used,
        1
    );
    geometry.leave_out(&[0, 1]);
    assert_eq!(
        frame(&geometry, &camera, &settings(Texturing::Blended))
            .1
            .cameras_used,
        0
    );
    geometry.leave_out(&[]);
    assert_eq!(
        frame(&geometry, &camera, &settings(Texturing::Blended))
            .1
            .cameras_used,
        2
    );
}
