//! Reading a mutated file gives a valid result or an error: no panic, and no huge allocation from a
//! corrupt count.
//!
//! Mutations are seeded: a failure names the seed. `.ci/fuzz` tries each kind of file for longer,
//! with new seeds. Files that fail in such a run go to `tests/corpus/`, which is replayed here.
//! Portal models and houses: `houses.rs`; PLY, STL and compressed glTF: `scenes.rs`; `pictures.rs`;
//! `image_sets.rs`.

use crate::mutations::{Alone, MutationRng, Rounds, corpus, corpus_folder, written_bytes};
use glam::DVec3;
use headbox_core::camera::Camera;
use headbox_core::file_frame::FileFrame;
use headbox_core::progress::Silent;
use headbox_cube::model::parameters::CaptureParameters;
use headbox_cube::pack::{
    BlockIndex, CubeLdi, PackedSegment, Plane, PlaneSet, PlaneTile, SplatIndexLayout, Split,
};
use headbox_cube::render::footprint::splat::SplatKernel;
use headbox_cube::render::{RenderSettings, Renderer};
use headbox_images::depth::DepthPicture;
use headbox_lab::report::figures::figures;
use headbox_lab::report::row::Report;
use headbox_lab::report::{results, summary};
use headbox_ldi::accumulate::shard;
use headbox_ldi::accumulate::shard::ShardInfo;
use headbox_ldi::capture::SceneCapture;
use headbox_ldi::scene_source::SceneSource;
use headbox_ldi::spec::{CaptureSpec, RunOptions};
use headbox_lumigraph::{CameraGrid, GridParts, LumigraphCapture, Placement, Slabs, SlabsRenderer};
use headbox_model::load::load_scene as load;
use headbox_scene::camera_path as path;
use headbox_scene::load::LoadOptions;
use headbox_sprite::{
    DisplacementFormat, SlabCapture, SpriteLayer, SpriteRenderer, SpriteSet, capture_slabs,
    write_depth_exr,
};
use headbox_trace::bvh::Tracer;
use headbox_trace::light::Lighting;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::Path;
use std::sync::Arc;

/// Number of broken cubes if no time is requested.
const CASES: u64 = 133;

fn spec() -> CaptureSpec {
    let scene = headbox_scenes::build("bump", 0).expect("built in");
    let headbox = scene.headbox.expect("it has one");
    CaptureSpec {
        face_size_px: 7,
        parameters: CaptureParameters {
            novelty: 0.25,
            light_samples: 1,
            ..CaptureParameters::unlit(3, 3)
        },
        ..CaptureSpec::new(
            SceneSource::new("builtin:bump"),
            headbox.centre,
            headbox.half_size_m,
        )
    }
}

fn tracer() -> Tracer {
    Tracer::new(
        Arc::new(headbox_scenes::build("bump", 0).expect("built in")),
        spec().centre,
    )
}

fn cube() -> CubeLdi {
    let tracer = tracer();
    let lighting = Lighting::unmetered(&tracer, 0);
    let (ldi, _) = SceneCapture::new(&spec(), &tracer, &lighting, &RunOptions::default())
        .run()
        .expect("captured");
    CubeLdi::pack(&ldi, SplatIndexLayout::Normal, Split::Auto).expect("packs")
}

/// Same as [`cube`], with two plane textures, which its few samples would not give: an opaque one,
/// and one with a rim.
fn cube_with_planes() -> CubeLdi {
    let whole = PlaneTile {
        plane: 0,
        first_texel: 0,
        x0: -1,
        y0: 2,
        width: 4,
        height: 3,
        face: 5,
        opaque: 1,
    };
    let rim = PlaneTile {
        first_texel: 12,
        x0: 2,
        y0: 0,
        width: 2,
        height: 8,
        opaque: 0,
        ..whole
    };
    let texel =
        |i: u8| PlaneSet::covered([9 * i, 200, 7, if i < 12 { 255 } else { 13 * (i - 12) }]);
    let planes = PlaneSet {
        error_px: 0.5,
        planes: vec![Plane {
            normal_per_distance: glam::Vec3::new(0.1, 0.05, -0.4),
        }],
        tiles: vec![whole, rim],
        texels: (0..28).map(texel).collect(),
        samples: 20,
        ..PlaneSet::default()
    };
    let cube = CubeLdi { planes, ..cube() };
    assert_eq!(cube.validate(), Ok(()));
    cube
}

fn camera(eye: DVec3, forward: DVec3) -> Camera {
    // Not `eye + forward`, which rounds to `eye` if a mutation has moved it far away.
    Camera::look_at(DVec3::ZERO, forward, DVec3::Y, 70.0, [13, 9])
        .expect("valid")
        .with_eye(eye)
}

