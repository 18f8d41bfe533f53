use super::*;
use exr::image::{AnyChannel, AnyChannels, FlatSamples, Image, Layer};
use exr::prelude::{Encoding, LayerAttributes, WritableImage, f16};
use std::path::PathBuf;
use tempfile::TempDir;

const SIZE: [usize; 2] = [3, 2];

const FORMAT: DepthFormat<'static> = DepthFormat {
    unit: Some(0.001),
    float_unit: 1.0,
    eight_bits: false,
    are_shares: false,
    channel: None,
};

/// Depths of the test files, metres.
const DEPTHS: [f32; 6] = [1.0, 1.5, 2.0, 2.5, 3.0, 3.5];

fn save(folder: &TempDir, name: &str, bytes: &[u8]) -> PathBuf {
    let path = folder.path().join(name);
    std::fs::write(&path, bytes).expect("written");
    path
}

fn npy(descr: &str, fortran: &str, shape: &str, data: &[u8]) -> Vec<u8> {
    let header =
        format!("{{'descr': '{descr}', 'fortran_order': {fortran}, 'shape': ({shape}), }}\n");
    let length = (header.len() as u16).to_le_bytes();
    [
        b"\x93NUMPY\x01\0",
        length.as_slice(),
        header.as_bytes(),
        data,
    ]
    .concat()
}

fn stored<const N: usize>(number: impl Fn(f32) -> [u8; N]) -> Vec<u8> {
    DEPTHS.iter().flat_map(|&depth| number(depth)).collect()
}

#[test]
fn npy_of_any_type_and_order() {
    let folder = tempfile::tempdir().expect("a folder");
    let mm = |depth: f32| (depth * 1000.0) as u32;
    let columns: Vec<u8> = [0, 3, 1, 4, 2, 5]
        .into_iter()
        .flat_map(|i| DEPTHS[i].to_le_bytes())
        .collect();
    let files = [
        ("<f4", "False", "2, 3", stored(f32::to_le_bytes)),
        (">f4", "False", "2, 3", stored(f32::to_be_bytes)),
        (
            "<f8",
            "False",
            "2, 3, 1",
            stored(|z| f64::from(z).to_le_bytes()),
        ),
        (
            ">f8",
            "False",
            "1, 2, 3",
            stored(|z| f64::from(z).to_be_bytes()),
        ),
        (
            "<f2",
            "False",
            "2, 3",
            stored(|z| f16::from_f32(z).to_le_bytes()),
        ),
        ("<f4", "True", "2, 3", columns),
        (
            "<u2",
            "False",
            "2, 3",
            stored(|z| (mm(z) as u16).to_le_bytes()),
        ),
        (">i4", "False", "2, 3", stored(|z| mm(z).to_be_bytes())),
        (
            "<i8",
            "False",
            "2, 3",
            stored(|z| u64::from(mm(z)).to_le_bytes()),
        ),
    ];
    for (descr, fortran, shape, data) in files {
        let path = save(&folder, "d.npy", &npy(descr, fortran, shape, &data));
        let read = read(&path, &FORMAT).expect(descr);
        assert_eq!([read.width, read.height], [3, 2], "{descr} {fortran}");
        let near = |(a, b): (&f32, &f32)| (a - b).abs() < 1e-6;
        assert!(
            read.values.iter().zip(&DEPTHS).all(near),
            "{descr}: {read:?}"
        );
        assert_eq!(read_size(&path).expect("read"), Some([3, 2]));
    }
    let negative = npy("<i2", "False", "1, 2", &[0xff, 0xff, 0xe8, 0x03]);
    let read_negative = read(&save(&folder, "d.npy", &negative), &FORMAT).expect("read");
    assert!(read_negative.values[0].is_nan() && (read_negative.values[1] - 1.0).abs() < 1e-6);
}

#[test]
fn invalid_npy_refused_by_name() {
    let folder = tempfile::tempdir().expect("a folder");
    let whole = npy("<f4", "False", "2, 3", &stored(f32::to_le_bytes));
    let refused = |bytes: &[u8]| {
        let path = save(&folder, "d.npy", bytes);
        read(&path, &FORMAT).expect_err("refused").to_string()
    };
    for length in 0..whole.len() {
        assert!(refused(&whole[..length]).contains("d.npy"), "{length}");
    }
    for (descr, shape, expected) in [
        ("|b1", "2, 3", "type |b1"),
        ("<c8", "2, 3", "type <c8"),
        ("<f4", "2, 3, 4", "shape (2, 3, 4)"),
        ("<f4", "6,", "shape (6,)"),
        ("<f4", "99999999999, 99999999999", "pixels"),
        ("<f4", "3, 3", "bytes of numbers"),
        ("|u1", "4, 6", "8 bits"),
    ] {
        let error = refused(&npy(descr, "False", shape, &stored(f32::to_le_bytes)));
        assert!(error.contains(expected), "{error}");
    }
}

