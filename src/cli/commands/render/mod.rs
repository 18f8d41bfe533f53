//! `headbox render`.

mod content;
pub(crate) mod geometry;
#[cfg(feature = "viewer")]
mod overlay;
mod polygons;
mod poses;
pub(crate) mod radiance;

use super::images::is_image_set;
use crate::args::{CameraArgs, DefaultCamera, Names, by_name, parse_length};
use crate::commands::house::file::HouseContent;
use crate::commands::images;
use crate::commands::render::content::{Content, CubeRenderer, Division};
use crate::commands::render::geometry::{
    GEOMETRY_ALONE, GeometryArgs, GeometryContent, texturing_of,
};
use crate::commands::render::polygons::PolygonsArg;
use crate::commands::render::radiance::{StoredLevels, is_radiance};
use crate::image_set::SetArgs;
use crate::output::{DEPTH, FILM, FRAME, Outputs, PICTURE, print_json, save_picture};
use crate::progress::Bar;
use crate::words::UsageError;
use anyhow::bail;
use clap::Args;
use headbox_core::camera::Camera;
use headbox_core::container::Container;
use headbox_core::file_frame::FileFrame;
use headbox_core::frame::Frame;
use headbox_core::simd;
use headbox_cube::pack::CubeLdi;
use headbox_cube::render::footprint::splat::SplatKernel;
use headbox_export::film;
use headbox_export::stereo::View;
use headbox_house::file::HOUSE_FILE;
use headbox_images::depth::DepthPicture;
use headbox_lumigraph::{Blend, LUMI_FILE, LumigraphSettings, Slabs};
use headbox_photos::view_geometry::Texturing;
use headbox_scene::camera_path;
use headbox_sprite::compose::{ComposeSettings, Composition};
use headbox_sprite::{
    RenderOptions, SPRITE_FILE, SpriteSampling, SpriteSet, SpriteVariant, write_depth_exr,
};
use image::RgbImage;
use serde_json::json;
use std::path::PathBuf;

