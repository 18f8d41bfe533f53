//! Frames of a set that cannot be used: they are left out and named, and the set opens.

use super::text;
use crate::ImagesError;
use headbox_core::read_note::ReadNote;

/// Collects the frames that are left out.
#[derive(Default)]
pub(super) struct LeftOut {
    frames: Vec<String>,
    first: Option<ImagesError>,
    kept: usize,
}

impl LeftOut {
    /// Returns a frame, or `None` if it is left out.
    ///
    /// # Errors
    /// [`ImagesError::Outside`], which is not a matter of one frame.
    pub(super) fn keep<T>(
        &mut self,
        name: &str,
        frame: Result<T, ImagesError>,
    ) -> Result<Option<T>, ImagesError> {
        match frame {
            Ok(frame) => {
                self.kept += 1;
                Ok(Some(frame))
            }
            Err(error @ ImagesError::Outside { .. }) => Err(error),
            Err(error) => {
                let cause = match &error {
                    ImagesError::Field { field, cause, .. } => format!("{field} {cause}"),
                    other => other.to_string(),
                };
                self.frames.push(format!("{name} ({cause})"));
                self.first.get_or_insert(error);
                Ok(None)
            }
        }
    }

    /// Returns the note on the frames that are left out.
    ///
    /// # Errors
    /// The first frame's error if no frame is left.
    pub(super) fn finish(self) -> Result<Option<ReadNote>, ImagesError> {
        match self.first {
            Some(error) if self.kept == 0 => Err(error),
            _ => {
                let all = self.frames.len() + self.kept;
                let sentence = format!("left out {} of {all} frames", self.frames.len());
                Ok(text::note_names(&sentence, &self.frames))
            }
        }
    }
}
