//! Mutated pictures: depth files of all kinds, deep images, skies, and photographs.

use crate::files::read_depth;
use crate::mutations::{Alone, written_bytes};
use headbox_images::deep_exr::{DeepChannel, DeepCompression, DeepImage, DeepKind, DeepView};
use headbox_images::read_color;
use headbox_scene::scene::SkyPicture;
use image::{ImageFormat, Luma, Rgb, RgbImage};
use std::path::Path;

fn npy(kind: &str, data: Vec<u8>) -> Vec<u8> {
    let header = format!("{{'descr': '{kind}', 'fortran_order': True, 'shape': (6, 8), }}\n");
    let mut bytes = b"\x93NUMPY\x01\0".to_vec();
    bytes.extend((header.len() as u16).to_le_bytes());
    bytes.extend(header.bytes());
    bytes.extend(data);
    bytes
}

#[test]
fn npy_depth() {
    let alone = Alone::lock();
    let floats = (0..48).flat_map(|i| (1.0 + i as f32).to_le_bytes());
    let integers = (0..48u16).flat_map(u16::to_be_bytes);
    let files = [npy("<f4", floats.collect()), npy(">u2", integers.collect())];
    alone.try_mutations("a.npy", &files, false, read_depth);
}

#[test]
fn tiff_depth() {
    let alone = Alone::lock();
    let grey = image::ImageBuffer::from_fn(8, 6, |x, y| Luma([(x * 300 + y) as u16]));
    let picture = written_bytes(|path| {
        grey.save_with_format(path, ImageFormat::Tiff)
            .expect("written");
    });
    alone.try_mutations("a.tif", &[picture], false, read_depth);
}

#[test]
fn colmap_depth_maps() {
    let alone = Alone::lock();
    let mut map = b"8&6&1&".to_vec();
    (0..48).for_each(|i| map.extend((1.0 + i as f32).to_le_bytes()));
    alone.try_mutations("a.bin", &[map], false, read_depth);
}

#[test]
fn deep_images() {
    let alone = Alone::lock();
    let channel = |name: &str, kind, first: f32| DeepChannel {
        name: name.into(),
        kind,
        values: (0..30).map(|i| first + i as f32).collect(),
    };
    let image = DeepImage {
        size_px: [6, 4],
        origin_px: [1, 0],
        stored_px: [5, 3],
        offsets: (0..16).map(|i| 2 * i).collect(),
        channels: vec![
            channel("A", DeepKind::Half, 0.0),
            channel("R", DeepKind::Float, 0.5),
            channel("Z", DeepKind::Float, 1.0),
        ],
        view: DeepView::default(),
    };
    let files = [
        DeepCompression::None,
        DeepCompression::Rle,
        DeepCompression::Zips,
    ]
    .map(|compression| image.to_bytes(compression).expect("encoded"));
    alone.try_mutations("deep.exr", &files, false, |path| {
        DeepImage::read(path).is_ok()
    });
}

fn read_sky(path: &Path) -> bool {
    SkyPicture::read(path, 30.0).is_ok_and(|sky| {
        let [width, height] = sky.size();
        assert_eq!(sky.texels().len(), width as usize * height as usize);
        true
    })
}

#[test]
fn skies() {
    let alone = Alone::lock();
    let mut flat = b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\nEXPOSURE=2\n\n-Y 8 +X 16\n".to_vec();
    let mut packed = flat.clone();
    for y in 0..8u8 {
        packed.extend([2, 2, 0, 16]);
        for channel in 0..4 {
            packed.extend([128 + 16, 100 + 8 * channel + y]);
        }
        (0..16).for_each(|x| flat.extend([x, y, 30, 129]));
    }
    alone.try_mutations("sky.hdr", &[flat, packed], false, read_sky);
    let exr = written_bytes(|path| {
        exr::prelude::write_rgb_file(path, 16, 8, |x, y| (x as f32, y as f32, 0.5))
            .expect("written");
    });
    alone.try_mutations("sky.exr", &[exr], false, read_sky);
}

#[test]
fn photographs() {
    let alone = Alone::lock();
    let picture = RgbImage::from_fn(20, 14, |x, y| Rgb([x as u8 * 12, y as u8 * 18, 7]));
    for (name, format) in [
        ("a.jpg", ImageFormat::Jpeg),
        ("a.gif", ImageFormat::Gif),
        ("a.webp", ImageFormat::WebP),
        ("a.png", ImageFormat::Png),
        ("a.tiff", ImageFormat::Tiff),
    ] {
        let bytes = written_bytes(|path| {
            picture.save_with_format(path, format).expect("written");
        });
        alone.try_mutations(name, &[bytes], false, |path| read_color(path).is_ok());
    }
}
