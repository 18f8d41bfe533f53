//! The memory that input files may take: one budget for the whole process, so that many files, or a
//! small one that declares much, end in an error and not in an abort.
//!
//! A decoder, or what is made of its output, calls [`reserve`] before it allocates, and holds the
//! [`Reservation`] until it has. What is kept afterwards counts as resident memory of the
//! process. While pages of a reservation are being written they count twice, so the budget is used
//! up early, never late.

use std::io;
use std::path::Path;
use std::sync::atomic::{AtomicU64, Ordering};

/// Limit where the system does not report free memory, bytes.
const DEFAULT_LIMIT: u64 = 8 << 30;

/// Limit of resident and reserved memory, bytes; 0 until it is known.
static LIMIT: AtomicU64 = AtomicU64::new(0);
/// Sum of all reservations, bytes.
static RESERVED: AtomicU64 = AtomicU64::new(0);

/// A decoder would take more memory than is left.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error(
    "needs at least {} MiB of memory, but of the {} MiB that may be used {} MiB are left; set a \
     higher limit with --memory",
    .needed.div_ceil(1 << 20), .limit >> 20, .left >> 20
)]
pub struct OverBudget {
    /// Bytes that were asked for.
    pub needed: u64,
    /// Bytes that are left.
    pub left: u64,
    /// The budget, bytes.
    pub limit: u64,
}

impl From<OverBudget> for io::Error {
    fn from(error: OverBudget) -> Self {
        Self::new(io::ErrorKind::OutOfMemory, error)
    }
}

/// Memory that a decoder may take until this is dropped.
#[derive(Debug)]
#[must_use]
pub struct Reservation(u64);

impl Drop for Reservation {
    fn drop(&mut self) {
        RESERVED.fetch_sub(self.0, Ordering::Relaxed);
    }
}

impl Reservation {
    /// Bytes that its decoder may allocate: these, and what is left of the budget.
    #[must_use]
    pub fn allowed(&self) -> u64 {
        let used = RESERVED
            .load(Ordering::Relaxed)
            .saturating_add(resident().unwrap_or(0));
        self.0.saturating_add(limit().saturating_sub(used))
    }

    /// Returns the error of a decoder that needs more than is [`Self::allowed`].
    #[must_use]
    pub fn exceeded(&self) -> OverBudget {
        let left = self.allowed();
        OverBudget {
            needed: left.saturating_add(1),
            left,
            limit: limit(),
        }
    }
}

/// Sets the limit of the process's memory while input files are decoded, bytes. Without this call
/// it is the resident memory at the first reservation and half of the memory that is free then.
pub fn set_limit(bytes: u64) {
    LIMIT.store(bytes.max(1), Ordering::Relaxed);
}

/// Reserves memory.
///
/// # Errors
/// [`OverBudget`] if resident memory, all reservations and `bytes` together exceed the limit.
pub fn reserve(bytes: u64) -> Result<Reservation, OverBudget> {
    /// Smaller ones are never refused: an error about them would help nobody.
    const ALWAYS: u64 = 1 << 20;
    let reservation = Reservation(bytes);
    let others = RESERVED.fetch_add(bytes, Ordering::Relaxed);
    if bytes <= ALWAYS {
        return Ok(reservation);
    }
    let limit = limit();
    let used = others.saturating_add(resident().unwrap_or(0));
    let left = limit.saturating_sub(used);
    if bytes > left {
        return Err(OverBudget {
            needed: bytes,
            left,
            limit,
        });
    }
    Ok(reservation)
}

/// Reads a file whose size is within the budget.
///
/// # Errors
/// I/O errors; [`OverBudget`] in one of kind [`io::ErrorKind::OutOfMemory`].
pub fn read_file(path: &Path) -> io::Result<Vec<u8>> {
    let _memory = reserve(std::fs::metadata(path)?.len())?;
    std::fs::read(path)
}

/// Peak and current resident memory of this process, bytes, if the system reports it (Linux).
#[must_use]
pub fn peak_and_resident() -> Option<[u64; 2]> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    Some([kib_field(&status, "VmHWM:")?, kib_field(&status, "VmRSS:")?])
}

fn resident() -> Option<u64> {
    peak_and_resident().map(|[_, resident]| resident)
}

/// Returns the limit; the first call determines it if none was set.
fn limit() -> u64 {
    match LIMIT.load(Ordering::Relaxed) {
        0 => {
            let limit = default_limit();
            LIMIT.store(limit, Ordering::Relaxed);
            limit
        }
        limit => limit,
    }
}

/// Returns the memory that new allocations can take without swapping, bytes; `None` if the system
/// does not tell.
pub fn free() -> Option<u64> {
    kib_field(
        &std::fs::read_to_string("/proc/meminfo").ok()?,
        "MemAvailable:",
    )
}

fn default_limit() -> u64 {
    free().map_or(DEFAULT_LIMIT, |free| resident().unwrap_or(0) + free / 2)
}

/// Returns a field of a table of /proc, bytes.
fn kib_field(table: &str, name: &str) -> Option<u64> {
    let line = table.lines().find_map(|line| line.strip_prefix(name))?;
    Some(line.trim().strip_suffix("kB")?.trim().parse::<u64>().ok()? * 1024)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn reservations_end_at_the_limit() {
        // One test: the limit belongs to the process.
        let most = 1 << 60;
        set_limit(most);
        let half = reserve(most / 2).expect("half of the limit");
        let error = reserve(most / 2).expect_err("resident memory is used, too");
        assert!(error.left < most / 2 && error.limit == most, "{error:?}");
        assert!(error.to_string().contains("--memory"), "{error}");
        let allowed = half.allowed();
        assert!(allowed > most / 2 && allowed < most, "{allowed}");
        drop(half);
        let _again = reserve(most / 2).expect("the first half is free again");
        set_limit(1);
        let _small = reserve(1000).expect("small ones are not refused");
        reserve(2 << 20).expect_err("no memory is left");
        set_limit(0);
    }

    #[test]
    fn fields_of_proc_are_read() {
        assert_eq!(
            kib_field("VmPeak:\t 9 kB\nVmRSS:\t   12 kB\n", "VmRSS:"),
            Some(12 * 1024)
        );
        assert_eq!(kib_field("VmRSS:\t12\n", "VmRSS:"), None);
    }
}
