//! Photographs of an object before something dark: from which level on a pixel shows the object.

use super::LoadedView;

/// A rim is dark below this level.
const DARK: u8 = 16;
/// If so large a share of all rims is.
const SHARE: f64 = 0.5;
/// Levels in a class of the histogram.
const CLASS: usize = 8;
/// The level is looked for in these classes.
const CLASSES: std::ops::Range<usize> = 2..12;

/// The level in the emptiest stretch of the histogram between backdrop and object, if there is a dark backdrop.
pub fn find(views: &[LoadedView]) -> Option<u8> {
    let (mut dark, mut rim) = (0u64, 0u64);
    let mut histogram = [0u64; 256 / CLASS];
    for view in views {
        let [width, height] = view.size_px.map(|side| side as usize);
        for (i, pixel) in view
            .color
            .iter()
            .enumerate()
            .filter(|(_, pixel)| pixel[3] > 0)
        {
            let level = pixel[0].max(pixel[1]).max(pixel[2]);
            histogram[usize::from(level) / CLASS] += 1;
            let (x, y) = (i % width, i / width);
            if x == 0 || y == 0 || x == width - 1 || y == height - 1 {
                rim += 1;
                dark += u64::from(level < DARK);
            }
        }
    }
    if dark as f64 <= SHARE * rim as f64 {
        return None;
    }
    let around = |class: usize| histogram[class - 1..=class + 1].iter().sum::<u64>();
    let emptiest = CLASSES.min_by_key(|&class| around(class))?;
    Some((emptiest * CLASS + CLASS / 2) as u8)
}

/// For each pixel whether it shows nothing: it is masked out, or connected with the picture's rim by pixels that are no lighter than `dark`.
pub(super) fn shows_nothing(view: &LoadedView, dark: Option<u8>) -> Vec<bool> {
    let mut nothing: Vec<bool> = view.color.iter().map(|pixel| pixel[3] == 0).collect();
    let Some(dark) = dark else { return nothing };
    let [width, height] = view.size_px.map(|side| side as usize);
    let mut reached: Vec<usize> = Vec::new();
    let reach = |i: usize, nothing: &mut [bool], reached: &mut Vec<usize>| {
        if !nothing[i] && view.color[i][..3].iter().all(|&level| level <= dark) {
            nothing[i] = true;
            reached.push(i);
        }
    };
    let at_rim =
        |i: &usize| [0, width - 1].contains(&(i % width)) || [0, height - 1].contains(&(i / width));
    (0..width * height)
        .filter(at_rim)
        .for_each(|i| reach(i, &mut nothing, &mut reached));
    while let Some(i) = reached.pop() {
        let (x, y) = (i % width, i / width);
        let sides = [
            (x > 0, i.wrapping_sub(1)),
            (x + 1 < width, i + 1),
            (y > 0, i.wrapping_sub(width)),
            (y + 1 < height, i + width),
        ];
        sides
            .into_iter()
            .filter(|side| side.0)
            .for_each(|side| reach(side.1, &mut nothing, &mut reached));
    }
    nothing
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
    fn a_dark_backdrop_ends_where_few_pixels_are() {
        let level = find(&[view(150, 3), view(120, 6)]).expect("dark");
        assert!((11..120).contains(&level), "{level}");
        assert_eq!(find(&[view(150, 90)]), None, "no dark rims");
        assert_eq!(find(&[]), None);
    }

    #[test]
    fn a_dark_place_within_the_object_is_no_backdrop() {
        let mut view = view(150, 3);
        view.color[16 * 32 + 16] = [1, 1, 1, 255];
        view.color[20 * 32 + 20][3] = 0;
        let nothing = shows_nothing(&view, Some(11));
        for (i, nothing) in nothing.into_iter().enumerate() {
            let inside = (8..24).contains(&(i % 32)) && (8..24).contains(&(i / 32));
            assert_eq!(nothing, !inside || i == 20 * 32 + 20, "{i}");
        }
        assert_eq!(
            shows_nothing(&view, None)
                .into_iter()
                .filter(|nothing| *nothing)
                .count(),
            1
        );
    }
}
