//! Overlays of lumigraphs: the layers and cameras behind each pixel.

use serde::Serialize;

/// Content of a frame.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum LumigraphOverlay {
    /// The scene.
    #[default]
    Colors,
    /// Stored layer of each pixel, from blue (farthest) to red (nearest).
    Layers,
    /// Merged layers of the frame, each in its own colour.
    Merged,
    /// Cameras from which a pixel is blended, each in its own colour.
    Cameras,
}

headbox_core::named_variants!(LumigraphOverlay {
    Colors => "none",
    Layers => "layer",
    Merged => "merged layers",
    Cameras => "camera",
});

/// Returns the palette colour of a number: hues in steps of the golden ratio. Linear light, 65535
/// for 1.
pub(super) fn palette_color(number: u32) -> [f32; 3] {
    hue((number as f32 * 0.618_034).fract())
}

/// Returns the colour of a relative depth, from blue at 0 (far) to red at 1 (near).
pub(super) fn depth_color(share: f32) -> [f32; 3] {
    hue(2.0 / 3.0 * (1.0 - share.clamp(0.0, 1.0)))
}

/// Returns the saturated colour of a hue from 0 to 1.
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
            let (a, b) = (palette_color(number), palette_color(number + 1));
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
            [0.0, 0.5, 1.0].map(|share| brightest(depth_color(share))),
            ['b', 'g', 'r']
        );
    }
}
