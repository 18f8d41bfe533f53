//! Replaces a scene's own light by the light that the user specified.

use crate::scene::{Scene, Sky, SkyError, SkyPicture, Sun};
use headbox_core::color::luminance;
use headbox_core::light_parameters::LightParameters;
use headbox_core::read_note::ReadNote;
use std::sync::Arc;

impl Scene {
    /// Applies `light` to this scene: sky, sun, exposure and tone curve. Notes on the sky are added
    /// to [`Self::summary`].
    ///
    /// # Errors
    /// If the sky cannot be read.
    pub fn set_light(&mut self, light: &LightParameters) -> Result<(), SkyError> {
        if let Some(path) = &light.sky {
            let (picture, notes) = SkyPicture::read_with_notes(path, light.sky_turn)?;
            self.summary
                .notes
                .extend(notes.into_iter().map(ReadNote::from));
            let (picture, sun) = picture.without_sun();
            self.sky = Some(Sky::Picture(Arc::new(picture)));
            self.sun = sun;
        }
        if let Some(place) = light.sun {
            let toward = place.direction(&self.frame);
            self.sun = toward.map(|direction| Sun {
                direction,
                ..self.sun.unwrap_or_default()
            });
        }
        if let (Some(sun), Some(strength)) = (&mut self.sun, light.sun_strength) {
            let factor = strength / luminance(sun.irradiance).max(f32::MIN_POSITIVE);
            sun.irradiance = sun.irradiance.map(|c| c * factor);
        }
        self.exposure = light.exposure;
        self.tone = light.tone;
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::{DVec3, Vec3};
    use headbox_core::light_parameters::SunPosition;

    #[test]
    fn sun_keeps_colour_takes_strength() {
        let mut scene = Scene {
            sun: Some(Sun::default()),
            ..Scene::default()
        };
        let asked = LightParameters {
            sun: Some(SunPosition::Toward(DVec3::Y)),
            sun_strength: Some(6.0),
            ..Default::default()
        };
        scene.set_light(&asked).expect("no file to read");
        let (sun, default) = (scene.sun.expect("a sun"), Sun::default());
        assert!((luminance(sun.irradiance) - 6.0).abs() < 1e-5 && sun.direction == Vec3::Y);
        assert!(
            (sun.irradiance[0] / sun.irradiance[2] - default.irradiance[0] / default.irradiance[2])
                .abs()
                < 1e-5
        );
        scene
            .set_light(&LightParameters {
                sun: Some(SunPosition::Off),
                ..asked
            })
            .expect("no file to read");
        assert_eq!(scene.sun, None);
    }
}
