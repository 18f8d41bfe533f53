//! Sparse points of a COLMAP model, triangulated from feature tracks.

use super::model::find_model;
use crate::ImagesError;
use crate::readers::byte_reader::ByteReader;
use crate::readers::text;
use glam::DVec3;
use headbox_core::files::InputFolder;
use std::path::Path;

/// A triangulated point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SparsePoint {
    /// Position, world metres.
    pub position: DVec3,
    /// Colour, 8-bit sRGB.
    pub color: [u8; 3],
}

/// Reads the finite sparse points of the model in a folder (or where
/// [`ImageSet::open`](crate::ImageSet::open) finds it below), in the file's order; empty if there
/// is no model or it has no points.
///
/// # Errors
/// [`ImagesError::Io`] and [`ImagesError::Field`] if the file of points cannot be read.
pub fn read_sparse_points(folder: &Path) -> Result<Vec<SparsePoint>, ImagesError> {
    let folder = &InputFolder::new(folder);
    let Some(model) = find_model(folder)? else {
        return Ok(Vec::new());
    };
    let extension = model.extension;
    let file = model.path.join(format!("points3D.{extension}"));
    if !file.is_file() {
        return Ok(Vec::new());
    }
    let mut points = if extension == "bin" {
        binary_points(folder, &file)?
    } else {
        text_points(folder, &file)?
    };
    points.retain(|point| point.position.is_finite());
    Ok(points)
}

fn binary_points(folder: &InputFolder, file: &Path) -> Result<Vec<SparsePoint>, ImagesError> {
    let bytes = text::read_bytes(folder, file)?;
    let mut bytes = ByteReader { file, rest: &bytes };
    let mut points = Vec::new();
    for _ in 0..bytes.u64()? {
        let _id = bytes.u64()?;
        let position = DVec3::from_array(bytes.f64s()?);
        let color = bytes.array()?;
        let [_error] = bytes.f64s()?;
        bytes.skip_list(8)?; // the track: images and features of the point
        points.push(SparsePoint { position, color });
    }
    Ok(points)
}

fn text_points(folder: &InputFolder, file: &Path) -> Result<Vec<SparsePoint>, ImagesError> {
    let text = text::read_text(folder, file)?;
    let point = |line: &str| {
        let mut words = line.split_whitespace().skip(1);
        let mut position = [0.0; 3];
        for axis in &mut position {
            *axis = words.next()?.parse().ok()?;
        }
        let mut color = [0; 3];
        for channel in &mut color {
            *channel = words.next()?.parse().ok()?;
        }
        Some(SparsePoint {
            position: DVec3::from_array(position),
            color,
        })
    };
    let expected = "expected POINT3D_ID X Y Z R G B ERROR TRACK[]";
    let parse_line = |(number, line): (usize, &str)| {
        point(line).ok_or_else(|| ImagesError::field(file, format!("line {number}"), expected))
    };
    text::numbered_lines(&text)
        .filter(|(_, line)| !line.is_empty())
        .map(parse_line)
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn point(x: f64, color: [u8; 3]) -> SparsePoint {
        SparsePoint {
            position: DVec3::new(x, 2.0, -3.5),
            color,
        }
    }

    fn binary(points: &[SparsePoint], pictures: u64) -> Vec<u8> {
        let mut bytes = (points.len() as u64).to_le_bytes().to_vec();
        for (id, point) in (7u64..).zip(points) {
            bytes.extend(id.to_le_bytes());
            point
                .position
                .to_array()
                .iter()
                .for_each(|axis| bytes.extend(axis.to_le_bytes()));
            bytes.extend(point.color);
            bytes.extend(0.5f64.to_le_bytes());
            bytes.extend(pictures.to_le_bytes());
            bytes.extend(vec![0; 8 * pictures as usize]);
        }
        bytes
    }

    #[test]
    fn binary_and_text_agree() {
        let folder = tempfile::tempdir().expect("a folder");
        let model = folder.path().join("sparse/0");
        std::fs::create_dir_all(&model).expect("made");
        let write =
            |name: &str, bytes: &[u8]| std::fs::write(model.join(name), bytes).expect("written");
        assert_eq!(read_sparse_points(folder.path()).expect("no model"), []);
        write("cameras.txt", b"");
        assert_eq!(read_sparse_points(folder.path()).expect("no points"), []);
        let points = [point(1.0, [1, 2, 3]), point(-4.0, [255, 0, 9])];
        write(
            "points3D.txt",
            b"# a comment\n1 1 2 -3.5 1 2 3 0.5 1 1 2 2\n\n9 -4 2 -3.5 255 0 9 0.1\n",
        );
        assert_eq!(read_sparse_points(folder.path()).expect("text"), points);
        write("points3D.txt", b"1 1 2 -3.5 1 2 3 0.5\n2 1 2 here 1 2 3\n");
        let error = read_sparse_points(folder.path())
            .expect_err("no number")
            .to_string();
        assert!(
            error.contains("points3D.txt") && error.contains("line 2"),
            "{error}"
        );
        // A binary model comes before one in text.
        write("cameras.bin", b"");
        let whole = binary(&[points[0], point(f64::NAN, [0; 3]), points[1]], 3);
        write("points3D.bin", &whole);
        assert_eq!(
            read_sparse_points(folder.path()).expect("binary"),
            points,
            "points that are not finite are dropped"
        );
        for end in [0, 4, 60, whole.len() - 1] {
            write("points3D.bin", &whole[..end]);
            assert!(
                read_sparse_points(folder.path()).is_err(),
                "cut off after {end} bytes"
            );
        }
        let mut endless = whole.clone();
        endless[..8].copy_from_slice(&u64::MAX.to_le_bytes());
        write("points3D.bin", &endless);
        assert!(
            read_sparse_points(folder.path()).is_err(),
            "the claimed count is not trusted"
        );
    }
}
