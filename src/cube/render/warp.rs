//! Warp of a batch, sixteen depth pixels at a time: unpack, transfer, cull, size (S18, S20, C8).
//!
//! One implementation for every SIMD level, down to plain scalars: IEEE operations in a fixed
//! order, without fused multiply-adds and approximate reciprocals, so that all levels give the same
//! bits.

use crate::render::footprint::size::{FootprintSize, LANES, SampleLanes, SegmentSize};
use crate::render::footprint::splat::Splats;
use crate::render::setup::clip::{Band, W_NEAR};
use crate::render::setup::transfer::{RowTransfer, Transfer};
use crate::render::traverse::batches::{BATCH_CAPACITY, Batch};
use crate::render::traverse::format::{DepthPixelLanes, Format};
use fearless_simd::{ExtractToken, Level, Simd, dispatch, f32x16, mask32x16, prelude::*};

/// Parameters of the warp of one segment.
pub(crate) struct SegmentWarp<'a> {
    transfer: &'a Transfer,
    /// Inverse depth of code 0 and its change from code to code, 1/m.
    scale: [f64; 2],
    /// Frame width, px.
    width: f32,
    /// Principal point of the frame, px.
    principal_px: [f32; 2],
    /// First row of the band, and the row after its last.
    rows: [f32; 2],
    level: Level,
}

impl<'a> SegmentWarp<'a> {
    /// Creates the warp of a segment; `scale` is from [`Format::scale`].
    pub(crate) fn new(transfer: &'a Transfer, scale: [f64; 2], band: &Band, level: Level) -> Self {
        Self {
            transfer,
            scale,
            width: band.width as f32,
            principal_px: band.principal_px.map(|c| c as f32),
            rows: [band.rows.start as f32, band.rows.end as f32],
            level,
        }
    }

    /// Warps a batch to `splats`; culls depth pixels behind the eye, or with a footprint outside
    /// the band.
    pub(crate) fn warp<P: Format>(
        &self,
        batch: &Batch<P>,
        size: &SegmentSize,
        splats: &mut Splats,
    ) {
        match size {
            SegmentSize::Tangent(size) => self.warp_sized(batch, size, splats),
            SegmentSize::Ellipse(size) => self.warp_sized(batch, size, splats),
            SegmentSize::Paper(size) => self.warp_sized(batch, *size, splats),
            SegmentSize::Stamp(size) => self.warp_sized(batch, size, splats),
        }
    }

    fn warp_sized<P: Format>(
        &self,
        batch: &Batch<P>,
        size: &impl FootprintSize,
        splats: &mut Splats,
    ) {
        dispatch!(self.level, simd => self.warp_batch(simd, batch, size, splats));
    }

    #[inline(always)]
    fn warp_batch<S: Simd, P: Format>(
        &self,
        simd: S,
        batch: &Batch<P>,
        size: &impl FootprintSize,
        splats: &mut Splats,
    ) {
        let row =
            self.transfer
                .anchor(batch.anchor_column, batch.row, self.scale[0], self.scale[1]);
        splats.len = 0;
        splats.by_footprint = [0; 4];
        for start in (0..batch.len.min(BATCH_CAPACITY)).step_by(LANES) {
            self.warp_lanes(simd, &row, batch, start, size, splats);
        }
    }

