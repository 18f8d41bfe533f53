//! Exports of the built-in representations.

use crate::{TruthView, ViewError};
use headbox_core::progress::Progress;
use headbox_core::view::View;
use headbox_cube::pack::CubeLdi;
use headbox_export::deep::{self, DeepSummary, Faces};
use headbox_export::from_sprites;
use headbox_export::mesh::glb::{self, GlbBudget, GlbSummary};
use headbox_export::page::Page;
use headbox_export::points::{PointBudget, PointSummary, ply, splats, splats_glb};
use headbox_house::view::HouseView;
use headbox_house::walk_path::WalkPath;
use headbox_lumigraph::view::LumigraphView;
use headbox_sprite::SpriteSet;
use headbox_sprite::view::LayersView;
use std::any::{Any, type_name};
use std::borrow::Cow;
use std::io::Write;

/// A file format that a view can be exported to.
#[derive(Clone, Copy, Debug)]
pub struct Exporter {
    /// Extension of the file, without the dot.
    pub extension: &'static str,
    /// Writes the file.
    pub write: WriteView,
}

/// Function that exports a view.
pub type WriteView = fn(
    &dyn View,
    &ExportOptions,
    &dyn Progress,
    &mut dyn Write,
) -> Result<ExportSummary, ViewError>;

/// Options of exports; a format ignores those of other formats.
#[derive(Clone, Debug)]
pub struct ExportOptions {
    /// Title of a page.
    pub title: String,
    /// Maximum number of triangles of a `.glb`.
    pub triangles: u64,
    /// Gaussians instead of triangles in a `.glb`.
    pub has_gaussians: bool,
    /// Maximum number of Gaussians of a `.glb` or `.ply`, or of points of a `.ply`.
    pub gaussians: Option<u64>,
    /// Maximum size of a `.glb` or `.ply`, bytes.
    pub bytes: Option<u64>,
    /// Plain points instead of Gaussians in a `.ply`.
    pub points: bool,
    /// Number of flat layers of an `.exr`; `None` for deep data.
    pub layers: Option<usize>,
    /// Faces in an `.exr`.
    pub faces: Faces,
}

