//! Photographs with projection matrices: `matrices` in text or MATLAB files, whose variables `mat5`
//! reads; `middlebury` in lines of numbers.

mod mat5;
pub(crate) mod matrices;
pub(crate) mod middlebury;
