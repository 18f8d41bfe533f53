//! Surface pieces of each face pixel as seen from the centre of the headbox, front to back, and the
//! coverage that several of them share.

use crate::points::surfels;
use crate::points::surfels::straight;
use headbox_core::cube_face::Face;
use headbox_cube::model::depth_bins::DepthBins;
use headbox_cube::pack::{CubeLdi, PlaneSet};
use headbox_cube::render::canvas::surface_canvas::SurfaceCanvas;
use rayon::prelude::*;

/// Surface in a face pixel: a depth pixel or a texel of a plane texture.
#[derive(Clone, Copy, Debug)]
pub(super) struct Piece {
    /// Index of its face pixel, row by row.
    pub(super) at: u32,
    /// Inverse depth, 1/m.
    pub(super) inverse_depth: f64,
    /// Straight alpha.
    pub(super) color_srgb: [u8; 4],
    source: PieceSource,
}

/// Origin of a piece in the cube.
#[derive(Clone, Copy, Debug)]
enum PieceSource {
    /// Indices of a segment and of its depth pixel.
    Segment(usize, usize),
    Texel(usize),
}

/// Returns all pieces of a face in the order of pixels, nearest first within a pixel.
pub(super) fn face_pieces(cube: &CubeLdi, face: Face) -> Vec<Piece> {
    let mut pieces = Vec::new();
    depth_pixels(cube, face, &mut pieces);
    texels(cube, face, &mut pieces);
    // A stable sort keeps the file's order at equal depth.
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
                let index = |count: u32| (segment.row_offsets[y] + count) as usize;
                let at = (segment.y0 + y as u32) * face_px + segment.x0 + x as u32;
                to.extend((index(counts[x])..index(counts[x + 1])).map(|sample| {
                    let found = segment.decode(cube.layout, segment.depth_pixels[sample]);
                    let inverse_depth = found.inverse_depth.max(f64::MIN_POSITIVE);
                    Piece {
                        at,
                        inverse_depth,
                        color_srgb: found.color_srgb,
                        source: PieceSource::Segment(i, sample),
                    }
                }));
            }
        }
    }
}

fn texels(cube: &CubeLdi, face: Face, to: &mut Vec<Piece>) {
    let set = &cube.planes;
    let face_px = cube.face_size_px;
    let min_inverse_depth = surfels::min_inverse_depth(cube);
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
            // Plane textures may begin outside of the face.
            let [x, y] = [(tile.x0, i % width), (tile.y0, i / width)]
                .map(|(first, i)| first as isize + i as isize);
            let inside = |c: isize| usize::try_from(c).ok().filter(|c| *c < side);
            if let Some((column, row)) = inside(x).zip(inside(y)) {
                let here = q + along_x * (x as f64 + 0.5) + along_y * (y as f64 + 0.5);
                to.push(Piece {
                    at: (row * side + column) as u32,
                    inverse_depth: here.max(min_inverse_depth),
                    color_srgb: straight(*texel),
                    source: PieceSource::Texel(tile.texel_range().start + i),
                });
            }
        }
    }
}

/// Test of two inverse depths in one pixel or in adjacent pixels for a common surface, as the
/// renderer does it.
pub(super) struct SurfaceTest {
    tolerance: f64,
    bin: f64,
}

impl SurfaceTest {
    pub(super) fn new(cube: &CubeLdi) -> Self {
        Self {
            tolerance: f64::from(SurfaceCanvas::tolerance(cube.face_size_px)),
            bin: DepthBins::new(cube.info.half_size_m, cube.face_size_px).inverse_depth(1.0),
        }
    }

    /// Returns true if both inverse depths, 1/m, belong to one surface.
    pub(super) fn connects(&self, a: f64, b: f64) -> bool {
        (a - b).abs() <= (a.max(b) * self.tolerance).max(self.bin)
    }
}

/// Returns a cube in which, of several pieces on one surface in a pixel, the one with the largest
/// coverage has the sum of their coverages. The renderer adds their coverages; readers that
/// composite them would let background show through between two of them.
pub(super) fn with_merged_coverage(cube: &CubeLdi) -> CubeLdi {
    let surfaces = SurfaceTest::new(cube);
    let merge_face = |face: &Face| {
        let pieces = face_pieces(cube, *face);
        let mut merged = Vec::new();
        for pixel in pieces
            .chunk_by(|a, b| a.at == b.at)
            .filter(|pixel| pixel.len() > 1)
        {
            let surfaces =
                pixel.chunk_by(|a, b| surfaces.connects(a.inverse_depth, b.inverse_depth));
            for surface in surfaces {
                let alpha = |piece: &Piece| u32::from(piece.color_srgb[3]);
                let most = surface.iter().max_by_key(|piece| alpha(piece));
                let sum: u32 = surface.iter().map(alpha).sum();
                merged.extend(most.map(|most| (most.source, sum.min(255) as u8)));
            }
        }
        merged
    };
    let merged: Vec<(PieceSource, u8)> = Face::ALL.par_iter().flat_map_iter(merge_face).collect();
    let mut cube = cube.clone();
    for (source, alpha) in merged {
        match source {
            PieceSource::Segment(segment, i) => {
                cube.segments[segment].depth_pixels[i].color_srgb[3] = alpha;
            }
            PieceSource::Texel(i) => {
                let [r, g, b, _] = straight(cube.planes.texels[i]);
                cube.planes.texels[i] = PlaneSet::covered([r, g, b, alpha]);
            }
        }
    }
    cube
}
