//! Causes of delays of a frame, as far as Linux reports them: the program itself, a disk, memory,
//! other programs, or the host of a virtual machine.

use std::fmt;
use std::fs::read_to_string;

/// Delays accumulated so far; for a frame, the difference.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Delays {
    /// Processor time of this program, of all threads, in steps of 10 ms.
    processor_ms: f64,
    /// Pages that it touched for the first time, and of these those that were read from a disk.
    faults: u64,
    read: u64,
    /// While any thread on this machine waited for a processor, a disk, memory, ms.
    waited_ms: [f64; 3],
    /// Processor time that the host gave to somebody else, in steps of 10 ms.
    stolen_ms: f64,
}

/// Milliseconds in a clock tick of Linux's tables.
const TICK_MS: f64 = 10.0;

impl Delays {
    /// All of it so far; zeros where the system does not tell.
    pub(crate) fn now() -> Self {
        // What follows the name of the program, which may hold blanks.
        let stat = read_to_string("/proc/self/stat").unwrap_or_default();
        let of_program: Vec<&str> = stat
            .rsplit(')')
            .next()
            .unwrap_or_default()
            .split_whitespace()
            .collect();
        let number = |i: usize| {
            of_program
                .get(i)
                .and_then(|text| text.parse::<u64>().ok())
                .unwrap_or(0)
        };
        let waited = ["cpu", "io", "memory"].map(|what| {
            let text = read_to_string(format!("/proc/pressure/{what}")).unwrap_or_default();
            let total = text
                .lines()
                .next()
                .and_then(|line| line.rsplit('=').next()?.parse::<f64>().ok());
            total.unwrap_or(0.0) / 1e3
        });
        let of_machine = read_to_string("/proc/stat").unwrap_or_default();
        let stolen = of_machine
            .split_whitespace()
            .nth(8)
            .and_then(|text| text.parse::<f64>().ok());
        Self {
            processor_ms: (number(11) + number(12)) as f64 * TICK_MS,
            faults: number(7) + number(9),
            read: number(9),
            waited_ms: waited,
            stolen_ms: stolen.unwrap_or(0.0) * TICK_MS,
        }
    }

    /// Delays since an earlier moment.
    pub(crate) fn since(&self, before: &Self) -> Self {
        Self {
            processor_ms: self.processor_ms - before.processor_ms,
            faults: self.faults - before.faults,
            read: self.read - before.read,
            waited_ms: std::array::from_fn(|i| self.waited_ms[i] - before.waited_ms[i]),
            stolen_ms: self.stolen_ms - before.stolen_ms,
        }
    }
}

impl fmt::Display for Delays {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        let Self {
            processor_ms,
            faults,
            read,
            waited_ms: [processor, disk, memory],
            stolen_ms,
        } = self;
        write!(
            f,
            "{processor_ms:.0} ms of processor, {faults} page faults ({read} read from disk); ms waited for a processor {processor:.1}, a disk \
             {disk:.1}, memory {memory:.1}; stolen by the host {stolen_ms:.0}"
        )
    }
}

/// Memory that this program has now, bytes, with what it has mapped and looked at.
pub(crate) fn resident_bytes() -> u64 {
    let status = read_to_string("/proc/self/status").unwrap_or_default();
    let line = status.lines().find_map(|line| line.strip_prefix("VmRSS:"));
    let kib = line.and_then(|line| line.split_whitespace().next()?.parse::<u64>().ok());
    kib.unwrap_or(0) * 1024
}
