//! `headbox render`.

pub(crate) mod geometry;
pub(crate) mod layers;
mod polygons;
mod poses;
pub(crate) mod radiance;
mod view_renderer;

use self::view_renderer::{Planes, ViewRenderer, hex};
use super::images::is_image_set;
use crate::args::{CameraArgs, DefaultCamera, parse_length};
use crate::commands::render::geometry::{
    GEOMETRY_ALONE, GeometryResourceArgs, geometry_view, parse_texturing,
};
use crate::commands::render::polygons::PolygonsArg;
use crate::commands::render::radiance::{is_radiance, save_radiance};
use crate::image_set::SetArgs;
use crate::messages::UsageError;
use crate::output::{DEPTH, FILM, FRAME, Outputs, PICTURE, print_json, save_picture};
use crate::setting_flags::SettingFlags;
use clap::Args;
use headbox_core::camera::Camera;
use headbox_core::file_frame::{figure, triple};
use headbox_core::frame::Frame;
use headbox_core::simd;
use headbox_core::view::{OVERLAY, View};
use headbox_cube::pack::CubeLdi;
use headbox_cube::render::footprint::splat::SplatKernel;
use headbox_export::film;
use headbox_export::film::stereo::View as Projection;
use headbox_images::depth::DepthPicture;
use headbox_photos::view_geometry::{GeometrySettings, Texturing};
use headbox_scene::camera_path;
use headbox_sprite::write_depth_exr;
use headbox_views::TruthView;
use image::RgbImage;
use serde_json::json;
use std::path::PathBuf;

/// Figures of a frame in the JSON object and in times.csv, with their names in reports.
const FIGURES: [(&str, &str); 2] = [
    ("depth_pixels_in", "depth pixels in"),
    ("splatted", "splatted"),
];

#[derive(Args)]
pub(crate) struct RenderCommand {
    /// Inputs: .ldi and .sprite files and folders of images with depth, of one world, composed back
    /// to front; models (.obj, .gltf, .glb, .ply, .stl, builtin:NAME) among them, in the light of
    /// the first .ldi, their names followed by @at=X,Y,Z, @turn=DEG, @scale=S, @up=z or @unit=cm as needed;
    /// or one .house or .lumi file
    #[arg(required = true, value_name = "FILE")]
    files: Vec<PathBuf>,
    /// Output image (.png, .jpg, .webp, .tif, .bmp or .tga; `-` for PNG on standard output; of an
    /// .ldi also .exr with linear radiance); a film (.mp4 or .webm, which need ffmpeg, .apng or
    /// .gif); or with --path a folder for frames and times.csv
    #[arg(short, long)]
    output: PathBuf,
    #[command(flatten)]
    camera: CameraArgs,
    /// Render one frame per pose of this file: JSON poses of the window or of nerfstudio's viewer,
    /// or animated cameras of a .gltf or .glb, as exported by Blender. Without it a film of an .ldi
    /// moves about the eye inside the headbox, one of a .house walks through all rooms
    #[arg(long, value_name = "PATH")]
    path: Option<PathBuf>,
    /// Frame rate of a film, and sampling rate of an animation in --path, frames per second, 1 to
    /// 240; that of the times in PATH for films, else 30, by default
    #[arg(long, value_parser = clap::value_parser!(u32).range(1..=240))]
    fps: Option<u32>,
    /// Render both eyes side by side at this distance, metres, 0.064 for people; with --panorama
    /// one above the other
    #[arg(long, value_name = "METRES", value_parser = parse_length)]
    stereo: Option<f64>,
    /// Render all directions about the eye as an equirectangular image, twice as wide as high, for
    /// players of 360-degree images and films; the height is that of --size or of the path. With
    /// --stereo for both eyes (omni-directional stereo), the left one above
    #[arg(long)]
    panorama: bool,
    /// Render 180 by 180 degrees in front of both eyes, side by side, for VR180 players; the height
    /// is that of --size or of the path, and the distance of the eyes that of --stereo, 0.064 m by
    /// default
    #[arg(long, conflicts_with = "panorama")]
    vr180: bool,
    #[command(flatten)]
    settings: SettingFlags,
    #[command(flatten)]
    geometry: GeometryResourceArgs,
    #[command(flatten)]
    images: SetArgs,
    /// Write the eye depth of each pixel to this EXR, metres, infinite where nothing is drawn; for
    /// a single frame of one .ldi or folder of images
    #[arg(long, value_name = "FILE.exr", conflicts_with_all = ["path", "stereo", "panorama", "vr180"])]
    depth: Option<PathBuf>,
    /// Write the share of each pixel that splats cover to this image, 0 to 255; for a single frame
    #[arg(long, value_name = "FILE.png", conflicts_with_all = ["path", "stereo", "panorama", "vr180"])]
    coverage: Option<PathBuf>,
    /// Number of times to render each frame; the median time is reported
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u32).range(1..=100_000))]
    repeat: u32,
    /// Print one JSON object on standard output
    #[arg(long)]
    json: bool,
}

