//! `headbox info`.

mod scene;

use super::capture::describe_aimed_rays;
use super::images::{ImagesCommand, is_image_set};
use crate::args::{AxesArgs, refuse_misplaced};
use crate::commands::capture::deep::{self as capture_deep, is_deep_picture};
use crate::commands::house::file as house_file;
use crate::commands::lumigraph;
use crate::messages::format_count;
use crate::output::print_json;
use anyhow::Context;
use clap::Args;
use headbox_core::bounces::Bounces;
use headbox_core::container::Container;
use headbox_core::cube_face::Face;
use headbox_core::file_frame::{figure, triple};
use headbox_cube::model::info::CaptureInfo;
use headbox_cube::pack::file::CUBE_LDI;
use headbox_cube::pack::{CubeLdi, SegmentSide};
use headbox_house::file::HOUSE_FILE;
use headbox_ldi::accumulate::shard::{self, SHARD};
use headbox_ldi::scene_source::SceneSource;
use headbox_lumigraph::LUMI_FILE;
use headbox_sprite::{SPRITE_FILE, SpriteSet, SpriteWithDepth};
use serde_json::{Value, json};
use std::path::PathBuf;

#[derive(Args)]
pub(crate) struct InfoCommand {
    /// Input .ldi, .sprite, .lumi or .house file, shard, deep EXR, folder of images, scene or home
    file: PathBuf,
    #[command(flatten)]
    axes: AxesArgs,
    /// Verify the complete layout, of a shard sample by sample, and print ok
    #[arg(long)]
    check: bool,
    /// Print one JSON object on standard output
    #[arg(long)]
    json: bool,
}

impl InfoCommand {
    pub(crate) fn run(&self) -> anyhow::Result<()> {
        let name = self.file.to_string_lossy();
        if scene::is_scene(&name) {
            let source = SceneSource {
                options: self.axes.load_options(),
                ..SceneSource::new(&*name)
            };
            return scene::describe(&source, self.check, self.json);
        }
        refuse_misplaced("scenes", self.axes.given_flags())?;
        if is_image_set(&name) {
            return ImagesCommand::new(&self.file, self.json).run();
        }
        if is_deep_picture(&name) {
            return capture_deep::describe(&self.file, self.json);
        }
        let kind =
            Container::peek_kind(&self.file).with_context(|| format!("{}", self.file.display()))?;
        match kind {
            Some(tag) if tag == CUBE_LDI.tag => self.cube(),
            Some(tag) if tag == SHARD.tag => self.shard(),
            Some(tag) if tag == SPRITE_FILE.tag => self.sprites(),
            Some(tag) if tag == LUMI_FILE.tag => {
                Ok(lumigraph::info(&self.file, self.check, self.json)?)
            }
            Some(tag) if tag == HOUSE_FILE.tag => {
                house_file::info(&self.file, self.check, self.json)
            }
            // The reader of cubes has the best error message for other files.
            _ => self.cube(),
        }
    }

