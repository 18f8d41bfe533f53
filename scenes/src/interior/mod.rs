//! `interior`: a furnished room of 6 m by 5 m by 2.8 m, lit by sun and sky through three windows.

use crate::finishes::Finishes;
use crate::furniture;
use crate::mesh::{Mesh, Vertex};
use glam::{DVec2, DVec3, dvec3};
use headbox_core::random::Rng;
use headbox_scene::scene::Scene;
use std::f64::consts::PI;

/// Half of the room's width (x) and depth (z), and its height; inner faces of the walls, metres.
const ROOM: DVec3 = dvec3(3.0, 2.8, 2.5);

/// Thickness of the outer walls, metres.
const WALL: f64 = 0.25;

/// Period of the wallpaper, metres.
const WALLPAPER: f64 = 0.6;

/// A window: start and end along the wall, and heights of sill and lintel, metres.
#[derive(Clone, Copy)]
struct Window {
    from: f64,
    to: f64,
    sill: f64,
    lintel: f64,
}

pub(crate) fn build(seed: u64) -> Scene {
    let rng = Rng::new(seed);
    let mut mesh = Mesh::default();
    let finishes = Finishes::new(&mut mesh, seed);
    add_shell(&mut mesh, &finishes);
    add_garden(&mut mesh, &finishes);
    add_lounge(&mut mesh, &finishes, &rng);
    add_dining(&mut mesh, &finishes);
    mesh.finish("interior", dvec3(0.2, 1.45, 0.9), 0.4)
}

/// Adds floor, ceiling, walls, windows and door.
fn add_shell(mesh: &mut Mesh, finishes: &Finishes) {
    let (x, z) = (ROOM.x, ROOM.z);
    mesh.add_rectangle(
        dvec3(-x, 0.0, z),
        DVec3::X * 2.0 * x,
        DVec3::NEG_Z * 2.0 * z,
        1.2,
        finishes.parquet,
    );
    mesh.add_block(
        [-x - WALL, ROOM.y, -z - WALL],
        [x + WALL, ROOM.y + 0.2, z + WALL],
        2.0,
        finishes.plaster,
    );

    let right_windows = [
        Window {
            from: -1.7,
            to: -0.5,
            sill: 0.9,
            lintel: 2.35,
        },
        Window {
            from: 0.4,
            to: 1.6,
            sill: 0.9,
            lintel: 2.35,
        },
    ];
    let right_windows = right_windows.map(|w| w.shifted(z));
    let front_window = Window {
        from: -0.4,
        to: 1.7,
        sill: 0.45,
        lintel: 2.35,
    };
    let front_windows = [front_window.mirrored().shifted(x)];
    // For each wall, `right x up` points into the room.
    let walls: [(DVec3, DVec3, f64, &[Window]); 4] = [
        (dvec3(x, 0.0, -z), DVec3::Z, 2.0 * z, &right_windows),
        (dvec3(x, 0.0, z), DVec3::NEG_X, 2.0 * x, &front_windows),
        (dvec3(-x, 0.0, z), DVec3::NEG_Z, 2.0 * z, &[]),
        (dvec3(-x, 0.0, -z), DVec3::X, 2.0 * x, &[]),
    ];
    for (corner, right, length, windows) in walls {
        add_wall(mesh, corner, right, length, windows, finishes);
    }

    for z0 in [-1.98, -0.52, 0.12, 1.58] {
        furniture::curtain(
            mesh,
            dvec3(x - 0.09, 2.5, z0),
            DVec3::Z * 0.3,
            2.4,
            finishes.curtain,
        );
    }
    add_door(mesh, finishes);
}

impl Window {
    fn shifted(self, by: f64) -> Self {
        Self {
            from: self.from + by,
            to: self.to + by,
            ..self
        }
    }

    fn mirrored(self) -> Self {
        Self {
            from: -self.to,
            to: -self.from,
            ..self
        }
    }
}

