//! `headbox`: image-based rendering with depth. A scene is ray-traced once into cube layered depth
//! images (LDIs) and then shown from anywhere inside a *headbox*, on a CPU, at a frame rate that
//! does not depend on its geometry.
//!
//! ```
//! use headbox::{Camera, Capture, DVec3, Renderer, Scene};
//!
//! # fn main() -> Result<(), headbox::Error> {
//! # let folder = tempfile::tempdir().expect("a folder");
//! # let frame_png = folder.path().join("frame.png");
//! let scene = Scene::open("builtin:miniature")?;
//! let ldi = Capture::new(&scene).face_size(64).strata(6).run()?;
//! let target = ldi.center() + DVec3::NEG_Z;
//! let camera = Camera::look_at(ldi.center(), target, DVec3::Y, 60.0, [640, 480])?;
//! Renderer::new().render(&ldi, &camera, &Default::default()).save(&frame_png)?;
//! # assert!(frame_png.is_file());
//! # Ok(())
//! # }
//! ```
//!
//! * Cube LDIs: a [`Scene`] is captured ([`Capture`]) into a [`CubeLdi`], which a [`Renderer`]
//!   draws into a [`Frame`].
//! * Sprites with depth: [`SpriteCapture`] makes a [`SpriteSet`]; a [`Composition`] combines
//!   sprites and cube LDIs in one frame.
//! * Houses of cells and portals: a [`Walker`] draws a [`House`], with [`Backdrops`] behind its
//!   portals.
//! * Image sets with depth: an [`ImageSet`] becomes one cube LDI ([`ImageSetCapture`]), or
//!   [`ViewGeometry`], which a [`GeometryRenderer`] draws from the images themselves.
//! * Lumigraphs: a [`LumigraphCapture`] traces a grid of images, which a [`LumigraphRenderer`] draws
//!   as a [`Lumigraph`] of layers.
//! * Models of triangles among samples: [`Polygons`] in a [`Composition`].
//!
//! `examples/` has a program for each of them.
//!
//! All rendering and capturing runs on the current rayon thread pool, and gives the same bytes on
//! any number of threads and at every SIMD level. Conventions: world metres, right-handed, Y up;
//! cameras look down -Z; row 0 of an image is the top; images are 8-bit sRGB with straight alpha;
//! depths of frames are eye depths in metres. Scene files have axes and a unit of their own, which
//! [`FileFrame`] maps to the world's.
//!
//! Features: `cli` (default) is the command line, `viewer` (default) its window. A library needs
//! neither: `headbox = { default-features = false, .. }`.

/// Compiles the example of the README as it stands there.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;

mod capture;
mod error;
mod scene;

pub use capture::{Capture, SpriteCapture};
pub use error::Error;
pub use glam::DVec3;
pub use headbox_core::bounces::Bounces;
pub use headbox_core::camera::Camera;
pub use headbox_core::file_frame::{FileFrame, UpAxis};
pub use headbox_core::frame::{Coverage, Frame};
pub use headbox_core::headbox::Headbox;
pub use headbox_core::progress::Progress;
pub use headbox_core::read_note::ReadNote;
pub use headbox_cube::pack::CubeLdi;
pub use headbox_cube::render::{RenderSettings, Renderer};
pub use headbox_house::backdrop::{BackdropKind, BackdropQuality};
pub use headbox_house::house::House;
pub use headbox_house::settings::WalkSettings;
pub use headbox_house::store::Store as Backdrops;
pub use headbox_house::walk::Walker;
pub use headbox_house::walk_path::WalkPath;
pub use headbox_images::{ImageSet, ImageSetOptions};
pub use headbox_ldi::from_images::ImageSetCapture;
pub use headbox_lumigraph::{
    CameraGrid, GridParts, Lumigraph, LumigraphCapture, LumigraphRenderer,
};
pub use headbox_photos::view_geometry::{GeometryRenderer, GeometryResources, ViewGeometry};
pub use headbox_sprite::SpriteSet;
pub use headbox_sprite::compose::{ComposeSettings, Composer, Composition, Polygons};
pub use scene::Scene;
