//! Image sets: formats and their faults.

mod faults;
mod formats;
mod wall;
