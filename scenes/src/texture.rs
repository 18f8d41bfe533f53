//! Procedural textures that repeat without a seam.

use headbox_core::random::{hash, unit};
use headbox_scene::material::Texture;

/// Creates a texture. `color(u, v)` returns the sRGB colour (0..1) at the centre of a texel, u to
/// the right and v up, both in 0..1.
pub(crate) fn paint(width: u32, height: u32, color: impl Fn(f64, f64) -> [f64; 3]) -> Texture {
    Texture::from_fn(width, height, |x, y| {
        let u = (f64::from(x) + 0.5) / f64::from(width);
        let v = 1.0 - (f64::from(y) + 0.5) / f64::from(height);
        let [r, g, b] = color(u, v).map(|c| (c.clamp(0.0, 1.0) * 255.0 + 0.5) as u8);
        [r, g, b, 255]
    })
}

/// Creates a checkerboard of `columns` by `rows` fields.
pub(crate) fn checkerboard(
    [width, height]: [u32; 2],
    [columns, rows]: [f64; 2],
    a: [f64; 3],
    b: [f64; 3],
) -> Texture {
    paint(width, height, |u, v| {
        if ((u * columns).floor() + (v * rows).floor()) % 2.0 == 0.0 {
            a
        } else {
            b
        }
    })
}

/// Interpolates colours linearly from `a` (`t` = 0) to `b` (`t` = 1).
pub(crate) fn mix(a: [f64; 3], b: [f64; 3], t: f64) -> [f64; 3] {
    std::array::from_fn(|c| a[c] + (b[c] - a[c]) * t)
}

/// Scales a colour.
pub(crate) fn shade(color: [f64; 3], factor: f64) -> [f64; 3] {
    color.map(|c| c * factor)
}

/// Evaluates smooth value noise in 0..1 with period 1 in both directions and `columns` by `rows`
/// random values per period.
pub(crate) fn noise(u: f64, v: f64, columns: u32, rows: u32, seed: u64) -> f64 {
    let lattice = |t: f64, count: u32| {
        let x = t.rem_euclid(1.0) * f64::from(count);
        let cell = x.floor();
        let fraction = x - cell;
        (
            cell as u64 % u64::from(count),
            (cell as u64 + 1) % u64::from(count),
            fraction * fraction * (3.0 - 2.0 * fraction),
        )
    };
    let (x0, x1, fx) = lattice(u, columns);
    let (y0, y1, fy) = lattice(v, rows);
    let value = |x: u64, y: u64| unit(hash(hash(seed ^ (y << 32)) ^ x));
    let row = |y: u64| value(x0, y) * (1.0 - fx) + value(x1, y) * fx;
    row(y0) * (1.0 - fy) + row(y1) * fy
}

/// Sums four octaves of [`noise`]; in 0..1.
pub(crate) fn fractal(u: f64, v: f64, columns: u32, rows: u32, seed: u64) -> f64 {
    let octave =
        |k: u32| noise(u, v, columns << k, rows << k, seed + u64::from(k)) / f64::from(1_u32 << k);
    (0..4).map(octave).sum::<f64>() / 1.875
}
