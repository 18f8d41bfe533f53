//! What a person says of a scene's light, stated once: sources of scenes, the headers of files and the command line hold this type.

use crate::capture::light::luminance;
use crate::capture::scene::{Exposure, FileFrame, Scene, Sky, SkyError, SkyPicture, Sun, ToneMap};
use glam::{DVec3, Vec3};
use serde::{Deserialize, Serialize};
use std::fmt;
use std::path::PathBuf;
use std::str::FromStr;
use std::sync::Arc;

/// The light of a scene where it is not the scene's own. Nothing is said by default.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "cli", derive(clap::Args))]
#[serde(default)]
pub struct LightParameters {
    /// Sky: an equirectangular .hdr or .exr picture, its middle north (-Z; +Y where Z points up), in place of the scene's sky
    /// and sun. A sun that stands in it lights as one
    #[serde(skip_serializing_if = "Option::is_none")]
    #[cfg_attr(feature = "cli", arg(long, value_name = "FILE.hdr|.exr"))]
    pub sky: Option<PathBuf>,
    /// Turn the picture of the sky about the up axis, degrees from north to east
    #[serde(skip_serializing_if = "is_zero")]
    #[cfg_attr(feature = "cli", arg(long, value_name = "DEG", default_value_t = 0.0, requires = "sky",
        value_parser = parse_angle, allow_hyphen_values = true))]
    pub sky_turn: f64,
    /// Sun: the direction toward it, X,Y,Z in the file's axes; or azimuth,elevation in degrees, from north to east and up from
    /// the horizon; or off
    #[serde(skip_serializing_if = "Option::is_none")]
    #[cfg_attr(feature = "cli", arg(long, value_name = "X,Y,Z|AZ,EL|off", allow_hyphen_values = true))]
    pub sun: Option<SunPlace>,
    /// Luminance of the sun's irradiance on what faces it, in the unit of the sky's radiance; the default sun brings 3
    #[serde(skip_serializing_if = "Option::is_none")]
    #[cfg_attr(feature = "cli", arg(long, value_name = "E", value_parser = parse_strength))]
    pub sun_strength: Option<f32>,
    /// Exposure: auto, stops beyond that such as auto+1, or a number of stops by which linear radiance is stored brighter
    #[serde(skip_serializing_if = "is_auto")]
    #[cfg_attr(feature = "cli", arg(long, value_name = "auto|EV", default_value_t = Exposure::default(),
        allow_hyphen_values = true))]
    pub exposure: Exposure,
    /// Whether light above white is kept ([`ToneMap::SrgbCompressed`]).
    #[serde(skip_serializing_if = "is_not")]
    #[cfg_attr(feature = "cli", arg(skip))]
    pub hdr: bool,
}

fn is_not(flag: &bool) -> bool {
    !flag
}

fn is_zero(number: &f64) -> bool {
    *number == 0.0
}

fn is_auto(exposure: &Exposure) -> bool {
    *exposure == Exposure::default()
}

#[cfg(feature = "cli")]
fn parse_angle(text: &str) -> Result<f64, String> {
    text.parse().ok().filter(|angle: &f64| angle.abs() <= 360.0).ok_or("give degrees from -360 to 360".into())
}

#[cfg(feature = "cli")]
fn parse_strength(text: &str) -> Result<f32, String> {
    let strength = text.parse().ok().filter(|strength: &f32| *strength > 0.0 && *strength <= 1e9);
    strength.ok_or("give a strength above 0 and up to 1e9; --sun off for none".into())
}

/// Where the sun stands, or that there is none. Written as on the command line.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "String", into = "String")]
pub enum SunPlace {
    /// No sun.
    Off,
    /// Toward it, in the axes of the scene's file; of any length but 0.
    Toward(DVec3),
    /// Degrees from north to east, and up from the horizon.
    Angles {
        /// 0 is north: -Z of the world.
        azimuth: f64,
        /// From -90 to 90.
        elevation: f64,
    },
}

impl SunPlace {
    /// Unit vector toward the sun, world axes; `None` if there is none.
    fn direction(self, frame: &FileFrame) -> Option<Vec3> {
        match self {
            Self::Off => None,
            Self::Toward(direction) => Some(frame.world_direction_from_file(direction).normalize().as_vec3()),
            Self::Angles { azimuth, elevation } => {
                let [(east, north), (up, level)] = [azimuth, elevation].map(|angle| angle.to_radians().sin_cos());
                Some(DVec3::new(level * east, up, -level * north).as_vec3())
            }
        }
    }
}

impl FromStr for SunPlace {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let numbers: Result<Vec<f64>, _> = text.split(',').map(|part| part.trim().parse()).collect();
        match numbers.as_deref() {
            _ if text == "off" => Ok(Self::Off),
            Ok(&[x, y, z]) if (1e-9..1e9).contains(&DVec3::new(x, y, z).length()) => {
                Ok(Self::Toward(DVec3::new(x, y, z)))
            }
            Ok(&[azimuth, elevation]) if azimuth.abs() <= 360.0 && elevation.abs() <= 90.0 => {
                Ok(Self::Angles { azimuth, elevation })
            }
            _ => {
                Err("give X,Y,Z toward the sun, azimuth,elevation in degrees (elevation from -90 to 90), or off".into())
            }
        }
    }
}

