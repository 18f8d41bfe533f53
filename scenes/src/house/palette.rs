//! Materials of the house in addition to those of its furniture.

use super::floor::Purpose;
use crate::finishes::Finishes;
use crate::mesh::Mesh;
use crate::texture::{fractal, mix, noise, paint, shade};
use headbox_core::random::{Rng, hash, unit};
use headbox_scene::material::Texture;

/// Indices of the materials.
pub(super) struct Palette {
    pub(super) finishes: Finishes,
    /// Wallpapers and paints, chosen per room.
    walls: Vec<u32>,
    wall_tiles: [u32; 2],
    carpets: [u32; 2],
    dark_parquet: u32,
    terracotta: u32,
    concrete: u32,
    pub(super) linens: [u32; 3],
    pub(super) stucco: u32,
    pub(super) roof: u32,
    pub(super) paving: u32,
    pub(super) leaves: [u32; 3],
}

/// Period of the textures of walls and floors, metres.
pub(super) const TILE_M: f64 = 1.2;

impl Palette {
    pub(super) fn new(mesh: &mut Mesh, seed: u64) -> Self {
        let finishes = Finishes::new(mesh, seed);
        let paints = [
            ([0.93, 0.91, 0.86], [0.90, 0.88, 0.83]),
            ([0.72, 0.80, 0.79], [0.66, 0.75, 0.74]),
            ([0.90, 0.80, 0.62], [0.87, 0.76, 0.57]),
            ([0.80, 0.83, 0.71], [0.75, 0.79, 0.66]),
            ([0.78, 0.69, 0.68], [0.74, 0.64, 0.63]),
            ([0.66, 0.72, 0.82], [0.61, 0.67, 0.78]),
        ];
        let mut walls: Vec<u32> = (0_u64..)
            .zip(paints)
            .map(|(i, (a, b))| mesh.textured("wall paint", plaster(a, b, seed + 40 + i)))
            .collect();
        let papers = [
            ([0.84, 0.80, 0.70], [0.55, 0.32, 0.28]),
            ([0.60, 0.68, 0.64], [0.88, 0.88, 0.80]),
        ];
        walls.extend(
            papers.map(|(ground, figure)| mesh.textured("wallpaper", damask(ground, figure))),
        );
        walls.push(finishes.wallpaper);
        Self {
            wall_tiles: [
                mesh.textured("wall tiles", tiling([0.90, 0.93, 0.93], 8.0, seed + 50)),
                mesh.textured("wall tiles", tiling([0.52, 0.70, 0.74], 12.0, seed + 51)),
            ],
            carpets: [
                mesh.textured("carpet", carpet([0.45, 0.36, 0.38], seed + 52)),
                mesh.textured("carpet", carpet([0.40, 0.44, 0.40], seed + 53)),
            ],
            dark_parquet: mesh.textured("boards", boards(seed + 54)),
            terracotta: mesh.textured("terracotta", tiling([0.68, 0.37, 0.25], 4.0, seed + 55)),
            concrete: mesh.textured(
                "concrete",
                plaster([0.62, 0.61, 0.59], [0.52, 0.51, 0.50], seed + 56),
            ),
            linens: [
                mesh.textured("linen", stripes([0.30, 0.42, 0.58], [0.86, 0.87, 0.85])),
                mesh.textured("linen", stripes([0.62, 0.24, 0.22], [0.88, 0.80, 0.70])),
                mesh.textured("linen", stripes([0.42, 0.50, 0.34], [0.80, 0.80, 0.66])),
            ],
            stucco: mesh.textured(
                "stucco",
                plaster([0.90, 0.86, 0.76], [0.82, 0.78, 0.68], seed + 57),
            ),
            roof: mesh.textured("roof tiles", roof_tiles(seed + 58)),
            paving: mesh.textured("paving", tiling([0.66, 0.63, 0.58], 2.0, seed + 59)),
            leaves: [[0.13, 0.30, 0.08], [0.20, 0.34, 0.10], [0.10, 0.24, 0.11]]
                .map(|c| mesh.plain("leaves", c)),
            walls,
            finishes,
        }
    }

    /// Chooses the material of a room's walls.
    pub(super) fn wall_material(&self, purpose: Purpose, random: &mut Rng) -> u32 {
        let pick = random.unit();
        match purpose {
            Purpose::Bathroom => self.wall_tiles[(pick * 2.0) as usize % 2],
            Purpose::Pantry | Purpose::Utility | Purpose::Workshop => self.walls[0],
            Purpose::Corridor | Purpose::Hall | Purpose::Foyer => {
                self.walls[(pick * 4.0) as usize % 4]
            }
            _ => self.walls[(pick * self.walls.len() as f64) as usize % self.walls.len()],
        }
    }

