//! Files of each kind through the sources, without a window.

mod houses;
mod images;
mod live;

use crate::open;
use glam::DVec3;
use headbox_core::camera::Camera;
use headbox_core::progress::Silent;
use headbox_ldi::scene_source::SceneSource;
use headbox_lumigraph::{CameraGrid, GridParts, LumigraphCapture, Placement};
use headbox_sprite::{DisplacementFormat, SlabCapture, SpriteSet, capture_slabs, slabs_at_gaps};
use headbox_trace::bvh::Tracer;
use headbox_trace::light::Lighting;
use headbox_viewer::{
    FrameReport, FrameRequest, FrameSource, Navigation, Pose, Refinement, SettingValues,
};
use std::path::Path;
use std::sync::Arc;

const SIZE: (u32, u32) = (96, 64);

/// Renders what `source` shows from `pose` with settings given as text.
fn render(
    source: &mut dyn FrameSource,
    pose: Pose,
    settings: &[(&str, &str)],
) -> (Vec<[u8; 4]>, FrameReport) {
    let known = source.settings();
    let mut values = SettingValues::initial(&known);
    settings
        .iter()
        .for_each(|(id, text)| values.set_text(&known, id, text).unwrap());
    let camera = pose.camera(SIZE.0, SIZE.1).unwrap();
    let request = FrameRequest {
        camera,
        settings: Arc::new(values),
        moving: false,
        complete: false,
        depth: false,
    };
    let mut pixels = vec![[1, 2, 3, 4]; (SIZE.0 * SIZE.1) as usize];
    let report = source.render(&request, &mut pixels).unwrap();
    (pixels, report)
}

/// Polls a live capture until it shows more than points; every frame must report its progress.
fn first_round(source: &mut dyn FrameSource) {
    let start = source.start_pose();
    loop {
        let (pixels, report) = render(source, start, &[]);
        assert!(pixels.iter().all(|pixel| pixel[3] == 255));
        if figure(&report, "depth pixels").is_some() {
            return;
        }
        assert!(report.ongoing.is_some() && report.refinement != Refinement::Done);
        std::thread::yield_now();
    }
}

fn figure(report: &FrameReport, name: &str) -> Option<f64> {
    report
        .figures
        .iter()
        .find(|f| f.name == name)
        .map(|f| f.value)
}

#[test]
fn sprites_are_shown_and_orbited() {
    let dir = tempfile::tempdir().unwrap();
    let file = dir.path().join("layers.sprite");
    write_sprites(&file);
    let mut source = open(file.to_str().unwrap()).unwrap();
    let start = source.start_pose();
    let Navigation::Orbit { pivot, nearest } = source.navigation() else {
        panic!("sprites are orbited")
    };
    assert!(nearest > 0.0 && start.forward().dot((pivot - start.eye).normalize()) > 0.999);
    let (front, report) = render(&mut *source, start, &[]);
    assert!(figure(&report, "pixels covered").unwrap() > 50.0);
    let aside = Pose::looking_at(
        start.eye + DVec3::X * 0.2 * start.eye.distance(pivot),
        pivot,
        start.fov_y_deg,
    );
    let (tilted, _) = render(&mut *source, aside, &[]);
    let (flat, _) = render(
        &mut *source,
        aside,
        &[
            ("variant", "homography"),
            ("sampling", "nearest"),
            ("fill", "0"),
        ],
    );
    assert!(front != tilted && tilted != flat);
}

/// Writes the built-in scene of layers as sprites.
fn write_sprites(file: &Path) {
    let scene = Arc::new(SceneSource::new("builtin:sprites").open().unwrap());
    let eye = scene.headbox.unwrap().centre;
    let tracer = Tracer::new(scene, eye);
    let lighting = Lighting::unmetered(&tracer, 0);
    let camera = Camera::look_at(eye, eye + DVec3::NEG_Z, DVec3::Y, 60.0, [128, 96]).unwrap();
    let slabs = slabs_at_gaps(&tracer, &camera, 4);
    let format = DisplacementFormat::I16;
    let capture = SlabCapture {
        tracer: &tracer,
        lighting: &lighting,
        lit: false,
        samples: 4,
        format,
    };
    let sprites = capture_slabs(&capture, &camera, &slabs, &Silent).unwrap();
    SpriteSet::new(sprites).write(file).unwrap();
}

#[test]
fn lumigraph_starts_at_its_cameras() {
    let dir = tempfile::tempdir().unwrap();
    let file = dir.path().join("a.lumi");
    let scene = Arc::new(SceneSource::new("builtin:bump").open().unwrap());
    let origin = scene.headbox.unwrap().centre;
    let tracer = Tracer::new(scene, origin);
    let lighting = Lighting::measure(&tracer, 0);
    let parts = GridParts {
        origin,
        world_from_eye: glam::DMat3::IDENTITY,
        columns: CameraGrid::even_positions(3, 1.0),
        rows: CameraGrid::even_positions(3, 1.0),
        focal_px: 60.0,
        // As wide as the frames below: nothing is known outside of the images.
        size_px: [96, 64],
        convergence: 0.3,
    };
    let capture = LumigraphCapture {
        tracer: &tracer,
        lighting: &lighting,
        lit: false,
        samples: 2,
    };
    let raw = capture
        .run(&CameraGrid::new(parts).unwrap(), &Silent)
        .unwrap();
    raw.layered(100, Placement::Uniform)
        .unwrap()
        .write(&file)
        .unwrap();
    let mut source = open(file.to_str().unwrap()).unwrap();
    let start = source.start_pose();
    assert!(
        start.eye == origin
            && start.forward().distance(DVec3::NEG_Z) < 1e-9
            && source.speed_m_per_s() >= 1.0
    );
    let (colors, report) = render(&mut *source, start, &[]);
    let layers = |report: &FrameReport| figure(report, "layers after merging").unwrap();
    assert!(layers(&report) < 30.0 && figure(&report, "pixels covered") == Some(100.0));
    let (unmerged, all) = render(&mut *source, start, &[("merge", "0")]);
    assert!(
        layers(&all) > 60.0 && unmerged != colors,
        "{}",
        layers(&all)
    );
    assert!(render(&mut *source, start, &[("skip", "off")]).0 == colors);
    let mut seen = vec![colors];
    for overlay in ["layer", "merged layers", "camera"] {
        let (pixels, _) = render(&mut *source, start, &[("overlay", overlay)]);
        assert!(!seen.contains(&pixels), "{overlay}");
        seen.push(pixels);
    }
}
