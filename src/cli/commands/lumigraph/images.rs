//! `headbox lumigraph FOLDER`: a lumigraph from images with depth of a grid of cameras.

use crate::args::refuse_given;
use crate::commands::lumigraph::LumigraphCommand;
use crate::output::{LUMIGRAPH, Outputs, print_warnings};
use crate::progress::Bar;
use headbox_lumigraph::{FromImages, RawLumigraph, Slabs};
use std::path::Path;
use std::time::Instant;

impl LumigraphCommand {
    /// Warps the images of a set to the images of the grid that their cameras form.
    pub(super) fn run_images(&self) -> anyhow::Result<()> {
        let start = Instant::now();
        // Images have their own cameras and light.
        let flags = self.grid.given_flags().into_iter();
        let flags = flags.chain(self.quality.given_flags());
        refuse_given("images", flags.chain(self.source.given_flags()))?;
        Outputs::new(self.json, [&self.scene]).file(&self.output, &LUMIGRAPH)?;
        let mut set = self.images.open(Path::new(&self.scene))?;
        // Rendered images (without depth noise) need no registration.
        if self.images.compare_neighbors(&set)? && set.depth_noise() > 0.0 {
            self.images.register(&mut set)?;
        }
        let bar = Bar::new();
        let FromImages { raw, notes } = RawLumigraph::from_images(&set, &bar)?;
        print_warnings(notes);
        bar.finish();
        let mut lumigraph = self.layered(&raw)?;
        (lumigraph.info.source, lumigraph.info.frame) = (self.scene.clone(), set.frame);
        lumigraph.write(&self.output)?;
        self.print_result(&Slabs::from(lumigraph), start.elapsed().as_secs_f64());
        Ok(())
    }
}
