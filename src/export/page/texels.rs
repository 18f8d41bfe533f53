//! Predictive encoding of texels (`texels.js` decodes it).

use std::ops::Range;

/// Image in a shared array of texels.
pub(super) struct TexelImage {
    /// Range of its texels, row by row.
    pub(super) texels: Range<usize>,
    pub(super) width: usize,
    /// True to omit its alpha.
    pub(super) opaque: bool,
}

/// Encodes green, red - green and blue - green of each texel, one after the other, then the alphas
/// of images that are not opaque. Each value is the difference from the texel on the left or, in
/// the first column, above.
pub(super) fn residuals(
    texels: &[[u8; 4]],
    pictures: impl IntoIterator<Item = TexelImage>,
) -> Vec<u8> {
    let (mut colors, mut alphas) = (vec![0; texels.len() * 3], Vec::new());
    for TexelImage {
        texels: range,
        width,
        opaque,
    } in pictures
    {
        let first = range.start;
        let texels = &texels[range];
        for (i, texel) in texels.iter().enumerate() {
            let neighbour = match i % width {
                0 => i.checked_sub(width).map_or([0; 4], |above| texels[above]),
                _ => texels[i - 1],
            };
            let [r, g, b, a] = [0, 1, 2, 3].map(|c| texel[c].wrapping_sub(neighbour[c]));
            let to = (first + i) * 3;
            colors[to..to + 3].copy_from_slice(&[g, r.wrapping_sub(g), b.wrapping_sub(g)]);
            if !opaque {
                alphas.push(a);
            }
        }
    }
    colors.extend(alphas);
    colors
}
