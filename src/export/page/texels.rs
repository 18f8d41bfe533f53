//! Texels of pictures on planes as what is left of a prediction.

use crate::packed::PlaneSet;

/// Green, red - green and blue - green of all texels, then the alphas of the pictures that are not opaque: each less what its
/// neighbours let one expect (MED of JPEG-LS).
pub(super) fn rests(set: &PlaneSet) -> Vec<u8> {
    let count = set.texels.len();
    let mut rests = vec![0; count * 3];
    for tile in &set.tiles {
        let width = usize::from(tile.width);
        let texels = &set.texels[tile.texel_range()];
        for i in 0..texels.len() {
            let rest = [0, 1, 2].map(|channel| rest(texels, i, width, channel));
            let at = tile.first_texel as usize + i;
            rests[at] = rest[1];
            rests[count + at] = rest[0].wrapping_sub(rest[1]);
            rests[2 * count + at] = rest[2].wrapping_sub(rest[1]);
        }
        if tile.opaque == 0 {
            rests.extend((0..texels.len()).map(|i| rest(texels, i, width, 3)));
        }
    }
    rests
}

fn rest(texels: &[[u8; 4]], i: usize, width: usize, channel: usize) -> u8 {
    let (has_left, has_above) = (!i.is_multiple_of(width), i >= width);
    let expected = match (has_left, has_above) {
        (false, false) => 0,
        (false, true) => texels[i - width][channel],
        (true, false) => texels[i - 1][channel],
        (true, true) => {
            let (left, above) = (i32::from(texels[i - 1][channel]), i32::from(texels[i - width][channel]));
            (left + above - i32::from(texels[i - width - 1][channel])).clamp(left.min(above), left.max(above)) as u8
        }
    };
    texels[i][channel].wrapping_sub(expected)
}
