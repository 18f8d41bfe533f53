//! Errors of lumigraphs.

/// Error of creating a lumigraph.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum LumigraphError {
    /// The grid of cameras has no column or no row.
    #[error("a lumigraph needs at least one camera")]
    NoCameras,
    /// A number of the grid is not finite, or a spacing is not positive.
    #[error(
        "the {0} of the camera grid must be finite, and cameras of a row or column must follow each other"
    )]
    Grid(&'static str),
    /// The images are too small or too large.
    #[error("images of {0}x{1} pixels; each side must lie between 2 and {max}", max = headbox_core::camera::Camera::MAX_SIDE_PX)]
    Size(u32, u32),
    /// All images together are too large.
    #[error("{cameras} images of {width}x{height} pixels; together they must have fewer than {max} pixels: take fewer cameras or smaller images", max = super::MAX_PIXELS)]
    TooLarge {
        /// Number of cameras.
        cameras: usize,
        /// Width of an image.
        width: u32,
        /// Height of an image.
        height: u32,
    },
    /// The layers are invalid.
    #[error("layers of disparity must be positive, finite, and follow each other from far to near")]
    Layers,
    /// There are more layers than an index can distinguish.
    #[error("{0} layers; an index of two bytes tells {max} apart", max = super::MAX_LAYERS)]
    TooManyLayers(usize),
    /// An image does not have the size of its camera, or refers to a layer that does not exist.
    #[error("image {0} does not have a colour and an index of a layer for each pixel")]
    Picture(usize),
    /// There is no light slab, or there are too many.
    #[error("{0} light slabs; there must be 1 to {max}", max = super::MAX_SLABS)]
    Slabs(usize),
    /// No image contains a surface.
    #[error("the cameras see nothing: move --plane, turn --normal or widen --fov")]
    NothingSeen,
}
