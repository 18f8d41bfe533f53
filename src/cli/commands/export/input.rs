//! Input files of `headbox export`, by kind.

use crate::commands::house::file::first_view;
use anyhow::{Context, bail};
use headbox_core::camera::Camera;
use headbox_core::container::{Container, FileKind};
use headbox_cube::pack::CubeLdi;
use headbox_export::page::Page;
use headbox_export::{ExportError, of_sprites};
use headbox_house::file;
use headbox_house::file::HOUSE_FILE;
use headbox_house::house::House;
use headbox_lumigraph::{LUMI_FILE, Lumigraph, Slabs};
use headbox_sprite::{SPRITE_FILE, SpriteSet};
use std::path::Path;

/// Input of an export.
pub(crate) enum ExportInput {
    /// A cube LDI.
    Cube(Box<CubeLdi>),
    /// Sprites with depth.
    Sprites(Box<SpriteSet>),
    /// A house, and how it is seen first.
    House(Box<House>, Camera),
    /// A layered lumigraph.
    Lumigraph(Box<Lumigraph>),
}

impl ExportInput {
    /// Opens a file; of other files of ours it is said what can be exported.
    pub(crate) fn open(path: &Path) -> anyhow::Result<Self> {
        let found = Container::peek_kind(path).ok().flatten();
        let kind = found.and_then(|tag| FileKind::ALL.iter().find(|kind| kind.tag == tag));
        match kind {
            Some(kind) if kind.tag == SPRITE_FILE.tag => {
                Ok(Self::Sprites(Box::new(SpriteSet::read(path)?)))
            }
            Some(kind) if kind.tag == HOUSE_FILE.tag => {
                // A page shows no backdrop.
                let (house, _, _) = file::read(path, 0)?;
                let first = first_view(&house)?;
                Ok(Self::House(Box::new(house), first))
            }
            Some(kind) if kind.tag == LUMI_FILE.tag => {
                let slabs = Slabs::read(path)?;
                let (file, count) = (path.display(), slabs.all().len());
                let single = slabs.into_single().with_context(|| {
                    format!(
                        "{file} has {count} light slabs, and a page shows one; capture it without --slabs for a page"
                    )
                })?;
                Ok(Self::Lumigraph(Box::new(single)))
            }
            Some(kind) if kind.tag != FileKind::CUBE_LDI.tag => {
                bail!(
                    "{} is a {}, which cannot be exported; what can be rendered can (.ldi, .sprite, .house, .lumi)",
                    path.display(),
                    kind.name
                )
            }
            _ => Ok(Self::Cube(Box::new(CubeLdi::read(path)?))),
        }
    }

    /// The cube, of sprites one that shows what they show; of anything else it is said that only
    /// pages are made of it.
    pub(super) fn cube(self, path: &Path) -> anyhow::Result<CubeLdi> {
        match self {
            Self::Cube(cube) => Ok(*cube),
            Self::Sprites(set) => {
                of_sprites::cube(&set).with_context(|| path.display().to_string())
            }
            Self::House(..) => bail!(
                "{} is a house, which is exported as a page (.html) alone",
                path.display()
            ),
            Self::Lumigraph(..) => {
                bail!(
                    "{} is a lumigraph, which is exported as a page (.html) alone",
                    path.display()
                )
            }
        }
    }

    pub(crate) fn page(&self, name: &str) -> Result<Page, ExportError> {
        match self {
            Self::Cube(cube) => Page::new(cube, name),
            Self::Sprites(set) => Page::of_sprites(set, name),
            Self::House(house, first) => Page::of_house(house, first, name),
            Self::Lumigraph(lumigraph) => Page::of_lumigraph(lumigraph, name),
        }
    }

    /// Number of primitives, and their name.
    pub(crate) fn amount(&self) -> (u64, &'static str) {
        match self {
            Self::Cube(cube) => (cube.depth_pixel_count() as u64, "depth pixels"),
            Self::Sprites(set) => (set.sprites().len() as u64, "sprites"),
            Self::House(house, _) => (house.scene().triangles.len() as u64, "triangles"),
            Self::Lumigraph(lumigraph) => (lumigraph.pictures().len() as u64, "images"),
        }
    }
}
