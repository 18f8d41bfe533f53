//! Primitive selection: replaces planar samples by textured planes within an error bound (inventory
//! S1; `docs/primitives.md`).
//!
//! * [`bound`]: from an error in frame pixels to one in inverse depth.
//! * `headbox_ldi::face_size`: the face size that such an error needs.
//! * `fit`, `regions`: planes, where inverse depth is affine in face pixels within the bound.
//! * `textures`: their pictures; `cost`: which of them are worth it.
//!
//! What no plane holds stays layered depth pixels.

pub mod bound;
mod cost;
mod fit;
mod regions;
mod textures;

pub use bound::Bound;

use crate::model::samples::{CubeLdi, LayeredDepthImage};
use crate::pack::{PackError, PackedCube, Plane, PlaneSet, SplatIndexLayout, Split};
use rayon::prelude::*;
use regions::{Grower, NOBODY};

/// The largest error that makes sense, px: more than a frame is wide.
pub const MAX_ERROR_PX: f64 = 1e6;

/// The error that captures allow where nothing is said, px: smooth walls lose up to half a decibel,
/// where captures without noise have 50 dB and more (docs/decisions/0051).
pub const DEFAULT_ERROR_PX: f64 = 0.5;

/// Packs a cube LDI that frames show all around. What of it is flat becomes pictures on planes
/// ([`choose`]), if these together are worth the canvas that a frame needs for them.
///
/// # Errors
/// See [`PackedCube::pack`].
pub fn pack(
    ldi: CubeLdi,
    layout: SplatIndexLayout,
    split: Split,
    error_px: f64,
) -> Result<PackedCube, PackError> {
    ldi.validate()?;
    let found = find(&ldi, error_px);
    let samples = found.iter().map(|of_face| of_face.pictures.samples).sum();
    let tiles = found
        .iter()
        .flat_map(|of_face| &of_face.pictures.tiles)
        .map(|tile| [tile.width, tile.height]);
    let face_pixels = ldi
        .faces
        .iter()
        .map(|face| u64::from(face.size_px).pow(2))
        .sum();
    let is_worth_it = cost::are_worth_a_canvas(samples, tiles, face_pixels);
    pack_found(
        ldi,
        if is_worth_it { found } else { Vec::new() },
        layout,
        split,
        error_px,
    )
}

/// Same as [`pack`], keeping all plane textures: for a cube of which portals show parts.
///
/// # Errors
/// See [`PackedCube::pack`].
pub fn pack_in_parts(
    ldi: CubeLdi,
    layout: SplatIndexLayout,
    split: Split,
    error_px: f64,
) -> Result<PackedCube, PackError> {
    ldi.validate()?;
    let found = find(&ldi, error_px);
    pack_found(ldi, found, layout, split, error_px)
}

fn pack_found(
    mut ldi: CubeLdi,
    found: Vec<SelectedTextures>,
    layout: SplatIndexLayout,
    split: Split,
    error_px: f64,
) -> Result<PackedCube, PackError> {
    let planes = take(&mut ldi, found, error_px);
    let split = match split {
        // What pictures leave is little, and a second table of pixels would be larger than what a
        // split saves.
        Split::Auto if !planes.tiles.is_empty() => Split::None,
        split => split,
    };
    let mut cube = PackedCube::pack(&ldi, layout, split)?;
    cube.planes = planes;
    Ok(cube)
}

/// Fewer samples are not tried as a region.
const LEAST_SAMPLES: usize = 48;

/// Takes from a cube LDI what can be shown as pictures on planes, such that nothing that the
/// samples of it say is seen elsewhere by more than `error_px` ([`Bound`]). With an error that is
/// not a positive number, nothing is taken.
///
/// The LDI must be valid ([`CubeLdi::validate`]).
pub fn choose(ldi: &mut CubeLdi, error_px: f64) -> PlaneSet {
    let found = find(ldi, error_px);
    take(ldi, found, error_px)
}

/// The pictures of each face.
fn find(ldi: &CubeLdi, error_px: f64) -> Vec<SelectedTextures> {
    if error_px.is_nan() || error_px <= 0.0 {
        return Vec::new();
    }
    let half_size_m = ldi.info.half_size_m;
    ldi.faces
        .par_iter()
        .with_max_len(1)
        .map(|face| choose_on(face, error_px, half_size_m))
        .collect()
}

/// Takes the samples of pictures from a cube, and makes a set of these.
fn take(ldi: &mut CubeLdi, found: Vec<SelectedTextures>, error_px: f64) -> PlaneSet {
    if found
        .iter()
        .all(|of_face| of_face.pictures.tiles.is_empty())
    {
        return PlaneSet::default();
    }
    ldi.faces
        .par_iter_mut()
        .zip(&found)
        .with_max_len(1)
        .for_each(|(face, of_face)| {
            keep(face, |i| of_face.owner[i] == NOBODY);
        });
    let mut set = PlaneSet {
        error_px,
        ..PlaneSet::default()
    };
    for SelectedTextures {
        planes, pictures, ..
    } in found
    {
        let (plane, texel) = (set.planes.len() as u32, set.texels.len() as u32);
        set.planes.extend(planes);
        set.tiles.extend(pictures.tiles.into_iter().map(|mut tile| {
            (tile.plane, tile.first_texel) = (tile.plane + plane, tile.first_texel + texel);
            tile
        }));
        set.texels.extend(pictures.texels);
        set.samples += pictures.samples;
    }
    set
}

/// Plane textures selected for a face.
struct SelectedTextures {
    planes: Vec<Plane>,
    pictures: textures::Pictures,
    /// Plane of each sample of the face, or [`NOBODY`].
    owner: Vec<u32>,
}

fn choose_on(face: &LayeredDepthImage, error_px: f64, half_size_m: f64) -> SelectedTextures {
    let mut grower = Grower::new(face, &Bound::new(error_px, half_size_m, face.size_px));
    grower.grow_all(LEAST_SAMPLES);
    let pictures = textures::draw(&mut grower, 0);
    let planes = grower.regions.iter().map(|region| region.plane).collect();
    SelectedTextures {
        planes,
        pictures,
        owner: grower.owner,
    }
}

/// Drops all samples but some.
fn keep(face: &mut LayeredDepthImage, is_kept: impl Fn(usize) -> bool) {
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
