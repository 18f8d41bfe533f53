//! Channels of EXR files: selected by name, and refused if they cannot be used.

use super::*;

fn parts(of: &[(Option<&str>, &[&str])]) -> ExrParts {
    let part = |(index, (name, channels)): (usize, &(Option<&str>, &[&str]))| ExrPart {
        index,
        name: name.map(str::to_owned),
        size_px: [4, 2],
        data_start: [0, 0],
        data_size: [4, 2],
        rec709_from_file: None,
        channels: channels.iter().map(|&name| name.to_owned()).collect(),
        halves: vec![false; channels.len()],
    };
    ExrParts(of.iter().enumerate().map(part).collect())
}

fn depth_name(of: &[(Option<&str>, &[&str])]) -> Option<String> {
    let parts = parts(of);
    parts.depth().map(|channel| parts.name(channel))
}

#[test]
fn depth_channel_found_by_any_name() {
    let combined = [
        "ViewLayer.Combined.A",
        "ViewLayer.Combined.B",
        "ViewLayer.Combined.G",
        "ViewLayer.Combined.R",
    ];
    let normal = [
        "ViewLayer.Normal.X",
        "ViewLayer.Normal.Y",
        "ViewLayer.Normal.Z",
    ];
    let with = |more: &[&'static str]| [combined.as_slice(), more, &normal].concat();
    for name in [
        "ViewLayer.Depth.Z",
        "depth.V",
        "Depth.R",
        "ViewLayer.Depth.V",
        "depth",
        "ZDepth",
        "depth.Y",
    ] {
        assert_eq!(depth_name(&[(None, &with(&[name]))]).as_deref(), Some(name));
    }
    assert_eq!(depth_name(&[(None, &with(&[]))]), None);
    assert_eq!(
        depth_name(&[(None, &["A", "B", "G", "R", "Z"])]).as_deref(),
        Some("Z")
    );
    assert_eq!(
        depth_name(&[(None, &["B", "G", "R"])]).as_deref(),
        Some("R")
    );
    assert_eq!(
        depth_name(&[(None, &["B", "G", "R", "zdepth"])]).as_deref(),
        Some("zdepth")
    );
    assert_eq!(depth_name(&[(None, &["V"])]).as_deref(), Some("V"));
    for [other, exact] in [
        ["V.Denoising Depth.Z", "V.Depth.Z"],
        ["V.Denoising Depth.Z", "V.Depth.V"],
        ["V.Mist.Z", "V.Denoising Depth.Z"],
    ] {
        let found = depth_name(&[(None, &[other, exact])]);
        assert_eq!(found.as_deref(), Some(exact));
    }
    for not_depth in [&["V.Mist.Z"][..], &["Mist.V"], &["X", "Y", "Z"]] {
        assert_eq!(depth_name(&[(None, not_depth)]), None, "{not_depth:?}");
    }
    let several: &[(Option<&str>, &[&str])] = &[
        (Some("rgba"), &["A", "B", "G", "R"]),
        (Some("depth"), &["Z"]),
    ];
    assert_eq!(depth_name(several).as_deref(), Some("depth.Z"));
    let several: &[(Option<&str>, &[&str])] = &[
        (Some("rgba"), &["A", "B", "G", "R"]),
        (Some("normal"), &["X", "Y", "Z"]),
        (Some("depth"), &["R"]),
    ];
    assert_eq!(depth_name(several).as_deref(), Some("depth.R"));
}

#[test]
fn color_channels_found_by_any_name() {
    let names = |of: &[(Option<&str>, &[&str])]| {
        let parts = parts(of);
        let found = parts.color()?;
        Some(
            found
                .map(|it| it.map_or_else(|| "-".into(), |it| parts.name(it)))
                .join(" "),
        )
    };
    let found = |of: &[(Option<&str>, &[&str])]| names(of).unwrap_or_default();
    assert_eq!(found(&[(None, &["A", "B", "G", "R"])]), "R G B A");
    assert_eq!(found(&[(None, &["b", "g", "r"])]), "r g b -");
    assert_eq!(found(&[(None, &["Y"])]), "Y Y Y -");
    let layers = [
        "L.Diffuse.B",
        "L.Diffuse.G",
        "L.Diffuse.R",
        "L.Combined.A",
        "L.Combined.B",
        "L.Combined.G",
        "L.Combined.R",
    ];
    assert_eq!(
        found(&[(None, &layers)]),
        "L.Combined.R L.Combined.G L.Combined.B L.Combined.A"
    );
    let several: &[(Option<&str>, &[&str])] =
        &[(Some("z"), &["Z"]), (Some("rgba"), &["B", "G", "R"])];
    assert_eq!(found(several), "rgba.R rgba.G rgba.B -");
    let rgb: &[&str] = &["B", "G", "R"];
    let several: &[(Option<&str>, &[&str])] = &[(Some("DiffCol"), rgb), (Some("V.Combined"), rgb)];
    assert_eq!(
        found(several),
        "V.Combined.R V.Combined.G V.Combined.B -",
        "the finished picture"
    );
    assert_eq!(found(&[(None, &["Y", "Z"])]), "Y Y Y -", "with depth");
    assert_eq!(names(&[(None, &["X", "Y", "Z"])]), None);
    let vectors: &[(Option<&str>, &[&str])] =
        &[(Some("depth"), &["Z"]), (Some("normal"), &["X", "Y", "Z"])];
    assert_eq!(names(vectors), None);
    assert_eq!(names(&[(None, &["BY", "RY", "Y"])]), None);
    assert_eq!(names(&[(None, &["Z"])]), None);
}

#[test]
fn picture_is_display_window() {
    use exr::image::{AnyChannel, AnyChannels, FlatSamples};
    use exr::meta::attribute::IntegerBounds;
    use exr::prelude::{Encoding, Image, Layer, LayerAttributes, WritableImage};
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("a.exr");
    let read = |size: (usize, usize), start: (i32, i32), display: (i32, i32, usize, usize)| {
        let samples = (1..=size.0 * size.1).map(|i| i as f32).collect();
        let channel = AnyChannel::new("Z", FlatSamples::F32(samples));
        let layer = Layer::new(
            size,
            LayerAttributes::default().with_position(start.into()),
            Encoding::UNCOMPRESSED,
            AnyChannels::sort([channel].into_iter().collect()),
        );
        let mut image = Image::from_layer(layer);
        let (x, y, width, height) = display;
        image.attributes.display_window = IntegerBounds::new((x, y), (width, height));
        image.write().to_file(&path).expect("written");
        let parts = ExrParts::read(&path).expect("an EXR");
        let depth = parts.depth().expect("Z");
        let samples = parts.decode_one(&path, depth).expect("samples");
        (parts.size_px(depth), samples)
    };
    let cropped = vec![0.0, 0.0, 0.0, 0.0, 1.0, 2.0, 0.0, 3.0, 4.0];
    assert_eq!(read((2, 2), (6, 6), (5, 5, 3, 3)), ([3, 3], cropped));
    let overscan = vec![5.0];
    assert_eq!(read((3, 3), (-1, -1), (0, 0, 1, 1)), ([1, 1], overscan));
    let apart = vec![1.0, 2.0];
    assert_eq!(read((2, 1), (9, 9), (0, 0, 4, 4)), ([2, 1], apart));
}

#[test]
fn primaries_of_aces_become_rec709() {
    let aces = Chromaticities {
        red: (0.7347, 0.2653).into(),
        green: (0.0, 1.0).into(),
        blue: (0.0001, -0.077).into(),
        white: (0.32168, 0.33767).into(),
    };
    let matrix = rec709_from(&aces).expect("other primaries");
    // Rec. 709 red and white in ACES 2065-1.
    let red = matrix * DVec3::new(0.4397, 0.0898, 0.0175);
    assert!(red.distance(DVec3::X) < 2e-3, "{red}");
    assert!((matrix * DVec3::ONE).distance(DVec3::ONE) < 1e-9);
}
