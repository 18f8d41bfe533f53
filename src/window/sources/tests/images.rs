//! Image sets in the window: geometry from depth, and cubes of the nearest images (S24).

use super::{SIZE, figure, render};
use crate::{show_live, show_view};
use glam::DVec3;
use headbox_core::progress::Silent;
use headbox_cube::pack::{CubeLdi, SplatIndexLayout, Split};
use headbox_fixtures::{frame_at, image_set, plane_view, saved};
use headbox_images::ImageSet;
use headbox_ldi::from_images::{ImageSetCapture, NearestImages};
use headbox_photos::view_geometry::view::GeometryView;
use headbox_photos::view_geometry::{
    GeometryResources, GeometrySettings, SampleGrid, ViewGeometry,
};
use headbox_viewer::{FrameReport, FrameRequest, FrameSource, Pose, Refinement, SettingValues};
use std::path::Path;
use std::sync::Arc;

#[test]
fn image_folder_is_shown() {
    let eyes = [DVec3::ZERO, DVec3::X * 0.2, DVec3::Y * 0.2];
    let views = eyes.map(|eye| plane_view(eye, 3.0, [96, 64]));
    let folder = tempfile::tempdir().unwrap();
    let on_disk: Vec<_> = views
        .iter()
        .enumerate()
        .map(|(i, view)| saved(view, folder.path(), &i.to_string()))
        .collect();
    let set = image_set(folder.path(), &on_disk);
    let resources = GeometryResources {
        grid: SampleGrid::default(),
        budget: 1 << 30,
        cache: None,
    };
    let geometry = ViewGeometry::open(
        &set,
        &on_disk.iter().collect::<Vec<_>>(),
        &resources,
        &Silent,
    )
    .unwrap();
    let start = frame_at(DVec3::new(0.05, 0.05, 0.0), [96, 64]);
    let mut source = show_view(
        Box::new(GeometryView::new(
            geometry,
            &start,
            GeometrySettings::default(),
        )),
        folder.path(),
    );
    assert!(source.title().ends_with("(view-dependent geometry)"));
    let pose = source.start_pose();
    let (blended, report) = render(&mut *source, pose, &[]);
    assert_eq!(
        (report.refinement, figure(&report, "cameras used")),
        (Refinement::Done, Some(3.0))
    );
    assert!(blended.iter().all(|pixel| pixel[3] == 255));
    assert!(
        blended != render(&mut *source, pose, &[("texturing", "geometry-nearest")]).0,
        "what textures counts"
    );
    let (_, one) = render(&mut *source, pose, &[("cameras", "1")]);
    assert_eq!(figure(&one, "cameras used"), Some(1.0));
    let mut painted = vec![blended];
    for overlay in ["holes", "camera", "owners", "mesh", "age"] {
        let (pixels, report) = render(&mut *source, pose, &[("overlay", overlay)]);
        assert!(
            !painted.contains(&pixels) && !report.legend.is_empty(),
            "{overlay}"
        );
        assert!(pixels.iter().all(|pixel| pixel[3] == 255));
        painted.push(pixels);
    }
    let away = Pose::looking_at(pose.eye, pose.eye + DVec3::Z, 60.0);
    let (_, report) = render(&mut *source, away, &[]);
    assert!(
        report
            .facts
            .iter()
            .any(|fact| fact.text.contains("none of the 3 cameras")),
        "{:?}",
        report.facts
    );
}

/// Renders until the refinement is done.
fn settled(
    source: &mut dyn FrameSource,
    pose: Pose,
    settings: &[(&str, &str)],
) -> (Vec<[u8; 4]>, FrameReport) {
    loop {
        let (pixels, report) = render(source, pose, settings);
        if report.refinement == Refinement::Done {
            return (pixels, report);
        }
        std::thread::yield_now();
    }
}

/// Images of a plane from cameras one metre apart.
fn six_images(folder: &Path) -> ImageSet {
    let view = |i: u32| {
        saved(
            &plane_view(DVec3::X * f64::from(i), 3.0, [96, 64]),
            folder,
            &format!("image {i}"),
        )
    };
    image_set(folder, &(0..6).map(view).collect::<Vec<_>>())
}

