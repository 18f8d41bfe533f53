//! A small capture of an analytic scene, independent of the product's: rays from the headbox's
//! faces, cosine-weighted (S15), merged by depth in their order of arrival.

use super::bed::{Scene, sky, srgb};
use glam::{DVec3, dvec3};
use headbox_core::cube_face::Face;
use headbox_core::environment::Environment;
use headbox_core::random::Rng;
use headbox_cube::model::info::CaptureInfo;
use headbox_cube::model::samples::{CubeSamples, DepthPixel, EncodedNormal, LayeredDepthImage};

/// Settings of a capture.
pub struct CaptureSettings {
    pub centre: DVec3,
    pub half: f64,
    pub face_px: u32,
    pub rays_per_pixel: u32,
    /// Relative difference of inverse depth up to which hits are merged.
    pub epsilon: f64,
}

/// A headbox of half size 0.5 about the origin.
pub fn quick(scene: &Scene, face_px: u32) -> CubeSamples {
    let settings = CaptureSettings {
        centre: DVec3::ZERO,
        half: 0.5,
        face_px,
        rays_per_pixel: 16,
        epsilon: 0.01,
    };
    capture(scene, &settings)
}

/// Sums over the hits of one depth pixel.
struct Gathered {
    inverse_depth: f64,
    normal: DVec3,
    color: [f64; 3],
    count: f64,
}

impl Gathered {
    fn mean_inverse_depth(&self) -> f64 {
        self.inverse_depth / self.count
    }
}

/// Sums of every pixel of every face, and of the environment.
struct Accumulator {
    size: usize,
    pixels: Vec<Vec<Gathered>>,
    environment: Vec<([f64; 3], f64)>,
}

const ENVIRONMENT_PX: usize = 64;

impl Accumulator {
    /// Index of the pixel that a point or direction falls into, and its eye depth.
    fn index(p: DVec3, size: usize) -> (usize, f64) {
        let face = Face::containing(p);
        let [x, y, eye_depth] = face.project(p, size as u32);
        let (x, y) = ((x as usize).min(size - 1), (y as usize).min(size - 1));
        ((face.index() * size + y) * size + x, eye_depth)
    }

    fn miss(&mut self, d: DVec3) {
        let texel = &mut self.environment[Self::index(d, ENVIRONMENT_PX).0];
        texel.0 = std::array::from_fn(|c| texel.0[c] + sky(d)[c]);
        texel.1 += 1.0;
    }

    fn hit(&mut self, p: DVec3, normal: DVec3, color: [f64; 3], epsilon: f64) {
        let (index, eye_depth) = Self::index(p, self.size);
        let q = 1.0 / eye_depth;
        let pixel = &mut self.pixels[index];
        match pixel
            .iter_mut()
            .find(|g| (g.mean_inverse_depth() - q).abs() < epsilon * q)
        {
            Some(g) => {
                g.inverse_depth += q;
                g.normal += normal;
                g.color = std::array::from_fn(|c| g.color[c] + color[c]);
                g.count += 1.0;
            }
            None => pixel.push(Gathered {
                inverse_depth: q,
                normal,
                color,
                count: 1.0,
            }),
        }
    }

    /// Alphas of the depth pixels of a pixel, from far to near: among the rays from the centre (16
    /// per pixel) that reach a sample, the share that ends at it; if few reach it, the share that
    /// hits anything at its depth.
    fn alphas(&self, index: usize, scene: &Scene, settings: &CaptureSettings) -> Vec<u8> {
        const SIDE: usize = 4;
        let (face, x, y) = (
            Face::ALL[index / self.size / self.size],
            index % self.size,
            index / self.size % self.size,
        );
        let depths: Vec<f64> = self.pixels[index]
            .iter()
            .map(|g| 1.0 / g.mean_inverse_depth())
            .collect();
        let directions: Vec<DVec3> = (0..SIDE * SIDE)
            .map(|k| {
                let within = |k: usize| (k as f64 + 0.5) / SIDE as f64;
                face.direction(
                    x as f64 + within(k % SIDE),
                    y as f64 + within(k / SIDE),
                    self.size as u32,
                )
            })
            .collect();
        let depth_beyond = |start: f64, d: DVec3| {
            scene
                .hit(settings.centre + d * start, d)
                .map(|hit| start + hit.t)
        };
        let mut ends = vec![0.0; depths.len()];
        for depth in directions
            .iter()
            .filter_map(|d| depth_beyond(settings.half, *d))
        {
            let apart = |i: &usize| (1.0 / depths[*i] - 1.0 / depth).abs();
            let nearest = (0..depths.len()).min_by(|a, b| apart(a).total_cmp(&apart(b)));
            nearest.into_iter().for_each(|i| ends[i] += 1.0);
        }
        let (count, mut reaching) = (directions.len() as f64, directions.len() as f64);
        let mut alphas = vec![255; depths.len()];
        for i in (0..depths.len()).rev() {
            let share = if reaching >= 4.0 {
                (ends[i] + 0.5) / reaching
            } else {
                let [near, far] = [1.0 - 2.0 * settings.epsilon, 1.0 + 2.0 * settings.epsilon]
                    .map(|f| depths[i] * f);
                let fills = |d: &&DVec3| depth_beyond(near, **d).is_some_and(|depth| depth < far);
                (directions.iter().filter(fills).count() as f64 + 0.5) / count
            };
            alphas[i] = (share * 255.0) as u8;
            reaching -= ends[i];
        }
        alphas
    }

