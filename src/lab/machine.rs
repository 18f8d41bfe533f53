//! Machine and program of a measurement.

use headbox_core::simd;
use serde::{Deserialize, Serialize};
use std::path::Path;
use std::process::Command;
use std::time::UNIX_EPOCH;

/// The machine of a measurement.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Machine {
    /// Name of the processor, or "unknown".
    pub processor: String,
    /// Number of threads.
    pub threads: usize,
    /// Name of the SIMD level of rendering.
    pub simd: String,
    /// Operating system and architecture.
    pub system: String,
    /// Load average of the minute before the run, in hundredths: timings of a busy machine scatter.
    pub load_hundredths: Option<u32>,
}

impl Machine {
    /// Describes this machine.
    pub fn here() -> Self {
        let load = std::fs::read_to_string("/proc/loadavg").ok();
        let load = load.and_then(|text| text.split_whitespace().next()?.parse::<f64>().ok());
        Self {
            processor: processor_name()
                .filter(|name| !name.is_empty())
                .unwrap_or_else(|| "unknown".into()),
            threads: rayon::current_num_threads(),
            simd: simd::name(simd::level()).to_owned(),
            system: format!("{} {}", std::env::consts::OS, std::env::consts::ARCH),
            load_hundredths: load.map(|load| (load * 100.0).round() as u32),
        }
    }
}

/// Reads the processor's name on Linux. Crates that support other systems are large for one line.
fn processor_name() -> Option<String> {
    let text = std::fs::read_to_string("/proc/cpuinfo").ok()?;
    let line = text.lines().find(|line| line.starts_with("model name"))?;
    Some(line.split_once(':')?.1.trim().to_owned())
}

/// Returns the commit of the repository that contains the running program, with `+` if tracked
/// files have changed or the program is older than the commit; `unknown` without a repository or
/// without git.
pub fn commit() -> String {
    let commit = || {
        let program = std::env::current_exe().ok()?;
        let folder = program.parent()?;
        let commit = git(folder, &["rev-parse", "--short=12", "HEAD"])?;
        // In a dirty work tree the program's own sources may differ.
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
    commit().unwrap_or_else(|| "unknown".into())
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