    /// Warps the [`LANES`] depth pixels from `start` on (a batch has room for whole registers).
    #[inline(always)]
    fn warp_lanes<S: Simd, P: Format, Z: FootprintSize>(
        &self,
        simd: S,
        row: &RowTransfer,
        batch: &Batch<P>,
        start: usize,
        size: &Z,
        splats: &mut Splats,
    ) {
        let mut columns = [0.0; LANES];
        for (column, byte) in columns.iter_mut().zip(&batch.columns[start..start + LANES]) {
            *column = f32::from(*byte);
        }
        let DepthPixelLanes {
            code,
            normals,
            color,
        } = P::load(simd, &batch.depth_pixels[start..start + LANES]);
        let k = f32x16::load_array(simd, columns);

        // Same as `RowTransfer::apply`.
        let hx = (k * row.step.x + row.anchor.x) + code * row.per_code.x;
        let hy = (k * row.step.y + row.anchor.y) + code * row.per_code.y;
        let hz = (k * row.step.z + row.anchor.z) + code * row.per_code.z;
        // All comparisons are false for NaN, which is outside.
        let in_front = hz.simd_ge(W_NEAR);
        let reciprocal_w = f32x16::splat(simd, 1.0) / hz;
        let inverse_depth = code * self.scale[1] as f32 + self.scale[0] as f32;
        let lanes = SampleLanes {
            homogeneous: [hx, hy, hz],
            reciprocal_w,
            inverse_depth,
            x: k + (batch.anchor_column as f32 + 0.5),
            y: batch.row as f32 + 0.5,
            normals,
        };
        let px = hx * reciprocal_w + self.principal_px[0];
        let py = hy * reciprocal_w + self.principal_px[1];
        let footprints = size.footprints(simd, &lanes);
        let (rx, ry) = (footprints.radius_x, footprints.radius_y);
        let touches_band = (px + rx).simd_gt(0.0)
            & (px - rx).simd_lt(self.width)
            & (py + ry).simd_gt(self.rows[0])
            & (py - ry).simd_lt(self.rows[1]);
        let in_batch = mask32x16::from_bitmask(simd, (1u64 << (batch.len - start).min(LANES)) - 1);
        let visible = in_front & touches_band & in_batch;
        let n = splats.len;
        append(px, visible, &mut splats.x, n);
        append(py, visible, &mut splats.y, n);
        append(
            inverse_depth * reciprocal_w,
            visible,
            &mut splats.inverse_depth,
            n,
        );
        append(rx, visible, &mut splats.radius_x, n);
        append(ry, visible, &mut splats.radius_y, n);
        append(footprints.weight, visible, &mut splats.weight, n);
        if Z::IS_ELLIPTICAL {
            append(footprints.correlation, visible, &mut splats.correlation, n);
        }
        simd.compress_u32x16(color, visible)
            .store_slice(&mut splats.color[n..n + LANES]);
        let larger = rx.max_precise(ry);
        let all = count(visible);
        let three = count(visible & larger.simd_ge(1.0));
        let five = count(visible & larger.simd_ge(2.0));
        let seven = count(visible & larger.simd_ge(3.0));
        splats.by_footprint[0] += all - three;
        splats.by_footprint[1] += three - five;
        splats.by_footprint[2] += five - seven;
        splats.by_footprint[3] += seven;
        splats.len += all as usize;
    }
}

/// Writes the lanes set in `visible` behind the first `n` values of an array.
#[inline(always)]
fn append<S: Simd>(
    values: f32x16<S>,
    visible: mask32x16<S>,
    to: &mut [f32; Splats::CAPACITY],
    n: usize,
) {
    let simd = values.token();
    simd.compress_f32x16(values, visible)
        .store_slice(&mut to[n..n + LANES]);
}

/// Returns the number of lanes that are set.
#[inline(always)]
fn count<S: Simd>(mask: mask32x16<S>) -> u64 {
    u64::from(mask.to_bitmask().count_ones())
}

#[cfg(test)]
mod tests {
    //! Batches of both formats, at every SIMD level, against the transfer in f64.

    use super::*;
    use crate::pack::tests::scattered;
    use crate::pack::{
        PackedDepthPixel, SplatIndexLayout, Split, UnquantisedCube, UnquantisedDepthPixel,
    };
    use crate::render::footprint::size::{FootprintLanes, Normals};
    use glam::DVec3;
    use headbox_core::camera::Camera;
    use headbox_core::cube_face::Face;
    use headbox_core::random::Rng;
    use headbox_core::simd;

