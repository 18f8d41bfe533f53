//! The tracer, against an oracle and in edge cases.

mod against_oracle;
mod edge_cases;
mod oracle;
