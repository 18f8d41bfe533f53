//! Arguments shared by several subcommands. Positions and lengths are in the scene file's own axes
//! and unit.

use super::messages::UsageError;
use super::output::print_notes;
use crate::commands::capture::place::place_headbox;
use clap::Args;
use clap::builder::{PossibleValue, PossibleValuesParser, TypedValueParser};
use glam::DVec3;
use headbox_core::camera::Camera;
use headbox_core::color::exposure::Exposure;
use headbox_core::color::tone::ToneMap;
use headbox_core::file_frame::{FileFrame, UpAxis};
use headbox_core::light_parameters::{LightParameters, SunPosition};
use headbox_core::read_note::{self, ReadNote, StrictError};
use headbox_core::view::View;
use headbox_ldi::scene_source::SceneSource;
use headbox_scene::load::LoadOptions;
use headbox_scene::scene::Scene;
use headbox_trace::bvh::Tracer;
use headbox_trace::viewpoint;
use std::path::PathBuf;
use std::sync::Arc;

/// Parses three finite numbers, `X,Y,Z`.
pub(super) fn parse_vector(text: &str) -> Result<DVec3, String> {
    let parts: Result<Vec<f64>, _> = text.split(',').map(|part| part.trim().parse()).collect();
    match parts.as_deref() {
        Ok(&[x, y, z]) if [x, y, z].iter().all(|c| c.is_finite()) => Ok(DVec3::new(x, y, z)),
        _ => Err("give three finite numbers separated by commas, such as 0.5,1.6,-2".into()),
    }
}

/// Parses a positive, finite length.
pub(super) fn parse_length(text: &str) -> Result<f64, String> {
    match text.parse() {
        Ok(length) if length > 0.0 && f64::is_finite(length) => Ok(length),
        _ => Err("give a finite number greater than 0".into()),
    }
}

/// Parses an image size, `WIDTHxHEIGHT`.
pub(super) fn parse_size(text: &str) -> Result<(u32, u32), String> {
    let allowed = 1..=Camera::MAX_SIDE_PX;
    match parse_sides(text) {
        Some((w, h)) if allowed.contains(&w) && allowed.contains(&h) => Ok((w, h)),
        _ => Err(format!(
            "give WIDTHxHEIGHT in pixels, each from 1 to {}, such as 1024x768",
            Camera::MAX_SIDE_PX
        )),
    }
}

/// Parses two integers, `AxB`.
pub(super) fn parse_sides(text: &str) -> Option<(u32, u32)> {
    let (a, b) = text.split_once(['x', 'X'])?;
    Some((a.parse().ok()?, b.parse().ok()?))
}

/// Parses an up axis.
pub(super) fn parse_up(text: &str) -> Result<UpAxis, String> {
    match text {
        "y" => Ok(UpAxis::Y),
        "z" => Ok(UpAxis::Z),
        _ => Err("give y or z".into()),
    }
}

/// Key and value.
pub(super) type Pair<'t> = (&'t str, &'t str);

/// Splits `NAME@KEY=VALUE@KEY=VALUE` into the name, which may contain an `@` that no key follows,
/// and the pairs of keys and values.
pub(super) fn split_settings<'t>(
    text: &'t str,
    keys: &[&str],
) -> Result<(&'t str, Vec<Pair<'t>>), String> {
    let first = keys
        .iter()
        .filter_map(|key| text.find(&format!("@{key}=")))
        .min();
    let (name, rest) = text.split_at(first.unwrap_or(text.len()));
    let pair = |part: &'t str| {
        part.split_once('=')
            .ok_or_else(|| format!("{part}: give one of {}=", keys.join("=, ")))
    };
    let pairs: Result<_, _> = rest.split('@').skip(1).map(pair).collect();
    Ok((name, pairs?))
}

