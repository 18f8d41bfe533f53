//! Bookmarks: named poses of the eye for each file, kept between runs in the user's state folder.

use crate::input::pose::Pose;
use crate::playback::{camera_file, export, thumbnails};
use headbox_core::file_frame::FileFrame;
use headbox_scene::camera_path::CameraRecord;
use serde::{Deserialize, Serialize};
use std::io;
use std::path::PathBuf;

/// A named pose.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct Bookmark {
    pub name: String,
    pub camera: CameraRecord,
}

/// The bookmarks of one source.
#[derive(Debug, Default)]
pub(crate) struct Bookmarks {
    /// Name of the source.
    source: String,
    /// File that stores them; `None`: they last as long as the source is open.
    file: Option<PathBuf>,
    list: Vec<Bookmark>,
}

/// Contents of the file. The source distinguishes files of equal digest, and tells people what it
/// is about.
#[derive(Serialize, Deserialize)]
struct Stored {
    source: String,
    bookmarks: Vec<Bookmark>,
}

impl Bookmarks {
    /// Reads the bookmarks of `source`, a path or another unique name, from `folder`. Empty if
    /// there are none.
    ///
    /// # Errors
    /// One sentence if there is a file that cannot be read; it is not overwritten.
    pub(crate) fn read(folder: Option<&PathBuf>, source: &str) -> (Self, Result<(), String>) {
        let mut bookmarks = Self {
            source: source.into(),
            file: folder.map(|folder| folder.join(thumbnails::digest(source) + ".json")),
            list: Vec::new(),
        };
        let Some(file) = &bookmarks.file else {
            return (bookmarks, Ok(()));
        };
        let stored = match std::fs::read_to_string(file) {
            Ok(text) => serde_json::from_str::<Stored>(&text).map_err(|error| error.to_string()),
            Err(error) if error.kind() == io::ErrorKind::NotFound => {
                return (bookmarks, Ok(()));
            }
            Err(error) => Err(error.to_string()),
        };
        let failure = match stored {
            Ok(stored) if stored.source == source => {
                bookmarks.list = stored.bookmarks;
                return (bookmarks, Ok(()));
            }
            Ok(stored) => format!("it belongs to {}", stored.source),
            Err(error) => error,
        };
        let text = format!("{}: cannot read the bookmarks: {failure}.", file.display());
        bookmarks.file = None;
        (bookmarks, Err(text))
    }

    pub(crate) fn list(&self) -> &[Bookmark] {
        &self.list
    }

    /// Returns the pose of a bookmark; `None` if there is no such bookmark or no such camera.
    pub(crate) fn pose(&self, index: usize, frame: &FileFrame, like: &Pose) -> Option<Pose> {
        let record = &self.list.get(index)?.camera;
        let camera = record.camera(frame).ok()?;
        let (eye, target) = (camera.eye(), camera.eye() + camera.forward());
        Some(Pose::upright(eye, target, like.up, record.fov))
    }

    /// Adds a bookmark of a pose and stores the list. An empty name becomes the bookmark's number.
    ///
    /// # Errors
    /// The error of the system.
    pub(crate) fn add(&mut self, name: &str, pose: &Pose, frame: &FileFrame) -> io::Result<()> {
        let name = match name.trim() {
            "" => format!("View {}", self.list.len() + 1),
            name => name.into(),
        };
        let camera = camera_file::record(pose, frame);
        self.list.push(Bookmark { name, camera });
        self.store()
    }

    /// Removes a bookmark and stores the list.
    ///
    /// # Errors
    /// The error of the system.
    pub(crate) fn remove(&mut self, index: usize) -> io::Result<()> {
        if index < self.list.len() {
            self.list.remove(index);
        }
        self.store()
    }

    fn store(&self) -> io::Result<()> {
        let Some(file) = &self.file else {
            return Ok(());
        };
        let stored = Stored {
            source: self.source.clone(),
            bookmarks: self.list.clone(),
        };
        export::write_json(file, &stored)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::{DVec3, dvec3};

    /// Rounding of poses in degrees and JSON, metres.
    const TOLERANCE_M: f64 = 1e-9;

    fn pose(x: f64) -> Pose {
        Pose::looking_at(dvec3(x, 1.0, 2.0), dvec3(0.0, 0.5, -3.0), 50.0)
    }

    #[test]
    fn bookmarks_are_kept_by_source() {
        let dir = tempfile::tempdir().unwrap();
        let folder = Some(dir.path().join("bookmarks"));
        let frame = FileFrame::default();
        let read = |source| {
            let (bookmarks, result) = Bookmarks::read(folder.as_ref(), source);
            result.unwrap();
            bookmarks
        };
        let mut room = read("room.ldi");
        room.add(" desk ", &pose(1.0), &frame).unwrap();
        room.add("", &pose(2.0), &frame).unwrap();
        let again = read("room.ldi");
        let names: Vec<_> = again.list().iter().map(|b| b.name.as_str()).collect();
        assert_eq!(names, ["desk", "View 2"]);
        let found = again.pose(1, &frame, &pose(0.0)).unwrap();
        assert!(found.eye.distance(pose(2.0).eye) < TOLERANCE_M);
        assert!(found.forward().distance(pose(2.0).forward()) < TOLERANCE_M);
        assert!((found.fov_y_deg - 50.0).abs() < TOLERANCE_M && found.up == DVec3::Y);
        assert_eq!(again.pose(2, &frame, &pose(0.0)), None);
        assert!(read("other.ldi").list().is_empty());
        room.remove(0).unwrap();
        assert_eq!(read("room.ldi").list().len(), 1);
    }

    #[test]
    fn damaged_bookmarks_are_reported_and_kept() {
        let dir = tempfile::tempdir().unwrap();
        let folder = Some(dir.path().to_owned());
        let file = dir.path().join(thumbnails::digest("a") + ".json");
        std::fs::write(&file, "{").unwrap();
        let (mut bookmarks, result) = Bookmarks::read(folder.as_ref(), "a");
        assert!(result.unwrap_err().contains("cannot read the bookmarks"));
        bookmarks
            .add("x", &pose(0.0), &FileFrame::default())
            .unwrap();
        assert_eq!(std::fs::read_to_string(&file).unwrap(), "{");
    }
}
