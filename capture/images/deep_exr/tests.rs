use super::*;
use headbox_core::random::Rng;

fn random_image(seed: u64, stored_px: [u32; 2]) -> DeepImage {
    let mut random = Rng::new(seed);
    let mut offsets = vec![0u32];
    for _ in 0..stored_px[0] * stored_px[1] {
        offsets.push(offsets[offsets.len() - 1] + random.below(5) as u32);
    }
    let total = offsets[offsets.len() - 1] as usize;
    // Multiples of one half, exact in half floats.
    let mut values = |step: f32| {
        (0..total)
            .map(|_| random.below(200) as f32 * step)
            .collect::<Vec<f32>>()
    };
    let channels = [
        ("A", DeepKind::Half, 0.5),
        ("Z", DeepKind::Float, 0.37),
        ("id", DeepKind::Uint, 1.0),
    ];
    let channels = channels.map(|(name, kind, step)| DeepChannel {
        name: name.into(),
        kind,
        values: values(step),
    });
    let matrix = |step: f32| std::array::from_fn(|i| i as f32 * step);
    let view = DeepView {
        cube: seed.is_multiple_of(2),
        world_to_camera: Some(matrix(0.5)),
        world_to_ndc: (seed > 1).then(|| matrix(-2.0)),
    };
    DeepImage {
        size_px: [40, 30],
        origin_px: [-3, 5],
        stored_px,
        offsets,
        channels: channels.into(),
        view,
    }
}

const ALL: [DeepCompression; 3] = [
    DeepCompression::None,
    DeepCompression::Rle,
    DeepCompression::Zips,
];

#[test]
fn written_image_reads_back() {
    for (seed, size) in [[1, 1], [17, 3], [64, 9], [1, 40]].into_iter().enumerate() {
        let image = random_image(seed as u64, size);
        for compression in ALL {
            let bytes = image.to_bytes(compression).expect("is whole");
            assert_eq!(
                parse(&bytes).expect("reads"),
                image,
                "{compression:?} {size:?}"
            );
        }
    }
}

#[test]
fn rle_and_zips_compress_constant_data() {
    let mut image = random_image(3, [64, 9]);
    image
        .channels
        .iter_mut()
        .for_each(|channel| channel.values.fill(1.0));
    let sizes = ALL.map(|compression| image.to_bytes(compression).expect("is whole").len());
    assert!(
        sizes[1] < sizes[0] / 2 && sizes[2] < sizes[0] / 2,
        "{sizes:?}"
    );
}

#[test]
fn damaged_file_never_panics() {
    let mut random = Rng::new(11);
    for compression in ALL {
        let bytes = random_image(5, [20, 6])
            .to_bytes(compression)
            .expect("is whole");
        for end in 0..bytes.len() {
            assert!(parse(&bytes[..end]).is_err(), "cut at {end}");
        }
        for _ in 0..3000 {
            let mut damaged = bytes.clone();
            for _ in 0..1 + random.below(3) {
                let position = random.below(damaged.len() as u64) as usize;
                damaged[position] = random.bits() as u8;
            }
            let _ = parse(&damaged); // values may differ, but it must neither panic nor allocate without bounds
        }
    }
    let (field, cause) = parse(b"x").expect_err("not a file");
    assert!(
        field.contains("first bytes") && cause.contains("truncated"),
        "{field} {cause}"
    );
}

#[test]
fn table_with_repeated_row_refused() {
    let bytes = random_image(5, [20, 6])
        .to_bytes(DeepCompression::None)
        .expect("is whole");
    let table = Header::read(&bytes).expect("reads").end;
    let mut damaged = bytes;
    damaged.copy_within(table..table + 8, table + 8);
    let (field, cause) = parse(&damaged).expect_err("a row is missing");
    assert!(
        field.contains("table") && cause.contains("twice"),
        "{field} {cause}"
    );
}

#[test]
fn inconsistent_counts_not_written() {
    let mut image = random_image(7, [5, 5]);
    image.channels[1].values.pop();
    let (field, _) = image.to_bytes(DeepCompression::Zips).expect_err("refused");
    assert!(field.contains('Z'));
}

#[test]
fn composite_nearest_sample_first() {
    let channel = |name: &str, values: [f32; 2]| DeepChannel {
        name: name.into(),
        kind: DeepKind::Float,
        values: values.into(),
    };
    let image = DeepImage {
        size_px: [1, 1],
        origin_px: [0, 0],
        stored_px: [1, 1],
        offsets: vec![0, 2],
        channels: vec![
            channel("A", [1.0, 0.25]),
            channel("R", [0.8, 0.1]),
            channel("Z", [5.0, 2.0]),
        ],
        view: DeepView::default(),
    };
    let pixel = DeepImage::composite(&[&image], 0, 0);
    assert!(
        (pixel[0] - (0.1 + 0.75 * 0.8)).abs() < 1e-6 && (pixel[3] - 1.0).abs() < 1e-6,
        "{pixel:?}"
    );
    assert_eq!(DeepImage::composite(&[&image], 1, 0), [0.0; 4]);
}

/// Composites OpenEXR's sample images and compares with their flat composite. The deep image of the
/// ground is missing: above it the other three make the whole image.
#[test]
fn openexr_samples_match_flat_composite() {
    let folder = Path::new(concat!(
        env!("CARGO_MANIFEST_DIR"),
        "/../../../shared/data/openexr_deep/LowResLeftView"
    ));
    if !folder.is_dir() {
        println!("skipped: no shared/data/openexr_deep");
        return;
    }
    let read = |name: &str| DeepImage::read(&folder.join(name)).expect("reads");
    let [balls, leaves, trunks] = ["Balls.exr", "Leaves.exr", "Trunks.exr"].map(read);
    let flat = exr::prelude::read_first_rgba_layer_from_file(
        folder.join("composited.exr"),
        |size, _| (size.x(), vec![[0f32; 4]; size.x() * size.y()]),
        |(stride, pixels), pixel, (r, g, b, a): (f32, f32, f32, f32)| {
            pixels[pixel.y() * *stride + pixel.x()] = [r, g, b, a];
        },
    );
    let layer = flat.expect("reads").layer_data;
    let (stride, pixels) = layer.channel_data.pixels;
    let corner = layer.attributes.layer_position;
    let mut covered = 0;
    // The ground starts below row 170.
    for y in 2..170u32 {
        for x in 2..1020u32 {
            let composited = DeepImage::composite(&[&balls, &leaves, &trunks], x, y);
            let expected = pixels
                [(y as i32 - corner.y()) as usize * stride + (x as i32 - corner.x()) as usize];
            covered += u32::from(expected[3] > 0.0);
            for (level, expected) in composited.into_iter().zip(expected) {
                // Samples and composite are halves: 11 bits each.
                assert!(
                    (level - expected).abs() <= 2e-3,
                    "{x} {y}: {level} {expected}"
                );
            }
        }
    }
    assert!(covered > 10_000, "{covered}");
}
