//! The paper's table against areas, and tangent planes against finite differences.

use super::*;
use crate::pack::SegmentSide;
use crate::pack::blocks::BlockIndex;
use fearless_simd::{Level, dispatch};
use glam::dvec3;
use headbox_core::cube_face::Face;
use headbox_core::random::Rng;
use headbox_core::simd;

/// Face size, px.
const FACE_PX: u32 = 100;

/// Returns the square root of the area, px^2, that the LDI pixel in the middle of a face covers in
/// a frame, for a surface with a normal (in the face's frame) `depth` metres from the centre: the
/// ratio of two areas, C10. The area is that of a thousandth of the pixel, within which perspective
/// is negligible.
fn pixel_width_px(camera: &Camera, face: Face, normal: DVec3, depth: f64) -> f64 {
    let world = face.world_from_eye();
    let normal = world * normal;
    let middle = world * dvec3(0.0, 0.0, -depth);
    let corner = |x: f64, y: f64| {
        let half_pixel = 1e-3 / f64::from(FACE_PX);
        let toward = world * dvec3(x * half_pixel, y * half_pixel, -1.0);
        camera
            .project(toward * (middle.dot(normal) / toward.dot(normal)))
            .expect("in front")
    };
    let [a, b, c, d] =
        [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)].map(|(x, y)| corner(x, y));
    let twice_the_area = (c[0] - a[0]) * (d[1] - b[1]) - (d[0] - b[0]) * (c[1] - a[1]);
    (twice_the_area.abs() / 2.0).sqrt() * 1e3
}

fn segment(face: Face) -> PackedSegment {
    PackedSegment {
        face,
        side: SegmentSide::Near,
        x0: 0,
        y0: 0,
        width: 0,
        height: 0,
        inverse_depth_min: 0.1,
        inverse_depth_max: 2.0,
        row_offsets: vec![0],
        row_counts: vec![],
        depth_pixels: vec![],
        blocks: BlockIndex::default(),
    }
}

/// Relative error from the perspective of a thousandth of a pixel, and of f32.
const TOLERANCE: f64 = 2e-3;

#[test]
fn paper_table_width_is_root_of_pixel_area() {
    let mut table = PaperSize::new();
    let mut checked = 0;
    for (face, layout) in Face::ALL
        .into_iter()
        .flat_map(|f| [(f, SplatIndexLayout::Normal), (f, SplatIndexLayout::Paper)])
    {
        let segment = segment(face);
        let range = segment.depth_code_range();
        let world = face.world_from_eye();
        // Eyes off the face's axis, nearer and farther than the centre, with a shorter and a longer
        // focal length.
        for (eye, fov) in [
            (dvec3(0.4, 0.3, -0.5), 70.0),
            (dvec3(-1.2, 0.5, 0.4), 20.0),
            (dvec3(0.0, 1.0, -1.0), 5.0),
        ] {
            for index in (0..layout.index_count() as u32).step_by(13) {
                // The paper's codes contain a depth; the table is exact at the depth in a code's
                // middle.
                let depth = if layout == SplatIndexLayout::Paper {
                    range.decode(index as usize % 32)
                } else {
                    2.5
                };
                let eye = world * eye;
                let point = world * dvec3(0.0, 0.0, -depth);
                // The sight line is the camera's axis, where the angles to both are equal.
                let camera = Camera::look_at(eye, point, dvec3(0.3, 0.9, 0.2), fov, [300, 200])
                    .expect("valid");
                let normal = layout.normal(index).as_dvec3();
                let cos1 = normal.z;
                let cos2 = (world * normal).dot((eye - point).normalize());
                let min_cosine = f64::from(PaperSize::MIN_COSINE);
                if cos1 < min_cosine || cos2 < min_cosine {
                    continue;
                }
                table.refill(&camera, &segment, layout, FACE_PX);
                let q = if layout == SplatIndexLayout::Paper {
                    1.0 / depth
                } else {
                    1.0
                };
                let w = (eye - point).length() / depth;
                let width = f64::from(table.widths[index as usize]) * q / w;
                let expected = pixel_width_px(&camera, face, normal, depth);
                assert!(
                    (width / expected - 1.0).abs() < TOLERANCE,
                    "{face:?} {layout:?} {index}: {width}, not {expected}"
                );
                checked += 1;
            }
        }
    }
    assert!(checked > 1000, "{checked}");
}

