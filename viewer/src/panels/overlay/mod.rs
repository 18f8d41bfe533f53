//! Marks, maps and messages over the frame.

pub(crate) mod divider;
pub(crate) mod headboxes;
pub(crate) mod inset;
pub(crate) mod legend;
pub(crate) mod messages;
pub(crate) mod room_map;
pub(crate) mod strip;
