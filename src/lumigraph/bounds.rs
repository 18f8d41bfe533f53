//! Numbers of images and layers that a view needs: the sampling curve and the error of a layer (L1,
//! L2, L3; C18, C22).
//!
//! A layer contains surfaces in a range of disparity (1 / depth beyond the camera plane) and is
//! drawn at one disparity. In the image of a camera at distance `s` from the crossing of a ray and
//! the plane, a surface of disparity `d` is then displaced by `f s |d - drawn|` on the image plane.
//! The middle of the range is best, and two neighbouring cameras, `spacing` apart, disagree by at
//! most `f spacing (max - min) / 2` (Eq. 4). Lengths on the image plane and the focal length
//! `focal` are in one unit of the caller's choice (pixels, say), spacings and disparities in
//! another and its inverse.

/// Returns the disparity at which a layer is best drawn: the middle of its *disparities*, not of
/// its depths (Eq. 2, C22).
pub fn optimal_disparity([min, max]: [f64; 2]) -> f64 {
    0.5 * (min + max)
}

/// Returns the finest detail in a frame, on the image plane: the maximum of an image's pixel, a
/// frame's pixel and, if known, half the period of the highest frequency (Eq. 1; without it Eq. 3).
pub fn detail(image_pixel: f64, frame_pixel: f64, highest_frequency: Option<f64>) -> f64 {
    let period = highest_frequency.map_or(0.0, |frequency| 0.5 / frequency);
    image_pixel.max(frame_pixel).max(period)
}

/// Returns the widest camera spacing without aliasing for layers of disparity width `width` (Eq. 1,
/// 3 and 7). Infinite for zero width.
pub fn max_spacing(focal: f64, width: f64, detail: f64) -> f64 {
    2.0 * detail / (focal * width)
}

/// Returns the number of layers, uniform in disparity, that a range needs (Eq. 6 in 7), as a real
/// number: the minimum sampling curve. Per axis: the number of layers falls with the cameras along
/// an axis, and so with the square root of the images of a grid.
pub fn min_layers(focal: f64, [min, max]: [f64; 2], spacing: f64, detail: f64) -> f64 {
    focal * spacing * (max - min) / (2.0 * detail)
}

/// Bound on the error of a layer in a frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ErrorBound {
    /// Focal length of the frame, in the unit of `tolerance`.
    pub focal: f64,
    /// Distance between neighbouring cameras.
    pub spacing: f64,
    /// Distance of the eye behind the camera plane; negative in front of it.
    pub behind: f64,
    /// Largest allowed disagreement of neighbouring cameras, on the frame's image plane.
    pub tolerance: f64,
}

impl ErrorBound {
    /// Returns the largest distance in the frame between two neighbouring cameras' images of a
    /// point of a layer (Eq. 8, C18). Exact for eyes behind the plane, on it, and in front of it
    /// while the whole layer is in front of the eye; infinite otherwise.
    pub fn error(&self, [min, max]: [f64; 2]) -> f64 {
        if 1.0 + max * self.behind <= 0.0 {
            return f64::INFINITY;
        }
        self.focal * self.spacing * (max - min) / (2.0 + (max + min) * self.behind)
    }

