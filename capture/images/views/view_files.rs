//! Files of a view whose resolution or orientation differs from that of the set.

use crate::ImagesError;
use crate::cameras::lens::Lens;
use crate::depth::has_proportions;
use crate::views::color_images::read_size;
use crate::views::view::View;
use headbox_core::depth_kind::DepthKind;
use headbox_core::image::orientation::{self, Orientation};

impl View {
    /// Returns the turn by the EXIF orientation of an image that is stored on its side, if the
    /// set's size is that of the upright image. An image that has the set's size is read as stored.
    pub(crate) fn upright_turn(&self, stored: [u32; 2]) -> Option<Orientation> {
        let [width, height] = self.file_size_px();
        if stored == [width, height] || stored != [height, width] {
            return None;
        }
        Some(orientation::read(&self.color)).filter(|turn| orientation::swaps_sides(*turn))
    }

    /// Reads depth at the image's pixels, as multiples of [`Lens::ray`]; empty without depth.
    pub(crate) fn load_depth(&self) -> Result<Vec<f32>, ImagesError> {
        let Some(source) = &self.depth else {
            return Ok(Vec::new());
        };
        let picture = source.read()?;
        // Estimated depth belongs to the rectified view.
        let size_px = if self.has_own_depth() {
            self.file_size_px()
        } else {
            self.size_px
        };
        let size = [picture.width, picture.height];
        let turned = self.depth_turn(size)?.map(|turn| picture.turned(turn));
        let fitted = turned
            .as_ref()
            .unwrap_or(&picture)
            .resampled(size_px, false);
        let mut picture = fitted.ok_or_else(|| {
            let [w, h] = size_px;
            let window = match crate::depth::extension(&source.path).as_str() {
                "exr" => " (its display window)",
                _ => "",
            };
            let cause = format!(
                "is {}x{} pixels{window}, but its image is {w}x{h}; depth of another resolution must have the image's \
                 proportions",
                size[0], size[1]
            );
            ImagesError::invalid_picture(&source.path, cause)
        })?;
        for (y, row) in picture
            .values
            .chunks_exact_mut(size_px[0] as usize)
            .enumerate()
        {
            for (x, depth) in row.iter_mut().enumerate() {
                let scale = match (source.kind, self.lens) {
                    // Converts distance along the ray to a multiple of the ray (C24).
                    (DepthKind::RayDistance, Lens::Pinhole(lens)) if self.source.is_none() => {
                        (1.0 / lens.distorted_ray_length([x as f64 + 0.5, y as f64 + 0.5])) as f32
                    }
                    _ => 1.0,
                };
                *depth *= scale * self.depth_scale;
            }
        }
        Ok(picture.values)
    }

    /// Returns the turn that brings depth of a size onto the image if one of them is stored on its
    /// side and the other is upright, by the EXIF orientation of the image.
    pub(crate) fn depth_turn(
        &self,
        [width, height]: [u32; 2],
    ) -> Result<Option<Orientation>, ImagesError> {
        let file_size_px = self.file_size_px();
        if has_proportions([width, height], file_size_px)
            || !has_proportions([height, width], file_size_px)
        {
            return Ok(None);
        }
        let turn = orientation::read(&self.color);
        if !orientation::swaps_sides(turn) {
            return Ok(None);
        }
        let is_stored = read_size(&self.color)? == file_size_px;
        Ok(Some(if is_stored {
            orientation::inverse(turn)
        } else {
            turn
        }))
    }
}

#[cfg(test)]
mod tests {
    use crate::{ImageSet, ImageSetOptions, LoadedView};
    use image::codecs::png::PngEncoder;
    use image::{ExtendedColorType, ImageBuffer, ImageEncoder, Luma};
    use serde_json::json;

