//! Storage beyond memory: an LRU cache of images, and an unnamed temporary file with the planes of
//! all views.

use super::hypotheses::Hypothesis;
use super::picture::MatchView;
use crate::ImagesError;
use std::collections::VecDeque;
use std::fs::File;
use std::io::{self, Read, Seek, SeekFrom, Write};
use std::sync::Arc;

/// LRU cache of the views' images, bounded in bytes.
pub(super) struct Shelf<'a> {
    /// Entries in order of use, the latest last.
    kept: VecDeque<(usize, Arc<MatchView>)>,
    budget_bytes: usize,
    load: Box<dyn Fn(usize) -> Result<MatchView, ImagesError> + 'a>,
}

impl<'a> Shelf<'a> {
    pub(super) fn new(
        budget_bytes: usize,
        load: impl Fn(usize) -> Result<MatchView, ImagesError> + 'a,
    ) -> Self {
        Self {
            kept: VecDeque::new(),
            budget_bytes,
            load: Box::new(load),
        }
    }

    /// Returns the image of a view, loaded again if it was evicted.
    pub(super) fn get(&mut self, view: usize) -> Result<Arc<MatchView>, ImagesError> {
        let found = match self.kept.iter().position(|(kept, _)| *kept == view) {
            Some(at) => self.kept.remove(at).map(|(_, picture)| picture),
            None => None,
        };
        let picture = match found {
            Some(picture) => picture,
            None => Arc::new((self.load)(view)?),
        };
        self.kept.push_back((view, Arc::clone(&picture)));
        while self.kept.len() > 1
            && self
                .kept
                .iter()
                .map(|(_, kept)| kept.bytes())
                .sum::<usize>()
                > self.budget_bytes
        {
            self.kept.pop_front();
        }
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