/// Summary of an export.
#[derive(Clone, Debug, Default)]
pub struct ExportSummary {
    /// Description printed after the size of the file, or "".
    pub details: String,
    /// Figures by name, for JSON.
    pub figures: Vec<(&'static str, serde_json::Value)>,
    /// Warnings about data that the file lacks, one sentence each.
    pub warnings: Vec<String>,
}

pub(super) const CUBE: [Exporter; 4] = cube_exporters(|view, options, progress, to| {
    Page::new(cube(view)?.as_ref(), &options.title, progress)?.write(to)?;
    Ok(ExportSummary::default())
});

pub(super) const SPRITES: [Exporter; 4] = cube_exporters(|view, options, progress, to| {
    Page::from_sprites(sprites(view)?, &options.title, progress)?.write(to)?;
    Ok(ExportSummary::default())
});

pub(super) const LUMIGRAPH: [Exporter; 1] = [Exporter {
    extension: "html",
    write: |view, options, progress, to| {
        let slabs = downcast::<LumigraphView>(view)?.slabs();
        let [single] = slabs.all() else {
            return Err(ViewError::Other(format!(
                "the lumigraph has {} light slabs, and a page shows one; capture it without --slabs for a page",
                slabs.all().len()
            )));
        };
        Page::from_lumigraph(single, &options.title, progress)?.write(to)?;
        Ok(ExportSummary::default())
    },
}];

/// Exporters of houses: pages, without backdrops.
pub(super) const HOUSE: [Exporter; 1] = [Exporter {
    extension: "html",
    write: |view, options, progress, to| {
        let house = downcast::<HouseView>(view)?.house();
        let first =
            WalkPath::first_view(house).map_err(|error| ViewError::Other(error.to_string()))?;
        Page::from_house(house, &first, &options.title, progress)?.write(to)?;
        Ok(ExportSummary::default())
    },
}];

/// Exporters of representations that are, or can be converted to, a cube LDI.
const fn cube_exporters(page: WriteView) -> [Exporter; 4] {
    [
        Exporter {
            extension: "html",
            write: page,
        },
        Exporter {
            extension: "glb",
            write: write_glb,
        },
        Exporter {
            extension: "ply",
            write: write_ply,
        },
        Exporter {
            extension: "exr",
            write: write_exr,
        },
    ]
}

fn write_glb(
    view: &dyn View,
    options: &ExportOptions,
    progress: &dyn Progress,
    to: &mut dyn Write,
) -> Result<ExportSummary, ViewError> {
    if options.has_gaussians {
        let cube = cube(view)?;
        let summary = splats_glb::write(&cube, point_budget(options), progress, to)?;
        return Ok(describe_points("Gaussians", Y_UP, summary));
    }
    let budget = GlbBudget {
        triangles: options.triangles,
        bytes: options.bytes,
    };
    let GlbSummary {
        triangles,
        error_px,
        dropped_samples,
        texel_px,
    } = glb::write(cube(view)?.as_ref(), budget, progress, to)?;
    let warning = format!(
        "{dropped_samples} samples, in the smallest pieces of surfaces, are left out to stay within the budget; give more \
         --triangles or --mb, or capture with a smaller --face-size"
    );
    let textures = if texel_px > 1.0 {
        format!(", texels {texel_px:.1} face pixels wide")
    } else {
        String::new()
    };
    Ok(ExportSummary {
        details: format!(
            ", {triangles} triangles, {Y_UP}, samples off by up to {error_px:.1} face pixels{textures}"
        ),
        figures: vec![
            ("triangles", triangles.into()),
            ("error_px", error_px.into()),
            ("dropped_samples", dropped_samples.into()),
            ("texel_px", texel_px.into()),
        ],
        warnings: (dropped_samples > 0)
            .then_some(warning)
            .into_iter()
            .collect(),
    })
}

fn write_ply(
    view: &dyn View,
    options: &ExportOptions,
    progress: &dyn Progress,
    to: &mut dyn Write,
) -> Result<ExportSummary, ViewError> {
    let cube = cube(view)?;
    let budget = point_budget(options);
    if options.points {
        let summary = ply::write_points(&cube, budget, progress, to)?;
        return Ok(describe_points("points", Y_UP, summary));
    }
    let summary = splats::write_ply(&cube, budget, progress, to)?;
    let axes = "Y down and Z ahead as trained splats, in metres from the headbox";
    Ok(describe_points("Gaussians", axes, summary))
}

/// Returns the budget of a file of points.
fn point_budget(options: &ExportOptions) -> PointBudget {
    PointBudget {
        points: options.gaussians,
        bytes: options.bytes,
    }
}

/// Axes and unit of files that lie at their place in the scene.
const Y_UP: &str = "Y up, in metres";

/// Describes a file of points.
fn describe_points(kind: &str, axes: &str, summary: PointSummary) -> ExportSummary {
    let PointSummary {
        points,
        samples,
        dropped_samples,
        error_levels,
    } = summary;
    let reduced = if points < samples {
        format!(" of {samples} samples, colours off by {error_levels:.1} levels (RMS, estimated)")
    } else {
        String::new()
    };
    let warning = format!(
        "{dropped_samples} samples, those that the headbox sees least, are left out to stay within the budget; give more \
         --gaussians or --mb"
    );
    ExportSummary {
        details: format!(", {points} {kind}{reduced}, {axes}"),
        figures: vec![
            ("points", points.into()),
            ("samples", samples.into()),
            ("dropped_samples", dropped_samples.into()),
            ("error_levels", error_levels.into()),
        ],
        warnings: (dropped_samples > 0)
            .then_some(warning)
            .into_iter()
            .collect(),
    }
}

fn write_exr(
    view: &dyn View,
    options: &ExportOptions,
    progress: &dyn Progress,
    to: &mut dyn Write,
) -> Result<ExportSummary, ViewError> {
    let cube = cube(view)?;
    let DeepSummary {
        samples,
        size_px: [width, height],
    } = match options.layers {
        Some(layers) => deep::write_layers(&cube, options.faces, layers, progress, to)?,
        None => deep::write(&cube, options.faces, progress, to)?,
    };
    let layers = options
        .layers
        .map_or_else(|| "deep".into(), |layers| format!("{layers} layers"));
    Ok(ExportSummary {
        details: format!(", {width}x{height}, {layers}, of {samples} samples"),
        figures: vec![
            ("samples", samples.into()),
            ("size", vec![width, height].into()),
        ],
        warnings: Vec::new(),
    })
}

/// Downcasts a view to the type of its representation.
fn downcast<V: View>(view: &dyn View) -> Result<&V, ViewError> {
    let view: &dyn Any = view;
    view.downcast_ref()
        .ok_or_else(|| ViewError::Other(format!("the view is not a {}", type_name::<V>())))
}

fn sprites(view: &dyn View) -> Result<&SpriteSet, ViewError> {
    Ok(downcast::<LayersView>(view)?.layers().sprites())
}

/// Returns the cube LDI of a view; converts sprites to one.
fn cube(view: &dyn View) -> Result<Cow<'_, CubeLdi>, ViewError> {
    if let Ok(view) = downcast::<TruthView>(view) {
        return Ok(Cow::Borrowed(view.cube()));
    }
    Ok(Cow::Owned(from_sprites::cube(sprites(view)?)?))
}
