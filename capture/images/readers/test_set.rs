//! Image sets made for tests.

use crate::{ImageSet, ImageSetOptions, LoadedView, View, write_set};
use image::RgbaImage;
use std::path::Path;

/// A set of these views' pictures in a folder, without depth, in a format of other programs.
pub(crate) fn photographs(folder: &Path, views: impl IntoIterator<Item = LoadedView>) -> ImageSet {
    let given = folder.join("given");
    std::fs::create_dir_all(&given).expect("a folder");
    let saved = |(i, view): (usize, LoadedView)| {
        let (name, [width, height]) = (format!("{i}.png"), view.size_px);
        let (color, bytes) = (given.join(&name), view.color.into_flattened());
        RgbaImage::from_raw(width, height, bytes)
            .expect("a picture")
            .save(&color)
            .expect("written");
        View {
            name,
            size_px: view.size_px,
            lens: view.lens,
            pose: view.pose,
            color,
            depth: None,
            mask: None,
            depth_scale: 1.0,
            color_channels: None,
            registration: None,
        }
    };
    let views: Vec<View> = views.into_iter().enumerate().map(saved).collect();
    write_set(&views, folder, &mut |_| {}).expect("written");
    ImageSet::open(folder, &ImageSetOptions::default()).expect("a set")
}