/// Parses the name of a unit of length; returns metres.
pub(super) fn parse_unit(text: &str) -> Result<f64, String> {
    let unit = UNITS
        .iter()
        .find(|(name, ..)| *name == text)
        .map(|(.., metres)| *metres);
    unit.ok_or_else(|| {
        let names: Vec<_> = UNITS.iter().map(|(name, ..)| *name).collect();
        format!("give one of {}", names.join(", "))
    })
}

/// Table of named values: name, help text, value.
pub(super) type Names<T> = &'static [(&'static str, &'static str, T)];

/// Creates a parser of the names in a table.
pub(super) fn by_name<T: Copy + Send + Sync + 'static>(
    names: Names<T>,
) -> impl TypedValueParser<Value = T> {
    let possible = names.iter().map(|(name, help, _)| {
        if help.is_empty() {
            PossibleValue::new(name)
        } else {
            PossibleValue::new(name).help(help)
        }
    });
    let find = |name: String| {
        names
            .iter()
            .find(|(known, ..)| *known == name)
            .map(|(.., value)| *value)
    };
    PossibleValuesParser::new(possible).try_map(move |name| find(name).ok_or("not one of them"))
}

/// Refuses the first given flag as meaningless for a kind of input.
pub(super) fn refuse_given(
    kind: &str,
    flags: impl IntoIterator<Item = (&'static str, bool)>,
) -> Result<(), UsageError> {
    match flags.into_iter().find(|(_, is_given)| *is_given) {
        Some((flag, _)) => Err(UsageError(format!(
            "{flag} has no meaning for {kind}; leave it out"
        ))),
        None => Ok(()),
    }
}

/// Refuses the first given flag as one for another kind of input.
pub(super) fn refuse_misplaced(
    kind: &str,
    flags: impl IntoIterator<Item = (&'static str, bool)>,
) -> Result<(), UsageError> {
    match flags.into_iter().find(|(_, is_given)| *is_given) {
        Some((flag, _)) => Err(UsageError(format!("{flag} is for {kind}; leave it out"))),
        None => Ok(()),
    }
}

/// Units of a file's lengths, metres.
pub(super) const UNITS: Names<f64> = &[
    ("m", "", 1.0),
    ("dm", "", 0.1),
    ("cm", "", 0.01),
    ("mm", "", 0.001),
    ("in", "", 0.0254),
    ("ft", "", 0.3048),
];

/// Light that replaces a scene's own.
#[derive(Args, Clone)]
pub(super) struct LightArgs {
    /// Equirectangular sky image, .hdr or .exr, that replaces the scene's sky and sun; its centre
    /// is north (-Z; +Y if Z is up). A sun in the image becomes a light source
    #[arg(long, value_name = "FILE.hdr|.exr")]
    sky: Option<PathBuf>,
    /// Rotation of the sky image about the up axis, degrees from north to east, -360 to 360
    #[arg(long, value_name = "DEG", default_value_t = 0.0, requires = "sky", value_parser = parse_angle,
        allow_hyphen_values = true)]
    sky_turn: f64,
    /// Sun position: the direction toward it, X,Y,Z in the file's axes; or azimuth,elevation in
    /// degrees, from north to east and up from the horizon; or off
    #[arg(long, value_name = "X,Y,Z|AZ,EL|off", allow_hyphen_values = true)]
    sun: Option<SunPosition>,
    /// Luminance of the sun's irradiance on surfaces that face it, in the unit of the sky's
    /// radiance, up to 1e9; 3 for the default sun
    #[arg(long, value_name = "E", value_parser = parse_strength)]
    sun_strength: Option<f32>,
    /// Exposure: auto (metered), auto with additional stops such as auto+1, or a number of stops by
    /// which linear radiance is scaled up before it is stored
    #[arg(long, value_name = "auto|EV", default_value_t = Exposure::default(), allow_hyphen_values = true)]
    exposure: Exposure,
    /// Tone curve: neutral compresses highlights (unlit scenes have none: linear), linear clips
    /// them at white, hdr keeps four stops above white for a later --exposure
    #[arg(long, value_name = "CURVE", default_value = "neutral", value_parser = by_name(TONES))]
    tone: ToneMap,
}

