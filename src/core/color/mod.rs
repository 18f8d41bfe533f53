//! Conversion between sRGB and linear light, and luminance.

pub mod exposure;
pub mod srgb_table;
pub mod tone;

/// Converts an 8-bit sRGB value to linear light.
pub fn linear_from_srgb8(value: u8) -> f32 {
    LINEAR_FROM_SRGB8[usize::from(value)]
}

/// Returns the table of [`linear_from_srgb8`] for all values.
pub fn linear_levels() -> &'static [f32; 256] {
    &LINEAR_FROM_SRGB8
}

/// Converts an sRGB value in 0..=1 to linear light; values outside are clamped, NaN becomes 0.
pub fn linear_from_srgb(value: f32) -> f32 {
    let x = if value > 0.0 { value.min(1.0) } else { 0.0 };
    if x <= 0.040_45 {
        x / 12.92
    } else {
        ((x + 0.055) / 1.055).powf(2.4)
    }
}

/// Converts linear light (clamped to 0..1; NaN becomes 0) to the nearest 8-bit sRGB value.
pub fn srgb8_from_linear(linear: f32) -> u8 {
    let x = if linear > 0.0 { linear.min(1.0) } else { 0.0 };
    let encoded = if x <= 0.003_130_8 {
        12.92 * x
    } else {
        1.055 * x.powf(1.0 / 2.4) - 0.055
    };
    (encoded * 255.0 + 0.5) as u8
}

static LINEAR_FROM_SRGB8: std::sync::LazyLock<[f32; 256]> = std::sync::LazyLock::new(|| {
    std::array::from_fn(|i| {
        let x = i as f64 / 255.0;
        let linear = if x <= 0.040_45 {
            x / 12.92
        } else {
            ((x + 0.055) / 1.055).powf(2.4)
        };
        linear as f32
    })
});

/// Rec. 709 weights of linear RGB in [`luminance`].
pub const LUMINANCE: [f32; 3] = [0.2126, 0.7152, 0.0722];

/// Returns the Rec. 709 luminance of linear RGB.
#[inline]
pub fn luminance([r, g, b]: [f32; 3]) -> f32 {
    LUMINANCE[0] * r + LUMINANCE[1] * g + LUMINANCE[2] * b
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn srgb_round_trips_every_value() {
        for value in 0..=255 {
            assert_eq!(srgb8_from_linear(linear_from_srgb8(value)), value);
            assert_eq!(
                srgb8_from_linear(linear_from_srgb(f32::from(value) / 255.0)),
                value
            );
        }
        assert_eq!(srgb8_from_linear(f32::NAN), 0);
        assert_eq!(srgb8_from_linear(9.0), 255);
    }
}
