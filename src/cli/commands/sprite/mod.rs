//! `headbox sprite`.

mod sequence;

use super::images::is_image_set;
use super::info::sprite_json;
use crate::args::{
    CameraArgs, DefaultCamera, Names, SourceArgs, by_name, parse_length, refuse_given,
    refuse_misplaced,
};
use crate::commands::sprite::sequence::SequenceArgs;
use crate::messages::{UsageError, format_count};
use crate::output::{Outputs, SPRITES, has_extension, peak_rss_mb, print_json, write_text};
use crate::progress::Bar;
use anyhow::{Context, bail};
use clap::Args;
use glam::DVec3;
use headbox_core::bounces::Bounces;
use headbox_core::depth_kind::DepthKind;
use headbox_core::file_frame::triple;
use headbox_core::image::codec;
use headbox_core::image::orientation::{self, Orientation};
use headbox_core::light_parameters::LightParameters;
use headbox_core::read_note::ReadNote;
use headbox_cube::model::parameters::CaptureParameters;
use headbox_images::{DepthPicture, ImagesError};
use headbox_lab::sprite_range::SpriteRange;
use headbox_ldi::scene_source::SceneSource;
use headbox_sprite::{
    DepthImport, DisplacementFormat, SlabCapture, SpriteInfo, SpriteSet, SpriteWithDepth,
    capture_slabs, slabs_at_gaps, sprites_from_layers,
};
use headbox_trace::light::Lighting;
use serde_json::json;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Instant;

#[derive(Args)]
pub(crate) struct SpriteCommand {
    /// Scene to capture (an .obj, .gltf, .glb, .ply or .stl file, a home (Home.xml, .sh3d, .toml),
    /// or builtin:NAME), folder of photographs with known cameras, or .sprite file to export
    scene: Option<String>,
    #[command(flatten)]
    pub(super) source: SourceArgs,
    /// Output .sprite file; `-` for standard output
    #[arg(short, long)]
    output: Option<PathBuf>,
    #[command(flatten)]
    pub(super) camera: CameraArgs,
    #[command(flatten)]
    pub(super) quality: SpriteQualityArgs,
    #[command(flatten)]
    pub(super) sequence: SequenceArgs,
    #[command(flatten)]
    import: ImportArgs,
    /// Storage format of displacements
    #[arg(long, default_value = "i8", value_parser = by_name(DISPLACEMENT_FORMATS))]
    pub(super) displacement: DisplacementFormat,
    /// Divisor of the displacements' resolution, relative to the colours, 1 to 64
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u32).range(1..=64))]
    displacement_divisor: u32,
    /// Write colour (PNG), eye depth (EXR, metres) and cameras (sprites.json) of all sprites into
    /// this folder
    #[arg(long, value_name = "DIR")]
    export: Option<PathBuf>,
    /// Measure errors and write them into this folder. Scene: every variant against truth as the
    /// eye moves away from the capture position (range.csv, range.svg). Folder of images: sprites
    /// made without every third photograph, against these photographs (report.json, summary.md,
    /// images)
    #[arg(long, value_name = "DIR", requires = "scene")]
    pub(super) range: Option<PathBuf>,
    /// Print one JSON object on standard output
    #[arg(long, conflicts_with = "range")]
    pub(super) json: bool,
}

/// Default of `--slabs`.
const DEFAULT_SLABS: u16 = 4;

/// Default of `--samples`.
const DEFAULT_SAMPLES: u32 = 32;

/// Quality of sprites captured from a scene.
#[derive(Args)]
pub(super) struct SpriteQualityArgs {
    /// Maximum number of sprites, 1 to 64; the view is cut at its widest gaps of depth
    #[arg(long, value_name = "N", default_value_t = DEFAULT_SLABS, value_parser = clap::value_parser!(u16).range(1..=64))]
    slabs: u16,
    /// Rays per pixel
    #[arg(long, value_name = "N", default_value_t = DEFAULT_SAMPLES, value_parser = clap::value_parser!(u32).range(1..=65_536))]
    samples: u32,
    /// Diffuse bounces of light after direct light, 0 to 64, or full: all bounces
    #[arg(long, value_name = "B", default_value_t = CaptureParameters::DEFAULT.bounces)]
    bounces: Bounces,
    /// Store albedo and emission without lighting
    #[arg(long)]
    pub(super) unlit: bool,
}

