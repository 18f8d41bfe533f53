//! The command line of headbox.

fn main() {}
