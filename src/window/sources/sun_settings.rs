//! Sun and sky of a live capture as settings of the window.

use headbox_core::color::luminance;
use headbox_core::light_parameters::{LightParameters, SunPosition};
use headbox_core::view::{SettingError, SettingValues};
use headbox_scene::scene::{Scene, Sun};
use headbox_viewer::Setting;

/// Ids of the settings.
const SUN: &str = "sun";
const AZIMUTH: &str = "sun-azimuth";
const ELEVATION: &str = "sun-elevation";
const STRENGTH: &str = "sun-strength";
const SKY_TURN: &str = "sky-turn";
const SKY_STRENGTH: &str = "sky-strength";

/// Heading of the settings.
const GROUP: &str = "Sun and sky";

/// Settings of a scene's sun and sky. Their initial values are the light in which the scene was
/// opened.
pub(super) struct SunSettings {
    opened: LightParameters,
    /// Luminance of the sun's irradiance, of the default sun if the scene has none.
    strength: f32,
    has_sky: bool,
    settings: Vec<Setting>,
    initial: SettingValues,
}

impl SunSettings {
    /// Creates the settings of a scene that was opened in the light `opened`.
    pub(super) fn new(scene: &Scene, opened: &LightParameters) -> Self {
        let sun = scene.sun.unwrap_or_default();
        let settings = controls(scene, &sun, opened);
        Self {
            opened: opened.clone(),
            strength: luminance(sun.irradiance),
            has_sky: scene.sky.is_some(),
            initial: SettingValues::initial(&settings),
            settings,
        }
    }

    /// The controls.
    pub(super) fn settings(&self) -> impl Iterator<Item = Setting> + '_ {
        self.settings.iter().cloned()
    }

    /// The light that the controls specify; what has its initial value is as it was opened.
    ///
    /// # Errors
    /// If `values` are not those of these settings.
    pub(super) fn light(&self, values: &SettingValues) -> Result<LightParameters, SettingError> {
        let mut light = self.opened.clone();
        let sun = |values: &SettingValues| -> Result<_, SettingError> {
            Ok((
                values.toggle(SUN)?,
                values.number(AZIMUTH)?,
                values.number(ELEVATION)?,
            ))
        };
        let opened = sun(&self.initial)?;
        let (shines, azimuth, elevation) = sun(values)?;
        if shines && opened != (shines, azimuth, elevation) {
            light.sun = Some(SunPosition::Angles { azimuth, elevation });
        } else if !shines && opened.0 {
            light.sun = Some(SunPosition::Off);
        }
        let stops = values.number(STRENGTH)?;
        if shines && stops != 0.0 {
            light.sun_strength = Some(self.strength * stops.exp2() as f32);
        }
        if light.sky.is_some() {
            light.sky_turn = values.number(SKY_TURN)?;
        }
        if self.has_sky {
            light.sky_strength *= values.number(SKY_STRENGTH)?.exp2() as f32;
        }
        Ok(light)
    }

    /// The light that turns the scene as it was opened into one in `light`: its own sky has the
    /// strength of the opened light already, while an image is read again.
    pub(super) fn change_to(&self, light: &LightParameters) -> LightParameters {
        let mut change = light.clone();
        if light.sky.is_none() && self.opened.sky_strength > 0.0 {
            change.sky_strength /= self.opened.sky_strength;
        }
        change
    }
}

