//! Light baked into vertices: a scene that shows, without any light of its own, what capture and
//! truth show with it.
//!
//! # What a baked scene is
//! * Its vertex colours are the source's times irradiance / pi times the exposure, by the estimator
//!   of [`headbox_trace::light`]; textures and albedos stay, so what a surface shows is its albedo
//!   (vertex colour included) plus its emission: what `truth --unlit` and a capture with no light
//!   samples show, and what a rasteriser interpolates.
//! * Emission and sky are multiplied by the exposure, and there is no sun, so its own exposure is
//!   1: values are stored as they are. [`headbox_trace::light::Lighting::of_scene`] with no bounces
//!   is its light: the sky, for rays that leave.
//!
//! Geometry, images and truth of one baked scene therefore agree by construction. What is lost
//! against the unbaked one is light between vertices (the shorter the edges, the less) and the
//! difference between the two sides of a thin surface: each vertex has the light of the side that
//! its room sees, or else of the brighter one, so that the winding of a file does not matter.

mod corners;
mod light;

use crate::{PortalModel, Prism, Side};
use glam::{DVec2, DVec3};
use headbox_scene::scene::{Scene, Sky};
use headbox_scene::subdivide::subdivide;
use headbox_trace::bvh::Tracer;
use headbox_trace::light::Lighting;
use light::VertexLight;
use std::ops::ControlFlow;
use std::sync::Arc;

/// Resolution of baked light.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BakeOptions {
    /// Edges longer than this are cut, metres.
    pub edge_m: f64,
    /// More triangles than this are not made: edges stay longer instead.
    pub max_triangles: usize,
    /// Light samples per vertex.
    pub samples: u32,
    /// Number of times that soft light (all but the sun's) is averaged with that of the
    /// neighbouring vertices of the same smooth surface, against the noise of few samples.
    pub smoothing: u32,
    /// Diffuse bounces of light.
    pub bounces: u32,
}

impl Default for BakeOptions {
    /// Shadows resolved to a hand's breadth, soft light to two: with fewer rounds of averaging,
    /// blotches stay on large walls.
    fn default() -> Self {
        Self {
            edge_m: 0.2,
            max_triangles: 6_000_000,
            samples: 64,
            smoothing: 6,
            bounces: 1,
        }
    }
}

/// A scene with its light in its vertices.
#[derive(Clone, Debug)]
pub struct Baked {
    /// The scene; see the [module](self) for how to show it.
    pub scene: Scene,
    /// Triangle `i` of the source became the triangles `pieces[i]..pieces[i + 1]`.
    pub pieces: Vec<u32>,
    /// The longest edge that was left uncut on purpose, metres: more than asked for where there
    /// would have been too many triangles.
    pub edge_m: f64,
    /// The exposure that is baked in.
    pub exposure: f32,
    /// Light samples that each vertex has at least: fewer than asked for if the bake was broken
    /// off; 0 if some are dark for that.
    pub samples: u32,
}

/// Columns of a sky's picture, at most: a third of a degree each.
const SKY_COLUMNS: u32 = 1024;

/// Is told often, and from several threads, how many light samples, of how many, are taken: those
/// by which it is learnt where light comes from, and those of vertices. After a `Break`, which has
/// to be said again from then on, the bake ends soon with what it has: a first round gives every
/// vertex eight samples, a second the rest.
pub type BakeProgress<'a> = dyn Fn(usize, usize) -> ControlFlow<()> + Sync + 'a;

/// Bakes the light of a valid scene ([`Scene::validate`]). The same bytes on any number of threads.
pub fn bake(source: &Arc<Scene>, options: &BakeOptions, progress: &BakeProgress<'_>) -> Baked {
    bake_seen(
        source,
        KnownVisibility::ALL,
        Lighting::measure,
        options,
        progress,
    )
}

/// Same as [`bake`], in the scene's light as it is: without metering, so that the exposure is 1,
/// and without fill light.
pub fn bake_unmetered(
    source: &Arc<Scene>,
    options: &BakeOptions,
    progress: &BakeProgress<'_>,
) -> Baked {
    bake_seen(
        source,
        KnownVisibility::ALL,
        Lighting::of_scene,
        options,
        progress,
    )
}

