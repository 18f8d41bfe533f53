//! Transfer from a sprite's camera to a target camera: homography of the plane, and epipole (Shade
//! et al., Eq. 1 to 6).

use crate::Sprite;
use glam::{DMat3, DMat4, DVec3, dvec3};
use headbox_core::camera::Camera;

/// Outcome of rendering a sprite.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, serde::Serialize)]
pub enum Outcome {
    /// The sprite was drawn. It may still lie outside the frame.
    Drawn,
    /// The target eye lies in the sprite's plane, or so close to it that the plane is a line:
    /// nothing was drawn.
    EdgeOn,
    /// All of the sprite's plane rectangle is behind the target eye, or the camera's numbers are
    /// out of range: nothing was drawn.
    Behind,
}

/// Smallest ratio of the target eye's distance from the plane to its distance from the sprite's
/// middle; below it the plane counts as edge-on. A rectangle seen at 0.06 degrees covers a
/// thousandth of its width.
pub const EDGE_ON: f64 = 1e-3;

/// Maps between the pixels of a sprite and of a target camera, in homogeneous coordinates.
///
/// With both cameras' third rows replaced by the same plane row (C4, C6), `T12 = C2^ C1^-1` has the
/// third row [0 0 1 0]; without its third row and column it is the homography H12, and its third
/// column is the epipole e12. Here both are written out: seen from camera 1, a pixel at
/// displacement d is the point `eye1 + Z dir` with `1/Z = q(x, y) + d / distance1`, q the plane's
/// inverse depth. Projecting Z^-1 times that point by camera 2 gives `H12 = M2 D1 + (M2 (eye1 -
/// eye2)) q^T` and `e12 = M2 (eye1 - eye2) / distance1`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SpriteTransfer {
    /// H12: (w2 x2, w2 y2, w2) = H12 (x1, y1, 1) for points on the plane; w2 is Z2/Z1, positive in
    /// front of both eyes.
    pub target_from_sprite: DMat3,
    /// H21, the inverse.
    pub sprite_from_target: DMat3,
    /// e12: the change per unit of displacement of `target_from_sprite * (x1, y1, 1)` (Eq. 4).
    pub epipole_in_target: DVec3,
    /// e* = H21 e12 = -e21: the change of (x1, y1, 1) per unit of displacement under pure parallax
    /// (Eq. 6).
    pub epipole_in_sprite: DVec3,
    /// 1 if the target eye is on the same side of the plane as the sprite's own, else -1. Of two
    /// displacements at one output pixel, the larger times this is nearer: along a target ray d2 =
    /// (side * distance)/Z2 + constant (C7).
    pub side: f64,
}

impl SpriteTransfer {
    /// Computes the maps of a sprite and a target camera.
    ///
    /// # Errors
    /// [`Outcome::EdgeOn`] and [`Outcome::Behind`].
    pub fn new(sprite: &Sprite, target: &Camera) -> Result<Self, Outcome> {
        let (camera, plane) = (sprite.camera(), sprite.plane());
        let origin = camera.direction(0.0, 0.0);
        let directions = DMat3::from_cols(
            camera.direction(1.0, 0.0) - origin,
            camera.direction(0.0, 1.0) - origin,
            origin,
        );
        let project = projection(target);
        let baseline = project * (camera.eye() - target.eye());
        let distance = plane.signed_distance(camera.eye());
        let inverse_depth = directions.transpose() * plane.normal / -distance;
        let target_from_sprite = project * directions + outer(baseline, inverse_depth);
        let epipole_in_target = baseline / distance;
        let transfer = Self::from_parts(
            target_from_sprite,
            epipole_in_target,
            target_side(sprite, target)?,
        );
        transfer
            .filter(|t| t.is_partly_in_front(sprite))
            .ok_or(Outcome::Behind)
    }

    /// Creates the maps from H12, e12 and the side; `None` unless H12 is invertible and all values
    /// are finite.
    pub fn from_parts(
        target_from_sprite: DMat3,
        epipole_in_target: DVec3,
        side: f64,
    ) -> Option<Self> {
        let sprite_from_target = target_from_sprite.inverse();
        let epipole_in_sprite = sprite_from_target * epipole_in_target;
        let finite = sprite_from_target.is_finite()
            && target_from_sprite.is_finite()
            && epipole_in_sprite.is_finite();
        finite.then_some(Self {
            target_from_sprite,
            sprite_from_target,
            epipole_in_target,
            epipole_in_sprite,
            side,
        })
    }

