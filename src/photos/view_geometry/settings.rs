//! Settings of view-dependent geometry: texturing, effort, and when neighbours are separate
//! surfaces.

use super::RankWeights;

/// Texturing of triangles (E9).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize)]
pub enum Texturing {
    /// The best camera's picture as it is, without depth: for comparison.
    Nearest,
    /// The best camera textures all that it sees.
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

impl Texturing {
    /// Each with the name it has on the command line and in reports.
    pub const ALL: [(&str, Self); 5] = [
        ("geometry-nearest", Self::Nearest),
        ("geometry-single", Self::Single),
        ("geometry-multi", Self::Multi),
        ("geometry-blended", Self::Blended),
        ("geometry-averaged", Self::Averaged),
    ];

    /// The one of a name.
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL
            .iter()
            .find(|(known, _)| *known == name)
            .map(|(_, texturing)| *texturing)
    }

    /// Its name.
    pub fn name(self) -> &'static str {
        Self::ALL
            .iter()
            .find(|(_, known)| *known == self)
            .map_or("", |(name, _)| name)
    }
}

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
    /// By which share of its distance a sample of a camera must be nearer than that of a better
    /// ranked one, to take its place.
    pub margin: f32,
    /// True to assign a node to the best ranked camera that sees it; otherwise to the one whose
    /// sample it holds.
    pub by_sight: bool,
    /// Holes of at most so many nodes are closed.
    pub close_nodes: u32,
    /// Weights of camera ranking.
    pub weights: RankWeights,
    /// Colour of pixels of which nothing is known, sRGB.
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

/// When two neighbours in a frame belong to different surfaces: if what lies between them would be
/// seen at a grazing angle and is no noise.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct EdgeRule {
    /// Share of inverse depth for a pixel.
    steepness: f32,
    /// 1/m.
    least: f32,
}

impl EdgeRule {
    /// The tangent of the angle between a surface and the frame from which on it is taken for a gap
    /// between two: 80 degrees.
    pub(super) const STEEPEST: f32 = 5.67;

    /// For a frame of a focal length, and the standard deviation of inverse depths, 1/m.
    pub(super) fn new(focal_px: f32, noise: f32) -> Self {
        Self {
            steepness: Self::STEEPEST / focal_px,
            least: 3.0 * noise,
        }
    }

    /// The largest difference of inverse depths of one surface over a distance in the frame, 1/m.
    #[inline]
    pub(super) fn most(&self, nearer: f32, length_px: f32) -> f32 {
        nearer * self.steepness * length_px + self.least
    }

    /// Returns true if two inverse depths belong to different surfaces.
    #[inline]
    pub(super) fn parts(&self, a: f32, b: f32, length_px: f32) -> bool {
        (a - b).abs() > self.most(a.max(b), length_px)
    }

    /// The difference that is never an edge, 1/m.
    #[inline]
    pub(super) fn least(&self) -> f32 {
        self.least
    }
}
