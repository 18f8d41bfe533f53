//! From keys, mouse and wheel to poses and commands.

pub(crate) mod bounds;
mod commands;
pub(crate) mod flight;
pub(crate) mod keymap;
pub(crate) mod motion;
mod navigation;
pub(crate) mod pose;
pub(crate) mod steering;
mod viewport;
