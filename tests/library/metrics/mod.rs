//! Promises of image metrics.

mod flip;
mod images;
mod values;
