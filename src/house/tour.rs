//! A walk whose backdrops are built ahead of need (R3, R16).

use super::backdrop::{BackdropError, BackdropQuality};
use super::house::House;
use super::settings::{WalkSettings, WalkStats};
use super::store::{BackdropBuilder, Store};
use super::visit::likely;
use super::walk::Walker;
use headbox_core::camera::Camera;
use headbox_core::frame::Frame;
use headbox_raster::RasterOutput;
use std::sync::Arc;

/// A house, a walker, a store of backdrops, and a thread that fills it: first with what the last
/// frame lacked, then with what the next ones are likely to need. Until a backdrop is there, what
/// is behind its portal is geometry.
pub struct Tour {
    /// Render settings; may be changed between frames.
    pub settings: WalkSettings,
    house: Arc<House>,
    store: Arc<Store>,
    quality: BackdropQuality,
    builder: BackdropBuilder,
    walker: Walker,
}

impl Tour {
    /// Starts the thread. The store may hold backdrops already, from a `.house` file for instance.
    pub fn new(
        house: Arc<House>,
        store: Arc<Store>,
        quality: BackdropQuality,
        settings: WalkSettings,
    ) -> Self {
        let builder = BackdropBuilder::new(Arc::clone(&house), Arc::clone(&store), quality);
        Self {
            settings,
            house,
            store,
            quality,
            builder,
            walker: Walker::new(),
        }
    }

    /// Draws what a camera sees, on the current rayon thread pool, and orders what was missing.
    pub fn frame(&mut self, camera: &Camera) -> (&Frame, &WalkStats) {
        let (frame, stats) = self
            .walker
            .frame(&self.house, &self.store, camera, &self.settings);
        if let Some(kind) = self.settings.backdrops {
            let urgent = stats.missing.iter().map(|at| (*at, kind));
            self.builder
                .request(urgent.chain(likely(&self.house, camera.eye(), kind)));
        }
        (frame, stats)
    }

    /// Draws what a camera sees after building every backdrop that the frame lacks.
    ///
    /// # Errors
    /// [`BackdropError`] if a backdrop cannot be captured.
    pub fn complete_frame(
        &mut self,
        camera: &Camera,
    ) -> Result<(&Frame, &WalkStats), BackdropError> {
        Walker::prepare(
            &self.house,
            &self.store,
            camera,
            &self.settings,
            &self.quality,
        )?;
        Ok(self
            .walker
            .frame(&self.house, &self.store, camera, &self.settings))
    }

    /// The last frame with what each of its pixels shows.
    pub fn last(&self) -> &RasterOutput {
        self.walker.last()
    }

    /// The house.
    pub fn house(&self) -> &House {
        &self.house
    }

    /// The backdrops.
    pub fn store(&self) -> &Store {
        &self.store
    }

    /// Returns true if the last frame can improve now or soon: a missing backdrop has arrived or is
    /// being built.
    pub fn can_improve(&self) -> bool {
        let Some(kind) = self.settings.backdrops else {
            return false;
        };
        let missing = &self.walker.stats().missing;
        // In this order: what is not being built any more is in the store, if it ever will be.
        !missing.is_empty()
            && (self.builder.is_busy() || missing.iter().any(|at| self.store.contains((*at, kind))))
    }

    /// Waits until nothing is ordered that could still be built.
    pub fn wait(&self) {
        self.builder.wait();
    }
}