/// Adds a wall from `corner` along `right` (unit), wallpapered inside, with windows in ascending
/// order and a skirting board.
fn add_wall(
    mesh: &mut Mesh,
    corner: DVec3,
    right: DVec3,
    length: f64,
    windows: &[Window],
    finishes: &Finishes,
) {
    let out = DVec3::Y.cross(right);
    let mut panel = |from: f64, to: f64, low: f64, high: f64| {
        // Wallpaper inside, plaster outside; the texture continues from panel to panel.
        let at = |along: f64, y: f64| corner + right * along + DVec3::Y * y;
        let size = DVec2::new(to - from, high - low);
        let start = DVec2::new(from, low);
        mesh.add_grid(1, 1, finishes.wallpaper, |column, row| {
            let offset = size * DVec2::new(column as f64, row as f64);
            let position = at(from + offset.x, low + offset.y);
            Vertex::new(position, -out, (start + offset) / WALLPAPER)
        });
        mesh.add_rectangle(
            at(to, low) + out * WALL,
            -right * size.x,
            DVec3::Y * size.y,
            1.0,
            finishes.plaster,
        );
    };
    let mut begin = 0.0;
    for window in windows {
        panel(begin, window.from, 0.0, ROOM.y);
        panel(window.from, window.to, 0.0, window.sill);
        panel(window.from, window.to, window.lintel, ROOM.y);
        begin = window.to;
    }
    panel(begin, length, 0.0, ROOM.y);
    for window in windows {
        add_window(mesh, corner, right, *window, finishes);
    }
    let end = corner - out * 0.015 + right * length + DVec3::Y * 0.09;
    mesh.add_block(corner.min(end), corner.max(end), 1.0, finishes.lacquer);
}

/// Adds the reveals of a window, its sill, and a frame with a cross of bars, without panes.
fn add_window(mesh: &mut Mesh, corner: DVec3, right: DVec3, window: Window, finishes: &Finishes) {
    let out = DVec3::Y.cross(right);
    let Window {
        from,
        to,
        sill,
        lintel,
    } = window;
    let mut block = |a: [f64; 3], b: [f64; 3], material: u32| {
        // Local axes: along the wall, up, outward.
        let [a, b] = [a, b].map(|[x, y, z]| corner + right * x + DVec3::Y * y + out * z);
        mesh.add_block(a.min(b), a.max(b), 1.0, material);
    };
    let (plaster, lacquer) = (finishes.plaster, finishes.lacquer);
    let reveal = 0.02;
    let outer = WALL - 0.001;
    block([from - reveal, sill, 0.001], [from, lintel, outer], plaster);
    block([to, sill, 0.001], [to + reveal, lintel, outer], plaster);
    block([from, lintel, 0.001], [to, lintel + reveal, outer], plaster);
    block(
        [from - 0.05, sill - 0.03, -0.12],
        [to + 0.05, sill, outer],
        lacquer,
    );
    let (near, far, bar) = (0.12, 0.17, 0.05);
    let middle = (from + to) / 2.0;
    for x in [from, middle - bar / 2.0, to - bar] {
        block([x, sill, near], [x + bar, lintel, far], lacquer);
    }
    for y in [sill, sill + (lintel - sill) * 0.68, lintel - bar] {
        block(
            [from + bar, y, near + 0.004],
            [to - bar, y + bar, far - 0.004],
            lacquer,
        );
    }
}

/// Adds a panelled door in the front wall, and tiles in front of it.
fn add_door(mesh: &mut Mesh, finishes: &Finishes) {
    let (x0, x1, z) = (-2.5, -1.6, ROOM.z);
    mesh.add_rectangle(
        dvec3(-2.9, 0.004, z),
        DVec3::X * 1.6,
        DVec3::NEG_Z * 0.8,
        0.4,
        finishes.tiles,
    );
    mesh.add_block(
        [x0 - 0.08, 0.0, z - 0.03],
        [x1 + 0.08, 2.13, z - 0.001],
        1.0,
        finishes.lacquer,
    );
    mesh.add_block(
        [x0, 0.005, z - 0.045],
        [x1, 2.05, z - 0.03],
        0.9,
        finishes.oak,
    );
    for (low, high) in [(0.15, 0.95), (1.1, 1.9)] {
        mesh.add_block(
            [x0 + 0.12, low, z - 0.06],
            [x1 - 0.12, high, z - 0.045],
            0.7,
            finishes.oak,
        );
    }
    mesh.add_block(
        [x1 - 0.09, 1.0, z - 0.1],
        [x1 - 0.05, 1.04, z - 0.045],
        1.0,
        finishes.metal,
    );
    mesh.add_block(
        [x1 - 0.18, 1.01, z - 0.1],
        [x1 - 0.05, 1.03, z - 0.085],
        1.0,
        finishes.metal,
    );
}

