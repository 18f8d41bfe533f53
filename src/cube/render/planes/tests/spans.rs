//! Spans of plane textures against rays through pixel centres.

use crate::pack::plane_textures::mips;
use crate::pack::{Plane, PlaneSet, PlaneTile};
use crate::render::planes::plan::{LEAST_AREA_PX, OVERLAP, PlanesInView, W_NEAR};
use glam::DVec3;
use headbox_core::camera::Camera;
use headbox_core::cube_face::Face;
use headbox_core::random::Rng;

pub(super) const FACE_PX: u32 = 64;

pub(super) fn one_texture(
    normal_per_distance: DVec3,
    face: Face,
    [x0, y0]: [i16; 2],
    [width, height]: [u16; 2],
) -> PlaneSet {
    let face = face.index() as u16;
    let tile = PlaneTile {
        plane: 0,
        first_texel: 0,
        x0,
        y0,
        width,
        height,
        face,
        opaque: 1,
    };
    let plane = Plane {
        normal_per_distance: normal_per_distance.as_vec3(),
    };
    let texels = vec![[0; 4]; tile.texel_count()];
    PlaneSet {
        error_px: 1.0,
        planes: vec![plane],
        tiles: vec![tile],
        texels,
        ..PlaneSet::default()
    }
}

/// Traces a camera ray to the first texture's plane: column and row among its texels, w, and
/// inverse depth in the frame.
pub(super) fn trace(set: &PlaneSet, camera: &Camera, [x, y]: [u32; 2]) -> Option<[f64; 4]> {
    let n = set.planes[0].normal_per_distance.as_dvec3();
    let tile = set.tiles[0];
    let direction = camera.direction(f64::from(x) + 0.5, f64::from(y) + 0.5);
    let eye_depth = (1.0 - n.dot(camera.eye())) / n.dot(direction);
    let face = Face::ALL[usize::from(tile.face)];
    let [column, row, depth] = face.project(camera.eye() + direction * eye_depth, FACE_PX);
    let is_hit = eye_depth > 0.0 && depth > 0.0;
    let column = column - f64::from(tile.x0) - 0.5;
    let row = row - f64::from(tile.y0) - 0.5;
    is_hit.then_some([column, row, eye_depth / depth, 1.0 / eye_depth])
}

/// Returns the mip level at which the texels are about as large as frame pixels, by projecting a
/// small square in the middle.
fn expected_mip_level(set: &PlaneSet, camera: &Camera) -> usize {
    let tile = set.tiles[0];
    let face = Face::ALL[usize::from(tile.face)];
    let n = set.planes[0].normal_per_distance.as_dvec3();
    let middle = |start: i16, length: u16| f64::from(start) + f64::from(length) / 2.0;
    let project = |dx: f64, dy: f64| {
        let direction = face.direction(
            middle(tile.x0, tile.width) + dx,
            middle(tile.y0, tile.height) + dy,
            FACE_PX,
        );
        let [x, y, _] = camera
            .project(direction / n.dot(direction))
            .expect("in front");
        [x, y]
    };
    let [a, b] = [project(-1e-3, 0.0), project(1e-3, 0.0)];
    let [c, d] = [project(0.0, -1e-3), project(0.0, 1e-3)];
    let area_px = ((b[0] - a[0]) * (d[1] - c[1]) - (b[1] - a[1]) * (d[0] - c[0])).abs() / 4e-6;
    (0..mips::LEVELS)
        .find(|level| area_px * 4f64.powi((level / 2) as i32) >= LEAST_AREA_PX[level % 2])
        .unwrap_or(mips::LEVELS)
}

/// Tolerated error of f32 steps along a row of 60 pixels, texels; relative for depths.
const TOLERANCE: f64 = 2e-3;

