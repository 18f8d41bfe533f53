//! Segmentation of photographs of an object in front of a dark backdrop.

use super::LoadedView;

/// Maximum level of a dark border pixel.
const DARK: u8 = 16;

/// Minimum fraction of dark border pixels for a dark backdrop.
const MIN_DARK_SHARE: f64 = 0.5;

/// Number of levels in a bin of the histogram.
const BIN: usize = 8;

/// Bins in which the threshold is searched.
const SEARCHED_BINS: std::ops::Range<usize> = 2..12;

/// Returns the level at the minimum of the histogram between backdrop and object, if the backdrop
/// is dark.
pub fn find_threshold(views: &[LoadedView]) -> Option<u8> {
    let mut dark = 0u64;
    let mut border = 0u64;
    let mut histogram = [0u64; 256 / BIN];
    for view in views {
        let [width, height] = view.size_px.map(|side| side as usize);
        for (i, pixel) in view
            .color
            .iter()
            .enumerate()
            .filter(|(_, pixel)| pixel[3] > 0)
        {
            let level = pixel[0].max(pixel[1]).max(pixel[2]);
            histogram[usize::from(level) / BIN] += 1;
            let x = i % width;
            let y = i / width;
            if x == 0 || y == 0 || x == width - 1 || y == height - 1 {
                border += 1;
                dark += u64::from(level < DARK);
            }
        }
    }
    if dark as f64 <= MIN_DARK_SHARE * border as f64 {
        return None;
    }
    let smoothed = |bin: usize| histogram[bin - 1..=bin + 1].iter().sum::<u64>();
    let emptiest = SEARCHED_BINS.min_by_key(|&bin| smoothed(bin))?;
    Some((emptiest * BIN + BIN / 2) as u8)
}

/// Returns true for each background pixel: one that is masked out, or connected to the image border
/// through pixels with levels up to `threshold`.
pub(super) fn background_mask(view: &LoadedView, threshold: Option<u8>) -> Vec<bool> {
    let mut mask: Vec<bool> = view.color.iter().map(|pixel| pixel[3] == 0).collect();
    let Some(threshold) = threshold else {
        return mask;
    };
    let [width, height] = view.size_px.map(|side| side as usize);
    let mut stack: Vec<usize> = Vec::new();
    let visit = |i: usize, mask: &mut [bool], stack: &mut Vec<usize>| {
        if !mask[i] && view.color[i][..3].iter().all(|&level| level <= threshold) {
            mask[i] = true;
            stack.push(i);
        }
    };
    let is_border =
        |i: &usize| [0, width - 1].contains(&(i % width)) || [0, height - 1].contains(&(i / width));
    (0..width * height)
        .filter(is_border)
        .for_each(|i| visit(i, &mut mask, &mut stack));
    while let Some(i) = stack.pop() {
        let x = i % width;
        let y = i / width;
        let sides = [
            (x > 0, i.wrapping_sub(1)),
            (x + 1 < width, i + 1),
            (y > 0, i.wrapping_sub(width)),
            (y + 1 < height, i + width),
        ];
        sides
            .into_iter()
            .filter(|side| side.0)
            .for_each(|side| visit(side.1, &mut mask, &mut stack));
    }
    mask
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Lens, Pose};
    use glam::{DMat3, DVec3};

    fn view(object: u8, backdrop: u8) -> LoadedView {
        let color = |i: usize| {
            let inside = (8..24).contains(&(i % 32)) && (8..24).contains(&(i / 32));
            let level = if inside {
                object.saturating_add((i % 7) as u8)
            } else {
                backdrop + (i % 5) as u8
            };
            [level, level / 2, level / 3, 255]
        };
        LoadedView {
            size_px: [32, 32],
            lens: Lens::Equirectangular,
            pose: Pose {
                world_from_eye: DMat3::IDENTITY,
                eye: DVec3::ZERO,
            },
            color: (0..32 * 32).map(color).collect(),
            depth: Vec::new(),
        }
    }

    #[test]
    fn threshold_between_backdrop_and_object() {
        let level = find_threshold(&[view(150, 3), view(120, 6)]).expect("dark");
        assert!((11..120).contains(&level), "{level}");
        assert_eq!(find_threshold(&[view(150, 90)]), None, "bright borders");
        assert_eq!(find_threshold(&[]), None);
    }

    #[test]
    fn dark_spot_in_object_not_background() {
        let mut view = view(150, 3);
        view.color[16 * 32 + 16] = [1, 1, 1, 255];
        view.color[20 * 32 + 20][3] = 0;
        let mask = background_mask(&view, Some(11));
        for (i, is_background) in mask.into_iter().enumerate() {
            let inside = (8..24).contains(&(i % 32)) && (8..24).contains(&(i / 32));
            assert_eq!(is_background, !inside || i == 20 * 32 + 20, "{i}");
        }
        assert_eq!(
            background_mask(&view, None)
                .into_iter()
                .filter(|is_background| *is_background)
                .count(),
            1
        );
    }
}
