//! Capture of sprites from a scene by ray tracing: one sprite per slab of eye depth.

use crate::{DepthImport, DisplacementFormat, SpriteError, SpriteWithDepth};
use glam::Vec3;
use headbox_core::camera::Camera;
use headbox_core::depth_kind::DepthKind;
use headbox_core::progress::Progress;
use headbox_trace::bvh::{Hit, Ray, Tracer};
use headbox_trace::light::{LightSample, Lighting, LitPoint, pixel_jitter};
use headbox_trace::sampler::random4;
use image::RgbaImage;
use rayon::prelude::*;

/// Scene and settings of a capture of sprites.
#[derive(Clone, Copy, Debug)]
pub struct SlabCapture<'a> {
    /// The scene.
    pub tracer: &'a Tracer,
    /// Lighting of the scene, as for truth frames.
    pub lighting: &'a Lighting,
    /// True to compute light; otherwise albedo and emission are stored.
    pub lit: bool,
    /// Camera rays per pixel; at least 1.
    pub samples: u32,
    /// Storage format of displacements.
    pub format: DisplacementFormat,
}

/// One pixel of a slab.
#[derive(Clone, Copy)]
struct Pixel {
    color: [u8; 4],
    /// Eye depth at the pixel's centre, metres; NaN if no ray hit a surface.
    depth: f32,
}

/// Captures a sprite for each slab of eye depth of `camera` (near, far; metres), without occlusion
/// by surfaces in front of the slab. Slabs without surfaces give no sprite. Alpha is the share of a
/// pixel's rays that hit a surface in the slab, which antialiases silhouettes. Depth is that of the
/// ray through the pixel's centre or, if it misses, of the hit nearest to the centre.
///
/// # Errors
/// Those of [`DepthImport::build`].
pub fn capture_slabs(
    capture: &SlabCapture,
    camera: &Camera,
    slabs: &[[f64; 2]],
    progress: &dyn Progress,
) -> Result<Vec<SpriteWithDepth>, SpriteError> {
    progress.begin(
        "sprites",
        "rows",
        u64::from(camera.height()) * slabs.len() as u64,
    );
    let mut sprites = Vec::with_capacity(slabs.len());
    for slab in slabs {
        let range = slab.map(|depth| depth as f32);
        let row = |y: u32| {
            let pixels: Vec<Pixel> = (0..camera.width())
                .map(|x| capture.pixel(camera, range, x, y))
                .collect();
            progress.advance(1);
            pixels
        };
        let rows: Vec<Vec<Pixel>> = (0..camera.height()).into_par_iter().map(row).collect();
        if rows.iter().flatten().all(|pixel| pixel.color[3] == 0) {
            continue;
        }
        let color = RgbaImage::from_fn(camera.width(), camera.height(), |x, y| {
            image::Rgba(rows[y as usize][x as usize].color)
        });
        let depth: Vec<f32> = rows.iter().flatten().map(|pixel| pixel.depth).collect();
        let import = DepthImport {
            color,
            camera: *camera,
            depth: &depth,
            depth_kind: DepthKind::EyeDepth,
            window_range_m: (0.0, 0.0),
            plane: None,
            format: capture.format,
        };
        sprites.push(import.build()?);
    }
    Ok(sprites)
}