    /// Bound of f32 position errors, px (as in `transfer`); splats so near to a border may be
    /// culled or not.
    const F32_PX: f64 = 2e-3;

    /// Footprints whose radii encode the position of their samples on the face.
    struct PositionSize {
        radius_px: f32,
    }

    impl FootprintSize for PositionSize {
        const MAX_RADIUS_PX: f32 = 4.0;

        fn radius_bound_px(&self, _: &Transfer, _: f64, _: f64, _: [u32; 2]) -> f64 {
            4.0
        }

        #[inline(always)]
        fn footprints<S: Simd>(&self, simd: S, lanes: &SampleLanes<S>) -> FootprintLanes<S> {
            FootprintLanes {
                radius_x: lanes.x * (0.01 * self.radius_px),
                radius_y: f32x16::splat(simd, lanes.y * (0.03 * self.radius_px)),
                weight: lanes.inverse_depth,
                correlation: f32x16::splat(simd, 0.0),
            }
        }
    }

    /// x, y, 1 / eye depth, horizontal radius, inverse depth on the face; colour.
    type ExpectedSplat = ([f64; 5], u32);

    /// Makes a batch of row 31 in the block of columns from 64 on.
    fn batch<P: Format>(depth_pixels: &[P], columns: impl Fn(usize) -> u8) -> Box<Batch<P>> {
        let mut batch = Box::new(Batch::new());
        batch.row = 31;
        batch.anchor_column = 64;
        batch.len = depth_pixels.len();
        batch.depth_pixels[..depth_pixels.len()].copy_from_slice(depth_pixels);
        (0..depth_pixels.len()).for_each(|i| batch.columns[i] = columns(i));
        batch
    }