/// Image and its depth, in place of a scene.
#[derive(Args)]
struct ImportArgs {
    /// Colour image (PNG and others) to make a sprite of; needs --depth and --depth-kind
    #[arg(long, value_name = "COLOR.png", requires_all = ["depth", "depth_kind"], conflicts_with = "scene")]
    color: Option<PathBuf>,
    /// Depth image: EXR, TIFF, NPY, or grey PNG of 8 or 16 bits where 0 means unknown; of the
    /// colour image's size or proportions
    #[arg(long, value_name = "DEPTH", requires = "color")]
    depth: Option<PathBuf>,
    /// Meaning of the depth values
    #[arg(long, requires = "color", value_parser = by_name(DEPTH_KINDS))]
    depth_kind: Option<DepthKind>,
    /// Metres per stored depth value; 1 for floating-point numbers (EXR) and 0.001 for integers
    /// (PNG) by default. Window depth: factor that scales stored values to 0..1; 1 for EXR, 1/255
    /// or 1/65535 for PNG of 8 or 16 bits by default
    #[arg(long, value_name = "METRES", requires = "color", value_parser = parse_length)]
    depth_unit: Option<f64>,
    /// Near plane of window depth, metres
    #[arg(long, value_name = "METRES", requires = "color", value_parser = parse_length)]
    near: Option<f64>,
    /// Far plane of window depth, metres; infinite by default
    #[arg(long, value_name = "METRES", requires = "color", value_parser = parse_length)]
    far: Option<f64>,
}

/// Storage formats of displacements.
const DISPLACEMENT_FORMATS: Names<DisplacementFormat> = &[
    (
        "i8",
        "Signed 8-bit integer, as in the paper",
        DisplacementFormat::I8,
    ),
    ("i16", "Signed 16-bit integer", DisplacementFormat::I16),
    ("f32", "32-bit floating point", DisplacementFormat::F32),
];

const DEPTH_KINDS: Names<DepthKind> = &[
    (
        "eye",
        "Distance along the viewing axis",
        DepthKind::EyeDepth,
    ),
    ("ray", "Distance from the eye", DepthKind::RayDistance),
    (
        "window",
        "Depth buffer value, 0 at the near plane and 1 at the far plane",
        DepthKind::WindowDepth,
    ),
    (
        "reversed-window",
        "Reversed depth buffer value, 1 at the near plane and 0 at the far plane",
        DepthKind::ReversedWindowDepth,
    ),
];

impl SpriteCommand {
    pub(crate) fn run(&self) -> anyhow::Result<()> {
        if self.output.is_none() && self.export.is_none() && self.range.is_none() {
            bail_usage!("nothing to do: give -o FILE.sprite, --export DIR or --range DIR");
        }
        let start = Instant::now();
        let outputs = self.outputs()?;
        let set = self.sprites(&outputs)?;
        let sprites: Vec<&SpriteWithDepth> = set
            .sprites()
            .iter()
            .map(|prepared| prepared.sprite())
            .collect();
        if let Some(output) = &self.output {
            set.write(output)?;
        }
        if let Some(folder) = &self.export {
            export(folder, &sprites, &set)?;
        }
        let seconds = start.elapsed().as_secs_f64();
        if self.json {
            let described: Vec<_> = sprites
                .iter()
                .map(|sprite| sprite_json(sprite, &set))
                .collect();
            print_json(
                &json!({ "sprites": described, "total_s": seconds, "peak_rss_mb": peak_rss_mb() }),
            );
            return Ok(());
        }
        let count = format_count(sprites.len() as u64, "sprite");
        if let Some(folder) = &self.export {
            println!("{}: colour and depth of {count}", folder.display());
        }
        if let Some(output) = &self.output {
            println!("{}: {count} with depth, {seconds:.2} s", output.display());
            if let Some(sprite) = sprites.first() {
                let camera = sprite.sprite().camera();
                let in_file = |point| triple(set.info.frame.file_from_world(point));
                println!(
                    "camera: --eye {} --look-at {}",
                    in_file(camera.eye()),
                    in_file(camera.eye() + camera.forward())
                );
            }
            println!(
                "look at it: headbox render {} -o frame.png",
                output.display()
            );
        }
        Ok(())
    }

