//! The packed LDI preserves its samples, and both validators detect every violated invariant.

use crate::common::bed::{leaves, room};
use crate::common::capture::{one_layer, quick};
use glam::{DVec3, Vec3};
use headbox_core::cube_face::Face;
use headbox_core::environment::{Environment, EnvironmentError};
use headbox_cube::model::samples::{CubeSamples, DepthPixel, EncodedNormal};
use headbox_cube::model::validate::LdiError;
use headbox_cube::pack::validate::SegmentProblem;
use headbox_cube::pack::{
    CubeLdi, PackError, PackedDepthPixel, PackedError, SegmentSide, SplatIndexLayout, Split,
};

/// Half a step of 20 bits over a segment's range of inverse depth, and the rounding of the f32 it
/// came from.
const HALF_STEP: f64 = 0.5 / ((1 << 20) - 1) as f64 + 1e-7;

/// Maximum error of the ring code, front side (see `splat_index`), degrees; the normals of a
/// capture face the centre.
const NORMAL_DEG: f64 = 2.9;
/// Cosine below which a surface is so nearly edge-on that its code may lie on the back side.
const EDGE_ON: f64 = 0.06;
/// Maximum error of such a code, which is moved by a ring to face the centre, degrees.
const MOVED_DEG: f64 = 3.6;

#[test]
fn packing_keeps_every_sample() {
    let ldi = quick(&leaves(20.0), 48);
    for layout in [SplatIndexLayout::Paper, SplatIndexLayout::Normal] {
        for split in [Split::Auto, Split::None, Split::AtDepth(2.0)] {
            let cube = CubeLdi::pack(&ldi, layout, split).expect("packs");
            cube.validate().expect("valid");
            assert_eq!(
                cube.depth_pixel_count(),
                ldi.faces.iter().map(|f| f.samples.len()).sum::<usize>()
            );
            for face in &ldi.faces {
                for (x, y) in (0..48).flat_map(|y| (0..48).map(move |x| (x, y))) {
                    // Far segment, then near: farthest first again.
                    let segments = cube.segments.iter().filter(|s| s.face == face.face);
                    let packed = segments.flat_map(|s| {
                        let inside = x >= s.x0 && y >= s.y0;
                        let pixel = if inside {
                            s.pixel(x - s.x0, y - s.y0)
                        } else {
                            &[]
                        };
                        pixel.iter().map(move |p| (s, s.decode(layout, *p)))
                    });
                    let packed: Vec<_> = packed.collect();
                    assert_eq!(packed.len(), face.pixel(x, y).len());
                    for ((segment, found), sample) in packed.iter().zip(face.pixel(x, y)) {
                        let range = f64::from(segment.inverse_depth_max)
                            - f64::from(segment.inverse_depth_min);
                        let error = (found.inverse_depth - f64::from(sample.inverse_depth)).abs();
                        assert!(
                            error <= HALF_STEP * range.max(f64::from(sample.inverse_depth)),
                            "{error}"
                        );
                        assert_eq!(found.color_srgb, sample.color_srgb);
                        let normal = sample.normal.decode().as_dvec3();
                        if layout == SplatIndexLayout::Normal
                            && normal.dot(face.face.normal()) < 0.17
                        {
                            let toward = face
                                .face
                                .direction(f64::from(x) + 0.5, f64::from(y) + 0.5, 48)
                                .normalize();
                            let moved_deg = if normal.dot(toward).abs() < EDGE_ON {
                                MOVED_DEG
                            } else {
                                0.0
                            };
                            assert!(
                                found.normal.angle_between(normal).to_degrees()
                                    < NORMAL_DEG + moved_deg
                            );
                        }
                    }
                }
            }
        }
    }
}

