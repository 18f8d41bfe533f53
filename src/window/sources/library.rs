//! Registry of sources by kind of file; the start page.

use super::cube::CubeSource;
use super::house::HouseSource;
use super::live::LiveSource;
use super::photographs::PhotographsSource;
use super::progressive_capture::CaptureOptions;
use super::view::ViewSource;
use crate::file_name::file_name;
use crate::marks::{MarkedSource, Marks};
use glam::{DVec3, Vec3};
use headbox_core::camera::Camera;
use headbox_core::color::{linear_from_srgb8, srgb8_from_linear};
use headbox_core::inputs::{self, DEEP_IMAGES, HOMES, SCENES};
use headbox_core::progress::Silent;
use headbox_core::view::View;
use headbox_cube::pack::{CubeLdi, SplatIndexLayout, Split};
use headbox_images::ImageSet;
use headbox_images::deep_exr::DeepImage;
use headbox_ldi::from_deep::{DeepCameraOptions, FromDeepError, cube as cube_of_deep};
use headbox_ldi::from_images::NearestImages;
use headbox_ldi::scene_source::SceneSource;
use headbox_scenes as scenes;
use headbox_trace::bvh::Tracer;
use headbox_trace::light::Lighting;
use headbox_trace::truth;
use headbox_trace::viewpoint::{place_headbox, suggest_view};
use headbox_viewer::{Entry, FrameSource, Library, Thumbnail};
use headbox_views::{TruthView, ViewError};
use image::{Rgb, RgbImage};
use std::fmt::Display;
use std::path::Path;
use std::sync::Arc;

