//! Reports of speed against error of all representations of a scene.
//!
//! A report has a plan ([`plan`]: sizes, seeded eyes) and contenders ([`contender`]: anything that
//! draws). They are timed in turns and compared with sufficiently exact truth ([`measurement`],
//! [`truth_samples`]), which gives rows ([`row`]); Embree's primary rays are timed for comparison
//! ([`rival`]). The charts ([`figures`]), the sentences ([`summary`]) and the page with the papers'
//! numbers ([`results`]) are generated from the rows alone.
//!
//! [`plan`]: crate::plan

pub mod scene;
pub mod subject;

pub mod captures;
pub mod contender;

pub mod measurement;
mod page;
pub mod rival;
pub mod row;
pub mod truth_samples;

pub use page::{figures, promises, results, summary};
