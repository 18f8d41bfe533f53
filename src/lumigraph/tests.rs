//! Tests of whole lumigraphs.

use super::*;
use glam::DVec3;
use headbox_core::camera::{Camera, focal_px};
use headbox_core::frame::Frame;
use headbox_core::progress::{Progress, Silent};
use headbox_scene::scene::Scene;
use headbox_trace::bvh::Tracer;
use headbox_trace::light::Lighting;
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

    pub(super) fn usual() -> Self {
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

    pub(super) fn lumigraph(&self) -> Lumigraph {
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
    pub(super) fn cameras(&self) -> Vec<Camera> {
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
