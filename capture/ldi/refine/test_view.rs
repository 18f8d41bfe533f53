//! A test view: one frame, compared with a ray through each of its pixels.

use crate::accumulate::accumulator::Sample;
use crate::rays::trace_and_accumulate::HitRouter;
use crate::spec::CaptureSpec;
use glam::{DVec3, Vec3, dvec3};
use headbox_core::camera::{Camera, fov_deg};
use headbox_core::random::Rng;
use headbox_cube::pack::CubeLdi;
use headbox_cube::render::Renderer;
use headbox_trace::bvh::{Hit, HitPacket, PACKET, Ray, RayPacket, Tracer};
use headbox_trace::sampler::RayKey;

/// Pixels along a side of a view, unless faces have fewer.
const VIEW_PX: u32 = 256;

/// Splat coverage, 0..255, below which a pixel lacks the surface that its ray hits: half of the
/// weight at which a surface is opaque.
const COVERED: u8 = 120;

/// Share of the surface's inverse depth by which the shown depth may lie behind it, in addition to
/// two bins.
const BEHIND: f32 = 0.03;

/// Ray domain of aimed rays: the one after the faces of the headbox.
const AIMED_DOMAIN: u8 = 6;

/// Half of the edge of the cube around an eye in which near eyes are chosen, in half-sizes of the
/// headbox.
const NEAR: f64 = 0.25;

/// Random stream of test views, which separates them from other uses of a seed.
const SALT: u64 = 0x686f_6c65;

/// A view from the headbox, with as many pixels per degree as faces have in their middle.
#[derive(Clone)]
pub(super) struct TestView {
    /// Number of the view; together with `copy` it identifies the rays.
    number: u32,
    /// Number among the views near view `number`; 0 for that view itself.
    copy: u32,
    /// Eye position in half-sizes from the centre.
    position: DVec3,
    camera: Camera,
}

impl TestView {
    /// View `number` of a capture: its eye uniform in the headbox, its direction uniform on the
    /// sphere. `None` for a headbox in which no camera can be placed.
    pub(super) fn fresh(spec: &CaptureSpec, number: u32) -> Option<Self> {
        let mut random = Self::random(spec, number);
        let position = random.in_cube(1.0);
        let height = random.unit() * 2.0 - 1.0;
        let turn = random.unit() * std::f64::consts::TAU;
        let rim = (1.0 - height * height).sqrt();
        let forward = dvec3(rim * turn.cos(), height, rim * turn.sin());
        Self::new(spec, [number, 0], position, forward)
    }

    /// A view from near this one in about its direction: number `number` of such views.
    pub(super) fn near(&self, spec: &CaptureSpec, number: usize) -> Option<Self> {
        let mut random = Self::random(spec, self.number).fork(number as u64);
        let position =
            (self.position + random.in_cube(1.0) * NEAR).clamp(DVec3::NEG_ONE, DVec3::ONE);
        let forward = self.camera.forward() + random.in_cube(1.0) * NEAR;
        Self::new(spec, [self.number, number as u32 + 1], position, forward)
    }

    fn new(
        spec: &CaptureSpec,
        [number, copy]: [u32; 2],
        position: DVec3,
        forward: DVec3,
    ) -> Option<Self> {
        let eye = spec.centre + position * spec.half_size_m;
        let side = VIEW_PX.min(spec.face_size_px);
        // The focal length of a face is half its side.
        let fov_deg = fov_deg(f64::from(side), f64::from(spec.face_size_px) / 2.0);
        let camera = Camera::look_at(eye, eye + forward, DVec3::Y, fov_deg, [side, side]).ok()?;
        Some(Self {
            number,
            copy,
            position,
            camera,
        })
    }

    fn random(spec: &CaptureSpec, number: u32) -> Rng {
        Rng::new(spec.parameters.seed)
            .fork(SALT)
            .fork(number.into())
    }
}

/// Views that were compared with the scene.
#[derive(Default)]
pub(super) struct TestedViews {
    /// The views, each with its share of lacking pixels.
    pub(super) views: Vec<(f64, TestView)>,
    /// Number of rays through lacking pixels whose hits were added.
    pub(super) aimed_rays: u64,
}

impl TestedViews {
    /// Mean share of lacking pixels over the views.
    pub(super) fn share(&self) -> f64 {
        self.views.iter().map(|(share, _)| share).sum::<f64>() / self.views.len().max(1) as f64
    }

    /// Standard error of the mean: views are independent, pixels of a view are not.
    pub(super) fn standard_error(&self) -> f64 {
        let count = self.views.len() as f64;
        let mean = self.share();
        let sum: f64 = self
            .views
            .iter()
            .map(|(share, _)| (share - mean).powi(2))
            .sum();
        if count > 1.0 {
            (sum / (count - 1.0) / count).sqrt()
        } else {
            1.0
        }
    }

