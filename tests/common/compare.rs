//! Truth frames, and comparison of frames.

use super::bed::{Scene, srgb};
use glam::DVec3;
use headbox_core::camera::Camera;
use headbox_core::cube_face::Face;
use headbox_core::environment::Environment;
use headbox_core::frame::Frame;

/// Mean radiance of `n * n` rays over the pixel (x, y).
fn mean_radiance(
    scene: &Scene,
    o: DVec3,
    n: u32,
    x: u32,
    y: u32,
    direction: impl Fn(f64, f64) -> DVec3,
) -> [u8; 4] {
    let mut sum = [0.0; 3];
    for s in 0..n * n {
        let at = |pixel: u32, k: u32| f64::from(pixel) + (f64::from(k) + 0.5) / f64::from(n);
        let radiance = scene.radiance(o, direction(at(x, s % n), at(y, s / n)));
        sum = std::array::from_fn(|c| sum[c] + radiance[c]);
    }
    srgb(sum.map(|s| s / f64::from(n * n)))
}

fn frame(camera: &Camera, color: impl Fn(u32, u32) -> [u8; 4]) -> Frame {
    let (width, height) = (camera.width(), camera.height());
    let color = (0..width * height)
        .map(|i| color(i % width, i / width))
        .collect();
    Frame {
        width,
        height,
        color,
        ..Frame::default()
    }
}

/// Ray-traces a truth frame with `n * n` rays per pixel.
pub fn truth(scene: &Scene, camera: &Camera, n: u32) -> Frame {
    frame(camera, |x, y| {
        mean_radiance(scene, camera.eye(), n, x, y, |x, y| camera.direction(x, y))
    })
}

/// Ray-traces a cube map (4 * 4 rays per texel) about a centre, for bilinear lookup: the reference
/// for an LDI seen from its centre.
pub fn cube_map(scene: &Scene, centre: DVec3, face_px: u32) -> Environment {
    let texels = Face::ALL.into_iter().flat_map(|face| {
        let texel = move |i: u32| {
            let direction = |x, y| face.direction(x, y, face_px);
            mean_radiance(scene, centre, 4, i % face_px, i / face_px, direction)
        };
        (0..face_px * face_px).map(texel)
    });
    Environment {
        size_px: face_px,
        texels: texels.collect(),
    }
}

/// Resamples a cube map for a camera.
pub fn resample(map: &Environment, camera: &Camera) -> Frame {
    frame(camera, |x, y| {
        let direction = camera
            .direction(f64::from(x) + 0.5, f64::from(y) + 0.5)
            .as_vec3();
        let [r, g, b] = map.sample(direction).expect("whole");
        [r, g, b, 255]
    })
}

/// Peak signal-to-noise ratio of two frames, dB.
pub fn psnr_db(a: &Frame, b: &Frame) -> f64 {
    assert_eq!((a.width, a.height), (b.width, b.height));
    let squares = |(p, q): (&[u8; 4], &[u8; 4])| -> f64 {
        (0..3)
            .map(|c| (f64::from(p[c]) - f64::from(q[c])).powi(2))
            .sum()
    };
    let sum: f64 = a.color.iter().zip(&b.color).map(squares).sum();
    10.0 * (255.0 * 255.0 * a.color.len() as f64 * 3.0 / sum).log10()
}

/// Share of pixels with a channel that differs by more than `levels`.
pub fn share_differing(a: &Frame, b: &Frame, levels: u8) -> f64 {
    let differs = |(p, q): &(&[u8; 4], &[u8; 4])| (0..3).any(|c| p[c].abs_diff(q[c]) > levels);
    a.color.iter().zip(&b.color).filter(differs).count() as f64 / a.color.len() as f64
}

/// Fails if more than `share` of the pixels differ by more than `levels`, and then saves an image:
/// expected | difference (times 4) | actual.
pub fn assert_close(name: &str, expected: &Frame, actual: &Frame, levels: u8, share: f64) {
    assert_eq!(
        (expected.width, expected.height),
        (actual.width, actual.height),
        "{name}"
    );
    let found = share_differing(expected, actual, levels);
    if found <= share {
        return;
    }
    let (w, h) = (expected.width, expected.height);
    let picture = image::RgbImage::from_fn(3 * w, h, |x, y| {
        let i = (y * w + x % w) as usize;
        let (e, a) = (expected.color[i], actual.color[i]);
        image::Rgb(std::array::from_fn(|c| match x / w {
            0 => e[c],
            1 => e[c].abs_diff(a[c]).saturating_mul(4),
            _ => a[c],
        }))
    });
    let path = std::path::Path::new(env!("CARGO_TARGET_TMPDIR")).join(format!("{name}.png"));
    picture.save(&path).expect("target folder");
    panic!(
        "{name}: {found} of the pixels differ by more than {levels} levels, {share} may; see {}",
        path.display()
    );
}