/// Error of opening a source.
#[derive(Debug, thiserror::Error)]
pub enum OpenError {
    /// The file is of a kind that cannot be shown.
    #[error("{name}: only these can be shown: {}", inputs::describe_shown())]
    Kind {
        /// Name of the file.
        name: String,
    },
    /// The file cannot be read.
    #[error(transparent)]
    View(#[from] ViewError),
    /// The scene cannot be opened or captured.
    #[error("{0}")]
    Scene(String),
}

/// Built-in scene that is shown as a house instead of being captured.
const HOUSE: &str = "builtin:house";

/// Opens a file of any kind, or `builtin:NAME`. The built-in house is opened as a house. Other
/// scenes are captured while they are shown.
///
/// # Errors
/// See [`OpenError`].
pub fn open(name: &str) -> Result<Box<dyn FrameSource>, OpenError> {
    open_source(SceneSource::new(name), CaptureOptions::default())
}

/// Returns true if `name` is a scene that [`open_source`] captures.
pub fn is_captured(name: &str) -> bool {
    let extension = Path::new(name).extension();
    let extension = extension.map(|e| e.to_string_lossy().to_lowercase());
    let is_scene = || extension.is_some_and(|e| SCENES.contains(&e.as_str()));
    name != HOUSE && (name.starts_with("builtin:") || is_scene())
}

/// Same as [`open`], with axes, unit and light of a scene's file, and headbox and quality of its
/// capture ([`is_captured`]); they have no effect on other kinds of files.
///
/// # Errors
/// See [`OpenError`].
pub fn open_source(
    source: SceneSource,
    options: CaptureOptions,
) -> Result<Box<dyn FrameSource>, OpenError> {
    let name = source.name.as_str();
    let path = Path::new(name);
    let extension = path.extension().map(|e| e.to_string_lossy().to_lowercase());
    let capture = |source| CubeSource::capture(source, options).map_err(OpenError::Scene);
    let source: Box<dyn FrameSource> = match extension.as_deref() {
        _ if name == HOUSE => Box::new(HouseSource::builtin().map_err(OpenError::Scene)?),
        _ if name.starts_with("builtin:") => Box::new(capture(source)?),
        Some(extension) if DEEP_IMAGES.contains(&extension) => {
            show_cube(deep_picture(path).map_err(OpenError::Scene)?, path)
        }
        Some(extension) if HOMES.contains(&extension) => {
            let house = HouseSource::load(path, options.is_strict);
            Box::new(house.map_err(OpenError::Scene)?)
        }
        Some(extension) if SCENES.contains(&extension) => Box::new(capture(source)?),
        _ => match headbox_views::find(path) {
            Some(representation) => show_view((representation.open)(path)?, path),
            None => {
                return Err(OpenError::Kind {
                    name: name.to_owned(),
                });
            }
        },
    };
    Ok(source)
}

/// Creates the source of a view whose data come from the file or folder `origin`.
pub fn show_view(view: Box<dyn View>, origin: &Path) -> Box<dyn FrameSource> {
    Box::new(ViewSource::new(view, origin))
}

/// Creates the source of a cube LDI that was made from `origin`.
pub fn show_cube(cube: CubeLdi, origin: &Path) -> Box<dyn FrameSource> {
    show_view(Box::new(TruthView::new(cube)), origin)
}

/// Converts a deep image with a camera in its header to a cube LDI.
fn deep_picture(path: &Path) -> Result<CubeLdi, String> {
    let image = DeepImage::read(path).map_err(|error| error.to_string())?;
    let with_path = |error: &dyn Display| format!("{}: {error}", path.display());
    let cube = cube_of_deep(&image, DeepCameraOptions::default()).map_err(|error| match error {
        FromDeepError::View => with_path(&format!(
            "{error} (headbox capture {} --fov DEG -o F.ldi)",
            path.display()
        )),
        error => with_path(&error),
    })?;
    CubeLdi::pack(&cube, SplatIndexLayout::Normal, Split::Auto).map_err(|error| with_path(&error))
}

/// Creates the source of the images in the folder `origin` that are nearest to the eye, initially
/// at `start`.
///
/// # Errors
/// [`OpenError::Scene`] if an image cannot be read, or no thread can be started.
pub fn show_live(
    near: NearestImages,
    origin: &Path,
    start: &Camera,
) -> Result<Box<dyn FrameSource>, OpenError> {
    let title = format!("{} (nearest images)", file_name(origin));
    Ok(Box::new(
        LiveSource::new(title, near, origin, start).map_err(OpenError::Scene)?,
    ))
}

/// Creates the source of the photographs without depth in the folder `origin`, which are coloured
/// into a cube LDI while they are shown.
///
/// # Errors
/// [`OpenError::Scene`] if the first photograph cannot be read, or no thread can be started.
pub fn show_photographs(set: ImageSet, origin: &Path) -> Result<Box<dyn FrameSource>, OpenError> {
    Ok(Box::new(
        PhotographsSource::new(set, origin).map_err(OpenError::Scene)?,
    ))
}

/// Wraps a source of images so that the window can draw camera marks over it.
pub fn show_marks(source: Box<dyn FrameSource>, marks: Marks) -> Box<dyn FrameSource> {
    Box::new(MarkedSource { source, marks })
}

/// Library of the built-in scenes and of every kind of file.
pub struct SceneLibrary;

impl SceneLibrary {
    /// Size of a thumbnail, pixels.
    const THUMBNAIL_PX: (u32, u32) = (200, 150);
    /// Maximum number of triangles of the built-in house in its thumbnail.
    const THUMBNAIL_TRIANGLES: usize = 60_000;
    /// Rays per pixel of a thumbnail.
    const THUMBNAIL_SAMPLES: u32 = 16;
}

/// Denoises an image of few rays per pixel by its unlit image, which has no noise. The light (lit
/// divided by unlit colour) is averaged over neighbouring pixels of similar unlit colour.
fn denoise(lit: &RgbImage, unlit: &RgbImage) -> RgbImage {
    /// Radius of the neighbourhood, pixels.
    const RADIUS: i64 = 6;
    /// Difference of unlit colours that halves the weight.
    const HALF_WEIGHT: f32 = 0.05;
    let (width, height) = lit.dimensions();
    let linear = |image: &RgbImage, x: i64, y: i64| {
        let at = |v: i64, end: u32| v.clamp(0, i64::from(end) - 1) as u32;
        Vec3::from(
            image
                .get_pixel(at(x, width), at(y, height))
                .0
                .map(linear_from_srgb8),
        )
    };
    RgbImage::from_fn(width, height, |x, y| {
        let (x, y) = (i64::from(x), i64::from(y));
        let window = (-RADIUS..=RADIUS).flat_map(|dy| (-RADIUS..=RADIUS).map(move |dx| (dx, dy)));
        let here = linear(unlit, x, y);
        // The offset prevents a division by zero on black surfaces.
        let (mut light, mut surface) = (Vec3::ZERO, Vec3::splat(1e-3));
        for (dx, dy) in window {
            let there = linear(unlit, x + dx, y + dy);
            let distance = 2.0 * (dx * dx + dy * dy) as f32 / (RADIUS * RADIUS) as f32;
            let difference = (there - here).length_squared() / (HALF_WEIGHT * HALF_WEIGHT);
            let weight = (-distance - difference).exp2();
            light += linear(lit, x + dx, y + dy) * weight;
            surface += there * weight;
        }
        Rgb((here * light / surface).to_array().map(srgb8_from_linear))
    })
}

impl Library for SceneLibrary {
    fn entries(&self) -> Vec<Entry> {
        let entry = |scene: &scenes::BuiltinScene| Entry {
            id: format!("builtin:{}", scene.name),
            name: scene.name.into(),
            description: scene.description.into(),
        };
        let mut entries: Vec<_> = scenes::all().iter().map(entry).collect();
        entries
            .iter_mut()
            .filter(|entry| entry.id == HOUSE)
            .for_each(|house| house.description += ", to be walked");
        entries
    }

