//! Several files of one world, composed in one frame: for `render` and `view`.

use super::polygons::PolygonsArg;
use crate::commands::images::{self, is_image_set};
use crate::image_set::SetArgs;
use crate::progress::Bar;
use anyhow::bail;
use headbox_core::container::Container;
use headbox_cube::pack::CubeLdi;
use headbox_cube::view::CubeView;
use headbox_house::file::HOUSE_FILE;
use headbox_lumigraph::LUMI_FILE;
use headbox_sprite::compose::Composition;
use headbox_sprite::view::{LayersStart, LayersView};
use headbox_sprite::{SPRITE_FILE, SpriteSet};
use std::path::{Path, PathBuf};

/// Opens several files of one world as a composition. Axes, unit and camera are those of the first
/// file that is not a model.
pub(crate) fn open(files: &[PathBuf], images: &SetArgs) -> anyhow::Result<LayersView> {
    let (mut cubes, mut sprites, mut models) = (Vec::new(), None::<SpriteSet>, Vec::new());
    let mut start = None;
    for file in files {
        if let Some(model) = PolygonsArg::parse(file)? {
            models.push(model);
            continue;
        }
        let kind = Container::peek_kind(file).ok().flatten();
        if kind == Some(SPRITE_FILE.tag) {
            let set = SpriteSet::read(file)?;
            let Some(first) = LayersView::start_of_sprites(&set) else {
                bail!("{}: holds no sprites", file.display())
            };
            start.get_or_insert(first);
            match &mut sprites {
                None => sprites = Some(set),
                Some(sprites) => sprites.append(set),
            }
            continue;
        }
        let others = [HOUSE_FILE, LUMI_FILE];
        if let Some(other) = others.iter().find(|other| kind == Some(other.tag)) {
            bail_usage!(
                "{}: a {} is rendered alone, without other files",
                file.display(),
                other.name
            );
        }
        let cube = if is_image_set(&file.to_string_lossy()) {
            cube_of_folder(file, images)?
        } else {
            CubeLdi::read(file)?
        };
        start.get_or_insert_with(|| LayersStart {
            view: CubeView::default_view(&cube),
            size_px: [1024, 768],
            file_frame: cube.info.frame,
        });
        cubes.push(cube);
    }
    let Some(start) = start else {
        let name = files.first().map(|file| file.display().to_string());
        bail!(
            "{}: is a scene: capture it first, or name a .ldi or .sprite file for it to stand among",
            name.unwrap_or_default()
        )
    };
    let polygons = models
        .iter()
        .map(|model| model.open(&start.file_frame, cubes.first(), images.strict))
        .collect::<Result<Vec<_>, _>>()?;
    let sprites = sprites.unwrap_or_else(|| SpriteSet::new(Vec::new()));
    let layers = Composition::new(sprites, cubes).with_polygons(polygons);
    Ok(LayersView::from_layers(layers, start))
}

/// Captures the cube LDI of a folder of images.
pub(crate) fn cube_of_folder(folder: &Path, images: &SetArgs) -> anyhow::Result<CubeLdi> {
    let bar = Bar::new();
    let cube = images::cube_from_folder(folder, images, &bar)?;
    bar.finish();
    Ok(cube)
}
