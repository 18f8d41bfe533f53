//! Frames compared with the scene: occluders, highlights, numbers of layers and cameras.

use crate::tests::{Bed, psnr_db, render, unmerged};
use crate::*;
use glam::DVec3;
use headbox_core::camera::Camera;
use headbox_core::progress::Silent;
use headbox_trace::truth;

#[test]
fn occluders_reveal_background_from_others() {
    // Four cameras in a row before a wall at 4 m with a post at 1 m, which hides another part of it
    // from each.
    let bed = Bed::new(vec![-0.6, -0.1, 0.1, 0.6], vec![0.0], [256, 64]);
    let (wall, post) = ([40, 90, 200], [250, 240, 10]);
    let pictures = (0..4).map(|number| {
        let camera = bed.grid.camera(number, 0);
        let pixel = |i: usize| {
            let direction = camera.direction((i % 256) as f64 + 0.5, (i / 256) as f64 + 0.5);
            let x = camera.eye().x + direction.x;
            if x.abs() < 0.25 { (post, 2) } else { (wall, 1) }
        };
        let (color, index) = (0..256 * 64).map(pixel).unzip();
        Picture { color, index }
    });
    let layers = vec![
        DisparityLayer {
            min: 0.25,
            max: 0.25,
        },
        DisparityLayer { min: 1.0, max: 1.0 },
    ];
    let mut lumigraph =
        Lumigraph::new(bed.grid.clone(), layers, pictures.collect()).expect("a lumigraph");
    lumigraph.environment = Environment {
        size_px: 2,
        texels: vec![[255, 0, 0, 255]; 24],
    };
    // From far away, the eye sees more of the wall beside the post than the two cameras about it
    // do.
    let eye = bed.grid.origin() + DVec3::Z * 10.0;
    let camera = Camera::look_at(eye, bed.grid.origin(), DVec3::Y, 8.0, [120, 60]).expect("valid");
    let frame = render(&lumigraph, &camera, &LumigraphSettings::default());
    let shown: std::collections::BTreeSet<[u8; 4]> = frame.color.iter().copied().collect();
    assert!(
        shown.contains(&[40, 90, 200, 255]) && shown.contains(&[250, 240, 10, 255]),
        "{shown:?}"
    );
    assert!(
        !shown.contains(&[255, 0, 0, 255]),
        "no sky between wall and post"
    );
    assert_eq!(
        frame,
        render_by_rays(&lumigraph, &camera, &LumigraphSettings::default())
    );
    let two = Lumigraph::new(
        CameraGrid::new(GridParts {
            columns: vec![-0.1, 0.1],
            rows: vec![0.0],
            ..bed.grid.parts()
        })
        .expect("a grid"),
        lumigraph.layers().to_vec(),
        lumigraph.pictures()[1..3].to_vec(),
    );
    let holes = |lumigraph: &Lumigraph| {
        render(lumigraph, &camera, &LumigraphSettings::default()).hole_count()
    };
    assert!(holes(&two.expect("a lumigraph")) > holes(&lumigraph));
}

#[test]
fn frames_show_the_scene() {
    let bed = Bed::new(
        CameraGrid::even_positions(4, 1.0),
        CameraGrid::even_positions(4, 1.0),
        [192, 192],
    );
    let lumigraph = bed.lumigraph();
    // A checkered scene of sharp edges; a geometry that is off by a pixel costs five decibels.
    let views = [
        (DVec3::new(0.13, 0.21, 0.0), DVec3::NEG_Z, 25.0),
        (DVec3::new(0.05, -0.1, 1.0), DVec3::NEG_Z, 28.0),
        (DVec3::new(-0.1, 0.1, -0.4), DVec3::NEG_Z, 25.0),
        (
            DVec3::new(0.3, 0.2, 0.4),
            DVec3::new(-0.12, -0.08, -1.0),
            25.0,
        ),
    ];
    for (offset, look, least_db) in views {
        let eye = bed.grid.origin() + offset;
        let camera = Camera::look_at(eye, eye + look, DVec3::Y, 40.0, [128, 128]).expect("valid");
        let expected = truth::render(&bed.tracer, &bed.lighting, false, &camera, 64, &Silent).frame;
        for (merge, less_db) in [(false, 0.0), (true, 4.5)] {
            let settings = LumigraphSettings {
                merge,
                ..LumigraphSettings::default()
            };
            let found = psnr_db(
                &render(&lumigraph, &camera, &settings).color,
                &expected.color,
            );
            assert!(
                found > least_db - less_db,
                "{found} dB from {offset}, merged: {merge}"
            );
        }
    }
}

/// The paper's limitation 2: cameras keep their own colours, and blending carries what a surface
/// mirrors along with the eye.
#[test]
fn highlights_move_with_the_eye() {
    let glossy = headbox_scenes::build("lacquer", 0).expect("built in");
    let mut dull = glossy.clone();
    dull.materials
        .iter_mut()
        .for_each(|material| material.gloss = None);
    let places = CameraGrid::even_positions(3, 0.6);
    let [glossy, dull] = [glossy, dull]
        .map(|scene| Bed::of(scene, DVec3::ZERO, places.clone(), places.clone(), [80, 80]));
    let lit = |bed: &Bed| {
        // Of one exposure, or the pictures could not be compared.
        let capture = LumigraphCapture {
            lighting: &glossy.lighting,
            ..bed.capture(true, 16)
        };
        let raw = capture.run(&bed.grid, &Silent).expect("captured");
        raw.layered(255, Placement::Histogram).expect("layered")
    };
    let (mirrors, one_color) = (lit(&glossy), lit(&dull));
    for offset in [DVec3::new(-0.17, 0.1, 0.0), DVec3::new(0.15, -0.05, 0.0)] {
        let camera = glossy.camera(offset, DVec3::new(0.0, -0.1, -1.0), [64, 64]);
        let truth = truth::render(
            &glossy.tracer,
            &glossy.lighting,
            true,
            &camera,
            128,
            &Silent,
        )
        .frame;
        let [own, one] = [&mirrors, &one_color].map(|lumigraph| {
            psnr_db(
                &render(lumigraph, &camera, &LumigraphSettings::default()).color,
                &truth.color,
            )
        });
        assert!(
            own > one + 3.0 && own > 24.0,
            "{own} dB, and {one} without what is mirrored"
        );
    }
}

#[test]
fn more_layers_and_more_cameras_err_less() {
    let bed = |cameras| {
        Bed::new(
            CameraGrid::even_positions(cameras, 1.0),
            CameraGrid::even_positions(cameras, 1.0),
            [128, 128],
        )
    };
    let (sparse, dense) = (bed(2), bed(5));
    let camera = dense.camera(DVec3::new(0.11, 0.17, 0.0), DVec3::NEG_Z, [128, 128]);
    let expected = truth::render(&dense.tracer, &dense.lighting, false, &camera, 16, &Silent).frame;
    let error = |raw: &RawLumigraph, layers: usize| {
        let lumigraph = raw.layered(layers, Placement::Uniform).expect("layered");
        psnr_db(
            &render(&lumigraph, &camera, &unmerged()).color,
            &expected.color,
        )
    };
    let [few, some, many] = [4, 16, 64].map(|layers| error(&sparse.raw(), layers));
    assert!(
        few + 1.0 < some && some + 0.5 < many,
        "{few}, {some}, {many} dB"
    );
    let dense = error(&dense.raw(), 4);
    assert!(few + 3.0 < dense, "{few} and {dense} dB");
}
