//! Sections of the side panel.

pub(crate) mod bookmarks;
pub(crate) mod camera;
pub(crate) mod chart;
pub(crate) mod display;
pub(crate) mod headbox;
pub(crate) mod record;
pub(crate) mod source;
pub(crate) mod statistics;