/// Adds a lawn with hedges and trees, visible through the windows.
fn add_garden(mesh: &mut Mesh, finishes: &Finishes) {
    let corner = dvec3(-40.0, -0.3, 40.0);
    mesh.add_rectangle(
        corner,
        DVec3::X * 80.0,
        DVec3::NEG_Z * 80.0,
        2.5,
        finishes.lawn,
    );
    mesh.add_block(
        [14.0, -0.3, -12.0],
        [15.5, 1.6, 14.0],
        2.5,
        finishes.foliage,
    );
    mesh.add_block(
        [-12.0, -0.3, 13.0],
        [14.0, 1.4, 14.5],
        2.5,
        finishes.foliage,
    );
    for (x, z, radius) in [
        (9.0, -4.0, 1.7),
        (11.5, 3.5, 2.2),
        (4.0, 10.0, 1.9),
        (-3.0, 11.0, 1.4),
    ] {
        // A crown of four clumps.
        for (right, up, near, share) in [
            (0.0, 0.5, 0.0, 0.8),
            (-0.6, 0.0, 0.2, 0.7),
            (0.5, -0.1, -0.4, 0.75),
            (0.2, 0.0, 0.6, 0.65),
        ] {
            let centre = dvec3(x, 1.4 + radius, z) + dvec3(right, up, near) * radius;
            mesh.add_ball(centre, radius * share, 24, finishes.foliage);
        }
        mesh.add_cylinder(dvec3(x, -0.3, z), 0.14, 2.4, 12, finishes.walnut);
    }
}

/// Adds sofa, low table, rug, shelf, lamp and pictures.
fn add_lounge(mesh: &mut Mesh, finishes: &Finishes, rng: &Rng) {
    mesh.add_block([-2.2, 0.0, -0.9], [-0.4, 0.012, 1.5], 0.0, finishes.rug);
    furniture::sofa(mesh, dvec3(-2.5, 0.0, 0.3), 0.0, finishes);
    furniture::table(
        mesh,
        dvec3(-1.3, 0.012, 0.3),
        0.0,
        dvec3(0.6, 0.4, 1.0),
        [finishes.walnut, finishes.walnut],
    );
    mesh.add_block(
        [-1.45, 0.412, 0.1],
        [-1.25, 0.435, 0.38],
        1.0,
        finishes.books[0],
    );
    mesh.add_block(
        [-1.43, 0.435, 0.13],
        [-1.27, 0.452, 0.36],
        1.0,
        finishes.books[4],
    );
    furniture::shelf(
        mesh,
        dvec3(-1.3, 0.0, -ROOM.z + 0.016),
        0.0,
        finishes,
        &rng.fork(0),
    );
    furniture::floor_lamp(mesh, dvec3(-2.6, 0.0, -1.5), finishes);
    furniture::plant(mesh, dvec3(2.5, 0.0, 2.0), 1.0, finishes, &rng.fork(1));
    let left_wall = -ROOM.x + 0.016;
    let hang = |mesh: &mut Mesh, z: f64, size: DVec2, canvas: u32| {
        furniture::picture(
            mesh,
            dvec3(left_wall, 1.6, z),
            DVec3::NEG_Z,
            size,
            canvas,
            finishes.walnut,
        );
    };
    hang(mesh, 0.75, DVec2::new(0.9, 0.675), finishes.pictures[0]);
    hang(mesh, -0.25, DVec2::new(0.6, 0.45), finishes.pictures[1]);
    let back = dvec3(1.4, 1.65, -ROOM.z + 0.016);
    furniture::picture(
        mesh,
        back,
        DVec3::X,
        DVec2::new(1.0, 0.75),
        finishes.pictures[2],
        finishes.oak,
    );
}

/// Adds a table with four chairs, fruit and a hanging lamp.
fn add_dining(mesh: &mut Mesh, finishes: &Finishes) {
    let place = dvec3(1.45, 0.0, -1.0);
    furniture::table(
        mesh,
        place,
        0.0,
        dvec3(1.5, 0.74, 0.85),
        [finishes.oak, finishes.oak],
    );
    for (x, z, turn) in [
        (-0.38, -0.62, 0.05),
        (0.38, -0.66, -0.08),
        (-0.38, 0.62, PI - 0.1),
        (0.4, 0.7, PI + 0.3),
    ] {
        furniture::chair(mesh, place + dvec3(x, 0.0, z), turn, finishes);
    }
    furniture::fruit_bowl(mesh, place + dvec3(0.1, 0.74, 0.0), finishes);
    furniture::pendant(mesh, place + DVec3::Y * 1.75, ROOM.y, finishes);
}