    fn outputs(&self) -> anyhow::Result<Outputs> {
        let pictures = [&self.import.color, &self.import.depth]
            .into_iter()
            .flatten()
            .map(PathBuf::as_path);
        let inputs = pictures.chain(self.scene.as_ref().map(Path::new));
        let mut outputs =
            Outputs::new(self.json, inputs).maybe_file(self.output.as_ref(), &SPRITES)?;
        for folder in [&self.export, &self.range].into_iter().flatten() {
            outputs = outputs.folder(folder)?;
        }
        Ok(outputs)
    }

    fn sprites(&self, outputs: &Outputs) -> anyhow::Result<SpriteSet> {
        if let Some(folder) = self.scene.as_ref().filter(|scene| is_image_set(scene)) {
            return self.sequence_sprites(folder);
        }
        self.sequence.refuse_without_set()?;
        match (&self.scene, &self.import.color) {
            (_, Some(color)) => {
                self.quality.refuse()?;
                self.import(color)
            }
            (Some(file), None) if has_extension(Path::new(file), "sprite") => {
                self.quality.refuse()?;
                if self.range.is_some() {
                    bail_usage!("--range needs a scene: a .sprite file has no truth");
                }
                Ok(SpriteSet::read(Path::new(file))?)
            }
            (Some(scene), None) => self.capture(&self.source.source(scene), outputs),
            (None, None) => {
                bail_usage!(
                    "what shall the sprites show? give a scene (see `headbox scenes`), or --color and --depth"
                )
            }
        }
    }

    fn capture(&self, source: &SceneSource, outputs: &Outputs) -> anyhow::Result<SpriteSet> {
        let scene = Arc::new(source.open()?);
        outputs.add_scene(&source.name, &scene, self.sequence.set.strict)?;
        let (camera, tracer) = self.camera.aim(&scene)?;
        let lighting = Lighting::prepare(
            &tracer,
            camera.eye(),
            self.quality.bounces,
            !self.quality.unlit,
        );
        let bar = Bar::new();
        let capture = SlabCapture {
            tracer: &tracer,
            lighting: &lighting,
            lit: !self.quality.unlit,
            samples: self.quality.samples,
            format: self.displacement,
        };
        let slabs = slabs_at_gaps(&tracer, &camera, usize::from(self.quality.slabs));
        let sprites = capture_slabs(&capture, &camera, &slabs, &bar)?;
        bar.finish();
        if sprites.is_empty() {
            bail!(
                "nothing of {} is seen from there: move --eye or --look-at",
                source.name
            );
        }
        let mut set = self.reduce_displacement(sprites)?;
        set.info = SpriteInfo {
            source: source.name.clone(),
            frame: scene.frame,
            light: LightParameters {
                tone: lighting.tone,
                ..source.light.clone()
            },
        };
        set.environment = lighting.environment();
        if let Some(folder) = &self.range {
            let range = SpriteRange::measure(&capture, &camera, set.clone())?;
            let range = range
                .context("nothing lies straight ahead to measure a range by: move --look-at")?;
            write_range(folder, &source.name, &range)?;
        }
        Ok(set)
    }