/// Known visibility of a scene.
#[derive(Clone, Copy)]
struct KnownVisibility<'a> {
    /// Visible side of each triangle; any for those beyond its end.
    sides: &'a [Side],
    /// Returns true if a position (world metres) may be visible.
    is_open: &'a (dyn Fn(DVec3) -> bool + Sync),
}

impl KnownVisibility<'_> {
    /// Nothing.
    const ALL: Self = Self {
        sides: &[],
        is_open: &|_| true,
    };
}

/// Same as [`bake`], with known visibility, in the light that `lights` computes for a scene and a
/// number of bounces.
fn bake_seen(
    source: &Arc<Scene>,
    KnownVisibility { sides, is_open }: KnownVisibility<'_>,
    lights: impl FnOnce(&Tracer, u32) -> Lighting,
    options: &BakeOptions,
    progress: &BakeProgress<'_>,
) -> Baked {
    let [low, high] = source.bounds();
    let tracer = Tracer::new(Arc::clone(source), (low + high) / 2.0);
    let lighting = lights(&tracer, options.bounces);
    let (mut scene, pieces, edge_m) = cut(source, options);
    let sources = owners(&pieces);
    let light = VertexLight {
        tracer: &tracer,
        lighting: &lighting,
        options,
        sides,
        is_open,
    };
    let samples = light.bake(&mut scene, &sources, progress);

    let exposure = lighting.exposure;
    for material in &mut scene.materials {
        material.emission = material.emission.map(|c| c * exposure);
    }
    scene.sun = None;
    scene.lamps.clear();
    // What is seen of the sky, of which a small picture shows enough.
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
/// surfaces. Those that border a room are lit as they are seen from it: the underside of a floor,
/// which nobody sees, may be in the sun; what lies partly in a wall by its part in a room. Returns
/// the model and [`Baked::samples`].
pub fn bake_model(
    mut model: PortalModel,
    options: &BakeOptions,
    progress: &BakeProgress<'_>,
) -> (PortalModel, u32) {
    let sides = model.sides();
    let source = Arc::new(std::mem::take(&mut model.scene));
    let inside = (0_u32..)
        .zip(&model.cells)
        .filter(|(cell, _)| !model.is_outside(*cell))
        .flat_map(|(_, it)| &it.space);
    let rooms: Vec<([DVec2; 2], &Prism)> = inside
        .map(|prism| (bounds(&prism.outline), prism))
        .collect();
    // What lies in no room lies in a wall, or outside, where all is seen.
    let is_in_a_room = |place: DVec3| {
        let plan = DVec2::new(place.x, place.z);
        let is_near = |[low, high]: &[DVec2; 2]| plan.cmpge(*low).all() && plan.cmple(*high).all();
        rooms
            .iter()
            .any(|(bounds, prism)| is_near(bounds) && prism.contains(place))
    };
    let seen = KnownVisibility {
        sides: &sides,
        is_open: &is_in_a_room,
    };
    let baked = bake_seen(&source, seen, Lighting::measure, options, progress);
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
    // Only now: with light of its own each new corner would show as a dent in what runs evenly
    // along an edge.
    lit.stitch();
    (lit, baked.samples)
}

/// The least and the largest coordinates of some points.
fn bounds(points: &[DVec2]) -> [DVec2; 2] {
    let all = points.iter().copied();
    [
        all.clone().fold(DVec2::INFINITY, DVec2::min),
        all.fold(DVec2::NEG_INFINITY, DVec2::max),
    ]
}

/// A scene cut to the wished edge length, or as near to it as the number of triangles allows.
fn cut(source: &Scene, options: &BakeOptions) -> (Scene, Vec<u32>, f64) {
    /// Each attempt allows edges longer by this factor.
    const COARSER: f64 = 1.5;
    let most = options.max_triangles.max(source.triangles.len());
    let mut edge_m = if options.edge_m > 0.0 {
        options.edge_m
    } else {
        f64::INFINITY
    };
    loop {
        let mut scene = source.clone();
        if let Some(pieces) = subdivide(&mut scene, edge_m, most) {
            return (scene, pieces, edge_m);
        }
        edge_m *= COARSER;
    }
}

/// For each piece, the triangle of the source that it is of.
fn owners(pieces: &[u32]) -> Vec<u32> {
    let runs = pieces.windows(2).enumerate();
    runs.flat_map(|(source, run)| (run[0]..run[1]).map(move |_| source as u32))
        .collect()
}
