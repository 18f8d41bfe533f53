//! A camera that looks along a face's axis: its view of the face is known in closed form.
//!
//! With the eye at (ex, ey, ez) in the face's axes, z toward the face, a sample of inverse
//! depth q at (dx, dy) of the face (-1 to 1) lies at `f (dx - q ex) / w` from the principal
//! point, w = 1 - q ez. So the side at L px is at `dx = L / f w + q ex`, which is linear in q.

use super::*;
use crate::model::samples::CubeSamples;
use crate::pack::tests::{ldi, sample, scattered};
use crate::pack::{CubeLdi, SplatIndexLayout, Split};
use crate::render::footprint::size::StampSize;
use headbox_core::cube_face::Face;
use headbox_core::random::Rng;

const FACE: Face = Face::NegX;
const FACE_PX: u32 = 200;

/// Builds an LDI with one sample in each pixel of a rectangle, nearer to the right and in the
/// lower half.
fn sloped_ldi() -> CubeSamples {
    ldi(FACE_PX, |face, x, y| {
        let q = 0.3 + 0.004 * f64::from(x) + if y > 100 { 0.25 } else { 0.0 };
        let inside = face == FACE && (21..170).contains(&x) && (13..181).contains(&y);
        if inside {
            vec![sample(&mut Rng::keyed(1), face, q)]
        } else {
            Vec::new()
        }
    })
}

struct AxisView {
    eye: DVec3,
    focal_px: f64,
    transfer: Transfer,
    band: Band,
}

impl AxisView {
    /// Creates a band of a frame of 90 x 70 pixels with an off-centre principal point.
    fn new(eye: [f64; 3], fov_deg: f64, rows: Range<u32>) -> Self {
        let axes = [FACE.right(), FACE.up(), FACE.normal()];
        let position: DVec3 = axes
            .iter()
            .zip(eye)
            .map(|(axis, along)| *axis * along)
            .sum();
        let target = position + FACE.normal();
        let camera = Camera::look_at(position, target, FACE.up(), fov_deg, [90, 70])
            .expect("valid")
            .with_principal_px([37.0, 41.0]);
        Self {
            eye: DVec3::from(eye),
            focal_px: camera.focal_px(),
            transfer: Transfer::new(&camera, position, FACE, FACE_PX),
            band: Band::new(&camera, rows),
        }
    }

    /// Returns the left, right, upper and lower side of the band, widened by a radius: px from
    /// the principal point over the focal length.
    fn sides(&self, radius_px: f64) -> [f64; 4] {
        let rows = [self.band.rows.start, self.band.rows.end].map(f64::from);
        [
            -37.0 - radius_px,
            53.0 + radius_px,
            rows[0] - 41.0 - radius_px,
            rows[1] - 41.0 + radius_px,
        ]
        .map(|side| side / self.focal_px)
    }

    /// Returns the columns and rows on the face, px, of the band's sides at an inverse depth.
    fn face_sides(&self, radius_px: f64, q: f64) -> [f64; 4] {
        let w = 1.0 - q * self.eye.z;
        let half = f64::from(FACE_PX) / 2.0;
        let [left, right, top, bottom] = self.sides(radius_px).map(|side| side * w);
        let x = q * self.eye.x;
        let y = -q * self.eye.y;
        [
            (left + x + 1.0) * half,
            (right + x + 1.0) * half,
            (top + y + 1.0) * half,
            (bottom + y + 1.0) * half,
        ]
    }
}

fn views() -> impl Iterator<Item = AxisView> {
    let eyes = [
        [0.0; 3],
        [0.3, -0.2, 0.0],
        [-0.4, 0.35, 0.25],
        [0.1, 0.5, -0.4],
        [0.0, -0.6, 0.5],
    ];
    let rows = [0..70, 30..47, 61..70];
    eyes.into_iter().flat_map(move |eye| {
        rows.clone().into_iter().flat_map(move |rows| {
            [20.0, 55.0].map(|fov_deg| AxisView::new(eye, fov_deg, rows.clone()))
        })
    })
}