#[test]
fn the_automatic_split_cuts_where_it_helps() {
    let ldi = quick(&room(20.0), 48);
    let cube = CubeLdi::pack(&ldi, SplatIndexLayout::Normal, Split::Auto).expect("packs");
    let cut = cube
        .segments
        .iter()
        .filter(|s| s.side == SegmentSide::Far)
        .count();
    assert!(
        cut >= 1,
        "a room with furniture near the headbox is cut somewhere"
    );
    let wall = one_layer(DVec3::ZERO, 8, &[Face::PosX], |_, _, _| Some(sample(0.5)));
    let cube = CubeLdi::pack(&wall, SplatIndexLayout::Normal, Split::Auto).expect("packs");
    assert_eq!(
        cube.segments.len(),
        1,
        "a wall at one depth stays whole, and empty faces are left out"
    );
    assert_eq!(cube.segments[0].inverse_depth(0), 0.5);
    for depth in [0.0, -1.0, f64::NAN, f64::INFINITY] {
        let packed = CubeLdi::pack(&wall, SplatIndexLayout::Normal, Split::AtDepth(depth));
        assert!(matches!(packed, Err(PackError::SplitDepth(_))));
    }
}

#[test]
fn empty_ldi_packs_to_nothing() {
    let empty = one_layer(DVec3::ZERO, 4, &[], |_, _, _| None);
    let cube = CubeLdi::pack(&empty, SplatIndexLayout::Paper, Split::Auto).expect("packs");
    cube.validate().expect("valid");
    assert_eq!(
        (cube.segments.len(), cube.depth_pixel_count(), cube.bytes()),
        (0, 0, 0)
    );
}

#[test]
fn segments_are_as_small_as_their_samples() {
    let two = |_: Face, x: f64, y: f64| {
        ((x, y) == (2.5, 3.5) || (x, y) == (5.5, 4.5)).then(|| sample(0.25))
    };
    let cube = CubeLdi::pack(
        &one_layer(DVec3::ZERO, 8, &[Face::NegY], two),
        SplatIndexLayout::Paper,
        Split::None,
    );
    let segment = &cube.expect("packs").segments[0];
    assert_eq!(
        (segment.x0, segment.y0, segment.width, segment.height),
        (2, 3, 4, 2)
    );
    assert_eq!(segment.row_offsets, [0, 1, 2]);
    assert_eq!(segment.row_counts, [0, 1, 1, 1, 1, 0, 0, 0, 0, 1]);
}

fn sample(inverse_depth: f32) -> DepthPixel {
    DepthPixel {
        inverse_depth,
        normal: EncodedNormal::new(Vec3::X),
        color_srgb: [9, 8, 7, 255],
    }
}

/// Drops the last entry.
fn truncate<T>(v: &mut Vec<T>) {
    v.truncate(v.len() - 1);
}

/// Two samples in every pixel of 3x3 faces, an environment of 2x2.
fn small_ldi() -> CubeSamples {
    let mut ldi = one_layer(DVec3::ZERO, 3, &Face::ALL, |_, _, _| Some(sample(0.5)));
    for face in &mut ldi.faces {
        face.samples = (0..9).flat_map(|_| [sample(0.25), sample(1.0)]).collect();
        face.offsets = (0..10).map(|i| 2 * i).collect();
    }
    ldi.environment = Environment {
        size_px: 2,
        texels: vec![[1, 2, 3, 255]; 24],
    };
    ldi
}

