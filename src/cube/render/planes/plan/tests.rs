//! Rays through the middles of pixels, held against the spans of pictures on planes.

use super::*;
use headbox_core::random::Rng;

pub(in crate::render::planes) const FACE_PX: u32 = 64;

pub(in crate::render::planes) fn one_picture(
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

/// What a ray of a camera shows of the first picture's plane: column and row among its texels, w, and inverse depth in the frame.
pub(in crate::render::planes) fn traced(
    set: &PlaneSet,
    camera: &Camera,
    [x, y]: [u32; 2],
) -> Option<[f64; 4]> {
    let (n, tile) = (set.planes[0].normal_per_distance.as_dvec3(), set.tiles[0]);
    let direction = camera.direction(f64::from(x) + 0.5, f64::from(y) + 0.5);
    let eye_depth = (1.0 - n.dot(camera.eye())) / n.dot(direction);
    let face = Face::ALL[usize::from(tile.face)];
    let [column, row, depth] = face.project(camera.eye() + direction * eye_depth, FACE_PX);
    let shows = eye_depth > 0.0 && depth > 0.0;
    let [column, row] = [
        column - f64::from(tile.x0) - 0.5,
        row - f64::from(tile.y0) - 0.5,
    ];
    shows.then_some([column, row, eye_depth / depth, 1.0 / eye_depth])
}

/// The level at which the picture's texels are about as large as frame pixels, from where a small square in its middle lands.
fn expected_level(set: &PlaneSet, camera: &Camera) -> usize {
    let tile = set.tiles[0];
    let (face, n) = (
        Face::ALL[usize::from(tile.face)],
        set.planes[0].normal_per_distance.as_dvec3(),
    );
    let middle = |start: i16, length: u16| f64::from(start) + f64::from(length) / 2.0;
    let at = |dx: f64, dy: f64| {
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
    let ([a, b], [c, d]) = (
        [at(-1e-3, 0.0), at(1e-3, 0.0)],
        [at(0.0, -1e-3), at(0.0, 1e-3)],
    );
    let area_px = ((b[0] - a[0]) * (d[1] - c[1]) - (b[1] - a[1]) * (d[0] - c[0])).abs() / 4e-6;
    (0..mips::LEVELS)
        .find(|level| area_px * 4f64.powi((level / 2) as i32) >= LEAST_AREA_PX[level % 2])
        .unwrap_or(mips::LEVELS)
}

/// Texels by which f32 may err that runs along a row of 60 pixels, and depths, relatively.
const TOLERANCE: f64 = 2e-3;

#[test]
fn spans_are_the_pixels_whose_rays_meet_the_picture() {
    let (mut random, mut covered, mut levels, mut partly) =
        (Rng::keyed(4), 0, [0; mips::LEVELS + 1], 0);
    for i in 0..400 {
        let face = Face::ALL[i % 6];
        // A plane before the face, leaning, and an eye that may lie beyond it or beside it.
        let n = (face.normal() + random.in_cube(0.7)) * random.between(0.3, 1.5);
        let at = [0; 2].map(|_: i16| random.below(40) as i16 - 1);
        let size = [0; 2].map(|_: u16| 2 + random.below(24) as u16);
        let set = one_picture(n, face, at, size);
        let corners = [0, 1, 2, 3].map(|corner| {
            let [x, y] = [0, 1].map(|i| {
                f64::from(at[i]) + 0.5 + f64::from(size[i] - 1) * f64::from(corner >> i & 1)
            });
            face.direction(x, y, FACE_PX)
                / set.planes[0]
                    .normal_per_distance
                    .as_dvec3()
                    .dot(face.direction(x, y, FACE_PX))
        });
        // A picture lies before its face, wholly, and not at infinity.
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
            .map(|i| traced(&set, &camera, [i % 60, i / 60]).filter(|[.., w, _]| *w >= W_NEAR))
            .collect();
        let [right, lower] = size.map(|length| f64::from(length) - 1.0);
        let Some(tile) = view.tiles.first() else {
            let inside = |ray: &&Option<[f64; 4]>| {
                ray.is_some_and(|[u, v, ..]| {
                    (0.0..=right).contains(&u) && (0.0..=lower).contains(&v)
                })
            };
            assert_eq!(
                rays.iter().filter(inside).count(),
                0,
                "left out, and yet there"
            );
            continue;
        };
        let scale = 1.0 / f64::from(1 << mips::halvings(tile.level));
        let mut rows = Vec::new();
        for y in 0..44 {
            let span = tile.span(y, &view.frame);
            for x in 0..60 {
                let found = span.as_ref().filter(|span| span.columns.contains(&x));
                // Pixels on the border itself may belong or not; a hair wider than the overlap of smaller pictures.
                let hair = OVERLAP / scale + 1e-6;
                let from_border = |v: f64, end: f64| (v + hair).min(end + hair - v);
                let ray = rays[(y * 60 + x) as usize];
                let inside = ray.map_or(-1.0, |[u, v, ..]| {
                    from_border(u, right).min(from_border(v, lower))
                });
                let Some(span) = found else {
                    assert!(inside <= 2e-6, "{x}, {y} is missing by {inside}");
                    continue;
                };
                assert!(inside >= 0.0, "{x}, {y} is too much by {inside}");
                let Some([u, v, w, q]) = ray else { continue };
                let [fu, fv, fw, fq]: [f64; 4] = std::array::from_fn(|i| {
                    f64::from(span.start[i])
                        + f64::from(span.step[i]) * f64::from(x - span.columns.start)
                });
                let close = |found: f64, expected: f64, size: f64| {
                    (found - expected).abs() < TOLERANCE * size
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
            let seen = camera.project(corner)?;
            (seen[2] / corner.dot(face.normal()) >= W_NEAR).then_some(seen)
        });
        let in_front = in_frame.iter().all(Option::is_some);
        if in_front {
            assert_eq!(tile.level, expected_level(&set, &camera));
            levels[tile.level] += 1;
            let of_all = |pick: fn(f64, f64) -> f64, start: f64| {
                [1, 2].map(|i| {
                    in_frame
                        .iter()
                        .flatten()
                        .map(|corner| corner[i])
                        .fold(start, pick)
                })
            };
            let ([top, nearest_m], [bottom, _]) = (
                of_all(f64::min, f64::INFINITY),
                of_all(f64::max, f64::NEG_INFINITY),
            );
            // Rows whose middles lie between the uppermost and the lowest corner, or one more.
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
    assert!(partly > 0, "before and behind the eye");
}

#[test]
fn nearest_pictures_come_first_and_wrong_ones_are_left_out() {
    let face = Face::PosX;
    let mut set = one_picture(face.normal() * 0.5, face, [10, 10], [9, 9]);
    let (far, near) = (set.tiles[0], set.planes[0].normal_per_distance * 3.0);
    set.planes.push(Plane {
        normal_per_distance: near,
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
