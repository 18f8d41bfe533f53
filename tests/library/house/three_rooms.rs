//! Three rooms in a row for the tests of houses, their backdrops, and truth.

use glam::{DVec2, DVec3, Vec3, dvec3};
use headbox_core::camera::Camera;
use headbox_core::frame::Frame;
use headbox_core::random::Rng;
use headbox_house::backdrop::{Backdrop, BackdropKind, BackdropQuality, PortalSide};
use headbox_house::house::House;
use headbox_house::store::Store;
use headbox_model::{Cell, Portal, PortalModel, Prism};
use headbox_scene::material::Material;
use headbox_scene::scene::Scene;
use headbox_scene::scene::{Sky, Triangle};
use headbox_trace::bvh::Ray;
use std::sync::Arc;

/// Quads under construction, cell by cell.
#[derive(Default)]
struct Build {
    scene: Scene,
    random: Option<Rng>,
}

impl Build {
    /// A quad divided into squares of about 0.5 m, each of a colour near the given one.
    fn quad(&mut self, [a, b, c, d]: [DVec3; 4], color: Vec3) {
        let cells = |p: DVec3, q: DVec3| (((q - p).length() / 0.5).ceil() as usize).max(1);
        let (columns, rows) = (cells(a, b), cells(a, d));
        let at = |u: f64, v: f64| {
            a * (1.0 - u) * (1.0 - v) + b * u * (1.0 - v) + c * u * v + d * (1.0 - u) * v
        };
        for i in 0..columns * rows {
            let (x, y) = ((i % columns) as f64, (i / columns) as f64);
            let first = self.scene.positions.len() as u32;
            let shade = self.random.get_or_insert(Rng::keyed(2)).between(0.6, 1.0) as f32;
            for (dx, dy) in [(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)] {
                self.scene
                    .positions
                    .push(at((x + dx) / columns as f64, (y + dy) / rows as f64));
                self.scene.colors.push(color * shade);
            }
            for vertices in [[first, first + 1, first + 2], [first, first + 2, first + 3]] {
                self.scene.triangles.push(Triangle {
                    vertices,
                    material: 0,
                });
            }
        }
    }

    /// A box seen from inside and outside.
    fn cuboid(&mut self, low: DVec3, high: DVec3, color: Vec3) {
        let p = |x: u8, y: u8, z: u8| {
            let pick = |axis: usize, k: u8| if k == 0 { low[axis] } else { high[axis] };
            dvec3(pick(0, x), pick(1, y), pick(2, z))
        };
        let faces = [
            [p(0, 0, 0), p(1, 0, 0), p(1, 1, 0), p(0, 1, 0)],
            [p(0, 0, 1), p(1, 0, 1), p(1, 1, 1), p(0, 1, 1)],
            [p(0, 0, 0), p(0, 0, 1), p(0, 1, 1), p(0, 1, 0)],
            [p(1, 0, 0), p(1, 0, 1), p(1, 1, 1), p(1, 1, 0)],
            [p(0, 0, 0), p(1, 0, 0), p(1, 0, 1), p(0, 0, 1)],
            [p(0, 1, 0), p(1, 1, 0), p(1, 1, 1), p(0, 1, 1)],
        ];
        faces.into_iter().for_each(|face| self.quad(face, color));
    }
}

const DOOR: [f64; 2] = [1.5, 2.5];
const DOOR_HEIGHT: f64 = 2.0;

/// Three rooms of 4 by 4 by 2.5 m in a row along x, a door between neighbours, a table in each, and
/// the sky over nothing: the last room has no end wall.
pub(crate) fn three_rooms() -> PortalModel {
    rooms(Some([dvec3(2.2, 0.0, 2.4), dvec3(2.9, 0.7, 3.2)]))
}

