//! Validation of the build-time layout (S11, S14; C9 for the order of layers).
//!
//! `headbox info --check` and [`crate::pack::CubeLdi::pack`] run it: a valid cube LDI can be packed
//! and drawn without further checks.

use crate::model::info::CaptureInfo;
use crate::model::samples::{CubeSamples, LayeredDepthImage};
use headbox_core::cube_face::Face;
use headbox_core::environment::EnvironmentError;
use rayon::prelude::*;

pub use headbox_core::cube_face::MAX_FACE_SIZE_PX;

/// Violation of the layout by a cube LDI.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum LdiError {
    /// Not six faces in the order of [`Face::ALL`].
    #[error(
        "a cube LDI has the six faces +X, -X, +Y, -Y, +Z, -Z in this order; entry {0} is missing or another face"
    )]
    Faces(usize),
    /// A face is empty or too large.
    #[error("face {}: {size_px} pixels a side; a side must lie between 1 and {MAX_FACE_SIZE_PX}", face.name())]
    FaceSize {
        /// The face.
        face: Face,
        /// Its size.
        size_px: u32,
    },
    /// Faces of one cube differ in size.
    #[error("face {}: {size_px} pixels a side, but the first face has {expected_px}", face.name())]
    FaceSizesDiffer {
        /// The face.
        face: Face,
        /// Its size.
        size_px: u32,
        /// The size of the first face.
        expected_px: u32,
    },
    /// The number of offsets is not pixels + 1.
    #[error("face {}: {found} offsets; a face of this size has {expected}", face.name())]
    OffsetCount {
        /// The face.
        face: Face,
        /// Entries found.
        found: usize,
        /// Entries expected.
        expected: usize,
    },
    /// The first offset is not 0, or the last is not the number of samples.
    #[error("face {}: offsets run from {first} to {last}, but there are {samples} samples", face.name())]
    OffsetEnds {
        /// The face.
        face: Face,
        /// First offset.
        first: u32,
        /// Last offset.
        last: u32,
        /// Number of samples.
        samples: usize,
    },
    /// An offset is smaller than the one before it.
    #[error("face {} pixel ({x}, {y}): its samples end before they begin", face.name())]
    OffsetOrder {
        /// The face.
        face: Face,
        /// Pixel column.
        x: u32,
        /// Pixel row.
        y: u32,
    },
    /// An inverse depth is not positive and finite.
    #[error("face {} pixel ({x}, {y}): inverse depth {inverse_depth}; it must be positive and finite", face.name())]
    InverseDepth {
        /// The face.
        face: Face,
        /// Pixel column.
        x: u32,
        /// Pixel row.
        y: u32,
        /// The value found.
        inverse_depth: f32,
    },
    /// A sample is farther than the one before it.
    #[error("face {} pixel ({x}, {y}): sample {layer} is farther than the one before it", face.name())]
    DepthOrder {
        /// The face.
        face: Face,
        /// Pixel column.
        x: u32,
        /// Pixel row.
        y: u32,
        /// Index inside the pixel of the sample that is out of order.
        layer: usize,
    },
    /// The environment is not six complete faces.
    #[error(transparent)]
    Environment(#[from] EnvironmentError),
    /// A field of [`CaptureInfo`] has an impossible value.
    #[error("capture information: {field} is {value}; expected {expected}")]
    Info {
        /// The field's name.
        field: &'static str,
        /// Its value.
        value: f64,
        /// Valid values.
        expected: &'static str,
    },
}