/// Draws a cube from two eyes by all kernels; must terminate for any content.
fn draw(cube: &CubeLdi) {
    let mut renderer = Renderer::new();
    for (offset, forward) in [
        (DVec3::ZERO, DVec3::NEG_Z),
        (DVec3::new(0.4, -0.3, 0.6), DVec3::new(-1.0, 0.5, 0.3)),
    ] {
        let eye = cube.info.centre + offset * cube.info.half_size_m;
        if !eye.is_finite() {
            continue;
        }
        for kernel in [SplatKernel::Tent, SplatKernel::Opaque, SplatKernel::Paper] {
            let settings = RenderSettings {
                kernel,
                ..RenderSettings::default()
            };
            renderer.render(cube, &camera(eye, forward), &settings);
        }
    }
}

fn read_ldi(path: &Path) -> bool {
    let Ok(cube) = CubeLdi::read(path) else {
        return false;
    };
    assert_eq!(cube.validate(), Ok(()), "what is read is sound");
    for segment in &cube.segments {
        for (x, y) in (0..segment.height).flat_map(|y| (0..segment.width).map(move |x| (x, y))) {
            let layout = cube.layout;
            assert!(
                segment
                    .pixel(x, y)
                    .iter()
                    .all(|pixel| segment.decode(layout, *pixel).inverse_depth > 0.0)
            );
        }
    }
    draw(&cube);
    true
}

fn read_shard(path: &Path) -> bool {
    shard::read_info(path).is_ok_and(|info| shard::check(path, &info).is_ok())
}

fn read_sprite(path: &Path) -> bool {
    let Ok(set) = SpriteSet::read(path) else {
        return false;
    };
    let (mut renderer, mut frame) = (SpriteRenderer::new(), SpriteLayer::default());
    for eye in [DVec3::ZERO, DVec3::new(0.3, 0.1, 3.2)] {
        set.render(
            &mut renderer,
            &camera(eye, DVec3::NEG_Z),
            &Default::default(),
            &mut frame,
        );
    }
    true
}

fn read_lumigraph(path: &Path) -> bool {
    let Ok(slabs) = Slabs::read(path) else {
        return false;
    };
    let mut renderer = SlabsRenderer::new();
    for eye in [DVec3::ZERO, DVec3::new(0.3, 0.1, 3.2)] {
        renderer.render(&slabs, &camera(eye, DVec3::NEG_Z), &Default::default());
    }
    true
}

fn read_path(path: &Path) -> bool {
    path::read(path, &FileFrame::default(), DVec3::Y, 30.0).is_ok()
}

fn read_scene(path: &Path) -> bool {
    load(path, &LoadOptions::default()).is_ok_and(|scene| {
        assert_eq!(scene.validate(), Ok(()), "what is loaded is sound");
        true
    })
}

fn shard_bytes() -> Vec<u8> {
    let spec = spec();
    let tracer = tracer();
    let lighting = Lighting::unmetered(&tracer, 0);
    let options = RunOptions {
        shard: (0, 2),
        ..RunOptions::default()
    };
    let capture = SceneCapture::new(&spec, &tracer, &lighting, &options);
    let tracing = capture.trace().expect("traced");
    let info = ShardInfo::new(&capture, &tracing);
    written_bytes(|path| shard::write(path, &info, &tracing).expect("written"))
}

fn sprite_bytes(format: DisplacementFormat) -> Vec<u8> {
    let tracer = tracer();
    let lighting = Lighting::unmetered(&tracer, 0);
    let capture = SlabCapture {
        tracer: &tracer,
        lighting: &lighting,
        lit: false,
        samples: 1,
        format,
    };
    let sprites = capture_slabs(
        &capture,
        &camera(spec().centre, DVec3::NEG_Z),
        &[[0.1, 100.0]],
        &Silent,
    );
    written_bytes(|path| {
        SpriteSet::new(sprites.expect("captured"))
            .write(path)
            .expect("written");
    })
}

#[test]
fn cube_ldi_files() {
    let alone = Alone::lock();
    let originals = [cube(), cube_with_planes()]
        .map(|cube| written_bytes(|path| cube.write(path).expect("written")));
    alone.try_mutations("a.ldi", &originals, true, read_ldi);
}

#[test]
fn shard_files() {
    let alone = Alone::lock();
    alone.try_mutations("a.shard", &[shard_bytes()], true, read_shard);
}

#[test]
fn sprite_files() {
    let alone = Alone::lock();
    let originals = [DisplacementFormat::I8, DisplacementFormat::F32].map(sprite_bytes);
    alone.try_mutations("a.sprite", &originals, true, read_sprite);
}