impl fmt::Display for SunPlace {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Off => f.write_str("off"),
            Self::Toward(DVec3 { x, y, z }) => write!(f, "{x},{y},{z}"),
            Self::Angles { azimuth, elevation } => write!(f, "{azimuth},{elevation}"),
        }
    }
}

impl TryFrom<String> for SunPlace {
    type Error = String;

    fn try_from(text: String) -> Result<Self, String> {
        text.parse()
    }
}

impl From<SunPlace> for String {
    fn from(place: SunPlace) -> Self {
        place.to_string()
    }
}

impl LightParameters {
    /// Puts this light into a scene.
    ///
    /// # Errors
    /// If the sky cannot be read.
    pub fn apply(&self, scene: &mut Scene) -> Result<(), SkyError> {
        if let Some(path) = &self.sky {
            let (picture, sun) = SkyPicture::read(path, self.sky_turn)?.without_sun();
            (scene.sky, scene.sun) = (Some(Sky::Picture(Arc::new(picture))), sun);
        }
        if let Some(place) = self.sun {
            let toward = place.direction(&scene.frame);
            scene.sun = toward.map(|direction| Sun { direction, ..scene.sun.unwrap_or_default() });
        }
        if let (Some(sun), Some(strength)) = (&mut scene.sun, self.sun_strength) {
            let factor = strength / luminance(sun.irradiance).max(f32::MIN_POSITIVE);
            sun.irradiance = sun.irradiance.map(|c| c * factor);
        }
        scene.exposure = self.exposure;
        scene.tone = if self.hdr { ToneMap::SrgbCompressed } else { ToneMap::SrgbClipped };
        Ok(())
    }

    /// What was asked for, in a few words; `None` where nothing was.
    pub fn in_words(&self) -> Option<String> {
        let sky = self.sky.as_ref().map(|path| match self.sky_turn {
            0.0 => format!("sky {}", path.display()),
            turn => format!("sky {}, turned by {turn} degrees", path.display()),
        });
        let sun = self.sun.map(|place| format!("sun {place}"));
        let strength = self.sun_strength.map(|strength| format!("sun's strength {strength}"));
        let words: Vec<String> = [sky, sun, strength].into_iter().flatten().collect();
        (!words.is_empty()).then(|| words.join(", "))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::capture::scene::UpAxis;

    fn direction(text: &str, up: UpAxis) -> Option<Vec3> {
        let place: SunPlace = text.parse().expect("a place");
        assert_eq!(place.to_string().parse(), Ok(place));
        place.direction(&FileFrame { up, unit_m: 0.01 })
    }

    #[test]
    fn the_sun_stands_where_it_is_put() {
        let close = |a: Option<Vec3>, b: Vec3| a.is_some_and(|a| (a - b).length() < 1e-6);
        assert!(close(direction("0,0", UpAxis::Y), Vec3::NEG_Z), "north");
        assert!(close(direction("90,0", UpAxis::Y), Vec3::X), "east");
        assert!(close(direction("-90,0", UpAxis::Z), Vec3::NEG_X), "west, in whatever axes");
        assert!(close(direction("123,90", UpAxis::Y), Vec3::Y), "the zenith");
        let half = std::f32::consts::FRAC_1_SQRT_2;
        assert!(close(direction("180,45", UpAxis::Y), Vec3::new(0.0, half, half)));
        // North of a file whose Z points up is its +Y.
        assert!(close(direction("0,7,0", UpAxis::Z), Vec3::NEG_Z));
        assert!(close(direction("0,0,2", UpAxis::Z), Vec3::Y));
        assert_eq!(direction("off", UpAxis::Y), None);
        for wrong in ["", "0,0,0", "nan,0", "10,91", "361,0", "1", "1,2,3,4", "inf,0,0", "on"] {
            assert!(wrong.parse::<SunPlace>().is_err(), "{wrong}");
        }
    }

    #[test]
    fn files_say_nothing_of_what_was_not_asked_for() {
        assert_eq!(serde_json::to_string(&LightParameters::default()).expect("json"), "{}");
        let asked = LightParameters {
            sky: Some("a.hdr".into()),
            sky_turn: 30.0,
            sun: Some("12,34".parse().expect("a place")),
            sun_strength: Some(2.0),
            exposure: Exposure::Auto(1.0),
            hdr: true,
        };
        let text = serde_json::to_string(&asked).expect("json");
        assert_eq!(serde_json::from_str::<LightParameters>(&text).expect("read"), asked);
        assert_eq!(asked.in_words().as_deref(), Some("sky a.hdr, turned by 30 degrees, sun 12,34, sun's strength 2"));
    }

    #[test]
    fn the_sun_keeps_its_colour_and_takes_its_strength() {
        let mut scene = Scene { sun: Some(Sun::default()), ..Scene::default() };
        let asked =
            LightParameters { sun: Some(SunPlace::Toward(DVec3::Y)), sun_strength: Some(6.0), ..Default::default() };
        asked.apply(&mut scene).expect("no file to read");
        let (sun, default) = (scene.sun.expect("a sun"), Sun::default());
        assert!((luminance(sun.irradiance) - 6.0).abs() < 1e-5 && sun.direction == Vec3::Y);
        assert!((sun.irradiance[0] / sun.irradiance[2] - default.irradiance[0] / default.irradiance[2]).abs() < 1e-5);
        LightParameters { sun: Some(SunPlace::Off), ..asked }.apply(&mut scene).expect("no file to read");
        assert_eq!(scene.sun, None);
    }
}
