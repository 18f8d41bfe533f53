//! Light: sky, sun, exposure and tone.

use super::values::{Names, by_name};
use clap::Args;
use headbox_core::color::exposure::Exposure;
use headbox_core::color::tone::ToneMap;
use headbox_core::light_parameters::{LightParameters, SunPosition};
use std::path::PathBuf;

/// Light that replaces a scene's own.
#[derive(Args, Clone)]
pub(crate) struct LightArgs {
    /// Equirectangular sky image, .hdr or .exr, that replaces the scene's sky and sun; its centre
    /// is north (-Z; +Y if Z is up). A sun in the image becomes a light source
    #[arg(long, value_name = "FILE.hdr|.exr")]
    pub(super) sky: Option<PathBuf>,
    /// Rotation of the sky image about the up axis, degrees from north to east, -360 to 360
    #[arg(long, value_name = "DEG", default_value_t = 0.0, requires = "sky", value_parser = parse_angle,
        allow_hyphen_values = true)]
    pub(super) sky_turn: f64,
    /// Factor on the radiance of the sky, also of a sun in its image, 0 to 1e9
    #[arg(long, value_name = "FACTOR", default_value_t = 1.0, value_parser = parse_sky_strength)]
    pub(super) sky_strength: f32,
    /// Sun position: the direction toward it, X,Y,Z in the file's axes; or azimuth,elevation in
    /// degrees, from north to east and up from the horizon; or off
    #[arg(long, value_name = "X,Y,Z|AZ,EL|off", allow_hyphen_values = true)]
    pub(super) sun: Option<SunPosition>,
    /// Luminance of the sun's irradiance on surfaces that face it, in the unit of the sky's
    /// radiance, up to 1e9; 3 for the default sun
    #[arg(long, value_name = "E", value_parser = parse_strength)]
    pub(super) sun_strength: Option<f32>,
    /// Exposure: auto (metered), auto with additional stops such as auto+1, or a number of stops by
    /// which linear radiance is scaled up before it is stored
    #[arg(long, value_name = "auto|EV", default_value_t = Exposure::default(), allow_hyphen_values = true)]
    pub(super) exposure: Exposure,
    /// Tone curve: neutral compresses highlights (unlit scenes have none: linear), linear clips
    /// them at white, hdr keeps four stops above white for a later --exposure
    #[arg(long, value_name = "CURVE", default_value = "neutral", value_parser = by_name(TONES))]
    pub(super) tone: ToneMap,
}

/// Tone curves.
const TONES: Names<ToneMap> = &[
    (ToneMap::Neutral.name(), "", ToneMap::Neutral),
    (ToneMap::SrgbClipped.name(), "", ToneMap::SrgbClipped),
    (ToneMap::SrgbCompressed.name(), "", ToneMap::SrgbCompressed),
];

impl LightArgs {
    /// The parameters that these arguments specify.
    pub(crate) fn parameters(&self) -> LightParameters {
        LightParameters {
            sky: self.sky.clone(),
            sky_turn: self.sky_turn,
            sky_strength: self.sky_strength,
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

fn parse_sky_strength(text: &str) -> Result<f32, String> {
    let factor = text
        .parse()
        .ok()
        .filter(|factor| (0.0..=1e9).contains(factor));
    factor.ok_or("give a factor from 0 to 1e9".into())
}

fn parse_strength(text: &str) -> Result<f32, String> {
    let strength = text
        .parse()
        .ok()
        .filter(|strength: &f32| *strength > 0.0 && *strength <= 1e9);
    strength.ok_or("give a strength above 0 and up to 1e9; --sun off for none".into())
}
