//! Ways to draw a walk, by the names under which the command line and the reports know them.

use super::backdrop::BackdropKind;
use super::settings::WalkSettings;
use super::store::Store;
use headbox_cube::render::RenderSettings;
use headbox_cube::render::footprint::splat::SplatKernel;

/// A way to draw a walk.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct HouseVariant {
    /// Its name.
    pub name: &'static str,
    /// Kind of backdrop; `None` for geometry alone.
    pub kind: Option<BackdropKind>,
    /// The footprints of layered depth images.
    pub kernel: SplatKernel,
    /// Holes keep what the last frame had there (R8).
    pub persistence: bool,
}

impl HouseVariant {
    /// All ways: culled geometry; each backdrop; one warped image over the frame before (R8); and
    /// the 13-image LDI with the fixed stamps of R7 in place of footprints of the samples' sizes;
    /// and the window LDI with opaque rectangles of those sizes.
    pub const ALL: [Self; 16] = [
        Self {
            name: "geometry",
            kind: None,
            ..Self::PLAIN
        },
        Self::of(BackdropKind::Texture),
        Self::of(BackdropKind::Textures),
        Self::of(BackdropKind::Image),
        Self {
            name: "persistence",
            kind: Some(BackdropKind::Image),
            persistence: true,
            ..Self::PLAIN
        },
        Self::of(BackdropKind::TwoImages),
        Self::of(BackdropKind::Ldi),
        Self::of(BackdropKind::LdiColorsApart),
        Self::of(BackdropKind::LdiAverage),
        Self {
            name: "ldi-plus",
            kind: Some(BackdropKind::Ldi),
            kernel: SplatKernel::Plus,
            ..Self::PLAIN
        },
        Self {
            name: "ldi-2x2",
            kind: Some(BackdropKind::Ldi),
            kernel: SplatKernel::Square2,
            ..Self::PLAIN
        },
        Self {
            name: "ldi-3x3",
            kind: Some(BackdropKind::Ldi),
            kernel: SplatKernel::Square3,
            ..Self::PLAIN
        },
        Self::of(BackdropKind::WindowLdi),
        Self {
            name: "window-ldi-opaque",
            kind: Some(BackdropKind::WindowLdi),
            kernel: SplatKernel::Opaque,
            ..Self::PLAIN
        },
        Self::of(BackdropKind::CellLdi),
        Self::of(BackdropKind::Sprite),
    ];

    const PLAIN: Self = Self {
        name: "",
        kind: None,
        kernel: SplatKernel::Tent,
        persistence: false,
    };

    const fn of(kind: BackdropKind) -> Self {
        Self {
            name: kind.name(),
            kind: Some(kind),
            ..Self::PLAIN
        }
    }

    /// The one that draws what a store holds (of several kinds, the first), or geometry alone if it
    /// is empty.
    pub fn of_store(store: &Store) -> Self {
        store
            .all()
            .first()
            .map_or(Self::ALL[0], |((_, kind), _)| Self::of(*kind))
    }

    /// The one with a name.
    pub fn by_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|variant| variant.name == name)
    }

    /// The names of all, with commas between them.
    pub fn names() -> String {
        Self::ALL.map(|variant| variant.name).join(", ")
    }

    /// The settings of a walk that is drawn so.
    pub fn settings(self) -> WalkSettings {
        let warp = RenderSettings {
            kernel: self.kernel,
            ..RenderSettings::default()
        };
        WalkSettings {
            backdrops: self.kind,
            persistence: self.persistence,
            warp,
            ..WalkSettings::default()
        }
    }
}
