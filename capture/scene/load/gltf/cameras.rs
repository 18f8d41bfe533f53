//! Cameras of a glTF file, and the paths along which animations move them.

use super::accessor::Buffers;
use super::raw_json::{NodeTransform, RawJson};
use super::{LoadError, folder_of, parse};
use crate::load::notes::Notes;
use ::gltf::json::Root;
use ::gltf::json::animation::{Animation, Interpolation, Property};
use ::gltf::json::validation::Checked;
use glam::{DAffine3, DQuat, DVec3, DVec4};
use headbox_core::files::InputFolder;
use std::path::Path;

/// A camera at one time: metres, Y up.
#[derive(Clone, Copy, Debug)]
pub(crate) struct GltfCamera {
    pub(crate) eye: DVec3,
    pub(crate) forward: DVec3,
    pub(crate) up: DVec3,
    /// Vertical field of view, radians.
    pub(crate) fov_y: f64,
    /// Width over height, if the file specifies it.
    pub(crate) aspect: Option<f64>,
    /// Time in seconds; 0 without an animation.
    pub(crate) time_s: f64,
}

/// Maximum number of frames of an animation.
const MAX_FRAMES: f64 = 1e6;

/// Reads the path of the first animated camera: `fps` frames a second from the first key to the
/// last. Without one, reads all perspective cameras in the order of nodes.
pub(crate) fn read(path: &Path, bytes: &[u8], fps: f64) -> Result<Vec<GltfCamera>, LoadError> {
    let malformed = |cause: String| LoadError::malformed(path, cause);
    let (root, transforms, blob) = parse(path, bytes)?;
    let mut notes = Notes::default();
    let folder = InputFolder::new(folder_of(path));
    let buffers = Buffers::read(&root, &transforms, blob, &folder, &mut notes);
    let rig = Rig::new(&root, transforms);
    let cameras: Vec<usize> = (0..root.nodes.len())
        .filter(|node| rig.lens(*node).is_some())
        .collect();
    if cameras.is_empty() {
        return Err(malformed(rig.no_perspective_message()));
    }
    for animation in &root.animations {
        let tracks = tracks(animation, &buffers)
            .ok_or_else(|| malformed("the keys of an animation cannot be read".into()))?;
        let moved = cameras.iter().find(|camera| {
            rig.ancestry(**camera)
                .any(|n| tracks.iter().any(|t| t.node == n))
        });
        let Some(camera) = moved else { continue };
        let camera_tracks = tracks
            .iter()
            .filter(|track| rig.ancestry(*camera).any(|node| node == track.node));
        let times = camera_tracks.flat_map(|track| track.times.iter().copied());
        let (first, last) = times.fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), t| {
            (a.min(t), b.max(t))
        });
        let frames = ((last - first) * fps + 1e-6).floor() + 1.0;
        if !(1.0..=MAX_FRAMES).contains(&frames) {
            return Err(malformed(format!("its animation lasts {} s", last - first)));
        }
        let at = |i: u32| rig.camera(*camera, &tracks, first + f64::from(i) / fps);
        return Ok((0..frames as u32).filter_map(at).collect());
    }
    Ok(cameras
        .into_iter()
        .filter_map(|camera| rig.camera(camera, &[], 0.0))
        .collect())
}

/// Nodes of a file with their parents.
struct Rig<'a> {
    root: &'a Root,
    transforms: RawJson,
    parents: Vec<Option<usize>>,
}

impl<'a> Rig<'a> {
    fn new(root: &'a Root, transforms: RawJson) -> Self {
        let mut parents = vec![None; root.nodes.len()];
        for (i, node) in root.nodes.iter().enumerate() {
            for child in node.children.iter().flatten() {
                if let Some(parent) = parents.get_mut(child.value()) {
                    *parent = Some(i);
                }
            }
        }
        Self {
            root,
            transforms,
            parents,
        }
    }

    /// Returns a node, its parent and so on; a cycle ends after as many as there are nodes.
    fn ancestry(&self, node: usize) -> impl Iterator<Item = usize> {
        std::iter::successors(Some(node), |node| self.parents[*node]).take(self.parents.len())
    }

    /// Returns the vertical field of view and the aspect of a node's perspective camera.
    fn lens(&self, node: usize) -> Option<(f64, Option<f64>)> {
        let camera = self
            .root
            .cameras
            .get(self.root.nodes.get(node)?.camera?.value())?;
        let lens = camera.perspective.as_ref()?;
        Some((f64::from(lens.yfov), lens.aspect_ratio.map(f64::from)))
    }

