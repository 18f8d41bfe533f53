//! Traces rays from every face of the headbox and accumulates their hits.
//!
//! A pilot round over all strata comes first; the plan that follows from it specifies how many more
//! rays each stratum gets. All six faces are traced in one run. A hit goes to the face whose
//! frustum contains it, whichever face its ray left (C13).

use super::ray_plan::RayPlan;
use crate::accumulate::accumulator::{Accumulator, Sample, to_unorm16};
use crate::accumulate::environment_mask::EnvironmentMask;
use crate::accumulate::tile_store::{InsertScratch, TileStore};
use crate::capture::{SceneCapture, stage};
use crate::spec::{CaptureSpec, RunOptions};
use glam::{DVec3, Vec3};
use headbox_core::cube_face::Face;
use headbox_core::progress::check_cancelled;
use headbox_cube::model::depth_bins::DepthBins;
use headbox_cube::model::info::Holes;
use headbox_cube::model::parameters::Sampler;
use headbox_trace::bvh::{Hit, HitPacket, PACKET, Ray, RayPacket, Tracer};
use headbox_trace::sampler::{DirectionCell, RayDomain, RayKey};
use rayon::prelude::*;
use std::io;

/// Number of ray domains: the faces of the headbox.
const DOMAINS: u32 = 6;

/// Traced rays, not yet lit and merged: the content of a shard file.
pub struct TracedRays {
    /// Accumulators of the hits.
    pub store: TileStore,
    /// Directions in which rays left the scene.
    pub environment_mask: EnvironmentMask,
    /// Number of rays of each stratum.
    pub plan: RayPlan,
    /// Number of traced rays (in a shard, by this shard, without its repetition of the pilot).
    pub rays: u64,
    /// Share of holes in test views; `None` if holes were not searched.
    pub holes: Option<Holes>,
}

impl TracedRays {
    /// A tracing without hits, whose plan contains all rays of the spec.
    ///
    /// # Errors
    /// If the spill file cannot be created.
    pub fn empty(spec: &CaptureSpec, options: &RunOptions) -> io::Result<Self> {
        Ok(Self {
            store: TileStore::new(spec.face_size_px, options.spill_budget())?,
            environment_mask: EnvironmentMask::new(spec.face_size_px),
            plan: RayPlan::full(spec.strata(), DOMAINS),
            rays: 0,
            holes: None,
        })
    }
}

/// Traces the rays of a capture, or of its shard.
///
/// # Errors
/// If accumulators cannot be spilled, or if the capture was cancelled.
pub(crate) fn trace(capture: &SceneCapture) -> io::Result<TracedRays> {
    let SceneCapture { spec, options, .. } = *capture;
    let strata = spec.strata();
    let (part, parts) = options.shard;
    let mut tracing = TracedRays::empty(spec, options)?;
    if spec.parameters.sampler == Sampler::CentreRays {
        tracing.rays = trace_centre_rays(capture, &tracing)?;
        return Ok(tracing);
    }
    let all_cells: Vec<DomainCell> = (0..DOMAINS as u8)
        .flat_map(|domain| (0..strata.direction_cells()).map(move |cell| (domain, cell)))
        .collect();
    let own_cells: Vec<DomainCell> = all_cells
        .iter()
        .copied()
        .skip(part as usize)
        .step_by(parts as usize)
        .collect();
    let has_pilot = spec.parameters.novelty > 0.0 && strata.rays > 1;
    if has_pilot {
        let pilot = tracing.plan.pilot_rays;
        let strata_count = all_cells.len() as u64 * u64::from(strata.position_cells());
        options
            .progress
            .begin(stage::PILOT, "rays", strata_count * u64::from(pilot));
        trace_cells(capture, &tracing, &all_cells, |_| 0..pilot)?;
        tracing.plan =
            RayPlan::from_pilot(strata, DOMAINS, &tracing.store, spec.parameters.novelty)?;
    }
    let keeps_pilot = has_pilot && parts == 1;
    if has_pilot && !keeps_pilot {
        // The other shards report their own share of the pilot.
        tracing = TracedRays {
            plan: tracing.plan,
            ..TracedRays::empty(spec, options)?
        };
    }
    tracing.rays = own_cells
        .iter()
        .map(|&(domain, cell)| tracing.plan.rays_in_cell(domain, cell))
        .sum();
    let first = if keeps_pilot {
        tracing.plan.pilot_rays
    } else {
        0
    };
    let traced_before =
        own_cells.len() as u64 * u64::from(strata.position_cells()) * u64::from(first);
    options
        .progress
        .begin(stage::TRACE, "rays", tracing.rays - traced_before);
    let plan = &tracing.plan;
    let range = |group: usize| first..plan.pilot_rays + plan.more_rays[group];
    trace_cells(capture, &tracing, &own_cells, range)?;
    Ok(tracing)
}

