//! Ctrl-C, or a request to terminate.

use std::sync::atomic::{AtomicBool, Ordering};

/// The exit code of a command that was interrupted, whatever it kept.
pub(super) const EXIT_CODE: u8 = 130;

/// True if the command writes partial results on an interrupt.
static KEEPS: AtomicBool = AtomicBool::new(false);

/// True after an interrupt.
static ASKED: AtomicBool = AtomicBool::new(false);

/// From now on an interrupt ends the program, without a half-written file; unless the command
/// [keeps what it has done](keep_what_is_done).
pub(super) fn handle() -> Result<(), ctrlc::Error> {
    /// True once the handler is installed: a process may run several commands.
    static HANDLED: AtomicBool = AtomicBool::new(false);
    if HANDLED.swap(true, Ordering::SeqCst) {
        return Ok(());
    }
    ctrlc::set_handler(|| {
        let first = !ASKED.swap(true, Ordering::SeqCst);
        if first && KEEPS.load(Ordering::SeqCst) {
            eprintln!("interrupted: ending with what there is; once more to end at once");
        } else {
            end();
        }
    })
}

/// From now on a first interrupt is left to the command, which looks at [`asked`] now and then.
pub(super) fn keep_what_is_done() {
    KEEPS.store(true, Ordering::SeqCst);
}

/// Returns true if the command should end soon.
pub(super) fn asked() -> bool {
    ASKED.load(Ordering::SeqCst)
}

/// Ends the program, without a half-written file.
pub(super) fn end() -> ! {
    headbox_core::files::remove_unfinished();
    std::process::exit(EXIT_CODE.into())
}
