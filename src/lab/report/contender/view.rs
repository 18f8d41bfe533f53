//! Any registered representation, through the interface of the command line and the window.

use super::{ContenderFrame, Draw};
use headbox_core::camera::Camera;
use headbox_core::view::{Control, FrameRequest, SettingValues, View};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// View shared by several contenders, each with its own variant.
pub type SharedView = Arc<Mutex<Box<dyn View>>>;

/// A view under one variant.
pub struct ViewDraw {
    view: SharedView,
    values: Arc<SettingValues>,
}

impl ViewDraw {
    /// Returns the names of the variants of `view` and a renderer of each, the initial variant
    /// first.
    pub fn variants(view: &SharedView) -> Vec<(String, Self)> {
        let settings = lock(view).settings();
        let initial = SettingValues::initial(&settings);
        let draw = |values| Self {
            view: Arc::clone(view),
            values: Arc::new(values),
        };
        let setting = settings
            .iter()
            .find(|setting| setting.flag == Some("variant"));
        let name = setting.and_then(|setting| initial.text(setting));
        let mut variants = vec![(name.unwrap_or_default(), draw(initial.clone()))];
        let Some(setting) = setting else {
            return variants;
        };
        if let Control::Choice { options, .. } = &setting.control {
            for option in options {
                let mut values = initial.clone();
                let is_set = values.set_text(&settings, setting.id, option).is_ok();
                if is_set && values != initial {
                    variants.push((option.clone(), draw(values)));
                }
            }
        }
        variants
    }
}

/// Locks a view, poisoned or not: the next frame does not depend on the previous one.
fn lock(view: &SharedView) -> MutexGuard<'_, Box<dyn View>> {
    view.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Draw for ViewDraw {
    fn draw(&mut self, camera: &Camera) {
        let request = FrameRequest::complete(*camera, Arc::clone(&self.values));
        // An error shows in `picture`, as an empty frame.
        let _ = lock(&self.view).render(&request);
    }

    fn picture(&mut self, camera: &Camera) -> ContenderFrame {
        let request = FrameRequest::complete(*camera, Arc::clone(&self.values));
        match lock(&self.view).render(&request) {
            Ok(rendered) => ContenderFrame::from_frame(rendered.frame),
            Err(_) => ContenderFrame::default(),
        }
    }
}