    /// Returns the maps with the epipole in the sprite moved to infinity (S8): all pixels move in
    /// one direction.
    #[must_use]
    pub(super) fn with_epipole_at_infinity(&self) -> Self {
        let epipole_in_sprite = dvec3(self.epipole_in_sprite.x, self.epipole_in_sprite.y, 0.0);
        Self {
            epipole_in_sprite,
            epipole_in_target: self.target_from_sprite * epipole_in_sprite,
            ..*self
        }
    }

    /// Maps a sprite pixel at displacement `d` to the target (Eq. 4); `None` if it is not in front
    /// of the target eye.
    pub fn forward(&self, x: f64, y: f64, d: f64) -> Option<[f64; 2]> {
        let p = self.target_from_sprite * dvec3(x, y, 1.0) + self.epipole_in_target * d;
        (p.z > 0.0).then(|| [p.x / p.z, p.y / p.z])
    }

    /// Returns true if a corner of the sprite's rectangle on the plane is in front of the target
    /// eye.
    fn is_partly_in_front(&self, sprite: &Sprite) -> bool {
        let [w, h] = [sprite.camera().width(), sprite.camera().height()].map(f64::from);
        [[0.0, 0.0], [w, 0.0], [0.0, h], [w, h]]
            .into_iter()
            .any(|[x, y]| (self.target_from_sprite * dvec3(x, y, 1.0)).z > 0.0)
    }
}

/// Returns the side of the plane on which the target eye lies.
fn target_side(sprite: &Sprite, target: &Camera) -> Result<f64, Outcome> {
    let distance = sprite.plane().signed_distance(target.eye());
    let range = (target.eye() - sprite.middle()).length();
    if distance.abs() > EDGE_ON * range && distance.is_finite() {
        Ok(distance.signum())
    } else {
        Err(Outcome::EdgeOn)
    }
}

/// Returns rows x, y and w of a camera's matrix without translation: it maps a direction to (w x, w
/// y, w).
fn projection(camera: &Camera) -> DMat3 {
    let rows: DMat4 = camera.image_from_world().transpose();
    DMat3::from_cols(
        rows.x_axis.truncate(),
        rows.y_axis.truncate(),
        rows.w_axis.truncate(),
    )
    .transpose()
}

