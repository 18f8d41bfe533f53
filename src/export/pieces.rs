//! Pieces: the surfaces of each face pixel as seen from the centre of the headbox, front to back,
//! with the coverage that several of them share.

use super::surfels::straight;
use crate::surfels;
use headbox_core::cube_face::Face;
use headbox_cube::model::depth_bins::DepthBins;
use headbox_cube::pack::{CubeLdi, PlaneSet};
use headbox_cube::render::canvas::surface::SurfaceCanvas;
use rayon::prelude::*;

/// A depth pixel or a texel of a picture on a plane.
#[derive(Clone, Copy, Debug)]
pub(super) struct Piece {
    /// Number of its face pixel, row by row.
    pub(super) at: u32,
    /// 1/m.
    pub(super) inverse_depth: f64,
    /// Straight alpha.
    pub(super) color_srgb: [u8; 4],
    place: Place,
}

/// Source of a piece in the cube.
#[derive(Clone, Copy, Debug)]
enum Place {
    /// Segment and depth pixel.
    Segment(usize, usize),
    Texel(usize),
}

/// All pieces of a face, in the order of pixels, nearest first.
pub(super) fn of_face(cube: &CubeLdi, face: Face) -> Vec<Piece> {
    let mut pieces = Vec::new();
    depth_pixels(cube, face, &mut pieces);
    texels(cube, face, &mut pieces);
    // Stable: of two at one depth the order in the file decides.
    pieces.sort_by(|a, b| {
        a.at.cmp(&b.at)
            .then(b.inverse_depth.total_cmp(&a.inverse_depth))
    });
    pieces
}

fn depth_pixels(cube: &CubeLdi, face: Face, to: &mut Vec<Piece>) {
    for (i, segment) in cube
        .segments
        .iter()
        .enumerate()
        .filter(|(_, segment)| segment.face == face)
    {
        let (width, face_px) = (segment.width as usize, cube.face_size_px);
        for (y, counts) in segment.row_counts.chunks_exact(width + 1).enumerate() {
            for x in 0..width {
                let of_row = |count: u32| (segment.row_offsets[y] + count) as usize;
                let at = (segment.y0 + y as u32) * face_px + segment.x0 + x as u32;
                to.extend((of_row(counts[x])..of_row(counts[x + 1])).map(|sample| {
                    let found = segment.decode(cube.layout, segment.depth_pixels[sample]);
                    let inverse_depth = found.inverse_depth.max(f64::MIN_POSITIVE);
                    Piece {
                        at,
                        inverse_depth,
                        color_srgb: found.color_srgb,
                        place: Place::Segment(i, sample),
                    }
                }));
            }
        }
    }
}

fn texels(cube: &CubeLdi, face: Face, to: &mut Vec<Piece>) {
    let (set, face_px, infinity) = (&cube.planes, cube.face_size_px, surfels::infinity(cube));
    for tile in set
        .tiles
        .iter()
        .filter(|tile| Face::ALL[usize::from(tile.face) % 6] == face)
    {
        let (Some(plane), Some(texels)) = (
            set.planes.get(tile.plane as usize),
            set.texels.get(tile.texel_range()),
        ) else {
            continue;
        };
        let [q, along_x, along_y] = plane.inverse_depth(face, face_px);
        let (width, side) = (usize::from(tile.width), face_px as usize);
        for (i, texel) in texels.iter().enumerate().filter(|(_, texel)| texel[3] > 0) {
            // Pictures may begin beyond the face.
            let [x, y] = [(tile.x0, i % width), (tile.y0, i / width)]
                .map(|(first, i)| first as isize + i as isize);
            let inside = |c: isize| usize::try_from(c).ok().filter(|c| *c < side);
            if let Some((column, row)) = inside(x).zip(inside(y)) {
                let here = q + along_x * (x as f64 + 0.5) + along_y * (y as f64 + 0.5);
                let (at, place) = (
                    (row * side + column) as u32,
                    Place::Texel(tile.texel_range().start + i),
                );
                to.push(Piece {
                    at,
                    inverse_depth: here.max(infinity),
                    color_srgb: straight(*texel),
                    place,
                });
            }
        }
    }
}

/// A cube in which of the pieces that share a pixel on one surface the one that covers most covers
/// what all do. The renderer adds their shares; what lays them one over another would see through
/// the crack between two of them.
pub(super) fn with_whole_rims(cube: &CubeLdi) -> CubeLdi {
    let tolerance = f64::from(SurfaceCanvas::tolerance(cube.face_size_px));
    let bin = DepthBins::new(cube.info.half_size_m, cube.face_size_px).inverse_depth(1.0);
    let connects = |a: f64, b: f64| (a - b).abs() <= (a.max(b) * tolerance).max(bin);
    let of_face = |face: &Face| {
        let pieces = of_face(cube, *face);
        let mut whole = Vec::new();
        for pixel in pieces
            .chunk_by(|a, b| a.at == b.at)
            .filter(|pixel| pixel.len() > 1)
        {
            for surface in pixel.chunk_by(|a, b| connects(a.inverse_depth, b.inverse_depth)) {
                let Some(most) = surface.iter().max_by_key(|piece| piece.color_srgb[3]) else {
                    continue;
                };
                let sum: u32 = surface
                    .iter()
                    .map(|piece| u32::from(piece.color_srgb[3]))
                    .sum();
                whole.push((most.place, sum.min(255) as u8));
            }
        }
        whole
    };
    let whole: Vec<(Place, u8)> = Face::ALL.par_iter().flat_map_iter(of_face).collect();
    let mut cube = cube.clone();
    for (place, alpha) in whole {
        match place {
            Place::Segment(segment, i) => {
                cube.segments[segment].depth_pixels[i].color_srgb[3] = alpha;
            }
            Place::Texel(i) => {
                let [r, g, b, _] = straight(cube.planes.texels[i]);
                cube.planes.texels[i] = PlaneSet::covered([r, g, b, alpha]);
            }
        }
    }
    cube
}
