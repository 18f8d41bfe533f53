//! A walk whose backdrops are built in advance (R3, R16).

use super::settings::{WalkSettings, WalkStats};
use super::visit::likely_backdrops;
use super::walk::Walker;
use crate::backdrop::{BackdropError, BackdropQuality};
use crate::house::House;
use crate::store::{BackdropBuilder, Store};
use headbox_core::camera::Camera;
use headbox_core::frame::Frame;
use headbox_raster::RasterOutput;
use std::sync::Arc;

/// A house, a walker, a store of backdrops, and a thread that fills the store: first with the
/// backdrops that the last frame lacked, then with those that the next frames are likely to need.
/// Until a backdrop is built, geometry is drawn behind its portal.
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
    /// Creates a tour and starts its thread. The store may contain backdrops already, for instance
    /// from a `.house` file.
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

    /// Renders a frame on the current rayon thread pool, and requests the missing backdrops.
    pub fn frame(&mut self, camera: &Camera) -> (&Frame, &WalkStats) {
        let (frame, stats) = self
            .walker
            .frame(&self.house, &self.store, camera, &self.settings);
        if let Some(kind) = self.settings.backdrops {
            let urgent = stats.missing.iter().map(|at| (*at, kind));
            self.builder
                .request(urgent.chain(likely_backdrops(&self.house, camera.eye(), kind)));
        }
        (frame, stats)
    }

    /// Renders a frame after building every backdrop that it lacks.
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

    /// Last frame, with the content of each pixel.
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
        // The order matters: a backdrop whose build has ended is in the store by then.
        !missing.is_empty()
            && (self.builder.is_busy() || missing.iter().any(|at| self.store.contains((*at, kind))))
    }

    /// Waits until all requested backdrops that can be built are built.
    pub fn wait(&self) {
        self.builder.wait();
    }
}
