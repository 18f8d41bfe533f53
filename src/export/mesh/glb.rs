//! GLB files for engines: quadrilaterals with unlit textures, and the environment as a box around
//! them.

use crate::ExportError;
use crate::mesh::glb_file::File;
use crate::mesh::{self, TexturedQuads, resample, sheets};
use headbox_core::headbox::Headbox;
use headbox_core::progress::Progress;
use headbox_cube::model::samples::CubeSamples;
use headbox_cube::pack::{CubeLdi, Split};
use headbox_cube::planes as primitives;
use std::io::Write;

/// Smallest error bound of quadrilaterals, face pixels. Each further bound is [`GROWTH`] times the
/// previous one; the smallest one that the triangle budget allows is used.
const FIRST_ERROR_PX: f64 = 0.1;
const GROWTH: f64 = 1.1;
/// Number of error bounds; the last one is 60 face pixels.
const ERRORS: i32 = 68;
/// Error bound of plane textures for a capture without them, px.
const PLANES_ERROR_PX: f64 = 1.0;

/// Resolutions of textures within a budget of bytes, finest first: width and height are divided by
/// [`TEXTURE_STEP`] to these powers.
const TEXTURE_STEPS: i32 = 20;
const TEXTURE_STEP: f64 = 1.19;
/// Bytes of a triangle: half of a quadrilateral's four vertices and six indices.
const TRIANGLE_BYTES: u64 = (4 * (3 * 4 + 2 * 2) + 6 * 2) / 2;

/// Budget of a file.
#[derive(Clone, Copy, Debug)]
pub struct GlbBudget {
    /// Maximum number of triangles, not counting the environment's.
    pub triangles: u64,
    /// Maximum size of the file, bytes.
    pub bytes: Option<u64>,
}

impl Default for GlbBudget {
    fn default() -> Self {
        Self {
            triangles: 200_000,
            bytes: None,
        }
    }
}

/// Summary of an exported capture.
#[derive(Clone, Copy, Debug)]
pub struct GlbSummary {
    /// Triangles in the file.
    pub triangles: u64,
    /// Largest displacement of a sample, face pixels.
    pub error_px: f64,
    /// Number of samples dropped to stay within the budget.
    pub dropped_samples: u64,
    /// Width of a texel, face pixels: 1 unless the budget of bytes is smaller.
    pub texel_px: f64,
}

/// Writes a cube LDI within a budget: the bound of errors is the smallest that the triangles allow.
/// Of a budget of bytes, triangles take at most half; then textures get the finest resolution that
/// fits.
///
/// # Errors
/// [`ExportError`].
pub fn write(
    cube: &CubeLdi,
    budget: GlbBudget,
    progress: &dyn Progress,
    to: &mut dyn Write,
) -> Result<GlbSummary, ExportError> {
    crate::check_memory(cube)?;
    let with_planes;
    let cube = if cube.planes.tiles.is_empty() && cube.depth_pixel_count() > 0 {
        let mut ldi: CubeSamples = cube.unpack();
        let planes = primitives::choose(&mut ldi, PLANES_ERROR_PX);
        with_planes = CubeLdi {
            planes,
            ..CubeLdi::pack(&ldi, cube.layout, Split::None)?
        };
        &with_planes
    } else {
        cube
    };
    let (plane_charts, sheets) = (mesh::plane_charts(cube), sheets::sheets(cube));
    let in_half = |bytes: u64| bytes / (2 * TRIANGLE_BYTES);
    let most = budget.bytes.map_or(u64::MAX, in_half).min(budget.triangles);
    let left = most.saturating_sub(triangles(&plane_charts));
    progress.begin(
        "fitting quadrilaterals",
        "bounds",
        u64::from(ERRORS.ilog2()) + 2,
    );
    let (error_px, cut) = least_error(left, |error_px| {
        let charts = mesh::sheet_charts(cube, &sheets, error_px);
        progress.advance(1);
        charts
    });
    let mut charts = plane_charts;
    charts.extend(cut);
    let dropped_samples = drop_smallest(&mut charts, most);
    let bytes = budget.bytes.unwrap_or(u64::MAX);
    let steps = u64::from(TEXTURE_STEPS.ilog2()) + 2;
    progress.begin(
        "encoding textures",
        "resolutions",
        if bytes == u64::MAX { 1 } else { steps },
    );
    let (texel_px, file) = finest_textures(bytes, |texel_px| {
        let file = textured_file(cube, &charts, texel_px);
        progress.advance(1);
        file
    })?;
    to.write_all(&file)?;
    Ok(GlbSummary {
        triangles: triangles(&charts),
        error_px,
        dropped_samples,
        texel_px,
    })
}

