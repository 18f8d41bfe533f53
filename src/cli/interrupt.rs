//! Handling of Ctrl-C and of requests to terminate.

use std::sync::atomic::{AtomicBool, Ordering};

/// Exit code of a command that was interrupted, with or without partial results.
pub(super) const EXIT_CODE: u8 = 130;

/// True if the command writes partial results on an interrupt.
static KEEPS_PARTIAL_RESULTS: AtomicBool = AtomicBool::new(false);

/// True after an interrupt.
static REQUESTED: AtomicBool = AtomicBool::new(false);

/// Installs the handler: an interrupt ends the program, without a partly written file, unless the
/// command [keeps partial results](keep_partial_results).
pub(super) fn handle() -> anyhow::Result<()> {
    /// True once the handler is installed: a process may run several commands.
    static INSTALLED: AtomicBool = AtomicBool::new(false);
    if INSTALLED.swap(true, Ordering::SeqCst) {
        return Ok(());
    }
    survive_file_size_limit()?;
    let set = ctrlc::set_handler(|| {
        let first = !REQUESTED.swap(true, Ordering::SeqCst);
        if first && KEEPS_PARTIAL_RESULTS.load(Ordering::SeqCst) {
            eprintln!("interrupted: ending with what there is; once more to end at once");
        } else {
            exit();
        }
    });
    Ok(set?)
}

/// Makes it an error to write beyond the system's limit of a file's size (`ulimit -f`), instead of
/// the end of the process without a message: a handled signal does not end it.
#[cfg(unix)]
fn survive_file_size_limit() -> std::io::Result<()> {
    use signal_hook::{consts::SIGXFSZ, flag};
    flag::register(SIGXFSZ, std::sync::Arc::default()).map(drop)
}

#[cfg(not(unix))]
fn survive_file_size_limit() -> std::io::Result<()> {
    Ok(())
}

/// Leaves a first interrupt to the command, which polls [`is_requested`].
pub(super) fn keep_partial_results() {
    KEEPS_PARTIAL_RESULTS.store(true, Ordering::SeqCst);
}

/// Returns true if the command should end soon.
pub(super) fn is_requested() -> bool {
    REQUESTED.load(Ordering::SeqCst)
}

/// Ends the program, without a partly written file.
pub(super) fn exit() -> ! {
    headbox_core::files::remove_unfinished();
    std::process::exit(EXIT_CODE.into())
}
