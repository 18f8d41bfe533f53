//! Capture: rays from every face of the headbox, hits into accumulators, accumulators into a cube LDI.
//!
//! The rounds are: a pilot over all strata, the plan that follows from it, the planned rays. All six faces are traced in
//! one run; a hit goes to the face whose frustum contains it, whichever face its ray left (C13).

use super::ray_plan::RayPlan;
use crate::accumulate::accumulator::{Accumulator, Sample, sixteen_bits};
use crate::accumulate::environment_mask::MissMap;
use crate::accumulate::tiles::{InsertScratch, TileStore};
use crate::settings::{CaptureSettings, strata_of};
use glam::{DVec3, Vec3};
use headbox_core::cube_face::Face;
use headbox_core::progress::{Progress, check_cancelled};
use headbox_cube::model::depth_bins::DepthBins;
use headbox_cube::model::info::Holes;
use headbox_cube::model::parameters::Sampler;
use headbox_trace::bvh::{Hit, HitPacket, PACKET, Ray, RayPacket, Tracer};
use headbox_trace::sampler::{DirectionCell, RayDomain, RayKey};
use rayon::prelude::*;
use std::io;
use std::sync::atomic::{AtomicU64, Ordering};

/// Rays traced and kept, not yet lit and merged: what a shard file holds.
pub struct Tracing {
    /// Accumulators.
    pub store: TileStore,
    /// Directions in which rays left the scene.
    pub misses: MissMap,
    /// How many rays each stratum got.
    pub plan: RayPlan,
    /// Rays traced (in a shard: by this shard, its repetition of the pilot not counted).
    pub rays: u64,
    /// What frames were found to lack, where they were looked at.
    pub holes: Option<Holes>,
}

/// Traces the rays of `settings` (or of its shard).
///
/// # Errors
/// If spilling to disk fails.
pub fn trace(
    tracer: &Tracer,
    settings: &CaptureSettings,
    progress: &dyn Progress,
) -> io::Result<Tracing> {
    let new_store = || {
        let budget = settings
            .resources
            .budget
            .as_ref()
            .map(|(bytes, dir)| (*bytes, dir.as_path()));
        TileStore::new(settings.face_size_px, budget)
    };
    let strata = strata_of(&settings.parameters);
    let (part, parts) = settings.shard;
    let mut run = Tracing {
        store: new_store()?,
        misses: MissMap::new(settings.face_size_px),
        plan: RayPlan::full(strata, 6),
        rays: 0,
        holes: None,
    };
    if settings.parameters.sampler == Sampler::CentreRays {
        run.rays = pierce_from_centre(tracer, settings, &run, progress)?;
        return Ok(run);
    }
    let total = |plan: &RayPlan, job: &(u8, u32)| plan.rays_in_cell(job.0, job.1);
    let jobs: Vec<(u8, u32)> = (0..6)
        .flat_map(|domain| (0..strata.direction_cells()).map(move |cell| (domain, cell)))
        .collect();
    let mine: Vec<(u8, u32)> = jobs
        .iter()
        .copied()
        .skip(part as usize)
        .step_by(parts as usize)
        .collect();
    let planned = settings.parameters.novelty > 0.0 && strata.rays > 1;
    if planned {
        let pilot = run.plan.pilot_rays;
        let count = jobs.len() as u64 * u64::from(strata.position_cells()) * u64::from(pilot);
        progress.begin("pilot", "rays", count);
        trace_jobs(tracer, settings, &run, &jobs, |_| 0..pilot, progress)?;
        run.plan = RayPlan::from_pilot(strata, 6, &run.store, settings.parameters.novelty)?;
    }
    let pilot_done = planned && parts == 1;
    if planned && !pilot_done {
        // The other shards' share of the pilot is theirs to report.
        (run.store, run.misses) = (new_store()?, MissMap::new(settings.face_size_px));
    }
    run.rays = mine.iter().map(|job| total(&run.plan, job)).sum();
    let first = if pilot_done { run.plan.pilot_rays } else { 0 };
    let traced_before = mine.len() as u64 * u64::from(strata.position_cells()) * u64::from(first);
    progress.begin("trace", "rays", run.rays - traced_before);
    let range = |group: usize| first..run.plan.pilot_rays + run.plan.more_rays[group];
    trace_jobs(tracer, settings, &run, &mine, range, progress)?;
    Ok(run)
}

