//! Ray rates on stratified cube-face rays, written to a file so that other tracers can trace the
//! same rays.
//!
//! ```text
//! cargo run --release -p headbox-trace --example rays -- SCENE.obj RAYS.bin \
//!     [cx cy cz half] [strata=32] [rays-per-stratum=16] [faces=0] [repetitions=3]
//! ```
//!
//! The rays start on the faces of the cube (centre c, half size `half`, in the file's axes),
//! cosine-weighted about the face's outward normal, stratum by stratum: the order of a capture. The
//! file holds a little-endian u64 count, then origin x, y, z and direction x, y, z as six arrays of
//! f32. Generating, writing and reading rays is not timed; loading them into packets, tracing, and
//! storing t and the triangle's index is. Rates are Mrays/s as median (minimum to maximum), for one
//! and two threads.

mod cube;

use cube::{Rays, cube_rays, load_packet, load_ray};
use glam::DVec3;
use headbox_scene::material::Material;
use headbox_scene::scene::{Scene, Triangle};
use headbox_trace::bvh::{HitPacket, PACKET, RayPacket, Tracer};
use std::io::Write;
use std::sync::{Arc, Mutex};
use std::time::Instant;

/// Number of rays that a thread traces at a time.
const CHUNK: usize = 16_384;

/// Number of packets traced by one call.
const BATCH: usize = 64;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let args: Vec<String> = std::env::args().collect();
    let [_, scene, file, ..] = &args[..] else {
        return Err("usage: rays SCENE.obj RAYS.bin [cx cy cz half] [strata] [rays-per-stratum] [faces] [reps]".into());
    };
    let number = |i: usize, default: f64| args.get(i).map_or(Ok(default), |s| s.parse::<f64>());
    let centre = DVec3::new(number(3, 0.0)?, number(4, 0.0)?, number(5, 2.0)?);
    let half = number(6, 0.5)?;
    let n = number(7, 32.0)? as u32;
    let m = number(8, 16.0)? as u32;
    let faces = args.get(9).map_or("0", String::as_str);
    let repetitions = number(10, 3.0)? as usize;

    let scene = read_obj(scene)?;
    let rays = cube_rays(centre, half, n, m, faces);
    write_rays(file, &rays)?;
    let start = Instant::now();
    // The file's own frame, so that every tracer gets the same coordinates.
    let tracer = Tracer::new(Arc::new(scene), DVec3::ZERO);
    println!(
        "{} triangles, {} rays; built in {:.2?}",
        tracer.scene().triangles.len(),
        rays[0].len(),
        start.elapsed()
    );
    report(&tracer, &rays);
    let mut results = (vec![1.0; rays[0].len()], vec![1; rays[0].len()]);
    for (name, trace_chunk) in [
        ("packets of 16", trace_packets as TraceChunk),
        ("single rays", trace_single),
        ("packets, occlusion", trace_occlusion),
    ] {
        for threads in [1, 2] {
            let mut rates: Vec<f64> = (0..repetitions)
                .map(|_| {
                    rays[0].len() as f64
                        / 1e6
                        / timed_pass(&tracer, &rays, &mut results, threads, trace_chunk)
                })
                .collect();
            rates.sort_by(f64::total_cmp);
            let least = rates[0];
            let most = rates[repetitions - 1];
            println!(
                "{name}, {threads} thread(s): {:.2} Mrays/s ({least:.2} to {most:.2})",
                rates[repetitions / 2]
            );
        }
    }
    Ok(())
}

/// Reads positions and faces of an OBJ file, in the file's frame.
fn read_obj(path: &str) -> Result<Scene, Box<dyn std::error::Error>> {
    let options = tobj::LoadOptions {
        triangulate: true,
        ..tobj::LoadOptions::default()
    };
    let (models, _) = tobj::load_obj(path, &options)?;
    let mut scene = Scene {
        materials: vec![Material::default()],
        ..Scene::default()
    };
    for mesh in models.into_iter().map(|model| model.mesh) {
        let base = scene.positions.len() as u32;
        scene
            .positions
            .extend(mesh.positions.chunks_exact(3).map(DVec3::from_slice));
        let triangles = mesh.indices.as_chunks::<3>().0.iter();
        scene.triangles.extend(triangles.map(|t| Triangle {
            vertices: t.map(|i| i + base),
            material: 0,
        }));
    }
    Ok(scene)
}

