//! `headbox lumigraph FOLDER`: pictures with depth, taken from a grid of places, as a lumigraph.

use crate::commands::lumigraph::LumigraphCommand;
use crate::output::{LUMIGRAPH, Outputs};
use crate::progress::Bar;
use crate::words::UsageError;
use headbox_lumigraph::{FromImages, RawLumigraph, Slabs};
use std::path::Path;
use std::time::Instant;

impl LumigraphCommand {
    /// Brings the pictures of a set onto the images of the grid that their cameras stand in.
    pub(super) fn run_images(&self) -> anyhow::Result<()> {
        let start = Instant::now();
        self.refuse_flags_of_scenes()?;
        Outputs::new(self.json, [&self.scene]).file(&self.output, &LUMIGRAPH)?;
        let mut set = self.images.open(Path::new(&self.scene))?;
        // What was rendered needs no registration, and its cameras keep their colours as they are.
        if set.depth_noise() > 0.0 {
            self.images.register(&mut set)?;
        }
        let bar = Bar::new();
        let FromImages { raw, notes } = RawLumigraph::from_images(&set, &bar)?;
        notes.iter().for_each(|note| eprintln!("warning: {note}"));
        bar.finish();
        let mut lumigraph = self.layered(&raw)?;
        (lumigraph.info.source, lumigraph.info.frame) = (self.scene.clone(), set.frame);
        lumigraph.write(&self.output)?;
        self.tell(&Slabs::from(lumigraph), start.elapsed().as_secs_f64());
        Ok(())
    }

    /// The cameras of a set are where they are, and see what they see.
    fn refuse_flags_of_scenes(&self) -> Result<(), UsageError> {
        let flags = self
            .grid
            .given()
            .into_iter()
            .chain(self.quality.given())
            .chain(self.source.given());
        match flags.into_iter().find(|(_, is_given)| *is_given) {
            Some((flag, _)) => Err(UsageError(format!(
                "{flag} has no meaning for images; leave it out"
            ))),
            None => Ok(()),
        }
    }
}
