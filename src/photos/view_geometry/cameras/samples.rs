//! Sparse points of depth images: a grid through a median filter (E4), sorted by level of detail
//! (E5).
//!
//! Invariant: the samples of level of detail n, which are those of all levels n and above (C25),
//! are the first of the list. So drawing many cameras coarsely reads only the beginning of each
//! list.

use glam::{DVec3, Vec3};
use headbox_core::container::StoredSection;
use headbox_images::LoadedView;
use std::ops::Range;
use std::sync::atomic::{AtomicBool, Ordering};

/// Point samples of a depth image.
#[derive(Debug, Default)]
pub(crate) struct Samples {
    /// Points relative to the sample origin, metres; coarsest level first, rows from top to bottom
    /// within a level.
    points: PointStorage,
    /// Number of points of each level of detail, the finest first.
    counts: Vec<u32>,
    probes: Probes,
}

/// Storage of the points, one array per axis.
#[derive(Debug)]
enum PointStorage {
    Memory([Vec<f32>; 3]),
    Disk(StoredPoints),
}

/// Points of a camera in a file that also holds other cameras.
#[derive(Debug)]
struct StoredPoints {
    axes: [StoredSection; 3],
    points: Range<usize>,
    checksum: u32,
    /// Set once the points were read and found damaged.
    damaged: AtomicBool,
}

impl Default for PointStorage {
    fn default() -> Self {
        Self::Memory(Default::default())
    }
}

/// Coordinates x, y and z of points.
pub(crate) type Points<'a> = [&'a [f32]; 3];

/// At most [`MAX_PROBES`] samples distributed over the image, one array per axis for SIMD
/// projection; NaN where there is none.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Probes {
    pub(crate) axes: [[f32; MAX_PROBES]; 3],
    /// Number of probes.
    pub(crate) count: u32,
}

impl Default for Probes {
    fn default() -> Self {
        Self::new([[f32::NAN; MAX_PROBES]; 3])
    }
}

impl Probes {
    /// Builds probes from their coordinates.
    pub(super) fn new(axes: [[f32; MAX_PROBES]; 3]) -> Self {
        let [x, y, z] = &axes;
        let count = (0..MAX_PROBES)
            .filter(|i| (x[*i] + y[*i] + z[*i]).is_finite())
            .count() as u32;
        Self { axes, count }
    }
}

/// Sampling density of depth images.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SampleGrid {
    /// Distance between samples, pixels; at least 1.
    pub spacing_px: u32,
    /// The coarsest level of detail; level n keeps one in 4^n samples.
    pub coarsest: u32,
}

impl Default for SampleGrid {
    fn default() -> Self {
        Self {
            spacing_px: 3,
            coarsest: 3,
        }
    }
}

/// Columns and rows of the probes, by which a camera's view is compared with the frame's (E6: at
/// most about 20).
const PROBES: [u32; 2] = [5, 4];
/// Maximum number of probes of a camera.
pub(crate) const MAX_PROBES: usize = (PROBES[0] * PROBES[1]) as usize;

