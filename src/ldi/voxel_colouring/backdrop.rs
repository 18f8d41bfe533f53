//! Photographs of an object before something dark: from which level on a pixel shows the object.

use crate::capture::images::LoadedView;

/// A rim is dark below this level.
const DARK: u8 = 16;
/// If so large a share of all rims is.
const SHARE: f64 = 0.5;
/// Levels in a class of the histogram.
const CLASS: usize = 8;
/// The level is looked for in these classes.
const CLASSES: std::ops::Range<usize> = 2..12;

/// The level in the emptiest stretch of the histogram between backdrop and object, if there is a dark backdrop.
pub(super) fn find(views: &[LoadedView]) -> Option<u8> {
    let (mut dark, mut rim) = (0u64, 0u64);
    let mut histogram = [0u64; 256 / CLASS];
    for view in views {
        let [width, height] = view.size_px.map(|side| side as usize);
        for (i, pixel) in view.color.iter().enumerate().filter(|(_, pixel)| pixel[3] > 0) {
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::capture::images::{Lens, Pose};
    use glam::{DMat3, DVec3};

    fn view(object: u8, backdrop: u8) -> LoadedView {
        let color = |i: usize| {
            let inside = (8..24).contains(&(i % 32)) && (8..24).contains(&(i / 32));
            let level = if inside { object.saturating_add((i % 7) as u8) } else { backdrop + (i % 5) as u8 };
            [level, level / 2, level / 3, 255]
        };
        LoadedView {
            size_px: [32, 32],
            lens: Lens::Equirectangular,
            pose: Pose { world_from_eye: DMat3::IDENTITY, eye: DVec3::ZERO },
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
}
