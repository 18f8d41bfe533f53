//! What overlays tell of a frame, against the frame itself and what clipping counts.

use super::*;
use crate::render::tests::{cameras, cube};
use crate::render::{RenderSettings, SplatKernel};

/// Samples of a segment's pixel (x, y) of the face.
fn samples(segment: &PackedSegment, x: u32, y: u32) -> u64 {
    segment.pixel(x - segment.x0, y - segment.y0).len() as u64
}

#[test]
fn a_pixels_fate_is_that_of_its_block_within_the_rectangle() {
    // Three blocks across from the second on, two down from the second on.
    let visible = vec![true, false, true, false, true, false];
    let kept = Kept { segment: 0, rectangle: [70..200, 20..40], visible };
    let (drawn, outside, hidden) = (Fate::Drawn, Fate::OutsideRectangle, Fate::HiddenBlock);
    let expected = [
        ([69, 25], outside),
        ([70, 19], outside),
        ([70, 20], drawn),
        ([127, 31], drawn),
        ([128, 31], hidden),
        ([192, 20], drawn),
        ([199, 31], drawn),
        ([200, 31], outside),
        ([127, 32], hidden),
        ([191, 39], drawn),
        ([192, 39], hidden),
        ([191, 40], outside),
    ];
    for ([x, y], fate) in expected {
        assert_eq!(kept.fate(x, y), fate, "pixel {x}, {y}");
    }
}

#[test]
fn what_is_kept_is_what_clipping_counts_and_runs_say_the_same() {
    let (cube, mut renderer) = (cube(), Renderer::new());
    let settings = RenderSettings { band_rows: 37, ..RenderSettings::default() };
    for camera in cameras() {
        let counts = renderer.clip_counts(&cube, &camera, &settings);
        let mut found = [0u64; 2];
        for kept in renderer.kept(&cube, &camera, &settings) {
            let segment = &cube.segments[kept.segment];
            for y in segment.y0..segment.y0 + segment.height {
                let mut next = 0;
                kept.for_each_run(segment, y, |fate, columns| {
                    assert_eq!(columns.start, next, "runs follow each other");
                    assert!(!columns.is_empty() && columns.end <= segment.width);
                    next = columns.end;
                    for x in columns.map(|column| segment.x0 + column) {
                        assert_eq!(kept.fate(x, y), fate, "pixel {x}, {y}");
                        found[usize::from(fate == Fate::Drawn)] += samples(segment, x, y);
                    }
                });
                assert_eq!(next, segment.width, "no column is left out");
            }
        }
        let [left_out, drawn] = found;
        assert!(left_out > 0 && drawn > 0);
        // What lies in segments that nothing of is kept is not among the kept.
        assert_eq!(drawn, counts.kept);
        assert!(left_out <= counts.culled + counts.clipped);
    }
}

#[test]
fn footprints_are_counted_wherever_rectangles_are_drawn_in_any_band() {
    let (cube, mut renderer) = (cube(), Renderer::new());
    let settings = RenderSettings { kernel: SplatKernel::Opaque, keep_holes: true, ..RenderSettings::default() };
    let mut counted = 0;
    for camera in cameras() {
        // Three bands, the last of them lower.
        let (eye, turn, focal_px) = (camera.eye(), camera.world_from_eye(), camera.focal_px());
        let camera = Camera::from_parts(eye, turn, focal_px, 61, 2 * BAND_ROWS + 11).expect("valid");
        let touched = renderer.touched(&cube, &camera, &settings);
        let frame = renderer.render(&cube, &camera, &settings);
        assert_eq!(touched.len(), frame.color.len());
        for (i, (touched, coverage)) in touched.iter().zip(&frame.coverage).enumerate() {
            let place = (i % 61, i / 61);
            // A sample of hardly any alpha has a footprint, and leaves nothing.
            assert!(touched.footprints > 0 || coverage.splat_share() == 0, "pixel {place:?}");
            assert_eq!(touched.footprints > 0, touched.width_px > 0.0, "pixel {place:?}");
            counted += touched.footprints;
        }
        // Bands of another frame lie elsewhere.
        let rows = 29..2 * BAND_ROWS + 5;
        let cropped = camera.cropped(0..61, rows.clone()).expect("valid");
        let part = &touched[29 * 61..(2 * BAND_ROWS as usize + 5) * 61];
        let alone = renderer.touched(&cube, &cropped, &settings);
        // Positions are rounded from another corner, so that a rare footprint ends a pixel farther.
        let others = alone.iter().zip(part).filter(|(alone, part)| alone != part).count();
        assert!(alone.len() == part.len() && others <= part.len() / 50, "rows {rows:?} alone: {others} differ");
    }
    assert!(counted > 1000, "{counted}");
}

#[test]
fn overlays_are_the_same_wherever_the_cube_stands() {
    let (here, mut renderer, settings) = (cube(), Renderer::new(), RenderSettings::default());
    let (mut there, moved) = (here.clone(), glam::DVec3::new(4.0, -2.0, 8.0));
    there.info.centre = moved;
    for camera in cameras() {
        let beside = camera.with_eye(camera.eye() + moved);
        assert_eq!(renderer.touched(&here, &camera, &settings), renderer.touched(&there, &beside, &settings));
        assert_eq!(renderer.kept(&here, &camera, &settings), renderer.kept(&there, &beside, &settings));
    }
}