/// Returns the radii of samples whose table entries are `widths`, at depth ratio `w` and inverse
/// depth `q`.
fn radii(layout: SplatIndexLayout, widths: [f32; LANES], w: f32, q: f32) -> [f32; LANES] {
    let mut table = PaperSize {
        layout,
        ..PaperSize::new()
    };
    table.widths[..LANES].copy_from_slice(&widths);
    dispatch!(Level::new(), simd => {
        let zero = f32x16::splat(simd, 0.0);
        let lanes = SampleLanes {
            homogeneous: [zero; 3],
            reciprocal_w: f32x16::splat(simd, 1.0 / w),
            inverse_depth: f32x16::splat(simd, q),
            x: zero,
            y: 0.0,
            normals: Normals::Index(u32x16::load_array(simd, std::array::from_fn(|i| i as u32))),
        };
        let footprints = table.footprints(simd, &lanes);
        assert_eq!(footprints.radius_x.to_array(), footprints.radius_y.to_array());
        assert_eq!(footprints.weight.to_array(), [1.0; LANES]);
        footprints.radius_x.to_array()
    })
}

#[test]
fn squares_are_smallest_that_cover_sample() {
    let widths = [
        0.0,
        0.5,
        1.0,
        1.01,
        2.0,
        2.99,
        3.0,
        3.01,
        4.5,
        5.0,
        5.01,
        6.0,
        7.0,
        7.5,
        60.0,
        f32::NAN,
    ];
    let expected = [
        0.5, 0.5, 0.5, 1.5, 1.5, 1.5, 1.5, 2.5, 2.5, 2.5, 3.5, 3.5, 3.5, 3.5, 3.5, 0.5,
    ];
    assert_eq!(radii(SplatIndexLayout::Normal, widths, 1.0, 9.0), expected);
    // Twice as far from the eye as from the centre: half the width. The paper's entries are metres,
    // to be multiplied by inverse depth.
    assert_eq!(
        radii(SplatIndexLayout::Normal, widths.map(|w| w * 2.0), 2.0, 9.0),
        expected
    );
    assert_eq!(
        radii(SplatIndexLayout::Paper, widths.map(|w| w * 2.0), 1.0, 0.5),
        expected
    );
}

/// Samples of one row of a face under a camera.
struct SampleRow {
    transfer: Transfer,
    y: f64,
    x: [f64; LANES],
    q: [f64; LANES],
    /// Splat indices of normals in the face's frame.
    index: [u32; LANES],
}

impl SampleRow {
    fn new(random: &mut Rng) -> Self {
        let eye = random.in_cube(0.4);
        let y = random.between(20.0, 80.0);
        let target = eye + Face::PosY.normal() + random.in_cube(0.3);
        let camera =
            Camera::look_at(eye, target, random.in_cube(1.0), 70.0, [300, 200]).expect("valid");
        let encode = |n: DVec3| {
            let range = segment(Face::PosY).depth_code_range();
            SplatIndexLayout::Normal.encode((n + DVec3::Z).normalize(), 1.0, range)
        };
        Self {
            transfer: Transfer::new(&camera, eye, Face::PosY, FACE_PX),
            y,
            x: std::array::from_fn(|_| random.between(20.0, 80.0)),
            q: std::array::from_fn(|_| random.between(0.1, 1.2)),
            index: std::array::from_fn(|_| encode(random.in_cube(0.9))),
        }
    }

    fn normal(&self, i: usize) -> DVec3 {
        SplatIndexLayout::Normal.normal(self.index[i]).as_dvec3()
    }

    /// Returns n . ray: 0 for a plane seen edge-on.
    fn normal_along_ray(&self, i: usize) -> f64 {
        let half = f64::from(FACE_PX) / 2.0;
        self.normal(i)
            .dot(dvec3(self.x[i] / half - 1.0, 1.0 - self.y / half, -1.0))
    }