#[test]
fn spans_are_pixels_whose_rays_hit_texture() {
    let mut random = Rng::keyed(4);
    let mut covered = 0;
    let mut levels = [0; mips::LEVELS + 1];
    let mut partly = 0;
    for i in 0..400 {
        let face = Face::ALL[i % 6];
        // An inclined plane in front of the face, and an eye anywhere near it.
        let n = (face.normal() + random.in_cube(0.7)) * random.between(0.3, 1.5);
        let origin = [0; 2].map(|_: i16| random.below(40) as i16 - 1);
        let size = [0; 2].map(|_: u16| 2 + random.below(24) as u16);
        let set = one_texture(n, face, origin, size);
        let corners = [0, 1, 2, 3].map(|corner| {
            let [x, y] = [0, 1].map(|i| {
                f64::from(origin[i]) + 0.5 + f64::from(size[i] - 1) * f64::from(corner >> i & 1)
            });
            face.direction(x, y, FACE_PX)
                / set.planes[0]
                    .normal_per_distance
                    .as_dvec3()
                    .dot(face.direction(x, y, FACE_PX))
        });
        // Textures lie completely in front of the cube's centre, and not at infinity.
        if corners
            .iter()
            .any(|corner| !(0.0..20.0).contains(&corner.dot(face.normal())))
        {
            continue;
        }
        let eye = random.in_cube(0.8);
        let look = face.normal() + random.in_cube(0.6);
        let camera = Camera::look_at(
            eye,
            eye + look,
            DVec3::new(0.1, 0.9, 0.2),
            random.between(30.0, 120.0),
            [60, 44],
        );
        let camera = camera.expect("valid").with_principal_px([21.0, 30.5]);
        let mut view = PlanesInView::default();
        view.prepare(&set, &camera, eye, FACE_PX);
        let rays: Vec<Option<[f64; 4]>> = (0..60 * 44)
            .map(|i| trace(&set, &camera, [i % 60, i / 60]).filter(|[.., w, _]| *w >= W_NEAR))
            .collect();
        let [right, lower] = size.map(|length| f64::from(length) - 1.0);
        let Some(tile) = view.tiles.first() else {
            let inside = |ray: &&Option<[f64; 4]>| {
                ray.is_some_and(|[u, v, ..]| {
                    (0.0..=right).contains(&u) && (0.0..=lower).contains(&v)
                })
            };
            assert_eq!(rays.iter().filter(inside).count(), 0, "culled, but visible");
            continue;
        };
        let scale = 1.0 / f64::from(1 << mips::halvings(tile.level));
        let mut rows = Vec::new();
        for y in 0..44 {
            let span = tile.span(y, &view.frame);
            for x in 0..60 {
                let covering = span.as_ref().filter(|span| span.columns.contains(&x));
                // Pixels on the border may belong or not: slightly more than the overlap at the mip
                // level.
                let margin = OVERLAP / scale + 1e-6;
                let from_border = |v: f64, end: f64| (v + margin).min(end + margin - v);
                let ray = rays[(y * 60 + x) as usize];
                let inside = ray.map_or(-1.0, |[u, v, ..]| {
                    from_border(u, right).min(from_border(v, lower))
                });
                let Some(span) = covering else {
                    assert!(inside <= 2e-6, "{x}, {y} is missing, {inside} inside");
                    continue;
                };
                assert!(inside >= 0.0, "{x}, {y} is covered, {inside} inside");
                let Some([u, v, w, q]) = ray else { continue };
                let [fu, fv, fw, fq]: [f64; 4] = std::array::from_fn(|i| {
                    f64::from(span.start[i])
                        + f64::from(span.step[i]) * f64::from(x - span.columns.start)
                });
                let close = |actual: f64, expected: f64, size: f64| {
                    (actual - expected).abs() < TOLERANCE * size
                };
                assert!(
                    close(fu / fw, u * scale, 1.0) && close(fv / fw, v * scale, 1.0),
                    "{u}, {v}: {fu}, {fv} / {fw}"
                );
                assert!(
                    close(fw * w, 1.0, 1.0) && close(fq, q, q),
                    "{w}, {q}: {fw}, {fq}"
                );
                covered += 1;
                rows.push(y);
            }
        }
        if let (Some(first), Some(last)) = (rows.first(), rows.last()) {
            assert!(
                tile.rows.contains(first) && tile.rows.contains(last),
                "{:?}: {rows:?}",
                tile.rows
            );
        }
        let in_frame = corners.map(|corner| {
            let projected = camera.project(corner)?;
            (projected[2] / corner.dot(face.normal()) >= W_NEAR).then_some(projected)
        });
        let in_front = in_frame.iter().all(Option::is_some);
        if in_front {
            assert_eq!(tile.level, expected_mip_level(&set, &camera));
            levels[tile.level] += 1;
            let fold_corners = |pick: fn(f64, f64) -> f64, start: f64| {
                [1, 2].map(|i| {
                    in_frame
                        .iter()
                        .flatten()
                        .map(|corner| corner[i])
                        .fold(start, pick)
                })
            };
            let [top, nearest_m] = fold_corners(f64::min, f64::INFINITY);
            let [bottom, _] = fold_corners(f64::max, f64::NEG_INFINITY);
            // Rows whose centres lie between the uppermost and the lowest corner, or one more.
            assert!(
                f64::from(tile.rows.start) >= (top - 1.6).clamp(0.0, 44.0),
                "{:?} {top}",
                tile.rows
            );
            assert!(
                f64::from(tile.rows.end) <= (bottom + 1.6).clamp(0.0, 44.0),
                "{:?} {bottom}",
                tile.rows
            );
            assert!(
                (tile.nearest * nearest_m - 1.0).abs() < 1e-6,
                "{} {nearest_m}",
                tile.nearest
            );
        } else {
            assert_eq!((tile.level, tile.rows.clone()), (0, 0..44));
            partly += 1;
        }
    }
    assert!(
        covered > 5_000 && levels[..4].iter().all(|count| *count > 0),
        "{covered} {levels:?} {partly}"
    );
    assert!(partly > 0, "in front of the eye and behind it");
}

#[test]
fn textures_are_sorted_and_invalid_ones_skipped() {
    let face = Face::PosX;
    let mut set = one_texture(face.normal() * 0.5, face, [10, 10], [9, 9]);
    let far = set.tiles[0];
    set.planes.push(Plane {
        normal_per_distance: set.planes[0].normal_per_distance * 3.0,
    });
    set.tiles.push(PlaneTile { plane: 1, ..far });
    set.tiles.extend([
        PlaneTile { plane: 2, ..far },
        PlaneTile { face: 6, ..far },
        PlaneTile { width: 1, ..far },
    ]);
    set.tiles.push(PlaneTile {
        first_texel: 1,
        ..far
    });
    let camera =
        Camera::look_at(DVec3::ZERO, face.normal(), DVec3::Y, 90.0, [60, 44]).expect("valid");
    let mut view = PlanesInView::default();
    view.prepare(&set, &camera, DVec3::ZERO, FACE_PX);
    assert_eq!(
        view.tiles.iter().map(|tile| tile.index).collect::<Vec<_>>(),
        [1, 0]
    );
    assert_eq!(view.len(), 2);
    let back =
        Camera::look_at(DVec3::ZERO, -face.normal(), DVec3::Y, 90.0, [60, 44]).expect("valid");
    view.prepare(&set, &back, DVec3::ZERO, FACE_PX);
    assert_eq!(view.len(), 0);
}
