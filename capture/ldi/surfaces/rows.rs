//! Slices by rows, so that each is written by one thread.

use rayon::prelude::*;

/// The pieces of a slice that have these lengths, one after the other from its beginning; they must fit into it.
pub(crate) fn pieces<T>(
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

/// What a face has in a row of pixels: where it starts in all that the face has, and the row.
pub(crate) type Row<'a, T> = (usize, &'a mut [T]);

/// What `all` holds for each row of `size_px` pixels of a face, whose `offsets` are those of a face's pixels.
pub(crate) fn of_face<'a, T>(offsets: &[u32], size_px: u32, all: &'a mut [T]) -> Vec<Row<'a, T>> {
    let starts: Vec<usize> = offsets
        .iter()
        .step_by(size_px.max(1) as usize)
        .map(|&offset| offset as usize)
        .collect();
    let lengths = starts.windows(2).map(|ends| ends[1] - ends[0]);
    starts.iter().copied().zip(pieces(all, lengths)).collect()
}

/// Puts rows one after the other, side by side in memory that nothing has touched yet.
pub(crate) fn concat<T: Copy + Send + Sync + bytemuck::Zeroable, R: Sync>(
    rows: &[R],
    row: impl Fn(&R) -> &[T] + Sync,
) -> Vec<T> {
    let mut all = bytemuck::zeroed_vec(rows.iter().map(|of| row(of).len()).sum());
    let pieces = pieces(&mut all, rows.iter().map(|of| row(of).len()));
    pieces
        .into_par_iter()
        .zip(rows)
        .for_each(|(piece, of)| piece.copy_from_slice(row(of)));
    all
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_faces_rows_are_what_its_offsets_say() {
        // 3x3 pixels that hold 1, 0, 2 | 0, 0, 0 | 3, 1, 0 things.
        let offsets = [0, 1, 1, 3, 3, 3, 3, 6, 7, 7];
        let mut all = [0, 1, 2, 3, 4, 5, 6];
        let rows: Vec<(usize, Vec<i32>)> = of_face(&offsets, 3, &mut all)
            .into_iter()
            .map(|(start, row)| (start, row.to_vec()))
            .collect();
        assert_eq!(
            rows,
            [(0, vec![0, 1, 2]), (3, vec![]), (3, vec![3, 4, 5, 6])]
        );
        assert!(
            of_face(&[0], 0, &mut [0; 0]).is_empty(),
            "a face without pixels"
        );
    }

    #[test]
    fn rows_follow_each_other() {
        let rows: Vec<Vec<u32>> = (0..40)
            .map(|y| (0..y * 7 % 11).map(|x| 100 * y + x).collect())
            .collect();
        assert_eq!(concat(&rows, |row| row), rows.concat());
        assert!(concat(&[] as &[Vec<u32>], |row| row).is_empty());
        let mut all: Vec<u32> = (0..10).collect();
        assert_eq!(
            pieces(&mut all, [2, 0, 5]),
            [&[0, 1][..], &[], &[2, 3, 4, 5, 6]],
            "and the rest is left"
        );
    }
}