#[derive(Args)]
pub(crate) struct RenderCommand {
    /// A .ldi or .sprite file or a folder of images with depth, or several of one world, laid over
    /// each other back to front, and models among them (.obj, .gltf, .glb, builtin:NAME), in the
    /// light of the first .ldi; @at=X,Y,Z, @turn=DEG, @scale=S, @up=z and @unit=cm may follow a
    /// model's name. Or one .house or .lumi file
    #[arg(required = true, value_name = "FILE")]
    files: Vec<PathBuf>,
    /// Picture to write (.png, .jpg, .webp, .tif, .bmp or .tga; `-` for standard output, PNG; of a
    /// .ldi also .exr: linear radiance); with --path the folder for frames and times.csv, or a film
    /// (.mp4 or .webm, which need ffmpeg, .apng or .gif)
    #[arg(short, long)]
    output: PathBuf,
    #[command(flatten)]
    camera: CameraArgs,
    /// Render a frame per pose of this file: JSON of poses, of the window or of nerfstudio's
    /// viewer, or the cameras of a .gltf or .glb with the animation that moves them, as Blender
    /// exports it
    #[arg(long, value_name = "PATH")]
    path: Option<PathBuf>,
    /// Frames a second of a film, and of an animation in --path; if absent as the times in PATH
    /// have it, else 30
    #[arg(long, requires = "path", value_parser = clap::value_parser!(u32).range(1..=240))]
    fps: Option<u32>,
    /// Frames for both eyes side by side, so many metres apart: 0.064 for people; with --panorama
    /// one above the other
    #[arg(long, value_name = "METRES", value_parser = parse_length)]
    stereo: Option<f64>,
    /// All directions about the eye, twice as wide as high (equirectangular), as players of
    /// 360-degree pictures and films have it; the height is that of --size or of the path. With
    /// --stereo for both eyes (omni-directional stereo), the left one above
    #[arg(long)]
    panorama: bool,
    /// What lies before both eyes, 180 by 180 degrees each, side by side, as VR180 has it; the
    /// height is that of --size or of the path, and the eyes are 0.064 m apart without --stereo
    #[arg(long, conflicts_with = "panorama")]
    vr180: bool,
    /// How samples become pixels, or how parallax inside sprites is drawn: see the list that a
    /// wrong name prints. For a folder of images also geometry-blended and its kin: view-dependent
    /// geometry, made for each frame, instead of a cube LDI
    #[arg(long, value_name = "NAME")]
    variant: Option<String>,
    #[command(flatten)]
    geometry: GeometryArgs,
    #[command(flatten)]
    images: SetArgs,
    /// How colours of sprites are looked up; bilinear if absent
    #[arg(long, value_parser = by_name(SAMPLINGS))]
    sampling: Option<SpriteSampling>,
    /// Pixels by which gaps inside sprites are filled; 3 if absent
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(0..=64))]
    fill_steps: Option<u32>,
    /// Leave small holes open, which are otherwise filled from what lies behind their rims
    #[arg(long)]
    keep_holes: bool,
    /// Show a .ldi so many stops brighter than it was captured, cut off at white; a capture made
    /// with --hdr keeps what lies above
    #[arg(long, value_name = "STOPS", value_parser = parse_stops, allow_hyphen_values = true)]
    exposure: Option<f32>,
    /// EXR to write the eye depth of each pixel to, metres, infinite where nothing is drawn; for a
    /// single frame of one .ldi
    #[arg(long, value_name = "FILE.exr", conflicts_with_all = ["path", "stereo", "panorama", "vr180"])]
    depth: Option<PathBuf>,
    /// Picture of the share of each pixel to that depth pixels cover, 0 to 255, to write; for a
    /// single frame of one .ldi
    #[arg(long, value_name = "FILE.png", conflicts_with_all = ["path", "stereo", "panorama", "vr180"])]
    coverage: Option<PathBuf>,
    /// Instead of the frame, one of the overlays that the window has for such a file, with a
    /// legend: holes, coverage, depth and others; of view-dependent geometry camera, owners, mesh
    /// and age; a wrong name prints the list
    #[cfg(feature = "viewer")]
    #[arg(long, value_name = "NAME", conflicts_with_all = [
        "path", "fps", "stereo", "panorama", "vr180", "sampling", "fill_steps", "keep_holes", "exposure", "depth", "coverage", "merge",
        "by_depth", "parallel", "repeat",
    ])]
    overlay: Option<String>,
    /// How far two cameras of a .lumi file may disagree where its layers are merged, pixels; 1 if
    /// absent, 0 merges none
    #[arg(long, value_name = "PX", value_parser = parse_merge)]
    merge: Option<f64>,
    /// Lay several files over each other pixel by pixel, by depth, instead of whole: slower, but
    /// right where they reach through each other. With a model it is always so
    #[arg(long)]
    by_depth: bool,
    /// How threads share the frame of a single .ldi without plane textures (all others are drawn
    /// in bands); the frame is the same in any case; bands if absent
    #[arg(long, value_name = "WAY", value_parser = by_name(WAYS))]
    parallel: Option<Division>,
    /// Render each frame so many times and report the median
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u32).range(1..=100_000))]
    repeat: u32,
    /// Print one JSON object on standard output
    #[arg(long)]
    json: bool,
}

fn parse_merge(text: &str) -> Result<f64, String> {
    text.parse()
        .ok()
        .filter(|px| (0.0..=1e6).contains(px))
        .ok_or("give pixels, 0 or more".into())
}

fn parse_stops(text: &str) -> Result<f32, String> {
    text.parse()
        .ok()
        .filter(|stops: &f32| stops.abs() <= 40.0)
        .ok_or("give stops from -40 to 40".into())
}

