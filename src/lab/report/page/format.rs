//! Formats of numbers and lists in sentences.

/// Formats a ratio of times.
pub(super) fn times(ratio: f64) -> String {
    if (0.97..1.03).contains(&ratio) {
        "the same time".into()
    } else if ratio < 9.95 {
        format!("{ratio:.2} times the time")
    } else {
        format!("{ratio:.0} times the time")
    }
}

/// Formats a time in milliseconds.
pub(super) fn ms(ms: f64) -> String {
    if ms < 10.0 {
        format!("{ms:.2} ms")
    } else {
        format!("{ms:.0} ms")
    }
}

/// Formats a number of bytes.
pub(super) fn bytes(bytes: u64) -> String {
    let kilobytes = bytes as f64 / 1e3;
    if kilobytes < 999.5 {
        format!("{kilobytes:.0} kB")
    } else {
        format!("{:.1} MB", kilobytes / 1e3)
    }
}

/// Joins items as `a`, `a and b`, `a, b and c`.
pub(super) fn list(mut items: Vec<String>) -> String {
    match (items.pop(), items.is_empty()) {
        (Some(last), false) => format!("{} and {last}", items.join(", ")),
        (Some(last), true) => last,
        (None, _) => "nothing".into(),
    }
}

#[cfg(test)]
mod tests {
    #[test]
    fn bytes_have_readable_units() {
        assert_eq!(
            [9_400, 999_499, 999_500, 50_600_000].map(super::bytes),
            ["9 kB", "999 kB", "1.0 MB", "50.6 MB"]
        );
    }
}
