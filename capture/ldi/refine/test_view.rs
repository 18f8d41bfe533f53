//! One frame, held against rays.

use crate::accumulate::accumulator::Sample;
use crate::job::CaptureJob;
use crate::rays::trace::Router;
use glam::{DVec3, Vec3, dvec3};
use headbox_core::camera::Camera;
use headbox_core::random::Rng;
use headbox_cube::pack::PackedCube;
use headbox_cube::render::Renderer;
use headbox_trace::bvh::{Hit, HitPacket, PACKET, Ray, RayPacket};
use headbox_trace::sampler::RayKey;

/// Pixels a side of a view, unless faces have fewer.
pub(super) const VIEW_PX: u32 = 256;

/// Of what a ray meets, a frame shows less if splats cover less than this share of 255 of its pixel...
const COVERED: u8 = 128;

/// ... or if what it shows lies behind it by more than this share of its inverse depth (and two bins).
const BEHIND: f32 = 0.03;

/// The domain of aimed rays: after the faces of the headbox.
const AIMED: u8 = 6;

/// Half of the edge of the cube in which eyes near another are, in half-sizes of the headbox.
const NEAR: f64 = 0.25;

/// A frame to look at: from a place in the headbox, in some direction, as many pixels to a degree as faces have in their middle.
#[derive(Clone)]
pub(super) struct View {
    /// Names its rays: the view, and which of those near it.
    number: u32,
    copy: u32,
    /// In half-sizes from the centre.
    place: DVec3,
    camera: Camera,
}

impl View {
    /// View `number` of a job: its eye uniform in the headbox, its direction uniform on the sphere. `None` for a headbox that no
    /// camera can be put in.
    pub(super) fn fresh(job: &CaptureJob, number: u32) -> Option<Self> {
        let mut random = Self::random(job, number);
        let place = in_cube(&mut random);
        let (height, turn) = (
            random.unit() * 2.0 - 1.0,
            random.unit() * std::f64::consts::TAU,
        );
        let rim = (1.0 - height * height).sqrt();
        Self::new(
            job,
            [number, 0],
            place,
            dvec3(rim * turn.cos(), height, rim * turn.sin()),
        )
    }

    /// A view from near this one, in about its direction; `number` tells those of one view apart.
    pub(super) fn near(&self, job: &CaptureJob, number: usize) -> Option<Self> {
        let mut random = Self::random(job, self.number).fork(number as u64);
        let place = (self.place + in_cube(&mut random) * NEAR).clamp(DVec3::NEG_ONE, DVec3::ONE);
        let forward = self.camera.forward() + in_cube(&mut random) * NEAR;
        Self::new(job, [self.number, number as u32 + 1], place, forward)
    }

    fn new(
        job: &CaptureJob,
        [number, copy]: [u32; 2],
        place: DVec3,
        forward: DVec3,
    ) -> Option<Self> {
        let eye = job.centre + place * job.half_size_m;
        let side = VIEW_PX.min(job.face_size_px);
        let fov_deg = 2.0
            * (f64::from(side) / f64::from(job.face_size_px))
                .atan()
                .to_degrees();
        let camera = Camera::look_at(eye, eye + forward, DVec3::Y, fov_deg, [side, side]).ok()?;
        Some(Self {
            number,
            copy,
            place,
            camera,
        })
    }

    fn random(job: &CaptureJob, number: u32) -> Rng {
        Rng::new(job.parameters.seed).fork(SALT).fork(number.into())
    }
}

/// Keeps the random numbers of views apart from all others of a seed.
const SALT: u64 = 0x686f_6c65;

/// Uniform in the cube from -1 to 1.
fn in_cube(random: &mut Rng) -> DVec3 {
    dvec3(random.unit(), random.unit(), random.unit()) * 2.0 - 1.0
}

/// What frames lack.
#[derive(Default)]
pub(super) struct Findings {
    /// The frames, each with the share of its pixels that lack something.
    views: Vec<(f64, View)>,
    /// What rays met there.
    pub(super) aimed: Vec<Sample>,
}

impl Findings {
    pub(super) fn and(mut self, other: Self) -> Self {
        self.views.extend(other.views);
        self.aimed.extend(other.aimed);
        self
    }

    /// Mean share over the frames.
    pub(super) fn share(&self) -> f64 {
        self.views.iter().map(|(share, _)| share).sum::<f64>() / self.views.len().max(1) as f64
    }

    /// Standard error of the mean: frames are independent, pixels of a frame are not.
    pub(super) fn standard_error(&self) -> f64 {
        let (n, mean) = (self.views.len() as f64, self.share());
        let sum: f64 = self
            .views
            .iter()
            .map(|(share, _)| (share - mean).powi(2))
            .sum();
        if n > 1.0 {
            (sum / (n - 1.0) / n).sqrt()
        } else {
            1.0
        }
    }

    /// The views that lack most, those that lack more again and again, `count` in all; none if nothing is lacking.
    pub(super) fn worst(&self, count: usize) -> Vec<View> {
        let mut lacking: Vec<&(f64, View)> = self
            .views
            .iter()
            .filter(|(share, _)| *share > 0.0)
            .collect();
        lacking.sort_by(|a, b| b.0.total_cmp(&a.0).then(a.1.number.cmp(&b.1.number)));
        let total: f64 = lacking.iter().map(|(share, _)| share).sum();
        let copies = lacking.iter().flat_map(|(share, view)| {
            let copies = (share / total * count as f64).ceil() as usize;
            std::iter::repeat_n(view.clone(), copies)
        });
        copies.take(count).collect()
    }
}