    /// Returns the frame position, px from the principal point, of the point (dx, dy) face pixels
    /// away from sample `i` on its plane, whose slope is clamped.
    fn project_offset(&self, i: usize, dx: f64, dy: f64) -> [f64; 2] {
        let step = 2.0 / f64::from(FACE_PX);
        let [x, y] = [self.normal(i).x, -self.normal(i).y].map(|n| {
            let max = f64::from(TangentTable::MAX_SLOPE);
            (n / self.normal_along_ray(i)).clamp(-max, max) * step
        });
        let q = self.q[i] * (1.0 + x * dx + y * dy);
        let h = self.transfer.map_infinite(self.x[i] + dx, self.y + dy)
            + self.transfer.inverse_depth * q;
        [h.x / h.z, h.y / h.z]
    }

    /// Returns the derivative of the frame position by central differences: the row of x, and of y.
    fn jacobian(&self, i: usize) -> [[f64; 2]; 2] {
        let step = 1e-4;
        let [right, left] = [step, -step].map(|dx| self.project_offset(i, dx, 0.0));
        let [below, above] = [step, -step].map(|dy| self.project_offset(i, 0.0, dy));
        [0, 1].map(|axis| {
            [right[axis] - left[axis], below[axis] - above[axis]].map(|d| d / (2.0 * step))
        })
    }

    fn project(&self, i: usize) -> DVec3 {
        self.transfer.map_infinite(self.x[i], self.y) + self.transfer.inverse_depth * self.q[i]
    }

    fn lanes<S: Simd>(&self, simd: S, exact: bool) -> SampleLanes<S> {
        let load = |value: &dyn Fn(usize) -> f64| {
            f32x16::load_array(simd, std::array::from_fn(|i| value(i) as f32))
        };
        let index = u32x16::load_array(simd, self.index);
        let normal = [0, 1, 2].map(|axis| load(&|i| self.normal(i)[axis]));
        SampleLanes {
            homogeneous: [0, 1, 2].map(|axis| load(&|i| self.project(i)[axis])),
            reciprocal_w: load(&|i| 1.0 / self.project(i).z),
            inverse_depth: load(&|i| self.q[i]),
            x: load(&|i| self.x[i]),
            y: self.y as f32,
            normals: if exact {
                Normals::Exact { normal, index }
            } else {
                Normals::Index(index)
            },
        }
    }
}

/// Relative error of radii in f32, of surfaces that are not seen almost edge-on.
const F32_RADIUS: f64 = 2e-3;

#[test]
fn radii_reach_adjacent_samples_of_surface() {
    let mut random = Rng::keyed(12);
    let mut table = TangentTable::default();
    let mut checked = [0; 2];
    for round in 0..60 {
        let row = SampleRow::new(&mut random);
        table.refill(SplatIndexLayout::Normal, FACE_PX, 1.15, 0.8);
        let size = TangentSize::new(&table, &row.transfer);
        let ellipse = EllipseSize(TangentSize::new(&table, &row.transfer));
        let frame = [300, 200];
        for level in simd::levels() {
            let exact = round % 2 == 0;
            let ([rx, ry, weight], [ex, ey, e_weight, correlation]) = dispatch!(level, simd => {
                let lanes = row.lanes(simd, exact);
                let a = size.footprints(simd, &lanes);
                let b = ellipse.footprints(simd, &lanes);
                let tangent = [a.radius_x, a.radius_y, a.weight];
                let elliptical = [b.radius_x, b.radius_y, b.weight, b.correlation];
                (
                    tangent.map(|v| v.to_array().map(f64::from)),
                    elliptical.map(|v| v.to_array().map(f64::from)),
                )
            });
            for i in (0..LANES)
                .filter(|i| row.project(*i).z > 0.1 && row.normal_along_ray(*i).abs() > 0.01)
            {
                let rows @ [[xx, xy], [yx, yy]] = row.jacobian(i);
                let radius = |[a, b]: [f64; 2]| (a.hypot(b) * f64::from(1.15f32)).clamp(0.8, 32.0);
                let expected = rows.map(radius);
                let near = |actual: f64, expected: f64| {
                    (actual - expected).abs() <= F32_RADIUS * expected.abs().max(0.1)
                };
                assert!(
                    near(rx[i], expected[0]) && near(ry[i], expected[1]),
                    "{expected:?}: {} {}",
                    rx[i],
                    ry[i]
                );
                let area = (xx * yy - xy * yx).abs();
                assert!(
                    near(weight[i], {
                        let [shorter, longer] =
                            [expected[0].min(expected[1]), expected[0].max(expected[1])];
                        (area / (shorter * longer) * (longer / shorter).sqrt()).min(1.0)
                    }),
                    "{area}: {}",
                    weight[i]
                );
                checked[0] += 1;
                // A Gaussian of half a spacing, blurred by 0.3 px, up to 2.5 deviations.
                let deviations = rows.map(|[a, b]| (a * a + b * b) * 0.25 + 0.09);
                let [px, py] = deviations.map(|squared| 2.5 * squared.sqrt());
                if px.max(py) < 31.0 {
                    assert!(
                        near(ex[i], px) && near(ey[i], py),
                        "{px} {py}: {} {}",
                        ex[i],
                        ey[i]
                    );
                    assert!(near(e_weight[i], area / (px * py)));
                    let expected =
                        (xx * yx + xy * yy) * 0.25 / (deviations[0] * deviations[1]).sqrt();
                    assert!(
                        near(correlation[i], expected),
                        "{expected}: {}",
                        correlation[i]
                    );
                    checked[1] += 1;
                }
                // Bounds hold for samples in the frame.
                let [x, y] = row.project_offset(i, 0.0, 0.0);
                if x.abs() < 150.0 && y.abs() < 100.0 {
                    let q = row.q[i];
                    let w = row.project(i).z;
                    assert!(size.radius_bound_px(&row.transfer, q, w, frame) >= rx[i].max(ry[i]));
                    assert!(
                        ellipse.radius_bound_px(&row.transfer, q, w, frame) >= ex[i].max(ey[i])
                    );
                }
            }
        }
    }
    assert!(checked.iter().all(|count| *count > 200), "{checked:?}");
}