/// Refuses a variant that is neither a splat kernel nor a texturing of view-dependent geometry,
/// before a folder of images is opened.
fn refuse_unknown_variant(name: &str) -> Result<(), UsageError> {
    if SplatKernel::from_name(name).is_some() {
        return Ok(());
    }
    let mut names = SplatKernel::ALL.map(SplatKernel::name).to_vec();
    names.extend(Texturing::ALL.map(Texturing::name));
    Err(UsageError(format!(
        "there is no variant \"{name}\"; there are: {}",
        names.join(", ")
    )))
}

impl RenderCommand {
    pub(crate) fn run(&self) -> anyhow::Result<()> {
        let outputs = Outputs::new(self.json, self.files.iter().chain(&self.path));
        let is_film = film::is_film(&self.output);
        if is_film && let Some(flag) = self.still_flag() {
            bail_usage!("{flag} is for a single frame, not for a film");
        }
        match &self.path {
            _ if is_film => outputs.file(&self.output, &FILM)?,
            Some(_) => outputs.frame_folder(&self.output)?,
            None if self.fps.is_some() => bail_usage!("--fps is for films and for --path"),
            None => {
                let outputs = outputs
                    .file(&self.output, &FRAME)?
                    .maybe_file(self.depth.as_ref(), &DEPTH)?;
                outputs.maybe_file(self.coverage.as_ref(), &PICTURE)?
            }
        };
        let mut renderer = self.open()?;
        let outcome = self.render(&mut renderer, is_film);
        renderer.print_warnings();
        outcome
    }

    /// Renders the frame, the frames of the path or the film.
    fn render(&self, renderer: &mut ViewRenderer, is_film: bool) -> anyhow::Result<()> {
        let frame = renderer.view.file_frame();
        match &self.path {
            Some(path) => {
                let up = DefaultCamera::from_view(&*renderer.view, self.camera.size).up;
                let cameras = camera_path::read(path, &frame, up, f64::from(self.fps()))?;
                let cameras = self.camera.resize_path(cameras)?;
                renderer.warn_if_outside(&cameras);
                if is_film {
                    self.render_film(renderer, &cameras, self.film_fps(path, &frame)?)
                } else {
                    self.render_path(renderer, &cameras)
                }
            }
            None => {
                let default = DefaultCamera::from_view(&*renderer.view, self.camera.size);
                let camera = self.camera.camera(&frame, &default)?;
                if is_film {
                    let cameras = self.film_path(&*renderer.view, &camera)?;
                    return self.render_film(renderer, &cameras, self.fps());
                }
                renderer.warn_if_outside(&[camera]);
                self.render_one(renderer, &camera)
            }
        }
    }

    /// Opens the files as one view with the given settings.
    fn open(&self) -> anyhow::Result<ViewRenderer> {
        let is_set = |file: &PathBuf| is_image_set(&file.to_string_lossy());
        self.images
            .refuse_without_set(self.files.iter().any(is_set))?;
        let is_set_alone = matches!(self.files.as_slice(), [folder] if is_set(folder));
        let texturing = parse_texturing(self.settings.get("variant"), is_set_alone)?;
        let is_given = |flag: &&str| self.settings.get(flag).is_some();
        let has_geometry_flags =
            self.geometry.are_given() || ["cameras", "grid", "lod"].iter().any(is_given);
        if texturing.is_none() && has_geometry_flags {
            bail_usage!("{GEOMETRY_ALONE}");
        }
        if let (true, None, Some(name)) = (is_set_alone, texturing, self.settings.get("variant")) {
            refuse_unknown_variant(name)?;
        }
        let view: Box<dyn View> = match self.files.as_slice() {
            [folder] if texturing.is_some() => Box::new(geometry_view(
                folder,
                self.images,
                GeometrySettings::default(),
                &self.geometry,
            )?),
            [folder] if is_set(folder) => Box::new(TruthView::new(layers::cube_of_folder(
                folder,
                &self.images,
            )?)),
            [file] if PolygonsArg::parse(file)?.is_none() => match headbox_views::find(file) {
                Some(representation) => (representation.open)(file)?,
                // The reader of cubes has the best error message for other files.
                None => Box::new(TruthView::new(CubeLdi::read(file)?)),
            },
            _ => Box::new(layers::open(&self.files, &self.images)?),
        };
        let values = self.settings.values(&*view)?;
        let is_radiance = self.path.is_none() && is_radiance(&self.output);
        if is_radiance && view.level_radiance().is_none() {
            let kind = view.kind();
            bail_usage!("a frame in an .exr is for a cube LDI; {kind} has no radiance");
        }
        if is_radiance && self.settings.get("exposure").is_some() {
            bail_usage!("--exposure is for pictures; an .exr holds the light itself");
        }
        Ok(ViewRenderer::new(view, values))
    }

