//! Cases of layered lumigraphs (hard case 10; L8, L9, C20, C21).

use super::Case;
use super::fixtures::{case_rng, largest, look_along};
use glam::{DVec3, dvec3};
use headbox_core::progress::Silent;
use headbox_core::random::Rng;
use headbox_lumigraph::{
    CameraGrid, DisparityLayer, ErrorBound, GridParts, Lumigraph, LumigraphCapture,
    LumigraphRenderer, LumigraphSettings, Placement, merge, render_by_rays, uniform,
};
use headbox_trace::bvh::Tracer;
use headbox_trace::light::Lighting;
use std::sync::{Arc, LazyLock};

pub(super) fn cases() -> Vec<Case> {
    vec![
        Case {
            name: "lumigraph from hard eyes",
            what: "Frames of a lumigraph of 4x3 images, eyes on its camera plane, on a camera, within 1e-9 m of either, in a layer, 1e6 m behind, looking along the plane and away: share of pixels that differ by more than a level from the same ray by ray in f64.",
            unit: "%",
            bound: 0.5,
            reason: "Positions of 24 bits may find the texel beside that of 53 bits: a thousandth of the pixels on the mean, and here is the worst of ten small frames.",
            measure: |seed| {
                let mut rng = case_rng(seed, 101);
                let lumigraph = BUMP.as_ref()?;
                let eyes = hard_eyes(lumigraph, &mut rng);
                largest_difference(
                    eyes.into_iter()
                        .map(|(eye, forward)| (lumigraph, eye, forward)),
                )
            },
        },
        Case {
            name: "lumigraphs of one camera, one row, one layer",
            what: "The same for lumigraphs of 1x1, 1x3 and 4x1 images and of a single layer, eyes anywhere about the plane.",
            unit: "%",
            bound: 0.5,
            reason: "The same: with one camera, or all cameras in a line, both neighbours of a ray are one.",
            measure: |seed| {
                let mut rng = case_rng(seed, 102);
                let mut views = Vec::new();
                for lumigraph in DEGENERATE.iter() {
                    let lumigraph = lumigraph.as_ref()?;
                    for _ in 0..2 {
                        let eye = lumigraph.grid().origin() + rng.in_cube(0.6);
                        let forward = (DVec3::NEG_Z + rng.in_cube(0.3)).normalize();
                        views.push((lumigraph, eye, forward));
                    }
                }
                largest_difference(views)
            },
        },
        Case {
            name: "merged layers from before the camera plane",
            what: "256 layers merged for eyes from 1 m behind the camera plane to past the nearest layer, tolerances from 0 on: how far two neighbouring cameras' images of a point of a merged layer are apart, by similar triangles in f64, over the tolerance.",
            unit: "",
            bound: 1.0 + 1e-9,
            reason: "A merged layer is one for which the bound allows it (Eq. 8, C18, C20); layers that the eye has passed, or is in, stay alone. The rest is rounding of f64.",
            measure: |seed| {
                let mut rng = case_rng(seed, 103);
                largest((0..20).map(|_| merged_disagreement(&mut rng)))
            },
        },
        Case {
            name: "number of merged layers",
            what: "The same: number of merged layers beyond the fewest that any way to cut needs, by dynamic programming over 64 layers.",
            unit: "layers",
            bound: 0.0,
            reason: "A wider layer never errs less, so that taking as many as the bound allows is best (C20).",
            measure: |seed| {
                let mut rng = case_rng(seed, 104);
                largest((0..20).map(|_| {
                    let layers = uniform(DISPARITIES, 64);
                    let bound = random_bound(&mut rng);
                    Some(merge(&layers, &bound).len() as f64 - fewest(&layers, &bound) as f64)
                }))
            },
        },
    ]
}

const FRAME_PX: [u32; 2] = [64, 48];

/// Largest change of a pixel by rounding to 12 bits of linear light, levels.
const ROUNDING: u8 = 1;

/// Range of disparities, 1/m: surfaces 1 to 5 m from the camera plane.
const DISPARITIES: [f64; 2] = [0.2, 1.0];

/// Lumigraph of a plane with a dome and a pyramid, 3 m in front of 4x3 cameras.
static BUMP: LazyLock<Option<Lumigraph>> =
    LazyLock::new(|| bump(&[-0.5, -0.1, 0.2, 0.5], &[-0.5, 0.0, 0.5], 63));

/// The same scene with fewer cameras, and in one layer.
static DEGENERATE: LazyLock<[Option<Lumigraph>; 4]> = LazyLock::new(|| {
    let four = [-0.5, -0.1, 0.2, 0.5];
    [
        bump(&[0.0], &[0.0], 63),
        bump(&[0.0], &[-0.5, 0.0, 0.5], 63),
        bump(&four, &[0.0], 63),
        bump(&four, &[-0.5, 0.5], 1),
    ]
});

