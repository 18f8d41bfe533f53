//! Ray rates on stratified cube-face rays, and a file of those rays for other tracers to trace the very same.
//!
//! ```text
//! cargo run --release -p headbox-capture --example rays -- SCENE.obj RAYS.bin \
//!     [cx cy cz half] [strata=32] [rays-per-stratum=16] [faces=0] [repetitions=3]
//! ```
//!
//! The rays start on the faces of the cube (centre c, half size `half`, in the file's axes), cosine-weighted about the
//! face's outward normal, stratum by stratum: the order of a capture. The file holds a little-endian u64 count, then
//! origin x, y, z and direction x, y, z as six arrays of f32. Making, writing and reading rays is not timed; loading
//! them into packets, tracing, and storing t and the triangle's number is. Rates are Mrays/s as median (least to
//! most), for one and two threads.

use glam::{DVec3, Vec3};
use headbox_capture::Material;
use headbox_capture::scene::{Scene, Triangle};
use headbox_capture::trace::{HitPacket, PACKET, Ray, RayPacket, Tracer};
use std::io::Write;
use std::sync::{Arc, Mutex};
use std::time::Instant;

/// Rays of one file, `[component][ray]`: origin x, y, z, direction x, y, z.
type Rays = [Vec<f32>; 6];

/// Rays that a thread takes at a time.
const CHUNK: usize = 16_384;

/// Packets that are traced by one call.
const BATCH: usize = 64;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let args: Vec<String> = std::env::args().collect();
    let [_, scene, file, ..] = &args[..] else {
        return Err("usage: rays SCENE.obj RAYS.bin [cx cy cz half] [strata] [rays-per-stratum] [faces] [reps]".into());
    };
    let number = |i: usize, default: f64| args.get(i).map_or(Ok(default), |s| s.parse::<f64>());
    let centre = DVec3::new(number(3, 0.0)?, number(4, 0.0)?, number(5, 2.0)?);
    let (half, n, m) = (number(6, 0.5)?, number(7, 32.0)? as u32, number(8, 16.0)? as u32);
    let faces = args.get(9).map_or("0", String::as_str);
    let repetitions = number(10, 3.0)? as usize;

    let scene = read_obj(scene)?;
    let rays = cube_rays(centre, half, n, m, faces);
    write_rays(file, &rays)?;
    let start = Instant::now();
    // The file's own frame, so that every tracer sees the same numbers.
    let tracer = Tracer::new(Arc::new(scene), DVec3::ZERO);
    println!("{} triangles, {} rays; built in {:.2?}", tracer.scene().triangles.len(), rays[0].len(), start.elapsed());
    report(&tracer, &rays);
    let mut results = (vec![1.0; rays[0].len()], vec![1; rays[0].len()]);
    for (name, trace_chunk) in [
        ("packets of 16", trace_packets as TraceChunk),
        ("single rays", trace_single),
        ("packets, occlusion", trace_occlusion),
    ] {
        for threads in [1, 2] {
            let mut rates: Vec<f64> = (0..repetitions)
                .map(|_| rays[0].len() as f64 / 1e6 / timed_pass(&tracer, &rays, &mut results, threads, trace_chunk))
                .collect();
            rates.sort_by(f64::total_cmp);
            let (least, most) = (rates[0], rates[repetitions - 1]);
            println!("{name}, {threads} thread(s): {:.2} Mrays/s ({least:.2} to {most:.2})", rates[repetitions / 2]);
        }
    }
    Ok(())
}

/// Positions and faces of an OBJ, in the file's frame.
fn read_obj(path: &str) -> Result<Scene, Box<dyn std::error::Error>> {
    let options = tobj::LoadOptions { triangulate: true, ..tobj::LoadOptions::default() };
    let (models, _) = tobj::load_obj(path, &options)?;
    let mut scene = Scene { materials: vec![Material::default()], ..Scene::default() };
    for mesh in models.into_iter().map(|model| model.mesh) {
        let base = scene.positions.len() as u32;
        scene.positions.extend(mesh.positions.chunks_exact(3).map(DVec3::from_slice));
        let triangles = mesh.indices.as_chunks::<3>().0.iter();
        scene.triangles.extend(triangles.map(|t| Triangle { vertices: t.map(|i| i + base), material: 0 }));
    }
    Ok(scene)
}

/// Unit square to unit disk, keeping areas (Shirley and Chiu 1997).
fn disk(u: f64, v: f64) -> (f64, f64) {
    let (a, b) = (2.0 * u - 1.0, 2.0 * v - 1.0);
    let quarter = std::f64::consts::FRAC_PI_4;
    let (r, phi) = if a.abs() > b.abs() { (a, quarter * (b / a)) } else { (b, quarter * (2.0 - a / b)) };
    if r == 0.0 { (0.0, 0.0) } else { (r * phi.cos(), r * phi.sin()) }
}

