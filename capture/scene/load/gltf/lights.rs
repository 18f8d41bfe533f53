//! KHR_lights_punctual: lamps at nodes. They shine along the node's -Z. Candela and lux are used as
//! radiant intensity and irradiance, just as emission is used as radiance.

use super::super::builder::Builder;
use super::super::notes::Note;
use crate::scene::{Lamp, Reach};
use ::gltf::json::extensions::scene::khr_lights_punctual::{Light, Type};
use ::gltf::json::validation::Checked;
use ::gltf::json::{Node, Root};
use glam::{DAffine3, DVec3, Vec3};

/// Returns true if a node has a lamp.
pub(super) fn has_lamp(node: &Node) -> bool {
    node.extensions
        .as_ref()
        .is_some_and(|extensions| extensions.khr_lights_punctual.is_some())
}

/// Adds the lamp of a node, if it has one.
pub(super) fn push(root: &Root, node: &Node, world_from_node: DAffine3, builder: &mut Builder) {
    let at_node = node
        .extensions
        .as_ref()
        .and_then(|extensions| extensions.khr_lights_punctual.as_ref());
    let Some(index) = at_node.map(|light| light.light.value()) else {
        return;
    };
    let all = root
        .extensions
        .as_ref()
        .and_then(|extensions| extensions.khr_lights_punctual.as_ref());
    let lamp = all
        .and_then(|all| all.lights.get(index))
        .and_then(|light| lamp(light, world_from_node, builder));
    let is_sane = lamp.is_some_and(|lamp| builder.lights.push(lamp));
    builder
        .notes
        .add(Note::LightUnreadable, usize::from(!is_sane));
}

/// Converts a light; `None` if its type is unknown.
fn lamp(light: &Light, world_from_node: DAffine3, builder: &Builder) -> Option<Lamp> {
    let frame = builder.frame;
    let position = frame.world_from_file(world_from_node.translation);
    let ahead = frame.world_direction_from_file(world_from_node.matrix3 * DVec3::NEG_Z);
    let axis: Vec3 = ahead.normalize_or_zero().as_vec3();
    let range_m = light
        .range
        .map_or(f32::INFINITY, |range| range * frame.unit_m as f32);
    let Checked::Valid(kind) = light.type_ else {
        return None;
    };
    let reach = match kind {
        Type::Directional => Reach::Distant { direction: -axis },
        Type::Point => Reach::Point { position, range_m },
        Type::Spot => {
            let [inner, outer] = light
                .spot
                .as_ref()
                .map_or([0.0, std::f32::consts::FRAC_PI_4], |spot| {
                    [spot.inner_cone_angle, spot.outer_cone_angle]
                });
            Reach::Spot {
                position,
                range_m,
                axis,
                cosines: [inner.cos(), outer.cos()],
            }
        }
    };
    Some(Lamp {
        intensity: light.color.map(|c| c * light.intensity),
        reach,
    })
}
