//! Overlays of rendering effort: footprint sizes, overdraw, and clipping.

use crate::pack::{CubeLdi, PackedSegment, SegmentSide};
use crate::render::reference::inspect::{ClipOutcome, ClippedSegment};
use crate::render::reference::overdraw::Overdraw;
use headbox_core::cube_face::Face;
use headbox_core::frame::Frame;
use headbox_core::view::paint::{
    NOTHING, Tops, class_color, class_legend, figure, opaque, swatch, tinted,
};
use headbox_core::view::{Figure, Swatch};

/// Upper ends of the colour classes of footprint width, px: most are between one and three.
const WIDTHS_PX: Tops = [1.5, 2.0, 2.5, 3.0, 4.0, 6.0];

/// Upper ends of the colour classes of overdraw, draws per pixel.
const TIMES: Tops = [1.0, 2.0, 4.0, 8.0, 16.0, 32.0];

/// Paints the width of the nearest footprint in each pixel, by classes; returns the mean width.
pub(super) fn paint_footprints(overdraw: &[Overdraw], pixels: &mut [[u8; 4]]) -> Vec<Figure> {
    let (mut sum_px, mut count) = (0.0, 0.0_f64);
    for (pixel, overdraw) in pixels.iter_mut().zip(overdraw) {
        let width_px = overdraw.width_px;
        *pixel = opaque(if width_px > 0.0 {
            class_color(width_px, &WIDTHS_PX)
        } else {
            NOTHING
        });
        sum_px += f64::from(width_px);
        count += f64::from(u8::from(width_px > 0.0));
    }
    vec![figure("width of footprints", sum_px / count.max(1.0), "px")]
}

pub(super) fn footprint_legend() -> Vec<Swatch> {
    class_legend("no footprint", &WIDTHS_PX, "px wide")
}

/// Paints the number of footprints drawn on each pixel, by classes; returns the mean and the
/// maximum.
pub(super) fn paint_overdraw(overdraw: &[Overdraw], pixels: &mut [[u8; 4]]) -> Vec<Figure> {
    let (mut sum, mut drawn, mut most) = (0_u64, 0_u64, 0);
    for (pixel, overdraw) in pixels.iter_mut().zip(overdraw) {
        let times = overdraw.footprints;
        *pixel = opaque(if times > 0 {
            class_color(times as f32, &TIMES)
        } else {
            NOTHING
        });
        sum += u64::from(times);
        drawn += u64::from(times > 0);
        most = most.max(times);
    }
    vec![
        figure("draws a pixel, mean", sum as f64 / drawn.max(1) as f64, ""),
        figure("draws a pixel, most", f64::from(most), ""),
    ]
}

pub(super) fn overdraw_legend() -> Vec<Swatch> {
    class_legend("never drawn", &TIMES, "x")
}

/// Column and row of each face in the unfolded cube: the sides in a row, +Y above -Z.
const UNFOLDED: [(Face, [usize; 2]); 6] = [
    (Face::PosY, [1, 0]),
    (Face::NegX, [0, 1]),
    (Face::NegZ, [1, 1]),
    (Face::PosX, [2, 1]),
    (Face::PosZ, [3, 1]),
    (Face::NegY, [1, 2]),
];

const OUTSIDE_COLOR: [u8; 3] = [213, 94, 0];
const HIDDEN_COLOR: [u8; 3] = [86, 180, 233];

/// Paints the unfolded faces of a cube over the dimmed frame: drawn samples in their own colours,
/// others tinted by the test that culled them.
pub(super) fn paint_clipping(
    cube: &CubeLdi,
    clipped: &[ClippedSegment],
    frame: &Frame,
    pixels: &mut [[u8; 4]],
) -> Vec<Figure> {
    for (pixel, &[r, g, b, _]) in pixels.iter_mut().zip(&frame.color) {
        *pixel = opaque([r, g, b].map(|c| c / 4));
    }
    let (width, height) = (frame.width as usize, frame.height as usize);
    let side = (width / 4).min(height / 3);
    let corner = [(width - 4 * side) / 2, (height - 3 * side) / 2];
    for (face, place) in UNFOLDED {
        // Near segments occlude far ones.
        let mut segments: Vec<_> = clipped
            .iter()
            .map(|clipped| (clipped, &cube.segments[clipped.segment]))
            .filter(|(_, segment)| segment.face == face)
            .collect();
        segments.sort_by_key(|(_, segment)| segment.side == SegmentSide::Far);
        let [left, top] = [0, 1].map(|axis| corner[axis] + place[axis] * side);
        let on_face = |i: usize| {
            ((i as u64 * 2 + 1) * u64::from(cube.face_size_px) / (2 * side as u64)) as u32
        };
        for (row, y) in (0..side).map(|i| (i, on_face(i))) {
            let row = &mut pixels[(top + row) * width + left..][..side];
            for (i, pixel) in row.iter_mut().enumerate() {
                *pixel = opaque(clip_color(&segments, on_face(i), y));
            }
        }
    }
    clipping_figures(cube, clipped)
}

