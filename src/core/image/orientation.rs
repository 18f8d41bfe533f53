//! Orientation of photographs by the EXIF tag of their files: phones store portraits on their side.

use super::png_chunks;
pub use ::image::metadata::Orientation;
use ::image::{ImageDecoder, ImageReader};
use std::fs::File;
use std::io::{self, BufReader, Read, Seek, SeekFrom};
use std::path::Path;

/// Largest length of EXIF data that is read, bytes.
const MAX_EXIF: u64 = 1 << 20;

/// Reads the turn that brings an image file upright, from its headers. A file without the tag, or
/// one that cannot be read, is upright.
#[must_use]
pub fn read(path: &Path) -> Orientation {
    let found = || -> io::Result<Option<Orientation>> {
        let mut file = BufReader::new(File::open(path)?);
        let mut start = [0; 8];
        file.read_exact(&mut start)?;
        if start.starts_with(b"\xff\xd8") {
            Ok(find_in_jpeg(&mut file)?.and_then(|exif| Orientation::from_exif_chunk(&exif)))
        } else if start == *png_chunks::SIGNATURE {
            Ok(find_in_png(&mut file)?.and_then(|exif| Orientation::from_exif_chunk(&exif)))
        } else if start.starts_with(b"RIFF") || start.starts_with(b"II") || start.starts_with(b"MM")
        {
            file.rewind()?;
            let decoder = ImageReader::new(file).with_guessed_format()?.into_decoder();
            Ok(decoder.and_then(|mut decoder| decoder.orientation()).ok())
        } else {
            Ok(None)
        }
    };
    let found = crate::panics::catch(found).ok().and_then(Result::ok);
    found.flatten().unwrap_or(Orientation::NoTransforms)
}

/// Returns the EXIF data of a JPEG file.
fn find_in_jpeg(file: &mut (impl Read + Seek)) -> io::Result<Option<Vec<u8>>> {
    const EXIF: &[u8] = b"Exif\0\0";
    file.seek(SeekFrom::Start(2))?;
    loop {
        let mut marker = [0; 2];
        file.read_exact(&mut marker)?;
        match marker {
            [0xff, 0xff] => {
                file.seek_relative(-1)?;
                continue;
            }
            // Start of a scan, or no segment.
            [0xff, 0xda] => return Ok(None),
            [0xff, _] => {}
            _ => return Ok(None),
        }
        let mut length = [0; 2];
        file.read_exact(&mut length)?;
        let length = u16::from_be_bytes(length).saturating_sub(2);
        if marker[1] == 0xe1 {
            let mut segment = vec![0; usize::from(length)];
            file.read_exact(&mut segment)?;
            if let Some(exif) = segment.strip_prefix(EXIF) {
                return Ok(Some(exif.to_vec()));
            }
        } else {
            file.seek_relative(i64::from(length))?;
        }
    }
}

/// Returns the EXIF data of a PNG file.
fn find_in_png(file: &mut (impl Read + Seek)) -> io::Result<Option<Vec<u8>>> {
    file.seek(SeekFrom::Start(8))?;
    loop {
        let mut head = [0; 8];
        file.read_exact(&mut head)?;
        let [a, b, c, d, kind @ ..] = head;
        let length = u64::from(u32::from_be_bytes([a, b, c, d]));
        match &kind {
            b"IEND" => return Ok(None),
            b"eXIf" if length <= MAX_EXIF => {
                let mut exif = vec![0; length as usize];
                file.read_exact(&mut exif)?;
                return Ok(Some(exif));
            }
            _ => file.seek_relative(length as i64 + 4)?,
        }
    }
}

/// Returns true if the turn swaps width and height.
#[must_use]
pub fn swaps_sides(orientation: Orientation) -> bool {
    use Orientation::{Rotate90, Rotate90FlipH, Rotate270, Rotate270FlipH};
    [Rotate90, Rotate270, Rotate90FlipH, Rotate270FlipH].contains(&orientation)
}

