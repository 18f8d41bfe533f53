//! Tests that an image is not blank: exit 0 if no colour covers most of it and there are many
//! colours, 1 otherwise.
//!
//!     not_blank FILE.png

use std::{collections::HashMap, process::ExitCode};

/// Minimum number of colours. A blank window has one colour and some text, the simplest real one
/// hundreds.
const MIN_COLORS: usize = 100;
/// Maximum share of one colour. The panel has one colour and covers about a quarter of the window.
const MAX_SHARE: f64 = 0.6;

fn main() -> ExitCode {
    let Some(path) = std::env::args().nth(1) else {
        eprintln!("usage: not_blank FILE.png");
        return ExitCode::from(2);
    };
    let image = match image::open(&path) {
        Ok(image) => image.into_rgb8(),
        Err(error) => {
            eprintln!("error: cannot read {path}: {error}");
            return ExitCode::FAILURE;
        }
    };
    let mut counts: HashMap<[u8; 3], usize> = HashMap::new();
    for pixel in image.pixels() {
        *counts.entry(pixel.0).or_default() += 1;
    }
    let pixels = image.width() as usize * image.height() as usize;
    let share = counts.values().max().copied().unwrap_or(0) as f64 / pixels.max(1) as f64;
    println!(
        "{path}: {}x{} pixels, {} colours, {:.0} % of the commonest",
        image.width(),
        image.height(),
        counts.len(),
        share * 100.0
    );
    if counts.len() >= MIN_COLORS && share <= MAX_SHARE {
        ExitCode::SUCCESS
    } else {
        eprintln!("error: {path} is blank, or nearly");
        ExitCode::FAILURE
    }
}