impl SlabCapture<'_> {
    fn pixel(&self, camera: &Camera, range: [f32; 2], x: u32, y: u32) -> Pixel {
        let samples = self.samples.max(1);
        let mut sum = Vec3::ZERO;
        let mut hits = 0u32;
        let mut nearest_to_center = (f32::INFINITY, f32::NAN);
        for index in 0..samples {
            let jitter = if samples == 1 {
                [0.5; 2]
            } else {
                pixel_jitter(x, y, index)
            };
            let ray = self.ray(camera, range, [x, y], jitter);
            let Some(hit) = self.tracer.closest(&ray) else {
                continue;
            };
            hits += 1;
            // Directions have eye depth 1, so t is eye depth.
            let off_center = (jitter[0] - 0.5).powi(2) + (jitter[1] - 0.5).powi(2);
            if off_center < nearest_to_center.0 {
                nearest_to_center = (off_center, hit.t);
            }
            sum += self.radiance(&ray, &hit, [x, y], index);
        }
        if hits == 0 {
            return Pixel {
                color: [0; 4],
                depth: f32::NAN,
            };
        }
        let center = self
            .tracer
            .closest(&self.ray(camera, range, [x, y], [0.5; 2]));
        let alpha = ((hits * 255 * 2 + samples) / (2 * samples)) as u8;
        let [r, g, b] = self.lighting.stored(sum / hits as f32);
        Pixel {
            color: [r, g, b, alpha],
            depth: center.map_or(nearest_to_center.1, |hit| hit.t),
        }
    }

    fn ray(
        &self,
        camera: &Camera,
        [t_min, t_max]: [f32; 2],
        [x, y]: [u32; 2],
        jitter: [f32; 2],
    ) -> Ray {
        let (x, y) = (
            f64::from(x) + f64::from(jitter[0]),
            f64::from(y) + f64::from(jitter[1]),
        );
        Ray {
            origin: (camera.eye() - self.tracer.origin()).as_vec3(),
            direction: camera.direction(x, y).as_vec3(),
            t_min,
            t_max,
        }
    }

    fn radiance(&self, ray: &Ray, hit: &Hit, [x, y]: [u32; 2], index: u32) -> Vec3 {
        let (point, surface) = LitPoint::from_hit(self.tracer, ray, hit);
        let radiosity = if self.lit {
            let [stream, ..] = random4([x, y, 0x5bd1, 2]);
            let sample = LightSample { stream, index };
            self.lighting.cached_radiosity(self.tracer, &point, &sample)
        } else {
            Vec3::ONE
        };
        Vec3::from_array(surface.albedo) * radiosity + Vec3::from_array(surface.emission)
    }
}

/// Divides the view of `camera` into at most `count` slabs of eye depth, at the widest gaps (by
/// ratio of depths) between all surfaces along a grid of rays, hidden ones included. Surfaces with
/// a depth ratio below 1.1 stay together. Sorted from far to near; empty if no ray hits a surface.
pub fn slabs_at_gaps(tracer: &Tracer, camera: &Camera, count: usize) -> Vec<[f64; 2]> {
    const GRID: u32 = 96;
    const LEAST_RATIO: f64 = 1.1;
    let origin = (camera.eye() - tracer.origin()).as_vec3();
    let column = |i: u32| {
        let mut depths = Vec::new();
        for j in 0..GRID {
            let [x, y] = [(i, camera.width()), (j, camera.height())]
                .map(|(k, side)| (f64::from(k) + 0.5) / f64::from(GRID) * f64::from(side));
            let ray = Ray {
                origin,
                direction: camera.direction(x, y).as_vec3(),
                t_min: 0.0,
                t_max: f32::INFINITY,
            };
            tracer.all_hits(&ray, &mut |hit| depths.push(f64::from(hit.t)));
        }
        depths
    };
    let mut depths: Vec<f64> = (0..GRID)
        .into_par_iter()
        .flat_map_iter(column)
        .filter(|&d| d > 0.0)
        .collect();
    depths.sort_unstable_by(f64::total_cmp);
    let (Some(&first), Some(&last)) = (depths.first(), depths.last()) else {
        return Vec::new();
    };
    let mut gaps: Vec<[f64; 2]> = depths
        .windows(2)
        .filter(|pair| pair[1] > pair[0] * LEAST_RATIO)
        .map(|pair| [pair[0], pair[1]])
        .collect();
    gaps.sort_by(|a, b| (b[1] / b[0]).total_cmp(&(a[1] / a[0])));
    gaps.truncate(count.saturating_sub(1));
    let mut cuts: Vec<f64> = gaps.iter().map(|[near, far]| (near * far).sqrt()).collect();
    // The grid of rays may miss the nearest and the farthest point.
    cuts.extend([first * 0.5, last * 2.0]);
    cuts.sort_unstable_by(f64::total_cmp);
    cuts.windows(2)
        .rev()
        .map(|pair| [pair[0], pair[1]])
        .collect()
}