    fn cube(&self) -> anyhow::Result<()> {
        // Reading checks everything that a renderer relies on; --check only confirms it.
        let cube = CubeLdi::read(&self.file)?;
        let bytes = std::fs::metadata(&self.file)?.len();
        let segment = |s: &headbox_cube::pack::PackedSegment| {
            json!({
                "face": s.face.name(), "side": if s.side == SegmentSide::Near { "near" } else { "far" },
                "rectangle": [s.x0, s.y0, s.width, s.height], "depth_pixels": s.depth_pixels.len(),
                "eye_depth_m": [1.0 / s.inverse_depth_max, 1.0 / s.inverse_depth_min],
            })
        };
        let faces: Vec<_> = cube.segments.iter().map(segment).collect();
        let info = &cube.info;
        let frame = info.frame;
        if self.json {
            let in_file = |direction| frame.file_from_world(direction * frame.unit_m);
            print_json(&json!({
                "kind": CUBE_LDI.name, "bytes": bytes, "depth_pixels": cube.depth_pixel_count(), "faces": faces,
                "face_size": cube.face_size_px, "layout": cube.layout, "environment_size": cube.environment.size_px,
                "center": frame.file_from_world(info.centre),
                "half_size": info.half_size_m / frame.unit_m,
                "ahead": info.ahead.map(in_file), "up_vector": info.up.map(in_file),
                "capture": capture_json(info)?, "planes": planes_json(&cube), "ok": true,
            }));
            return Ok(());
        }
        println!("{}: {}, {bytes} bytes", self.file.display(), CUBE_LDI.name);
        println!("  scene       {}", info.scene);
        println!(
            "  centre      {} (in the file's axes and unit)",
            triple(frame.file_from_world(info.centre))
        );
        println!(
            "  half-size   {} (file units)",
            figure(info.half_size_m / frame.unit_m)
        );
        println!(
            "  world       1 file unit = {} m, {} up in the file",
            info.frame.unit_m, info.frame.up
        );
        println!("  faces       6 x {0}x{0} pixels", cube.face_size_px);
        println!(
            "  samples     {} depth pixels from {} rays",
            cube.depth_pixel_count(),
            info.rays_traced
        );
        println!(
            "  light       {}, {}{}",
            describe_bounces(info.parameters.bounces),
            format_count(info.parameters.light_samples, "sample"),
            info.light
                .describe()
                .map_or(String::new(), |words| format!(", {words}"))
        );
        let stops = info.exposure.log2();
        println!(
            "  exposure    {stops:.2} stops ({}); {}",
            info.light.exposure, info.tone
        );
        for (face, missing) in Face::ALL.iter().zip(info.missing_estimate) {
            if let Some(missing) = missing {
                println!(
                    "  {}          next ray new with probability {missing:.4}",
                    face.name()
                );
            }
        }
        if let Some(holes) = info.holes {
            let [share, error] = [holes.share, holes.standard_error].map(|v| v * 100.0);
            println!(
                "  holes       {share:.4} % of frames' pixels, +- {error:.4} % (standard error)"
            );
            println!(
                "              {}, in {}",
                describe_aimed_rays(&holes),
                format_count(holes.rounds, "round")
            );
        }
        for s in &cube.segments {
            let side = if s.side == SegmentSide::Near {
                "near"
            } else {
                "far "
            };
            let (from, to) = (1.0 / s.inverse_depth_max, 1.0 / s.inverse_depth_min);
            let count = s.depth_pixels.len();
            let (name, w, h, x, y) = (s.face.name(), s.width, s.height, s.x0, s.y0);
            println!(
                "  {name} {side}     {count} depth pixels, {w}x{h} at {x},{y}, depth {from:.3} to {to:.3} m"
            );
        }
        let set = &cube.planes;
        if !set.tiles.is_empty() {
            let (planes, tiles, texels) = (set.planes.len(), set.tiles.len(), set.texels.len());
            println!(
                "  planes      {planes} planes, {tiles} pictures of {texels} texels, for {} samples",
                set.samples
            );
            println!(
                "              within {} frame pixels, {} bytes in memory",
                set.error_px,
                set.bytes()
            );
            if cube.segments.len() <= Face::ALL.len() {
                println!(
                    "              faces are not split near and far, which gains nothing beside planes"
                );
            }
        }
        if self.check {
            println!("ok: every promise of the layout holds");
        }
        Ok(())
    }

    fn sprites(&self) -> anyhow::Result<()> {
        // As for cubes, reading checks everything that a renderer relies on.
        let set = SpriteSet::read(&self.file)?;
        let bytes = std::fs::metadata(&self.file)?.len();
        let sprites: Vec<_> = set
            .sprites()
            .iter()
            .map(|prepared| prepared.sprite())
            .collect();
        if self.json {
            let described: Vec<_> = sprites
                .iter()
                .map(|sprite| sprite_json(sprite, &set))
                .collect();
            print_json(&json!({
                "kind": SPRITE_FILE.name, "bytes": bytes, "depth_pixels": null, "faces": [], "sprites": described,
                "environment_size": set.environment.size_px, "capture": set.info, "ok": true,
            }));
            return Ok(());
        }
        let info = &set.info;
        let count = format_count(sprites.len() as u64, "sprite");
        println!("{}: {count} with depth, {bytes} bytes", self.file.display());
        println!("  source      {}", info.source);
        println!(
            "  world       1 file unit = {} m, {} up in the file",
            info.frame.unit_m, info.frame.up
        );
        if let Some(first) = sprites.first().map(|sprite| sprite.sprite().camera()) {
            let in_file = |point: glam::DVec3| triple(info.frame.file_from_world(point));
            println!(
                "  camera      at {} toward {} (in the file's axes and unit)",
                in_file(first.eye()),
                in_file(first.eye() + first.forward())
            );
        }
        for (number, sprite) in sprites.iter().enumerate() {
            let camera = sprite.sprite().camera();
            let (columns, rows) = sprite.displacement().size();
            println!(
                "  {number}           {}x{} pixels, {columns}x{rows} displacements of format {:?}, plane {:.3} m from the eye, depth {}",
                camera.width(),
                camera.height(),
                sprite.displacement().format(),
                sprite.sprite().plane().signed_distance(camera.eye()),
                depth_range(sprite).map_or("unknown".into(), |[near, far]| format!(
                    "{near:.3} to {far:.3} m"
                ))
            );
        }
        if self.check {
            println!("ok: every promise of the layout holds");
        }
        Ok(())
    }

