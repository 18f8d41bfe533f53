//! Draws an image set with depth from a new place in two ways: warped into one cube LDI, and by
//! view-dependent geometry, which keeps the images.
//!
//! ```text
//! cargo run --release --example image_set -- [SET] [FOLDER]
//! ```
//!
//! SET is a folder of images with depth and cameras: nerfstudio, COLMAP, Seurat and others. Without
//! it, or with "-", a set of a built-in scene is rendered first.

use headbox::{Camera, Capture, DVec3, GeometryRenderer, GeometryResources, ImageSet};
use headbox::{ImageSetCapture, ImageSetOptions, RenderSettings, Renderer, Scene, ViewGeometry};
use headbox_core::progress::Silent;
use headbox_cube::pack::{SplatIndexLayout, Split};
use headbox_cube::planes::{self, DEFAULT_ERROR_PX};
use headbox_images::{Distortion, Lens, LoadedView, Pinhole, Pose, SetWriter};
use headbox_photos::view_geometry::{GeometrySettings, WaitPolicy};
use std::path::{Path, PathBuf};

/// Size of the images and of the frames, pixels.
const SIZE: [u32; 2] = [320, 240];

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut arguments = std::env::args().skip(1);
    let set_folder = arguments.next().filter(|name| name != "-");
    let folder = PathBuf::from(arguments.next().unwrap_or_else(|| ".".into()));
    std::fs::create_dir_all(&folder)?;
    let set_folder = match set_folder {
        Some(name) => PathBuf::from(name),
        None => render_set(&folder.join("set"))?,
    };

    let set = ImageSet::open(&set_folder, &ImageSetOptions::default())?;
    let views: Vec<_> = set.views_with_depth().collect();
    let [first, .., last] = &views[..] else {
        return Err("the set has fewer than two images with depth".into());
    };
    let view_camera = first.camera().ok_or("the first image is a panorama")?;
    let eye = (first.pose.eye + last.pose.eye) / 2.0;
    let up = view_camera.world_from_eye().y_axis;
    let target = eye + view_camera.forward();
    let camera = Camera::look_at(eye, target, up, view_camera.fov_y_deg(), SIZE)?;

    // All images in one cube LDI: a fixed size, and one colour for each surface.
    let samples = ImageSetCapture::suggest(&set).run(&set, &views, &Silent)?;
    let ldi = planes::pack(
        samples,
        SplatIndexLayout::Normal,
        Split::Auto,
        DEFAULT_ERROR_PX,
    )?;
    let mut renderer = Renderer::new();
    let frame = renderer.render(&ldi, &camera, &RenderSettings::default());
    frame.save(folder.join("set_cube.png"))?;
    println!("cube LDI: {} pixels without a surface", frame.hole_count());

    // The images nearest to the eye, textured onto a mesh of their depth: gloss stays.
    let geometry = ViewGeometry::open(&set, &views, &GeometryResources::default(), &Silent)?;
    let mut renderer = GeometryRenderer::new();
    let settings = GeometrySettings::default();
    let (frame, stats) = renderer.render(&geometry, &camera, &settings, WaitPolicy::Wait);
    frame.save(folder.join("set_geometry.png"))?;
    println!("view-dependent geometry: {} cameras", stats.cameras_valid);
    Ok(())
}

/// Renders a set of six images from a cube LDI of a built-in scene; returns its folder.
fn render_set(folder: &Path) -> Result<PathBuf, Box<dyn std::error::Error>> {
    let scene = Scene::open("builtin:interior")?;
    let ldi = Capture::new(&scene)
        .face_size(256)
        .strata(12)
        .rays(8)
        .run()?;
    let mut renderer = Renderer::new();
    let settings = RenderSettings {
        depth: true,
        ..RenderSettings::default()
    };
    let mut writer = SetWriter::new(folder);
    for number in 0..6 {
        let side = number as f64 / 2.5 - 1.0;
        let eye = ldi.center() + DVec3::X * side * ldi.half_size();
        let camera = Camera::look_at(eye, eye + DVec3::NEG_Z, DVec3::Y, 60.0, SIZE)?;
        let frame = renderer.render(&ldi, &camera, &settings);
        let view = LoadedView {
            size_px: SIZE,
            lens: Lens::Pinhole(Pinhole {
                focal_px: [camera.focal_px(); 2],
                principal_px: camera.principal_px(),
                distortion: Distortion::default(),
            }),
            pose: Pose {
                eye,
                world_from_eye: camera.world_from_eye(),
            },
            color: frame.color.clone(),
            depth: frame.depth_m.clone(),
        };
        writer.add(number, &view, true)?;
    }
    writer.finish()?;
    Ok(folder.into())
}