    /// The `count` views with most lacking pixels, each repeated in proportion to its share; none
    /// if no pixel is lacking.
    pub(super) fn worst(&self, count: usize) -> Vec<TestView> {
        let mut lacking: Vec<&(f64, TestView)> = self
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

/// Comparison of views of a cube with the scene.
pub(super) struct ViewTest<'a> {
    pub(super) cube: &'a CubeLdi,
    pub(super) router: &'a HitRouter<'a>,
    pub(super) half_size_m: f64,
}

impl ViewTest<'_> {
    /// Renders a view and compares it with a ray through the middle of each pixel. Returns the
    /// share of lacking pixels, and the hits of rays through pixels that lack what these hit.
    pub(super) fn run(&self, view: &TestView, renderer: &mut Renderer) -> (f64, Vec<Sample>) {
        let (frame, fronts) = renderer.render_with_fronts(self.cube, &view.camera);
        let side = view.camera.width();
        let mut hits = vec![None; (side * side) as usize];
        let rays = ViewRays::new(view, self.router.tracer.origin(), self.half_size_m);
        rays.trace(self.router.tracer, &mut hits);
        let mut lacking = 0u32;
        let mut aimed = Vec::new();
        let margin = self.router.bins.inverse_depth(2.0) as f32;
        for (i, hit) in hits.iter().enumerate() {
            let x = i as u32 % side;
            let y = i as u32 / side;
            let Some(hit) = hit else {
                if frame.coverage[i].is_hole() {
                    lacking += 1;
                    let direction = rays.ray(x, y).direction;
                    self.router.environment_mask.mark(direction);
                }
                continue;
            };
            // True if the pixel does not show a surface at an eye depth.
            let lacks_surface = |eye_depth: f32| {
                frame.coverage[i].splat_share() < COVERED
                    || fronts[i] < (1.0 - BEHIND) / eye_depth - margin
            };
            if !lacks_surface(hit.t) {
                continue;
            }
            // Where a surface ends within a pixel, a frame may show either side.
            let farthest = neighbourhood(x, y, side)
                .map(|j| hits[j].map_or(f32::INFINITY, |hit| hit.t))
                .fold(0.0, f32::max);
            lacking += u32::from(farthest.is_finite() && lacks_surface(farthest));
            let ray_number = view.copy * VIEW_PX * VIEW_PX + i as u32;
            let key = RayKey::new(AIMED_DOMAIN, view.number, ray_number);
            let ray = rays.ray(x, y);
            let length = ray.direction.length();
            let unit_ray = Ray {
                direction: ray.direction / length,
                ..ray
            };
            let hit = Hit {
                t: hit.t * length,
                ..*hit
            };
            aimed.push(self.router.sample(&unit_ray, &hit, key));
        }
        (f64::from(lacking) / f64::from(side * side), aimed)
    }
}

/// The indices of a pixel and those around it.
fn neighbourhood(x: u32, y: u32, side: u32) -> impl Iterator<Item = usize> {
    let around = move |c: u32| c.saturating_sub(1)..(c + 2).min(side);
    around(y).flat_map(move |y| around(x).map(move |x| (y * side + x) as usize))
}

/// The rays through the pixels of a view. They start where they leave the headbox: nothing inside
/// it is captured.
struct ViewRays<'a> {
    camera: &'a Camera,
    /// Relative to the tracer's origin, metres.
    eye: Vec3,
    half_size_m: f32,
}

impl<'a> ViewRays<'a> {
    fn new(view: &'a TestView, origin: DVec3, half_size_m: f64) -> Self {
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
        // A component of 0 gives infinity, or NaN where the eye lies on the face, which `min`
        // skips.
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

    /// Traces all rays, a block of four by four pixels at a time.
    fn trace(&self, tracer: &Tracer, hits: &mut [Option<Hit>]) {
        const BLOCK: u32 = 4;
        let side = self.camera.width();
        let mut packets = Vec::with_capacity(side.div_ceil(BLOCK) as usize);
        let mut packet_hits = Vec::new();
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
            packet_hits.clear();
            packet_hits.resize(packets.len(), HitPacket::MISS);
            tracer.closest_packets(&packets, &mut packet_hits);
            for (x0, packet_hit) in (0..side).step_by(BLOCK as usize).zip(&packet_hits) {
                for k in 0..PACKET as u32 {
                    let (x, y) = (x0 + k % BLOCK, y0 + k / BLOCK);
                    if x < side && y < side {
                        hits[(y * side + x) as usize] = packet_hit.hit(k as usize);
                    }
                }
            }
        }
    }
}