/// Names of the texture filters.
const SAMPLINGS: Names<SpriteSampling> = &[
    ("nearest", "The nearest pixel", SpriteSampling::Nearest),
    (
        "bilinear",
        "Weighted mean of the four around",
        SpriteSampling::Bilinear,
    ),
];

/// Names of the divisions of a frame among threads.
const WAYS: Names<Division> = &[
    ("bands", "Bands of rows of the frame", Division::Bands),
    (
        "fragments",
        "Fragments of the LDI between epipolar lines, one a thread",
        Division::Fragments,
    ),
];

impl RenderCommand {
    pub(crate) fn run(&self) -> anyhow::Result<()> {
        let outputs = Outputs::new(self.json, self.files.iter().chain(&self.path));
        match &self.path {
            Some(_) if film::is_film(&self.output) => outputs.file(&self.output, &FILM)?,
            Some(_) => outputs.folder_of_frames(&self.output)?,
            None => {
                let outputs = outputs
                    .file(&self.output, &FRAME)?
                    .maybe_file(self.depth.as_ref(), &DEPTH)?;
                outputs.maybe_file(self.coverage.as_ref(), &PICTURE)?
            }
        };
        #[cfg(feature = "viewer")]
        if let Some(overlay) = &self.overlay {
            self.images.only_for_sets(
                self.files
                    .iter()
                    .any(|file| is_image_set(&file.to_string_lossy())),
            )?;
            return self.render_overlay(overlay);
        }
        let (mut content, frame, default_camera) = self.open()?;
        self.of_cubes_alone(&mut content)?;
        match &self.path {
            Some(path) => {
                let cameras =
                    self.camera
                        .of_path(camera_path::read(path, &frame, f64::from(self.fps()))?)?;
                content.warn_if_outside(&cameras, &frame);
                match film::is_film(&self.output) {
                    true => self.render_film(&mut content, &cameras, self.film_fps(path, &frame)?),
                    false => self.render_path(&mut content, &cameras),
                }
            }
            None => {
                let camera = self.camera.camera(&frame, &default_camera)?;
                content.warn_if_outside(&[camera], &frame);
                self.render_one(&mut content, &camera)
            }
        }
    }

    /// Reads the files. Axes, unit and camera are those of the first.
    fn open(&self) -> anyhow::Result<(Content, FileFrame, DefaultCamera)> {
        self.images.only_for_sets(
            self.files
                .iter()
                .any(|file| is_image_set(&file.to_string_lossy())),
        )?;
        if let Some(content) = self.open_house()? {
            return Ok(content);
        }
        if let Some(content) = self.open_lumigraph()? {
            return Ok(content);
        }
        if self.merge.is_some() {
            return Err(UsageError("--merge is for .lumi files".into()).into());
        }
        if let Some(content) = self.open_geometry()? {
            return Ok(content);
        }
        let (mut cubes, mut sprites, mut models) = (Vec::new(), None::<SpriteSet>, Vec::new());
        let mut world = None;
        for file in &self.files {
            if let Some(model) = PolygonsArg::of_file(file)? {
                models.push(model);
                continue;
            }
            // What is no file of ours the reader of cubes names best.
            if Container::peek_kind(file).ok().flatten() == Some(SPRITE_FILE.tag) {
                let set = SpriteSet::read(file)?;
                let Some(first) = set.sprites().first() else {
                    bail!("{}: holds no sprites", file.display())
                };
                let camera = DefaultCamera::like(first.sprite().sprite().camera());
                world.get_or_insert((set.info.frame, camera));
                match &mut sprites {
                    None => sprites = Some(set),
                    Some(sprites) => sprites.append(set),
                }
            } else {
                let cube = match is_image_set(&file.to_string_lossy()) {
                    true => {
                        let bar = Bar::new();
                        let cube = images::cube(file, &self.images, &bar)?;
                        bar.finish();
                        cube
                    }
                    false => CubeLdi::read(file)?,
                };
                world.get_or_insert((cube.info.frame, DefaultCamera::of_cube(&cube.info)));
                cubes.push(cube);
            }
        }
        let Some((frame, camera)) = world else {
            let name = self
                .files
                .first()
                .map(|file| file.display().to_string())
                .unwrap_or_default();
            bail!(
                "{name}: is a scene: capture it first, or name a .ldi or .sprite file for it to stand among"
            )
        };
        let settings = self.settings(!cubes.is_empty(), sprites.is_some())?;
        let polygons = models
            .iter()
            .map(|model| model.open(&frame, cubes.first()))
            .collect::<Result<Vec<_>, _>>()?;
        let content = match (sprites, cubes.len()) {
            (None, 1) if polygons.is_empty() => Content::Cube {
                cube: Box::new(cubes.remove(0)),
                renderer: Box::new(CubeRenderer::new(self.parallel.unwrap_or_default())),
                settings: settings.cubes,
                shown: None,
            },
            (sprites, _) => Content::Layers {
                layers: Box::new(
                    Composition::new(sprites.unwrap_or_else(|| SpriteSet::new(Vec::new())), cubes)
                        .with_polygons(polygons),
                ),
                composer: Box::default(),
                settings,
                frame: Frame::default(),
            },
        };
        Ok((content, frame, camera))
    }

