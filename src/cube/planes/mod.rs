//! Primitive selection: replaces planar samples by textured planes within an error bound (inventory
//! S1; `docs/primitives.md`).
//!
//! * [`bound`]: converts an error in frame pixels to one in inverse depth.
//! * `headbox_ldi::face_size`: the face size that such an error needs.
//! * `fit`, `regions`: planes, where inverse depth is affine in face pixels within the bound.
//! * `textures`: their textures; `cost`: the cost model that selects them.
//!
//! All other samples stay layered depth pixels.

pub mod bound;
mod cost;
mod fit;
mod regions;
mod textures;

pub use bound::Bound;

use crate::model::samples::{CubeSamples, LayeredDepthImage};
use crate::pack::{CubeLdi, PackError, Plane, PlaneSet, PlaneTile, SplatIndexLayout, Split};
use rayon::prelude::*;
use regions::{Grower, NO_REGION};
use textures::FaceTextures;

/// Maximum error bound, px: more than the width of a frame.
pub const MAX_ERROR_PX: f64 = 1e6;

/// Default error bound of captures, px: smooth walls lose up to half a decibel, at 50 dB and more
/// in captures without noise (docs/decisions/0051).
pub const DEFAULT_ERROR_PX: f64 = 0.5;

/// Packs a cube LDI that is visible in all directions. Planar samples become plane textures
/// ([`choose`]), if these together save more time than their canvas costs.
///
/// # Errors
/// See [`CubeLdi::pack`].
pub fn pack(
    ldi: CubeSamples,
    layout: SplatIndexLayout,
    split: Split,
    error_px: f64,
) -> Result<CubeLdi, PackError> {
    ldi.validate()?;
    let mut selection = select(&ldi, error_px);
    let samples = selection.iter().map(|face| face.textures.samples).sum();
    let tiles = selection
        .iter()
        .flat_map(|face| &face.textures.tiles)
        .map(|tile| [tile.width, tile.height]);
    let face_pixels = ldi
        .faces
        .iter()
        .map(|face| u64::from(face.size_px).pow(2))
        .sum();
    if !cost::outweigh_canvas(samples, tiles, face_pixels) {
        selection.clear();
    }
    pack_selection(ldi, selection, layout, split, error_px)
}

/// Same as [`pack`], but keeps all plane textures: for a cube that portals show only parts of.
///
/// # Errors
/// See [`CubeLdi::pack`].
pub fn pack_keeping_all_textures(
    ldi: CubeSamples,
    layout: SplatIndexLayout,
    split: Split,
    error_px: f64,
) -> Result<CubeLdi, PackError> {
    ldi.validate()?;
    let selection = select(&ldi, error_px);
    pack_selection(ldi, selection, layout, split, error_px)
}

fn pack_selection(
    mut ldi: CubeSamples,
    selection: Vec<SelectedTextures>,
    layout: SplatIndexLayout,
    split: Split,
    error_px: f64,
) -> Result<CubeLdi, PackError> {
    let planes = extract(&mut ldi, selection, error_px);
    let split = match split {
        // Few samples remain beside plane textures: the tables of a second segment would be larger
        // than the savings of a split.
        Split::Auto if !planes.tiles.is_empty() => Split::None,
        split => split,
    };
    let mut cube = CubeLdi::pack(&ldi, layout, split)?;
    cube.planes = planes;
    Ok(cube)
}

/// Moves planar samples of a cube LDI to plane textures that displace no sample by more than
/// `error_px` in any frame ([`Bound`]). Moves none if the error is not a positive number.
///
/// The LDI must be valid ([`CubeSamples::validate`]).
pub fn choose(ldi: &mut CubeSamples, error_px: f64) -> PlaneSet {
    let selection = select(ldi, error_px);
    extract(ldi, selection, error_px)
}

/// Selects the plane textures of each face; none if the error is not a positive number.
fn select(ldi: &CubeSamples, error_px: f64) -> Vec<SelectedTextures> {
    if error_px.is_nan() || error_px <= 0.0 {
        return Vec::new();
    }
    let half_size_m = ldi.info.half_size_m;
    ldi.faces
        .par_iter()
        .with_max_len(1)
        .map(|face| select_on_face(face, &Bound::new(error_px, half_size_m, face.size_px)))
        .collect()
}

/// Removes the samples of the selected plane textures from a cube, and merges the textures into one
/// set.
fn extract(ldi: &mut CubeSamples, selection: Vec<SelectedTextures>, error_px: f64) -> PlaneSet {
    if selection.iter().all(|face| face.textures.tiles.is_empty()) {
        return PlaneSet::default();
    }
    ldi.faces
        .par_iter_mut()
        .zip(&selection)
        .with_max_len(1)
        .for_each(|(face, selected)| retain_samples(face, |i| selected.owner[i] == NO_REGION));
    let mut set = PlaneSet {
        error_px,
        ..PlaneSet::default()
    };
    for SelectedTextures {
        planes, textures, ..
    } in selection
    {
        let first_plane = set.planes.len() as u32;
        let first_texel = set.texels.len() as u32;
        set.planes.extend(planes);
        set.tiles
            .extend(textures.tiles.into_iter().map(|tile| PlaneTile {
                plane: tile.plane + first_plane,
                first_texel: tile.first_texel + first_texel,
                ..tile
            }));
        set.texels.extend(textures.texels);
        set.samples += textures.samples;
    }
    set
}

/// Plane textures selected for a face.
struct SelectedTextures {
    planes: Vec<Plane>,
    textures: FaceTextures,
    /// Plane of each sample of the face, or [`NO_REGION`].
    owner: Vec<u32>,
}

fn select_on_face(face: &LayeredDepthImage, bound: &Bound) -> SelectedTextures {
    let mut grower = Grower::new(face, bound);
    grower.grow_all();
    let textures = textures::draw(&mut grower);
    SelectedTextures {
        planes: grower.regions.iter().map(|region| region.plane).collect(),
        textures,
        owner: grower.owner,
    }
}

/// Keeps the samples for whose indices `is_kept` returns true.
fn retain_samples(face: &mut LayeredDepthImage, is_kept: impl Fn(usize) -> bool) {
    let mut kept = 0;
    let mut start = 0;
    for p in 1..face.offsets.len() {
        let end = face.offsets[p] as usize;
        for i in start..end {
            if is_kept(i) {
                face.samples[kept] = face.samples[i];
                kept += 1;
            }
        }
        (start, face.offsets[p]) = (end, kept as u32);
    }
    face.samples.truncate(kept);
    face.samples.shrink_to_fit();
}
