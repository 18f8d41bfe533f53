//! Promises of the laboratory: reports, results, stability, citations.

mod citations;
mod results_page;
mod stability;
mod variants;
