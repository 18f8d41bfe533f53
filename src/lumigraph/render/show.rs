//! Overlays of lumigraphs: how a frame was composed.

use serde::Serialize;

/// Content of a frame.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Show {
    /// The scene.
    #[default]
    Colors,
    /// The layer of each pixel as it is stored, blue for the farthest and red for the nearest.
    Layers,
    /// Layers as they were merged for the frame, each in a colour of its own.
    Merged,
    /// Cameras that a pixel is blended from, each in its own colour.
    Cameras,
}

impl Show {
    /// All, with what the window calls them.
    pub const ALL: [(&'static str, Self); 4] = [
        ("none", Self::Colors),
        ("layer", Self::Layers),
        ("merged layers", Self::Merged),
        ("camera", Self::Cameras),
    ];
}

/// A colour of its own for a number: steps by the golden ratio around the hues. Linear light, 65535
/// for 1.
pub(super) fn own_color(number: u32) -> [f32; 3] {
    hue((number as f32 * 0.618_034).fract())
}

/// From blue to red for a share from 0 to 1.
pub(super) fn from_far_to_near(share: f32) -> [f32; 3] {
    hue(2.0 / 3.0 * (1.0 - share.clamp(0.0, 1.0)))
}

/// A full colour of a hue from 0 to 1.
fn hue(hue: f32) -> [f32; 3] {
    [0.0, 4.0, 2.0].map(|offset| {
        let around = (hue * 6.0 + offset) % 6.0;
        (((around - 3.0).abs() - 1.0).clamp(0.0, 1.0) * 0.85 + 0.1) * 65535.0
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn neighbours_differ_and_far_is_blue() {
        for number in 0..40 {
            let (a, b) = (own_color(number), own_color(number + 1));
            assert!((0..3).map(|c| (a[c] - b[c]).abs()).sum::<f32>() > 20_000.0);
        }
        let brightest = |[r, g, b]: [f32; 3]| {
            if r > g && r > b {
                'r'
            } else if g > b {
                'g'
            } else {
                'b'
            }
        };
        assert_eq!(
            [0.0, 0.5, 1.0].map(|share| brightest(from_far_to_near(share))),
            ['b', 'g', 'r']
        );
    }
}