    /// Name of an option given that has a meaning for a single frame only.
    fn still_flag(&self) -> Option<&'static str> {
        let flags = [
            ("--depth", self.depth.is_some()),
            ("--coverage", self.coverage.is_some()),
            ("--repeat", self.repeat > 1),
        ];
        flags
            .into_iter()
            .find_map(|(flag, is_given)| is_given.then_some(flag))
    }

    /// Frame rate at which an animation is sampled, frames per second.
    fn fps(&self) -> u32 {
        self.fps.unwrap_or(30)
    }

    /// Projection of the frame.
    fn projection(&self) -> Projection {
        /// Human interpupillary distance, metres.
        const EYE_DISTANCE_M: f64 = 0.064;
        match (self.stereo, self.panorama, self.vr180) {
            (distance_m, _, true) => Projection::HalfSpheres(distance_m.unwrap_or(EYE_DISTANCE_M)),
            (Some(distance_m), true, _) => Projection::StereoPanorama(distance_m),
            (Some(distance_m), false, _) => Projection::SideBySide(distance_m),
            (None, true, _) => Projection::Panorama,
            (None, false, _) => Projection::Frame,
        }
    }

    fn picture(&self, renderer: &mut ViewRenderer, camera: &Camera) -> anyhow::Result<RgbImage> {
        self.projection().draw(camera, |camera| {
            anyhow::Ok(renderer.render(camera, 1, Planes::None)?.image)
        })
    }

    fn render_one(&self, renderer: &mut ViewRenderer, camera: &Camera) -> anyhow::Result<()> {
        if self.projection() != Projection::Frame {
            let picture = self.picture(renderer, camera)?;
            self.save(renderer, &picture)?;
            let (width, height) = picture.dimensions();
            if self.json {
                print_json(&json!({"size": [width, height], "variant": renderer.variant()}));
            } else {
                println!("{}: {width}x{height}", self.output.display());
            }
            return Ok(());
        }
        let planes = match (&self.depth, &self.coverage) {
            (Some(_), _) => Planes::Depth,
            (None, Some(_)) => Planes::Coverage,
            (None, None) => Planes::None,
        };
        let rendered = renderer.render(camera, self.repeat, planes)?;
        self.save(renderer, &rendered.image)?;
        if let Some(planes) = &rendered.planes {
            self.save_planes(planes)?;
        }
        renderer.warn_if_empty(camera, &rendered);
        let ms_median = rendered.ms_median();
        let in_file = |point| renderer.view.file_frame().file_from_world(point);
        let eye = in_file(camera.eye());
        let ahead = in_file(camera.eye() + camera.forward());
        let look_at = self.camera.look_at.unwrap_or(ahead);
        if self.json {
            let mut report = json!({
                "eye": eye, "look_at": look_at, "fov": camera.fov_y_deg(),
                "ms_median": ms_median, "ms": rendered.ms, "stages": rendered.stages(), "variant": renderer.variant(),
                "statistics": renderer.statistics(camera), "hole_fraction": rendered.hole_fraction(),
                "threads": rayon::current_num_threads(), "simd": simd::name(simd::level()),
            });
            for (key, figure) in FIGURES {
                if let Some(value) = rendered.figure(figure) {
                    report[key] = json!(value as u64);
                }
            }
            if self.settings.get(OVERLAY).is_some() {
                report["overlay"] = json!(renderer.overlay());
                report["size"] = json!([camera.width(), camera.height()]);
                rendered.add_overlay(&mut report);
            }
            print_json(&report);
        } else {
            let (file, holes) = (self.output.display(), rendered.hole_fraction() * 100.0);
            // The first frame allocates, and reads the file's pages.
            let which = if self.repeat == 1 {
                " for the first frame"
            } else {
                ""
            };
            println!(
                "{file}: {ms_median:.2} ms{which}, {}, {holes:.3} % holes",
                renderer.summary()
            );
            println!(
                "  camera  --eye {} --look-at {} --fov {}",
                triple(eye),
                triple(look_at),
                figure(camera.fov_y_deg())
            );
            if self.settings.get(OVERLAY).is_some() {
                println!("  overlay {}", renderer.overlay());
            }
            let legend = rendered.report.legend.iter();
            legend.for_each(|line| println!("  {}  {}", hex(line.color), line.label));
        }
        Ok(())
    }

    fn save(&self, renderer: &ViewRenderer, frame: &RgbImage) -> anyhow::Result<()> {
        match renderer.view.level_radiance() {
            Some(levels) if is_radiance(&self.output) => {
                let pixels = frame.pixels();
                let radiance: Vec<[f32; 3]> = pixels
                    .map(|pixel| pixel.0.map(|level| levels[usize::from(level)]))
                    .collect();
                save_radiance(&self.output, frame.dimensions(), &radiance)
            }
            _ => save_picture(&self.output, frame),
        }
    }

    /// Writes depth and coverage, if requested.
    fn save_planes(&self, frame: &Frame) -> anyhow::Result<()> {
        let &Frame { width, height, .. } = frame;
        if let Some(path) = &self.depth {
            let picture = DepthPicture {
                width,
                height,
                values: frame.depth_m.clone(),
            };
            write_depth_exr(&picture, path)?;
        }
        if let Some(path) = &self.coverage {
            let grey = |x: u32, y: u32| {
                frame.coverage[y as usize * width as usize + x as usize].splat_share()
            };
            save_picture(
                path,
                &RgbImage::from_fn(width, height, |x, y| image::Rgb([grey(x, y); 3])),
            )?;
        }
        Ok(())
    }
}