fn bump(columns: &[f64], rows: &[f64], layers: usize) -> Option<Lumigraph> {
    let origin = dvec3(0.0, 0.0, 3.0);
    let size_px = [64, 48];
    let parts = GridParts {
        origin,
        world_from_eye: CameraGrid::facing(DVec3::NEG_Z, DVec3::Y)?,
        columns: columns.to_vec(),
        rows: rows.to_vec(),
        focal_px: f64::from(size_px[1]) / 2.0 / 30f64.to_radians().tan(),
        size_px,
        convergence: 0.3,
    };
    let tracer = Tracer::new(Arc::new(headbox_scenes::build("bump", 0)?), origin);
    let lighting = Lighting::unmetered(&tracer, 0);
    let capture = LumigraphCapture {
        tracer: &tracer,
        lighting: &lighting,
        lit: false,
        samples: 1,
    };
    let raw = capture.run(&CameraGrid::new(parts).ok()?, &Silent).ok()?;
    raw.layered(layers, Placement::Histogram).ok()
}

/// Returns eyes and directions around the bump's cameras, which look along -Z.
fn hard_eyes(lumigraph: &Lumigraph, rng: &mut Rng) -> Vec<(DVec3, DVec3)> {
    let grid = lumigraph.grid();
    let at = |x: f64, y: f64, behind: f64| grid.origin() + dvec3(x, y, behind);
    let (x, y) = (rng.between(-0.5, 0.5), rng.between(-0.5, 0.5));
    let column = grid.columns()[rng.below(4) as usize];
    let row = grid.rows()[rng.below(3) as usize];
    let layers = lumigraph.layers();
    let in_layer = -1.0 / layers[rng.below(layers.len() as u64) as usize].drawn();
    let ahead = DVec3::NEG_Z;
    let along = dvec3(x, y, 0.0).normalize_or(DVec3::X);
    vec![
        (at(x, y, 0.0), ahead),
        (at(column, row, 0.0), ahead),
        (at(x, y, 1e-9), ahead),
        (at(x, y, -1e-9), ahead),
        (at(column + 1e-9, row, -1e-9), ahead),
        (at(x, y, in_layer), ahead),
        (at(x, y, 1e6), ahead),
        (at(x, y, 0.0), along),
        (at(x, y, 0.5), along),
        (at(x, y, 0.0), DVec3::Z),
    ]
}

/// Returns the largest share of the pixels of a frame that differ from the ray-by-ray reference,
/// percent; `None` if less than a quarter of all pixels show surfaces.
fn largest_difference<'a>(
    views: impl IntoIterator<Item = (&'a Lumigraph, DVec3, DVec3)>,
) -> Option<f64> {
    let settings = LumigraphSettings::default();
    let mut renderer = LumigraphRenderer::new();
    let (mut worst, mut drawn, mut pixels) = (0.0f64, 0, 0);
    for (lumigraph, eye, forward) in views {
        let camera = look_along(eye, forward, 50.0, FRAME_PX).ok()?;
        let (fast, _) = renderer.render(lumigraph, &camera, &settings);
        let slow = render_by_rays(lumigraph, &camera, &settings);
        let differs =
            |(a, b): &(&[u8; 4], &[u8; 4])| (0..3).any(|c| a[c].abs_diff(b[c]) > ROUNDING);
        let count = fast.color.iter().zip(&slow.color).filter(differs).count();
        worst = worst.max(100.0 * count as f64 / slow.color.len() as f64);
        drawn += slow.coverage.iter().filter(|c| c.splat_share() > 0).count();
        pixels += slow.color.len();
    }
    (4 * drawn > pixels).then_some(worst)
}

fn random_bound(rng: &mut Rng) -> ErrorBound {
    let tolerance = [0.0, rng.between(0.0, 1.0), rng.between(0.0, 50.0)];
    ErrorBound {
        focal: rng.between(100.0, 2000.0),
        spacing: rng.between(0.01, 0.5),
        behind: rng.between(-1.5, 1.0),
        tolerance: tolerance[rng.below(3) as usize],
    }
}

/// Returns the largest distance between the images of a point in two neighbouring cameras, over the
/// tolerance, for all merged layers of several layers.
fn merged_disagreement(rng: &mut Rng) -> Option<f64> {
    let layers = uniform(DISPARITIES, 256);
    let bound = random_bound(rng);
    let merged_layers = merge(&layers, &bound)
        .into_iter()
        .filter(|merged| merged.len() > 1);
    let disagreements = merged_layers.map(|merged| {
        let layer = layers[merged.start].through(&layers[merged.end - 1]);
        // Similar triangles: the ray from a camera through a point with disparity d > 0 intersects
        // the depth at which the layer is drawn, and the intersection is projected to the frame.
        let depth = 1.0 / layer.drawn();
        let project = |camera: f64, d: f64| {
            bound.focal * (camera - camera * d * depth) / (depth + bound.behind)
        };
        let [a, b] = layer
            .range()
            .map(|d| (project(bound.spacing, d) - project(0.0, d)).abs());
        let is_in_front = 1.0 / layer.max + bound.behind > 0.0;
        is_in_front.then(|| a.max(b) / bound.tolerance)
    });
    largest(disagreements.chain([Some(0.0)]))
}

/// Returns the least number of merged layers over all partitions, by dynamic programming.
fn fewest(layers: &[DisparityLayer], bound: &ErrorBound) -> usize {
    let mut best = vec![usize::MAX; layers.len() + 1];
    best[0] = 0;
    for end in 1..=layers.len() {
        for first in 0..end {
            if first + 1 == end || bound.allows([layers[first].min, layers[end - 1].max]) {
                best[end] = best[end].min(best[first] + 1);
            }
        }
    }
    best[layers.len()]
}
