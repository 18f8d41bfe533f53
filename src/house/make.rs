//! Creation of a house from a portal model: bakes light, prepares the model, captures backdrops.

use super::backdrop::{Backdrop, BackdropError, BackdropKind, BackdropQuality, PortalSide};
use super::house::{House, HouseError};
use super::store::{Key, Store};
use headbox_core::progress::Progress;
use headbox_model::PortalModel;
use headbox_model::bake::{BakeOptions, BakedLight, bake_model};
use std::ops::ControlFlow;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::time::{Duration, Instant};

/// Options of [`make_house`].
#[derive(Clone, Debug)]
pub struct MakeOptions {
    /// Light to bake into the vertices; `None` keeps the model's colours.
    pub light: Option<BakeOptions>,
    /// Kinds of backdrops to capture behind both sides of every portal.
    pub backdrops: Vec<BackdropKind>,
    /// Quality of the backdrops.
    pub quality: BackdropQuality,
    /// Memory budget of backdrops, bytes.
    pub budget_bytes: u64,
}

/// A house with its backdrops.
#[derive(Debug)]
pub struct MadeHouse {
    /// The house.
    pub house: House,
    /// Its backdrops.
    pub store: Store,
    /// Its light; `None` if none was baked.
    pub light: Option<BakedLight>,
    /// Number of captured backdrops.
    pub captures: usize,
    /// Number of requested backdrops; more than `captures` if the work was cancelled.
    pub requested: usize,
    /// Portals of backdrops that are larger than the whole memory budget and not in the store.
    pub oversized: Vec<u32>,
    /// Time of all captures.
    pub capture_time: Duration,
}

/// Error of [`make_house`].
#[derive(Debug, thiserror::Error)]
pub enum MakeError {
    /// The model cannot be walked.
    #[error(transparent)]
    House(#[from] HouseError),
    /// A backdrop cannot be captured.
    #[error(transparent)]
    Backdrop(#[from] BackdropError),
    /// The work was cancelled before every vertex had light.
    #[error("interrupted before every wall had light: nothing to keep")]
    NoLight,
}

/// Stage of [`make_house`] that bakes the light.
pub const LIGHT: &str = "light";

/// Stage of [`make_house`] that captures the backdrops.
pub const BACKDROPS: &str = "backdrops";

/// Makes a house on the current rayon thread pool.
///
/// If `progress` is cancelled, the house has the light and the backdrops that are complete by then.
/// Its stages are [`LIGHT`] and [`BACKDROPS`].
///
/// # Errors
/// [`MakeError`].
pub fn make_house(
    model: PortalModel,
    options: &MakeOptions,
    progress: &dyn Progress,
) -> Result<MadeHouse, MakeError> {
    let (mut model, light) = match &options.light {
        Some(light) => {
            let (model, light) = bake_light(model, light, progress)?;
            (model, Some(light))
        }
        None => (model, None),
    };
    if light.is_none() {
        model.scene.tone = model.scene.tone.without_highlights();
    }
    let house = House::new(model)?;
    let mut made = MadeHouse {
        house,
        store: Store::new(options.budget_bytes),
        light,
        captures: 0,
        requested: 0,
        oversized: Vec::new(),
        capture_time: Duration::ZERO,
    };
    made.capture_backdrops(options, progress)?;
    Ok(made)
}

/// Bakes the light of a model.
fn bake_light(
    model: PortalModel,
    options: &BakeOptions,
    progress: &dyn Progress,
) -> Result<(PortalModel, BakedLight), MakeError> {
    model.scene.validate().map_err(HouseError::from)?;
    let has_begun = AtomicBool::new(false);
    let reported = AtomicU64::new(0);
    let (model, light) = bake_model(model, options, &|done, all| {
        if !has_begun.swap(true, Ordering::Relaxed) {
            progress.begin(LIGHT, "samples", all as u64);
        }
        let before = reported.fetch_max(done as u64, Ordering::Relaxed);
        progress.advance((done as u64).saturating_sub(before));
        if progress.is_cancelled() {
            ControlFlow::Break(())
        } else {
            ControlFlow::Continue(())
        }
    });
    if light.samples == 0 && progress.is_cancelled() {
        return Err(MakeError::NoLight);
    }
    Ok((model, light))
}

impl MadeHouse {
    /// Captures the backdrops, kind by kind.
    fn capture_backdrops(
        &mut self,
        options: &MakeOptions,
        progress: &dyn Progress,
    ) -> Result<(), BackdropError> {
        let start = Instant::now();
        let portals = self.house.plan().portals.len() as u32;
        let sides = (0..portals).flat_map(|portal| [0, 1].map(|side| PortalSide { portal, side }));
        let keys: Vec<Key> = options
            .backdrops
            .iter()
            .flat_map(|kind| sides.clone().map(|side| (side, *kind)))
            .collect();
        self.requested = keys.len();
        if keys.is_empty() {
            return Ok(());
        }
        progress.begin(BACKDROPS, "sides of portals", keys.len() as u64);
        for (side, kind) in keys {
            if progress.is_cancelled() {
                break;
            }
            let backdrop = Backdrop::capture(&self.house, side, kind, &options.quality)?;
            if !self.store.insert((side, kind), Arc::new(backdrop)) {
                self.oversized.push(side.portal);
            }
            self.captures += 1;
            progress.advance(1);
        }
        self.capture_time = start.elapsed();
        Ok(())
    }
}