impl Samples {
    /// Samples a depth image as points relative to `origin`. There is no sample where less than a
    /// third of the filter window is known: the rim of a hole is not a surface.
    pub(crate) fn new(view: &LoadedView, grid: &SampleGrid, origin: DVec3) -> Self {
        let spacing = grid.spacing_px.max(1);
        let coarsest = grid.coarsest.min(16);
        // From the first to the last pixel, so that the samples reach the image borders.
        let [columns, rows] = view
            .size_px
            .map(|side| side.saturating_sub(1).div_ceil(spacing) + 1);
        let mut levels: Vec<Vec<Vec3>> = vec![Vec::new(); coarsest as usize + 1];
        let mut probes = [None::<(u32, Vec3)>; MAX_PROBES];
        let mut window = Vec::new();
        for (row, column) in (0..rows).flat_map(|row| (0..columns).map(move |column| (row, column)))
        {
            let at = [(column, view.size_px[0]), (row, view.size_px[1])]
                .map(|(number, side)| (number * spacing).min(side - 1));
            let Some(depth) = median_depth(view, at, (spacing / 2).max(1), &mut window) else {
                continue;
            };
            // Depth scales the pixel's ray, whose third component is 1 for a pinhole: eye depth
            // (C24).
            let ray = view
                .lens
                .ray(at.map(|at| f64::from(at) + 0.5), view.size_px);
            let point = (view.pose.to_world(ray * f64::from(depth)) - origin).as_vec3();
            let level = column
                .trailing_zeros()
                .min(row.trailing_zeros())
                .min(coarsest);
            levels[level as usize].push(point);
            let cell =
                [(column, columns, PROBES[0]), (row, rows, PROBES[1])].map(|(at, of, cells)| {
                    let cell = (at * cells / of.max(1)).min(cells - 1);
                    (cell, (2 * at * cells).abs_diff((2 * cell + 1) * of))
                });
            let probe = &mut probes[(cell[1].0 * PROBES[0] + cell[0].0) as usize];
            let off_centre = cell[0].1 + cell[1].1;
            if probe.is_none_or(|(best, _)| off_centre < best) {
                *probe = Some((off_centre, point));
            }
        }
        let mut counts = vec![0; levels.len()];
        let mut points = [0; 3].map(|_| Vec::with_capacity(levels.iter().map(Vec::len).sum()));
        for (level, level_points) in levels.iter().enumerate().rev() {
            (0..3)
                .for_each(|axis| points[axis].extend(level_points.iter().map(|point| point[axis])));
            counts[level] = points[0].len() as u32;
        }
        let mut probe_axes = [[f32::NAN; MAX_PROBES]; 3];
        for (i, (_, point)) in probes.iter().flatten().enumerate() {
            (0..3).for_each(|axis| probe_axes[axis][i] = point[axis]);
        }
        Self {
            points: PointStorage::Memory(points),
            counts,
            probes: Probes::new(probe_axes),
        }
    }

    /// Samples in a file: a range of the points of three sections, and the stored results of
    /// [`Self::counts`], [`Self::probes`] and [`Self::checksum`]. They have no points until
    /// [`Self::read_or`] reads them.
    pub(super) fn stored(
        axes: &[StoredSection; 3],
        points: Range<usize>,
        counts: Vec<u32>,
        probes: Probes,
        checksum: u32,
    ) -> Self {
        let stored = StoredPoints {
            axes: axes.clone(),
            points,
            checksum,
            damaged: AtomicBool::new(false),
        };
        Self {
            points: PointStorage::Disk(stored),
            counts,
            probes,
        }
    }

    /// Computes the checksum of all points.
    pub(super) fn checksum(&self) -> u32 {
        let mut sum = crc32fast::Hasher::new();
        self.of_level(0)
            .iter()
            .for_each(|axis| sum.update(bytemuck::cast_slice(axis)));
        sum.finalize()
    }

    /// Reads stored points into memory, verified by their checksum; those that cannot be read or
    /// are damaged are replaced by `recompute`. `None` if the points are in memory already.
    pub(crate) fn read_or(&self, recompute: impl FnOnce() -> Self) -> Option<Self> {
        let PointStorage::Disk(stored) = &self.points else {
            return None;
        };
        let [x, y, z] = stored
            .axes
            .each_ref()
            .map(|axis| axis.values(stored.points.clone()));
        if let (Ok(x), Ok(y), Ok(z)) = (x, y, z) {
            let read = Self {
                points: PointStorage::Memory([x, y, z]),
                counts: self.counts.clone(),
                probes: self.probes.clone(),
            };
            if read.checksum() == stored.checksum {
                return Some(read);
            }
        }
        stored.damaged.store(true, Ordering::Relaxed);
        Some(recompute())
    }

    /// Returns true if the points are stored and were found damaged.
    pub(crate) fn is_damaged(&self) -> bool {
        match &self.points {
            PointStorage::Memory(_) => false,
            PointStorage::Disk(stored) => stored.damaged.load(Ordering::Relaxed),
        }
    }

    /// Number of samples of each level of detail, the finest first.
    pub(super) fn counts(&self) -> &[u32] {
        &self.counts
    }

