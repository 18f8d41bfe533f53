//! A frame by one ray a pixel, shaded as the rasteriser shades: what the walk is up against.

use glam::Vec3;
use headbox_core::camera::Camera;
use headbox_core::srgb_table::encode_srgb;
use headbox_house::house::House;
use headbox_trace::bvh::{Hit, HitPacket, PACKET, Ray, RayPacket};
use rayon::prelude::*;
use std::time::Instant;

/// Pixels a side of a packet.
const SIDE: u32 = 4;

/// The time of the fastest of some frames, ms, on the current rayon thread pool.
pub(super) fn frame_ms(house: &House, camera: &Camera, repeats: u32) -> f64 {
    let frame = || {
        let started = Instant::now();
        let rows: Vec<Vec<[u8; 4]>> = (0..camera.height().div_ceil(SIDE))
            .into_par_iter()
            .map(|row| block_row(house, camera, row))
            .collect();
        std::hint::black_box(rows);
        started.elapsed().as_secs_f64() * 1e3
    };
    (0..repeats.max(1))
        .map(|_| frame())
        .fold(f64::INFINITY, f64::min)
}

/// Colours of four rows of pixels, block by block.
fn block_row(house: &House, camera: &Camera, row: u32) -> Vec<[u8; 4]> {
    let origin = (camera.eye() - house.tracer().origin()).as_vec3();
    let corner = camera.direction(0.5, 0.5);
    let [right, down] = [
        camera.direction(1.5, 0.5) - corner,
        camera.direction(0.5, 1.5) - corner,
    ];
    let packet = |block: u32| {
        let ray = |i: u32| {
            let (x, y) = (SIDE * block + i % SIDE, SIDE * row + i / SIDE);
            let direction = (corner + right * f64::from(x) + down * f64::from(y)).as_vec3();
            Ray {
                origin,
                direction,
                t_min: 0.0,
                t_max: f32::INFINITY,
            }
        };
        RayPacket::from_rays(&std::array::from_fn::<Ray, PACKET, _>(|i| ray(i as u32)))
    };
    let packets: Vec<RayPacket> = (0..camera.width().div_ceil(SIDE)).map(packet).collect();
    let mut hits = vec![HitPacket::MISS; packets.len()];
    house.tracer().closest_packets(&packets, &mut hits);
    let shade = |hit: Hit| {
        let surface = house.scene().surface(hit.primitive, hit.u, hit.v);
        let [r, g, b] = (Vec3::from(surface.albedo) + Vec3::from(surface.emission))
            .to_array()
            .map(encode_srgb);
        [r, g, b, 255]
    };
    hits.iter()
        .flat_map(|packet| (0..PACKET).map(|lane| packet.hit(lane).map_or([0; 4], shade)))
        .collect()
}