#[test]
fn every_broken_promise_of_the_ldi_is_named() {
    small_ldi().validate().expect("valid");
    let broken = |name: &str,
                  damage: &dyn Fn(&mut CubeSamples),
                  expected: &dyn Fn(&LdiError) -> bool| {
        let mut ldi = small_ldi();
        damage(&mut ldi);
        let error = ldi.validate().expect_err(name);
        assert!(expected(&error), "{name}: {error:?}");
        assert!(!error.to_string().is_empty());
        let packed = CubeLdi::pack(&ldi, SplatIndexLayout::Normal, Split::Auto).expect_err(name);
        assert_eq!(
            packed.to_string(),
            PackError::Ldi(error).to_string(),
            "{name}"
        );
    };
    let face = Face::PosY;
    broken("face missing", &|l| truncate(&mut l.faces), &|e| {
        *e == LdiError::Faces(5)
    });
    broken(
        "face too many",
        &|l| l.faces.push(l.faces[0].clone()),
        &|e| *e == LdiError::Faces(6),
    );
    broken("faces swapped", &|l| l.faces.swap(0, 1), &|e| {
        *e == LdiError::Faces(0)
    });
    broken(
        "size 0",
        &|l| l.faces.iter_mut().for_each(|f| f.size_px = 0),
        &|e| matches!(e, LdiError::FaceSize { .. }),
    );
    broken("sizes differ", &|l| l.faces[2].size_px = 4, &|e| {
        *e == LdiError::FaceSizesDiffer {
            face,
            size_px: 4,
            expected_px: 3,
        }
    });
    broken(
        "offsets short",
        &|l| truncate(&mut l.faces[2].offsets),
        &|e| {
            *e == LdiError::OffsetCount {
                face,
                found: 9,
                expected: 10,
            }
        },
    );
    broken("first offset", &|l| l.faces[2].offsets[0] = 1, &|e| {
        matches!(e, LdiError::OffsetEnds { first: 1, .. })
    });
    broken(
        "sample lost",
        &|l| truncate(&mut l.faces[2].samples),
        &|e| matches!(e, LdiError::OffsetEnds { .. }),
    );
    broken("offset falls", &|l| l.faces[2].offsets[5] = 1, &|e| {
        *e == LdiError::OffsetOrder { face, x: 1, y: 1 }
    });
    broken("offset wild", &|l| l.faces[2].offsets[5] = 999, &|e| {
        *e == LdiError::OffsetOrder { face, x: 1, y: 1 }
    });
    for q in [0.0, -1.0, f32::NAN, f32::INFINITY] {
        let is = |e: &LdiError| matches!(e, LdiError::InverseDepth { face: f, x: 2, y: 0, .. } if *f == face);
        broken(
            "inverse depth",
            &|l| l.faces[2].samples[4].inverse_depth = q,
            &is,
        );
    }
    broken("depth order", &|l| l.faces[2].samples.swap(4, 5), &|e| {
        *e == LdiError::DepthOrder {
            face,
            x: 2,
            y: 0,
            layer: 1,
        }
    });
    broken(
        "texel lost",
        &|l| truncate(&mut l.environment.texels),
        &|e| matches!(e, LdiError::Environment(EnvironmentError::Size { .. })),
    );
    broken("texel alpha", &|l| l.environment.texels[3][3] = 7, &|e| {
        *e == LdiError::Environment(EnvironmentError::Alpha { index: 3, alpha: 7 })
    });
    type Damage = fn(&mut CubeSamples);
    let info: [(&str, Damage); 7] = [
        ("centre", |l| l.info.centre.y = f64::NAN),
        ("half_size_m", |l| l.info.half_size_m = 0.0),
        ("half_size_m", |l| l.info.half_size_m = f64::INFINITY),
        ("unit_m", |l| l.info.frame.unit_m = -1.0),
        ("exposure", |l| l.info.exposure = 0.0),
        ("missing_estimate", |l| {
            l.info.missing_estimate[3] = Some(1.5);
        }),
        ("missing_estimate", |l| {
            l.info.missing_estimate[0] = Some(f64::NAN);
        }),
    ];
    for (name, damage) in info {
        broken(
            name,
            &damage,
            &|e| matches!(e, LdiError::Info { field, .. } if *field == name),
        );
    }
}

