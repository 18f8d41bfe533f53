//! Textures at a lower resolution, to fit a budget of bytes.

use super::TexturedQuads;
use super::atlas::AtlasPicture;
use rayon::prelude::*;

/// Returns charts whose textures have about 1 / `scale` of the width and height.
pub(super) fn charts(charts: &[TexturedQuads], scale: f64) -> Vec<TexturedQuads> {
    let resampled = |chart: &TexturedQuads| {
        let AtlasPicture { width, height, .. } = chart.picture;
        let axes = [width, height].map(|length| Axis::new(length, scale));
        let mut quads = chart.quads.clone();
        for at in quads.iter_mut().flat_map(|quad| &mut quad.texels) {
            *at = [axes[0].position(at[0]), axes[1].position(at[1])];
        }
        TexturedQuads {
            picture: picture(&chart.picture, &axes),
            quads,
            ..*chart
        }
    };
    charts.par_iter().map(resampled).collect()
}

/// Texels of a picture along one axis: those inside are resampled, the border of one texel remains,
/// for quadrilaterals reach a little over their samples.
struct Axis {
    /// Number of texels of the resampled picture.
    length: usize,
    /// Texels of the picture per texel of the resampled one.
    step: f64,
}

impl Axis {
    fn new(length: usize, scale: f64) -> Self {
        let inside = length.saturating_sub(2).max(1) as f64;
        let count = (inside / scale).ceil().max(1.0);
        Self {
            length: count as usize + 2,
            step: inside / count,
        }
    }

    /// Returns where a position of the picture is in the resampled one, texels.
    fn position(&self, at: f64) -> f64 {
        1.0 + (at - 1.0) / self.step
    }

    /// Returns the texels of the picture that texel `i` of the resampled one covers, each with its
    /// share.
    fn texels(&self, i: usize, length: usize) -> Vec<(usize, f64)> {
        let start = 1.0 + (i as f64 - 1.0) * self.step;
        let end = (start + self.step).min(length as f64);
        let start = start.max(0.0);
        let (first, last) = (start as usize, (end.ceil() as usize).min(length));
        let share = |at: usize| (end.min(at as f64 + 1.0) - start.max(at as f64)).max(0.0);
        (first..last).map(|at| (at, share(at))).collect()
    }
}

/// Averages texels over areas; colours by coverage.
fn picture(picture: &AtlasPicture, [columns, rows]: &[Axis; 2]) -> AtlasPicture {
    let across: Vec<_> = (0..columns.length)
        .map(|i| columns.texels(i, picture.width))
        .collect();
    let mut texels = Vec::with_capacity(columns.length * rows.length);
    for j in 0..rows.length {
        let down = rows.texels(j, picture.height);
        texels.extend(across.iter().map(|across| {
            let (mut color, mut covered, mut alpha, mut area) = ([0.0; 3], 0.0, 0.0, 0.0);
            for (y, height) in &down {
                for (x, width) in across {
                    let [r, g, b, a] = picture.texels[y * picture.width + x].map(f64::from);
                    let share = width * height;
                    // Transparent texels have the colours of their neighbours, and decide alone.
                    let weight = share * (a + 1e-3);
                    color = [
                        color[0] + r * weight,
                        color[1] + g * weight,
                        color[2] + b * weight,
                    ];
                    covered += weight;
                    alpha += a * share;
                    area += share;
                }
            }
            let [r, g, b] = color.map(|c| (c / covered).round() as u8);
            [r, g, b, (alpha / area).round() as u8]
        }));
    }
    AtlasPicture {
        width: columns.length,
        height: rows.length,
        texels,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn texels_stay_where_they_are() {
        // A ramp along x, and along y, with a border.
        let (width, height) = (26, 14);
        let chart = TexturedQuads {
            picture: AtlasPicture {
                width,
                height,
                texels: (0..width * height)
                    .map(|i| [(i % width) as u8 * 8, (i / width) as u8 * 8, 0, 255])
                    .collect(),
            },
            quads: Vec::new(),
            opaque: true,
            samples: 1,
        };
        for scale in [1.0, 1.5, 2.0, 3.7] {
            let found = &charts(std::slice::from_ref(&chart), scale)[0].picture;
            let axes = [width, height].map(|length| Axis::new(length, scale));
            assert_eq!(
                [found.width, found.height],
                [axes[0].length, axes[1].length]
            );
            for y in 2..height - 2 {
                for x in 2..width - 2 {
                    let at = [
                        axes[0].position(x as f64 + 0.5) - 0.5,
                        axes[1].position(y as f64 + 0.5) - 0.5,
                    ];
                    let level = |channel: usize| {
                        let mut sum = 0.0;
                        for (i, j) in [(0, 0), (1, 0), (0, 1), (1, 1)] {
                            let [cx, cy] = [at[0].floor() as usize + i, at[1].floor() as usize + j];
                            let share =
                                |c: f64, i: usize| if i == 1 { c.fract() } else { 1.0 - c.fract() };
                            let texel = found.texels[cy * found.width + cx][channel];
                            sum += f64::from(texel) * share(at[0], i) * share(at[1], j);
                        }
                        sum
                    };
                    // Linear filtering of averages restores a ramp, but for rounding and the
                    // border, which is narrower than a texel inside.
                    let near_rim = x < 6 || x > width - 7 || y < 6 || y > height - 7;
                    let tolerance = if near_rim { 12.0 } else { 1.0 };
                    assert!(
                        (level(0) - x as f64 * 8.0).abs() <= tolerance,
                        "{scale}: {x}"
                    );
                    assert!(
                        (level(1) - y as f64 * 8.0).abs() <= tolerance,
                        "{scale}: {y}"
                    );
                }
            }
            assert!(found.texels.iter().all(|texel| texel[3] == 255));
        }
    }
}
