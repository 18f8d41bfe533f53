//! Storage beyond memory: an LRU cache of images, and an unnamed temporary file with the planes of
//! all views.

use super::matching::hypotheses::Hypothesis;
use super::matching::picture::MatchView;
use crate::ImagesError;
use headbox_core::lru::LruCache;
use std::fs::File;
use std::io::{self, Read, Seek, SeekFrom, Write};
use std::sync::Arc;

/// Images of the views, loaded on demand and cached within a budget in bytes.
pub(super) struct ViewCache<'a> {
    cache: LruCache<usize, Arc<MatchView>>,
    budget_bytes: u64,
    load: Box<dyn Fn(usize) -> Result<MatchView, ImagesError> + 'a>,
}

impl<'a> ViewCache<'a> {
    pub(super) fn new(
        budget_bytes: usize,
        load: impl Fn(usize) -> Result<MatchView, ImagesError> + 'a,
    ) -> Self {
        Self {
            cache: LruCache::default(),
            budget_bytes: budget_bytes as u64,
            load: Box::new(load),
        }
    }

    /// Returns the image of a view, loaded again if it was evicted.
    pub(super) fn get(&mut self, view: usize) -> Result<Arc<MatchView>, ImagesError> {
        self.cache.next_tick();
        if let Some(picture) = self.cache.get(view) {
            return Ok(picture);
        }
        let picture = Arc::new((self.load)(view)?);
        let bytes = picture.bytes() as u64;
        self.cache.put(view, Arc::clone(&picture), bytes);
        self.cache.evict_to(self.budget_bytes);
        Ok(picture)
    }
}

/// Temporary file with the planes of all views.
pub(super) struct Spool {
    file: File,
    /// Byte offset of each view's planes, followed by the end.
    offsets: Vec<u64>,
}

impl Spool {
    /// Creates the file in a folder, for a number of planes of each view.
    pub(super) fn new(
        folder: &std::path::Path,
        planes: impl Iterator<Item = usize>,
    ) -> io::Result<Self> {
        let mut offsets = vec![0];
        let mut end = 0;
        for planes in planes {
            end += (planes * size_of::<Hypothesis>()) as u64;
            offsets.push(end);
        }
        Ok(Self {
            file: tempfile::tempfile_in(folder)?,
            offsets,
        })
    }

    pub(super) fn write(&mut self, view: usize, planes: &[Hypothesis]) -> io::Result<()> {
        self.file.seek(SeekFrom::Start(self.offsets[view]))?;
        self.file.write_all(bytemuck::cast_slice(planes))
    }

    pub(super) fn read(&mut self, view: usize) -> io::Result<Vec<Hypothesis>> {
        let bytes = self.offsets[view + 1] - self.offsets[view];
        let mut planes = vec![Hypothesis::default(); bytes as usize / size_of::<Hypothesis>()];
        self.file.seek(SeekFrom::Start(self.offsets[view]))?;
        self.file
            .read_exact(bytemuck::cast_slice_mut(&mut planes))?;
        Ok(planes)
    }

    /// Reads the inverse depths of a view, 1/m, 0 where unknown.
    pub(super) fn inverse_depths(&mut self, view: usize) -> io::Result<Vec<f32>> {
        Ok(self
            .read(view)?
            .iter()
            .map(|plane| plane.inverse_depth)
            .collect())
    }
}
