//! Image sets for tests.

use crate::{ImageSet, ImageSetOptions, LoadedView, View, write_set};
use image::RgbaImage;
use std::path::Path;

/// Writes the views' images as a nerfstudio set without depth in `folder`, and opens it.
pub(crate) fn photographs(folder: &Path, views: impl IntoIterator<Item = LoadedView>) -> ImageSet {
    let source = folder.join("source");
    std::fs::create_dir_all(&source).expect("a folder");
    let save = |(i, view): (usize, LoadedView)| {
        let name = format!("{i}.png");
        let [width, height] = view.size_px;
        let color = source.join(&name);
        let bytes = view.color.into_flattened();
        RgbaImage::from_raw(width, height, bytes)
            .expect("a picture")
            .save(&color)
            .expect("written");
        View::new(name, view.size_px, view.lens, view.pose, color, None)
    };
    let views: Vec<View> = views.into_iter().enumerate().map(save).collect();
    write_set(&views, folder, &mut |_| {}).expect("written");
    ImageSet::open(folder, &ImageSetOptions::default()).expect("a set")
}
