//! Materials of furnished rooms, most of them textured.

use crate::mesh::Mesh;
use crate::texture::{fractal, mix, noise, paint, shade};
use headbox_core::random::{hash, unit};
use headbox_scene::material::Texture;

/// Indices of the materials.
pub(crate) struct Finishes {
    pub(crate) parquet: u32,
    pub(crate) tiles: u32,
    pub(crate) wallpaper: u32,
    pub(crate) plaster: u32,
    pub(crate) oak: u32,
    pub(crate) walnut: u32,
    pub(crate) fabric: u32,
    pub(crate) cushion: u32,
    pub(crate) rug: u32,
    pub(crate) curtain: u32,
    pub(crate) lacquer: u32,
    pub(crate) metal: u32,
    pub(crate) clay: u32,
    pub(crate) foliage: u32,
    pub(crate) bulb: u32,
    pub(crate) shade: u32,
    pub(crate) lawn: u32,
    pub(crate) pictures: [u32; 3],
    pub(crate) books: [u32; 6],
    pub(crate) fruit: [u32; 3],
}

impl Finishes {
    pub(crate) fn new(mesh: &mut Mesh, seed: u64) -> Self {
        let books = [
            [0.45, 0.08, 0.07],
            [0.07, 0.15, 0.35],
            [0.10, 0.28, 0.14],
            [0.6, 0.45, 0.15],
            [0.7, 0.66, 0.58],
            [0.08, 0.08, 0.09],
        ];
        let fruit = [[0.65, 0.08, 0.05], [0.75, 0.35, 0.03], [0.45, 0.55, 0.08]];
        Self {
            parquet: mesh.textured("parquet", parquet(seed)),
            tiles: mesh.textured("tiles", tiles(seed)),
            wallpaper: mesh.textured("wallpaper", wallpaper()),
            plaster: mesh.plain("plaster", [0.82, 0.81, 0.78]),
            oak: mesh.textured(
                "oak",
                wood([0.62, 0.44, 0.27], [0.78, 0.61, 0.41], seed + 1),
            ),
            walnut: mesh.textured(
                "walnut",
                wood([0.27, 0.17, 0.11], [0.43, 0.29, 0.19], seed + 2),
            ),
            fabric: mesh.textured("fabric", weave([0.33, 0.43, 0.50], [0.42, 0.53, 0.60])),
            cushion: mesh.textured("cushion", weave([0.80, 0.56, 0.20], [0.90, 0.70, 0.38])),
            rug: mesh.textured("rug", rug()),
            curtain: mesh.textured("curtain", weave([0.80, 0.76, 0.68], [0.88, 0.85, 0.78])),
            lacquer: mesh.plain("lacquer", [0.75, 0.75, 0.72]),
            metal: mesh.plain("metal", [0.12, 0.12, 0.13]),
            clay: mesh.plain("clay", [0.50, 0.22, 0.12]),
            foliage: mesh.plain("foliage", [0.10, 0.28, 0.07]),
            bulb: mesh.emissive("bulb", [110.0, 90.0, 62.0]),
            shade: mesh.emissive("lamp shade", [1.6, 1.3, 0.9]),
            lawn: mesh.textured("lawn", lawn(seed)),
            pictures: [0, 1, 2]
                .map(|i| mesh.textured("picture", picture(i, seed + 10 + u64::from(i)))),
            books: books.map(|albedo| mesh.plain("book", albedo)),
            fruit: fruit.map(|albedo| mesh.plain("fruit", albedo)),
        }
    }
}

/// Wood with its grain along u.
fn wood(dark: [f64; 3], light: [f64; 3], seed: u64) -> Texture {
    paint(256, 256, |u, v| {
        let rings = (v + 0.08 * noise(u, v, 2, 4, seed)) * 9.0 + noise(u, v, 3, 12, seed + 1);
        let ring = 0.5 + 0.5 * (rings * std::f64::consts::TAU).sin();
        let pores = noise(u, v, 12, 128, seed + 2);
        mix(
            dark,
            light,
            0.25 + 0.45 * ring * (1.0 - 0.4 * pores) + 0.3 * pores,
        )
    })
}

/// Parquet of eight rows of planks along u, each plank with its own shade.
fn parquet(seed: u64) -> Texture {
    paint(512, 512, |u, v| {
        let row = (v * 8.0).floor();
        let along = (u * 2.0 + row * 0.37).rem_euclid(2.0);
        let plank = hash(seed ^ (row as u64) << 8 ^ along.floor() as u64);
        let joint = (v * 8.0).fract() < 0.03 || along.fract() < 0.006;
        let grain = fractal(u, v + unit(plank), 6, 96, seed + 5);
        let base = mix(
            [0.52, 0.33, 0.18],
            [0.73, 0.51, 0.31],
            0.6 * unit(hash(plank)) + 0.4 * grain,
        );
        if joint { shade(base, 0.45) } else { base }
    })
}

