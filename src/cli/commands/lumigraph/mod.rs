//! `headbox lumigraph`.

mod images;

use super::images::is_image_set;
use crate::args::{
    Names, SourceArgs, by_name, parse_length, parse_sides, parse_size, parse_vector,
};
use crate::commands::capture::place::place_headbox;
use crate::image_set::SetArgs;
use crate::messages::UsageError;
use crate::output::{LUMIGRAPH, Outputs, peak_rss_mb, print_json};
use crate::progress::Bar;
use anyhow::Context;
use clap::Args;
use glam::DVec3;
use headbox_core::bounces::Bounces;
use headbox_core::container::FileError;
use headbox_core::file_frame::FileFrame;
use headbox_core::headbox::Headbox;
use headbox_cube::model::parameters::CaptureParameters;
use headbox_lumigraph::{
    CameraGrid, GridParts, Lumigraph, LumigraphCapture, LumigraphError, MAX_LAYERS, MAX_SLABS,
    Placement, RawLumigraph, Slabs, middle_disparity,
};
use headbox_scene::scene::Scene;
use headbox_trace::bvh::Tracer;
use headbox_trace::light::Lighting;
use headbox_trace::viewpoint;
use serde_json::json;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Instant;

#[derive(Args)]
pub(crate) struct LumigraphCommand {
    /// Scene (an .obj, .gltf, .glb, .ply or .stl file, a home (Home.xml, .sh3d, .toml), or
    /// builtin:NAME), or folder of images with depth and known cameras in a grid on a plane
    pub(super) scene: String,
    #[command(flatten)]
    pub(super) source: SourceArgs,
    /// Output .lumi file; `-` for standard output
    #[arg(short, long)]
    pub(super) output: PathBuf,
    #[command(flatten)]
    pub(super) grid: GridArgs,
    #[command(flatten)]
    pub(super) quality: LumigraphQualityArgs,
    #[command(flatten)]
    pub(super) images: SetArgs,
    /// Print one JSON object on standard output
    #[arg(long)]
    pub(super) json: bool,
}

/// Placement of the cameras that capture a scene.
#[derive(Args)]
pub(super) struct GridArgs {
    /// Centre of the camera plane, in the file's axes and unit; repeat it for several planes; the
    /// centre of the scene's headbox by default
    #[arg(long, value_name = "X,Y,Z", value_parser = parse_vector, allow_hyphen_values = true)]
    plane: Vec<DVec3>,
    /// Viewing direction of the cameras, normal to their plane: one for all planes, or one for
    /// each; the direction with the most detail by default
    #[arg(long, value_name = "X,Y,Z", value_parser = parse_vector, allow_hyphen_values = true)]
    normal: Vec<DVec3>,
    /// Up direction of the images, in the file's axes; the file's up axis by default
    #[arg(long, value_name = "X,Y,Z", value_parser = parse_vector, allow_hyphen_values = true)]
    up_vector: Option<DVec3>,
    /// Distance from the first camera of a row to the last, in the file's unit; columns have the
    /// same spacing; the edge length of the scene's headbox by default
    #[arg(long, value_name = "LENGTH", value_parser = parse_length)]
    extent: Option<f64>,
    /// Number of cameras in a row and in a column, 1 to 256 each; 4x4 by default
    #[arg(long, value_name = "CxR", value_parser = parse_cameras)]
    cameras: Option<(u32, u32)>,
    /// Size of each image, pixels; 512x512 by default
    #[arg(long, value_name = "WxH", value_parser = parse_size)]
    size: Option<(u32, u32)>,
    /// Vertical field of view of each image, degrees, 0.1 to 170; 60 by default
    #[arg(long, value_name = "DEG", value_parser = parse_fov)]
    fov: Option<f64>,
    /// Distance from the plane, in the file's unit, at which all images show the same part of the
    /// scene; the middle of the disparities by default
    #[arg(long, value_name = "LENGTH", value_parser = parse_length, conflicts_with = "parallel")]
    focus: Option<f64>,
    /// Point all cameras straight ahead, as in the paper, without convergence
    #[arg(long)]
    parallel: bool,
    /// Number of light slabs, 1 to 256: camera planes rotated about a vertical axis, to show the
    /// scene from all around; 1 by default
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=MAX_SLABS as i64))]
    slabs: Option<u32>,
    /// Point on the rotation axis of the light slabs; the point straight ahead of the first plane
    /// at the middle disparity by default
    #[arg(long, value_name = "X,Y,Z", value_parser = parse_vector, allow_hyphen_values = true, requires = "slabs")]
    about: Option<DVec3>,
}