    /// Refuses what else is given beside a file of a kind that is rendered alone.
    fn is_alone(&self, kind: &str, is_one_thread: bool) -> Result<(), UsageError> {
        let beside = [
            ("other files", self.files.len() > 1),
            ("--sampling", self.sampling.is_some()),
            ("--fill-steps", self.fill_steps.is_some()),
            ("--parallel", is_one_thread && self.parallel.is_some()),
        ];
        match beside.iter().find(|(_, is_given)| *is_given) {
            Some((what, _)) => Err(UsageError(format!(
                "a {kind} file is rendered without {what}; leave out {what}"
            ))),
            None => Ok(()),
        }
    }

    /// A `.house` file, which comes alone; `None` if there is none among the files.
    fn open_house(&self) -> anyhow::Result<Option<(Content, FileFrame, DefaultCamera)>> {
        let is_house =
            |file: &PathBuf| Container::peek_kind(file).ok().flatten() == Some(HOUSE_FILE.tag);
        let Some(file) = self.files.iter().find(|file| is_house(file)) else {
            return Ok(None);
        };
        self.is_alone(".house", false)?;
        let (content, frame, camera) = HouseContent::open(file, self.variant.as_deref())?;
        Ok(Some((Content::House(Box::new(content)), frame, camera)))
    }

    /// A folder of images for a variant of view-dependent geometry; `None` if that is not asked
    /// for.
    fn open_geometry(&self) -> anyhow::Result<Option<(Content, FileFrame, DefaultCamera)>> {
        let alone =
            matches!(self.files.as_slice(), [folder] if is_image_set(&folder.to_string_lossy()));
        let Some(texturing) = texturing_of(self.variant.as_deref(), alone)? else {
            if self.geometry.are_given() {
                return Err(UsageError(GEOMETRY_ALONE.into()).into());
            }
            return Ok(None);
        };
        if self.sampling.is_some()
            || self.fill_steps.is_some()
            || self.parallel.is_some()
            || self.keep_holes
        {
            let message = "--sampling, --fill-steps, --parallel and --keep-holes are not for view-dependent geometry";
            return Err(UsageError(message.into()).into());
        }
        let (content, frame, camera) =
            GeometryContent::open(&self.files[0], self.images, texturing, &self.geometry)?;
        Ok(Some((Content::Geometry(Box::new(content)), frame, camera)))
    }

