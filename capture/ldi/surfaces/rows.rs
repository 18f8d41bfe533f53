//! Slices by rows of a face, so that each row is written by one thread.

use rayon::prelude::*;

/// Splits a slice into consecutive pieces of the given lengths, from its beginning. They must fit.
pub(crate) fn split_lengths<T>(
    mut slice: &mut [T],
    lengths: impl IntoIterator<Item = usize>,
) -> Vec<&mut [T]> {
    let piece = |length| {
        let (piece, rest) = std::mem::take(&mut slice).split_at_mut(length);
        slice = rest;
        piece
    };
    lengths.into_iter().map(piece).collect()
}

/// Elements of a face in one row of pixels: the index of the first in the whole face, and the row.
pub(crate) type Row<'a, T> = (usize, &'a mut [T]);

/// Splits `all` into the rows of a face of `size_px` pixels. `offsets` are the prefix sums of the
/// face's pixels.
pub(crate) fn split_rows<'a, T>(
    offsets: &[u32],
    size_px: u32,
    all: &'a mut [T],
) -> Vec<Row<'a, T>> {
    let starts: Vec<usize> = offsets
        .iter()
        .step_by(size_px.max(1) as usize)
        .map(|&offset| offset as usize)
        .collect();
    let lengths = starts.windows(2).map(|ends| ends[1] - ends[0]);
    starts
        .iter()
        .copied()
        .zip(split_lengths(all, lengths))
        .collect()
}

/// Concatenates rows in parallel, into memory that was not touched before.
pub(crate) fn concat<T: Copy + Send + Sync + bytemuck::Zeroable, R: Sync>(
    rows: &[R],
    row: impl Fn(&R) -> &[T] + Sync,
) -> Vec<T> {
    let mut all = bytemuck::zeroed_vec(rows.iter().map(|r| row(r).len()).sum());
    let pieces = split_lengths(&mut all, rows.iter().map(|r| row(r).len()));
    pieces
        .into_par_iter()
        .zip(rows)
        .for_each(|(piece, r)| piece.copy_from_slice(row(r)));
    all
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn face_splits_into_rows_by_offsets() {
        // 3x3 pixels with 1, 0, 2 | 0, 0, 0 | 3, 1, 0 elements.
        let offsets = [0, 1, 1, 3, 3, 3, 3, 6, 7, 7];
        let mut all = [0, 1, 2, 3, 4, 5, 6];
        let rows: Vec<(usize, Vec<i32>)> = split_rows(&offsets, 3, &mut all)
            .into_iter()
            .map(|(start, row)| (start, row.to_vec()))
            .collect();
        assert_eq!(
            rows,
            [(0, vec![0, 1, 2]), (3, vec![]), (3, vec![3, 4, 5, 6])]
        );
        assert!(
            split_rows(&[0], 0, &mut [0; 0]).is_empty(),
            "a face without pixels"
        );
    }

    #[test]
    fn rows_concatenate_in_order() {
        let rows: Vec<Vec<u32>> = (0..40)
            .map(|y| (0..y * 7 % 11).map(|x| 100 * y + x).collect())
            .collect();
        assert_eq!(concat(&rows, |row| row), rows.concat());
        assert!(concat(&[] as &[Vec<u32>], |row| row).is_empty());
        let mut all: Vec<u32> = (0..10).collect();
        assert_eq!(
            split_lengths(&mut all, [2, 0, 5]),
            [&[0, 1][..], &[], &[2, 3, 4, 5, 6]],
            "the rest is not split"
        );
    }
}