/// Two by two tiles, dark and light, with grout.
fn tiles(seed: u64) -> Texture {
    paint(256, 256, |u, v| {
        let grout = [u, v]
            .iter()
            .any(|t| (t * 2.0 - (t * 2.0).round()).abs() < 0.015);
        let is_light = ((u * 2.0).floor() + (v * 2.0).floor()) % 2.0 == 0.0;
        let base = if is_light {
            [0.86, 0.84, 0.80]
        } else {
            [0.24, 0.27, 0.30]
        };
        if grout {
            [0.55, 0.54, 0.52]
        } else {
            shade(base, 0.88 + 0.18 * fractal(u, v, 4, 4, seed + 6))
        }
    })
}

/// Stripes with a row of small lozenges.
fn wallpaper() -> Texture {
    paint(256, 256, |u, v| {
        let stripe = (u * 4.0).fract() < 0.5;
        let (x, y) = ((u * 4.0).fract() - 0.25, (v * 4.0).fract() - 0.5);
        let lozenge = x.abs() * 2.0 + y.abs() < 0.16;
        match (lozenge, stripe) {
            (true, _) => [0.55, 0.66, 0.60],
            (_, true) => [0.87, 0.85, 0.76],
            _ => [0.80, 0.80, 0.72],
        }
    })
}

/// Plain weave of two threads.
fn weave(a: [f64; 3], b: [f64; 3]) -> Texture {
    paint(128, 128, |u, v| {
        let (x, y) = (u * 32.0, v * 32.0);
        let over = (x.floor() + y.floor()) % 2.0 == 0.0;
        let across = if over { x.fract() } else { y.fract() } - 0.5;
        shade(if over { a } else { b }, 1.0 - 0.8 * across * across)
    })
}

/// Nested frames around a checkered field.
fn rug() -> Texture {
    paint(512, 512, |u, v| {
        let edge = u.min(1.0 - u).min(v).min(1.0 - v);
        let thread = 0.92 + 0.08 * ((u * 256.0).floor() + (v * 256.0).floor()).rem_euclid(2.0);
        let base = match edge {
            e if e < 0.03 => [0.85, 0.78, 0.65],
            e if e < 0.08 => [0.48, 0.12, 0.12],
            e if e < 0.10 => [0.85, 0.70, 0.35],
            e if e < 0.15 => [0.16, 0.20, 0.33],
            _ if ((u * 20.0).floor() + (v * 20.0).floor()) % 2.0 == 0.0 => [0.55, 0.17, 0.15],
            _ => [0.64, 0.27, 0.20],
        };
        shade(base, thread)
    })
}

/// Picture by `kind`: hills under a sky, coloured squares, or circles.
fn picture(kind: u32, seed: u64) -> Texture {
    paint(256, 192, |u, v| match kind {
        0 => {
            let hill =
                |k: u64| 0.2 + 0.15 * k as f64 + 0.25 * noise(u, 0.5, 3 + k as u32, 1, seed + k);
            match (0..3).find(|&k| v < hill(k)) {
                Some(k) => mix([0.15, 0.30, 0.18], [0.55, 0.65, 0.70], k as f64 / 3.0),
                None => mix([0.95, 0.75, 0.50], [0.35, 0.55, 0.80], v),
            }
        }
        1 => {
            let (x, y) = (u * 6.0, v * 4.0);
            let cell = hash(seed ^ (x.floor() as u64) << 8 ^ y.floor() as u64);
            let inside = [x.fract(), y.fract()]
                .iter()
                .all(|t| (0.06..0.94).contains(t));
            let color =
                [0, 21, 42].map(|shift| 0.15 + 0.8 * ((cell >> shift) & 0xff) as f64 / 255.0);
            if inside { color } else { [0.95, 0.94, 0.90] }
        }
        _ => {
            let from_centre = ((u - 0.5) * 4.0 / 3.0).hypot(v - 0.5);
            if (from_centre * 7.0).fract() < 0.5 {
                [0.85, 0.30, 0.15]
            } else {
                [0.96, 0.90, 0.80]
            }
        }
    })
}

fn lawn(seed: u64) -> Texture {
    paint(256, 256, |u, v| {
        let patch = fractal(u, v, 4, 4, seed + 7);
        shade(
            mix([0.24, 0.36, 0.12], [0.46, 0.54, 0.22], patch),
            0.8 + 0.4 * noise(u, v, 64, 64, seed + 8),
        )
    })
}
