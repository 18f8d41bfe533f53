//! Limits of `--memory`: files that are refused by name, and captures that keep within it.

use crate::run::{fails, json, succeeds};

#[test]
fn memory_limit_refuses_files_by_name() {
    let dir = tempfile::tempdir().unwrap();
    let write = |name: &str, text: &str| std::fs::write(dir.path().join(name), text).unwrap();
    write("a.mtl", "newmtl m\nmap_Kd large.png\n");
    write(
        "a.obj",
        "mtllib a.mtl\nusemtl m\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nf 1/1 2/1 3/1\n",
    );
    // 16 MiB of pixels, and four times as many as a texture.
    let image = image::GrayImage::new(4096, 4096);
    image.save(dir.path().join("large.png")).unwrap();
    let command = "truth a.obj -o o.png --size 8x8 --samples 1 --memory";
    let arguments = |limit| command.split(' ').chain([limit]).collect::<Vec<_>>();
    fails(
        dir.path(),
        1,
        &arguments("64"),
        "a.obj: large.png needs at least 80 MiB of memory",
    );
    assert!(!dir.path().join("o.png").exists());
    succeeds(dir.path(), &arguments("4096"));

    // As large as a texture, but a sprite has more for each pixel.
    let sprite = "sprite --color large.png --depth large.png --depth-kind eye -o o.sprite --memory";
    fails(
        dir.path(),
        1,
        &sprite.split(' ').chain(["512"]).collect::<Vec<_>>(),
        "large.png and large.png: making a sprite needs at least 768 MiB of memory",
    );
}

/// Files whose headers state sizes that they do not have: a frame of a GIF that is larger than the
/// image, and a sky.
#[test]
fn decoders_allocate_no_more_than_the_limit() {
    let dir = tempfile::tempdir().unwrap();
    let write = |name: &str, bytes: &[u8]| std::fs::write(dir.path().join(name), bytes).unwrap();
    write("a.mtl", b"newmtl m\nmap_Kd large.gif\n");
    write(
        "a.obj",
        b"mtllib a.mtl\nusemtl m\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nf 1/1 2/1 3/1\n",
    );
    let size = 30_000u16.to_le_bytes();
    let mut gif = b"GIF89a\x01\0\x01\0\x80\0\0\0\0\0\xff\xff\xff,\0\0\0\0".to_vec();
    gif.extend([size, size].concat());
    gif.extend(b"\0\x02\x02D\x01\0;");
    write("large.gif", &gif);
    let command = "-o o.png --size 8x8 --samples 1 --memory 256";
    let refuses = |scene: &[&str], message: &str| {
        let arguments = [&["truth"], scene, &command.split(' ').collect::<Vec<_>>()].concat();
        fails(dir.path(), 1, &arguments, message);
    };
    refuses(&["a.obj"], "a.obj: large.gif needs at least");

    let sky = "truth builtin:bump -o sky.exr --size 16x8 --samples 1";
    succeeds(dir.path(), &sky.split(' ').collect::<Vec<_>>());
    let mut exr = std::fs::read(dir.path().join("sky.exr")).unwrap();
    let corners = [0i32, 0, 16_383, 16_383].map(i32::to_le_bytes);
    for name in [&b"dataWindow\0box2i\0"[..], b"displayWindow\0box2i\0"] {
        let found = exr.windows(name.len()).position(|bytes| bytes == name);
        let window = found.unwrap() + name.len() + 4;
        exr[window..window + 16].copy_from_slice(&corners.concat());
    }
    write("large.exr", &exr);
    refuses(
        &["builtin:bump", "--sky", "large.exr"],
        "large.exr: needs at least 3072 MiB of memory",
    );
}

