//! Shared test bed: analytic scenes whose every ray has a known answer, their capture, and the
//! comparison of frames.
#![allow(
    dead_code,
    missing_docs,
    unreachable_pub,
    reason = "every test file uses a part of it, and nobody else reads it"
)]

pub mod bed;
pub mod capture;
pub mod compare;
