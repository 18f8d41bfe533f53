//! The memory allocator under `--memory`.

/// Makes the allocator return freed memory to the system: starts this program again in the same
/// process, with the same arguments, and with the environment that glibc reads once at the start.
///
/// By default glibc keeps freed blocks of up to 32 MiB for later, up to half of the peak of a
/// capture (docs/decisions/0073). Does nothing with other C libraries, if the user has set the
/// variable, or if the program cannot be started again.
#[cfg(all(target_os = "linux", target_env = "gnu"))]
pub(crate) fn return_freed_memory() {
    use std::os::unix::process::CommandExt;

    /// Size from which blocks are returned as soon as they are freed, bytes. glibc raises it with
    /// each larger block that is freed, unless it is set.
    const THRESHOLD: (&str, &str) = ("MALLOC_MMAP_THRESHOLD_", "1048576");
    /// Number of pools of smaller blocks: each would keep what its threads have freed.
    const POOLS: (&str, &str) = ("MALLOC_ARENA_MAX", "1");

    if std::env::var_os(THRESHOLD.0).is_some() {
        return;
    }
    if let Ok(program) = std::env::current_exe() {
        // Returns only if it fails: the command then runs with more memory.
        let _ = std::process::Command::new(program)
            .args(std::env::args_os().skip(1))
            .envs([THRESHOLD, POOLS])
            .exec();
    }
}

/// Does nothing: other allocators return freed memory by themselves.
#[cfg(not(all(target_os = "linux", target_env = "gnu")))]
pub(crate) fn return_freed_memory() {}