#[test]
fn radius_bounds_are_tight() {
    // From the centre there is no parallax: columns of the face are columns of the frame, w is 1.
    let camera = Camera::look_at(DVec3::ZERO, DVec3::Y, DVec3::X, 90.0, [200, 200]).expect("valid");
    let transfer = Transfer::new(&camera, DVec3::ZERO, Face::PosY, FACE_PX);
    let mut table = TangentTable::default();
    table.refill(SplatIndexLayout::Normal, FACE_PX, 1.5, 0.5);
    let size = TangentSize::new(&table, &transfer);
    // 200 pixels of the frame for 100 of the face.
    assert!((size.radius_bound_px(&transfer, 1.0, 1.0, [200, 200]) - 3.0).abs() < 1e-3);
    assert!((size.radius_bound_px(&transfer, 1.0, 2.0, [200, 200]) - 1.5).abs() < 1e-3);
    assert_eq!(size.radius_bound_px(&transfer, 1.0, 1e9, [200, 200]), 0.5);
    assert_eq!(size.radius_bound_px(&transfer, 1.0, 0.0, [200, 200]), 32.0);
    assert_eq!(size.radius_bound_px(&transfer, 1.0, 1e-9, [200, 200]), 32.0);
    let blurred = EllipseSize(size).radius_bound_px(&transfer, 1.0, 1.0, [200, 200]);
    assert!((blurred - 3f64.hypot(0.75)).abs() < 1e-3, "{blurred}");
    // Depth moves samples to the right and a little toward the eye, by at most 12 * 0.02 * 0.5 of
    // it from a pixel to the next. Perspective acts at up to 150 + 32 pixels from the axis.
    let transfer = Transfer {
        one: DVec3::ZERO,
        x_step: dvec3(2.0, 0.0, 0.0),
        y_step: dvec3(0.0, 2.0, 0.0),
        inverse_depth: dvec3(3.0, 0.0, 0.01),
    };
    let size = TangentSize::new(&table, &transfer);
    let from_depth: f64 = 0.12 * 3.0 + 182.0 * 0.12 * 0.01;
    let expected = (2.0 + from_depth).hypot(from_depth) * 1.5;
    let bound = size.radius_bound_px(&transfer, 0.5, 1.0, [300, 100]);
    assert!(
        (bound / expected - 1.0).abs() < 1e-4 && bound > expected,
        "{bound}, not {expected}"
    );
}
