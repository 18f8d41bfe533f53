//! Tests of whole lumigraphs.

use super::*;
use glam::DVec3;
use headbox_core::camera::{Camera, focal_px};
use headbox_core::frame::Frame;
use headbox_core::progress::{Progress, Silent};
use headbox_core::random::Rng;
use headbox_core::simd;
use headbox_scene::scene::Scene;
use headbox_trace::bvh::Tracer;
use headbox_trace::light::Lighting;
use headbox_trace::truth;
use std::sync::Arc;

/// A plane with a dome and a pyramid on it, 3 m before the cameras, which look at it from a square
/// of 1 m.
pub(super) struct Bed {
    pub(super) tracer: Tracer,
    pub(super) lighting: Lighting,
    pub(super) grid: CameraGrid,
}

impl Bed {
    pub(super) fn new(columns: Vec<f64>, rows: Vec<f64>, size_px: [u32; 2]) -> Self {
        Self::of(
            headbox_scenes::build("bump", 0).expect("built in"),
            DVec3::new(0.0, 0.0, 3.0),
            columns,
            rows,
            size_px,
        )
    }

    pub(super) fn of(
        scene: Scene,
        origin: DVec3,
        columns: Vec<f64>,
        rows: Vec<f64>,
        size_px: [u32; 2],
    ) -> Self {
        let tracer = Tracer::new(Arc::new(scene), origin);
        let lighting = Lighting::measure(&tracer, 0);
        let grid = CameraGrid::new(GridParts {
            origin,
            world_from_eye: CameraGrid::facing(DVec3::NEG_Z, DVec3::Y).expect("a direction"),
            columns,
            rows,
            focal_px: focal_px(f64::from(size_px[1]), 60.0),
            size_px,
            convergence: 0.3,
        });
        Self {
            tracer,
            lighting,
            grid: grid.expect("a grid"),
        }
    }

    fn usual() -> Self {
        Self::new(
            vec![-0.5, -0.1, 0.2, 0.5],
            CameraGrid::even_positions(3, 1.0),
            [97, 64],
        )
    }

    pub(super) fn raw(&self) -> RawLumigraph {
        let capture = self.capture(false, 4);
        capture.run(&self.grid, &Silent).expect("captured")
    }

    pub(super) fn capture(&self, lit: bool, samples: u32) -> LumigraphCapture<'_> {
        LumigraphCapture {
            tracer: &self.tracer,
            lighting: &self.lighting,
            lit,
            samples,
        }
    }

    fn lumigraph(&self) -> Lumigraph {
        self.raw()
            .layered(255, Placement::Histogram)
            .expect("layered")
    }

    /// From a place in plane space (forward is -z here) to a direction.
    pub(super) fn camera(&self, offset: DVec3, look: DVec3, size_px: [u32; 2]) -> Camera {
        let eye = self.grid.origin() + offset;
        Camera::look_at(eye, eye + look, DVec3::new(0.1, 1.0, 0.0), 50.0, size_px).expect("valid")
    }

    /// Behind the plane, on it, on a camera, before it, beside it, turned, nose to a surface,
    /// looking away.
    fn cameras(&self) -> Vec<Camera> {
        let ahead = DVec3::NEG_Z;
        let view =
            |x: f64, y: f64, z: f64, look: DVec3| self.camera(DVec3::new(x, y, z), look, [83, 51]);
        vec![
            view(0.03, 0.11, 0.0, ahead),
            view(0.2, 0.0, 0.0, ahead),
            view(0.1, -0.2, 4.0, ahead),
            view(-0.2, 0.1, -0.7, ahead),
            view(1.5, 0.2, 0.4, ahead + DVec3::X * -0.6),
            view(0.0, 0.4, 0.6, DVec3::new(0.9, -0.4, -0.2)),
            view(0.8, 0.0, -2.2, ahead),
            view(0.0, 0.0, 0.5, -ahead),
        ]
    }
}

