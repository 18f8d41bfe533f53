//! Speed against error of everything that can show a scene.
//!
//! A report is a plan ([`plan`]: sizes, seeded eyes), contenders ([`contender`]: anything that
//! draws), their measurement in turns and against truth that is good enough ([`judge`],
//! [`growth`]), and rows ([`row`]); Embree's rays beside frames ([`rival`]). All that people read,
//! the charts ([`figures`]), the sentences ([`summary`]) and the page beside the papers' numbers
//! ([`results`]), is made from the rows alone.
//!
//! [`plan`]: crate::plan

mod brief;
pub mod captures;
pub mod contender;
mod field;
pub mod figures;
pub mod growth;
pub mod judge;
pub mod promises;
pub mod results;
pub mod rival;
pub mod row;
pub mod scene;
pub mod subject;
pub mod summary;
mod wall;
mod words;