/// Traces, of every stratum of the given (domain, direction cell) pairs, the rays in the range for its group.
fn trace_jobs(
    tracer: &Tracer,
    settings: &CaptureSettings,
    run: &Tracing,
    jobs: &[(u8, u32)],
    range: impl Fn(usize) -> std::ops::Range<u32> + Sync,
    progress: &dyn Progress,
) -> io::Result<()> {
    let bins = DepthBins::new(settings.half_size_m, settings.face_size_px);
    let strata = strata_of(&settings.parameters);
    jobs.par_iter()
        .try_for_each_init(JobBuffers::default, |buffers, &(domain, cell)| {
            check_cancelled(progress)?;
            let job = DirectionCell {
                domain: RayDomain::cube_face(Face::ALL[usize::from(domain)], settings.half_size_m),
                domain_number: domain,
                strata,
                cell,
            };
            buffers.names.clear();
            for position_cell in 0..strata.position_cells() {
                let rays = range(run.plan.groups.of_cell(domain, cell, position_cell));
                buffers.names.extend(rays.map(|ray| (position_cell, ray)));
            }
            let router = Router {
                tracer,
                bins,
                size_px: settings.face_size_px,
                misses: &run.misses,
            };
            buffers.trace(&job, &router);
            run.store.insert(&buffers.samples, &mut buffers.scratch)?;
            progress.advance(buffers.names.len() as u64);
            Ok(())
        })
}

/// Buffers that a thread reuses from job to job.
#[derive(Default)]
struct JobBuffers {
    names: Vec<(u32, u32)>,
    packets: Vec<RayPacket>,
    hits: Vec<HitPacket>,
    samples: Vec<Sample>,
    scratch: InsertScratch,
}

impl JobBuffers {
    /// Traces all named rays of a job into `samples`.
    fn trace(&mut self, job: &DirectionCell, router: &Router) {
        /// Packets in flight: 64 of 16 rays and their hits stay in the level 2 cache.
        const BATCH: usize = 64;
        self.samples.clear();
        self.packets.resize(BATCH, RayPacket::EMPTY);
        self.hits.resize(BATCH, HitPacket::MISS);
        for names in self.names.chunks(BATCH * PACKET) {
            let count = names.len().div_ceil(PACKET);
            for (names, packet) in names.chunks(PACKET).zip(&mut self.packets) {
                job.fill_packet(names, packet);
            }
            router
                .tracer
                .closest_packets(&self.packets[..count], &mut self.hits[..count]);
            for (names, (packet, hits)) in names
                .chunks(PACKET)
                .zip(self.packets.iter().zip(&self.hits))
            {
                for (lane, &(position_cell, ray)) in names.iter().enumerate() {
                    let (Some(ray_here), key) = (packet.ray(lane), job.key(position_cell, ray))
                    else {
                        continue;
                    };
                    match hits.hit(lane) {
                        Some(hit) => self.samples.push(router.sample(&ray_here, &hit, key)),
                        None => router.misses.mark(ray_here.direction),
                    }
                }
            }
        }
    }
}

/// Turns hits into samples of the face that contains them; misses are marked in the environment.
pub(crate) struct Router<'a> {
    pub(crate) tracer: &'a Tracer,
    pub(crate) bins: DepthBins,
    /// Pixels a side of a face.
    pub(crate) size_px: u32,
    pub(crate) misses: &'a MissMap,
}