fn write_rays(path: &str, rays: &Rays) -> std::io::Result<()> {
    let mut file = std::io::BufWriter::new(std::fs::File::create(path)?);
    file.write_all(&(rays[0].len() as u64).to_le_bytes())?;
    for value in rays.iter().flatten() {
        file.write_all(&value.to_le_bytes())?;
    }
    file.flush()
}

/// Prints the hit fraction and mean distance, on which other tracers must agree.
fn report(tracer: &Tracer, rays: &Rays) {
    let mut hits = 0_u64;
    let mut sum = 0.0;
    for start in (0..rays[0].len()).step_by(PACKET) {
        let packet = tracer.closest_packet(&load_packet(rays, start));
        for t in packet.t.into_iter().filter(|t| t.is_finite()) {
            hits += 1;
            sum += f64::from(t);
        }
    }
    println!(
        "hit fraction {:.5}, mean t {:.5}",
        hits as f64 / rays[0].len() as f64,
        sum / hits.max(1) as f64
    );
}

/// Function that traces the rays from `start` on, as many as the result slices hold.
type TraceChunk = fn(&Tracer, &Rays, usize, &mut [f32], &mut [u32]);

/// Measures one pass over all rays, seconds. The results' memory must have been touched before.
fn timed_pass(
    tracer: &Tracer,
    rays: &Rays,
    (t, primitive): &mut (Vec<f32>, Vec<u32>),
    threads: usize,
    trace_chunk: TraceChunk,
) -> f64 {
    let chunks = t
        .chunks_mut(CHUNK)
        .zip(primitive.chunks_mut(CHUNK))
        .enumerate();
    let chunks = Mutex::new(chunks);
    let start = Instant::now();
    std::thread::scope(|scope| {
        for _ in 0..threads {
            scope.spawn(|| {
                loop {
                    let chunk = chunks.lock().ok().and_then(|mut chunks| chunks.next());
                    let Some((index, (t, primitive))) = chunk else {
                        break;
                    };
                    trace_chunk(tracer, rays, index * CHUNK, t, primitive);
                }
            });
        }
    });
    let seconds = start.elapsed().as_secs_f64();
    std::hint::black_box((t, primitive));
    seconds
}

fn trace_packets(tracer: &Tracer, rays: &Rays, start: usize, t: &mut [f32], primitive: &mut [u32]) {
    let mut packets = [const { RayPacket::EMPTY }; BATCH];
    let mut hits = [const { HitPacket::MISS }; BATCH];
    for (i, (t, primitive)) in t
        .chunks_mut(BATCH * PACKET)
        .zip(primitive.chunks_mut(BATCH * PACKET))
        .enumerate()
    {
        let start = start + i * BATCH * PACKET;
        let count = t.len().div_ceil(PACKET);
        for (k, packet) in packets[..count].iter_mut().enumerate() {
            *packet = load_packet(rays, start + k * PACKET);
        }
        tracer.closest_packets(&packets[..count], &mut hits[..count]);
        for (k, (t, primitive)) in t
            .chunks_mut(PACKET)
            .zip(primitive.chunks_mut(PACKET))
            .enumerate()
        {
            t.copy_from_slice(&hits[k].t[..t.len()]);
            primitive.copy_from_slice(&hits[k].primitive[..primitive.len()]);
        }
    }
}

fn trace_occlusion(tracer: &Tracer, rays: &Rays, start: usize, _: &mut [f32], blocked: &mut [u32]) {
    for (i, blocked) in blocked.chunks_mut(BATCH * PACKET).enumerate() {
        let starts = (start + i * BATCH * PACKET..)
            .step_by(PACKET)
            .take(blocked.len().div_ceil(PACKET));
        let packets: Vec<RayPacket> = starts.map(|start| load_packet(rays, start)).collect();
        let mut bits = [0; BATCH];
        tracer.occluded_packets(&packets, &mut bits);
        for (k, blocked) in blocked.iter_mut().enumerate() {
            *blocked = u32::from(bits[k / PACKET] >> (k % PACKET) & 1);
        }
    }
}

fn trace_single(tracer: &Tracer, rays: &Rays, start: usize, t: &mut [f32], primitive: &mut [u32]) {
    for (i, (t, primitive)) in t.iter_mut().zip(primitive).enumerate() {
        let ray = load_ray(rays, start + i);
        (*t, *primitive) = tracer
            .closest(&ray)
            .map_or((f32::INFINITY, u32::MAX), |hit| (hit.t, hit.primitive));
    }
}
