//! Page of sprites with depth: the image and the stored displacements of each sprite.
//!
//! The page renders in two passes, as [`headbox_sprite`] does: displacements are forward-warped by
//! pure parallax into an integer field, holes in it are filled, and each pixel of the frame samples
//! the image backward through it.

mod displacements;

use super::texels::{TexelImage, residuals};
use super::{Content, Part, check_size, environment};
use crate::from_sprites::half_size_m;
use crate::{ExportError, POSTER_PX, jpeg};
use glam::DVec3;
use headbox_core::camera::Camera;
use headbox_core::frame::Frame;
use headbox_core::view::level_up;
use headbox_sprite::compose::{ComposeSettings, Composer, Composition};
use headbox_sprite::{PreparedSprite, RenderOptions, SpriteSet, rules, visible_points};
use serde_json::{Value, json};

pub(super) const MODULES: &[&str] = &[
    include_str!("../headbox.js"),
    include_str!("../texels.js"),
    include_str!("field.js"),
    include_str!("layers.js"),
    include_str!("transfer.js"),
    include_str!("shaders.js"),
    include_str!("renderer.js"),
];

/// Builds the content of a page of sprites. The view starts at the camera of the first.
pub(super) fn content(set: &SpriteSet) -> Result<Content, ExportError> {
    let first = set
        .sprites()
        .first()
        .ok_or(ExportError::Empty)?
        .sprite()
        .sprite()
        .camera();
    let pixels = |sprite: &PreparedSprite| sprite.sprite().sprite().color().pixels().len() as u64;
    // Hardly any image deflates to less than two bits per pixel, except where it is transparent.
    check_size(set.sprites().iter().map(pixels).sum::<u64>() / 4)?;
    let centre = first.eye();
    let mut parts = Vec::new();
    if set.environment.size_px > 0 {
        parts.push(environment(&set.environment));
    }
    parts.extend(set.sprites().iter().map(|sprite| part(sprite, centre)));
    let header = json!({
        "centre": centre,
        "halfSize": half_size_m(set)?,
        "frame": {"unit": set.info.frame.unit_m, "zUp": bool::from(set.info.frame.up)},
        "ahead": first.forward(),
        "up": level_up(Some(first.world_from_eye().y_axis)),
        "fov": first.fov_y_deg(),
        "rules": {
            "fillSteps": RenderOptions::default().fill_steps,
            "nearest": rules::NEAREST_DEPTH_SHARE,
            "leastStretch": rules::LEAST_STRETCH,
            "magnified": rules::MAGNIFIED,
            "steepest": rules::STEEPEST,
            "smoothing": rules::SMOOTHING_ROUNDS,
            "edgeOn": rules::EDGE_ON,
        },
    });
    Ok(Content {
        header,
        parts,
        poster: poster(set, first)?,
        modules: MODULES,
    })
}

/// Encodes a sprite: points of its surface, its displacements, its image.
fn part(sprite: &PreparedSprite, centre: DVec3) -> Part {
    let points = visible_points(sprite.sprite());
    let coordinates = points
        .iter()
        .flat_map(|point| (*point - centre).as_vec3().to_array());
    let mut bytes: Vec<u8> = coordinates.flat_map(f32::to_le_bytes).collect();
    let displacement = sprite.sprite().displacement();
    bytes.extend(displacements::encode(displacement));
    let color = sprite.sprite().sprite().color();
    // Colours of transparent pixels are not needed.
    let texels: Vec<[u8; 4]> = color
        .pixels()
        .map(|pixel| if pixel.0[3] > 0 { pixel.0 } else { [0; 4] })
        .collect();
    let opaque = texels.iter().all(|texel| texel[3] == 255);
    let all = TexelImage {
        texels: 0..texels.len(),
        width: color.width() as usize,
        opaque,
    };
    bytes.extend(residuals(&texels, [all]));
    let header = json!({
        "kind": "sprite",
        "points": points.len(),
        "size": color.dimensions(),
        "opaque": opaque,
        "cells": displacement.size(),
        "format": displacement.format(),
        "scale": displacement.scale(),
        "view": view(sprite, centre),
    });
    Part { header, bytes }
}