impl Router<'_> {
    /// The sample of a hit. The ray's direction has unit length.
    #[inline(always)] // the one caller that matters builds rays and hits from lanes, and would wait for them to reach memory
    pub(crate) fn sample(&self, ray: &Ray, hit: &Hit, key: RayKey) -> Sample {
        let (face, [right, up, eye_depth]) = Face::locate(ray.origin + ray.direction * hit.t);
        let inverse_depth = 1.0 / eye_depth;
        let half = self.size_px as f32 / 2.0;
        let pixel =
            |c: f32| ((half * (1.0 + c * inverse_depth)) as u32).min(self.size_px - 1) as u16;
        let (bin, offset) = self.bins.place(inverse_depth);
        let scene = self.tracer.scene();
        let normal = self.tracer.geometric_normal(hit.primitive);
        let cos = normal.dot(ray.direction);
        let normal = if cos > 0.0 { -normal } else { normal };
        let material = scene.triangles[hit.primitive as usize].material;
        Sample {
            face,
            x: pixel(right),
            y: pixel(-up),
            bin,
            offset,
            class: Accumulator::class(material, cos > 0.0, normal),
            albedo: scene
                .paint(hit.primitive)
                .albedo(hit.u, hit.v)
                .map(sixteen_bits),
            primitive: hit.primitive,
            barycentric: [hit.u, hit.v].map(sixteen_bits),
            area: hit.t * hit.t / cos.abs().max(1e-6),
            key,
        }
    }
}

/// Sampler [`Sampler::CentreRays`]: every hit beyond the headbox on the ray through each pixel's centre.
fn pierce_from_centre(
    tracer: &Tracer,
    settings: &CaptureSettings,
    run: &Tracing,
    progress: &dyn Progress,
) -> io::Result<u64> {
    let size = settings.face_size_px;
    let bins = DepthBins::new(settings.half_size_m, size);
    let router = Router {
        tracer,
        bins,
        size_px: size,
        misses: &run.misses,
    };
    let (part, parts) = settings.shard;
    let rows: Vec<u32> = (0..6 * size)
        .skip(part as usize)
        .step_by(parts as usize)
        .collect();
    progress.begin("trace", "rays", rows.len() as u64 * u64::from(size));
    rows.par_iter().try_for_each_init(
        InsertScratch::default,
        |scratch, &row| -> io::Result<()> {
            let face = Face::ALL[(row / size) as usize];
            let mut samples = Vec::new();
            for x in 0..size {
                let direction = face
                    .direction(f64::from(x) + 0.5, f64::from(row % size) + 0.5, size)
                    .as_vec3();
                // Directions have eye depth 1, so the headbox ends at t = half size.
                let t_min = settings.half_size_m as f32;
                let ray = Ray {
                    origin: Vec3::ZERO,
                    direction,
                    t_min,
                    t_max: f32::INFINITY,
                };
                let before = samples.len();
                let key = RayKey::new(face.index() as u8, row % size * size + x, 0);
                tracer.all_hits(&ray, &mut |hit| {
                    samples.push(router.sample(&ray, &hit, key))
                });
                if samples.len() == before {
                    run.misses.mark(direction);
                }
            }
            progress.advance(u64::from(size));
            run.store.insert(&samples, scratch)
        },
    )?;
    Ok(rows.len() as u64 * u64::from(size))
}

/// Share of the headbox that its centre does not see: geometry inside it or across it hides the scene from there.
/// Capture works all the same; rays start on the headbox's faces.
pub fn blocked_share(tracer: &Tracer, half_size_m: f64) -> f64 {
    const SIDE: u32 = 24;
    let blocked = AtomicU64::new(0);
    (0..SIDE.pow(3)).into_par_iter().for_each(|i| {
        let cell = |k: u32| (f64::from(k) + 0.5) / f64::from(SIDE) * 2.0 - 1.0;
        let place =
            DVec3::new(cell(i % SIDE), cell(i / SIDE % SIDE), cell(i / SIDE / SIDE)) * half_size_m;
        let ray = Ray {
            origin: Vec3::ZERO,
            direction: place.as_vec3(),
            t_min: 0.0,
            t_max: 1.0,
        };
        blocked.fetch_add(u64::from(tracer.occluded(&ray)), Ordering::Relaxed);
    });
    blocked.into_inner() as f64 / f64::from(SIDE.pow(3))
}