/// Tone curves.
const TONES: Names<ToneMap> = &[
    (ToneMap::Neutral.name(), "", ToneMap::Neutral),
    (ToneMap::SrgbClipped.name(), "", ToneMap::SrgbClipped),
    (ToneMap::SrgbCompressed.name(), "", ToneMap::SrgbCompressed),
];

impl LightArgs {
    /// The parameters that these arguments specify.
    pub(super) fn parameters(&self) -> LightParameters {
        LightParameters {
            sky: self.sky.clone(),
            sky_turn: self.sky_turn,
            sun: self.sun,
            sun_strength: self.sun_strength,
            exposure: self.exposure,
            tone: self.tone,
        }
    }
}

fn parse_angle(text: &str) -> Result<f64, String> {
    let angle = text.parse().ok().filter(|angle: &f64| angle.abs() <= 360.0);
    angle.ok_or("give degrees from -360 to 360".into())
}

fn parse_strength(text: &str) -> Result<f32, String> {
    let strength = text
        .parse()
        .ok()
        .filter(|strength: &f32| *strength > 0.0 && *strength <= 1e9);
    strength.ok_or("give a strength above 0 and up to 1e9; --sun off for none".into())
}

/// Strict reading.
#[derive(Args, Clone, Copy, Default)]
pub(super) struct StrictArgs {
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
    pub(super) fn report(self, input: &str, notes: &[ReadNote]) -> Result<(), StrictError> {
        self.check(input, notes)?;
        print_notes(notes);
        Ok(())
    }

    /// Same as [`Self::report`], without printing.
    pub(super) fn check(self, input: &str, notes: &[ReadNote]) -> Result<(), StrictError> {
        if self.strict {
            read_note::refuse(input, notes)?;
        }
        Ok(())
    }

    /// Returns true if reading is strict.
    #[cfg(feature = "viewer")]
    pub(super) fn is_strict(self) -> bool {
        self.strict
    }
}

/// A scene.
#[derive(Args)]
pub(super) struct SceneArgs {
    /// Scene: an .obj, .gltf, .glb, .ply or .stl file, a home (Home.xml, .sh3d, .toml), or
    /// builtin:NAME
    scene: String,
    #[command(flatten)]
    pub(super) source: SourceArgs,
}

/// Options for reading a scene: axes and unit that override its file's, and light that replaces its
/// own.
#[derive(Args)]
pub(super) struct SourceArgs {
    /// Up axis of the file, y or z; Y for glTF and inferred for OBJ by default
    #[arg(long, value_parser = parse_up)]
    up: Option<UpAxis>,
    /// Unit of lengths in the file; metres for glTF and inferred for OBJ by default
    #[arg(long, value_parser = by_name(UNITS))]
    unit: Option<f64>,
    #[command(flatten)]
    pub(super) light: LightArgs,
}

impl SceneArgs {
    /// Name of the scene on the command line.
    pub(super) fn name(&self) -> &str {
        &self.scene
    }

    pub(super) fn source(&self) -> SceneSource {
        self.source.source(&self.scene)
    }
}

impl SourceArgs {
    /// Axes and unit, by default Y up and metres.
    pub(super) fn file_frame(&self) -> FileFrame {
        FileFrame {
            up: self.up.unwrap_or_default(),
            unit_m: self.unit.unwrap_or(1.0),
        }
    }

    /// Returns a copy with other axes and another unit, if given.
    pub(super) fn with(&self, up: Option<UpAxis>, unit: Option<f64>) -> Self {
        Self {
            up: up.or(self.up),
            unit: unit.or(self.unit),
            light: self.light.clone(),
        }
    }

