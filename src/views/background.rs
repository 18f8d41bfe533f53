//! Thread pools that take what others leave of the processor.

use rayon::{ThreadPool, ThreadPoolBuilder};

/// A pool of as many threads as the program uses elsewhere, all of the lowest priority where the
/// system can do that.
///
/// # Errors
/// One sentence, if threads cannot be started.
pub fn pool(name: &'static str) -> Result<ThreadPool, String> {
    let builder = ThreadPoolBuilder::new().num_threads(rayon::current_num_threads());
    let builder = builder
        .thread_name(move |i| format!("{name} {i}"))
        .start_handler(|_| yield_to_others());
    builder
        .build()
        .map_err(|error| format!("Cannot start threads for the {name}: {error}."))
}

/// Linux has a nice value per thread, and `setpriority` of "this process" sets that of the calling
/// thread. That it fails costs smoothness, nothing else.
#[cfg(target_os = "linux")]
fn yield_to_others() {
    let _ = rustix::process::setpriority_process(None, 19);
}

#[cfg(not(target_os = "linux"))]
fn yield_to_others() {}