    fn finish(
        mut self,
        scene: &Scene,
        settings: &CaptureSettings,
    ) -> (Vec<LayeredDepthImage>, Environment) {
        for pixel in &mut self.pixels {
            pixel.sort_by(|a, b| a.mean_inverse_depth().total_cmp(&b.mean_inverse_depth()));
        }
        let per_face = self.size * self.size;
        let face = |face: Face| {
            let mut ldi = LayeredDepthImage::empty(face, self.size as u32);
            for p in 0..per_face {
                let index = face.index() * per_face + p;
                for (g, alpha) in self.pixels[index]
                    .iter()
                    .zip(self.alphas(index, scene, settings))
                {
                    let mut color_srgb = srgb(g.color.map(|c| c / g.count));
                    color_srgb[3] = alpha;
                    ldi.samples.push(DepthPixel {
                        inverse_depth: g.mean_inverse_depth() as f32,
                        normal: EncodedNormal::new(g.normal.normalize_or(DVec3::X).as_vec3()),
                        color_srgb,
                    });
                }
                ldi.offsets[p + 1] = ldi.samples.len() as u32;
            }
            ldi
        };
        let faces = Face::ALL.map(face).into();
        let texel = |(sum, n): &([f64; 3], f64)| {
            if *n > 0.0 {
                srgb(sum.map(|c| c / n))
            } else {
                [0; 4]
            }
        };
        let texels: Vec<_> = self.environment.iter().map(texel).collect();
        let environment = match texels.iter().any(|t| t[3] > 0) {
            true => Environment {
                size_px: ENVIRONMENT_PX as u32,
                texels,
            },
            false => Environment {
                size_px: 0,
                texels: vec![],
            },
        };
        (faces, environment)
    }
}

pub fn capture(scene: &Scene, settings: &CaptureSettings) -> CubeSamples {
    let size = settings.face_px as usize;
    let mut sums = Accumulator {
        size,
        pixels: (0..6 * size * size).map(|_| Vec::new()).collect(),
        environment: vec![([0.0; 3], 0.0); 6 * ENVIRONMENT_PX * ENVIRONMENT_PX],
    };
    let mut random = Rng::keyed(1);
    for face in Face::ALL {
        for _ in 0..settings.rays_per_pixel as usize * size * size {
            let in_face = |v: DVec3| face.right() * v.x + face.up() * v.y + face.normal() * v.z;
            let o = in_face(dvec3(
                random.between(-1.0, 1.0),
                random.between(-1.0, 1.0),
                1.0,
            )) * settings.half;
            let (r, a) = (random.unit().sqrt(), random.unit() * std::f64::consts::TAU);
            let d = in_face(dvec3(r * a.cos(), r * a.sin(), (1.0 - r * r).sqrt()));
            match scene.hit(settings.centre + o, d) {
                Some(hit) => sums.hit(o + d * hit.t, hit.normal, hit.color, settings.epsilon),
                None => sums.miss(d),
            }
        }
    }
    let (faces, environment) = sums.finish(scene, settings);
    CubeSamples {
        info: info(settings.centre, settings.half),
        faces,
        environment,
    }
}

/// Capture information of a cube that was not captured.
pub fn info(centre: DVec3, half_size_m: f64) -> CaptureInfo {
    CaptureInfo {
        scene: "test".into(),
        centre,
        half_size_m,
        exposure: 1.0,
        ..CaptureInfo::default()
    }
}

/// A cube LDI with one sample at the centre of each pixel of some faces, without an environment.
/// `sample` returns the sample for a position on the face in pixels.
pub fn one_layer(
    centre: DVec3,
    face_px: u32,
    faces: &[Face],
    sample: impl Fn(Face, f64, f64) -> Option<DepthPixel>,
) -> CubeSamples {
    let face = |face: Face| {
        let mut ldi = LayeredDepthImage::empty(face, face_px);
        for p in 0..face_px * face_px {
            if faces.contains(&face) {
                ldi.samples.extend(sample(
                    face,
                    f64::from(p % face_px) + 0.5,
                    f64::from(p / face_px) + 0.5,
                ));
            }
            ldi.offsets[p as usize + 1] = ldi.samples.len() as u32;
        }
        ldi
    };
    let environment = Environment {
        size_px: 0,
        texels: vec![],
    };
    CubeSamples {
        info: info(centre, 0.5),
        faces: Face::ALL.map(face).into(),
        environment,
    }
}

/// One ray from the centre through the middle of every pixel: a headbox of half size 0.5 about the
/// origin.
pub fn centre_rays(scene: &Scene, face_px: u32) -> CubeSamples {
    one_layer(DVec3::ZERO, face_px, &Face::ALL, |face, x, y| {
        let hit = scene.hit(DVec3::ZERO, face.direction(x, y, face_px))?;
        let normal = EncodedNormal::new(hit.normal.as_vec3());
        Some(DepthPixel {
            inverse_depth: (1.0 / hit.t) as f32,
            normal,
            color_srgb: srgb(hit.color),
        })
    })
}