#[test]
fn rectangles_are_bounded_by_sides_of_view() {
    let cube = CubeLdi::pack(&sloped_ldi(), SplatIndexLayout::Normal, Split::None).expect("packs");
    let segment = &cube.segments[0];
    let mut clipped = [0; 2];
    for view in views() {
        for radius_px in [0.0, 2.5] {
            let ends = [segment.inverse_depth_min, segment.inverse_depth_max]
                .map(|q| view.face_sides(radius_px, f64::from(q)));
            let range = |axis: usize, start: u32, length: u32| {
                let first = ends[0][axis].min(ends[1][axis]);
                let last = ends[0][axis + 1].max(ends[1][axis + 1]);
                let end = start + length;
                // A pixel more on both sides, as in `clip_rectangle`.
                let first = (first.floor() - 1.0).max(0.0) as u32;
                let last = (last.ceil() + 1.0).max(0.0) as u32;
                first.clamp(start, end)..last.clamp(start, end)
            };
            let expected = [
                range(0, segment.x0, segment.width),
                range(2, segment.y0, segment.height),
            ];
            let is_empty = expected.iter().any(|range| range.is_empty());
            assert_eq!(
                clip_rectangle(&view.transfer, segment, &view.band, radius_px),
                (!is_empty).then(|| expected.clone())
            );
            for (count, (range, whole)) in clipped
                .iter_mut()
                .zip(expected.iter().zip([segment.width, segment.height]))
            {
                *count += u32::from(!range.is_empty() && (range.len() as u32) < whole);
            }
        }
    }
    assert!(clipped.iter().all(|count| *count > 20), "{clipped:?}");
}

#[test]
fn blocks_are_hidden_only_by_one_side_of_view() {
    let cube = CubeLdi::pack(&sloped_ldi(), SplatIndexLayout::Normal, Split::None).expect("packs");
    let segment = &cube.segments[0];
    let mut visible = Vec::new();
    let mut counts = [0; 2];
    // Also eyes beyond some blocks, completely or partly.
    for view in views().chain([0.9, 1.4, 2.2].map(|z| AxisView::new([0.1, 0.05, z], 60.0, 0..70))) {
        let clip = SegmentClip {
            transfer: &view.transfer,
            segment,
            band: &view.band,
            face_px: FACE_PX,
            size: SegmentSize::Stamp(StampSize { radius_px: 1.5 }),
            unclipped: false,
        };
        let rectangle @ [columns, rows] = &[40..165, 30..179];
        clip.clip_blocks(rectangle, &mut visible);
        let blocks = [
            columns.start / 64..columns.end.div_ceil(64),
            rows.start / 16..rows.end.div_ceil(16),
        ];
        let mut flags = visible.iter();
        for (row, column) in blocks[1]
            .clone()
            .flat_map(|row| blocks[0].clone().map(move |column| (row, column)))
        {
            let ends = |block: u32, size: u32| {
                [block * size, ((block + 1) * size).min(FACE_PX)].map(f64::from)
            };
            let [x0, x1] = ends(column, 64);
            let [y0, y1] = ends(row, 16);
            let codes = segment
                .blocks
                .codes(column, row)
                .expect("samples in every block");
            let outside = codes.map(|code| {
                let q = segment.inverse_depth(code);
                let [left, right, top, bottom] = view.face_sides(1.5, q);
                let behind = 1.0 - q * view.eye.z < f64::from(W_NEAR);
                [behind, x1 < left, x0 > right, y1 < top, y0 > bottom]
            });
            let hidden = (0..5).any(|side| outside.iter().all(|outside| outside[side]));
            assert_eq!(flags.next(), Some(&!hidden), "block {column}, {row}");
            counts[usize::from(hidden)] += 1;
        }
        assert_eq!(flags.next(), None);
    }
    assert!(counts.iter().all(|count| *count > 100), "{counts:?}");
}

#[test]
fn centred_size_contains_off_centre_frame() {
    let band = |principal_px| Band {
        width: 90,
        height: 70,
        principal_px,
        rows: 0..70,
    };
    assert_eq!(band([45.0, 35.0]).centred_size(), [90, 70]);
    assert_eq!(band([37.0, 41.0]).centred_size(), [106, 82]);
    assert_eq!(band([-10.0, 100.25]).centred_size(), [200, 201]);
}

#[test]
fn face_rectangle_is_cut_at_face_border() {
    let cube = CubeLdi::pack(&scattered(), SplatIndexLayout::Normal, Split::None).expect("packs");
    let segment = &cube.segments[0];
    let x = segment.x0..segment.x0 + segment.width;
    let y = segment.y0..segment.y0 + segment.height;
    assert_eq!(face_rectangle(segment, 170), [x.clone(), y.clone()]);
    assert_eq!(face_rectangle(segment, 30), [30..30, y.start..30]);
    assert_eq!(block_count(&[x, y]), 2 * 3);
    assert_eq!(block_count(&[64..65, 15..17]), 2);
    assert_eq!(block_count(&[0..0, 0..1]), 0);
}
