//! Saving of frames, cameras and paths: the dialog asks where, then another thread writes.

use crate::panels::dialogs::save::{PendingSave, SaveContent};
use crate::playback::{camera_file, export};
use crate::thread::exchange::{ExportOrder, Order};
use crate::window::app::Viewer;
use crate::window::messages::Kind;
use headbox_core::view::Control;
use std::path::PathBuf;
use std::sync::Arc;

impl Viewer {
    /// Asks where to save the frame on the screen.
    pub(crate) fn save_frame(&mut self, now_s: f64) {
        let Some(frame) = self.frame_on_screen() else {
            let text = "There is no frame to save yet.";
            return self.messages.add(Kind::Error, text, now_s);
        };
        let write = move |path: &std::path::Path| {
            let (width, pixels) = frame();
            export::write_png(path, width, &pixels)
        };
        self.save_dialog.ask(PendingSave {
            title: "Save frame",
            stem: "frame".into(),
            extension: "png",
            content: SaveContent::File(Box::new(write)),
        });
    }

    /// Asks where to save the camera.
    pub(crate) fn save_camera(&mut self) {
        let (Some(info), Some(request)) = (&self.info, &self.view_request) else {
            return;
        };
        let mut record = camera_file::record(&self.eye.pose, &info.file_frame);
        record.size = Some(request.size_px);
        self.save_json("Save camera", "camera", record);
    }

    /// Asks where to save the recorded or loaded path.
    pub(crate) fn save_path(&mut self, now_s: f64) {
        let (Some(info), Some(path), Some(request)) =
            (&self.info, &self.path_recorder.path, &self.view_request)
        else {
            let text = "There is no path to save: record one (R).";
            return self.messages.add(Kind::Done, text, now_s);
        };
        let record = camera_file::path_record(path, request.size_px, &info.file_frame);
        self.save_json("Save path", "path", record);
    }

    fn save_json(
        &mut self,
        title: &'static str,
        stem: &'static str,
        record: impl serde::Serialize + Send + 'static,
    ) {
        let write = move |path: &std::path::Path| export::write_json(path, &record);
        self.save_dialog.ask(PendingSave {
            title,
            stem: stem.into(),
            extension: "json",
            content: SaveContent::File(Box::new(write)),
        });
    }

    /// Asks where to save the file of a button of the source's panel.
    pub(crate) fn save_from_source(&mut self, id: &'static str) {
        let settings = self.info.iter().flat_map(|info| &info.settings);
        let found = settings
            .filter(|setting| setting.id == id)
            .find_map(|it| match &it.control {
                Control::Save { stem, extension } => Some((stem.clone(), *extension)),
                _ => None,
            });
        if let Some((stem, extension)) = found {
            self.save_dialog.ask(PendingSave {
                title: "Save file",
                stem,
                extension,
                content: SaveContent::Source(id),
            });
        }
    }

    /// Asks where to write the frames of the path.
    pub(crate) fn export_path(&mut self, now_s: f64) {
        let (Some(path), Some(request)) = (&self.path_recorder.path, &self.view_request) else {
            let text = "There is no path to render: record one (R) or load one.";
            return self.messages.add(Kind::Done, text, now_s);
        };
        let order = ExportOrder {
            path: path.clone(),
            size: request.size_px,
            settings: Arc::clone(&self.sets.a),
            dir: PathBuf::new(),
        };
        self.save_dialog.ask(PendingSave {
            title: "Render path to folder",
            stem: "path".into(),
            extension: "frames",
            content: SaveContent::Frames(order),
        });
    }

    /// Saves what the dialog was about.
    pub(crate) fn save(&mut self, path: PathBuf, replace: bool, now_s: f64) {
        let Some(pending) = self.save_dialog.take() else {
            return;
        };
        match pending.content {
            SaveContent::File(write) => self.session.run_in_background(move || {
                let written = if replace {
                    write(&path)
                } else {
                    export::write_new(&path, write)
                };
                let path = path.display();
                match written {
                    Ok(()) => Ok(format!("Saved {path}.")),
                    Err(error) => Err(format!("{path} cannot be written: {error}.")),
                }
            }),
            SaveContent::Source(id) => self.session.order(Order::Save { id, path }),
            SaveContent::Frames(order) => match export::create_new_folder(&path) {
                Ok(()) => {
                    self.exporting = Some([0, order.path.poses().len()]);
                    self.session
                        .order(Order::Export(ExportOrder { dir: path, ..order }));
                }
                Err(error) => {
                    let text = format!("{} cannot be created: {error}.", path.display());
                    self.messages.add(Kind::Error, text, now_s);
                }
            },
        }
    }
}