    /// Returns true if the error of a layer is within the tolerance ("not larger", as in the text:
    /// C20).
    pub fn allows(&self, range: [f64; 2]) -> bool {
        self.error(range) <= self.tolerance
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Position at which an eye at (`eye`, `behind` the plane) sees a point of disparity `d` above
    /// `x` through the camera at `camera`, if it is drawn at disparity `drawn`: by similar
    /// triangles, without the formulas above.
    fn seen_at(camera: f64, x: f64, d: f64, drawn: f64, eye: f64, behind: f64, focal: f64) -> f64 {
        let along = camera + (x - camera) / (1.0 / d) * (1.0 / drawn);
        focal * (along - eye) / (1.0 / drawn + behind)
    }

    proptest! {
        #[test]
        fn error_reaches_bound_at_layer_ends(
            near in 0.5..5.0f64, depth in 0.1..20.0f64, spacing in 0.01..2.0f64, share in 0.0..1.0f64,
            eye in -3.0..3.0f64, x in -5.0..5.0f64, behind in -0.45..30.0f64, focal in 0.5..2000.0f64,
        ) {
            let range = [1.0 / (near + depth), 1.0 / near];
            let bound = ErrorBound { focal, spacing, behind, tolerance: 1.0 };
            let drawn = optimal_disparity(range);
            let apart = |d: f64| {
                let seen = [0.0, spacing].map(|camera| seen_at(camera, x, d, drawn, eye, behind, focal));
                (seen[1] - seen[0]).abs()
            };
            let error = bound.error(range);
            for end in range {
                prop_assert!((apart(end) - error).abs() <= 1e-9 * error, "{} and {error}", apart(end));
            }
            prop_assert!(apart(range[0] + share * (range[1] - range[0])) <= error * (1.0 + 1e-9));
        }

        #[test]
        fn curve_error_on_plane_equals_detail(
            spacing in 0.01..2.0f64, min in 0.0..2.0f64, width in 0.01..3.0f64, focal in 1.0..1000.0f64, pixel in 0.1..4.0f64,
        ) {
            let range = [min, min + width];
            let layers = min_layers(focal, range, spacing, pixel);
            let one = [min, min + width / layers];
            let bound = ErrorBound { focal, spacing, behind: 0.0, tolerance: pixel };
            prop_assert!((bound.error(one) - pixel).abs() < 1e-9 * pixel);
            prop_assert!((max_spacing(focal, width / layers, pixel) - spacing).abs() < 1e-9 * spacing);
            // Twice the spacing, twice the layers.
            prop_assert!((min_layers(focal, range, 2.0 * spacing, pixel) / layers - 2.0).abs() < 1e-9);
        }

        #[test]
        fn no_disparity_is_better_than_the_middle(min in 0.0..2.0f64, width in 0.01..3.0f64, off in -1.0..1.0f64) {
            let range = [min, min + width];
            let worst = |drawn: f64| range.iter().map(|d| (d - drawn).abs()).fold(0.0, f64::max);
            prop_assert!(worst(optimal_disparity(range)) <= worst(min + width * (0.5 + off)) + 1e-12);
        }

        #[test]
        fn wider_layer_never_errs_less(
            min in 0.01..2.0f64, width in 0.0..3.0f64, more in 0.0..1.0f64, behind in -0.15..30.0f64,
        ) {
            let bound = ErrorBound { focal: 1.0, spacing: 1.0, behind, tolerance: 1.0 };
            let error = bound.error([min, min + width]);
            prop_assert!(bound.error([min, min + width + more]) >= error * (1.0 - 1e-12));
            prop_assert!(bound.error([(min - more).max(0.0), min + width]) >= error * (1.0 - 1e-12));
        }
    }

    /// The paper's table 4: UV plane, ST plane, F, depths.
    const SCENES: [[f64; 5]; 3] = [
        [200.0, 100.0, 160.0, 183.4, 308.8],
        [400.0, 200.0, 300.0, 232.6, 581.8],
        [80.0, 40.0, 60.0, 35.4, 134.0],
    ];

    #[test]
    fn paper_scenes_need_derived_layers() {
        let layers = [[22.7, 7.6, 3.2], [49.5, 16.5, 7.1], [79.8, 26.6, 11.4]];
        let cameras = [23.7, 50.5, 80.8];
        for (([uv, st, f, near, far], layers), cameras) in
            SCENES.into_iter().zip(layers).zip(cameras)
        {
            let (range, pixel) = ([1.0 / far, 1.0 / near], uv / 256.0);
            for (m, derived) in [2.0, 4.0, 8.0].into_iter().zip(layers) {
                let found = min_layers(f, range, st / (m - 1.0), pixel);
                assert!((found - derived).abs() < 0.05, "{found} for {derived}");
            }
            // A single layer for the whole range (Eq. 3).
            let found = st / max_spacing(f, range[1] - range[0], pixel) + 1.0;
            assert!((found - cameras).abs() < 0.05, "{found} for {cameras}");
        }
    }

    #[test]
    fn layer_at_or_behind_eye_exceeds_bound() {
        let bound = ErrorBound {
            focal: 1.0,
            spacing: 1.0,
            behind: -2.0,
            tolerance: 1e9,
        };
        assert!(bound.allows([0.1, 0.4]));
        for passed in [[0.1, 0.5], [0.4, 0.6], [0.6, 0.7]] {
            assert!(!bound.allows(passed), "{passed:?}");
        }
        assert_eq!(detail(1.0, 2.0, Some(0.1)), 5.0);
        assert_eq!(detail(1.0, 0.5, None), 1.0);
        assert_eq!(max_spacing(100.0, 0.0, 1.0), f64::INFINITY);
    }
}