/// Quality of images and layers.
#[derive(Args)]
pub(super) struct LumigraphQualityArgs {
    /// Maximum number of layers; up to 255 take one byte per pixel, more take two
    #[arg(long, value_name = "N", default_value_t = 255, value_parser = clap::value_parser!(u32).range(1..=MAX_LAYERS as i64))]
    layers: u32,
    /// Placement of the layers along disparity
    #[arg(long, value_name = "WHERE", default_value = "histogram", value_parser = by_name(PLACEMENTS))]
    placement: Placement,
    /// Rays per pixel of a scene's images; 8 by default
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=65_536))]
    samples: Option<u32>,
    /// Diffuse bounces of a scene's light after direct light, 0 to 64, or full: all bounces, the
    /// default
    #[arg(long, value_name = "B")]
    bounces: Option<Bounces>,
    /// Store albedo and emission without lighting
    #[arg(long)]
    unlit: bool,
}

/// Placements of layers.
const PLACEMENTS: Names<Placement> = &[
    (
        "histogram",
        "Adapted to the surfaces: minimises the width of the widest layer",
        Placement::Histogram,
    ),
    (
        "uniform",
        "Equal intervals of disparity, as in the paper",
        Placement::Uniform,
    ),
];

fn placement_name(placement: Placement) -> &'static str {
    PLACEMENTS
        .iter()
        .find(|(.., known)| *known == placement)
        .map_or("", |(name, ..)| name)
}

/// Maximum number of cameras in a row or column.
const MAX_CAMERAS: u32 = 256;

fn parse_cameras(text: &str) -> Result<(u32, u32), String> {
    let allowed = 1..=MAX_CAMERAS;
    match parse_sides(text) {
        Some((columns, rows)) if allowed.contains(&columns) && allowed.contains(&rows) => {
            Ok((columns, rows))
        }
        _ => Err(format!(
            "give COLUMNSxROWS, each from 1 to {MAX_CAMERAS}, such as 4x4"
        )),
    }
}

fn parse_fov(text: &str) -> Result<f64, String> {
    text.parse()
        .ok()
        .filter(|fov| (0.1..=170.0).contains(fov))
        .ok_or("give degrees from 0.1 to 170".into())
}

impl LumigraphCommand {
    pub(crate) fn run(&self) -> anyhow::Result<()> {
        if is_image_set(&self.scene) {
            return self.run_images();
        }
        let start = Instant::now();
        let outputs =
            Outputs::new(self.json, [Path::new(&self.scene)]).file(&self.output, &LUMIGRAPH)?;
        let source = self.source.source(&self.scene);
        let scene = Arc::new(source.open()?);
        outputs.add_scene(&self.scene, &scene, self.images.strict)?;
        let (grids, tracer) = self.grid.place(&scene)?;
        let bounces = self
            .quality
            .bounces
            .unwrap_or(CaptureParameters::DEFAULT.bounces);
        let lighting =
            Lighting::prepare_paths(&tracer, tracer.origin(), bounces, !self.quality.unlit);
        let bar = Bar::new();
        let capture = LumigraphCapture {
            tracer: &tracer,
            lighting: &lighting,
            lit: !self.quality.unlit,
            samples: self.quality.samples.unwrap_or(8),
        };
        let mut slabs = Vec::new();
        for grid in &grids {
            let raw = capture.run(grid, &bar)?;
            let (slab, number) = (self.layered(&raw), slabs.len() + 1);
            slabs.push(match grids.len() {
                1 => slab?,
                count => slab.with_context(|| format!("light slab {number} of {count}"))?,
            });
        }
        bar.finish();
        let info = &mut slabs[0].info;
        (info.source, info.frame, info.tone) = (source.name, scene.frame, lighting.tone);
        let slabs = Slabs::new(slabs)?;
        slabs.write(&self.output)?;
        self.print_result(&slabs, start.elapsed().as_secs_f64());
        Ok(())
    }

