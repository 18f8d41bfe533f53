//! Sources: a scene with its axes, unit and light, and notes on what was lost.

use super::light::LightArgs;
use super::values::{UNITS, by_name, parse_up};
use crate::output::print_notes;
use clap::Args;
use headbox_core::file_frame::{FileFrame, UpAxis};
use headbox_core::light_parameters::LightParameters;
use headbox_core::read_note::{self, ReadNote, StrictError};
use headbox_ldi::scene_source::SceneSource;
use headbox_scene::load::LoadOptions;

/// Strict reading.
#[derive(Args, Clone, Copy, Default)]
pub(crate) struct StrictArgs {
    /// Fail before any work if something of the input was lost, limited or guessed while it was
    /// read; the error lists what the notes would
    #[arg(long)]
    strict: bool,
}

impl StrictArgs {
    /// Prints the notes on an input.
    ///
    /// # Errors
    /// If there are notes and reading is strict.
    pub(crate) fn report(self, input: &str, notes: &[ReadNote]) -> Result<(), StrictError> {
        self.check(input, notes)?;
        print_notes(notes);
        Ok(())
    }

    /// Same as [`Self::report`], without printing.
    pub(crate) fn check(self, input: &str, notes: &[ReadNote]) -> Result<(), StrictError> {
        if self.strict {
            read_note::refuse(input, notes)?;
        }
        Ok(())
    }

    /// Returns true if reading is strict.
    #[cfg(feature = "viewer")]
    pub(crate) fn is_strict(self) -> bool {
        self.strict
    }
}

/// A scene.
#[derive(Args)]
pub(crate) struct SceneArgs {
    /// Scene: an .obj, .gltf, .glb, .ply or .stl file, a home (Home.xml, .sh3d, .toml), or
    /// builtin:NAME; capture also takes a folder of images with known cameras, or a deep EXR image
    scene: String,
    #[command(flatten)]
    pub(crate) source: SourceArgs,
}

/// Axes and unit of a scene that override its file's.
#[derive(Args, Clone, Copy, Default)]
pub(crate) struct AxesArgs {
    /// Up axis of the file, y or z; Y for glTF and inferred for OBJ by default
    #[arg(long, value_parser = parse_up)]
    up: Option<UpAxis>,
    /// Unit of lengths in the file; metres for glTF and inferred for OBJ by default
    #[arg(long, value_parser = by_name(UNITS))]
    unit: Option<f64>,
}

impl AxesArgs {
    /// Flags of axes and unit, each with true if it is given.
    pub(crate) fn given_flags(self) -> [(&'static str, bool); 2] {
        [("--up", self.up.is_some()), ("--unit", self.unit.is_some())]
    }

    /// Options for loading a scene.
    pub(crate) fn load_options(self) -> LoadOptions {
        LoadOptions {
            up: self.up,
            unit_m: self.unit,
        }
    }
}

/// Options for reading a scene: axes and unit that override its file's, and light that replaces its
/// own.
#[derive(Args)]
pub(crate) struct SourceArgs {
    #[command(flatten)]
    axes: AxesArgs,
    #[command(flatten)]
    pub(crate) light: LightArgs,
}

impl SceneArgs {
    /// Name of the scene on the command line.
    pub(crate) fn name(&self) -> &str {
        &self.scene
    }

    pub(crate) fn source(&self) -> SceneSource {
        self.source.source(&self.scene)
    }
}

impl SourceArgs {
    /// Axes and unit, by default Y up and metres.
    pub(crate) fn file_frame(&self) -> FileFrame {
        FileFrame {
            up: self.axes.up.unwrap_or_default(),
            unit_m: self.axes.unit.unwrap_or(1.0),
        }
    }

    /// Returns a copy with other axes and another unit, if given.
    pub(crate) fn with(&self, up: Option<UpAxis>, unit: Option<f64>) -> Self {
        Self {
            axes: AxesArgs {
                up: up.or(self.axes.up),
                unit: unit.or(self.axes.unit),
            },
            light: self.light.clone(),
        }
    }

    /// Flags of the source, each with true if it differs from the default.
    pub(crate) fn given_flags(&self) -> [(&'static str, bool); 9] {
        let LightArgs {
            sky,
            sky_turn,
            sky_strength,
            sun,
            sun_strength,
            exposure,
            tone,
        } = &self.light;
        let default = LightParameters::default();
        let [up, unit] = self.axes.given_flags();
        [
            up,
            unit,
            ("--sky", sky.is_some()),
            ("--sky-turn", *sky_turn != default.sky_turn),
            ("--sky-strength", *sky_strength != default.sky_strength),
            ("--sun", sun.is_some()),
            ("--sun-strength", sun_strength.is_some()),
            ("--exposure", *exposure != default.exposure),
            ("--tone", *tone != default.tone),
        ]
    }

    /// Source of a scene with these options.
    pub(crate) fn source(&self, scene: &str) -> SceneSource {
        SceneSource {
            name: scene.to_owned(),
            options: self.axes.load_options(),
            light: self.light.parameters(),
        }
    }
}
