//! One frame of 1024x768 at 60 degrees, on one thread: milliseconds for each splat kernel.
//!
//! * `cube`: about 1.1 M depth pixels on six faces; a fifth of them is in view.
//! * `face`: about 1.1 M depth pixels on one face, nearly all in view, as in the paper's tree.

#[path = "../tests/common/mod.rs"]
mod common;

use common::bed::{Scene, room};
use common::capture::one_layer;
use criterion::{Criterion, criterion_group, criterion_main};
use glam::{DVec3, dvec3};
use headbox::capture::Camera;
use headbox::capture::rig::Face;
use headbox::ldi::{CubeLdi, DepthPixel, EncodedNormal};
use headbox::packed::{PackedCube, SplatIndexLayout, Split};
use headbox::splat::SplatKernel;
use headbox::warp::{RenderSettings, Renderer};

/// The first surface that each pixel's ray meets.
fn pierced(scene: &Scene, face_px: u32, faces: &[Face]) -> CubeLdi {
    one_layer(DVec3::ZERO, face_px, faces, |face, x, y| {
        let hit = scene.hit(DVec3::ZERO, face.direction(x, y, face_px))?;
        let [r, g, b] = hit.color.map(|c| (c * 255.0) as u8);
        let normal = EncodedNormal::new(hit.normal.as_vec3());
        Some(DepthPixel { inverse_depth: (1.0 / hit.t) as f32, normal, color_srgb: [r, g, b, 255] })
    })
}

fn frames(criterion: &mut Criterion) {
    let scene = room(24.0);
    for (name, ldi) in [("cube", pierced(&scene, 428, &Face::ALL)), ("face", pierced(&scene, 1049, &[Face::NegZ]))] {
        let eye = dvec3(0.21, -0.13, 0.17);
        let fov = if name == "cube" { 60.0 } else { 80.0 };
        let camera = Camera::look_at(eye, dvec3(0.1, 0.0, -3.0), DVec3::Y, fov, 1024, 768).expect("valid");
        for layout in [SplatIndexLayout::Paper, SplatIndexLayout::Normal] {
            let cube = PackedCube::pack(&ldi, layout, Split::Auto).expect("packs");
            for kernel in [SplatKernel::Paper, SplatKernel::Opaque, SplatKernel::Tent] {
                let settings = RenderSettings { kernel, ..RenderSettings::default() };
                let mut renderer = Renderer::new();
                let stats = |_| *renderer.render(&cube, &camera, &settings).1;
                let best = (0..30).map(stats).min_by(|a, b| a.warp_ms.total_cmp(&b.warp_ms));
                println!("{name} {layout:?} {kernel:?}: {best:?}");
                criterion.bench_function(&format!("warp_frame/{name}/{layout:?}/{kernel:?}"), |b| {
                    b.iter(|| renderer.render(&cube, &camera, &settings).1.hole_pixels);
                });
            }
        }
    }
}

criterion_group! {
    name = warp_frame;
    config = Criterion::default().sample_size(10).measurement_time(std::time::Duration::from_secs(1));
    targets = frames
}
criterion_main!(warp_frame);