    /// Assigns the pixels of the images to layers.
    pub(super) fn layered(&self, raw: &RawLumigraph) -> Result<Lumigraph, LumigraphError> {
        raw.layered(self.quality.layers as usize, self.quality.placement)
    }

    pub(super) fn print_result(&self, slabs: &Slabs, seconds: f64) {
        if self.json {
            let mut facts = lumigraph_json(slabs);
            facts["total_s"] = json!(seconds);
            facts["peak_rss_mb"] = json!(peak_rss_mb());
            print_json(&facts);
            return;
        }
        let (first, count) = (slabs.first(), slabs.all().len());
        let (columns, rows) = (first.grid().columns().len(), first.grid().rows().len());
        let (file, layers) = (self.output.display(), first.layers().len());
        let prefix = if count > 1 {
            format!("{count} light slabs of ")
        } else {
            String::new()
        };
        println!("{file}: {prefix}{columns}x{rows} images, {layers} layers, {seconds:.2} s");
        println!("look at it: headbox render {file} -o frame.png");
    }
}

impl LumigraphQualityArgs {
    /// Flags of tracing, each with true if it is given.
    pub(super) fn given_flags(&self) -> [(&'static str, bool); 3] {
        [
            ("--samples", self.samples.is_some()),
            ("--bounces", self.bounces.is_some()),
            ("--unlit", self.unlit),
        ]
    }
}

impl GridArgs {
    /// Flags of the grid, each with true if it is given.
    pub(super) fn given_flags(&self) -> [(&'static str, bool); 11] {
        [
            ("--plane", !self.plane.is_empty()),
            ("--normal", !self.normal.is_empty()),
            ("--up-vector", self.up_vector.is_some()),
            ("--extent", self.extent.is_some()),
            ("--cameras", self.cameras.is_some()),
            ("--size", self.size.is_some()),
            ("--fov", self.fov.is_some()),
            ("--focus", self.focus.is_some()),
            ("--parallel", self.parallel),
            ("--slabs", self.slabs.is_some()),
            ("--about", self.about.is_some()),
        ]
    }

    /// Cameras of each light slab, and a tracer about the plane of the first.
    fn place(&self, scene: &Arc<Scene>) -> anyhow::Result<(Vec<CameraGrid>, Tracer)> {
        let several = self.plane.len() > 1;
        if several && self.slabs.is_some() {
            bail_usage!("--slabs turns one --plane; give one, or leave --slabs out");
        }
        if self.plane.len() > MAX_SLABS {
            bail_usage!(
                "{} planes; a file has {MAX_SLABS} at most",
                self.plane.len()
            );
        }
        let planes = self.plane.len().max(1);
        if self.normal.len() > 1 && self.normal.len() != planes {
            let normals = self.normal.len();
            bail_usage!("{normals} --normal for {planes} --plane; give one, or one for each");
        }
        let headbox = place_headbox(scene, self.plane.first().copied(), None)?;
        let tracer = Tracer::new(Arc::clone(scene), headbox.centre);
        let mut grids = Vec::with_capacity(planes);
        for i in 0..planes {
            let centre = if i == 0 {
                headbox.centre
            } else {
                place_headbox(scene, Some(self.plane[i]), None)?.centre
            };
            let place = Headbox { centre, ..headbox };
            grids.push(self.grid(
                &tracer,
                place,
                self.normal.get(i).or(self.normal.first()).copied(),
            )?);
        }
        match <[CameraGrid; 1]>::try_from(grids) {
            Ok([first]) => {
                let frame = &scene.frame;
                let centre = self.about.map(|about| frame.world_from_file(about));
                let grids = self.turned_grids(first, centre, self.up(frame), &tracer)?;
                Ok((grids, tracer))
            }
            Err(grids) => Ok((grids, tracer)),
        }
    }

    fn up(&self, frame: &FileFrame) -> DVec3 {
        self.up_vector
            .map_or(DVec3::Y, |up| frame.world_direction_from_file(up))
    }

    /// Cameras on one plane about the centre of a headbox.
    fn grid(
        &self,
        tracer: &Tracer,
        headbox: Headbox,
        normal: Option<DVec3>,
    ) -> anyhow::Result<CameraGrid> {
        let frame = &tracer.scene().frame;
        let edge_m = self
            .extent
            .map_or(2.0 * headbox.half_size_m, |edge| edge * frame.unit_m);
        let normal = normal.map(|normal| frame.world_direction_from_file(normal));
        let normal = normal.unwrap_or_else(|| viewpoint::suggest_view(tracer, headbox.centre));
        let Some(world_from_eye) = CameraGrid::facing(normal, self.up(frame)) else {
            bail_usage!("--normal has no direction; give three numbers that are not all 0")
        };
        let (columns, rows) = self
            .cameras
            .map_or((4, 4), |(columns, rows)| (columns as usize, rows as usize));
        // A single column has the extent in the rows.
        let spacing = edge_m / (columns.max(2) - 1) as f64;
        let (width, height) = self.size.unwrap_or((512, 512));
        let half_fov = self.fov.unwrap_or(60.0).to_radians() / 2.0;
        let mut parts = GridParts {
            origin: headbox.centre,
            world_from_eye,
            columns: CameraGrid::even_positions(columns, edge_m),
            rows: CameraGrid::even_positions(
                rows,
                if columns > 1 {
                    spacing * (rows - 1) as f64
                } else {
                    edge_m
                },
            ),
            focal_px: f64::from(height) / 2.0 / half_fov.tan(),
            size_px: [width, height],
            convergence: 0.0,
        };
        if !self.parallel {
            let focus_m = self.focus.map(|focus| focus * frame.unit_m);
            parts.convergence =
                focus_m.map_or_else(|| middle_disparity(tracer, &parts), |focus| 1.0 / focus);
        }
        Ok(CameraGrid::new(parts).map_err(|error| UsageError(error.to_string()))?)
    }

    /// The first plane of cameras and its copies, rotated about a vertical line.
    fn turned_grids(
        &self,
        first: CameraGrid,
        centre: Option<DVec3>,
        up: DVec3,
        tracer: &Tracer,
    ) -> Result<Vec<CameraGrid>, UsageError> {
        let count = self.slabs.unwrap_or(1);
        let focus =
            || Some(middle_disparity(tracer, &first.parts())).filter(|disparity| *disparity > 0.0);
        let ahead = |disparity: f64| first.origin() - first.world_from_eye().z_axis / disparity;
        let centre = if count > 1 {
            centre.or_else(|| focus().map(ahead))
        } else {
            Some(first.origin())
        };
        let Some(centre) = centre else {
            return Err(UsageError(
                "the cameras see nothing to turn their plane about; give --about X,Y,Z".into(),
            ));
        };
        let turned = |i: u32| {
            let grid = first.turned(
                centre,
                up,
                std::f64::consts::TAU * f64::from(i) / f64::from(count),
            );
            let mut parts = grid.ok_or(LumigraphError::Grid("up direction"))?.parts();
            if i > 0 && !self.parallel && self.focus.is_none() {
                parts.convergence = middle_disparity(tracer, &parts);
            }
            CameraGrid::new(parts)
        };
        (0..count)
            .map(turned)
            .collect::<Result<_, _>>()
            .map_err(|error| UsageError(error.to_string()))
    }
}

/// Describes the first light slab, and the planes of all.
pub(super) fn lumigraph_json(slabs: &Slabs) -> serde_json::Value {
    let lumigraph = slabs.first();
    let (grid, frame) = (lumigraph.grid(), &lumigraph.info.frame);
    let in_file = |point: DVec3| frame.file_from_world(point);
    let along = |places: &[f64]| {
        places
            .iter()
            .map(|place| place / frame.unit_m)
            .collect::<Vec<_>>()
    };
    json!({
        "cameras": [grid.columns().len(), grid.rows().len()], "size": grid.size_px(), "layers": lumigraph.layers().len(),
        "index_bytes": lumigraph.index_bytes(), "plane": in_file(grid.origin()),
        "look_at": in_file(grid.origin() - grid.world_from_eye().z_axis), "columns": along(grid.columns()),
        "rows": along(grid.rows()), "focal_px": grid.focal_px(), "convergence_per_m": grid.convergence(),
        "disparity_per_m": lumigraph.range(), "unknown_pixels": lumigraph.unknown_pixels(),
        "environment_size": lumigraph.environment.size_px, "capture": lumigraph.info,
        "slabs": slabs.all().iter().map(|slab| in_file(slab.grid().origin())).collect::<Vec<_>>(),
    })
}

/// Prints the description of a `.lumi` file: `headbox info`.
pub(super) fn info(path: &Path, check: bool, json: bool) -> Result<(), FileError> {
    // Reading checks everything that a renderer relies on; --check only confirms it.
    let slabs = Slabs::read(path)?;
    let bytes = std::fs::metadata(path)
        .map_err(|source| FileError::Io {
            path: path.into(),
            source,
        })?
        .len();
    if json {
        let mut facts = lumigraph_json(&slabs);
        facts["kind"] = json!(headbox_lumigraph::LUMI_FILE.name);
        facts["bytes"] = json!(bytes);
        facts["depth_pixels"] = json!(null);
        facts["faces"] = json!([]);
        facts["ok"] = json!(true);
        print_json(&facts);
        return Ok(());
    }
    let frame: &FileFrame = &slabs.info().frame;
    println!(
        "{}: {}, {bytes} bytes",
        path.display(),
        headbox_lumigraph::LUMI_FILE.name
    );
    println!("  source      {}", slabs.info().source);
    println!(
        "  world       1 file unit = {} m, {} up in the file",
        frame.unit_m, frame.up
    );
    let count = slabs.all().len();
    for (number, slab) in slabs.all().iter().enumerate() {
        if count > 1 {
            println!("light slab {} of {count}", number + 1);
        }
        print_slab(slab);
    }
    if check {
        println!("ok: every promise of the layout holds");
    }
    Ok(())
}

fn print_slab(slab: &Lumigraph) {
    let (grid, info) = (slab.grid(), &slab.info);
    let frame = &info.frame;
    let [width, height] = grid.size_px();
    let extent = |places: &[f64]| (places[places.len() - 1] - places[0]) / frame.unit_m;
    println!(
        "  plane       at {} (in the file's axes and unit)",
        frame.file_from_world(grid.origin())
    );
    let normal = frame.file_from_world(grid.origin() - grid.world_from_eye().z_axis)
        - frame.file_from_world(grid.origin());
    println!("  normal      {}", normal.normalize_or_zero());
    println!(
        "  cameras     {}x{} over {}x{} file units",
        grid.columns().len(),
        grid.rows().len(),
        extent(grid.columns()),
        extent(grid.rows())
    );
    println!(
        "  images      {width}x{height} pixels, focal length {:.2} px",
        grid.focal_px()
    );
    let (layers, bits) = (slab.layers().len(), 8 * slab.index_bytes());
    println!(
        "  layers      {layers}, of {bits} bits a pixel, {}",
        placement_name(info.placement)
    );
    if let Some([min, max]) = slab.range() {
        println!("  depth       {:.3} to {:.3} m", 1.0 / max, 1.0 / min);
    }
    if slab.unknown_pixels() > 0 {
        let share =
            slab.unknown_pixels() as f64 / (grid.camera_count() * grid.picture_pixels()) as f64;
        println!("  unknown     {:.1} % of the pixels", 100.0 * share);
    }
}