/// The three rooms with a box in each, relative to the room's corner.
pub(crate) fn rooms(cuboid: Option<[DVec3; 2]>) -> PortalModel {
    let mut build = Build::default();
    let mut cells = Vec::new();
    let colors = [
        Vec3::new(0.8, 0.5, 0.4),
        Vec3::new(0.4, 0.7, 0.5),
        Vec3::new(0.4, 0.5, 0.9),
    ];
    for (i, color) in colors.into_iter().enumerate() {
        let first = build.scene.triangles.len() as u32;
        let (x0, x1) = (4.0 * i as f64, 4.0 * i as f64 + 4.0);
        let at = |x: f64, y: f64, z: f64| dvec3(x, y, z);
        build.quad(
            [
                at(x0, 0.0, 0.0),
                at(x1, 0.0, 0.0),
                at(x1, 0.0, 4.0),
                at(x0, 0.0, 4.0),
            ],
            color * 0.5,
        );
        build.quad(
            [
                at(x0, 2.5, 0.0),
                at(x1, 2.5, 0.0),
                at(x1, 2.5, 4.0),
                at(x0, 2.5, 4.0),
            ],
            Vec3::ONE,
        );
        build.quad(
            [
                at(x0, 0.0, 0.0),
                at(x1, 0.0, 0.0),
                at(x1, 2.5, 0.0),
                at(x0, 2.5, 0.0),
            ],
            color,
        );
        build.quad(
            [
                at(x0, 0.0, 4.0),
                at(x1, 0.0, 4.0),
                at(x1, 2.5, 4.0),
                at(x0, 2.5, 4.0),
            ],
            color,
        );
        if i == 0 {
            build.quad(
                [
                    at(x0, 0.0, 0.0),
                    at(x0, 0.0, 4.0),
                    at(x0, 2.5, 4.0),
                    at(x0, 2.5, 0.0),
                ],
                color,
            );
        }
        // The half of each wall that faces this room; the two sheets are very close.
        for (wall, inside) in [(x0, 0.0002), (x1, -0.0002)] {
            if wall > 0.0 && wall < 12.0 {
                let x = wall + inside;
                build.quad(
                    [
                        at(x, 0.0, 0.0),
                        at(x, 0.0, DOOR[0]),
                        at(x, 2.5, DOOR[0]),
                        at(x, 2.5, 0.0),
                    ],
                    color,
                );
                build.quad(
                    [
                        at(x, 0.0, DOOR[1]),
                        at(x, 0.0, 4.0),
                        at(x, 2.5, 4.0),
                        at(x, 2.5, DOOR[1]),
                    ],
                    color,
                );
                let top = [
                    at(x, DOOR_HEIGHT, DOOR[0]),
                    at(x, DOOR_HEIGHT, DOOR[1]),
                    at(x, 2.5, DOOR[1]),
                    at(x, 2.5, DOOR[0]),
                ];
                build.quad(top, color);
            }
        }
        if let Some([low, high]) = cuboid {
            build.cuboid(
                low + DVec3::X * x0,
                high + DVec3::X * x0,
                Vec3::new(0.7, 0.6, 0.2),
            );
        }
        let corners = [[x0, 0.0], [x1, 0.0], [x1, 4.0], [x0, 4.0]];
        let space = vec![Prism {
            outline: corners.map(DVec2::from).to_vec(),
            floor_y: 0.0,
            ceiling_y: 2.5,
        }];
        cells.push(Cell {
            name: format!("room {i}"),
            space,
            triangles: first..build.scene.triangles.len() as u32,
        });
    }
    build.scene.materials = vec![Material {
        albedo: [1.0; 3],
        ..Material::default()
    }];
    build.scene.sky = Some(Sky::default());
    let door = |i: u32| {
        let x = 4.0 * f64::from(i) + 4.0;
        let corner = |y: f64, z: f64| dvec3(x, y, z);
        // Counter-clockwise seen from smaller x.
        let polygon = vec![
            corner(0.0, DOOR[0]),
            corner(0.0, DOOR[1]),
            corner(DOOR_HEIGHT, DOOR[1]),
            corner(DOOR_HEIGHT, DOOR[0]),
        ];
        Portal {
            name: format!("door {i}"),
            cells: [i, i + 1],
            polygon,
        }
    };
    PortalModel {
        scene: build.scene,
        cells,
        portals: vec![door(0), door(1)],
        outside: None,
    }
}

pub(crate) fn house() -> House {
    House::new(three_rooms()).expect("a valid model")
}

pub(crate) const QUALITY: BackdropQuality = BackdropQuality {
    face_px: 128,
    window_face_px: 128,
    window_back_m: 0.5,
    images: 3,
    radius_m: 1.5,
    eye_height_m: 1.5,
    texture_px: 64,
    strata: 12,
    rays: 12,
    seed: 0,
};

/// A store with one kind of backdrop for every side of every portal.
pub(crate) fn stocked(house: &House, kind: BackdropKind) -> Store {
    let store = Store::new(1 << 30);
    for portal in 0..house.plan().portals.len() as u32 {
        for side in [0, 1] {
            let at = PortalSide { portal, side };
            let backdrop = Backdrop::capture(house, at, kind, &QUALITY).expect("a capture");
            assert!(store.insert((at, kind), Arc::new(backdrop)));
        }
    }
    store
}

pub(crate) fn camera(eye: DVec3, at: DVec3) -> Camera {
    Camera::look_at(eye, at, DVec3::Y, 65.0, [80, 64]).expect("valid")
}

/// A camera at the same position with `scale` times the pixels.
pub(crate) fn enlarged(camera: &Camera, scale: u32) -> Camera {
    let (width, height) = (camera.width() * scale, camera.height() * scale);
    Camera::from_parts(
        camera.eye(),
        camera.world_from_eye(),
        camera.focal_px() * f64::from(scale),
        width,
        height,
    )
    .expect("valid")
}

