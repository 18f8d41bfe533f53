//! Promises of the command line as a whole: exit codes, messages, files, memory and streams.

mod bad_inputs;
mod cli;
mod guide_cli;
mod memory_cli;
mod paths_cli;
mod streams_cli;
mod strict_cli;