pub(super) fn render(
    lumigraph: &Lumigraph,
    camera: &Camera,
    settings: &LumigraphSettings,
) -> Frame {
    LumigraphRenderer::new()
        .render(lumigraph, camera, settings)
        .0
        .clone()
}

/// Settings without merging of layers.
pub(super) fn unmerged() -> LumigraphSettings {
    LumigraphSettings {
        merge: false,
        ..LumigraphSettings::default()
    }
}

pub(super) fn psnr_db(a: &[[u8; 4]], b: &[[u8; 4]]) -> f64 {
    let squares = a
        .iter()
        .zip(b)
        .flat_map(|(a, b)| (0..3).map(move |c| f64::from(a[c].abs_diff(b[c])).powi(2)));
    10.0 * (255.0f64.powi(2) / (squares.sum::<f64>() / (a.len() * 3) as f64)).log10()
}

/// Share of pixels where a position of 24 bits may find the texel beside that of 53 bits.
const OTHER_TEXELS: f64 = 0.001;
/// Rounding to 12 bits of linear light, levels.
const ROUNDING: u8 = 1;

#[test]
fn frames_are_those_of_rays_one_by_one() {
    let bed = Bed::usual();
    let mut lumigraph = bed.lumigraph();
    let mut random = Rng::keyed(7);
    let texels = (0..6 * 16)
        .map(|_| [random.below(256) as u8, random.below(256) as u8, 90, 255])
        .collect();
    lumigraph.environment = Environment { size_px: 4, texels };
    let settings = LumigraphSettings::default();
    let variants = [
        settings,
        LumigraphSettings {
            blend: Blend::Whole,
            ..settings
        },
        LumigraphSettings {
            merge: false,
            levels: false,
            ..settings
        },
        LumigraphSettings {
            tolerance_px: 20.0,
            ..settings
        },
    ];
    let (mut off, mut pixels, mut drawn) = (0, 0, 0);
    for camera in bed.cameras() {
        for settings in &variants {
            let (fast, slow) = (
                render(&lumigraph, &camera, settings),
                render_by_rays(&lumigraph, &camera, settings),
            );
            let differs =
                |(a, b): &(&[u8; 4], &[u8; 4])| (0..3).any(|c| a[c].abs_diff(b[c]) > ROUNDING);
            off += fast.color.iter().zip(&slow.color).filter(differs).count();
            pixels += fast.color.len();
            drawn += fast
                .coverage
                .iter()
                .filter(|coverage| coverage.splat_share() > 0)
                .count();
        }
    }
    assert!(
        off as f64 <= OTHER_TEXELS * pixels as f64,
        "{off} of {pixels} pixels"
    );
    assert!(
        drawn * 2 > pixels,
        "there was something to see in {drawn} of {pixels}"
    );
}

#[test]
fn levels_threads_and_skipping_change_no_bit() {
    let bed = Bed::usual();
    let lumigraph = bed.lumigraph();
    for blend in [Blend::Shared, Blend::Whole] {
        let settings = LumigraphSettings {
            blend,
            ..LumigraphSettings::default()
        };
        for camera in bed.cameras() {
            let expected = render(&lumigraph, &camera, &settings);
            for level in simd::levels() {
                let mut renderer = LumigraphRenderer::with_level(level);
                assert_eq!(
                    renderer.render(&lumigraph, &camera, &settings).0,
                    &expected,
                    "{}",
                    simd::name(level)
                );
            }
            let all = LumigraphSettings {
                skip: false,
                ..settings
            };
            assert_eq!(render(&lumigraph, &camera, &all), expected, "rectangles");
            for threads in [1, 3] {
                let pool = rayon::ThreadPoolBuilder::new()
                    .num_threads(threads)
                    .build()
                    .expect("a pool");
                assert_eq!(
                    pool.install(|| render(&lumigraph, &camera, &settings)),
                    expected,
                    "{threads} threads"
                );
            }
        }
    }
}

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
fn rectangles_leave_most_layers_out() {
    let bed = Bed::usual();
    let lumigraph = bed.lumigraph();
    let camera = bed.camera(DVec3::new(0.1, 0.1, 0.5), DVec3::NEG_Z, [200, 150]);
    let asked = |skip| {
        let settings = LumigraphSettings { skip, ..unmerged() };
        LumigraphRenderer::new()
            .render(&lumigraph, &camera, &settings)
            .1
            .layer_pixels
    };
    assert!(
        asked(true) * 4 < asked(false) * 3,
        "{} of {}",
        asked(true),
        asked(false)
    );
}

