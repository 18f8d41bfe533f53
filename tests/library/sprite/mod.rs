//! Promises of sprites with depth and of compositions.

mod compose;
mod figure;
mod files;
mod oracle;
mod source_addresses;
mod warp;