    fn import(&self, color_path: &Path) -> anyhow::Result<SpriteSet> {
        let (Some(depth_path), Some(kind)) = (&self.import.depth, self.import.depth_kind) else {
            bail_usage!("--color needs --depth and --depth-kind");
        };
        let color = codec::read(color_path, codec::MAX_BYTES);
        let color = color
            .with_context(|| format!("{} could not be read as an image", color_path.display()))?;
        let damage = color.damage.as_ref();
        let damage = damage.map(|damage| format!("{}: {damage}", color_path.display()));
        let mut color = color.image;
        let turn = orientation::read(color_path);
        color.apply_orientation(turn);
        let color = color.to_rgba8();
        let depth = self.import.read_depth(depth_path, kind)?;
        let size = color.dimensions();
        let (depth, notes) = fit_depth(depth, turn, [color_path, depth_path], size, kind)?;
        let notes: Vec<ReadNote> = damage
            .into_iter()
            .chain(notes)
            .map(ReadNote::from)
            .collect();
        let name = color_path.display().to_string();
        self.sequence.set.strict.report(&name, &notes)?;
        if self.camera.size.is_some_and(|wanted| wanted != size) {
            bail_usage!(
                "{} has {}x{} pixels; leave --size out",
                color_path.display(),
                size.0,
                size.1
            );
        }
        let frame = self.source.file_frame();
        let import = DepthImport {
            camera: self.camera.camera(
                &frame,
                &DefaultCamera {
                    size,
                    ..DefaultCamera::from_eye(DVec3::ZERO)
                },
            )?,
            color,
            depth: &depth.values,
            depth_kind: kind,
            window_range_m: self.import.window_range(kind)?,
            plane: None,
            format: self.displacement,
        };
        let sprite = import
            .build()
            .with_context(|| format!("{} and {}", color_path.display(), depth_path.display()))?;
        let mut set = self.reduce_displacement(vec![sprite])?;
        set.info = SpriteInfo {
            source: color_path.display().to_string(),
            frame,
            ..SpriteInfo::default()
        };
        Ok(set)
    }

    /// Reduces the resolution of displacements by `--displacement-divisor`.
    pub(super) fn reduce_displacement(
        &self,
        sprites: Vec<SpriteWithDepth>,
    ) -> anyhow::Result<SpriteSet> {
        if self.displacement_divisor == 1 {
            return Ok(SpriteSet::new(sprites));
        }
        let reduced = |sprite: SpriteWithDepth| {
            let displacement = sprite.displacement().reduced(self.displacement_divisor)?;
            SpriteWithDepth::new(sprite.sprite().clone(), displacement)
        };
        Ok(SpriteSet::new(
            sprites.into_iter().map(reduced).collect::<Result<_, _>>()?,
        ))
    }

    /// Makes sprites of the layers of a folder of images.
    fn sequence_sprites(&self, name: &str) -> anyhow::Result<SpriteSet> {
        // Images have their own cameras and light.
        let flags = self.source.given_flags().into_iter();
        refuse_given("images", flags.chain(self.camera.given_flags()))?;
        self.quality.refuse()?;
        let (layers, frame) = self.sequence.layers(name, self.range.as_deref())?;
        if !self.json {
            eprintln!("{} with {}", layers.used[0], layers.used[1..].join(", "));
        }
        let mut sprites =
            self.reduce_displacement(sprites_from_layers(&layers, self.displacement)?)?;
        sprites.info = SpriteInfo {
            source: name.into(),
            frame,
            ..SpriteInfo::default()
        };
        Ok(sprites)
    }
}

impl SpriteQualityArgs {
    /// Refuses these arguments for input that is not a scene.
    fn refuse(&self) -> Result<(), UsageError> {
        let flags = [
            ("--slabs", self.slabs != DEFAULT_SLABS),
            ("--samples", self.samples != DEFAULT_SAMPLES),
            (
                "--bounces",
                self.bounces != CaptureParameters::DEFAULT.bounces,
            ),
            ("--unlit", self.unlit),
        ];
        refuse_misplaced("sprites of scenes", flags)
    }
}