    /// Returns the samples of a level of detail, 0 the finest; levels beyond the coarsest give the
    /// coarsest. Points that are still in a file are not among them.
    pub(crate) fn of_level(&self, level: u32) -> Points<'_> {
        let count = self
            .counts
            .get(level as usize)
            .or(self.counts.last())
            .copied()
            .unwrap_or(0) as usize;
        let all: Points = match &self.points {
            PointStorage::Memory(axes) => axes.each_ref().map(Vec::as_slice),
            PointStorage::Disk(_) => [&[]; 3],
        };
        all.map(|axis| axis.get(..count).unwrap_or_default())
    }

    /// Returns points distributed over the whole image.
    pub(crate) fn probes(&self) -> &Probes {
        &self.probes
    }

    /// Bytes in memory, without stored points.
    pub(crate) fn bytes(&self) -> usize {
        let points = match &self.points {
            PointStorage::Memory(axes) => {
                axes.iter().map(|axis| size_of_val(axis.as_slice())).sum()
            }
            PointStorage::Disk(_) => 0,
        };
        points + size_of::<Self>()
    }
}

/// Returns the lower median of the known depths in a window around a pixel; `None` if less than a
/// third are known.
fn median_depth(
    view: &LoadedView,
    [x, y]: [u32; 2],
    radius: u32,
    window: &mut Vec<f32>,
) -> Option<f32> {
    window.clear();
    let range = |at: u32, side: u32| at.saturating_sub(radius)..(at + radius + 1).min(side);
    let (columns, rows) = (range(x, view.size_px[0]), range(y, view.size_px[1]));
    let all = columns.len() * rows.len();
    for row in rows {
        window.extend(
            columns
                .clone()
                .filter_map(|column| view.depth_at(column, row)),
        );
    }
    if window.is_empty() || 3 * window.len() < all {
        return None;
    }
    let middle = (window.len() - 1) / 2;
    Some(*window.select_nth_unstable_by(middle, f32::total_cmp).1)
}

#[cfg(test)]
mod tests {
    use super::*;
    pub(crate) use crate::view_geometry::tests::{grid, make_view, plane_view};

    #[test]
    fn level_of_detail_is_prefix_of_quarter_size() {
        let view = plane_view(DVec3::ZERO, 2.0, [64, 64]);
        let samples = Samples::new(&view, &grid(2, 3), DVec3::ZERO);
        let counts: Vec<usize> = (0..6)
            .map(|level| samples.of_level(level)[0].len())
            .collect();
        assert_eq!(counts, [33 * 33, 17 * 17, 9 * 9, 5 * 5, 25, 25]);
        // Level 1 is what a grid of twice the spacing would hold: every second point in both
        // directions.
        let ([second, ..], [all, ..]) = (samples.of_level(1), samples.of_level(0));
        assert_eq!(second, &all[..17 * 17]);
        let columns: std::collections::BTreeSet<i32> =
            second.iter().map(|x| (x * 1e4) as i32).collect();
        assert_eq!(columns.len(), 17);
        assert_eq!(samples.probes().count as usize, MAX_PROBES);
    }

    #[test]
    fn samples_follow_depth_without_outliers() {
        let depth = |x: u32, y: u32| if (x, y) == (10, 10) { 0.1 } else { 3.0 };
        let view = make_view(DVec3::new(1.0, 2.0, 3.0), depth, |_, _| [9; 3], [48, 32]);
        let samples = Samples::new(&view, &grid(4, 2), DVec3::ONE);
        let [x, _, z] = samples.of_level(0);
        assert_eq!((x.len(), z.len()), (13 * 9, 13 * 9));
        // Looking down -Z from (1, 2, 3), relative to (1, 1, 1).
        assert!(
            z.iter().all(|z| (z - (3.0 - 3.0 - 1.0)).abs() < 1e-5),
            "{z:?}"
        );
    }

    #[test]
    fn holes_have_no_samples() {
        let depth = |x: u32, _| if x < 24 { f32::NAN } else { 2.0 };
        let view = make_view(DVec3::ZERO, depth, |_, _| [9; 3], [48, 32]);
        let samples = Samples::new(&view, &grid(4, 2), DVec3::ZERO);
        assert_eq!(samples.of_level(0)[0].len(), 7 * 9);
        let none = make_view(DVec3::ZERO, |_, _| f32::NAN, |_, _| [9; 3], [48, 32]);
        let samples = Samples::new(&none, &SampleGrid::default(), DVec3::ZERO);
        assert!(samples.of_level(0)[0].is_empty() && samples.probes().count == 0);
        let tiny = make_view(DVec3::ZERO, |_, _| 1.0, |_, _| [9; 3], [2, 1]);
        assert_eq!(
            Samples::new(&tiny, &SampleGrid::default(), DVec3::ZERO).of_level(0)[0].len(),
            2
        );
    }
}