impl CubeSamples {
    /// Checks the layout: six faces of one size, offsets that are prefix sums, positive finite
    /// inverse depths, farthest first inside a pixel, an environment of six complete faces, valid
    /// capture information.
    ///
    /// # Errors
    /// The first violation, with face, pixel and value.
    pub fn validate(&self) -> Result<(), LdiError> {
        self.info.validate()?;
        for (i, expected) in Face::ALL.into_iter().enumerate() {
            if self.faces.get(i).map(|f| f.face) != Some(expected) {
                return Err(LdiError::Faces(i));
            }
        }
        if self.faces.len() > Face::ALL.len() {
            return Err(LdiError::Faces(Face::ALL.len()));
        }
        let expected_px = self.faces[0].size_px;
        let find_error = |face: &LayeredDepthImage| {
            if face.size_px == expected_px {
                return face.validate().err();
            }
            Some(LdiError::FaceSizesDiffer {
                face: face.face,
                size_px: face.size_px,
                expected_px,
            })
        };
        if let Some(error) = self.faces.par_iter().find_map_first(find_error) {
            return Err(error);
        }
        Ok(self.environment.validate()?)
    }
}

impl LayeredDepthImage {
    /// Checks one face; see [`CubeSamples::validate`].
    ///
    /// # Errors
    /// The first violation, with face, pixel and value.
    pub fn validate(&self) -> Result<(), LdiError> {
        let (face, size_px) = (self.face, self.size_px);
        if !(1..=MAX_FACE_SIZE_PX).contains(&size_px) {
            return Err(LdiError::FaceSize { face, size_px });
        }
        let expected = (size_px as usize).pow(2) + 1;
        if self.offsets.len() != expected {
            return Err(LdiError::OffsetCount {
                face,
                found: self.offsets.len(),
                expected,
            });
        }
        let (first, last) = (self.offsets[0], self.offsets[expected - 1]);
        if first != 0 || last as usize != self.samples.len() {
            return Err(LdiError::OffsetEnds {
                face,
                first,
                last,
                samples: self.samples.len(),
            });
        }
        for (p, ends) in self.offsets.windows(2).enumerate() {
            let (x, y) = (p as u32 % size_px, p as u32 / size_px);
            let samples = self.samples.get(ends[0] as usize..ends[1] as usize);
            let samples = samples.ok_or(LdiError::OffsetOrder { face, x, y })?;
            for (layer, sample) in samples.iter().enumerate() {
                let inverse_depth = sample.inverse_depth;
                if !(inverse_depth > 0.0 && inverse_depth.is_finite()) {
                    return Err(LdiError::InverseDepth {
                        face,
                        x,
                        y,
                        inverse_depth,
                    });
                }
                if layer > 0 && inverse_depth < samples[layer - 1].inverse_depth {
                    return Err(LdiError::DepthOrder { face, x, y, layer });
                }
            }
        }
        Ok(())
    }
}

impl CaptureInfo {
    /// Checks that lengths and exposure are positive and finite, that the centre is finite, and
    /// that shares and estimates lie between 0 and 1.
    ///
    /// # Errors
    /// [`LdiError::Info`] with the field and its value.
    pub fn validate(&self) -> Result<(), LdiError> {
        let check = |field, value: f64, is_valid: bool, expected| {
            let error = LdiError::Info {
                field,
                value,
                expected,
            };
            is_valid.then_some(()).ok_or(error)
        };
        for value in self.centre.to_array() {
            check("centre", value, value.is_finite(), "three finite numbers")?;
        }
        let positive = [
            ("half_size_m", self.half_size_m),
            ("unit_m", self.frame.unit_m),
            ("exposure", f64::from(self.exposure)),
        ];
        for (field, value) in positive {
            check(
                field,
                value,
                value > 0.0 && value.is_finite(),
                "a positive finite number",
            )?;
        }
        for value in self.missing_estimate.into_iter().flatten() {
            check(
                "missing_estimate",
                value,
                (0.0..=1.0).contains(&value),
                "a probability",
            )?;
        }
        if let Some(holes) = &self.holes {
            for (field, value) in [
                ("share", holes.share),
                ("standard_error", holes.standard_error),
                ("share_before", holes.share_before),
            ] {
                check(field, value, (0.0..=1.0).contains(&value), "a share")?;
            }
        }
        Ok(())
    }
}