#[test]
fn cubes_of_the_nearest_images_follow_the_eye() {
    let folder = tempfile::tempdir().unwrap();
    let set = six_images(folder.path());
    let near =
        || NearestImages::new(set.clone(), ImageSetCapture::suggest(&set), usize::MAX).unwrap();
    let start = frame_at(DVec3::X * 0.2, [SIZE.0, SIZE.1]);
    let mut source = show_live(near(), folder.path(), &start).unwrap();
    assert!(source.bounds().is_none() && source.start_pose().eye == start.eye());
    let made_of = |report: &FrameReport| {
        report
            .facts
            .iter()
            .find(|fact| fact.name == "made of")
            .unwrap()
            .text
            .clone()
    };
    let (_, report) = settled(source.as_mut(), source_pose(0.2), &[]);
    assert_eq!(made_of(&report), "image 0, image 1, image 2");
    // The last cube is shown while the next is built.
    let (_, report) = render(source.as_mut(), source_pose(4.6), &[("images", "2")]);
    assert!(report.refinement != Refinement::Done || made_of(&report) == "image 5, image 4");
    let (pixels, report) = settled(source.as_mut(), source_pose(4.6), &[("images", "2")]);
    assert_eq!(made_of(&report), "image 5, image 4");
    let (mut expected, camera) = (near(), source_pose(4.6).camera(SIZE.0, SIZE.1).unwrap());
    let chosen = expected.nearest(&camera, 2);
    let ldi = expected.cube(&chosen).unwrap();
    let cube = CubeLdi::pack(&ldi, SplatIndexLayout::Normal, Split::Auto).unwrap();
    let mut renderer = headbox_cube::render::Renderer::new();
    assert!(pixels == renderer.render(&cube, &camera, &Default::default()).color);
}

#[test]
fn vanished_image_reported_once() {
    let folder = tempfile::tempdir().unwrap();
    let set = six_images(folder.path());
    // Only the data used last stay in memory.
    let near = NearestImages::new(set.clone(), ImageSetCapture::suggest(&set), 0).unwrap();
    let start = frame_at(DVec3::ZERO, [SIZE.0, SIZE.1]);
    let mut source = show_live(near, folder.path(), &start).unwrap();
    std::fs::remove_file(&set.views[5].color).unwrap();
    let values = SettingValues::initial(&source.settings());
    let camera = source_pose(5.0).camera(SIZE.0, SIZE.1).unwrap();
    let request = FrameRequest {
        camera,
        settings: Arc::new(values),
        moving: false,
        complete: false,
        depth: false,
    };
    let mut pixels = vec![[0; 4]; (SIZE.0 * SIZE.1) as usize];
    let error = loop {
        match source.render(&request, &mut pixels) {
            Err(error) => break error,
            Ok(_) => std::thread::yield_now(),
        }
    };
    assert!(error.contains("image 5.png"), "{error}");
    let report = source.render(&request, &mut pixels).unwrap();
    assert_eq!(report.refinement, Refinement::Done);
    assert!(
        report
            .facts
            .iter()
            .any(|fact| fact.text == "image 0, image 1, image 2")
    );
}

/// Pose on the X axis that looks down -Z.
fn source_pose(x: f64) -> Pose {
    Pose::looking_at(DVec3::X * x, DVec3::new(x, 0.0, -1.0), 60.0)
}

#[test]
fn depth_in_the_middle_is_reported_on_request() {
    let folder = tempfile::tempdir().unwrap();
    let near = NearestImages::new(
        six_images(folder.path()),
        ImageSetCapture::suggest(&six_images(folder.path())),
        NearestImages::DEFAULT_BUDGET,
    )
    .unwrap();
    let start = frame_at(DVec3::ZERO, [96, 64]);
    let mut source = show_live(near, folder.path(), &start).unwrap();
    let pose = source.start_pose();
    let mut depth_m = |depth: bool| {
        let camera = pose.camera(400, 300).unwrap();
        let request = FrameRequest {
            camera: camera.cropped(200..208, 150..158).unwrap(),
            settings: Arc::new(SettingValues::initial(&source.settings())),
            moving: true,
            complete: false,
            depth,
        };
        source.render(&request, &mut [[0; 4]; 64]).unwrap().depth_m
    };
    assert_eq!(depth_m(false), None);
    // The plane of the images is 3 m away, and stored in steps of inverse depth.
    let depth_m = depth_m(true).unwrap();
    assert!((depth_m - 3.0).abs() < 0.03, "{depth_m} m");
}
