//! Light baked into vertices, so that an unlit rendering of a scene looks like the lit one of
//! capture and truth.
//!
//! # Contents of a baked scene
//! * Vertex colours are those of the source times irradiance / pi times the exposure, by the
//!   estimator of [`headbox_trace::light`]. Textures and albedos stay. A surface's radiance is its
//!   albedo (vertex colour included) plus its emission, as `truth --unlit`, a capture without light
//!   samples and a rasteriser compute it.
//! * Emission and sky are multiplied by the exposure, and there is no sun, so that the exposure of
//!   the baked scene is 1. Its light, [`headbox_trace::light::Lighting::unmetered`] without
//!   bounces, is the sky for rays that leave the scene.
//!
//! Geometry, images and truth of one baked scene therefore agree by construction. Compared with the
//! unbaked scene, changes of light between vertices are lost (fewer with shorter edges), and the
//! difference between the two sides of a thin surface: each vertex has the light of the side that
//! is visible from its room, or else of the brighter side, so that the winding does not matter.

mod corners;
mod light;

use crate::{PortalModel, Prism, Side};
use glam::{DVec2, DVec3};
use headbox_core::bounces::Bounces;
use headbox_scene::scene::{Scene, Sky};
use headbox_scene::subdivide::{has_few_pieces, subdivide};
use headbox_trace::bvh::Tracer;
use headbox_trace::light::Lighting;
use light::VertexLight;
use std::ops::ControlFlow;
use std::sync::Arc;

/// Resolution of baked light.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BakeOptions {
    /// Maximum edge length, metres; longer edges are cut.
    pub edge_m: f64,
    /// Maximum number of triangles; edges stay longer if it would be exceeded.
    pub max_triangles: usize,
    /// Light samples per vertex.
    pub samples: u32,
    /// Number of times that soft light (all but the sun's) is averaged with that of the
    /// neighbouring vertices of the same smooth surface, against the noise of few samples.
    pub smoothing: u32,
    /// Diffuse bounces of light.
    pub bounces: Bounces,
}

impl Default for BakeOptions {
    /// Resolves shadows to about 10 cm and soft light to 20 cm. With fewer rounds of smoothing,
    /// blotches stay on large walls.
    fn default() -> Self {
        Self {
            edge_m: 0.2,
            max_triangles: 6_000_000,
            samples: 64,
            smoothing: 6,
            bounces: Bounces::Full,
        }
    }
}

/// A scene with light baked into its vertices.
#[derive(Clone, Debug)]
pub struct Baked {
    /// The scene; the [module](self) describes its rendering.
    pub scene: Scene,
    /// Triangle `i` of the source became the triangles `pieces[i]..pieces[i + 1]`.
    pub pieces: Vec<u32>,
    /// Maximum edge length after subdivision, metres: more than requested if there would have been
    /// too many triangles.
    pub edge_m: f64,
    /// Exposure that is baked in.
    pub exposure: f32,
    /// Minimum number of light samples of a vertex: fewer than requested if the bake was cancelled,
    /// 0 if some vertices are unlit.
    pub samples: u32,
}

/// Light that [`bake_model`] has baked into a model.
#[derive(Clone, Copy, Debug, Default)]
pub struct BakedLight {
    /// See [`Baked::exposure`].
    pub exposure: f32,
    /// See [`Baked::samples`].
    pub samples: u32,
}

/// Maximum number of columns of a sky's picture: a third of a degree each.
const SKY_COLUMNS: u32 = 1024;

/// Callback with the work done and its total, in light samples: training paths of the light guide,
/// then samples of vertices, weighted to advance evenly in time. Called often and from several
/// threads. After a `Break`, which it must return from then on, the bake ends soon with the light
/// so far: a first round gives every vertex eight samples, a second one the rest.
pub type BakeProgress<'a> = dyn Fn(usize, usize) -> ControlFlow<()> + Sync + 'a;

/// Bakes the light of a valid scene ([`Scene::validate`]). The result does not depend on the number
/// of threads.
pub fn bake(source: &Arc<Scene>, options: &BakeOptions, progress: &BakeProgress<'_>) -> Baked {
    bake_visible(
        source,
        KnownVisibility::UNKNOWN,
        Lighting::measure,
        options,
        progress,
    )
}

/// Same as [`bake`] without metering and fill light: the exposure is 1.
pub fn bake_unmetered(
    source: &Arc<Scene>,
    options: &BakeOptions,
    progress: &BakeProgress<'_>,
) -> Baked {
    bake_visible(
        source,
        KnownVisibility::UNKNOWN,
        Lighting::unmetered,
        options,
        progress,
    )
}

/// Known visibility of a scene.
#[derive(Clone, Copy)]
struct KnownVisibility<'a> {
    /// Visible side of each triangle; [`Side::Any`] beyond the end.
    sides: &'a [Side],
    /// Returns true if a position (world metres) may be visible.
    is_open: &'a (dyn Fn(DVec3) -> bool + Sync),
}

impl KnownVisibility<'_> {
    /// No knowledge: everything may be visible.
    const UNKNOWN: Self = Self {
        sides: &[],
        is_open: &|_| true,
    };
}