/// Returns column * row^T.
fn outer(column: DVec3, row: DVec3) -> DMat3 {
    DMat3::from_cols(column * row.x, column * row.y, column * row.z)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::SpritePlane;
    use glam::DVec4;
    use image::RgbaImage;

    fn setup() -> (Sprite, Camera) {
        let look = |eye, at| Camera::look_at(eye, at, DVec3::Y, 50.0, [64, 48]).expect("valid");
        let camera = look(dvec3(10.0, 1.0, 4.0), dvec3(10.2, 1.1, 0.0));
        let plane = SpritePlane::through(dvec3(10.0, 1.0, 0.0), dvec3(0.2, 0.1, 1.0));
        let sprite = Sprite::new(RgbaImage::new(64, 48), camera, plane).expect("valid");
        (sprite, look(dvec3(10.7, 1.3, 3.5), dvec3(10.0, 1.0, 0.0)))
    }

    /// f64 through an inverse of a matrix with entries up to 10^3.
    const ROUNDING: f64 = 1e-9;

    #[test]
    fn transfer_agrees_with_paper_matrices() {
        let (sprite, target) = setup();
        let transfer = SpriteTransfer::new(&sprite, &target).expect("in front");
        let hat = |camera: &Camera| {
            let rows = camera.image_from_world().transpose();
            let plane = DVec4::from((sprite.plane().normal, sprite.plane().offset));
            DMat4::from_cols(rows.x_axis, rows.y_axis, plane, rows.w_axis).transpose()
        };
        let t12 = hat(&target) * hat(sprite.camera()).inverse();
        let t21 = t12.inverse();
        let rows = t12.transpose();
        assert!(
            rows.z_axis.distance(DVec4::Z) < ROUNDING,
            "C6: the third row is [0 0 1 0]"
        );
        let pick = |v: DVec4| dvec3(v.x, v.y, v.w);
        for (mine, theirs) in [
            (transfer.target_from_sprite, t12),
            (transfer.sprite_from_target, t21),
        ] {
            for (k, column) in [theirs.x_axis, theirs.y_axis, theirs.w_axis]
                .into_iter()
                .enumerate()
            {
                assert!(mine.col(k).distance(pick(column)) < ROUNDING * 1e3);
            }
        }
        assert!(transfer.epipole_in_target.distance(pick(t12.z_axis)) < ROUNDING * 1e3);
        assert!(
            (-transfer.epipole_in_sprite).distance(pick(t21.z_axis)) < ROUNDING * 1e3,
            "e21 = -e*"
        );
    }

    #[test]
    fn eq_4_agrees_with_projecting_the_point() {
        let (sprite, target) = setup();
        let transfer = SpriteTransfer::new(&sprite, &target).expect("in front");
        for (x, y, depth) in [(3.0, 40.0, 3.0), (60.5, 2.5, 4.5), (31.0, 20.0, 9.0)] {
            let point = sprite.camera().eye() + sprite.camera().direction(x, y) * depth;
            let d = sprite.plane().signed_distance(point) / depth;
            let [px, py, _] = target.project(point).expect("in front");
            let [fx, fy] = transfer.forward(x, y, d).expect("in front");
            assert!((px - fx).abs() < ROUNDING && (py - fy).abs() < ROUNDING);
        }
    }

    #[test]
    fn edge_on_is_an_angle_whatever_the_distance() {
        let (sprite, _) = setup();
        let (normal, middle) = (sprite.plane().normal.normalize(), sprite.middle());
        let along = normal.any_orthonormal_vector();
        for range in [0.2, 5.0, 300.0] {
            for (angle, is_edge_on) in [
                (0.8e-3, true),
                (1.2e-3, false),
                (-0.8e-3, true),
                (-1.2e-3, false),
            ] {
                let eye = middle + (along + normal * angle) * range;
                let target = Camera::look_at(eye, middle, normal, 50.0, [64, 48]).expect("valid");
                let found =
                    SpriteTransfer::new(&sprite, &target).map(|_| ()) == Err(Outcome::EdgeOn);
                assert_eq!(found, is_edge_on, "{range} m, {angle} rad");
            }
        }
    }

    #[test]
    fn partly_visible_sprite_is_drawn() {
        let (sprite, _) = setup();
        let corner = |x, y| {
            let ray = sprite.camera().direction(x, y);
            let depth = -sprite.plane().signed_distance(sprite.camera().eye())
                / sprite.plane().normal.dot(ray);
            sprite.camera().eye() + ray * depth
        };
        let (left, right) = (corner(0.0, 24.0), corner(64.0, 24.0));
        // From amid the rectangle, toward one end of it.
        for at in [left, right] {
            let eye = sprite.middle() + sprite.plane().normal * 0.3;
            let target = Camera::look_at(eye, at, DVec3::Y, 50.0, [64, 48]).expect("valid");
            assert!(SpriteTransfer::new(&sprite, &target).is_ok());
        }
        let target = Camera::look_at(
            left * 2.0 - right,
            left * 3.0 - right * 2.0,
            DVec3::Y,
            50.0,
            [64, 48],
        );
        assert!(
            SpriteTransfer::new(&sprite, &target.expect("valid")).is_err(),
            "all of it is behind"
        );
    }

    #[test]
    fn singular_transfer_is_none() {
        let finite = DVec3::new(1.0, 2.0, 3.0);
        assert!(SpriteTransfer::from_parts(DMat3::IDENTITY, finite, 1.0).is_some());
        for value in [f64::INFINITY, f64::NAN] {
            assert!(SpriteTransfer::from_parts(DMat3::IDENTITY, finite * value, 1.0).is_none());
            assert!(SpriteTransfer::from_parts(DMat3::IDENTITY * value, finite, 1.0).is_none());
        }
        assert!(SpriteTransfer::from_parts(DMat3::ZERO, finite, 1.0).is_none());
    }

    #[test]
    fn degenerate_views_are_named() {
        let (sprite, _) = setup();
        let look = |eye, at| Camera::look_at(eye, at, DVec3::Y, 50.0, [64, 48]).expect("valid");
        let in_plane = look(dvec3(10.0, 1.0, 0.0), dvec3(11.0, 1.0, 0.0));
        assert_eq!(
            SpriteTransfer::new(&sprite, &in_plane),
            Err(Outcome::EdgeOn)
        );
        let along_plane = look(dvec3(9.0, 1.0, 0.2), dvec3(10.0, 1.0, 0.0));
        assert_eq!(
            SpriteTransfer::new(&sprite, &along_plane),
            Err(Outcome::EdgeOn)
        );
        let away = look(dvec3(10.0, 1.0, 4.0), dvec3(10.0, 1.0, 8.0));
        assert_eq!(SpriteTransfer::new(&sprite, &away), Err(Outcome::Behind));
        let from_behind = look(dvec3(10.0, 1.0, -4.0), dvec3(10.0, 1.0, 0.0));
        assert_eq!(
            SpriteTransfer::new(&sprite, &from_behind)
                .expect("visible")
                .side,
            -1.0
        );
    }
}