    fn shard(&self) -> anyhow::Result<()> {
        let info = shard::read_info(&self.file)?;
        let bytes = std::fs::metadata(&self.file)?.len();
        let samples = if self.check {
            Some(shard::check(&self.file, &info)?)
        } else {
            None
        };
        if self.json {
            print_json(&json!({
                "kind": SHARD.name, "bytes": bytes, "rays": info.rays, "part": info.part, "parts": info.parts,
                "depth_pixels": samples, "faces": [], "job": info.spec, "ok": true,
            }));
        } else {
            let (scene, rays, part) = (
                &info.spec.scene.name,
                info.rays,
                shard::part_label(info.part, info.parts),
            );
            println!(
                "{}: {} {part} of {scene}, {rays} rays, {bytes} bytes",
                self.file.display(),
                SHARD.name
            );
            if let Some(samples) = samples {
                println!("ok: {samples} accumulators");
            }
        }
        Ok(())
    }
}

/// Describes the plane textures; `None` if there are none.
fn planes_json(cube: &CubeLdi) -> Option<Value> {
    let set = &cube.planes;
    (!set.tiles.is_empty()).then(|| {
        json!({
            "error_px": set.error_px, "planes": set.planes.len(), "pictures": set.tiles.len(),
            "texels": set.texels.len(), "samples": set.samples, "bytes": set.bytes(),
        })
    })
}

/// Describes a sprite; eye, look_at and fov are the arguments with which its camera is imported.
pub(super) fn sprite_json(sprite: &SpriteWithDepth, set: &SpriteSet) -> Value {
    let (camera, plane) = (sprite.sprite().camera(), sprite.sprite().plane());
    let (columns, rows) = sprite.displacement().size();
    let in_file = |point: glam::DVec3| set.info.frame.file_from_world(point);
    json!({
        "size": [camera.width(), camera.height()], "displacement_size": [columns, rows],
        "displacement_format": sprite.displacement().format(),
        "eye": in_file(camera.eye()), "look_at": in_file(camera.eye() + camera.forward()),
        "up_vector": in_file(camera.world_from_eye().y_axis * set.info.frame.unit_m),
        "fov": camera.fov_y_deg(),
        "plane_normal": plane.normal, "plane_offset_m": plane.offset, "eye_depth_m": depth_range(sprite),
    })
}

/// Nearest and farthest eye depth of a sprite's visible pixels, metres.
fn depth_range(sprite: &SpriteWithDepth) -> Option<[f64; 2]> {
    let (columns, rows) = sprite.displacement().size();
    let color = sprite.sprite().color();
    let visible = |x: u32, y: u32| {
        let at = |i: u32, count: u32, pixels: u32| {
            ((2 * u64::from(i) + 1) * u64::from(pixels) / (2 * u64::from(count))) as u32
        };
        color
            .get_pixel(at(x, columns, color.width()), at(y, rows, color.height()))
            .0[3]
            > 0
    };
    let cells = (0..rows).flat_map(|y| (0..columns).map(move |x| (x, y)));
    let depths = cells
        .filter(|&(x, y)| visible(x, y))
        .filter_map(|(x, y)| sprite.eye_depth(x, y));
    depths.fold(None, |range, depth| {
        let [near, far] = range.unwrap_or([depth, depth]);
        Some([depth.min(near), depth.max(far)])
    })
}

/// Returns the fields of a capture's header but its positions and directions, which are in world
/// axes there.
fn capture_json(info: &CaptureInfo) -> serde_json::Result<Value> {
    let mut fields = serde_json::to_value(info)?;
    if let Some(fields) = fields.as_object_mut() {
        for field in ["centre", "half_size_m", "ahead", "up"] {
            fields.remove(field);
        }
    }
    Ok(fields)
}

/// Describes the bounces of a capture's light.
fn describe_bounces(bounces: Bounces) -> String {
    match bounces {
        Bounces::Full => "all bounces".into(),
        Bounces::Exactly(number) => format_count(number, "bounce"),
    }
}
