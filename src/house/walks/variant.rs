//! Named variants of rendering a walk, for the command line and the reports.

use super::settings::WalkSettings;
use crate::backdrop::BackdropKind;
use crate::store::Store;
use headbox_cube::render::RenderSettings;
use headbox_cube::render::footprint::splat::SplatKernel;

/// A variant of rendering a walk.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct HouseVariant {
    /// Name of the variant.
    pub name: &'static str,
    /// Kind of backdrop; `None` for geometry alone.
    pub kind: Option<BackdropKind>,
    /// Splat kernel of layered depth images.
    pub kernel: SplatKernel,
    /// True if holes keep the colour of the last frame (R8).
    pub persistence: bool,
}

impl HouseVariant {
    /// All variants: culled geometry; each kind of backdrop; one warped image over the last frame
    /// (R8); the 13-image LDI with the fixed stamps of R7 instead of footprints of the samples'
    /// sizes; and the window LDI with opaque rectangles of those sizes.
    pub const ALL: [Self; 16] = [
        Self {
            name: "geometry",
            kind: None,
            kernel: SplatKernel::Tent,
            persistence: false,
        },
        Self::with_backdrops(BackdropKind::Texture),
        Self::with_backdrops(BackdropKind::Textures),
        Self::with_backdrops(BackdropKind::Image),
        Self {
            name: "persistence",
            persistence: true,
            ..Self::with_backdrops(BackdropKind::Image)
        },
        Self::with_backdrops(BackdropKind::TwoImages),
        Self::with_backdrops(BackdropKind::Ldi),
        Self::with_backdrops(BackdropKind::LdiColorsApart),
        Self::with_backdrops(BackdropKind::LdiAverage),
        Self::with_kernel("ldi-plus", BackdropKind::Ldi, SplatKernel::Plus),
        Self::with_kernel("ldi-2x2", BackdropKind::Ldi, SplatKernel::Square2),
        Self::with_kernel("ldi-3x3", BackdropKind::Ldi, SplatKernel::Square3),
        Self::with_backdrops(BackdropKind::WindowLdi),
        Self::with_kernel(
            "window-ldi-opaque",
            BackdropKind::WindowLdi,
            SplatKernel::Opaque,
        ),
        Self::with_backdrops(BackdropKind::CellLdi),
        Self::with_backdrops(BackdropKind::Sprite),
    ];

    const fn with_backdrops(kind: BackdropKind) -> Self {
        Self::with_kernel(kind.name(), kind, SplatKernel::Tent)
    }

    const fn with_kernel(name: &'static str, kind: BackdropKind, kernel: SplatKernel) -> Self {
        Self {
            name,
            kind: Some(kind),
            kernel,
            persistence: false,
        }
    }

    /// Returns the variant for the backdrops in a store (the first kind of several), or geometry
    /// alone if it is empty.
    pub fn for_store(store: &Store) -> Self {
        store
            .all()
            .first()
            .map_or(Self::ALL[0], |((_, kind), _)| Self::with_backdrops(*kind))
    }

    /// Returns the variant with a name.
    pub fn by_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|variant| variant.name == name)
    }

    /// Returns all names, separated by commas.
    pub fn names() -> String {
        Self::ALL.map(|variant| variant.name).join(", ")
    }

    /// Returns the settings of a walk.
    pub fn settings(self) -> WalkSettings {
        WalkSettings {
            backdrops: self.kind,
            persistence: self.persistence,
            warp: RenderSettings {
                kernel: self.kernel,
                ..RenderSettings::default()
            },
            ..WalkSettings::default()
        }
    }
}
