//! The window itself: state, layout, start options, messages.

pub(crate) mod app;
pub(crate) mod desktop;
mod events;
pub(crate) mod layout;
pub(crate) mod messages;
pub(crate) mod options;
pub(crate) mod system_dialog;
pub(crate) mod views;