    #[test]
    fn splats_that_touch_band_have_exact_positions() {
        let exact = UnquantisedCube::pack(&scattered(), SplatIndexLayout::Normal, Split::None)
            .expect("packs");
        let i = exact
            .cube
            .segments
            .iter()
            .position(|segment| segment.face == Face::PosZ)
            .expect("one");
        let segment = &exact.cube.segments[i];
        let exact = &exact.depth_pixels[i];
        let mut random = Rng::keyed(6);
        let mut visible_count = 0;
        let mut culled_count = 0;
        for length in [1, 15, 16, 17, 50, 49, 48] {
            for (class, radius_px) in [0.5f32, 1.1, 2.2, 3.3].into_iter().enumerate() {
                // Near the frame's left border, inside, and near its right border.
                let middle = [3.0, 43.0, 77.0][(class + length) % 3];
                let columns = |i: usize| (i * 5 % 26) as u8;
                // Eyes in front of the samples and beyond them.
                let eye = random.in_cube(2.0);
                let ahead = Face::PosZ.direction(75.0, 31.5, 170) - eye * 0.5;
                let camera =
                    Camera::look_at(eye, eye + ahead, DVec3::Y, 30.0, [80, 60]).expect("valid");
                let camera = camera.with_principal_px([middle, 26.0]);
                let band = Band::new(&camera, 11..47);
                let transfer = Transfer::new(&camera, eye, Face::PosZ, 170);
                let size = PositionSize { radius_px };
                let radius_y = 31.5 * 0.03 * f64::from(radius_px);
                let packed = &segment.depth_pixels[7..7 + length];
                let exact = &exact[7..7 + length];
                // The splat of a sample, and by how many pixels its footprint reaches into the band
                // (-1 behind the eye).
                let place = |i: usize, q: f64| {
                    let column = 64.5 + f64::from(columns(i));
                    let h = transfer.map_infinite(column, 31.5) + transfer.inverse_depth * q;
                    let x = h.x / h.z + middle;
                    let y = h.y / h.z + 26.0;
                    let radius_x = column * 0.01 * f64::from(radius_px);
                    let inside = [
                        x + radius_x,
                        80.0 - x + radius_x,
                        y + radius_y - 11.0,
                        47.0 - y + radius_y,
                    ];
                    let inside = inside.into_iter().fold(f64::INFINITY, f64::min);
                    (
                        [x, y, q / h.z, radius_x, q],
                        if h.z >= f64::from(W_NEAR) {
                            inside
                        } else {
                            -1.0
                        },
                    )
                };
                let is_sure = |i: usize, q: f64| place(i, q).1.abs() > F32_PX;
                let packed_q = |i: usize| segment.inverse_depth(packed[i].inverse_depth_code());
                let exact_q = |i: usize| f64::from(exact[i].inverse_depth);
                if !(0..length).all(|i| is_sure(i, packed_q(i)) && is_sure(i, exact_q(i))) {
                    continue;
                }
                let expected = |q: &dyn Fn(usize) -> f64| -> Vec<ExpectedSplat> {
                    let all = (0..length)
                        .map(|i| (place(i, q(i)), u32::from_ne_bytes(exact[i].color_srgb)));
                    all.filter(|((_, inside), _)| *inside > 0.0)
                        .map(|((splat, _), color)| (splat, color))
                        .collect()
                };
                let expected_of_packed = expected(&packed_q);
                let expected_of_exact = expected(&exact_q);
                visible_count += expected_of_exact.len();
                culled_count += length - expected_of_exact.len();
                for level in simd::levels() {
                    let mut splats = Box::new(Splats::new());
                    let check = |splats: &Splats, expected: &[ExpectedSplat]| {
                        assert_eq!(splats.len, expected.len());
                        let class_count = |other| {
                            if class == other {
                                expected.len() as u64
                            } else {
                                0
                            }
                        };
                        assert_eq!(splats.by_footprint, [0, 1, 2, 3].map(class_count));
                        for (i, ([x, y, q, radius_x, q_face], color)) in expected.iter().enumerate()
                        {
                            let near = |actual: f32, exact: f64, tolerance: f64| {
                                (f64::from(actual) - exact).abs() <= tolerance
                            };
                            assert!(near(splats.x[i], *x, F32_PX) && near(splats.y[i], *y, F32_PX));
                            assert!(near(splats.inverse_depth[i], *q, q * 1e-4), "{q}");
                            assert!(
                                near(splats.radius_x[i], *radius_x, 1e-5)
                                    && near(splats.radius_y[i], radius_y, 1e-5)
                            );
                            assert!(
                                near(splats.weight[i], *q_face, 1e-6) && splats.color[i] == *color
                            );
                        }
                    };
                    SegmentWarp::new(&transfer, PackedDepthPixel::scale(segment), &band, level)
                        .warp_sized(&batch(packed, columns), &size, &mut splats);
                    check(&splats, &expected_of_packed);
                    SegmentWarp::new(
                        &transfer,
                        UnquantisedDepthPixel::scale(segment),
                        &band,
                        level,
                    )
                    .warp_sized(&batch(exact, columns), &size, &mut splats);
                    check(&splats, &expected_of_exact);
                }
            }
        }
        assert!(
            visible_count > 50 && culled_count > 50,
            "{visible_count} {culled_count}"
        );
    }

    #[test]
    fn packed_pixels_unpack_code_and_normal_index() {
        let geometry = |i: u32| ((i * 331 % 2048) << 20) | (i * 65_537 % (1 << 20));
        let pixels: Vec<_> = (0..16)
            .map(|i| PackedDepthPixel {
                geometry: geometry(i),
                color_srgb: [7; 4],
            })
            .collect();
        for level in simd::levels() {
            dispatch!(level, simd => {
                let lanes = PackedDepthPixel::load(simd, &pixels);
                let Normals::Index(indices) = lanes.normals else {
                    panic!("indices")
                };
                let unpacked = lanes.code.to_array().into_iter().zip(indices.to_array());
                let expected = pixels
                    .iter()
                    .map(|p| (p.inverse_depth_code() as f32, p.splat_index()));
                assert!(unpacked.eq(expected));
            });
        }
    }
}