/// A ray domain and one of its direction cells.
type DomainCell = (u8, u32);

/// Traces, for every stratum of the cells, the rays in the range of its group.
fn trace_cells(
    capture: &SceneCapture,
    tracing: &TracedRays,
    cells: &[DomainCell],
    range: impl Fn(usize) -> std::ops::Range<u32> + Sync,
) -> io::Result<()> {
    let SceneCapture { spec, options, .. } = *capture;
    let strata = spec.strata();
    let router = HitRouter::new(capture, &tracing.environment_mask);
    cells
        .par_iter()
        .try_for_each_init(CellBuffers::default, |buffers, &(domain, cell)| {
            check_cancelled(options.progress)?;
            let direction_cell = DirectionCell {
                domain: RayDomain::cube_face(Face::ALL[usize::from(domain)], spec.half_size_m),
                domain_number: domain,
                strata,
                cell,
            };
            buffers.rays.clear();
            for position_cell in 0..strata.position_cells() {
                let group = tracing.plan.groups.index(domain, cell, position_cell);
                let rays = range(group).map(|ray| (position_cell, ray));
                buffers.rays.extend(rays);
            }
            buffers.trace(&direction_cell, &router);
            tracing
                .store
                .insert(&buffers.samples, &mut buffers.scratch)?;
            options.progress.advance(buffers.rays.len() as u64);
            Ok(())
        })
}

/// Buffers that a thread reuses from cell to cell.
#[derive(Default)]
struct CellBuffers {
    /// The rays to trace: position cell and number in its stratum.
    rays: Vec<(u32, u32)>,
    packets: Vec<RayPacket>,
    hits: Vec<HitPacket>,
    samples: Vec<Sample>,
    scratch: InsertScratch,
}

impl CellBuffers {
    /// Traces the rays of a direction cell into `samples`.
    fn trace(&mut self, direction_cell: &DirectionCell, router: &HitRouter) {
        /// Packets in flight: 64 of 16 rays and their hits stay in the level 2 cache.
        const BATCH: usize = 64;
        self.samples.clear();
        self.packets.resize(BATCH, RayPacket::EMPTY);
        self.hits.resize(BATCH, HitPacket::MISS);
        for rays in self.rays.chunks(BATCH * PACKET) {
            let count = rays.len().div_ceil(PACKET);
            for (rays, packet) in rays.chunks(PACKET).zip(&mut self.packets) {
                direction_cell.fill_packet(rays, packet);
            }
            router
                .tracer
                .closest_packets(&self.packets[..count], &mut self.hits[..count]);
            for (rays, (packet, hits)) in
                rays.chunks(PACKET).zip(self.packets.iter().zip(&self.hits))
            {
                for (lane, &(position_cell, ray_number)) in rays.iter().enumerate() {
                    let key = direction_cell.key(position_cell, ray_number);
                    let Some(ray) = packet.ray(lane) else {
                        continue;
                    };
                    match hits.hit(lane) {
                        Some(hit) => self.samples.push(router.sample(&ray, &hit, key)),
                        None => router.environment_mask.mark(ray.direction),
                    }
                }
            }
        }
    }
}

/// Turns hits into samples of the face that contains them.
pub(crate) struct HitRouter<'a> {
    pub(crate) tracer: &'a Tracer,
    pub(crate) bins: DepthBins,
    /// Pixels along a side of a face.
    pub(crate) size_px: u32,
    /// Receives rays that hit nothing.
    pub(crate) environment_mask: &'a EnvironmentMask,
}

impl<'a> HitRouter<'a> {
    pub(crate) fn new(capture: &SceneCapture<'a>, environment_mask: &'a EnvironmentMask) -> Self {
        Self {
            tracer: capture.tracer,
            bins: capture.spec.depth_bins(),
            size_px: capture.spec.face_size_px,
            environment_mask,
        }
    }

