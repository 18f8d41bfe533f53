//! Plan of a measurement: sizes and seeded eye positions.

use glam::{DVec3, dvec3};
use headbox_core::camera::{Camera, CameraError};
use headbox_trace::bvh::{Ray, Tracer};
use headbox_trace::sampler::{random4, unit_float};
use serde::{Deserialize, Serialize};
use std::f64::consts::TAU;

/// Effort of a measurement.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Quality {
    /// Edge of a face, px.
    pub face_size_px: u32,
    /// Strata per dimension (N).
    pub strata: u32,
    /// Rays per stratum (M).
    pub rays: u32,
    /// Light samples per depth pixel.
    pub light_samples: u32,
    /// Light samples per texel of cube maps, light maps and sprites, which do not pool light.
    pub baked_samples: u32,
    /// Size of the frames, px.
    pub frame_px: [u32; 2],
    /// Number of eyes distributed over the headbox.
    pub uniform_eyes: u32,
    /// Number of eyes from the centre to a corner, both ends included; at least 2.
    pub line_eyes: u32,
    /// Number of neighbouring eyes on a smooth path, at least 2 or none.
    pub path_eyes: u32,
    /// Initial rays per pixel of truth.
    pub first_samples: u32,
    /// Maximum rays per pixel of truth.
    pub most_samples: u32,
    /// Number of timed frames per eye, apart from the first.
    pub rounds: u32,
    /// Number of cameras per row and per column of the camera walls of lumigraphs.
    pub walls: &'static [usize],
    /// Rays per pixel of the images of camera walls.
    pub wall_samples: u32,
    /// True to repeat the capture with one parameter changed each time, and to render it with the
    /// reference renderer.
    pub variations: bool,
}

impl Quality {
    /// Effort of `headbox report`.
    pub const FULL: Self = Self {
        face_size_px: 512,
        strata: 32,
        rays: 8,
        light_samples: 4,
        baked_samples: 64,
        frame_px: [320, 240],
        uniform_eyes: 8,
        line_eyes: 6,
        path_eyes: 6,
        first_samples: 32,
        most_samples: 4096,
        rounds: 11,
        walls: &[2, 4, 8],
        wall_samples: 8,
        variations: true,
    };
    /// Effort of `headbox report --quick`: a scene in one to two minutes on two cores. Rays of
    /// truth are limited: in a room lit by lamps 1,536 of them took six minutes.
    pub const QUICK: Self = Self {
        face_size_px: 96,
        strata: 16,
        rays: 8,
        light_samples: 4,
        baked_samples: 32,
        frame_px: [96, 72],
        uniform_eyes: 3,
        line_eyes: 4,
        path_eyes: 2,
        first_samples: 16,
        most_samples: 256,
        rounds: 11,
        walls: &[2, 4, 8],
        wall_samples: 2,
        variations: true,
    };
    /// Effort of `headbox report --real`: frames and faces of practical size. Few eyes and one
    /// capture, since truth of an indirectly lit room takes four minutes per frame on two cores.
    pub const REAL: Self = Self {
        face_size_px: 1024,
        strata: 32,
        rays: 8,
        light_samples: 4,
        baked_samples: 8,
        frame_px: [1024, 768],
        uniform_eyes: 2,
        line_eyes: 2,
        path_eyes: 2,
        first_samples: 16,
        most_samples: 192,
        rounds: 5,
        walls: &[4],
        wall_samples: 2,
        variations: false,
    };
}

/// Set of eyes over which the errors of a row are averaged.
#[derive(
    Clone, Copy, Debug, Default, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize,
)]
#[serde(rename_all = "snake_case")]
pub enum EyeSet {
    /// Uniform eyes and eyes on the line from the centre to a corner.
    #[default]
    All,
    /// Eyes on the line only, which look ahead: for sprites, and for renderers too slow for more.
    Ahead,
    /// Eyes at a camera wall, in front of it and behind it, which look ahead: for lumigraphs.
    Wall,
}

impl EyeSet {
    /// Returns true if the set contains all eyes of another set.
    pub fn contains(self, other: Self) -> bool {
        self == other || (self == Self::All && other == Self::Ahead)
    }
}

headbox_core::named_variants!(EyeSet {
    All => "all",
    Ahead => "ahead",
    Wall => "wall",
});

