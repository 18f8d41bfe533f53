//! The command line of headbox.

fn main() -> std::process::ExitCode {
    headbox_cli::main()
}