#[test]
fn every_broken_invariant_is_named() {
    use SegmentProblem as P;
    let whole =
        CubeLdi::pack(&small_ldi(), SplatIndexLayout::Normal, Split::AtDepth(2.0)).expect("packs");
    whole.validate().expect("valid");
    assert_eq!(whole.segments.len(), 12);
    // Segment 4 is the far one of +Y, 5 the near one.
    let broken =
        |name: &str, damage: &dyn Fn(&mut CubeLdi), expected: &dyn Fn(&PackedError) -> bool| {
            let mut cube = whole.clone();
            damage(&mut cube);
            let error = cube.validate().expect_err(name);
            assert!(expected(&error), "{name}: {error:?}");
            assert!(!error.to_string().is_empty());
        };
    let in_segment = |name: &str, damage: &dyn Fn(&mut CubeLdi), expected: &dyn Fn(&P) -> bool| {
        let in_face = |e: &PackedError| matches!(e, PackedError::Segment { face: Face::PosY, problem, .. } if expected(problem));
        broken(name, damage, &in_face);
    };
    broken("face size 0", &|c| c.face_size_px = 0, &|e| {
        *e == PackedError::FaceSize(0)
    });
    broken("face size", &|c| c.face_size_px = 1 << 20, &|e| {
        *e == PackedError::FaceSize(1 << 20)
    });
    broken("order", &|c| c.segments.swap(4, 5), &|e| {
        *e == PackedError::SegmentOrder(5)
    });
    broken("twice", &|c| c.segments[5] = c.segments[4].clone(), &|e| {
        *e == PackedError::SegmentOrder(5)
    });
    broken("info", &|c| c.info.frame.unit_m = 0.0, &|e| {
        matches!(e, PackedError::Shared(_))
    });
    broken("environment", &|c| c.environment.size_px = 3, &|e| {
        matches!(e, PackedError::Shared(_))
    });
    let empty = |c: &mut CubeLdi| c.segments[4].depth_pixels.clear();
    in_segment("empty", &empty, &|p| *p == P::Empty);
    in_segment("x0", &|c| c.segments[4].x0 = 1, &|p| *p == P::Rectangle);
    in_segment("y0", &|c| c.segments[4].y0 = u32::MAX, &|p| {
        *p == P::Rectangle
    });
    in_segment("width", &|c| c.segments[4].width = 0, &|p| {
        *p == P::Rectangle
    });
    in_segment("height", &|c| c.segments[4].height = 4, &|p| {
        *p == P::Rectangle
    });
    in_segment("range", &|c| c.segments[4].inverse_depth_min = 0.0, &|p| {
        matches!(p, P::InverseDepthRange(..))
    });
    in_segment(
        "range",
        &|c| c.segments[4].inverse_depth_max = f32::NAN,
        &|p| matches!(p, P::InverseDepthRange(..)),
    );
    in_segment("range", &|c| c.segments[4].inverse_depth_max = 0.1, &|p| {
        matches!(p, P::InverseDepthRange(..))
    });
    in_segment("split", &|c| c.segments[4].inverse_depth_max = 1.5, &|p| {
        *p == P::SplitPlane
    });
    in_segment(
        "offset count",
        &|c| truncate(&mut c.segments[4].row_offsets),
        &|p| matches!(p, P::RowOffsetCount { .. }),
    );
    in_segment("count count", &|c| c.segments[4].row_counts.push(0), &|p| {
        matches!(p, P::RowCountCount { .. })
    });
    in_segment("offset 0", &|c| c.segments[4].row_offsets[0] = 1, &|p| {
        *p == P::RowOffsets(0)
    });
    in_segment("offset end", &|c| c.segments[4].row_offsets[3] = 8, &|p| {
        *p == P::RowOffsets(3)
    });
    in_segment(
        "offset falls",
        &|c| c.segments[4].row_offsets[1] = 9,
        &|p| matches!(p, P::RowCounts(0)),
    );
    in_segment("count 0", &|c| c.segments[4].row_counts[4] = 1, &|p| {
        *p == P::RowCounts(1)
    });
    in_segment("count falls", &|c| c.segments[4].row_counts[2] = 0, &|p| {
        *p == P::RowCounts(0)
    });
    in_segment("count end", &|c| c.segments[4].row_counts[3] = 4, &|p| {
        *p == P::RowCounts(0)
    });
    let spare = |c: &mut CubeLdi| c.segments[4].depth_pixels[2].geometry |= 1 << 31;
    in_segment("spare bit", &spare, &|p| *p == P::Bits(2));
    let index = |c: &mut CubeLdi| c.segments[4].depth_pixels[2].geometry |= 0x7ff << 20;
    in_segment("splat index", &index, &|p| *p == P::Bits(2));
    let out_of_order = |c: &mut CubeLdi| {
        let segment = &mut c.segments[4];
        // Both samples of the row in one pixel, nearer first.
        segment.row_counts[..4].copy_from_slice(&[0, 2, 2, 3]);
        let at = |geometry| PackedDepthPixel {
            geometry,
            color_srgb: [0; 4],
        };
        (segment.depth_pixels[0], segment.depth_pixels[1]) = (at(7), at(6));
    };
    in_segment("depth order", &out_of_order, &|p| {
        *p == P::DepthOrder { x: 0, y: 0 }
    });
    let loose = |c: &mut CubeLdi| {
        let segment = &mut c.segments[4];
        segment.row_counts = [[0, 1, 3, 3]; 3].concat();
    };
    in_segment("loose", &loose, &|p| *p == P::LooseRectangle);
}
