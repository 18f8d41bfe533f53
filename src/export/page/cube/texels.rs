//! Texels of pictures on planes as what they are more than their neighbours.

use crate::packed::PlaneSet;

/// Green, red - green and blue - green of each texel, one after the other, then the alphas of the pictures that are not opaque: each
/// less that of the texel on the left or, in the first column, above.
pub(super) fn rests(set: &PlaneSet) -> Vec<u8> {
    let (mut colors, mut alphas) = (vec![0; set.texels.len() * 3], Vec::new());
    for tile in &set.tiles {
        let width = usize::from(tile.width);
        let texels = &set.texels[tile.texel_range()];
        for (i, texel) in texels.iter().enumerate() {
            let beside = match i % width {
                0 => i.checked_sub(width).map_or([0; 4], |above| texels[above]),
                _ => texels[i - 1],
            };
            let [r, g, b, a] = [0, 1, 2, 3].map(|c| texel[c].wrapping_sub(beside[c]));
            let to = (tile.first_texel as usize + i) * 3;
            colors[to..to + 3].copy_from_slice(&[g, r.wrapping_sub(g), b.wrapping_sub(g)]);
            if tile.opaque == 0 {
                alphas.push(a);
            }
        }
    }
    colors.extend(alphas);
    colors
}