/// `m` rays in each of the `n`^4 strata of each face.
fn cube_rays(centre: DVec3, half: f64, n: u32, m: u32, faces: &str) -> Rays {
    let mut rays: Rays = Default::default();
    let mut state = 1_u64;
    let mut unit = || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 40) as f64 / f64::from(1 << 24)
    };
    for face in faces.bytes().map(|b| usize::from(b.wrapping_sub(b'0')) % 6) {
        let (axis, sign) = (face / 2, if face % 2 == 0 { 1.0 } else { -1.0 });
        let (right, up) = ((axis + 1) % 3, (axis + 2) % 3);
        for stratum in 0..n.pow(4) {
            let cell = [stratum / n.pow(3), stratum / n.pow(2) % n, stratum / n % n, stratum % n];
            for _ in 0..m {
                let q = cell.map(|c| (f64::from(c) + unit()) / f64::from(n));
                let (x, y) = disk(q[2], q[3]);
                let (mut origin, mut direction) = (centre, DVec3::ZERO);
                origin[axis] += sign * half;
                origin[right] += half * (2.0 * q[0] - 1.0);
                origin[up] += half * (2.0 * q[1] - 1.0);
                direction[axis] = sign * (1.0 - x * x - y * y).max(1e-6).sqrt();
                (direction[right], direction[up]) = (x, y);
                for i in 0..3 {
                    rays[i].push(origin[i] as f32);
                    rays[i + 3].push(direction[i] as f32);
                }
            }
        }
    }
    rays
}

fn write_rays(path: &str, rays: &Rays) -> std::io::Result<()> {
    let mut file = std::io::BufWriter::new(std::fs::File::create(path)?);
    file.write_all(&(rays[0].len() as u64).to_le_bytes())?;
    for value in rays.iter().flatten() {
        file.write_all(&value.to_le_bytes())?;
    }
    file.flush()
}

/// What other tracers must agree on.
fn report(tracer: &Tracer, rays: &Rays) {
    let (mut hits, mut sum) = (0_u64, 0.0);
    for start in (0..rays[0].len()).step_by(PACKET) {
        let found = tracer.closest_packet(&load_packet(rays, start));
        for t in found.t.into_iter().filter(|t| t.is_finite()) {
            hits += 1;
            sum += f64::from(t);
        }
    }
    println!("hit fraction {:.5}, mean t {:.5}", hits as f64 / rays[0].len() as f64, sum / hits.max(1) as f64);
}

/// Traces the rays from `start` on, as many as the results hold.
type TraceChunk = fn(&Tracer, &Rays, usize, &mut [f32], &mut [u32]);

/// Seconds of one pass over all rays. The results' memory has been touched before.
fn timed_pass(
    tracer: &Tracer,
    rays: &Rays,
    (t, primitive): &mut (Vec<f32>, Vec<u32>),
    threads: usize,
    trace_chunk: TraceChunk,
) -> f64 {
    let chunks = t.chunks_mut(CHUNK).zip(primitive.chunks_mut(CHUNK)).enumerate();
    let chunks = Mutex::new(chunks);
    let start = Instant::now();
    std::thread::scope(|scope| {
        for _ in 0..threads {
            scope.spawn(|| {
                loop {
                    let chunk = chunks.lock().ok().and_then(|mut chunks| chunks.next());
                    let Some((index, (t, primitive))) = chunk else { break };
                    trace_chunk(tracer, rays, index * CHUNK, t, primitive);
                }
            });
        }
    });
    let seconds = start.elapsed().as_secs_f64();
    std::hint::black_box((t, primitive));
    seconds
}

fn load_packet(rays: &Rays, start: usize) -> RayPacket {
    let mut packet = RayPacket::EMPTY;
    let len = PACKET.min(rays[0].len() - start);
    for i in 0..3 {
        packet.origin[i][..len].copy_from_slice(&rays[i][start..start + len]);
        packet.direction[i][..len].copy_from_slice(&rays[i + 3][start..start + len]);
    }
    packet.active = (u32::from(u16::MAX) >> (PACKET - len)) as u16;
    packet
}

fn trace_packets(tracer: &Tracer, rays: &Rays, start: usize, t: &mut [f32], primitive: &mut [u32]) {
    let mut packets = [const { RayPacket::EMPTY }; BATCH];
    let mut hits = [const { HitPacket::MISS }; BATCH];
    for (i, (t, primitive)) in t.chunks_mut(BATCH * PACKET).zip(primitive.chunks_mut(BATCH * PACKET)).enumerate() {
        let start = start + i * BATCH * PACKET;
        let count = t.len().div_ceil(PACKET);
        for (k, packet) in packets[..count].iter_mut().enumerate() {
            *packet = load_packet(rays, start + k * PACKET);
        }
        tracer.closest_packets(&packets[..count], &mut hits[..count]);
        for (k, (t, primitive)) in t.chunks_mut(PACKET).zip(primitive.chunks_mut(PACKET)).enumerate() {
            t.copy_from_slice(&hits[k].t[..t.len()]);
            primitive.copy_from_slice(&hits[k].primitive[..primitive.len()]);
        }
    }
}

fn trace_occlusion(tracer: &Tracer, rays: &Rays, start: usize, _: &mut [f32], blocked: &mut [u32]) {
    for (i, blocked) in blocked.chunks_mut(BATCH * PACKET).enumerate() {
        let starts = (start + i * BATCH * PACKET..).step_by(PACKET).take(blocked.len().div_ceil(PACKET));
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
        let at = |component: usize| rays[component][start + i];
        let ray = Ray {
            origin: Vec3::new(at(0), at(1), at(2)),
            direction: Vec3::new(at(3), at(4), at(5)),
            t_min: 0.0,
            t_max: f32::INFINITY,
        };
        (*t, *primitive) = tracer.closest(&ray).map_or((f32::INFINITY, u32::MAX), |hit| (hit.t, hit.primitive));
    }
}