/// Origin of an eye position.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Place {
    /// Random in the headbox, looking in any direction near the horizon.
    Uniform,
    /// On the line from the centre (0) to a corner (1), looking ahead.
    Line(f64),
    /// On a camera wall in the middle of the headbox, in front of it or behind it, looking ahead.
    Wall,
    /// On the smooth path, looking ahead.
    Path,
}

impl Place {
    /// Returns the name in reports.
    pub fn name(self) -> &'static str {
        match self {
            Self::Uniform => "uniform",
            Self::Line(_) => "line",
            Self::Wall => "wall",
            Self::Path => "path",
        }
    }
}

/// One camera of a report.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Eye {
    /// Origin of the position.
    pub place: Place,
    /// Position relative to the centre, in half-sizes of the headbox.
    pub offset: DVec3,
    /// The camera.
    pub camera: Camera,
}

impl Eye {
    /// Returns true if the eye is in `set`. Eyes of the path are in none: they serve flicker only.
    pub fn belongs_to(&self, set: EyeSet) -> bool {
        match self.place {
            Place::Uniform => set == EyeSet::All,
            Place::Line(_) => set != EyeSet::Wall,
            Place::Wall => set == EyeSet::Wall,
            Place::Path => false,
        }
    }
}

/// Eyes of one scene.
#[derive(Clone, Debug, PartialEq)]
pub struct Plan {
    /// Sizes.
    pub quality: Quality,
    /// Centre of the headbox, world metres.
    pub centre: DVec3,
    /// Half of the headbox's edge, metres.
    pub half_size_m: f64,
    /// Viewing direction of the eyes on the line: world axes, unit.
    pub ahead: DVec3,
    /// Seed of eyes and captures.
    pub seed: u64,
    /// Eyes in the order uniform, line, wall, path.
    pub eyes: Vec<Eye>,
}

/// Distance between neighbouring eyes of the path, half-sizes: a slow movement at 60 frames per
/// second.
const PATH_STEP: f64 = 0.02;
/// Vertical field of view, degrees.
const FOV_Y_DEG: f64 = 60.0;

impl Plan {
    /// Places the eyes of a headbox, the same for the same seed.
    ///
    /// # Errors
    /// [`CameraError`] if the frames are empty, or the headbox is not finite.
    pub fn new(
        quality: Quality,
        centre: DVec3,
        half_size_m: f64,
        ahead: DVec3,
        seed: u64,
    ) -> Result<Self, CameraError> {
        let eye = |place, offset: DVec3, forward: DVec3| {
            let position = centre + offset * half_size_m;
            // The target is at the scale of the headbox: the direction stays accurate far from the
            // world's origin.
            let camera = Camera::look_at(
                position,
                position + forward * half_size_m,
                DVec3::Y,
                FOV_Y_DEG,
                quality.frame_px,
            )?;
            Ok(Eye {
                place,
                offset,
                camera,
            })
        };
        let key = [seed as u32, (seed >> 32) as u32];
        let random = |i: u32, stream: u32| {
            random4([i, stream, key[0], key[1]]).map(|r| f64::from(unit_float(r)))
        };
        let mut eyes = Vec::new();
        let [turn, ..] = random(0, 1);
        for i in 0..quality.uniform_eyes {
            let [x, y, z, pitch] = random(i, 2);
            // Golden-ratio steps: random directions of few eyes could leave out sides.
            let yaw = (turn + f64::from(i) * 0.618_033_988_75) * TAU;
            let (sin, cos) = yaw.sin_cos();
            let forward = dvec3(cos, (pitch - 0.5) * 0.6, sin).normalize();
            eyes.push(eye(Place::Uniform, dvec3(x, y, z) * 2.0 - 1.0, forward)?);
        }
        let [x, y, z, _] = random(0, 3);
        let corner = dvec3(x, y, z).map(|c| if c < 0.5 { -1.0 } else { 1.0 });
        for i in 0..quality.line_eyes {
            let share = f64::from(i) / f64::from(quality.line_eyes.max(2) - 1);
            eyes.push(eye(Place::Line(share), corner * share, ahead)?);
        }
        let along = ahead.cross(DVec3::Y).normalize_or(DVec3::X) + ahead * 0.5;
        for i in 0..quality.path_eyes {
            let offset = corner * 0.4 + along * (PATH_STEP * f64::from(i));
            eyes.push(eye(Place::Path, offset, ahead)?);
        }
        Ok(Self {
            quality,
            centre,
            half_size_m,
            ahead,
            seed,
            eyes,
        })
    }