/// Returns the bytes of a file whose textures have texels of a width in face pixels.
fn textured_file(
    cube: &CubeLdi,
    charts: &[TexturedQuads],
    texel_px: f64,
) -> Result<Vec<u8>, ExportError> {
    let coarse;
    let charts = if texel_px > 1.0 {
        coarse = resample::charts(charts, texel_px);
        &coarse
    } else {
        charts
    };
    let mut file = File::default();
    file.add_charts(charts)?;
    file.add_environment(cube, texel_px)?;
    if file.is_empty() {
        return Err(ExportError::Empty);
    }
    file.into_bytes(Headbox {
        centre: cube.info.centre,
        half_size_m: cube.info.half_size_m,
    })
}

/// Finds the smallest texels with which a file has at most `budget` bytes; returns their width and
/// the file.
///
/// # Errors
/// Those of `file`, or [`ExportError::Budget`] if no file is so small.
fn finest_textures(
    budget: u64,
    file: impl Fn(f64) -> Result<Vec<u8>, ExportError>,
) -> Result<(f64, Vec<u8>), ExportError> {
    let texel_px = |i: i32| TEXTURE_STEP.powi(i);
    let first = file(1.0)?;
    if first.len() as u64 <= budget {
        return Ok((1.0, first));
    }
    let last = file(texel_px(TEXTURE_STEPS))?;
    if last.len() as u64 > budget {
        return Err(ExportError::Budget {
            least_bytes: last.len() as u64,
        });
    }
    // Bisection: the first texels are too fine, the last ones fit.
    let (mut fine, mut found) = (0, (TEXTURE_STEPS, last));
    while found.0 - fine > 1 {
        let middle = i32::midpoint(fine, found.0);
        let made = file(texel_px(middle))?;
        if made.len() as u64 <= budget {
            found = (middle, made);
        } else {
            fine = middle;
        }
    }
    Ok((texel_px(found.0), found.1))
}

fn triangles(charts: &[TexturedQuads]) -> u64 {
    charts
        .iter()
        .map(|chart| 2 * chart.quads.len() as u64)
        .sum()
}

/// Finds the smallest error, face pixels, that needs no more than `budget` triangles, else the
/// largest; returns it with its charts.
fn least_error(
    budget: u64,
    charts: impl Fn(f64) -> Vec<TexturedQuads>,
) -> (f64, Vec<TexturedQuads>) {
    let error_px = |i: i32| FIRST_ERROR_PX * GROWTH.powi(i);
    let first = charts(error_px(0));
    if triangles(&first) <= budget {
        return (error_px(0), first);
    }
    // Bisection: the first error is too small; the last one is taken if no smaller one fits.
    let (mut fine, mut found) = (0, (ERRORS - 1, None));
    while found.0 - fine > 1 {
        let middle = (fine + found.0) / 2;
        let made = charts(error_px(middle));
        if triangles(&made) <= budget {
            found = (middle, Some(made));
        } else {
            fine = middle;
        }
    }
    let (i, made) = found;
    (error_px(i), made.unwrap_or_else(|| charts(error_px(i))))
}

/// Drops the charts with the fewest samples until the rest is within the budget; returns the number
/// of dropped samples.
fn drop_smallest(charts: &mut Vec<TexturedQuads>, budget: u64) -> u64 {
    charts.sort_by_key(|chart| std::cmp::Reverse(chart.samples));
    let (mut sum, mut kept) = (0, 0);
    for chart in charts.iter() {
        sum += 2 * chart.quads.len() as u64;
        if sum > budget {
            break;
        }
        kept += 1;
    }
    charts
        .drain(kept..)
        .map(|chart| u64::from(chart.samples))
        .sum()
}
