//! `--face-size`: a number of pixels, or the size that frames need.

use crate::packing::PackingArgs;
use headbox_cube::model::validate::MAX_FACE_SIZE_PX;
use headbox_ldi::face_size::choose_face_size;
use headbox_ldi::spec::CaptureSpec;
use headbox_trace::bvh::Tracer;
use std::fmt;
use std::str::FromStr;

/// Size of cube faces.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum FaceSize {
    /// Pixels along a side.
    Px(u32),
    /// The size that frames need.
    Auto(Frames),
}

/// Frames that are to be rendered from a capture.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Frames {
    width: u32,
    height: u32,
    fov_y_deg: f64,
}

impl Frames {
    /// Frames of reports, for which the default face size is chosen.
    const DEFAULT: Self = Self {
        width: 1024,
        height: 768,
        fov_y_deg: 60.0,
    };

    fn focal_px(self) -> f64 {
        f64::from(self.height) / 2.0 / (self.fov_y_deg.to_radians() / 2.0).tan()
    }
}

impl fmt::Display for Frames {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}x{}@{}", self.width, self.height, self.fov_y_deg)
    }
}

impl fmt::Display for FaceSize {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Px(size) => write!(f, "{size}"),
            Self::Auto(frames) => write!(f, "auto:{frames}"),
        }
    }
}

impl FromStr for FaceSize {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let parsed = match text.strip_prefix("auto") {
            None => text
                .parse()
                .ok()
                .filter(|size| (1..=MAX_FACE_SIZE_PX).contains(size))
                .map(Self::Px),
            Some("") => Some(Self::Auto(Frames::DEFAULT)),
            Some(frames) => frames
                .strip_prefix(':')
                .and_then(parse_frames)
                .map(Self::Auto),
        };
        parsed.ok_or_else(|| {
            format!("give pixels from 1 to {MAX_FACE_SIZE_PX}, auto, or auto:WIDTHxHEIGHT@DEGREES, such as auto:1920x1080@75")
        })
    }
}

/// Parses width, height, and the vertical field of view, which may be absent.
fn parse_frames(text: &str) -> Option<Frames> {
    let (size, fov_y_deg) = match text.split_once('@') {
        Some((size, fov)) => (size, fov.parse().ok()?),
        None => (text, Frames::DEFAULT.fov_y_deg),
    };
    let (width, height) = size.split_once('x')?;
    let [width, height] = [width.parse().ok()?, height.parse().ok()?];
    let sides = 1..=headbox_core::camera::Camera::MAX_SIDE_PX;
    let is_valid =
        sides.contains(&width) && sides.contains(&height) && (0.1..=179.0).contains(&fov_y_deg);
    is_valid.then_some(Frames {
        width,
        height,
        fov_y_deg,
    })
}

impl FaceSize {
    /// Returns the size, or `auto_px` if [`Self::choose`] decides it later; strata must be chosen
    /// for that size.
    pub(super) fn or(self, auto_px: u32) -> u32 {
        match self {
            Self::Px(size) => size,
            Self::Auto(_) => auto_px,
        }
    }

    /// Sets the face size that frames need, with as many rays for each face pixel as before, and
    /// reports it.
    pub(super) fn choose(self, spec: &mut CaptureSpec, tracer: &Tracer, packing: &PackingArgs) {
        let Self::Auto(frames) = self else { return };
        choose_face_size(spec, tracer, frames.focal_px(), packing.error_px);
        eprintln!(
            "faces of {} px and {}^4 strata: as fine as frames of {}x{} at {} degrees show",
            spec.face_size_px,
            spec.parameters.strata,
            frames.width,
            frames.height,
            frames.fov_y_deg
        );
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn face_sizes_parse_and_format() {
        for text in ["1", "1024", "auto:1920x1080@75", "auto:640x480@60.5"] {
            assert_eq!(
                text.parse::<FaceSize>()
                    .map(|size| size.to_string())
                    .as_deref(),
                Ok(text)
            );
        }
        assert_eq!("auto".parse(), Ok(FaceSize::Auto(Frames::DEFAULT)));
        assert_eq!("auto:1024x768".parse(), Ok(FaceSize::Auto(Frames::DEFAULT)));
        for text in [
            "0",
            "-3",
            "1e9",
            "automatic",
            "auto:",
            "auto:9",
            "auto:0x5",
            "auto:5x5@",
            "auto:5x5@nan",
            "auto:5x5@180",
        ] {
            assert!(text.parse::<FaceSize>().is_err(), "{text}");
        }
    }
}