fn controls(scene: &Scene, sun: &Sun, opened: &LightParameters) -> Vec<Setting> {
    let [x, y, z] = sun.direction.to_array().map(f64::from);
    let azimuth = x.atan2(-z).to_degrees();
    let elevation = y.clamp(-1.0, 1.0).asin().to_degrees();
    let again = "The headbox that is shown is captured again when this has changed.";
    let turn = |id, label: &str, tip: &str, value, most: f64| {
        let tip = format!("{tip} {again}");
        Setting::number(id, label, &tip, value, -most..=most, "\u{b0}")
    };
    let strength = |id, label: &str, tip: &str| {
        let tip = format!("{tip} {again}");
        Setting::number(id, label, &tip, 0.0, -6.0..=6.0, "stops")
    };
    let mut controls = vec![
        Setting::toggle(
            SUN,
            "Sun",
            &format!("Whether the sun shines. {again}"),
            scene.sun.is_some(),
        ),
        turn(
            AZIMUTH,
            "Azimuth",
            "Direction of the sun, from north (-Z; +Y where Z is up) to east: the first number of --sun.",
            azimuth,
            360.0,
        ),
        turn(
            ELEVATION,
            "Elevation",
            "Height of the sun above the horizon: the second number of --sun.",
            elevation,
            90.0,
        ),
        strength(
            STRENGTH,
            "Strength",
            "Strength of the sun relative to that of the file or of --sun-strength.",
        ),
    ];
    if scene.sky.is_some() {
        controls.push(strength(
            SKY_STRENGTH,
            "Sky strength",
            "Strength of the sky, and of the sun in its image, relative to that of the file or of --sky-strength.",
        ));
    }
    if opened.sky.is_some() {
        let tip = "Rotation of the sky image, from north to east, as --sky-turn.";
        controls.push(turn(SKY_TURN, "Sky turn", tip, opened.sky_turn, 360.0));
    }
    let folded = |control: Setting| control.folded_under(GROUP);
    controls.into_iter().map(folded).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use headbox_core::file_frame::FileFrame;
    use headbox_scene::scene::Sky;

    fn light(settings: &SunSettings, texts: &[(&str, &str)]) -> LightParameters {
        let known: Vec<Setting> = settings.settings().collect();
        let mut values = SettingValues::initial(&known);
        for (id, text) in texts {
            values.set_text(&known, id, text).unwrap();
        }
        settings.light(&values).unwrap()
    }

    #[test]
    fn unchanged_settings_keep_the_light_as_opened() {
        for sun in [None, Some(Sun::default())] {
            let scene = Scene {
                sun,
                ..Scene::default()
            };
            let opened = LightParameters {
                sun_strength: sun.map(|_| 5.0),
                ..LightParameters::default()
            };
            let settings = SunSettings::new(&scene, &opened);
            assert_eq!(light(&settings, &[]), opened);
        }
    }

    #[test]
    fn changed_settings_are_the_flags_of_a_capture() {
        let scene = Scene {
            sun: Some(Sun::default()),
            ..Scene::default()
        };
        let settings = SunSettings::new(&scene, &LightParameters::default());
        let strength = luminance(Sun::default().irradiance);
        let dimmed = light(&settings, &[("sun-strength", "-1")]);
        assert_eq!(
            (dimmed.sun, dimmed.sun_strength),
            (None, Some(strength / 2.0))
        );
        let moved = light(&settings, &[("sun-elevation", "10")]).sun.unwrap();
        let toward = moved.direction(&FileFrame::default()).unwrap();
        let default = Sun::default().direction;
        assert!(
            (toward.y.asin().to_degrees() - 10.0).abs() < 1e-3,
            "{toward}"
        );
        let level = |direction: glam::Vec3| direction.with_y(0.0).normalize();
        assert!(level(toward).distance(level(default)) < 1e-5, "{toward}");
        assert_eq!(
            light(&settings, &[("sun", "off")]).sun,
            Some(SunPosition::Off)
        );
    }

    #[test]
    fn without_a_sun_its_place_and_strength_change_nothing() {
        let settings = SunSettings::new(&Scene::default(), &LightParameters::default());
        let moved = [("sun-azimuth", "40"), ("sun-strength", "2")];
        assert_eq!(light(&settings, &moved), LightParameters::default());
        let added = light(&settings, &[("sun", "on")]);
        assert!(added.sun.is_some() && added.sun_strength.is_none());
    }

    #[test]
    fn sky_is_scaled_in_stops_of_its_factor() {
        let scene = Scene {
            sky: Some(Sky::default()),
            ..Scene::default()
        };
        let opened = LightParameters {
            sky_strength: 3.0,
            ..LightParameters::default()
        };
        let settings = SunSettings::new(&scene, &opened);
        assert_eq!(light(&settings, &[]), opened);
        assert_eq!(
            light(&settings, &[("sky-strength", "-1")]).sky_strength,
            1.5
        );
        let half = light(&settings, &[("sky-strength", "-1")]);
        assert_eq!(settings.change_to(&half).sky_strength, 0.5);
        let with_image = LightParameters {
            sky: Some("sky.hdr".into()),
            ..half
        };
        assert_eq!(settings.change_to(&with_image), with_image);
        let closed = SunSettings::new(&Scene::default(), &opened);
        assert!(
            closed
                .settings()
                .all(|setting| setting.id != "sky-strength")
        );
    }

    #[test]
    fn sky_images_are_turned() {
        let opened = LightParameters {
            sky: Some("sky.hdr".into()),
            sky_turn: 20.0,
            ..LightParameters::default()
        };
        let settings = SunSettings::new(&Scene::default(), &opened);
        assert_eq!(light(&settings, &[]), opened);
        let turned = light(&settings, &[("sky-turn", "90")]);
        assert_eq!((turned.sky_turn, turned.sun), (90.0, None));
    }
}
