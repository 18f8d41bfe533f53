//! Settings of view-dependent geometry: texturing, effort, and the rule for depth edges.

use super::RankWeights;

/// Texturing of triangles (E9).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize)]
pub enum Texturing {
    /// The best camera's image as it is, without depth: for comparison.
    Nearest,
    /// The best camera textures everything that it sees.
    Single,
    /// Each triangle by the best ranked of its corners' cameras.
    Multi,
    /// Each triangle by all cameras of its corners, weighted by the corners.
    #[default]
    Blended,
    /// Each pixel by the mean of the best ranked cameras that see its point, whoever owns the
    /// corners.
    Averaged,
}

headbox_core::named_variants!(Texturing {
    Nearest => "geometry-nearest",
    Single => "geometry-single",
    Multi => "geometry-multi",
    Blended => "geometry-blended",
    Averaged => "geometry-averaged",
});

/// Settings of a frame: time against quality (E11).
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct GeometrySettings {
    /// Texturing of triangles.
    pub texturing: Texturing,
    /// Cameras whose samples are fused.
    pub cameras: usize,
    /// Level of detail of the samples, 0 the finest.
    pub level: u32,
    /// Pixels between nodes of the frame's grid.
    pub grid_px: f32,
    /// Share of its distance by which a camera's sample must be nearer than that of a better ranked
    /// one to replace it.
    pub margin: f32,
    /// True to assign a node to the best ranked camera that sees it; false to assign it to the
    /// camera of its sample.
    pub by_sight: bool,
    /// Maximum size of a hole that is closed, nodes.
    pub close_nodes: u32,
    /// Weights of camera ranking.
    pub weights: RankWeights,
    /// Colour of hole pixels, sRGB.
    pub hole_color_srgb: [u8; 3],
}

impl Default for GeometrySettings {
    fn default() -> Self {
        Self {
            texturing: Texturing::default(),
            cameras: 10,
            level: 0,
            grid_px: 5.0,
            margin: 0.02,
            by_sight: true,
            close_nodes: 3,
            weights: RankWeights::default(),
            hole_color_srgb: [0; 3],
        }
    }
}

/// Rule for depth edges: adjacent positions of a frame belong to different surfaces if a surface
/// between them would be seen at a grazing angle and the difference exceeds noise.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct EdgeRule {
    /// Largest relative change of inverse depth per pixel.
    steepness: f32,
    /// Difference of inverse depths that is never an edge, 1/m.
    pub(super) noise_floor: f32,
}

impl EdgeRule {
    /// Tangent of the angle between a surface and the image plane beyond which it counts as an
    /// edge: 80 degrees.
    pub(super) const MAX_SLOPE: f32 = 5.67;

    /// Creates the rule for a frame's focal length and the standard deviation of inverse depths,
    /// 1/m.
    pub(super) fn new(focal_px: f32, noise: f32) -> Self {
        Self {
            steepness: Self::MAX_SLOPE / focal_px,
            noise_floor: 3.0 * noise,
        }
    }

    /// Returns the largest difference of inverse depths on one surface over a distance in the
    /// frame, 1/m.
    #[inline]
    pub(super) fn max_difference(&self, nearer: f32, length_px: f32) -> f32 {
        nearer * self.steepness * length_px + self.noise_floor
    }

    /// Returns true if two inverse depths belong to different surfaces.
    #[inline]
    pub(super) fn is_edge(&self, a: f32, b: f32, length_px: f32) -> bool {
        (a - b).abs() > self.max_difference(a.max(b), length_px)
    }
}