/// What frames are held against.
pub(super) struct Look<'a> {
    pub(super) cube: &'a PackedCube,
    pub(super) router: &'a Router<'a>,
    pub(super) half_size_m: f64,
}

impl Look<'_> {
    /// Draws a frame and holds it against a ray through the middle of each pixel.
    pub(super) fn at(&self, view: View, renderer: &mut Renderer) -> Findings {
        let (frame, fronts) = renderer.render_with_fronts(self.cube, &view.camera);
        let side = view.camera.width();
        let mut hits = vec![
            Hit {
                t: f32::INFINITY,
                primitive: 0,
                u: 0.0,
                v: 0.0
            };
            (side * side) as usize
        ];
        let rays = ViewRays::new(&view, self.router.tracer.origin(), self.half_size_m);
        rays.trace(self, &mut hits);
        let (mut lacking, mut aimed) = (0u32, Vec::new());
        let margin = self.router.bins.inverse_depth(2.0) as f32;
        for (i, hit) in hits.iter().enumerate() {
            let (x, y) = (i as u32 % side, i as u32 / side);
            let pixel = Pixel {
                share: frame.coverage[i].splat_share(),
                inverse_depth: fronts[i],
            };
            let key = RayKey::new(AIMED, view.number, view.copy * VIEW_PX * VIEW_PX + i as u32);
            if hit.t == f32::INFINITY {
                if frame.coverage[i].is_hole() {
                    lacking += 1;
                    self.router.misses.mark(rays.ray(x, y).direction);
                }
                continue;
            }
            if !pixel.lacks(hit.t, margin) {
                continue;
            }
            // Where a surface ends within a pixel, frames may show either side.
            let farthest = neighbourhood(x, y, side)
                .map(|j| hits[j].t)
                .fold(0.0, f32::max);
            lacking += u32::from(farthest.is_finite() && pixel.lacks(farthest, margin));
            let ray = rays.ray(x, y);
            let length = ray.direction.length();
            let unit = Ray {
                direction: ray.direction / length,
                ..ray
            };
            aimed.push(self.router.sample(
                &unit,
                &Hit {
                    t: hit.t * length,
                    ..*hit
                },
                key,
            ));
        }
        Findings {
            views: vec![(f64::from(lacking) / f64::from(side * side), view)],
            aimed,
        }
    }
}

/// What a frame shows in a pixel.
struct Pixel {
    share: u8,
    inverse_depth: f32,
}

impl Pixel {
    /// Whether it shows less than a surface at an eye depth, within a margin of inverse depth.
    fn lacks(&self, eye_depth: f32, margin: f32) -> bool {
        self.share < COVERED || self.inverse_depth < (1.0 - BEHIND) / eye_depth - margin
    }
}

/// The pixels around one, with it.
fn neighbourhood(x: u32, y: u32, side: u32) -> impl Iterator<Item = usize> {
    let about = move |c: u32| c.saturating_sub(1)..(c + 2).min(side);
    about(y).flat_map(move |y| about(x).map(move |x| (y * side + x) as usize))
}

/// The rays through the pixels of a view. They start where they leave the headbox: nothing inside it is captured.
struct ViewRays<'a> {
    camera: &'a Camera,
    eye: Vec3,
    half_size_m: f32,
}

impl<'a> ViewRays<'a> {
    fn new(view: &'a View, origin: DVec3, half_size_m: f64) -> Self {
        Self {
            camera: &view.camera,
            eye: (view.camera.eye() - origin).as_vec3(),
            half_size_m: half_size_m as f32,
        }
    }

    /// The ray through the middle of a pixel; along its direction `t` is eye depth.
    fn ray(&self, x: u32, y: u32) -> Ray {
        let direction = self
            .camera
            .direction(f64::from(x) + 0.5, f64::from(y) + 0.5)
            .as_vec3();
        // A component of 0 gives infinity, or NaN where the eye lies on the face, which `min` passes over.
        let exits =
            (Vec3::splat(self.half_size_m) - self.eye * direction.signum()) / direction.abs();
        let t_min = exits
            .to_array()
            .into_iter()
            .fold(f32::INFINITY, f32::min)
            .max(0.0);
        Ray {
            origin: self.eye,
            direction,
            t_min,
            t_max: f32::INFINITY,
        }
    }

    /// Traces them all, squares of four by four pixels at a time.
    fn trace(&self, look: &Look, hits: &mut [Hit]) {
        const BLOCK: u32 = 4;
        let (side, tracer) = (self.camera.width(), look.router.tracer);
        let mut packets = Vec::with_capacity(side.div_ceil(BLOCK) as usize);
        let mut found = Vec::new();
        for y0 in (0..side).step_by(BLOCK as usize) {
            packets.clear();
            for x0 in (0..side).step_by(BLOCK as usize) {
                let mut packet = RayPacket::EMPTY;
                for k in 0..PACKET as u32 {
                    let (x, y) = (x0 + k % BLOCK, y0 + k / BLOCK);
                    if x < side && y < side {
                        packet.set(k as usize, &self.ray(x, y));
                    }
                }
                packets.push(packet);
            }
            found.clear();
            found.resize(packets.len(), HitPacket::MISS);
            tracer.closest_packets(&packets, &mut found);
            for (x0, found) in (0..side).step_by(BLOCK as usize).zip(&found) {
                for k in 0..PACKET as u32 {
                    let (x, y) = (x0 + k % BLOCK, y0 + k / BLOCK);
                    if let Some(hit) = found.hit(k as usize).filter(|_| x < side && y < side) {
                        hits[(y * side + x) as usize] = hit;
                    }
                }
            }
        }
    }
}