/// One ray through the centre of each pixel.
pub(crate) fn truth(house: &House, camera: &Camera) -> Vec<[u8; 3]> {
    let pixel = |i: u32| {
        let (x, y) = (
            f64::from(i % camera.width()) + 0.5,
            f64::from(i / camera.width()) + 0.5,
        );
        let origin = (camera.eye() - house.tracer().origin()).as_vec3();
        let ray = Ray {
            origin,
            direction: camera.direction(x, y).as_vec3(),
            t_min: 0.0,
            t_max: f32::INFINITY,
        };
        let lighting = house.lighting();
        lighting.stored(match house.tracer().closest(&ray) {
            Some(hit) => lighting.unlit_radiance(house.tracer(), &hit),
            None => lighting.miss_radiance(ray.direction.normalize()).into(),
        })
    };
    (0..camera.width() * camera.height()).map(pixel).collect()
}

/// Maximum difference in levels of two colours of the same square of a wall.
pub(crate) const SAME_SQUARE_LEVELS: u8 = 4;

/// Among the pixels for which `counts` is true, the share that matches no truth pixel within one
/// pixel.
pub(crate) fn wrong_share(frame: &Frame, truth: &[[u8; 3]], counts: impl Fn(usize) -> bool) -> f64 {
    let (width, height) = (i64::from(frame.width), i64::from(frame.height));
    let (mut wrong, mut all) = (0, 0);
    for i in (0..frame.color.len()).filter(|&i| counts(i)) {
        let (x, y) = (i as i64 % width, i as i64 / width);
        let near = (-1..=1).flat_map(|dy| (-1..=1).map(move |dx| (x + dx, y + dy)));
        let same = near
            .filter(|(x, y)| (0..width).contains(x) && (0..height).contains(y))
            .any(|(x, y)| {
                let expected = truth[(y * width + x) as usize];
                (0..3).all(|c| expected[c].abs_diff(frame.color[i][c]) <= SAME_SQUARE_LEVELS)
            });
        all += 1;
        wrong += u32::from(!same);
    }
    f64::from(wrong) / f64::from(all.max(1))
}

pub(crate) fn poses() -> [Camera; 4] {
    [
        camera(dvec3(1.0, 1.5, 2.0), dvec3(4.0, 1.2, 2.0)),
        camera(dvec3(1.6, 1.1, 1.2), dvec3(4.0, 1.0, 2.2)),
        camera(dvec3(6.3, 1.6, 3.2), dvec3(4.0, 1.2, 1.8)),
        camera(dvec3(9.5, 1.5, 2.4), dvec3(4.0, 1.2, 2.0)),
    ]
}

/// Returns true if all truth pixels within `reach` of a pixel show one square of a wall.
fn is_within_a_square(
    truth: &[[u8; 3]],
    [width, height]: [u32; 2],
    pixel: usize,
    reach: i64,
) -> bool {
    let (x, y) = (
        i64::from(pixel as u32 % width),
        i64::from(pixel as u32 / width),
    );
    let (columns, rows) = (x - reach..=x + reach, y - reach..=y + reach);
    let inside = *columns.start() >= 0
        && *columns.end() < width.into()
        && *rows.start() >= 0
        && *rows.end() < height.into();
    let of = |x: i64, y: i64| truth[y as usize * width as usize + x as usize];
    inside
        && rows.into_iter().all(|y| {
            columns
                .clone()
                .all(|x| is_same_square(of(x, y), truth[pixel]))
        })
}

fn is_same_square(a: [u8; 3], b: [u8; 3]) -> bool {
    (0..3).all(|c| a[c].abs_diff(b[c]) <= SAME_SQUARE_LEVELS)
}

/// Share of wrong pixels among those for which `counts` is true and that lie at least `reach`
/// pixels inside a square, and the number of the latter.
pub(crate) fn wrong_squares(
    frame: &Frame,
    truth: &[[u8; 3]],
    reach: i64,
    counts: impl Fn(usize) -> bool,
) -> (f64, usize) {
    let size = [frame.width, frame.height];
    let judged =
        (0..frame.color.len()).filter(|&i| counts(i) && is_within_a_square(truth, size, i, reach));
    let wrong = |i: &usize| !is_same_square([0, 1, 2].map(|c| frame.color[*i][c]), truth[*i]);
    let judged: Vec<usize> = judged.collect();
    (
        judged.iter().filter(|i| wrong(i)).count() as f64 / judged.len().max(1) as f64,
        judged.len(),
    )
}

/// Mean difference from truth of the pixels for which `counts` is true, levels.
pub(crate) fn mean_error(frame: &Frame, truth: &[[u8; 3]], counts: impl Fn(usize) -> bool) -> f64 {
    let counted: Vec<usize> = (0..frame.color.len()).filter(|&i| counts(i)).collect();
    let off = |i: &usize| {
        (0..3)
            .map(|c| u32::from(frame.color[*i][c].abs_diff(truth[*i][c])))
            .sum::<u32>()
    };
    f64::from(counted.iter().map(off).sum::<u32>()) / 3.0 / counted.len().max(1) as f64
}