/// Returns the colour of a face pixel, from the first segment with samples there.
fn clip_color(segments: &[(&ClippedSegment, &PackedSegment)], x: u32, y: u32) -> [u8; 3] {
    let nearest = segments.iter().find_map(|(clipped, segment)| {
        let [column, row] = [x.checked_sub(segment.x0)?, y.checked_sub(segment.y0)?];
        let inside = column < segment.width && row < segment.height;
        let nearest = inside.then(|| segment.pixel(column, row).last())??;
        Some((clipped.outcome(x, y), nearest.color_srgb))
    });
    let Some((outcome, [r, g, b, _])) = nearest else {
        return NOTHING;
    };
    let tint = match outcome {
        ClipOutcome::Drawn => return [r, g, b],
        ClipOutcome::OutsideRectangle => OUTSIDE_COLOR,
        ClipOutcome::HiddenBlock => HIDDEN_COLOR,
    };
    tinted(tint, [r, g, b])
}

/// Counts the depth pixels by outcome of clipping.
fn clipping_figures(cube: &CubeLdi, clipped: &[ClippedSegment]) -> Vec<Figure> {
    let [mut drawn, mut outside, mut hidden] = [0; 3];
    for clipped in clipped {
        let counts = clipped.counts(&cube.segments[clipped.segment]);
        drawn += counts[0];
        outside += counts[1];
        hidden += counts[2];
    }
    vec![
        figure("depth pixels kept", drawn as f64, ""),
        figure("outside of rectangles", outside as f64, ""),
        figure("in hidden blocks", hidden as f64, ""),
    ]
}

pub(super) fn clipping_legend() -> Vec<Swatch> {
    vec![
        swatch([200, 200, 200], "in its own colours: drawn"),
        swatch(OUTSIDE_COLOR, "outside of the view's rectangle on the face"),
        swatch(HIDDEN_COLOR, "in a block that the view cannot see"),
        swatch(NOTHING, "no depth pixels"),
    ]
}

#[cfg(test)]
mod tests {
    use super::super::tests::cube;
    use super::*;
    use crate::render::footprint::splat::SplatKernel;
    use crate::render::{RenderSettings, Renderer};
    use glam::{DVec3, dvec3};
    use headbox_core::camera::Camera;

    /// Views from off the centre: along the axes of the room, and askew.
    fn views(cube: &CubeLdi) -> Vec<Camera> {
        let eye = cube.info.centre + dvec3(0.3, -0.2, 0.25) * cube.info.half_size_m;
        let ahead = [DVec3::NEG_Z, DVec3::X, dvec3(0.4, -0.7, 0.6)];
        ahead
            .map(|ahead| Camera::look_at(eye, eye + ahead, DVec3::Y, 55.0, [90, 70]).unwrap())
            .to_vec()
    }