    /// Loads a view of an image of 4x2 pixels whose red level is 10 x + y if it is upright, stored
    /// with EXIF orientation 6 (or 8), and its depth of 1000 + red level millimetres; also returns
    /// the notes.
    fn load(tag: u8, size: Option<[u32; 2]>, depth_is_upright: bool) -> (LoadedView, String) {
        let folder = tempfile::tempdir().expect("a folder");
        // Upright 2 columns, 4 rows; stored 4 columns, 2 rows: of orientation 6, column = row and
        // row = 1 - column; 8 is turned by 180 degrees against it.
        let upright = |x: u32, y: u32| (10 * x + y) as u8;
        let stored = |x: u32, y: u32| match tag {
            8 => upright(y, 3 - x),
            _ => upright(1 - y, x),
        };
        let pixels: Vec<u8> = (0..8).flat_map(|i| [stored(i % 4, i / 4), 0, 0]).collect();
        let mut exif = *b"II*\0\x08\0\0\0\x01\0\x12\x01\x03\0\x01\0\0\0\x06\0\0\0\0\0\0\0";
        exif[18] = tag;
        let mut file = Vec::new();
        let mut encoder = PngEncoder::new(&mut file);
        encoder.set_exif_metadata(exif.to_vec()).expect("supported");
        encoder
            .write_image(&pixels, 4, 2, ExtendedColorType::Rgb8)
            .expect("fits");
        std::fs::write(folder.path().join("a.png"), file).expect("written");
        let [width, height] = if depth_is_upright { [2, 4] } else { [4, 2] };
        let level = |x, y| {
            if depth_is_upright {
                upright(x, y)
            } else {
                stored(x, y)
            }
        };
        let depth = |x, y| Luma([1000 + u16::from(level(x, y))]);
        ImageBuffer::<Luma<u16>, Vec<u16>>::from_fn(width, height, depth)
            .save(folder.path().join("d.png"))
            .expect("written");
        let pose = [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]];
        let frame = json!({"file_path": "a.png", "depth_path": "d.png", "transform_matrix": pose});
        let mut set = json!({"fl_x": 4, "cx": 1, "cy": 2, "frames": [frame]});
        if let Some([w, h]) = size {
            set = json!({"fl_x": 4, "w": w, "h": h, "frames": set["frames"]});
        }
        std::fs::write(folder.path().join("transforms.json"), set.to_string()).expect("written");
        let set = ImageSet::open(folder.path(), &ImageSetOptions::default()).expect("opens");
        (set.views[0].load().expect("loads"), set.notes.join("\n"))
    }

    #[test]
    fn exif_orientation_follows_the_size_of_the_set() {
        for depth_is_upright in [false, true] {
            // Without a size, the principal point shows the orientation.
            for (size, is_upright) in [(Some([2, 4]), true), (Some([4, 2]), false), (None, true)] {
                let (view, notes) = load(6, size, depth_is_upright);
                let expected = |i: u32| {
                    if is_upright {
                        10 * (i % 2) + i / 2
                    } else {
                        10 * (1 - i / 4) + i % 4
                    }
                };
                for i in 0..8 {
                    let red = u32::from(view.color[i as usize][0]);
                    assert_eq!(red, expected(i), "{size:?} {i}");
                    let millimetres = (view.depth[i as usize] * 1000.0).round() as u32;
                    assert_eq!(
                        millimetres,
                        1000 + expected(i),
                        "{size:?} {depth_is_upright} {i}"
                    );
                }
                assert_eq!(notes.contains("turned upright"), is_upright, "{notes}");
                assert_eq!(notes.contains("read as stored"), !is_upright, "{notes}");
                let has_turned_depth = is_upright != depth_is_upright;
                assert_eq!(
                    notes.contains("turned like its image"),
                    has_turned_depth,
                    "{notes}"
                );
            }
        }
    }

    #[test]
    fn exif_orientation_8_turns_the_other_way() {
        for depth_is_upright in [false, true] {
            let (view, notes) = load(8, Some([2, 4]), depth_is_upright);
            for i in 0..8 {
                let expected = 10 * (i % 2) + i / 2;
                assert_eq!(u32::from(view.color[i as usize][0]), expected, "{i}");
                let millimetres = (view.depth[i as usize] * 1000.0).round() as u32;
                assert_eq!(millimetres, 1000 + expected, "{depth_is_upright} {i}");
            }
            assert!(notes.contains("turned upright"), "{notes}");
        }
    }

    /// The size does not show whether an image stored upside down was posed so.
    #[test]
    fn image_upside_down_is_read_as_stored_and_noted() {
        let (view, notes) = load(3, Some([4, 2]), false);
        for i in 0..8 {
            let red = u32::from(view.color[i as usize][0]);
            assert_eq!(red, 10 * (1 - i / 4) + i % 4, "{i}");
        }
        assert!(
            notes.contains("1 of 1 images have an EXIF orientation"),
            "{notes}"
        );
        assert!(notes.contains("read as stored"), "{notes}");
    }
}
