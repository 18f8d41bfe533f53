//! Portal-window LDI: rays through the whole opening in all directions, stored about any centre.
//!
//! Every ray from one cell to the next crosses the portal, so that no other rays are needed. The
//! ray domain is the opening's bounding rectangle, divided into 4-D strata (S15); rays that start
//! outside the polygon are not traced.

use super::BackdropQuality;
use super::gather::CubeJob;
use crate::house::House;
use crate::portal_opening::Opening;
use glam::{DVec3, Vec3};
use headbox_cube::model::parameters::MergeRule;
use headbox_cube::pack::{CubeLdi, PackError};
use headbox_trace::bvh::{PACKET, RayPacket};
use headbox_trace::sampler::{DirectionCell, RayDomain, Sampling, Strata};

/// Captures the LDI of an opening about a centre (world metres).
pub(super) fn ldi(
    house: &House,
    opening: &Opening,
    centre: DVec3,
    face_px: u32,
    quality: &BackdropQuality,
) -> Result<CubeLdi, PackError> {
    let origin = house.tracer().origin();
    let domain = RayDomain {
        centre: (opening.centre - origin).as_vec3(),
        half_u: (opening.right * opening.half.x).as_vec3(),
        half_v: (opening.up * opening.half.y).as_vec3(),
        normal: -opening.normal.as_vec3(),
    };
    let strata = Strata {
        per_dimension: quality.strata,
        rays: quality.rays,
        seed: quality.seed,
        sampling: Sampling::Stratified,
    };
    let job = CubeJob {
        house,
        centre,
        face_px,
        rule: MergeRule::Average,
        repairs: true,
    };
    job.run(strata.direction_cells(), |cell, batch| {
        (batch.image, batch.eye) = (0, None);
        let directions = DirectionCell {
            domain,
            domain_number: 0,
            strata,
            cell,
        };
        let rays: Vec<(u32, u32)> = (0..strata.position_cells())
            .flat_map(|p| (0..strata.rays).map(move |ray| (p, ray)))
            .collect();
        let mut packet = RayPacket::EMPTY;
        for rays in rays.chunks(PACKET) {
            directions.fill_packet(rays, &mut packet);
            for lane in 0..rays.len() {
                let start = Vec3::from_array(packet.origin.map(|axis| axis[lane]));
                let direction = Vec3::from_array(packet.direction.map(|axis| axis[lane]));
                if opening.contains(start.as_dvec3() + origin) {
                    batch.rays.push((start, direction));
                }
            }
        }
    })
}
