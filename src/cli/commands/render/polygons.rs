//! Polygon models on the command line, composed with images:
//! `NAME@at=X,Y,Z@turn=DEG@scale=S@up=z@unit=cm`.

use crate::args::{StrictArgs, parse_length, parse_unit, parse_up, parse_vector, split_settings};
use crate::messages::UsageError;
use crate::progress::Bar;
use anyhow::Context;
use glam::DVec3;
use headbox_core::file_frame::{FileFrame, UpAxis};
use headbox_core::files;
use headbox_core::inputs::SCENES;
use headbox_cube::pack::CubeLdi;
use headbox_ldi::scene_source::SceneSource;
use headbox_scene::load::LoadOptions;
use headbox_sprite::compose::{Polygons, place};
use std::path::Path;

/// A polygon model and its placement.
#[derive(Debug, Default, PartialEq)]
pub(super) struct PolygonsArg {
    name: String,
    /// Position of the model's origin, in axes and unit of the first file.
    at: DVec3,
    /// Rotation about the up axis, degrees, from north to east.
    turn_deg: f64,
    scale: Option<f64>,
    up: Option<UpAxis>,
    unit: Option<f64>,
}

const KEYS: [&str; 5] = ["at", "turn", "scale", "up", "unit"];

impl PolygonsArg {
    /// Parses a file on the command line; `None` if it is not a model.
    pub(super) fn parse(file: &Path) -> anyhow::Result<Option<Self>> {
        let text = file.to_string_lossy();
        let (name, parts) =
            split_settings(&text, &KEYS).map_err(|cause| UsageError(format!("{text}: {cause}")))?;
        if let Some(unknown) = unknown_setting(name) {
            bail_usage!(
                "{text}: there is no setting {unknown}; there are {}",
                KEYS.join(", ")
            );
        }
        let ending = Path::new(name)
            .extension()
            .map(|ending| ending.to_string_lossy().to_lowercase());
        if !name.starts_with("builtin:")
            && !ending.is_some_and(|ending| SCENES.contains(&ending.as_str()))
        {
            return Ok(None);
        }
        let mut arg = Self {
            name: name.to_owned(),
            ..Self::default()
        };
        for (key, value) in parts {
            arg.set(key, value)
                .map_err(|cause| UsageError(format!("{name}: {key}={value}: {cause}")))?;
        }
        Ok(Some(arg))
    }

    fn set(&mut self, key: &str, value: &str) -> Result<(), String> {
        match key {
            "at" => self.at = parse_vector(value)?,
            "turn" => {
                let turn = value.parse().ok().filter(|turn: &f64| turn.abs() <= 360.0);
                self.turn_deg = turn.ok_or("give degrees, from -360 to 360")?;
            }
            "scale" => self.scale = Some(parse_length(value)?),
            "up" => self.up = Some(parse_up(value)?),
            "unit" => self.unit = Some(parse_unit(value)?),
            _ => return Err(format!("give one of {}", KEYS.join("=, "))),
        }
        Ok(())
    }

    /// Opens the model and places it in the world of a file with axes and unit `frame`, in the
    /// light of `cube` if given.
    pub(super) fn open(
        &self,
        frame: &FileFrame,
        cube: Option<&CubeLdi>,
        strict: StrictArgs,
    ) -> anyhow::Result<Polygons> {
        let source = SceneSource {
            options: LoadOptions {
                up: self.up,
                unit_m: self.unit,
            },
            ..SceneSource::new(&self.name)
        };
        let mut scene = source.open()?;
        scene
            .summary
            .files
            .iter()
            .for_each(|file| files::protect_input(file));
        strict.check(&self.name, &scene.summary.notes)?;
        scene
            .summary
            .notes
            .iter()
            .for_each(|note| eprintln!("note: {}: {note}", self.name));
        place(
            &mut scene,
            self.scale.unwrap_or(1.0),
            self.turn_deg,
            frame.world_from_file(self.at),
        );
        let polygons = match cube {
            None => Polygons::new(scene),
            Some(cube) => {
                let bar = Bar::new();
                let lit = Polygons::lit_by(scene, cube, &bar);
                bar.finish();
                lit
            }
        };
        polygons.with_context(|| self.name.clone())
    }
}

/// Finds an unknown key after a model's name, such as `a.obj@foo=1`, unless a file has that name.
fn unknown_setting(name: &str) -> Option<&str> {
    let (at, key) = SCENES.iter().find_map(|ending| {
        let (before, after) = name.split_once(&format!(".{ending}@"))?;
        Some((before.len(), after.split_once('=')?.0))
    })?;
    (at > 0 && !Path::new(name).exists()).then_some(key)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn model_placement_is_parsed() {
        let of = |text: &str| PolygonsArg::parse(Path::new(text));
        let expected = PolygonsArg {
            name: "a@home/chair.obj".into(),
            at: DVec3::new(1.0, 0.0, -2.5),
            turn_deg: -45.0,
            scale: Some(0.5),
            up: Some(UpAxis::Z),
            unit: Some(0.01),
        };
        assert_eq!(
            of("a@home/chair.obj@at=1,0,-2.5@turn=-45@scale=0.5@up=z@unit=cm").unwrap(),
            Some(expected)
        );
        assert_eq!(of("builtin:bump").unwrap().unwrap().name, "builtin:bump");
        for other in ["room.ldi", "layers.sprite", "folder", "room.obj.ldi"] {
            assert_eq!(of(other).unwrap(), None, "{other}");
        }
        let unknown = of("a.obj@foo=1").unwrap_err().to_string();
        assert_eq!(
            unknown,
            "a.obj@foo=1: there is no setting foo; there are at, turn, scale, up, unit"
        );
        for wrong in [
            "a.obj@at=1,2",
            "a.obj@turn=x",
            "a.glb@scale=0",
            "a.obj@up=z@half=2",
            "a.obj@unit=yd",
            "a.obj@up=z@nonsense",
        ] {
            let error = of(wrong).unwrap_err().to_string();
            assert!(
                error.starts_with("a.") && error.contains(": give "),
                "{error}"
            );
        }
    }
}
