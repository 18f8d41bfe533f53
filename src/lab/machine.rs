//! Machine and program of a measurement.

use headbox_core::simd;
use serde::{Deserialize, Serialize};
use std::path::Path;
use std::process::Command;
use std::time::UNIX_EPOCH;

/// The computer.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Machine {
    /// Name of the processor, if the system tells.
    pub processor: String,
    /// Threads of this run.
    pub threads: usize,
    /// The SIMD level that frames are drawn with.
    pub simd: String,
    /// Operating system and architecture.
    pub system: String,
    /// Load average of the last minute when the run began, in hundredths; timings of a busy machine
    /// scatter.
    pub load_hundredths: Option<u32>,
}

impl Machine {
    /// This one.
    pub fn here() -> Self {
        let processor = first_line_after("/proc/cpuinfo", "model name").unwrap_or_default();
        let load = std::fs::read_to_string("/proc/loadavg").ok();
        let load = load.and_then(|text| text.split_whitespace().next()?.parse::<f64>().ok());
        Self {
            processor: if processor.is_empty() {
                "unknown".into()
            } else {
                processor
            },
            threads: rayon::current_num_threads(),
            simd: simd::name(simd::level()).to_owned(),
            system: format!("{} {}", std::env::consts::OS, std::env::consts::ARCH),
            load_hundredths: load.map(|load| (load * 100.0).round() as u32),
        }
    }
}

/// Two lines of two files of Linux: crates that know them on other systems read and compile a whole
/// system's worth.
fn first_line_after(path: &str, key: &str) -> Option<String> {
    let text = std::fs::read_to_string(path).ok()?;
    let line = text.lines().find(|line| line.starts_with(key))?;
    Some(line.split_once(':')?.1.trim().to_owned())
}

/// The commit of the repository that holds the running program, with `+` if its tracked files have
/// been changed or the program was built before it; `unknown` if it lies in none, or there is no
/// git.
pub fn commit() -> String {
    let found = || {
        let program = std::env::current_exe().ok()?;
        let folder = program.parent()?;
        let commit = git(folder, &["rev-parse", "--short=12", "HEAD"])?;
        // A dirty work tree is one in which this program's own sources may differ.
        let changed = git(folder, &["status", "--porcelain", "--untracked-files=no"])?;
        let built = program
            .metadata()
            .ok()?
            .modified()
            .ok()?
            .duration_since(UNIX_EPOCH)
            .ok()?
            .as_secs();
        let committed: u64 = git(folder, &["log", "-1", "--format=%ct"])?.parse().ok()?;
        Some(if changed.is_empty() && built >= committed {
            commit
        } else {
            commit + "+"
        })
    };
    found().unwrap_or_else(|| "unknown".into())
}

fn git(folder: &Path, arguments: &[&str]) -> Option<String> {
    let output = Command::new("git")
        .arg("-C")
        .arg(folder)
        .args(arguments)
        .output()
        .ok()?;
    output
        .status
        .success()
        .then(|| String::from_utf8_lossy(&output.stdout).trim().to_owned())
}
