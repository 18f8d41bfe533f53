//! Ray-traced frames with one ray per pixel, shaded as the rasteriser shades: the baseline of
//! walks.

use crate::turns::{least, time_ms};
use headbox_core::camera::Camera;
use headbox_core::color::srgb_table::SrgbTable;
use headbox_house::house::House;
use headbox_trace::bvh::{Hit, HitPacket, PACKET, Ray, RayPacket};
use rayon::prelude::*;

/// Edge of the block of pixels of a ray packet.
const SIDE: u32 = 4;

/// Returns the time of the fastest of some frames, ms, on the current rayon thread pool.
pub(super) fn frame_ms(house: &House, camera: &Camera, repeats: u32) -> f64 {
    let frame = || -> Vec<Vec<[u8; 4]>> {
        (0..camera.height().div_ceil(SIDE))
            .into_par_iter()
            .map(|row| block_row(house, camera, row))
            .collect()
    };
    let times: Vec<f64> = (0..repeats.max(1)).map(|_| time_ms(frame)).collect();
    least(&times).unwrap_or(f64::INFINITY)
}

/// Renders one row of blocks of 4x4 pixels; returns sRGB colours, block by block.
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
    let table = SrgbTable::get(house.lighting().tone);
    let shade = |hit: Hit| {
        let radiance = house.lighting().unlit_radiance(house.tracer(), &hit);
        let [r, g, b] = radiance.to_array().map(|c| table.encode(c));
        [r, g, b, 255]
    };
    hits.iter()
        .flat_map(|packet| (0..PACKET).map(|lane| packet.hit(lane).map_or([0; 4], shade)))
        .collect()
}
