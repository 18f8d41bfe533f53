//! Images by integer formulas, which other programs can reproduce bit for bit.

use image::{Rgb, RgbImage};

/// Gradients in red, rings in green, a chequerboard of 8 pixels in blue.
pub(crate) fn pattern(width: u32, height: u32) -> RgbImage {
    RgbImage::from_fn(width, height, |x, y| {
        Rgb([
            (5 * x + 3 * y) as u8,
            ((x * x + y * y) / 16) as u8,
            (40 + 160 * ((x / 8 + y / 8) % 2)) as u8,
        ])
    })
}

/// `image` with each channel lowered by a hash of its position, at most `strength`.
pub(crate) fn noisy(image: &RgbImage, strength: u32) -> RgbImage {
    RgbImage::from_fn(image.width(), image.height(), |x, y| {
        let channel = |c: u32| {
            let hash = x
                .wrapping_mul(374_761_393)
                .wrapping_add(y.wrapping_mul(668_265_263))
                .wrapping_add(c * 974_634_077);
            let hash = (hash ^ (hash >> 13)).wrapping_mul(1_274_126_177);
            image[(x, y)][c as usize].saturating_sub(((hash >> 16) % (strength + 1)) as u8)
        };
        Rgb([0, 1, 2].map(channel))
    })
}

/// `image` moved one pixel to the right; its first column repeats.
pub(crate) fn shifted(image: &RgbImage) -> RgbImage {
    RgbImage::from_fn(image.width(), image.height(), |x, y| {
        image[(x.saturating_sub(1), y)]
    })
}

/// `image` at 3/4 of its sRGB values.
pub(crate) fn darker(image: &RgbImage) -> RgbImage {
    RgbImage::from_fn(image.width(), image.height(), |x, y| {
        Rgb(image[(x, y)].0.map(|v| (u32::from(v) * 3 / 4) as u8))
    })
}

/// A constant image.
pub(crate) fn constant(width: u32, height: u32, color: [u8; 3]) -> RgbImage {
    RgbImage::from_pixel(width, height, Rgb(color))
}

/// Named pairs of images that differ in various ways.
pub(crate) fn pairs(width: u32, height: u32) -> Vec<(&'static str, RgbImage, RgbImage)> {
    let image = pattern(width, height);
    let mut one_pixel = image.clone();
    one_pixel.put_pixel(width / 2, height / 3, Rgb([255, 0, 255]));
    vec![
        ("equal", image.clone(), image.clone()),
        ("noise 8", image.clone(), noisy(&image, 8)),
        ("noise 90", image.clone(), noisy(&image, 90)),
        ("shift", image.clone(), shifted(&image)),
        ("darker", image.clone(), darker(&image)),
        ("one pixel", image.clone(), one_pixel),
        (
            "black, white",
            constant(width, height, [0; 3]),
            constant(width, height, [255; 3]),
        ),
        (
            "green, blue",
            constant(width, height, [0, 255, 0]),
            constant(width, height, [0, 0, 255]),
        ),
        ("pattern, grey", image, constant(width, height, [128; 3])),
    ]
}