    fn thumbnail(&mut self, entry: &Entry) -> Option<Thumbnail> {
        let scene = match entry.id.as_str() {
            HOUSE => scenes::house(0, Self::THUMBNAIL_TRIANGLES).scene,
            id => SceneSource::new(id).open().ok()?,
        };
        let scene = Arc::new(scene);
        let eye = place_headbox(&scene, None, None).ok()?.centre;
        let tracer = Tracer::new(scene, eye);
        let lighting = Lighting::measure(&tracer, 1);
        let (width, height) = Self::THUMBNAIL_PX;
        let camera = Camera::look_at(
            eye,
            eye + suggest_view(&tracer, eye),
            DVec3::Y,
            60.0,
            [width, height],
        )
        .ok()?;
        let [lit, unlit] = [true, false].map(|lit| {
            let lighting = if lit {
                &lighting
            } else {
                &Lighting::unmetered(&tracer, 0)
            };
            truth::render(
                &tracer,
                lighting,
                lit,
                &camera,
                Self::THUMBNAIL_SAMPLES,
                &Silent,
            )
            .rgb()
        });
        let pixels = denoise(&lit, &unlit)
            .pixels()
            .map(|&Rgb([r, g, b])| [r, g, b, 255])
            .collect();
        Some(Thumbnail {
            width,
            height,
            pixels,
        })
    }

    fn extensions(&self) -> Vec<String> {
        let mut extensions = inputs::shown_extensions();
        // Representations of other crates are added at run time.
        let views = headbox_views::all();
        let views = views.iter().map(|representation| representation.extension);
        let added: Vec<&str> = views.filter(|view| !extensions.contains(view)).collect();
        extensions.extend(added);
        extensions.into_iter().map(str::to_owned).collect()
    }

    fn open_entry(&mut self, id: &str) -> Result<Box<dyn FrameSource>, String> {
        open(id).map_err(|error| error.to_string())
    }

    fn open_file(&mut self, path: &Path) -> Result<Box<dyn FrameSource>, String> {
        let name = path
            .to_str()
            .ok_or_else(|| format!("{}: the name is not valid Unicode.", path.display()))?;
        open(name).map_err(|error| error.to_string())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn unsupported_files_are_refused() {
        let message = |name: &str| open(name).err().unwrap().to_string();
        assert!(
            message("notes.txt").contains("notes.txt: only"),
            "{}",
            message("notes.txt")
        );
        assert!(message("no/such.ldi").contains("no/such.ldi"));
        assert!(message("no/such.exr").contains("no/such.exr"));
        assert!(message("no/such.sprite").contains("no/such.sprite"));
        assert!(message("no/such.lumi").contains("no/such.lumi"));
        assert!(message("no/such.house").contains("no/such.house"));
        assert!(message("no/such.obj").contains("no/such.obj"));
        assert!(message("no/Home.xml").contains("no/Home.xml"));
        assert!(message("builtin:nonsense").contains("nonsense"));
    }

    #[test]
    fn every_shown_extension_is_opened() {
        let mut library = SceneLibrary;
        for extension in library.extensions() {
            let name = format!("no/such.{extension}");
            let error = library.open_file(Path::new(&name)).err().unwrap();
            assert!(error.contains(&name), "{error}");
            assert!(!error.contains("only these"), "{error}");
        }
        for representation in headbox_views::all() {
            let extension = representation.extension;
            assert!(inputs::REPRESENTATIONS.contains(&extension), "{extension}");
        }
    }

    #[test]
    fn every_entry_has_thumbnail() {
        let mut library = SceneLibrary;
        for entry in library.entries() {
            let picture = library.thumbnail(&entry).unwrap();
            assert_eq!(
                picture.pixels.len(),
                (picture.width * picture.height) as usize
            );
            assert!(
                picture.pixels.iter().any(|p| *p != picture.pixels[0]),
                "{}",
                entry.name
            );
        }
    }
}