    /// Chooses the material of a room's floor.
    pub(super) fn floor_material(&self, purpose: Purpose, random: &mut Rng) -> u32 {
        let second = random.unit() < 0.5;
        match purpose {
            Purpose::Bathroom | Purpose::Kitchen | Purpose::Foyer => self.finishes.tiles,
            Purpose::Pantry | Purpose::Utility => self.terracotta,
            Purpose::Workshop => self.concrete,
            Purpose::Bedroom | Purpose::Dressing if second => self.carpets[0],
            Purpose::Library => self.carpets[1],
            Purpose::Living | Purpose::Corridor | Purpose::Hall => self.finishes.parquet,
            _ => self.dark_parquet,
        }
    }
}

fn plaster(a: [f64; 3], b: [f64; 3], seed: u64) -> Texture {
    paint(256, 256, |u, v| {
        mix(
            a,
            b,
            0.7 * fractal(u, v, 4, 4, seed) + 0.3 * noise(u, v, 96, 96, seed + 9),
        )
    })
}

/// Rows of leaves.
fn damask(ground: [f64; 3], figure: [f64; 3]) -> Texture {
    paint(256, 256, |u, v| {
        let (x, y) = (
            (u * 6.0).fract() - 0.5,
            (v * 6.0 + 0.5 * f64::from((u * 6.0) as u32 % 2)).fract() - 0.5,
        );
        let leaf = x.abs() < 0.22 * (1.0 - (2.4 * y).powi(2)).max(0.0) && x.abs() > 0.02;
        let stem = x.abs() < 0.012;
        if leaf || stem {
            mix(ground, figure, 0.55)
        } else {
            ground
        }
    })
}

/// Square tiles with joints, `count` per period, each tile with its own shade.
fn tiling(color: [f64; 3], count: f64, seed: u64) -> Texture {
    paint(256, 256, |u, v| {
        let (x, y) = (u * count, v * count);
        let joint = [x, y]
            .iter()
            .any(|t| (t - t.round()).abs() < 0.012 * count.sqrt());
        let tile = unit(hash(seed ^ (x as u64) << 16 ^ y as u64));
        let base = shade(
            color,
            0.9 + 0.14 * tile + 0.06 * (fractal(u, v, 8, 8, seed) - 0.5),
        );
        if joint {
            mix(color, [0.8, 0.79, 0.76], 0.75)
        } else {
            base
        }
    })
}

fn carpet(color: [f64; 3], seed: u64) -> Texture {
    paint(256, 256, |u, v| {
        shade(
            color,
            0.8 + 0.3 * noise(u, v, 128, 128, seed) + 0.2 * fractal(u, v, 4, 4, seed + 3),
        )
    })
}

/// Wide, dark boards along u.
fn boards(seed: u64) -> Texture {
    paint(256, 256, |u, v| {
        let row = (v * 6.0) as u64;
        let joint = (v * 6.0).fract() < 0.03 || (u + unit(hash(seed ^ row))).fract() < 0.006;
        let grain = fractal(u, v, 4, 96, seed + 1);
        let base = mix(
            [0.25, 0.15, 0.09],
            [0.45, 0.29, 0.17],
            0.5 * unit(hash(row ^ (seed + 2))) + 0.5 * grain,
        );
        if joint { shade(base, 0.5) } else { base }
    })
}

fn stripes(a: [f64; 3], b: [f64; 3]) -> Texture {
    paint(128, 128, |u, v| {
        let thread = 0.93 + 0.07 * f64::from((v * 64.0) as u32 % 2);
        shade(if (u * 5.0).fract() < 0.35 { a } else { b }, thread)
    })
}

/// Overlapping rounded tiles.
fn roof_tiles(seed: u64) -> Texture {
    paint(256, 256, |u, v| {
        let row = (v * 8.0) as u64;
        let x = u * 8.0 + if row.is_multiple_of(2) { 0.0 } else { 0.5 };
        let (across, up) = (x.fract() - 0.5, (v * 8.0).fract());
        let rounded = up < 0.25 - (0.25 - across * across).max(0.0);
        let tile = unit(hash(seed ^ row << 8 ^ (x as u64 % 8)));
        let base = mix([0.50, 0.20, 0.13], [0.68, 0.34, 0.22], tile);
        shade(base, if rounded { 0.45 } else { 0.75 + 0.3 * up })
    })
}