fn lumigraph_bytes(slabs: usize, layers: usize) -> Vec<u8> {
    let tracer = tracer();
    let lighting = Lighting::unmetered(&tracer, 0);
    let parts = GridParts {
        origin: spec().centre,
        world_from_eye: glam::DMat3::IDENTITY,
        columns: vec![-0.2, 0.0, 0.1],
        rows: vec![0.0, 0.3],
        focal_px: 9.0,
        size_px: [11, 7],
        convergence: 0.3,
    };
    let grid = CameraGrid::new(parts).expect("a grid");
    let capture = LumigraphCapture {
        tracer: &tracer,
        lighting: &lighting,
        lit: false,
        samples: 1,
    };
    let raw = capture.run(&grid, &Silent).expect("captured");
    let lumigraph = raw.layered(layers, Placement::Histogram).expect("layered");
    let slabs = Slabs::new(vec![lumigraph; slabs]).expect("slabs");
    written_bytes(|path| slabs.write(path).expect("written"))
}

#[test]
fn lumigraph_files() {
    let alone = Alone::lock();
    alone.try_mutations(
        "a.lumi",
        &[(1, 5), (1, 60_000), (3, 5)].map(|(slabs, layers)| lumigraph_bytes(slabs, layers)),
        true,
        read_lumigraph,
    );
}

#[test]
fn camera_paths() {
    let alone = Alone::lock();
    alone.try_mutations(
        "a.json",
        &["list.json", "camera.json", "path.json"].map(corpus),
        false,
        read_path,
    );
}

#[test]
fn obj_files() {
    let alone = Alone::lock();
    alone.try_mutations("a.obj", &["a.obj", "b.obj"].map(corpus), false, read_scene);
}

#[test]
fn mtl_files() {
    let alone = Alone::lock();
    let obj = corpus("a.obj");
    alone.try_mutations("a.mtl", &[corpus("a.mtl")], false, |path| {
        std::fs::write(path.with_extension("obj"), &obj).expect("written");
        read_scene(&path.with_extension("obj"))
    });
}

#[test]
fn gltf_files() {
    let alone = Alone::lock();
    alone.try_mutations(
        "a.gltf",
        &["a.gltf", "nodes.gltf"].map(corpus),
        false,
        read_scene,
    );
}

#[test]
fn glb_files() {
    let alone = Alone::lock();
    alone.try_mutations("a.glb", &[corpus("a.glb")], false, read_scene);
}

pub(crate) fn read_depth(path: &Path) -> bool {
    DepthPicture::read(path, 0.001, 1.0).is_ok_and(|depth| {
        assert_eq!(
            depth.values.len(),
            depth.width as usize * depth.height as usize
        );
        true
    })
}

#[test]
fn depth_pictures() {
    let alone = Alone::lock();
    let depth = DepthPicture {
        width: 9,
        height: 7,
        values: (0..63).map(|i| 1.0 + i as f32).collect(),
    };
    let exr = written_bytes(|path| write_depth_exr(&depth, path).expect("written"));
    alone.try_mutations("a.exr", &[exr], false, read_depth);
    let grey = image::ImageBuffer::<image::Luma<u16>, _>::from_fn(9, 7, |x, y| {
        image::Luma([(x * 300 + y) as u16])
    });
    let png = written_bytes(|path| {
        grey.save_with_format(path, image::ImageFormat::Png)
            .expect("written");
    });
    alone.try_mutations("a.png", &[png], false, read_depth);
}

#[test]
fn textures() {
    let alone = Alone::lock();
    let picture = image::RgbaImage::from_fn(6, 5, |x, y| {
        image::Rgba([x as u8 * 40, y as u8 * 40, 9, 255 - x as u8 * 50])
    });
    let originals = [
        image::ImageFormat::Png,
        image::ImageFormat::Bmp,
        image::ImageFormat::Tga,
        image::ImageFormat::Tiff,
    ];
    let originals = originals.map(|format| {
        written_bytes(|path| picture.save_with_format(path, format).expect("written"))
    });
    for (name, original) in ["a.png", "a.bmp", "a.tga", "a.tiff"]
        .into_iter()
        .zip(originals)
    {
        let obj = "mtllib t.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nusemtl m\nf 1/1 2/1 3/1\n";
        let mtl = format!("newmtl m\nmap_Kd {name}\n");
        alone.try_mutations(name, &[original], false, |path| {
            std::fs::write(path.with_file_name("t.mtl"), &mtl).expect("written");
            std::fs::write(path.with_file_name("t.obj"), obj).expect("written");
            // A scene is valid without its texture.
            read_scene(&path.with_file_name("t.obj"))
        });
    }
}

/// Reads a report and generates all its outputs.
fn read_report(path: &Path) -> bool {
    let Ok(report) = serde_json::from_slice::<Report>(&std::fs::read(path).expect("written"))
    else {
        return false;
    };
    results::page(&report, None);
    summary::summary(&report);
    figures(&report)
        .iter()
        .for_each(|figure| drop(figure.chart.to_svg()));
    true
}