    /// Returns the plan with more eyes, inserted before those of the path.
    pub fn with_eyes(&self, more: Vec<Eye>) -> Self {
        let (path, mut eyes): (Vec<Eye>, Vec<Eye>) =
            self.eyes.iter().partition(|eye| eye.place == Place::Path);
        eyes.extend(more);
        eyes.extend(path);
        Self {
            eyes,
            ..self.clone()
        }
    }
}

/// Returns the horizontal axis along which a view from `centre` (world) has the most nearby
/// geometry, by the sum of 1 / distance over a grid of rays.
pub fn axis_with_most_geometry(tracer: &Tracer, centre: DVec3) -> DVec3 {
    const SIDE: i32 = 24;
    let origin = (centre - tracer.origin()).as_vec3();
    let nearness = |ahead: DVec3| -> f64 {
        let right = ahead.cross(DVec3::Y);
        let cell = |i: i32| f64::from(2 * i + 1 - SIDE) / f64::from(SIDE) * 0.6;
        let rays =
            (0..SIDE * SIDE).map(|i| ahead + right * cell(i % SIDE) + DVec3::Y * cell(i / SIDE));
        let inverse_distances = rays.map(|direction| {
            let ray = Ray {
                origin,
                direction: direction.as_vec3(),
                t_min: 0.0,
                t_max: f32::INFINITY,
            };
            tracer
                .closest(&ray)
                .map_or(0.0, |hit| 1.0 / f64::from(hit.t).max(1e-12))
        });
        inverse_distances.sum()
    };
    let sides = [DVec3::NEG_Z, DVec3::X, DVec3::Z, DVec3::NEG_X].map(|side| (side, nearness(side)));
    // Reversed, so that the first of equals wins.
    sides
        .into_iter()
        .rev()
        .max_by(|a, b| a.1.total_cmp(&b.1))
        .map_or(DVec3::NEG_Z, |(side, _)| side)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn eyes_are_seeded_and_in_headbox() {
        let centre = dvec3(1e5, 2.0, -3.0);
        let plan = |seed| Plan::new(Quality::FULL, centre, 0.25, DVec3::X, seed).expect("valid");
        assert_eq!(plan(3), plan(3));
        assert_ne!(plan(3).eyes, plan(4).eyes);
        for seed in 0..20 {
            let plan = plan(seed);
            assert_eq!(plan.eyes.len(), 8 + 6 + 6);
            for eye in &plan.eyes {
                assert!(eye.offset.abs().max_element() <= 1.0, "{:?}", eye.offset);
                let from_centre = (eye.camera.eye() - centre) / 0.25;
                assert!((from_centre - eye.offset).length() < 1e-9);
            }
            let line: Vec<&Eye> = plan
                .eyes
                .iter()
                .filter(|eye| eye.belongs_to(EyeSet::Ahead))
                .collect();
            assert_eq!(line[0].offset, DVec3::ZERO);
            assert_eq!(line[5].offset.abs(), DVec3::ONE, "it ends in a corner");
            assert!(
                line.iter()
                    .all(|eye| eye.camera.forward().distance(DVec3::X) < 1e-9)
            );
        }
    }

    #[test]
    fn uniform_eyes_fill_the_headbox() {
        let many = Quality {
            uniform_eyes: 2000,
            ..Quality::QUICK
        };
        let plan = Plan::new(many, DVec3::ZERO, 1.0, DVec3::NEG_Z, 1).expect("valid");
        let offsets: Vec<DVec3> = plan
            .eyes
            .iter()
            .filter(|e| e.place == Place::Uniform)
            .map(|e| e.offset)
            .collect();
        let mean = offsets.iter().sum::<DVec3>() / 2000.0;
        let variance = offsets.iter().map(|o| (*o - mean).powf(2.0)).sum::<DVec3>() / 2000.0;
        // A uniform variable on -1..1 has variance 1/3; standard errors of 2,000 draws are 0.013
        // and 0.007.
        assert!(
            mean.abs().max_element() < 0.06 && (variance - 1.0 / 3.0).abs().max_element() < 0.03
        );
    }
}