/// Describes camera and plane: the eye, directions at eye depth 1 (change per pixel right and down,
/// and at the top left corner), the plane's unit normal, its distance from the eye, and the
/// position of the image's centre on it.
fn view(sprite: &PreparedSprite, centre: DVec3) -> Value {
    let sprite = sprite.sprite().sprite();
    let (camera, plane) = (sprite.camera(), sprite.plane());
    let corner = camera.direction(0.0, 0.0);
    json!({
        "eye": camera.eye() - centre,
        "right": camera.direction(1.0, 0.0) - corner,
        "down": camera.direction(0.0, 1.0) - corner,
        "corner": corner,
        "normal": plane.normal,
        "distance": plane.signed_distance(camera.eye()),
        "middle": sprite.middle() - centre,
    })
}

/// Renders the first view as a JPEG file, with no more rows than the sprite's image.
fn poster(set: &SpriteSet, first: &Camera) -> Result<Vec<u8>, ExportError> {
    let rows = first.height().min(POSTER_PX[1]);
    let size_px = [(rows * POSTER_PX[0]).div_ceil(POSTER_PX[1]), rows];
    let camera = Camera::look_at(
        first.eye(),
        first.eye() + first.forward(),
        DVec3::Y,
        first.fov_y_deg(),
        size_px,
    )?;
    let mut frame = Frame::default();
    let composition = Composition::new(set.clone(), Vec::new());
    composition.render(
        &mut Composer::default(),
        &camera,
        &ComposeSettings::default(),
        &mut frame,
    );
    jpeg(&frame)
}

#[cfg(test)]
mod tests {
    use super::super::Page;
    use super::*;
    use headbox_core::progress::Silent;
    use headbox_sprite::{Displacement, Sprite, SpritePlane, SpriteWithDepth};
    use image::RgbaImage;

    /// A picture of half-transparent grey, nothing on its left half.
    fn sprite(eye: DVec3) -> SpriteWithDepth {
        let camera = Camera::look_at(eye, eye + DVec3::NEG_Z, DVec3::Y, 60.0, [40, 30]).unwrap();
        let color = RgbaImage::from_fn(40, 30, |x, _| {
            image::Rgba([90, 90, 90, if x < 20 { 0 } else { 128 }])
        });
        let plane = SpritePlane::parallel_to_image(&camera, 2.0);
        SpriteWithDepth::new(
            Sprite::new(color, camera, plane).unwrap(),
            Displacement::zero(20, 15),
        )
        .unwrap()
    }

    #[test]
    fn sprites_of_several_eyes_are_one_page() {
        let eyes = [DVec3::new(1.0, 2.0, 3.0), DVec3::new(1.5, 2.0, 3.0)];
        let set = SpriteSet::new(eyes.map(sprite).to_vec());
        let content = content(&set).unwrap();
        assert_eq!(content.parts.len(), 2);
        for (part, eye) in content.parts.iter().zip(eyes) {
            let off = (eye - eyes[0]).to_array();
            assert_eq!(part.header["view"]["eye"], json!(off));
            // Every second of nine by nine points, or so, has something to show.
            let points = part.header["points"].as_u64().unwrap();
            assert!((36..=45).contains(&points), "{points}");
            assert_eq!(part.bytes.len() as u64, points * 12 + 20 * 15 + 40 * 30 * 4);
        }
        // What is nearest is 2 m away.
        let half = content.header["halfSize"].as_f64().unwrap();
        assert!((half - 0.3).abs() < 1e-6, "{half}");
        assert!(Page::from_sprites(&set, "two", &Silent).is_ok());
    }

    #[test]
    fn empty_sprite_set_is_refused() {
        assert!(matches!(
            Page::from_sprites(&SpriteSet::new(Vec::new()), "none", &Silent),
            Err(ExportError::Empty)
        ));
    }
}