#[test]
fn reports() {
    let alone = Alone::lock();
    alone.try_mutations("a.report", &[corpus("a.report")], false, read_report);
}

/// Sometimes damages a plane texture or a plane.
fn break_plane_texture(set: &mut PlaneSet, rng: &mut MutationRng) {
    let (tile, plane) = (rng.below(set.tiles.len()), rng.below(set.planes.len()));
    let bits = rng.bits() as u32;
    match rng.below(16) {
        0 => set.tiles[tile].first_texel = bits,
        1 => set.tiles[tile].width = bits as u16,
        2 => set.tiles[tile].height = bits as u16,
        3 => set.tiles[tile].x0 = bits as i16,
        4 => set.tiles[tile].plane = bits,
        5 => set.tiles[tile].face = bits as u16,
        6 => set.tiles[tile].opaque = bits as u16,
        7 => set.planes[plane].normal_per_distance.x = f32::from_bits(bits),
        8 => set.texels.truncate(bits as usize % 1000),
        9 => set.planes.truncate(plane),
        _ => {}
    }
}

#[test]
fn mutated_packed_cubes_never_panic() {
    let _alone = Alone::lock();
    let original = cube_with_planes();
    let mut invalid = 0;
    let mut rounds = Rounds::new(CASES);
    while let Some(seed) = rounds.next() {
        let mut rng = MutationRng::new(seed.wrapping_mul(0x9e37_79b9));
        let mut broken = original.clone();
        let count = broken.segments.len();
        break_plane_texture(&mut broken.planes, &mut rng);
        for _ in 0..1 + rng.below(3) {
            break_invariant(&mut broken.segments[rng.below(count)], &mut rng);
        }
        if rng.below(10) == 0 {
            broken.face_size_px = rng.bits() as u32;
        }
        invalid += u64::from(broken.validate().is_err());
        for segment in &broken.segments {
            for y in 0..segment.height.min(40) {
                segment.row(y);
                (0..segment.width.min(40)).for_each(|x| drop(segment.pixel(x, y).to_vec()));
            }
        }
        let drawn = catch_unwind(AssertUnwindSafe(|| draw(&broken)));
        assert!(drawn.is_ok(), "seed {seed}: {:?}", broken.validate());
    }
    println!(
        "packed cubes: {} broken promises, of which {invalid} were found out",
        rounds.done()
    );
    assert!(invalid * 2 > rounds.done(), "most are broken: {invalid}");
}

fn break_invariant(segment: &mut PackedSegment, rng: &mut MutationRng) {
    let wild = |rng: &mut MutationRng| [0, 1, 6, 7, 8, 64, 1 << 20, u32::MAX][rng.below(8)];
    let change = |list: &mut Vec<u32>, rng: &mut MutationRng| {
        let at = rng.below(list.len());
        match rng.below(3) {
            0 => list.truncate(at),
            1 => list.push(wild(rng)),
            _ => list
                .iter_mut()
                .skip(at)
                .take(1)
                .for_each(|v| *v = wild(rng)),
        }
    };
    match rng.below(9) {
        0 => segment.x0 = wild(rng),
        1 => segment.y0 = wild(rng),
        2 => segment.width = wild(rng).min(1 << 12),
        3 => segment.height = wild(rng).min(1 << 12),
        4 => segment.inverse_depth_min = f32::from_bits(rng.bits() as u32),
        5 => segment.inverse_depth_max = f32::from_bits(rng.bits() as u32),
        6 => change(&mut segment.row_offsets, rng),
        7 => change(&mut segment.row_counts, rng),
        _ => {
            let at = rng.below(segment.depth_pixels.len());
            segment
                .depth_pixels
                .iter_mut()
                .skip(at)
                .for_each(|pixel| pixel.geometry = rng.bits() as u32);
        }
    }
    if rng.below(2) == 0 {
        segment.blocks = BlockIndex::default();
    }
}

/// Files of earlier failures, and small files of every kind, must give a valid result or an error.
#[test]
fn corpus_files_are_valid_or_errors() {
    let mut replayed = 0;
    for entry in std::fs::read_dir(corpus_folder())
        .expect("the corpus")
        .flatten()
    {
        let path = entry.path();
        match path.extension().and_then(|e| e.to_str()) {
            Some("ldi") => drop(read_ldi(&path)),
            Some("shard") => drop(read_shard(&path)),
            Some("sprite") => drop(read_sprite(&path)),
            Some("json") => drop(read_path(&path)),
            Some("report") => drop(read_report(&path)),
            Some("exr") => drop(read_depth(&path)),
            Some("obj" | "gltf" | "glb" | "ply" | "stl") => drop(read_scene(&path)),
            _ => continue,
        }
        replayed += 1;
    }
    assert!(replayed >= 8, "{replayed} files");
}
