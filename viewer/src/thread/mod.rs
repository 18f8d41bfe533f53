//! The render thread, and the exchange between it and the window.

pub(crate) mod exchange;
pub(crate) mod history;
pub(crate) mod resolution;
pub(crate) mod session;
pub(crate) mod slot;
mod worker;