/// Returns the opposite turn.
#[must_use]
pub fn inverse(orientation: Orientation) -> Orientation {
    match orientation {
        Orientation::Rotate90 => Orientation::Rotate270,
        Orientation::Rotate270 => Orientation::Rotate90,
        own => own,
    }
}

/// Turns a picture, row-major; returns its new width and height, and the pixels.
///
/// # Panics
/// If there are fewer pixels than `width * height`.
#[must_use]
pub fn turn<T: Copy>(
    [width, height]: [u32; 2],
    pixels: &[T],
    orientation: Orientation,
) -> ([u32; 2], Vec<T>) {
    let size = if swaps_sides(orientation) {
        [height, width]
    } else {
        [width, height]
    };
    let source = |x: u32, y: u32| match orientation {
        Orientation::NoTransforms => [x, y],
        Orientation::FlipHorizontal => [width - 1 - x, y],
        Orientation::Rotate180 => [width - 1 - x, height - 1 - y],
        Orientation::FlipVertical => [x, height - 1 - y],
        Orientation::Rotate90 => [y, height - 1 - x],
        Orientation::Rotate270 => [width - 1 - y, x],
        Orientation::Rotate90FlipH => [y, x],
        Orientation::Rotate270FlipH => [width - 1 - y, height - 1 - x],
    };
    let rows = (0..size[1]).flat_map(|y| (0..size[0]).map(move |x| (x, y)));
    let pixel = |(x, y)| {
        let [x, y] = source(x, y);
        pixels[y as usize * width as usize + x as usize]
    };
    (size, rows.map(pixel).collect())
}

#[cfg(test)]
mod tests {
    use super::*;
    use ::image::{DynamicImage, GrayImage};

    const ALL: [u8; 8] = [1, 2, 3, 4, 5, 6, 7, 8];

    fn orientation(tag: u8) -> Orientation {
        Orientation::from_exif(tag).expect("a tag")
    }

    #[test]
    fn turn_equals_that_of_the_image_crate() {
        let pixels: Vec<u8> = (0..15).collect();
        for tag in ALL {
            let mut image =
                DynamicImage::from(GrayImage::from_raw(5, 3, pixels.clone()).expect("fits"));
            image.apply_orientation(orientation(tag));
            let (size, turned) = turn([5, 3], &pixels, orientation(tag));
            assert_eq!(size, [image.width(), image.height()], "{tag}");
            assert_eq!(turned, image.as_bytes(), "{tag}");
            let back = turn(size, &turned, inverse(orientation(tag)));
            assert_eq!(back, ([5, 3], pixels.clone()), "{tag}");
        }
    }

    #[test]
    fn tag_found_in_jpeg_and_png() {
        let folder = tempfile::tempdir().expect("a folder");
        for tag in ALL {
            let exif = [
                b"II*\0\x08\0\0\0\x01\0\x12\x01\x03\0\x01\0\0\0".as_slice(),
                &[tag, 0, 0, 0],
                &[0; 4],
            ]
            .concat();
            let app0 = b"\xff\xe0\0\x04ab";
            let app1 = [b"Exif\0\0".as_slice(), &exif].concat();
            let length = (app1.len() as u16 + 2).to_be_bytes();
            let jpeg = [
                b"\xff\xd8".as_slice(),
                app0,
                b"\xff\xff\xe1",
                &length,
                &app1,
                b"\xff\xda",
            ]
            .concat();
            let chunk = |kind: &[u8], data: &[u8]| {
                [&(data.len() as u32).to_be_bytes(), kind, data, &[0; 4]].concat()
            };
            let png = [
                png_chunks::SIGNATURE,
                &chunk(b"IDAT", &[0; 9]),
                &chunk(b"eXIf", &exif),
            ]
            .concat();
            for bytes in [jpeg, png] {
                let path = folder.path().join("a");
                std::fs::write(&path, &bytes).expect("written");
                assert_eq!(read(&path), orientation(tag));
                std::fs::write(&path, &bytes[..bytes.len() / 2]).expect("written");
                assert_eq!(read(&path), Orientation::NoTransforms, "cut short");
            }
        }
    }
}
