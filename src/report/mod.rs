//! Speed against error, measured; and what is shown to people: charts, sheets of pictures side by side.
//!
//! A report is a plan ([`plan`]: sizes, seeded eyes), contenders ([`contender`]: anything that draws), their measurement in
//! turns ([`measure`]) against truth that is good enough ([`truths`]), and rows ([`row`]). All that people read, the charts
//! ([`figures`]), the sentences ([`summary`]) and the page beside the papers' numbers ([`results`]), is made from the rows
//! alone. [`stability`] is the other half: hard numerical cases with bounds.

pub mod captures;
pub mod chart;
pub mod contender;
pub mod cube_map;
mod field;
pub mod figures;
pub mod font;
pub mod growth;
pub mod machine;
pub mod measure;
pub mod plan;
pub mod promises;
pub mod results;
pub mod row;
pub mod scene;
pub mod sheet;
pub mod sprite_range;
pub mod stability;
pub mod stats;
pub mod summary;
pub mod truths;