#[test]
fn the_first_view_shows_what_the_images_show() {
    let bed = Bed::usual();
    let lumigraph = bed.lumigraph();
    let holes = |fov_y_deg: f64, size_px: [u32; 2]| {
        let eye = bed.grid.origin();
        let camera =
            Camera::look_at(eye, eye + DVec3::NEG_Z, DVec3::Y, fov_y_deg, size_px).expect("valid");
        render(&lumigraph, &camera, &LumigraphSettings::default()).hole_count()
    };
    for size_px in [[96, 64], [64, 96], [97, 97]] {
        let fov_y_deg = lumigraph.clear_fov_deg(size_px);
        assert_eq!(
            holes(fov_y_deg, size_px),
            0,
            "{size_px:?}, {fov_y_deg} degrees"
        );
        assert!(
            holes(fov_y_deg * 1.7, size_px) > 50,
            "{size_px:?}: a wider view looks past the images"
        );
    }
}

#[test]
fn frame_at_camera_equals_its_image() {
    let bed = Bed::usual();
    let lumigraph = bed.lumigraph();
    for (column, row) in [(0, 0), (1, 1), (3, 2), (2, 0)] {
        let frame = render(&lumigraph, &bed.grid.camera(column, row), &unmerged());
        let picture = &lumigraph.pictures()[row * 4 + column];
        let off = frame
            .color
            .iter()
            .zip(&picture.color)
            .filter(|(a, b)| (0..3).any(|c| a[c].abs_diff(b[c]) > ROUNDING));
        // Positions of 24 bits are not quite the middles of texels.
        assert!(off.count() * 200 < picture.color.len());
    }
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

#[test]
fn degenerate_lumigraphs_render() {
    let single = Bed::new(vec![0.0], vec![0.0], [40, 30]);
    let lumigraph = single.lumigraph();
    let frame = render(
        &lumigraph,
        &single.grid.camera(0, 0),
        &LumigraphSettings::default(),
    );
    assert!(
        psnr_db(
            &frame.color,
            &render_by_rays(
                &lumigraph,
                &single.grid.camera(0, 0),
                &LumigraphSettings::default()
            )
            .color
        ) > 45.0
    );
    let many = Bed::usual()
        .raw()
        .layered(3000, Placement::Histogram)
        .expect("layered");
    assert!(many.layers().len() > 256 && many.index_bytes() == 2);
    assert_eq!(
        single
            .raw()
            .layered(MAX_LAYERS + 1, Placement::Uniform)
            .err(),
        Some(LumigraphError::TooManyLayers(65_536))
    );

    // Everything at one depth: no range of disparity at all.
    let pixels = single.grid.picture_pixels();
    let flat = Picture {
        color: vec![[10, 200, 30]; pixels],
        index: vec![1; pixels],
    };
    let layer = DisparityLayer { min: 0.5, max: 0.5 };
    let lumigraph =
        Lumigraph::new(single.grid.clone(), vec![layer], vec![flat.clone()]).expect("a lumigraph");
    let frame = render(
        &lumigraph,
        &single.camera(DVec3::Z * 0.1, DVec3::NEG_Z, [9, 7]),
        &LumigraphSettings::default(),
    );
    assert!(frame.color.iter().all(|color| *color == [10, 200, 30, 255]));
    // An eye that has passed the only layer, and one that looks back.
    for camera in [
        single.camera(DVec3::Z * -2.5, DVec3::NEG_Z, [9, 7]),
        single.camera(DVec3::Z * -2.0, DVec3::NEG_Z, [9, 7]),
        single.camera(DVec3::ZERO, DVec3::Z, [9, 7]),
    ] {
        let frame = render(&lumigraph, &camera, &LumigraphSettings::default());
        assert_eq!(frame.hole_count(), 63);
    }

    let refused = |layers: Vec<DisparityLayer>, pictures: Vec<Picture>| {
        Lumigraph::new(single.grid.clone(), layers, pictures).err()
    };
    assert_eq!(
        refused(vec![layer, layer], vec![flat.clone()]),
        Some(LumigraphError::Layers)
    );
    assert_eq!(
        refused(
            vec![DisparityLayer { min: 0.0, max: 1.0 }],
            vec![flat.clone()]
        ),
        Some(LumigraphError::Layers)
    );
    let beyond = Picture {
        index: vec![3; pixels],
        ..flat.clone()
    };
    assert_eq!(
        refused(vec![layer], vec![beyond]),
        Some(LumigraphError::Picture(0))
    );
    assert_eq!(
        refused(vec![layer], Vec::new()),
        Some(LumigraphError::Picture(0))
    );
    assert_eq!(
        refused(vec![layer], vec![flat.clone(), flat]),
        Some(LumigraphError::Picture(1))
    );
}

#[test]
fn capture_errors_and_cancellation() {
    let bed = Bed::new(vec![0.0], vec![0.0], [8, 8]);
    let away = CameraGrid::facing(DVec3::Z, DVec3::Y).expect("a direction");
    let parts = GridParts {
        origin: bed.grid.origin(),
        world_from_eye: away,
        columns: vec![0.0],
        rows: vec![0.0],
        focal_px: 8.0,
        size_px: [8, 8],
        convergence: 0.0,
    };
    let capture = bed.capture(true, 1);
    let raw = capture
        .run(&CameraGrid::new(parts).expect("a grid"), &Silent)
        .expect("captured");
    assert_eq!(
        (raw.range(), raw.layered(9, Placement::Uniform).err()),
        (None, Some(LumigraphError::NothingSeen))
    );
    struct Impatient;
    impl Progress for Impatient {
        fn begin(&self, _: &str, _: &str, _: u64) {}
        fn advance(&self, _: u64) {}
        fn is_cancelled(&self) -> bool {
            true
        }
    }
    let given_up = capture
        .run(&bed.grid, &Impatient)
        .map(|_| ())
        .map_err(|error| error.kind());
    assert_eq!(given_up, Err(std::io::ErrorKind::Interrupted));
}

#[test]
fn files_keep_every_bit() {
    let folder = tempfile::tempdir().expect("a folder");
    let bed = Bed::usual();
    for layers in [7, 400] {
        let mut lumigraph = bed
            .raw()
            .layered(layers, Placement::Uniform)
            .expect("layered");
        lumigraph.info.source = "builtin:bump".into();
        lumigraph.environment = Environment {
            size_px: 2,
            texels: vec![[1, 2, 3, 255]; 24],
        };
        let path = folder.path().join("a.lumi");
        lumigraph.write(&path).expect("written");
        let back = Lumigraph::read(&path).expect("read");
        assert_eq!(
            (back.grid(), back.layers(), back.pictures()),
            (lumigraph.grid(), lumigraph.layers(), lumigraph.pictures())
        );
        assert_eq!(
            (&back.info, &back.environment),
            (&lumigraph.info, &lumigraph.environment)
        );
        let bytes = std::fs::metadata(&path).expect("there").len();
        let pixels = (12 * 97 * 64) as u64 * (3 + back.index_bytes() as u64);
        assert!(
            (pixels..pixels + 30_000).contains(&bytes),
            "{bytes} for {pixels}"
        );
    }
}
