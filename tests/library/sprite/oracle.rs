//! Shared parts of the sprite tests: sprites with known surfaces, and the slow f64 oracle.
use glam::{DVec3, dvec3};
use headbox_core::camera::Camera;
use headbox_sprite::{
    Displacement, DisplacementFormat, Sprite, SpritePlane, SpriteTransfer, SpriteWithDepth,
};
use image::{Rgba, RgbaImage};

/// A camera two metres in front of the origin, slightly off axis, of `size` x `size` pixels.
pub(crate) fn camera(size: u32) -> Camera {
    look(dvec3(0.05, -0.03, 2.0), DVec3::ZERO, size)
}

pub(crate) fn look(eye: DVec3, at: DVec3, size: u32) -> Camera {
    Camera::look_at(eye, at, DVec3::Y, 50.0, [size, size]).expect("valid camera")
}

/// An image in which every distortion is visible.
pub(crate) fn picture(size: u32) -> RgbaImage {
    RgbaImage::from_fn(size, size, |x, y| {
        let check = if (x / 8 + y / 8) % 2 == 0 { 220 } else { 40 };
        Rgba([check, (x * 255 / size) as u8, (y * 255 / size) as u8, 255])
    })
}

/// A smooth wavy displacement: amplitude `amplitude`, `waves` waves across; analytic, so that an
/// oracle can evaluate it anywhere. x and y in 0..1.
#[derive(Clone, Copy)]
pub(crate) struct Waves {
    pub(crate) amplitude: f64,
    pub(crate) waves: f64,
}

impl Waves {
    pub(crate) fn at(&self, x: f64, y: f64) -> f64 {
        let phase = std::f64::consts::TAU * self.waves;
        self.amplitude * (phase * x + 0.3).sin() * (phase * y - 0.5).cos()
    }

    pub(crate) fn displacement(&self, size: u32, format: DisplacementFormat) -> Displacement {
        let at = |i: u32| (f64::from(i) + 0.5) / f64::from(size);
        let values: Vec<f32> = (0..size * size)
            .map(|i| self.at(at(i % size), at(i / size)) as f32)
            .collect();
        Displacement::new(size, size, &values, format).expect("finite")
    }
}

/// A sprite of `size` x `size` pixels on a slightly tilted plane.
pub(crate) fn sprite(size: u32, picture: RgbaImage, displacement: Displacement) -> SpriteWithDepth {
    let plane = SpritePlane::through(DVec3::ZERO, dvec3(0.15, -0.1, 1.0));
    let sprite = Sprite::new(picture, camera(size), plane).expect("valid sprite");
    SpriteWithDepth::new(sprite, displacement).expect("sizes agree")
}

/// Exact inverse of Eq. 4: the source position of the nearest surface that is visible at (x2, y2),
/// by search along the line of candidates `(x3, y3, 1) - d e*` for `surface(x1, y1) = d w1`.
/// Displacements between `low` and `high` of the moved field are tried in steps, each change of
/// sign is refined by bisection; the largest displacement times `side` wins.
pub(crate) fn exact_source(
    transfer: &SpriteTransfer,
    surface: &dyn Fn(f64, f64) -> f64,
    [low, high]: [f64; 2],
    [x2, y2]: [f64; 2],
) -> Option<[f64; 2]> {
    const STEPS: usize = 600;
    let plane = transfer.sprite_from_target * dvec3(x2, y2, 1.0);
    if plane.z <= 0.0 {
        return None;
    }
    let base = dvec3(plane.x / plane.z, plane.y / plane.z, 1.0);
    let source = |d3: f64| {
        let p = base - transfer.epipole_in_sprite * d3;
        [p.x / p.z, p.y / p.z, p.z]
    };
    // d3 = d1 / w3 and the third component is 1 / w3.
    let excess = |d3: f64| {
        let [x, y, share] = source(d3);
        d3 - surface(x, y) * share
    };
    let at = |i: usize| {
        let t = i as f64 / STEPS as f64;
        if transfer.side > 0.0 {
            high + (low - high) * t
        } else {
            low + (high - low) * t
        }
    };
    (0..STEPS)
        .map(|i| [at(i), at(i + 1)])
        .find(|[a, b]| excess(*a) * excess(*b) <= 0.0)
        .map(|[mut a, mut b]| {
            for _ in 0..60 {
                let middle = 0.5 * (a + b);
                if excess(a) * excess(middle) <= 0.0 {
                    b = middle;
                } else {
                    a = middle;
                }
            }
            let [x, y, _] = source(0.5 * (a + b));
            [x, y]
        })
}

/// Premultiplied bilinear lookup in f64, transparent outside.
pub(crate) fn bilinear(picture: &RgbaImage, x: f64, y: f64) -> [f64; 4] {
    let (x, y) = (x - 0.5, y - 0.5);
    let (fx, fy) = (x - x.floor(), y - y.floor());
    let at = |dx: i64, dy: i64| {
        let (x, y) = (x.floor() as i64 + dx, y.floor() as i64 + dy);
        let inside =
            x >= 0 && y >= 0 && x < i64::from(picture.width()) && y < i64::from(picture.height());
        if !inside {
            return [0.0; 4];
        }
        let [r, g, b, a] = picture.get_pixel(x as u32, y as u32).0.map(f64::from);
        // The renderer stores premultiplied bytes, and so does its oracle.
        [r, g, b, 255.0].map(|c| (c * a / 255.0).round())
    };
    [0, 1, 2, 3].map(|c| {
        let row = |dy| at(0, dy)[c] * (1.0 - fx) + at(1, dy)[c] * fx;
        row(0) * (1.0 - fy) + row(1) * fy
    })
}
