//! Kinds of depth values.

/// Kind of a depth value (Seurat's `WINDOW_Z`, `EYE_Z`, `RAY_DEPTH`).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum DepthKind {
    /// Non-linear depth-buffer value in 0..1, 0 at the near plane.
    WindowDepth,
    /// The same reversed, 1 at the near plane ("reversed Z").
    ReversedWindowDepth,
    /// Distance along the viewing axis, metres (Z in the papers).
    EyeDepth,
    /// Euclidean distance from the eye, metres.
    RayDistance,
}