    #[test]
    fn clipped_samples_are_outside_frame() {
        const MARK: [u8; 4] = [255, 0, 220, 255];
        let cube = cube();
        let (mut renderer, settings) = (Renderer::new(), RenderSettings::default());
        for camera in views(&cube) {
            let clipped = renderer.clipped_segments(&cube, &camera, &settings);
            let mut marked = (*cube).clone();
            let (mut left_out, mut all) = (0, 0);
            for clipped in &clipped {
                let segment = &mut marked.segments[clipped.segment];
                for (x, y) in
                    (0..segment.height).flat_map(|y| (0..segment.width).map(move |x| (x, y)))
                {
                    let row = y as usize * (segment.width as usize + 1) + x as usize;
                    let [start, end] = [0, 1].map(|i| {
                        (segment.row_offsets[y as usize] + segment.row_counts[row + i]) as usize
                    });
                    all += end - start;
                    if clipped.outcome(segment.x0 + x, segment.y0 + y) != ClipOutcome::Drawn {
                        left_out += end - start;
                        segment.depth_pixels[start..end]
                            .iter_mut()
                            .for_each(|p| p.color_srgb = MARK);
                    }
                }
            }
            let counted: f64 = clipping_figures(&cube, &clipped)[1..]
                .iter()
                .map(|figure| figure.value)
                .sum();
            assert!(left_out > all / 4 && left_out < all, "{left_out} of {all}");
            assert_eq!(counted, left_out as f64);
            let expected = renderer.render(&cube, &camera, &settings).color.clone();
            assert!(renderer.render(&marked, &camera, &settings).color == expected);
        }
        let unclipped = RenderSettings {
            unclipped: true,
            ..settings
        };
        let clipped = renderer.clipped_segments(&cube, &views(&cube)[0], &unclipped);
        assert_eq!(
            clipping_figures(&cube, &clipped)[0].value,
            cube.depth_pixel_count() as f64
        );
    }

    #[test]
    fn touched_pixels_match_footprints() {
        let cube = cube();
        let mut renderer = Renderer::new();
        for (camera, kernel) in views(&cube).into_iter().zip(SplatKernel::ALL) {
            let name = kernel.name();
            let settings = RenderSettings {
                kernel,
                ..RenderSettings::default()
            };
            let overdraw = renderer.overdraw(&cube, &camera, &settings);
            let unclipped = RenderSettings {
                unclipped: true,
                ..settings
            };
            assert!(
                overdraw == renderer.overdraw(&cube, &camera, &unclipped),
                "{name}: clipping changes nothing"
            );
            let frame = renderer.render(&cube, &camera, &settings);
            for (i, (overdraw, coverage)) in overdraw.iter().zip(&frame.coverage).enumerate() {
                assert_eq!(overdraw.footprints > 0, overdraw.width_px > 0.0);
                // The paper's squares lie about the pixel of a sample rather than about the sample.
                let shows = coverage.splat_share() > 0;
                assert!(
                    kernel == SplatKernel::Paper || !shows || overdraw.footprints > 0,
                    "{name}: pixel {i}"
                );
            }
        }
    }

    #[test]
    fn unfolded_faces_fill_opaque_pixels() {
        let cube = cube();
        let (mut renderer, settings) = (Renderer::new(), RenderSettings::default());
        for size in [(320, 240), (7, 5), (1, 1)] {
            let eye = cube.info.centre;
            let camera =
                Camera::look_at(eye, eye + DVec3::NEG_Z, DVec3::Y, 55.0, [size.0, size.1]).unwrap();
            let clipped = renderer.clipped_segments(&cube, &camera, &settings);
            let frame = renderer.render(&cube, &camera, &settings).clone();
            let mut pixels = vec![[0; 4]; frame.color.len()];
            paint_clipping(&cube, &clipped, &frame, &mut pixels);
            assert!(pixels.iter().all(|p| p[3] == 255), "{size:?}");
        }
    }

    #[test]
    fn unfolded_faces_meet_at_edges() {
        // Adjacent faces have the same directions along their common edge.
        const SIZE: u32 = 8;
        let direction = |face: Face, [x, y]: [f64; 2]| face.direction(x, y, SIZE);
        let end = f64::from(SIZE);
        let mut edges = 0;
        for (a, [column, row]) in UNFOLDED {
            for (b, position) in UNFOLDED {
                for t in (0..=SIZE).map(f64::from) {
                    let (on_a, on_b) = if position == [column + 1, row] {
                        ([end, t], [0.0, t])
                    } else if position == [column, row + 1] {
                        ([t, end], [t, 0.0])
                    } else {
                        continue;
                    };
                    assert!(direction(a, on_a).distance(direction(b, on_b)) < 1e-12);
                    edges += 1;
                }
            }
        }
        assert_eq!(edges, 5 * (SIZE + 1));
    }
}
