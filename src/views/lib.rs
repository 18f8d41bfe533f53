//! Registry of representations: how a file is opened as a [`View`], its settings, and the formats
//! that it can be exported to.
//!
//! A new representation is one [`Representation`] in [`all`]: `headbox render`, the window, the
//! report and the exports find it here. [`add`] registers one of another crate.
//!
//! | file | content |
//! |---|---|
//! | `truth` | comparison of a cube LDI with ray-traced truth of its scene |
//! | `reference` | the thread that traces truth for the current camera |
//! | `export` | pages, GLB, PLY and EXR of the built-in representations |

mod export;
mod reference;
#[cfg(test)]
mod tests;
mod truth;

pub use export::{ExportOptions, ExportSummary, Exporter, WriteView};
pub use reference::LitScene;
pub use truth::{OpenScene, TruthView};

use headbox_core::container::{Container, FileError, FileKind};
use headbox_core::view::{Setting, View};
use headbox_cube::pack::CubeLdi;
use headbox_export::ExportError;
use headbox_house::file::HouseFileError;
use headbox_house::view::HouseView;
use headbox_lumigraph::Slabs;
use headbox_lumigraph::view::LumigraphView;
use headbox_sprite::SpriteSet;
use headbox_sprite::view::LayersView;
use std::path::{Path, PathBuf};
use std::sync::{PoisonError, RwLock};

/// A representation with its own file format.
#[derive(Clone, Copy, Debug)]
pub struct Representation {
    /// Name, for messages: "cube LDI".
    pub name: &'static str,
    /// Extension of its files, without the dot.
    pub extension: &'static str,
    /// Tag in the header of its files, if they are containers of this project.
    pub tag: Option<[u8; 4]>,
    /// Opens a file.
    pub open: fn(&Path) -> Result<Box<dyn View>, ViewError>,
    /// Returns the settings of its views, with the initial values of most files.
    pub settings: fn() -> Vec<Setting>,
    /// Formats that its views can be exported to.
    pub exporters: &'static [Exporter],
}

/// Error of opening or exporting a view.
#[derive(Debug, thiserror::Error)]
pub enum ViewError {
    /// The file cannot be read.
    #[error(transparent)]
    File(#[from] FileError),
    /// The house cannot be read or shown.
    #[error(transparent)]
    House(#[from] HouseFileError),
    /// The file contains no sprites.
    #[error("{}: holds no sprites", .0.display())]
    NoSprites(PathBuf),
    /// The view could not be exported.
    #[error(transparent)]
    Export(#[from] ExportError),
    /// The export could not be written.
    #[error(transparent)]
    Write(#[from] std::io::Error),
    /// Another error, in one sentence.
    #[error("{0}")]
    Other(String),
}

const BUILT_IN: [Representation; 4] = [
    Representation {
        name: headbox_cube::view::KIND,
        extension: "ldi",
        tag: Some(FileKind::CUBE_LDI.tag),
        open: |path| Ok(Box::new(TruthView::new(CubeLdi::read(path)?))),
        settings: TruthView::setting_table,
        exporters: &export::CUBE,
    },
    Representation {
        name: headbox_sprite::view::KIND,
        extension: "sprite",
        tag: Some(FileKind::SPRITES.tag),
        open: |path| {
            let view = LayersView::from_sprites(SpriteSet::read(path)?);
            Ok(Box::new(
                view.ok_or_else(|| ViewError::NoSprites(path.into()))?,
            ))
        },
        settings: LayersView::sprite_settings,
        exporters: &export::SPRITES,
    },
    Representation {
        name: headbox_lumigraph::view::KIND,
        extension: "lumi",
        tag: Some(headbox_lumigraph::LUMI_FILE.tag),
        open: |path| Ok(Box::new(LumigraphView::new(Slabs::read(path)?))),
        settings: LumigraphView::setting_table,
        exporters: &export::LUMIGRAPH,
    },
    Representation {
        name: headbox_house::view::KIND,
        extension: "house",
        tag: Some(FileKind::HOUSE.tag),
        open: |path| Ok(Box::new(HouseView::read(path)?)),
        settings: HouseView::setting_table,
        exporters: &export::HOUSE,
    },
];

/// Registered representations of other crates.
static ADDED: RwLock<Vec<Representation>> = RwLock::new(Vec::new());

/// Returns all representations: the built-in ones, then those of [`add`].
pub fn all() -> Vec<Representation> {
    let added = ADDED.read().unwrap_or_else(PoisonError::into_inner);
    BUILT_IN.into_iter().chain(added.iter().copied()).collect()
}

/// Registers a representation, for every command that runs later in this process.
pub fn add(representation: Representation) {
    let mut added = ADDED.write().unwrap_or_else(PoisonError::into_inner);
    added.push(representation);
}

/// Finds the representation of a file: by the tag in its header, else by its extension. `None` if
/// its kind is unknown.
pub fn find(path: &Path) -> Option<Representation> {
    let tag = Container::peek_kind(path).ok().flatten();
    let extension = path.extension().unwrap_or_default().to_ascii_lowercase();
    let mut all = all().into_iter();
    match tag {
        Some(tag) => all.find(|representation| representation.tag == Some(tag)),
        None => all.find(|representation| extension == representation.extension),
    }
}
