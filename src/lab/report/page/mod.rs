//! Pages of a report, from its rows: first lines (`brief`), sentences (`summary`), charts
//! (`figures`), the short page (`results`), and claims of the README (`promises`).

mod brief;
pub mod figures;
mod format;
pub mod promises;
pub mod results;
pub mod summary;