/// 300,000 triangles without common corners: each kind of file is refused by the first part of it
/// that does not fit.
#[test]
fn meshes_are_within_the_memory_limit() {
    const TRIANGLES: u32 = 300_000;
    let dir = tempfile::tempdir().unwrap();
    let mut obj = String::new();
    // Each triangle has three vertices of its own: their positions are shared, not their normals.
    let mut flat = "v 0 0 0\nv 1 0 0\nv 0 0 1\n".to_owned();
    let mut stl = vec![0; 80];
    stl.extend(TRIANGLES.to_le_bytes());
    for i in 0..TRIANGLES {
        obj += &format!("v {i} 0 0\nv {i} 1 0\nv {i} 0 1\nf -1 -2 -3\n");
        flat += &format!("vn 0 1 {i}\nf 1//-1 2//-1 3//-1\n");
        let x = i as f32;
        let record = [0.0, 0.0, 0.0, x, 0.0, 0.0, x, 1.0, 0.0, x, 0.0, 1.0];
        stl.extend(record.iter().flat_map(|value: &f32| value.to_le_bytes()));
        stl.extend([0, 0]);
    }
    std::fs::write(dir.path().join("a.obj"), obj).unwrap();
    std::fs::write(dir.path().join("flat.obj"), flat).unwrap();
    std::fs::write(dir.path().join("a.stl"), stl).unwrap();
    let truth = |file: &'static str, limit: &'static str| {
        let command = "-o o.png --size 8x8 --samples 1 --bounces 0 --memory";
        let words = command.split(' ').chain([limit]);
        ["truth", file].into_iter().chain(words).collect::<Vec<_>>()
    };
    for (file, limit, message) in [
        ("a.obj", "64", "a.obj: its mesh needs at least 56 MiB"),
        ("a.obj", "128", "a.obj: its mesh needs at least 110 MiB"),
        (
            "flat.obj",
            "128",
            "flat.obj: its mesh needs at least 114 MiB",
        ),
        ("a.stl", "64", "a.stl: its mesh needs at least"),
        ("a.stl", "128", "a.stl: tracing it needs at least 58 MiB"),
    ] {
        fails(dir.path(), 1, &truth(file, limit), message);
    }
    succeeds(dir.path(), &truth("a.stl", "256"));
}

/// Takes 54 MiB; 69 if the allocator keeps freed memory.
#[test]
fn captures_keep_the_memory_limit_or_are_refused() {
    const LIMIT_MIB: &str = "64";
    let dir = tempfile::tempdir().unwrap();
    let command = "capture builtin:interior --strata 6 --rays 4 --light-samples 1";
    let arguments =
        |more: [&'static str; 4]| [command.split(' ').collect(), more.to_vec()].concat();
    let kept = arguments(["-o", "kept.ldi", "--face-size", "176"]);
    let limit = ["--memory", LIMIT_MIB, "--threads", "8"];
    let printed = json(dir.path(), &[&kept[..], &limit, &["--json"]].concat());
    let peak = printed["peak_rss_mb"].as_f64().unwrap();
    assert!(peak < LIMIT_MIB.parse().unwrap(), "{peak} MiB");
    succeeds(
        dir.path(),
        &arguments(["-o", "free.ldi", "--face-size", "176"]),
    );
    let bytes = |name: &str| std::fs::read(dir.path().join(name)).unwrap();
    assert!(bytes("kept.ldi") == bytes("free.ldi"));

    let refused = arguments(["-o", "refused.ldi", "--face-size", "256"]);
    let message = "--memory 64: loading the scene and capturing it take about";
    fails(dir.path(), 2, &[&refused[..], &limit].concat(), message);
    assert!(!dir.path().join("refused.ldi").exists());

    let shard =
        "capture builtin:interior --face-size 400 --strata 1 --rays 1 --shard 1/1 -o a.shard";
    succeeds(dir.path(), &shard.split(' ').collect::<Vec<_>>());
    let merge = ["merge", "a.shard", "-o", "refused.ldi"];
    fails(dir.path(), 2, &[&merge[..], &limit].concat(), message);
    assert!(!dir.path().join("refused.ldi").exists());
}