/// Same as [`bake`], with known visibility and with the lighting that `prepare` computes for a
/// scene and a number of bounces.
fn bake_visible(
    source: &Arc<Scene>,
    visibility: KnownVisibility<'_>,
    prepare: impl FnOnce(&Tracer, Bounces) -> Lighting,
    options: &BakeOptions,
    progress: &BakeProgress<'_>,
) -> Baked {
    let [low, high] = source.bounds();
    let tracer = Tracer::new(Arc::clone(source), (low + high) / 2.0);
    let lighting = prepare(&tracer, options.bounces);
    let (mut scene, pieces, edge_m) = subdivide_within_limit(source, options);
    let sources = sources_of_pieces(&pieces);
    let light = VertexLight {
        tracer: &tracer,
        lighting: &lighting,
        options,
        visibility,
    };
    let samples = light.bake(&mut scene, &sources, progress);

    let exposure = lighting.exposure;
    for material in &mut scene.materials {
        material.emission = material.emission.map(|c| c * exposure);
    }
    scene.sun = None;
    scene.lamps.clear();
    // The sky is only a background now, for which a small picture suffices.
    scene.sky = scene.sky.map(|sky| match sky.times(exposure) {
        Sky::Picture(picture) => Sky::Picture(Arc::new(picture.reduced(SKY_COLUMNS))),
        gradient => gradient,
    });
    Baked {
        scene,
        pieces,
        edge_m,
        exposure,
        samples,
    }
}

/// Bakes the light of a portal model's scene (see [`bake`]) and stitches it; each cell keeps its
/// surfaces. Surfaces of a room have the light of the side that is visible from it, because the
/// invisible underside of a floor, for example, may be in the sun. Surfaces partly inside a wall
/// have the light of their part in the room.
pub fn bake_model(
    mut model: PortalModel,
    options: &BakeOptions,
    progress: &BakeProgress<'_>,
) -> (PortalModel, BakedLight) {
    let sides = model.sides();
    let source = Arc::new(std::mem::take(&mut model.scene));
    let inside = (0_u32..)
        .zip(&model.cells)
        .filter(|(cell, _)| !model.is_outside(*cell))
        .flat_map(|(_, it)| &it.space);
    let rooms: Vec<([DVec2; 2], &Prism)> = inside
        .map(|prism| (bounds(&prism.outline), prism))
        .collect();
    // Positions outside of rooms are in a wall, or outside, where everything is visible.
    let is_in_room = |position: DVec3| {
        let plan = DVec2::new(position.x, position.z);
        let is_near = |[low, high]: &[DVec2; 2]| plan.cmpge(*low).all() && plan.cmple(*high).all();
        rooms
            .iter()
            .any(|(bounds, prism)| is_near(bounds) && prism.contains(position))
    };
    let visibility = KnownVisibility {
        sides: &sides,
        is_open: &is_in_room,
    };
    let baked = bake_visible(&source, visibility, Lighting::measure, options, progress);
    let piece = |triangle: u32| {
        baked
            .pieces
            .get(triangle as usize)
            .copied()
            .unwrap_or_default()
    };
    let mut cells = model.cells;
    for cell in &mut cells {
        cell.triangles = piece(cell.triangles.start)..piece(cell.triangles.end);
    }
    let mut lit = PortalModel {
        scene: baked.scene,
        cells,
        portals: model.portals,
        outside: model.outside,
    };
    // After baking: new corners interpolate the light along their edge. With light of their own
    // they would be visible in it.
    lit.stitch();
    let light = BakedLight {
        exposure: baked.exposure,
        samples: baked.samples,
    };
    (lit, light)
}

/// Returns the bounding rectangle of points: lowest and highest corner.
fn bounds(points: &[DVec2]) -> [DVec2; 2] {
    let all = points.iter().copied();
    [
        all.clone().fold(DVec2::INFINITY, DVec2::min),
        all.fold(DVec2::NEG_INFINITY, DVec2::max),
    ]
}

/// Subdivides a scene to the requested edge length, or as near to it as the number of triangles
/// allows. Returns the scene, the first piece of each triangle (see [`Baked::pieces`]) and the edge
/// length.
fn subdivide_within_limit(source: &Scene, options: &BakeOptions) -> (Scene, Vec<u32>, f64) {
    /// Factor of the edge length from one attempt to the next.
    const COARSER: f64 = 1.5;
    let max_triangles = options.max_triangles.max(source.triangles.len());
    let mut edge_m = if options.edge_m > 0.0 {
        options.edge_m
    } else {
        f64::INFINITY
    };
    while !has_few_pieces(source, edge_m, max_triangles) {
        edge_m *= COARSER;
    }
    let mut scene = source.clone();
    let pieces = subdivide(&mut scene, edge_m);
    (scene, pieces, edge_m)
}

/// Returns the source triangle of each piece.
fn sources_of_pieces(pieces: &[u32]) -> Vec<u32> {
    let runs = pieces.windows(2).enumerate();
    runs.flat_map(|(source, run)| (run[0]..run[1]).map(move |_| source as u32))
        .collect()
}
