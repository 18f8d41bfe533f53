//! From a canvas to the frame: compositing over the environment, and filling of small holes.

pub mod composite_environment;
pub mod holes;
