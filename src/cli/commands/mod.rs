//! The commands of `headbox`, one file or folder each.

pub(crate) mod capture;
pub(crate) mod compare;
pub(crate) mod demo;
pub(crate) mod export;
pub(crate) mod house;
pub(crate) mod images;
pub(crate) mod info;
pub(crate) mod lumigraph;
pub(crate) mod merge;
pub(crate) mod render;
pub(crate) mod report;
pub(crate) mod scenes;
pub(crate) mod sprite;
pub(crate) mod truth;
#[cfg(feature = "viewer")]
pub(crate) mod view;
pub(crate) mod walk;
