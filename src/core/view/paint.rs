//! Colours and legends of overlays, shared by several representations.

use super::{Figure, Swatch};
use crate::color::tone::ToneMap;
use crate::frame::Frame;

/// Colours of seven classes: the "viridis" map by van der Walt and Smith (2015), whose lightness
/// increases evenly, and white.
const CLASSES: [[u8; 3]; 7] = [
    [68, 1, 84],
    [65, 68, 135],
    [42, 120, 142],
    [34, 168, 132],
    [122, 209, 81],
    [253, 231, 37],
    [255, 255, 255],
];

/// Colour of pixels without samples.
pub const NOTHING: [u8; 3] = [20, 20, 20];

/// Largest value of each class but the last.
pub type Tops = [f32; CLASSES.len() - 1];

/// Returns the colour of the class of a positive number.
pub fn class_color(value: f32, tops: &Tops) -> [u8; 3] {
    CLASSES[tops
        .iter()
        .position(|top| value <= *top)
        .unwrap_or(tops.len())]
}

/// Returns the legend of classes with their limits in `unit`.
pub fn class_legend(nothing: &str, tops: &Tops, unit: &str) -> Vec<Swatch> {
    let up_to = tops.iter().map(|top| format!("up to {top} {unit}"));
    let labels = up_to.chain(tops.last().map(|top| format!("more than {top} {unit}")));
    // Of classes with equal limits, all but the first are empty.
    let is_empty = |i: usize| i > 0 && tops.get(i) == tops.get(i - 1);
    let classes = CLASSES
        .into_iter()
        .zip(labels)
        .enumerate()
        .filter(|(i, _)| !is_empty(*i));
    let classes = classes.map(|(_, (color, label))| Swatch { color, label });
    std::iter::once(swatch(NOTHING, nothing))
        .chain(classes)
        .collect()
}

/// Creates a line of a legend.
pub fn swatch(color: [u8; 3], label: &str) -> Swatch {
    Swatch {
        color,
        label: label.into(),
    }
}

/// Adds alpha 255 to a colour.
pub fn opaque([r, g, b]: [u8; 3]) -> [u8; 4] {
    [r, g, b, 255]
}

/// Tints a colour so that shapes stay visible.
pub fn tinted(tint: [u8; 3], [r, g, b]: [u8; 3]) -> [u8; 3] {
    let light = (u16::from(r) + 2 * u16::from(g) + u16::from(b)) / 4;
    tint.map(|c| (u16::from(c) * (80 + light / 2) / 255) as u8)
}

/// Creates a figure of a report.
pub fn figure(name: &'static str, value: f64, unit: &'static str) -> Figure {
    Figure { name, value, unit }
}

/// sRGB of holes: a magenta that hardly occurs in scenes.
pub const HOLE_RGB: [u8; 3] = [255, 0, 220];

/// sRGB of pixels that only show the environment.
pub const ENVIRONMENT_RGB: [u8; 3] = [40, 70, 130];

/// Makes stored colours brighter by a number of stops, under the tone curve that they are stored
/// with (see [`ToneMap::brighter_levels`]).
pub fn expose(pixels: &mut [[u8; 4]], tone: ToneMap, stops: f64) {
    let levels = tone.brighter_levels(stops);
    for [r, g, b, _] in pixels {
        [*r, *g, *b] = [*r, *g, *b].map(|level| levels[usize::from(level)]);
    }
}

/// Paints a frame with its holes in magenta, the rest dimmed so that single pixels stand out.
pub fn paint_holes(frame: &Frame, pixels: &mut [[u8; 4]]) {
    for ((pixel, color), coverage) in pixels.iter_mut().zip(&frame.color).zip(&frame.coverage) {
        let [r, g, b, _] = color.map(|c| c / 2);
        *pixel = opaque(if coverage.is_hole() {
            HOLE_RGB
        } else {
            [r, g, b]
        });
    }
}

/// Legend of [`paint_holes`].
pub fn hole_legend() -> Vec<Swatch> {
    vec![swatch(HOLE_RGB, "hole: nothing is known")]
}

/// Colours that differ in hue and lightness, also for most colour-blind people (Okabe and Ito
/// 2008).
pub const DISTINCT: [[u8; 3]; 8] = [
    [230, 159, 0],
    [86, 180, 233],
    [0, 158, 115],
    [240, 228, 66],
    [0, 114, 178],
    [213, 94, 0],
    [204, 121, 167],
    [230, 230, 230],
];

/// Returns a colour for a number: one of seven, in four shades.
pub fn distinct_color(number: u32) -> [u8; 3] {
    let shade = 255 - 45 * (number / 7 % 4);
    DISTINCT[number as usize % 7].map(|c| (u32::from(c) * shade / 255) as u8)
}

#[cfg(test)]
mod tests {
    use super::*;

    const TOPS: Tops = [1.0, 2.0, 4.0, 8.0, 16.0, 32.0];

    #[test]
    fn classes_match_legend() {
        let of = |value| {
            CLASSES
                .iter()
                .position(|class| *class == class_color(value, &TOPS))
                .unwrap()
        };
        assert_eq!(
            [1.0, 2.0, 3.0, 4.0, 5.0, 32.0, 33.0, 1e9].map(of),
            [0, 1, 2, 2, 3, 5, 6, 6]
        );
        let labels: Vec<_> = class_legend("none", &TOPS, "x")
            .into_iter()
            .map(|line| line.label)
            .collect();
        let some = [0, 1, 6, 7].map(|i| labels[i].as_str());
        assert_eq!(some, ["none", "up to 1 x", "up to 32 x", "more than 32 x"]);
    }
}
