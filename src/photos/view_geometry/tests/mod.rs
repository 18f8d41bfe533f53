//! View-dependent geometry as a whole: exact where it can be, and whole where data is bad.

mod around;
mod frames;
mod hard_sets;

use super::*;
use crate::view_geometry::cameras::picture::Picture;
use glam::DVec3;
use headbox_core::camera::Camera;
use headbox_core::frame::Frame;
use headbox_core::progress::Silent;
pub(crate) use headbox_fixtures::{frame_at, image_set, make_view, pattern, plane_view, saved};
use headbox_images::{LoadedView, View};
use std::path::Path;

const FOCAL: f64 = headbox_fixtures::FOCAL;

/// Views on disk, opened; the folder lives as long as the pictures are needed.
pub(crate) fn opened(views: &[LoadedView], grid: &SampleGrid) -> (tempfile::TempDir, ViewGeometry) {
    let folder = tempfile::tempdir().expect("a folder");
    let on_disk: Vec<View> = views
        .iter()
        .enumerate()
        .map(|(i, view)| saved(view, folder.path(), &i.to_string()))
        .collect();
    let geometry = open(folder.path(), &on_disk, grid, 1 << 30).expect("opens");
    (folder, geometry)
}

fn open(
    folder: &Path,
    views: &[View],
    grid: &SampleGrid,
    budget: usize,
) -> Result<ViewGeometry, GeometryError> {
    let set = image_set(folder, views);
    let resources = GeometryResources {
        grid: *grid,
        budget,
        cache: None,
    };
    ViewGeometry::open(&set, &views.iter().collect::<Vec<_>>(), &resources, &Silent)
}

const SIZE: [u32; 2] = [96, 72];

const DEFAULT: SampleGrid = grid(3, 3);

pub(crate) const fn grid(spacing_px: u32, coarsest: u32) -> SampleGrid {
    SampleGrid {
        spacing_px,
        coarsest,
    }
}

fn settings(texturing: Texturing) -> GeometrySettings {
    GeometrySettings {
        texturing,
        hole_color_srgb: [255, 0, 255],
        ..GeometrySettings::default()
    }
}

pub(crate) fn frame(
    geometry: &ViewGeometry,
    camera: &Camera,
    settings: &GeometrySettings,
) -> (Frame, GeometryStats) {
    let mut renderer = GeometryRenderer::new();
    let (frame, stats) = renderer.render(geometry, camera, settings, WaitPolicy::Wait);
    (frame.clone(), stats)
}

/// The largest difference of levels from the plane's pattern, over the pixels that are covered, and
/// how many are not.
fn off_the_pattern(frame: &Frame, camera: &Camera, plane_z: f64) -> (u8, u64) {
    let mut worst = 0;
    for (i, (color, coverage)) in frame.color.iter().zip(&frame.coverage).enumerate() {
        if coverage.is_hole() {
            continue;
        }
        let x = (i % frame.width as usize) as f64 + 0.5;
        let y = (i / frame.width as usize) as f64 + 0.5;
        let ray = camera.direction(x, y);
        let p = camera.eye() + ray * ((plane_z - camera.eye().z) / ray.z);
        let expected = pattern(p.x, p.y);
        worst = (0..3)
            .map(|k| color[k].abs_diff(expected[k]))
            .fold(worst, u8::max);
    }
    (worst, frame.hole_count())
}

#[test]
fn walk_stays_within_budget_without_waiting() {
    let folder = tempfile::tempdir().expect("a folder");
    let eyes: Vec<DVec3> = (0..120u32)
        .map(|i| DVec3::X * (0.1 * f64::from(i)))
        .collect();
    let views: Vec<View> = eyes
        .iter()
        .enumerate()
        .map(|(i, eye)| {
            saved(
                &plane_view(*eye, 3.0, [48, 36]),
                folder.path(),
                &i.to_string(),
            )
        })
        .collect();
    let one = Picture::new(&views[0].load().expect("loads")).bytes();
    let geometry = open(folder.path(), &views, &DEFAULT, 12 * one).expect("opens");
    let settings = GeometrySettings {
        cameras: 6,
        ..settings(Texturing::Blended)
    };
    let mut renderer = GeometryRenderer::new();
    let mut served = 0;
    for step in 0..300 {
        let camera = frame_at(DVec3::X * (0.04 * f64::from(step)), [48, 36]);
        let (_, stats) = renderer.render(&geometry, &camera, &settings, WaitPolicy::Never);
        served += u32::from(stats.cameras_used > 0);
        // One more may come in while the others are being counted.
        assert!(
            geometry.pictures.bytes() <= 13 * one,
            "{} pictures",
            geometry.pictures.bytes() / one
        );
        std::thread::sleep(std::time::Duration::from_millis(1));
    }
    assert!(served > 250, "{served} frames showed something");
    let camera = frame_at(DVec3::X * 12.0, [48, 36]);
    let (expected, _) = frame(&geometry, &camera, &settings);
    let (still, stats) = renderer.render(&geometry, &camera, &settings, WaitPolicy::Never);
    assert!(
        *still == expected && stats.pictures_missing == 0,
        "{stats:?}"
    );
}

#[test]
fn coarser_settings_still_show_scene() {
    let (_folder, geometry) = opened(
        &[DVec3::ZERO, DVec3::X * 0.2].map(|eye| plane_view(eye, 3.0, SIZE)),
        &DEFAULT,
    );
    let camera = frame_at(DVec3::X * 0.1, SIZE);
    let mut samples = u64::MAX;
    for level in 0..3 {
        let settings = GeometrySettings {
            level,
            grid_px: 4.0 * 2f32.powi(level as i32),
            ..settings(Texturing::Blended)
        };
        let mut renderer = GeometryRenderer::new();
        let (frame, stats) = renderer.render(&geometry, &camera, &settings, WaitPolicy::Wait);
        let (worst, holes) = off_the_pattern(frame, &camera, -3.0);
        assert!(
            worst <= 3 && holes < 96 * 72 / 3,
            "level {level}: off by {worst}, {holes} holes"
        );
        assert!(
            stats.samples * 3 < samples,
            "level {level}: {} samples",
            stats.samples
        );
        samples = stats.samples;
    }
}