    /// Returns the message about a file without a node that has a perspective camera.
    fn no_perspective_message(&self) -> String {
        let nodes = self.root.nodes.iter();
        let at_nodes = nodes
            .filter_map(|node| self.root.cameras.get(node.camera?.value()))
            .filter(|camera| camera.orthographic.is_some())
            .count();
        let (found, remedy) = if at_nodes > 0 {
            let cameras = if at_nodes == 1 {
                "its only camera is orthographic".into()
            } else {
                format!("its {at_nodes} cameras are orthographic")
            };
            (cameras, "change the type of the camera and export it again")
        } else if self.root.cameras.is_empty() {
            ("it has no camera".into(), "export cameras with it")
        } else {
            (
                "no node of it has a perspective camera".to_owned(),
                "export cameras with it",
            )
        };
        format!("{found}, but a path needs a perspective camera; {remedy}")
    }

    fn camera(&self, node: usize, tracks: &[Track], time_s: f64) -> Option<GltfCamera> {
        let (fov_y, aspect) = self.lens(node)?;
        let world_from_node = self.ancestry(node).fold(DAffine3::IDENTITY, |from, node| {
            let mut transform = self.transforms.node_transform(node);
            tracks
                .iter()
                .filter(|track| track.node == node)
                .for_each(|track| track.apply(time_s, &mut transform));
            transform.parent_from_node() * from
        });
        let [up, back] = [
            world_from_node.matrix3.y_axis,
            world_from_node.matrix3.z_axis,
        ]
        .map(|axis| axis.normalize_or_zero());
        Some(GltfCamera {
            eye: world_from_node.translation,
            forward: -back,
            up,
            fov_y,
            aspect,
            time_s,
        })
    }
}

/// An animated property of a node.
struct Track {
    node: usize,
    property: Property,
    interpolation: Interpolation,
    times: Vec<f64>,
    /// A value per time; for cubic splines an in-tangent, a value and an out-tangent.
    values: Vec<DVec4>,
}

/// Reads the tracks of an animation that transform nodes; `None` if one cannot be read.
fn tracks(animation: &Animation, buffers: &Buffers) -> Option<Vec<Track>> {
    let mut tracks = Vec::new();
    for channel in &animation.channels {
        // Other paths, such as "pointer" of KHR_animation_pointer, do not transform nodes.
        let Checked::Valid(property) = channel.target.path else {
            continue;
        };
        let sampler = animation.samplers.get(channel.sampler.value())?;
        let Checked::Valid(interpolation) = sampler.interpolation else {
            return None;
        };
        let values = match property {
            Property::Translation | Property::Scale => buffers
                .vectors::<3>(sampler.output)?
                .into_iter()
                .map(|v| DVec3::from(v).extend(0.0))
                .collect(),
            Property::Rotation => buffers
                .vectors::<4>(sampler.output)?
                .into_iter()
                .map(DVec4::from)
                .collect::<Vec<_>>(),
            Property::MorphTargetWeights => continue,
        };
        let times: Vec<f64> = buffers
            .vectors::<1>(sampler.input)?
            .into_iter()
            .map(|[time]| time)
            .collect();
        let values_per_time = if interpolation == Interpolation::CubicSpline {
            3
        } else {
            1
        };
        let rising = times.windows(2).all(|pair| pair[0] < pair[1])
            && times.iter().all(|time| time.is_finite());
        if times.is_empty() || !rising || values.len() != times.len() * values_per_time {
            return None;
        }
        tracks.push(Track {
            node: channel.target.node.value(),
            property,
            interpolation,
            times,
            values,
        });
    }
    Some(tracks)
}

impl Track {
    fn apply(&self, time_s: f64, to: &mut NodeTransform) {
        let value = self.value(time_s);
        let vector = value.truncate().to_array();
        match self.property {
            Property::Translation => to.translation = Some(vector),
            Property::Scale => to.scale = Some(vector),
            Property::Rotation => to.rotation = Some(value.to_array()),
            Property::MorphTargetWeights => {}
        }
    }

    /// Interpolates the value at a time; constant before the first and after the last key (glTF
    /// 2.0, appendix C).
    fn value(&self, time_s: f64) -> DVec4 {
        let next = self.times.partition_point(|time| *time <= time_s);
        let spline = self.interpolation == Interpolation::CubicSpline;
        let key = |i: usize| self.values[if spline { 3 * i + 1 } else { i }];
        if next == 0 || next == self.times.len() || self.interpolation == Interpolation::Step {
            return key(next.saturating_sub(1));
        }
        let (before, step) = (next - 1, self.times[next] - self.times[next - 1]);
        let t = (time_s - self.times[before]) / step;
        if spline {
            let (out, into) = (
                self.values[3 * before + 2] * step,
                self.values[3 * next] * step,
            );
            let (t2, t3) = (t * t, t * t * t);
            return key(before) * (2.0 * t3 - 3.0 * t2 + 1.0)
                + out * (t3 - 2.0 * t2 + t)
                + key(next) * (3.0 * t2 - 2.0 * t3)
                + into * (t3 - t2);
        }
        if self.property == Property::Rotation {
            let [a, b] =
                [key(before), key(next)].map(|v| DQuat::from_vec4(v.normalize_or(DVec4::W)));
            return DVec4::from(a.slerp(b, t));
        }
        key(before).lerp(key(next), t)
    }
}