    /// Flags of the source, each with true if it differs from the default.
    pub(super) fn given_flags(&self) -> [(&'static str, bool); 8] {
        let LightArgs {
            sky,
            sky_turn,
            sun,
            sun_strength,
            exposure,
            tone,
        } = &self.light;
        let default = LightParameters::default();
        [
            ("--up", self.up.is_some()),
            ("--unit", self.unit.is_some()),
            ("--sky", sky.is_some()),
            ("--sky-turn", *sky_turn != default.sky_turn),
            ("--sun", sun.is_some()),
            ("--sun-strength", sun_strength.is_some()),
            ("--exposure", *exposure != default.exposure),
            ("--tone", *tone != default.tone),
        ]
    }

    /// Source of a scene with these options.
    pub(super) fn source(&self, scene: &str) -> SceneSource {
        let options = LoadOptions {
            up: self.up,
            unit_m: self.unit,
        };
        SceneSource {
            name: scene.to_owned(),
            options,
            light: self.light.parameters(),
        }
    }
}

/// A camera.
#[derive(Args)]
pub(super) struct CameraArgs {
    /// Position of the eye, in the file's axes and unit; the centre of the headbox, or the capture
    /// position of sprites, by default
    #[arg(long, value_name = "X,Y,Z", value_parser = parse_vector, allow_hyphen_values = true)]
    eye: Option<DVec3>,
    /// Point to look at, in the file's axes and unit; in the direction with the most detail from
    /// the headbox (for scenes from the eye), or the capture direction of sprites, by default
    #[arg(long, value_name = "X,Y,Z", value_parser = parse_vector, allow_hyphen_values = true)]
    look_at: Option<DVec3>,
    /// Up direction of the frame, in the file's axes; the file's up axis, or the up direction of
    /// the input images, by default
    #[arg(long, value_name = "X,Y,Z", value_parser = parse_vector, allow_hyphen_values = true)]
    up_vector: Option<DVec3>,
    /// Vertical field of view, degrees; 60, or that of the input's own camera, by default
    #[arg(long, value_name = "DEG")]
    fov: Option<f64>,
    /// Size of the frame, pixels; 1024x768, or that of the input's own camera, by default
    #[arg(long, value_name = "WxH", value_parser = parse_size)]
    pub(super) size: Option<(u32, u32)>,
}

/// Default camera; world metres.
pub(super) struct DefaultCamera {
    pub(super) eye: DVec3,
    /// Viewing direction, any length.
    pub(super) forward: DVec3,
    /// Up direction in the image.
    pub(super) up: DVec3,
    pub(super) fov_y_deg: f64,
    pub(super) size: (u32, u32),
}

impl DefaultCamera {
    /// Camera at an eye in a scene, toward the direction with the most to see.
    pub(super) fn from_scene(tracer: &Tracer, eye: DVec3) -> Self {
        Self {
            forward: viewpoint::suggest_view(tracer, eye),
            ..Self::from_eye(eye)
        }
    }

    /// Camera at an eye, along -Z.
    pub(super) fn from_eye(eye: DVec3) -> Self {
        Self {
            eye,
            forward: DVec3::NEG_Z,
            up: DVec3::Y,
            fov_y_deg: 60.0,
            size: (1024, 768),
        }
    }

