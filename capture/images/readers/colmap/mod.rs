//! Models of COLMAP: `model` reads them with the lenses of `cameras`, `points` their sparse points.

mod cameras;
mod model;
mod points;
#[cfg(test)]
mod tests;

pub(crate) use model::open;
pub use points::{SparsePoint, read_sparse_points};
