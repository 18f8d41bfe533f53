//! Houses: the command, its files, and their portals.

mod house;
mod portal_cli;
