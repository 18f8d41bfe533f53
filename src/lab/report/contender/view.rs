//! Any representation, through the interface that the command line and the window use.

use super::{Draw, JudgedFrame};
use headbox_core::camera::Camera;
use headbox_core::view::{Control, FrameRequest, SettingValues, View};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// A view that several contenders share, each with a variant of its own.
pub type SharedView = Arc<Mutex<Box<dyn View>>>;

/// A view under one variant.
pub struct ViewDraw {
    view: SharedView,
    values: Arc<SettingValues>,
}

impl ViewDraw {
    /// Draws `view` with its initial settings, and with each other option of its variant: the names
    /// of the variants, the initial one first.
    pub fn variants(view: &SharedView) -> Vec<(String, Self)> {
        let settings = lock(view).settings();
        let initial = SettingValues::initial(&settings);
        let draw = |values| Self {
            view: Arc::clone(view),
            values: Arc::new(values),
        };
        let of_variant = settings
            .iter()
            .find(|setting| setting.flag == Some("variant"));
        let mut found = vec![(
            of_variant
                .and_then(|setting| initial.text(setting))
                .unwrap_or_default(),
            draw(initial.clone()),
        )];
        let Some((setting, Control::Choice { options, .. })) =
            of_variant.map(|setting| (setting, &setting.control))
        else {
            return found;
        };
        for option in options {
            let mut values = initial.clone();
            let is_set = values.set_text(&settings, setting.id, option).is_ok();
            if is_set && values != initial {
                found.push((option.clone(), draw(values)));
            }
        }
        found
    }
}

/// A panic elsewhere leaves a view that renders the next frame from its own data.
fn lock(view: &SharedView) -> MutexGuard<'_, Box<dyn View>> {
    view.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Draw for ViewDraw {
    fn draw(&mut self, camera: &Camera) {
        let request = FrameRequest::complete(*camera, Arc::clone(&self.values));
        // What cannot be drawn is missing in the picture.
        let _ = lock(&self.view).render(&request);
    }

    fn picture(&mut self, camera: &Camera) -> JudgedFrame {
        let request = FrameRequest::complete(*camera, Arc::clone(&self.values));
        let mut view = lock(&self.view);
        let rendered = view.render(&request);
        rendered.map_or_else(
            |_| JudgedFrame::default(),
            |it| JudgedFrame::of_frame(it.frame),
        )
    }
}
