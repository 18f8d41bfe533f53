//! SIMD level of the process, chosen once from the processor and `HEADBOX_SIMD`.
//!
//! Every level gives the same bits (docs/simd.md); it only affects time.

use fearless_simd::Level;
use std::sync::LazyLock;

/// Environment variable that selects a level.
pub const VARIABLE: &str = "HEADBOX_SIMD";

/// Error of requesting a level that the processor does not have.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{VARIABLE}={wanted}: this machine has no such SIMD level; it has {available}")]
pub struct LevelError {
    wanted: String,
    available: String,
}

/// Returns the level in use: that of `HEADBOX_SIMD` if the processor has it, else the processor's
/// best.
pub fn level() -> Level {
    static LEVEL: LazyLock<Level> = LazyLock::new(|| requested().unwrap_or_else(|_| Level::new()));
    *LEVEL
}

/// Returns the level requested by `HEADBOX_SIMD`, or the processor's best if it is not set.
///
/// # Errors
///
/// If `HEADBOX_SIMD` is not the name of a level of this processor.
pub fn requested() -> Result<Level, LevelError> {
    match std::env::var_os(VARIABLE) {
        Some(wanted) if !wanted.is_empty() => find(&wanted.to_string_lossy()),
        _ => Ok(Level::new()),
    }
}

/// Finds a level by name among [`levels`].
fn find(wanted: &str) -> Result<Level, LevelError> {
    let levels = levels();
    let found = levels.iter().find(|level| name(**level) == wanted);
    found.copied().ok_or_else(|| LevelError {
        wanted: wanted.to_owned(),
        available: levels
            .iter()
            .map(|level| name(*level))
            .collect::<Vec<_>>()
            .join(", "),
    })
}

/// Returns the levels of this processor, the lowest first. All give the same bits.
pub fn levels() -> Vec<Level> {
    let best = Level::new();
    let mut levels = vec![Level::baseline()];
    #[cfg(target_arch = "x86_64")]
    {
        levels.extend(best.as_sse4_2().map(Level::Sse4_2));
        levels.extend(best.as_avx2().map(Level::Avx2));
    }
    levels.push(best);
    levels.dedup_by_key(|level| name(*level));
    levels
}

/// Returns the name of a level: `fallback` (the baseline of the architecture: SSE2 on x86-64,
/// scalar code elsewhere), `sse4.2`, `avx2`, `avx512`, or `neon`.
pub fn name(level: Level) -> &'static str {
    #[cfg(target_arch = "x86_64")]
    {
        let names = [
            (level.as_avx512().is_some(), "avx512"),
            (level.as_avx2().is_some(), "avx2"),
            (level.as_sse4_2().is_some(), "sse4.2"),
        ];
        if let Some((_, name)) = names.iter().find(|(has, _)| *has) {
            return name;
        }
    }
    #[cfg(target_arch = "aarch64")]
    if level.as_neon().is_some() {
        return "neon";
    }
    let _ = level;
    "fallback"
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn level_by_name_refuses_unknown_names() {
        let levels = levels();
        assert_eq!(
            name(levels[levels.len() - 1]),
            name(Level::new()),
            "the best comes last"
        );
        for level in &levels {
            assert_eq!(find(name(*level)).map(name), Ok(name(*level)));
        }
        for wanted in ["AVX2", "sse9", "fast"] {
            let error = find(wanted).expect_err("is no level").to_string();
            assert!(
                error.contains(wanted) && error.contains(name(levels[0])),
                "{error}"
            );
        }
    }
}
