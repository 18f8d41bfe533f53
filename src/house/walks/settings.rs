//! Settings and statistics of a frame of a walk.

use crate::backdrop::{BackdropKind, BackdropQuality, BackdropStats, PortalSide};
use crate::portal_culling::Limits;
use headbox_core::camera::Camera;
use headbox_cube::render::RenderSettings;
use headbox_raster::RasterStats;
use serde::Serialize;

/// Rule by which a cell behind a portal is drawn as geometry (R3 gives none).
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Near {
    /// If the eye is nearer to the portal's rectangle than this, metres.
    Distance(f64),
    /// If the samples of a cube `back_m` in front of the portal's middle, with faces of `face_px`,
    /// on a surface [`REFERENCE_DEPTH_M`] behind the portal would be farther apart than
    /// `spacing_px` in the frame, or the eye is nearer than [`LEAST_DISTANCE_M`].
    ProjectedError {
        /// Largest distance of neighbouring samples, pixels of the frame.
        spacing_px: f64,
        /// Size of the cube's faces, pixels.
        face_px: u32,
        /// Distance from the portal's middle to the cube's centre, metres.
        back_m: f64,
    },
}

impl Default for Near {
    /// Projected error of [`BackdropKind::WindowLdi`] in the default [`BackdropQuality`].
    fn default() -> Self {
        let quality = BackdropQuality::default();
        Self::ProjectedError {
            spacing_px: 2.77,
            face_px: quality.window_face_px,
            back_m: quality.window_back_m,
        }
    }
}

/// Depth at which the spacing of a backdrop's samples is measured, metres: about the middle of a
/// room.
pub const REFERENCE_DEPTH_M: f64 = 3.0;

/// Distance below which a portal is always passed, metres: half a wall and a step.
pub const LEAST_DISTANCE_M: f64 = 0.3;

impl Near {
    /// Returns the distance from a portal within which the next cell is drawn as geometry, metres.
    pub fn distance_m(self, camera: &Camera) -> f64 {
        match self {
            Self::Distance(distance) => distance,
            Self::ProjectedError {
                spacing_px,
                face_px,
                back_m,
            } => {
                // At depth z behind the portal samples are (z + back) / f1 apart; the frame scales
                // this by f2 / (z + d).
                let ratio = camera.focal_px() / (f64::from(face_px) / 2.0 * spacing_px);
                ((REFERENCE_DEPTH_M + back_m) * ratio - REFERENCE_DEPTH_M).max(LEAST_DISTANCE_M)
            }
        }
    }
}

/// Division of the backdrops' work among threads; all give the same frame.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Division {
    /// Each backdrop in bands of rows, one per thread: a depth pixel near the border of two bands
    /// is warped for both.
    #[default]
    Bands,
    /// Each portal's backdrop (a sheet of R6) by one thread.
    Portals,
}

impl Division {
    /// Returns the render settings of a backdrop of `rows` rows.
    pub(crate) fn settings(self, warp: &RenderSettings, rows: u32) -> RenderSettings {
        let band_rows = match self {
            Self::Bands if warp.band_rows > 0 => warp.band_rows,
            Self::Bands => rows / rayon::current_num_threads() as u32 + 1,
            Self::Portals => rows,
        };
        RenderSettings { band_rows, ..*warp }
    }
}

/// Settings of a walk.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct WalkSettings {
    /// Kind of backdrops behind portals; `None` for geometry alone.
    pub backdrops: Option<BackdropKind>,
    /// Rule by which a cell behind a portal is drawn as geometry.
    pub near: Near,
    /// Settings of the LDI renderer.
    pub warp: RenderSettings,
    /// Division among threads.
    pub division: Division,
    /// True if holes keep the colour of the last frame (R8).
    pub persistence: bool,
    /// Limits of portal culling.
    pub limits: Limits,
}

/// Statistics of a frame.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct WalkStats {
    /// Cell of the eye; `None` inside a wall, where all cells are drawn as geometry.
    pub cell: Option<u32>,
    /// Number of cells drawn as geometry.
    pub geometry_cells: u32,
    /// Number of portals with a backdrop.
    pub portals: u32,
    /// Portals that were passed because their backdrop is missing.
    pub missing: Vec<PortalSide>,
    /// True if portal culling stopped at a limit, so that cells may be missing.
    #[serde(skip_serializing_if = "std::ops::Not::not")]
    pub is_culling_cut: bool,
    /// Number of pixels of the frame.
    pub pixels: u64,
    /// Number of pixels of backdrops.
    pub backdrop_pixels: u64,
    /// Number of hole pixels inside backdrops.
    pub hole_pixels: u64,
    /// Statistics of the rasteriser.
    pub raster: RasterStats,
    /// Sums over all backdrops.
    pub backdrop: BackdropStats,
    /// Time of the whole frame, ms.
    pub frame_ms: f64,
    /// Time of culling and geometry, ms.
    pub geometry_ms: f64,
    /// Time of the backdrops, ms.
    pub backdrop_ms: f64,
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::{DVec3, dvec3};
    use headbox_core::cube_face::Face;

    /// The tilt of a line of sight half a sample off the axis: (1/2 / f1)^2.
    const TILT: f64 = 1e-4;

    #[test]
    fn near_doors_open_where_samples_separate() {
        let Near::ProjectedError {
            spacing_px,
            face_px,
            back_m,
        } = Near::default()
        else {
            panic!("a rule of samples")
        };
        let quality = BackdropQuality::default();
        assert_eq!(
            (face_px, back_m),
            (quality.window_face_px, quality.window_back_m),
            "what the default kind captures"
        );
        for (fov_y_deg, size) in [(60.0, [640, 512]), (60.0, [1280, 1024]), (40.0, [800, 600])] {
            // A portal about the origin, the eye before it on +z, and the wall behind it.
            let camera = |z: f64| {
                Camera::look_at(
                    DVec3::Z * z,
                    DVec3::ZERO,
                    DVec3::Y,
                    fov_y_deg,
                    [size[0], size[1]],
                )
            };
            let distance = Near::default().distance_m(&camera(1.0).expect("valid"));
            let camera = camera(distance).expect("valid");
            let middle = f64::from(face_px) / 2.0;
            let sample = |column: f64| {
                let toward = Face::NegZ.direction(middle + column, middle, face_px);
                camera
                    .project(dvec3(0.0, 0.0, back_m) + toward * (REFERENCE_DEPTH_M + back_m))
                    .expect("in front")[0]
            };
            let spacing = sample(0.5) - sample(-0.5);
            assert!(
                (spacing / spacing_px - 1.0).abs() < TILT,
                "{spacing} px at {distance} m"
            );
        }
        let tiny = Camera::look_at(DVec3::Z, DVec3::ZERO, DVec3::Y, 60.0, [8, 8]).expect("valid");
        assert_eq!(Near::default().distance_m(&tiny), LEAST_DISTANCE_M);
        assert_eq!(Near::Distance(7.0).distance_m(&tiny), 7.0);
    }
}
