//! Distribution of samples over layers (R-N2: 72/19/6/3 %, P-N1: 79/20/1 %).

use headbox_cube::pack::PackedSegment;
use headbox_house::backdrop::{Backdrop, BackdropKind};
use headbox_house::store::Store;
use serde::{Deserialize, Serialize};

/// Distribution of samples over the layers of all LDIs of one kind.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct LayerRow {
    /// Name of the kind.
    pub name: String,
    /// Number of images.
    pub images: usize,
    /// Mean number of samples of an image.
    pub samples: f64,
    /// Shares of the samples in layers 1, 2, 3, and 4 or more.
    pub shares: [f64; 4],
    /// Mean number of samples of the pixels that have any.
    pub depth_complexity: f64,
}

/// Counts the layers of each kind of LDI in the store.
pub(super) fn layers(store: &Store) -> Vec<LayerRow> {
    let kinds = [
        BackdropKind::Ldi,
        BackdropKind::LdiColorsApart,
        BackdropKind::LdiAverage,
        BackdropKind::WindowLdi,
        BackdropKind::CellLdi,
    ];
    kinds
        .into_iter()
        .filter_map(|kind| row(store, kind))
        .collect()
}

fn row(store: &Store, kind: BackdropKind) -> Option<LayerRow> {
    let all = store.all();
    let cubes: Vec<_> = all
        .iter()
        .filter_map(|((_, other), backdrop)| match &**backdrop {
            Backdrop::Cubes(cubes) if *other == kind => Some(cubes),
            _ => None,
        })
        .flatten()
        .collect();
    let mut layers = [0u64; 4];
    for segment in cubes.iter().flat_map(|cube| &cube.segments) {
        count_layers(segment, &mut layers);
    }
    let total: u64 = layers.iter().sum();
    (total > 0).then(|| LayerRow {
        name: kind.name().into(),
        images: cubes.len(),
        samples: total as f64 / cubes.len() as f64,
        shares: layers.map(|n| n as f64 / total as f64),
        depth_complexity: total as f64 / layers[0] as f64,
    })
}

fn count_layers(segment: &PackedSegment, layers: &mut [u64; 4]) {
    for row in segment.row_counts.chunks(segment.width as usize + 1) {
        for ends in row.windows(2) {
            let samples = ends[1] - ends[0];
            (0..samples.min(3) as usize).for_each(|layer| layers[layer] += 1);
            layers[3] += u64::from(samples.saturating_sub(3));
        }
    }
}