    /// Start camera of a view, for frames of `size` if given.
    pub(super) fn from_view(view: &dyn View, size: Option<(u32, u32)>) -> Self {
        let size = size.unwrap_or_else(|| view.default_size_px().into());
        let start = view.start(size.into());
        Self {
            eye: start.eye,
            forward: start.forward,
            up: start.up,
            fov_y_deg: start.fov_y_deg,
            size,
        }
    }
}

impl CameraArgs {
    /// Flags of the camera, each with true if it is given.
    pub(super) fn given_flags(&self) -> [(&'static str, bool); 5] {
        [
            ("--eye", self.eye.is_some()),
            ("--look-at", self.look_at.is_some()),
            ("--up-vector", self.up_vector.is_some()),
            ("--fov", self.fov.is_some()),
            ("--size", self.size.is_some()),
        ]
    }

    /// Resizes the cameras of a path to `--size`; refuses all other flags of the camera.
    pub(super) fn resize_path(&self, cameras: Vec<Camera>) -> anyhow::Result<Vec<Camera>> {
        if let Some((flag, _)) = self
            .given_flags()
            .into_iter()
            .find(|(flag, is_given)| *is_given && *flag != "--size")
        {
            bail_usage!("{flag} has no meaning with --path, which says it; leave it out");
        }
        let Some((width, height)) = self.size else {
            return Ok(cameras);
        };
        let resized = |camera: Camera| {
            let focal_px = camera.focal_px() * f64::from(height) / f64::from(camera.height());
            Camera::from_parts(
                camera.eye(),
                camera.world_from_eye(),
                focal_px,
                width,
                height,
            )
        };
        Ok(cameras.into_iter().map(resized).collect::<Result<_, _>>()?)
    }

    /// Camera in a scene, by default in free space toward the direction with the most to see, and a
    /// tracer about its eye.
    pub(super) fn aim(&self, scene: &Arc<Scene>) -> anyhow::Result<(Camera, Tracer)> {
        let eye = match self.eye {
            Some(eye) => scene.frame.world_from_file(eye),
            None => place_headbox(scene, None, None)?.centre,
        };
        let tracer = Tracer::new(Arc::clone(scene), eye);
        let camera = self.camera(&scene.frame, &DefaultCamera::from_scene(&tracer, eye))?;
        Ok((camera, tracer))
    }

    /// Camera in world space.
    pub(super) fn camera(
        &self,
        frame: &FileFrame,
        default: &DefaultCamera,
    ) -> anyhow::Result<Camera> {
        let eye = self
            .eye
            .map_or(default.eye, |eye| frame.world_from_file(eye));
        let look_at = self
            .look_at
            .map_or(eye + default.forward, |point| frame.world_from_file(point));
        if self.up_vector == Some(DVec3::ZERO) {
            bail_usage!("--up-vector has no direction; give three numbers that are not all 0");
        }
        let up = self
            .up_vector
            .map_or(default.up, |up| frame.world_direction_from_file(up));
        warn_if_parallel(look_at - eye, up, frame);
        let (width, height) = self.size.unwrap_or(default.size);
        let fov_y_deg = self.fov.unwrap_or(default.fov_y_deg);
        let camera = Camera::look_at(eye, look_at, up, fov_y_deg, [width, height]);
        Ok(camera.map_err(|error| UsageError(error.to_string()))?)
    }
}

/// Warns if the up vector is parallel to the viewing direction.
fn warn_if_parallel(forward: DVec3, up: DVec3, frame: &FileFrame) {
    if forward.length() > 0.0 && forward.normalize().cross(up.normalize_or_zero()).length() <= 1e-6
    {
        let stand_in = if forward.normalize().y.abs() < 0.9 {
            DVec3::Y
        } else {
            DVec3::Z
        };
        // Adding 0 turns -0 into 0.
        let [x, y, z] = (frame.file_from_world(stand_in).normalize() + 0.0).to_array();
        eprintln!(
            "warning: the view runs along the up vector, which then does not say what is up in the picture; {x},{y},{z} (in the \
             file's axes) is taken. Give --up-vector X,Y,Z to hold the camera in another way"
        );
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_sane_values_parse() {
        assert_eq!(
            parse_vector("-1, 2.5,3e2"),
            Ok(DVec3::new(-1.0, 2.5, 300.0))
        );
        for bad in ["", "1,2", "1,2,3,4", "nan,0,0", "inf,0,0", "a,b,c"] {
            assert!(parse_vector(bad).is_err(), "{bad}");
        }
        assert!(
            parse_length("0").is_err()
                && parse_length("-1").is_err()
                && parse_length("nan").is_err()
        );
        assert_eq!(parse_size("640x480"), Ok((640, 480)));
        for bad in ["0x4", "640", "x", "99999x9", "-1x5"] {
            assert!(parse_size(bad).is_err(), "{bad}");
        }
    }
}