    /// The sample of a hit. The ray's direction has unit length.
    // Inlined into its one hot caller, which builds rays and hits from lanes and would otherwise
    // wait for them to reach memory.
    #[inline(always)]
    pub(crate) fn sample(&self, ray: &Ray, hit: &Hit, key: RayKey) -> Sample {
        let (face, [right, up, eye_depth]) = Face::locate(ray.origin + ray.direction * hit.t);
        let inverse_depth = 1.0 / eye_depth;
        let half = self.size_px as f32 / 2.0;
        let pixel =
            |c: f32| ((half * (1.0 + c * inverse_depth)) as u32).min(self.size_px - 1) as u16;
        let (bin, offset) = self.bins.place(inverse_depth);
        let scene = self.tracer.scene();
        let (class, cos) = Accumulator::class_of_hit(self.tracer, ray.direction, hit.primitive);
        Sample {
            face,
            x: pixel(right),
            y: pixel(-up),
            bin,
            offset,
            class,
            albedo: scene
                .paint(hit.primitive)
                .albedo(hit.u, hit.v)
                .map(to_unorm16),
            primitive: hit.primitive,
            barycentric: [hit.u, hit.v].map(to_unorm16),
            area: hit.t * hit.t / cos.abs().max(1e-6),
            key,
        }
    }
}

/// Traces the rays of [`Sampler::CentreRays`]: one through each pixel's centre, of which every hit
/// beyond the headbox is kept. Returns the number of rays.
fn trace_centre_rays(capture: &SceneCapture, tracing: &TracedRays) -> io::Result<u64> {
    let SceneCapture {
        spec,
        tracer,
        options,
        ..
    } = *capture;
    let size = spec.face_size_px;
    let router = HitRouter::new(capture, &tracing.environment_mask);
    let (part, parts) = options.shard;
    let rows: Vec<u32> = (0..6 * size)
        .skip(part as usize)
        .step_by(parts as usize)
        .collect();
    let rays = rows.len() as u64 * u64::from(size);
    options.progress.begin(stage::TRACE, "rays", rays);
    rows.par_iter().try_for_each_init(
        InsertScratch::default,
        |scratch, &row| -> io::Result<()> {
            let face = Face::ALL[(row / size) as usize];
            let mut samples = Vec::new();
            for x in 0..size {
                let direction = face
                    .direction(f64::from(x) + 0.5, f64::from(row % size) + 0.5, size)
                    .as_vec3();
                let ray = Ray {
                    origin: Vec3::ZERO,
                    direction,
                    // Directions have eye depth 1, so the headbox ends at t = half size.
                    t_min: spec.half_size_m as f32,
                    t_max: f32::INFINITY,
                };
                let before = samples.len();
                let key = RayKey::new(face.index() as u8, row % size * size + x, 0);
                tracer.all_hits(&ray, &mut |hit| {
                    samples.push(router.sample(&ray, &hit, key));
                });
                if samples.len() == before {
                    tracing.environment_mask.mark(direction);
                }
            }
            options.progress.advance(u64::from(size));
            tracing.store.insert(&samples, scratch)
        },
    )?;
    Ok(rays)
}

/// Estimates the share of the headbox that its centre does not see because geometry inside the
/// headbox occludes it. Capture works all the same, because rays start on the headbox's faces.
pub fn blocked_share(tracer: &Tracer, half_size_m: f64) -> f64 {
    const SIDE: u32 = 24;
    let is_blocked = |&i: &u32| {
        let cell = |k: u32| (f64::from(k) + 0.5) / f64::from(SIDE) * 2.0 - 1.0;
        let position =
            DVec3::new(cell(i % SIDE), cell(i / SIDE % SIDE), cell(i / SIDE / SIDE)) * half_size_m;
        tracer.occluded(&Ray {
            origin: Vec3::ZERO,
            direction: position.as_vec3(),
            t_min: 0.0,
            t_max: 1.0,
        })
    };
    let blocked = (0..SIDE.pow(3)).into_par_iter().filter(is_blocked).count();
    blocked as f64 / f64::from(SIDE.pow(3))
}