impl ImportArgs {
    /// Reads depth: integers are millimetres, or fractions of the largest of their type for window
    /// depth, unless a unit is given.
    fn read_depth(&self, path: &Path, kind: DepthKind) -> Result<DepthPicture, ImagesError> {
        match (self.depth_unit, kind) {
            (Some(unit), _) => DepthPicture::read(path, unit as f32, unit as f32),
            (None, DepthKind::WindowDepth | DepthKind::ReversedWindowDepth) => {
                DepthPicture::read_fractions(path, 1.0)
            }
            (None, DepthKind::EyeDepth | DepthKind::RayDistance) => {
                DepthPicture::read(path, 1e-3, 1.0)
            }
        }
    }

    fn window_range(&self, kind: DepthKind) -> anyhow::Result<(f64, f64)> {
        match (kind, self.near) {
            (DepthKind::EyeDepth | DepthKind::RayDistance, _) => Ok((0.0, 0.0)),
            (_, Some(near)) => Ok((near, self.far.unwrap_or(f64::INFINITY))),
            (_, None) => bail_usage!("window depth needs --near METRES (and --far METRES)"),
        }
    }
}

/// Brings depth to the orientation and the size of an upright colour image; also returns notes on
/// what was done.
fn fit_depth(
    depth: DepthPicture,
    turn: Orientation,
    [color_path, depth_path]: [&Path; 2],
    (width, height): (u32, u32),
    kind: DepthKind,
) -> anyhow::Result<(DepthPicture, Vec<String>)> {
    let [color_name, depth_name] = [color_path, depth_path].map(|path| path.display().to_string());
    let mut notes = Vec::new();
    let is_window = matches!(
        kind,
        DepthKind::WindowDepth | DepthKind::ReversedWindowDepth
    );
    let size = [width, height];
    let mut fitted = depth.resampled(size, is_window);
    if turn != Orientation::NoTransforms {
        let is_turned = fitted.is_none() && orientation::swaps_sides(turn);
        let with_it = if is_turned {
            format!("{depth_name}, stored on its side, is turned with it")
        } else {
            format!("{depth_name} is taken to be upright")
        };
        notes.push(format!(
            "{color_name} is turned upright by its EXIF orientation; {with_it}"
        ));
        if is_turned {
            fitted = depth.turned(turn).resampled(size, is_window);
        }
    }
    let [dw, dh] = [depth.width, depth.height];
    let Some(fitted) = fitted else {
        bail!(
            "{color_name} has {width}x{height} pixels, {depth_name} {dw}x{dh}: bring both to one size, or to the same proportions"
        );
    };
    if [dw, dh] != size && [dh, dw] != size {
        notes.push(format!(
            "{depth_name} has {dw}x{dh} pixels, {color_name} {width}x{height}: depth is interpolated"
        ));
    }
    Ok((fitted, notes))
}

/// Writes `range.csv` and `range.svg`, and prints a summary.
fn write_range(folder: &Path, name: &str, range: &SpriteRange) -> anyhow::Result<()> {
    write_text(&folder.join("range.csv"), &range.to_csv())?;
    write_text(&folder.join("range.svg"), &range.chart(name).to_svg())?;
    range
        .sentences()
        .iter()
        .for_each(|sentence| println!("{sentence}"));
    println!("{}: range.csv and range.svg", folder.display());
    Ok(())
}

/// Writes `sprite_N.png`, `sprite_N.exr` and `sprites.json`.
fn export(folder: &Path, sprites: &[&SpriteWithDepth], set: &SpriteSet) -> anyhow::Result<()> {
    for (number, sprite) in sprites.iter().enumerate() {
        let file = |extension: &str| folder.join(format!("sprite_{number}.{extension}"));
        sprite.export(&file("png"), &file("exr"))?;
    }
    let described: Vec<_> = sprites
        .iter()
        .map(|sprite| sprite_json(sprite, set))
        .collect();
    write_text(
        &folder.join("sprites.json"),
        &format!("{:#}\n", json!(described)),
    )
}