    /// A `.lumi` file, which comes alone; `None` if there is none among the files.
    fn open_lumigraph(&self) -> anyhow::Result<Option<(Content, FileFrame, DefaultCamera)>> {
        let is_lumigraph =
            |file: &PathBuf| Container::peek_kind(file).ok().flatten() == Some(LUMI_FILE.tag);
        let Some(file) = self.files.iter().find(|file| is_lumigraph(file)) else {
            return Ok(None);
        };
        self.is_alone(".lumi", true)?;
        let mut settings = LumigraphSettings::default();
        settings.tolerance_px = self.merge.unwrap_or(settings.tolerance_px);
        settings.merge = settings.tolerance_px > 0.0;
        if let Some(wanted) = &self.variant {
            let found = Blend::ALL.iter().find(|(name, _)| name == wanted);
            settings.blend = found.map(|(_, blend)| *blend).ok_or_else(|| {
                let names = Blend::ALL.map(|(name, _)| name).join(", ");
                UsageError(format!(
                    "there is no variant \"{wanted}\"; there are: {names}"
                ))
            })?;
        }
        let slabs = Box::new(Slabs::read(file)?);
        let first = slabs.first();
        let grid = first.grid();
        let [column, row] = [grid.columns().len() / 2, grid.rows().len() / 2];
        let size = self.camera.size.unwrap_or((1024, 768));
        let fov_y_deg = first.clear_fov_deg([size.0, size.1]);
        let camera = DefaultCamera {
            eye: grid.origin(),
            size,
            fov_y_deg,
            ..DefaultCamera::like(&grid.camera(column, row))
        };
        let frame = slabs.info().frame;
        Ok(Some((
            Content::Lumigraph {
                slabs,
                renderer: Box::default(),
                settings,
            },
            frame,
            camera,
        )))
    }

    fn settings(&self, cubes: bool, sprites: bool) -> anyhow::Result<ComposeSettings> {
        let mut settings = ComposeSettings::default();
        if !sprites && (self.sampling.is_some() || self.fill_steps.is_some()) {
            return Err(
                UsageError("--sampling and --fill-steps are for .sprite files".into()).into(),
            );
        }
        let RenderOptions {
            sampling,
            fill_steps,
            ..
        } = settings.sprites;
        settings.sprites.sampling = self.sampling.unwrap_or(sampling);
        settings.sprites.fill_steps = self.fill_steps.unwrap_or(fill_steps);
        if !cubes && self.parallel.is_some() {
            return Err(UsageError("--parallel is for .ldi files".into()).into());
        }
        if !cubes && self.keep_holes {
            return Err(UsageError("--keep-holes is for .ldi files".into()).into());
        }
        settings.cubes.keep_holes = self.keep_holes;
        settings.by_depth = self.by_depth;
        let Some(wanted) = &self.variant else {
            return Ok(settings);
        };
        let kernel = SplatKernel::ALL
            .into_iter()
            .find(|kernel| kernel.name() == wanted)
            .filter(|_| cubes);
        match (SpriteVariant::from_name(wanted).filter(|_| sprites), kernel) {
            (Some(variant), _) => settings.sprites.variant = variant,
            (None, Some(kernel)) => settings.cubes.kernel = kernel,
            (None, None) => {
                let kernels = SplatKernel::ALL
                    .iter()
                    .filter(|_| cubes)
                    .map(|kernel| kernel.name());
                let variants = SpriteVariant::ALL
                    .iter()
                    .filter(|_| sprites)
                    .map(|variant| variant.name());
                let is_set = matches!(self.files.as_slice(), [folder] if is_image_set(&folder.to_string_lossy()));
                let geometry = Texturing::ALL
                    .iter()
                    .filter(|_| is_set)
                    .map(|(name, _)| *name);
                let names: Vec<&str> = kernels.chain(variants).chain(geometry).collect();
                let message = format!(
                    "there is no variant \"{wanted}\"; there are: {}",
                    names.join(", ")
                );
                return Err(UsageError(message).into());
            }
        }
        Ok(settings)
    }

