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
        if light.sky_strength != 1.0 {
            self.scale_sky(light);
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

    /// Multiplies the radiance of the sky, and of the sun in its image, by the specified strength.
    fn scale_sky(&mut self, light: &LightParameters) {
        let factor = light.sky_strength;
        match &self.sky {
            Some(sky) => self.sky = Some(sky.times(factor)),
            None => self.summary.notes.push(ReadNote::from(String::from(
                "the scene has no sky whose strength could be changed",
            ))),
        }
        if let (Some(_), Some(sun)) = (&light.sky, &mut self.sun) {
            sun.irradiance = sun.irradiance.map(|c| c * factor);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::{DVec3, Vec3};
    use headbox_core::light_parameters::SunPosition;

    #[test]
    fn strength_scales_the_sky_but_not_the_scenes_own_sun() {
        let scene = || Scene {
            sky: Some(Sky::default()),
            sun: Some(Sun::default()),
            ..Scene::default()
        };
        let dimmed = LightParameters {
            sky_strength: 0.25,
            ..Default::default()
        };
        let mut lit = scene();
        lit.set_light(&dimmed).expect("no file to read");
        let up = |scene: &Scene| scene.sky.as_ref().expect("a sky").radiance(Vec3::Y);
        assert_eq!(up(&lit), up(&scene()).map(|c| c / 4.0));
        assert_eq!(lit.sun, scene().sun);
        assert!(lit.summary.notes.is_empty());

        let mut closed = Scene::default();
        closed.set_light(&dimmed).expect("no file to read");
        assert_eq!(closed.summary.notes.len(), 1, "says that there is no sky");
    }

    #[test]
    fn strength_scales_the_sun_of_a_sky_image() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("sky.hdr");
        let mut file = b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 64 +X 128\n".to_vec();
        for i in 0..64 * 128 {
            // 0.5, and 4096 in one texel.
            let exponent = if i == 20 * 128 + 70 { 141 } else { 128 };
            file.extend([128, 128, 128, exponent]);
        }
        std::fs::write(&path, file).expect("written");
        let sun = |sky_strength: f32| {
            let mut scene = Scene::default();
            let light = LightParameters {
                sky: Some(path.clone()),
                sky_strength,
                ..Default::default()
            };
            scene.set_light(&light).expect("a sky");
            scene.sun.expect("the bright texel")
        };
        let ratio = sun(2.0).irradiance[0] / sun(1.0).irradiance[0];
        assert!((ratio - 2.0).abs() < 1e-5, "{ratio}");
    }

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
