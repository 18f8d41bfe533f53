//! Scenes of boxes, and captures of them with few rays.

#![expect(
    clippy::unwrap_used,
    reason = "in a test a panic is the failure report"
)]

use glam::{DVec3, dvec3};
use headbox_core::bounces::Bounces;
use headbox_core::cube_face::Face;
use headbox_cube::model::parameters::CaptureParameters;
use headbox_cube::model::samples::CubeSamples;
use headbox_cube::pack::{CubeLdi, SplatIndexLayout, Split};
use headbox_ldi::accumulate::shard::{self, ShardInfo};
use headbox_ldi::capture::SceneCapture;
use headbox_ldi::rays::trace_and_accumulate::TracedRays;
use headbox_ldi::scene_source::SceneSource;
use headbox_ldi::spec::{CaptureSpec, RunOptions};
use headbox_scene::material::Material;
use headbox_scene::scene::{Scene, Triangle};
use headbox_trace::bvh::Tracer;
use headbox_trace::light::Lighting;
use std::path::PathBuf;
use std::sync::Arc;

/// A scene made of boxes.
#[derive(Default)]
pub(super) struct Boxes(pub(super) Scene);

impl Boxes {
    pub(super) fn material(&mut self, albedo: [f32; 3], emission: [f32; 3]) -> u32 {
        self.0.materials.push(Material {
            albedo,
            emission,
            ..Material::default()
        });
        self.0.materials.len() as u32 - 1
    }

    pub(super) fn add(mut self, centre: DVec3, half: DVec3, material: u32) -> Self {
        let scene = &mut self.0;
        for face in Face::ALL {
            let first = scene.positions.len() as u32;
            for (s, t) in [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)] {
                let corner = face.normal() + face.right() * s + face.up() * t;
                scene.positions.push(centre + corner * half);
            }
            for [a, b] in [[1, 2], [2, 3]] {
                scene.triangles.push(Triangle {
                    vertices: [first, first + a, first + b],
                    material,
                });
            }
        }
        self
    }
}

/// A room of 4 x 3 x 4 m with two boxes in it, lit by a bright box.
pub(super) fn room() -> Arc<Scene> {
    let mut boxes = Boxes::default();
    let wall = boxes.material([0.7, 0.6, 0.5], [0.0; 3]);
    let red = boxes.material([0.8, 0.2, 0.2], [0.0; 3]);
    let lamp = boxes.material([0.5; 3], [6.0; 3]);
    let boxes = boxes.add(DVec3::ZERO, dvec3(2.0, 1.5, 2.0), wall);
    let boxes = boxes.add(dvec3(0.9, -1.0, -1.2), dvec3(0.3, 0.5, 0.3), red);
    let boxes = boxes.add(dvec3(-1.0, -1.1, 0.9), dvec3(0.4, 0.4, 0.2), red);
    Arc::new(
        boxes
            .add(dvec3(0.0, 1.45, 0.0), dvec3(0.3, 0.04, 0.3), lamp)
            .0,
    )
}

pub(super) fn spec() -> CaptureSpec {
    CaptureSpec {
        face_size_px: 48,
        parameters: CaptureParameters {
            seed: 7,
            novelty: 0.3,
            bounces: Bounces::Exactly(1),
            light_samples: 2,
            ..CaptureParameters::unlit(8, 8)
        },
        ..CaptureSpec::new(SceneSource::new("test"), DVec3::ZERO, 0.3)
    }
}

/// The spec with changed parameters.
pub(super) fn spec_with(change: impl FnOnce(&mut CaptureParameters)) -> CaptureSpec {
    let mut spec = spec();
    change(&mut spec.parameters);
    spec
}

pub(super) fn capture(spec: &CaptureSpec, scene: &Arc<Scene>) -> CubeSamples {
    capture_within(spec, scene, None)
}

pub(super) fn capture_within(
    spec: &CaptureSpec,
    scene: &Arc<Scene>,
    budget: Option<(u64, PathBuf)>,
) -> CubeSamples {
    let tracer = Tracer::new(Arc::clone(scene), spec.centre);
    let lighting = Lighting::measure(&tracer, spec.parameters.bounces);
    let options = RunOptions {
        budget,
        ..RunOptions::default()
    };
    let capture = SceneCapture::new(spec, &tracer, &lighting, &options);
    capture.run().unwrap().0
}

pub(super) fn file_bytes(ldi: &CubeSamples) -> Vec<u8> {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a.ldi");
    CubeLdi::pack(ldi, SplatIndexLayout::Normal, Split::Auto)
        .unwrap()
        .write(&path)
        .unwrap();
    std::fs::read(path).unwrap()
}

pub(super) fn merged_from_shards(
    spec: &CaptureSpec,
    scene: &Arc<Scene>,
    budget: Option<(u64, PathBuf)>,
) -> CubeSamples {
    let dir = tempfile::tempdir().unwrap();
    let tracer = Tracer::new(Arc::clone(scene), spec.centre);
    let lighting = Lighting::measure(&tracer, spec.parameters.bounces);
    let mut infos = Vec::new();
    for part in [2, 0, 3, 1] {
        let options = RunOptions {
            shard: (part, 4),
            ..RunOptions::default()
        };
        let capture = SceneCapture::new(spec, &tracer, &lighting, &options);
        let tracing = capture.trace().unwrap();
        let info = ShardInfo::new(&capture, &tracing);
        let path = dir.path().join(format!("{part}.shard"));
        shard::write(&path, &info, &tracing).unwrap();
        infos.push((path, info));
    }
    shard::check_complete(&infos).unwrap();
    let missing = shard::check_complete(&infos[1..]).unwrap_err().to_string();
    assert!(missing.contains("missing: 2/4"), "{missing}");
    let twice = shard::check_complete(&[infos.as_slice(), &infos[..1]].concat())
        .unwrap_err()
        .to_string();
    assert!(twice.contains("given twice: 2/4"), "{twice}");
    let options = RunOptions {
        budget,
        ..RunOptions::default()
    };
    let mut merged = TracedRays::empty(spec, &options).unwrap();
    for (path, info) in &infos {
        assert_eq!(shard::read_info(path).unwrap(), *info);
        shard::absorb(path, info, &mut merged).unwrap();
    }
    let capture = SceneCapture::new(spec, &tracer, &lighting, &options);
    capture.fill_holes(&mut merged).unwrap();
    capture.light_and_merge(&merged).unwrap()
}