    /// Moments a second of an animation.
    fn fps(&self) -> u32 {
        self.fps.unwrap_or(30)
    }

    /// Projection of the frame.
    fn view(&self) -> View {
        /// Between the pupils of people, metres.
        const PEOPLE_M: f64 = 0.064;
        match (self.stereo, self.panorama, self.vr180) {
            (distance_m, _, true) => View::HalfSpheres(distance_m.unwrap_or(PEOPLE_M)),
            (Some(distance_m), true, _) => View::StereoPanorama(distance_m),
            (Some(distance_m), false, _) => View::SideBySide(distance_m),
            (None, true, _) => View::Panorama,
            (None, false, _) => View::Frame,
        }
    }

    fn picture(&self, content: &mut Content, camera: &Camera) -> anyhow::Result<RgbImage> {
        self.view().draw(camera, |camera| {
            anyhow::Ok(content.render(camera, 1)?.image)
        })
    }

    fn render_one(&self, content: &mut Content, camera: &Camera) -> anyhow::Result<()> {
        if self.view() != View::Frame {
            let picture = self.picture(content, camera)?;
            self.save(content, &picture)?;
            let (width, height) = picture.dimensions();
            match self.json {
                true => print_json(&json!({"size": [width, height], "variant": content.variant()})),
                false => println!("{}: {width}x{height}", self.output.display()),
            }
            return Ok(());
        }
        if let Content::Cube { settings, .. } = content {
            settings.depth = self.depth.is_some();
        } else if self.depth.is_some() || self.coverage.is_some() {
            return Err(
                UsageError("--depth and --coverage are for a single .ldi file".into()).into(),
            );
        }
        let rendered = content.render(camera, self.repeat)?;
        self.save(content, &rendered.image)?;
        if let Content::Cube { renderer, .. } = content {
            self.save_planes(renderer.frame())?;
        }
        let ms_median = rendered.ms_median();
        if self.json {
            print_json(&json!({
                "ms_median": ms_median, "ms": rendered.ms, "stages": rendered.stages, "variant": content.variant(),
                "depth_pixels_in": rendered.depth_pixels_in, "splatted": rendered.splatted,
                "statistics": rendered.statistics, "hole_fraction": rendered.hole_fraction(),
                "threads": rayon::current_num_threads(), "simd": simd::name(simd::level()),
            }));
        } else {
            let (file, holes) = (self.output.display(), rendered.hole_fraction() * 100.0);
            println!(
                "{file}: {ms_median:.2} ms, {}, {holes:.3} % holes",
                content.summary(&rendered)
            );
        }
        Ok(())
    }

    /// Refuses radiance and exposure of what does not say how its levels came about, and sets the
    /// exposure of what does.
    fn of_cubes_alone(&self, content: &mut Content) -> Result<(), UsageError> {
        let radiance = self.path.is_none() && is_radiance(&self.output);
        match (content, self.exposure) {
            (Content::Cube { .. }, Some(_)) if radiance => Err(UsageError(
                "--exposure is for pictures; an .exr holds the light itself".into(),
            )),
            (Content::Cube { cube, shown, .. }, Some(stops)) => {
                *shown = Some(Box::new(StoredLevels::of(&cube.info).brighter(stops)));
                Ok(())
            }
            (Content::Cube { .. }, None) => Ok(()),
            (_, None) if !radiance => Ok(()),
            _ => Err(UsageError(
                "--exposure, and a frame in an .exr, are for a single .ldi file".into(),
            )),
        }
    }

    fn save(&self, content: &Content, frame: &RgbImage) -> anyhow::Result<()> {
        match content {
            Content::Cube { cube, .. } if is_radiance(&self.output) => {
                StoredLevels::of(&cube.info).save(&self.output, frame)
            }
            _ => save_picture(&self.output, frame),
        }
    }

    /// Writes what was asked for beside the colours.
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
