//! Promises of the command line, tested on the built program as a user runs it.

mod run;

mod usage;

mod capture;
mod demo_cli;
mod exports;
mod houses;
mod images;
mod lumigraph_cli;
mod sprite_cli;
