//! View-dependent geometry of image sets, instead of a cube LDI.

use crate::commands::images::views_with_depth;
use crate::image_set::SetArgs;
use crate::output::print_notes;
use crate::progress::Bar;
use clap::Args;
use glam::DVec3;
use headbox_core::camera::Camera;
use headbox_images::ImageSet;
use headbox_photos::cache;
use headbox_photos::view_geometry::view::GeometryView;
use headbox_photos::view_geometry::{
    GeometryResources, GeometrySettings, SampleGrid, Texturing, ViewGeometry,
};
use std::path::{Path, PathBuf};

/// Message for options of view-dependent geometry without its variant.
pub(crate) const GEOMETRY_ALONE: &str = "--cameras, --grid, --sample-spacing, --lod and --pictures-memory are for --variant geometry-blended and its kin (-averaged, -multi, \
     -single, -nearest), of a folder of images with depth";

/// Options of view-dependent geometry.
#[derive(Args, Clone)]
pub(crate) struct GeometryArgs {
    /// View-dependent geometry: number of cameras whose depth samples make a frame, 1 to 1000; 10
    /// by default
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1000))]
    cameras: Option<u16>,
    /// View-dependent geometry: spacing of the nodes of a frame's mesh, pixels, 1 to 256; 5 by
    /// default
    #[arg(long, value_name = "PX", value_parser = clap::value_parser!(u16).range(1..=256))]
    grid: Option<u16>,
    /// View-dependent geometry: level of detail of the depth samples, 0 to 3, each with a quarter
    /// of the samples of the one before; 0 by default
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(0..=3))]
    lod: Option<u32>,
    #[command(flatten)]
    pub(crate) resources: GeometryResourceArgs,
}

/// Resources of view-dependent geometry.
#[derive(Args, Clone)]
pub(crate) struct GeometryResourceArgs {
    /// View-dependent geometry: spacing of the samples of a depth image, pixels, 1 to 256; 3 by
    /// default
    #[arg(long, value_name = "PX", value_parser = clap::value_parser!(u16).range(1..=256))]
    sample_spacing: Option<u16>,
    /// View-dependent geometry: memory for images, MiB; 1024 by default
    #[arg(long, value_name = "MIB", value_parser = clap::value_parser!(u32).range(1..))]
    pictures_memory: Option<u32>,
}

impl GeometryArgs {
    /// Returns true if any of these options was given.
    #[cfg(feature = "viewer")]
    pub(crate) fn are_given(&self) -> bool {
        let numbers = [self.cameras, self.grid];
        numbers.iter().any(Option::is_some) || self.lod.is_some() || self.resources.are_given()
    }

    /// Settings of a frame.
    pub(crate) fn settings(&self) -> GeometrySettings {
        let default = GeometrySettings::default();
        GeometrySettings {
            cameras: self.cameras.map_or(default.cameras, usize::from),
            grid_px: self.grid.map_or(default.grid_px, f32::from),
            level: self.lod.unwrap_or(default.level),
            ..default
        }
    }
}

impl GeometryResourceArgs {
    /// Returns true if any of these options was given.
    pub(crate) fn are_given(&self) -> bool {
        self.sample_spacing.is_some() || self.pictures_memory.is_some()
    }

    /// Resources for opening a folder; samples are cached in `cache`.
    pub(crate) fn resources(&self, cache: Option<PathBuf>) -> GeometryResources {
        let default = GeometryResources::default();
        let spacing_px = self
            .sample_spacing
            .map_or(default.grid.spacing_px, u32::from);
        GeometryResources {
            grid: SampleGrid {
                spacing_px,
                ..default.grid
            },
            budget: self
                .pictures_memory
                .map_or(default.budget, |mib| (mib as usize) << 20),
            cache,
        }
    }
}

/// Opens view-dependent geometry of a set; returns the camera of its central view, too.
pub(crate) fn open_geometry(
    set: &ImageSet,
    args: &GeometryResourceArgs,
) -> anyhow::Result<(ViewGeometry, Option<Camera>)> {
    let views = views_with_depth(set)?;
    let bar = Bar::new();
    let geometry = ViewGeometry::open(
        set,
        &views,
        &args.resources(cache::folder(cache::IMAGES)),
        &bar,
    )?;
    bar.finish();
    print_notes(geometry.notes());
    Ok((geometry, set.central_view().and_then(|view| view.camera())))
}

/// Opens view-dependent geometry of a folder of images as a view.
pub(crate) fn geometry_view(
    folder: &Path,
    set: SetArgs,
    settings: GeometrySettings,
    args: &GeometryResourceArgs,
) -> anyhow::Result<GeometryView> {
    let (geometry, central) = open_geometry(&set.open_registered(folder)?, args)?;
    let ahead = || Camera::look_at(DVec3::ZERO, DVec3::NEG_Z, DVec3::Y, 60.0, [1024, 768]);
    let start = central.map_or_else(ahead, Ok)?;
    Ok(GeometryView::new(geometry, &start, settings))
}

/// Texturing that a variant names, if any; an error if the input is not a single folder of images.
pub(crate) fn parse_texturing(
    variant: Option<&str>,
    is_set_alone: bool,
) -> anyhow::Result<Option<Texturing>> {
    match variant.and_then(Texturing::from_name) {
        Some(_) if !is_set_alone => {
            bail_usage!("view-dependent geometry is for one folder of images with depth, alone")
        }
        texturing => Ok(texturing),
    }
}
