//! Boundary around third-party code that may panic on malformed input.

use std::any::Any;
use std::cell::Cell;
use std::panic::{AssertUnwindSafe, catch_unwind};

thread_local! {
    static IS_CAUGHT: Cell<bool> = const { Cell::new(false) };
}

/// Runs `work`, and returns the message of its panic as an error. What `work` changes must be
/// dropped then.
///
/// # Errors
/// The panic's message.
pub fn catch<R>(work: impl FnOnce() -> R) -> Result<R, String> {
    let before = IS_CAUGHT.replace(true);
    let result = catch_unwind(AssertUnwindSafe(work));
    IS_CAUGHT.set(before);
    result.map_err(|panic| message(&*panic))
}

/// Returns true if this thread is inside [`catch`]: a panic hook then prints nothing.
#[must_use]
pub fn is_caught() -> bool {
    IS_CAUGHT.get()
}

/// Returns the message of a panic.
#[must_use]
pub fn message(panic: &(dyn Any + Send)) -> String {
    let text = panic.downcast_ref::<String>().map(String::as_str);
    let text = text.or_else(|| panic.downcast_ref::<&str>().copied());
    text.unwrap_or("panic without a message").into()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn panic_becomes_its_message() {
        assert_eq!(catch(|| 7), Ok(7));
        let caught: Result<(), _> = catch(|| panic!("row {}", 3));
        assert_eq!(caught, Err("row 3".into()));
        assert!(!is_caught());
        assert!(catch(is_caught).expect("no panic"));
    }
}