#[test]
fn tiff_of_more_bits_than_the_image_decoder_reads() {
    use ::tiff::encoder::{TiffEncoder, colortype};
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("d.tif");
    let create = || TiffEncoder::new(std::fs::File::create(&path).expect("a file")).expect("begun");
    let check = |what: &str| {
        let read = read(&path, &FORMAT).expect(what);
        let near = |(a, b): (&f32, &f32)| (a - b).abs() < 1e-6;
        assert!(
            read.values.iter().zip(&DEPTHS).all(near),
            "{what}: {read:?}"
        );
        assert_eq!(read_size(&path).expect("read"), Some([3, 2]), "{what}");
    };
    let mm = DEPTHS.map(|depth| (depth * 1000.0) as u32);
    create()
        .write_image::<colortype::Gray32Float>(3, 2, &DEPTHS)
        .expect("written");
    check("32-bit floats");
    create()
        .write_image::<colortype::Gray64Float>(3, 2, &DEPTHS.map(f64::from))
        .expect("written");
    check("64-bit floats");
    create()
        .write_image::<colortype::Gray32>(3, 2, &mm)
        .expect("written");
    check("32-bit integers");
    create()
        .write_image::<colortype::Gray16>(3, 2, &mm.map(|mm| mm as u16))
        .expect("written");
    check("16-bit integers");
    create()
        .write_image::<colortype::GrayI16>(3, 2, &mm.map(|mm| mm as i16))
        .expect("written");
    check("signed 16-bit integers");
    create()
        .write_image::<colortype::RGB32Float>(1, 2, &DEPTHS)
        .expect("written");
    assert!(read(&path, &FORMAT).is_err(), "colours");
    create()
        .write_image::<colortype::Gray32Float>(3, 2, &DEPTHS)
        .expect("written");
    let bytes = std::fs::read(&path).expect("there");
    for length in 0..bytes.len() {
        save(&folder, "d.tif", &bytes[..length]);
        let _ = read(&path, &FORMAT);
    }
}

/// Writes an EXR of parts with named channels; samples are half floats if `halves`.
fn save_exr(path: &Path, parts: &[(&str, &[(&str, f32)])], halves: bool) {
    let layer = |(name, channels): &(&str, &[(&str, f32)])| {
        let channel = |(name, factor): &(&str, f32)| {
            let values = DEPTHS.iter().map(|depth| depth * factor);
            let samples = if halves {
                FlatSamples::F16(values.map(f16::from_f32).collect())
            } else {
                FlatSamples::F32(values.collect())
            };
            AnyChannel::new(*name, samples)
        };
        let attributes = if name.is_empty() {
            LayerAttributes::default()
        } else {
            LayerAttributes::named(*name)
        };
        let channels = AnyChannels::sort(channels.iter().map(channel).collect());
        Layer::new(
            (SIZE[0], SIZE[1]),
            attributes,
            Encoding::FAST_LOSSLESS,
            channels,
        )
    };
    let layers: Vec<_> = parts.iter().map(layer).collect();
    let attributes = exr::meta::header::ImageAttributes::with_size((SIZE[0], SIZE[1]));
    Image::from_layers(attributes, layers)
        .write()
        .to_file(path)
        .expect("written");
}

#[test]
fn exr_depth_of_layers_and_parts() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("d.exr");
    let rgb = [("R", 0.1), ("G", 0.2), ("B", 0.3)];
    for name in ["ViewLayer.Depth.Z", "depth.V", "Depth.R", "Z", "depth"] {
        for halves in [false, true] {
            let channels = [rgb.as_slice(), &[(name, 1.0)]].concat();
            save_exr(&path, &[("", &channels)], halves);
            assert_eq!(read(&path, &FORMAT).expect(name).values, DEPTHS, "{name}");
            save_exr(&path, &[("rgb", &rgb), ("z", &[(name, 1.0)])], halves);
            assert_eq!(read(&path, &FORMAT).expect(name).values, DEPTHS, "{name}");
        }
    }
    save_exr(&path, &[("", &[("R", 1.0), ("G", 1.0), ("B", 1.0)])], false);
    assert_eq!(read(&path, &FORMAT).expect("grey").values, DEPTHS);
    for channels in [rgb.as_slice(), &[("U", 1.0), ("W", 1.0)]] {
        save_exr(&path, &[("", channels)], false);
        let error = read(&path, &FORMAT).expect_err("colours").to_string();
        assert!(
            error.contains(channels[1].0) && error.contains("channels are"),
            "{error}"
        );
    }
    save_exr(&path, &[("rgb", &rgb), ("z", &[("D", 1.0)])], false);
    for name in ["D", "z.D"] {
        let format = DepthFormat {
            channel: Some(name),
            ..FORMAT
        };
        assert_eq!(read(&path, &format).expect(name).values, DEPTHS);
    }
}

#[test]
fn grey_picture_in_colour_is_depth() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("d.png");
    let values = DEPTHS.map(|depth| (depth * 1000.0) as u16);
    let grey: Vec<u16> = values.iter().flat_map(|&v| [v; 3]).collect();
    let save = |samples: Vec<u16>| {
        image::ImageBuffer::<image::Rgb<u16>, _>::from_raw(3, 2, samples)
            .expect("fits")
            .save(&path)
            .expect("written");
        read(&path, &FORMAT)
    };
    let read_grey = save(grey.clone()).expect("grey");
    assert!((read_grey.values[1] - 1.5).abs() < 1e-6);
    let mut colored = grey;
    colored[4] += 1;
    let error = save(colored).expect_err("colours").to_string();
    assert!(error.contains("different colours"), "{error}");
}

#[test]
fn largest_integer_of_any_type_is_1() {
    let folder = tempfile::tempdir().expect("a folder");
    let halves = [
        ("|u1", [128u8; 6].to_vec()),
        ("<u2", [0x8000u16.to_le_bytes(); 6].concat()),
        ("<u4", [0x8000_0000u32.to_le_bytes(); 6].concat()),
    ];
    for (descr, data) in halves {
        let path = save(&folder, "d.npy", &npy(descr, "False", "2, 3", &data));
        let depth = DepthPicture::read_fractions(&path, 1.0).expect(descr);
        assert!((depth.values[0] - 0.5).abs() < 0.003, "{descr}: {depth:?}");
    }
}
