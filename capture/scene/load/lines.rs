//! Lines of text files of any operating system.

use std::borrow::Cow;

/// Decodes UTF-8 without its byte-order mark; other bytes become replacement characters.
pub fn decode(bytes: &[u8]) -> Cow<'_, str> {
    String::from_utf8_lossy(bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes))
}

/// Returns the trimmed lines of a text with their numbers from 1. A backslash at its end continues
/// a line in the next one; it has the number of its first part. Lines end in line feeds, with or
/// without carriage returns, or in carriage returns if the text has no line feed.
pub fn lines(text: &str) -> impl Iterator<Item = (usize, Cow<'_, str>)> {
    let end = if text.contains('\n') { '\n' } else { '\r' };
    let mut parts = text.split(end).enumerate();
    std::iter::from_fn(move || {
        let (index, part) = parts.next()?;
        let mut line = Cow::from(part.trim());
        while let Some(unfinished) = line.strip_suffix('\\') {
            let Some((_, next)) = parts.next() else { break };
            line = format!("{unfinished} {}", next.trim()).into();
        }
        Some((index + 1, line))
    })
}

/// Splits a line into its first word and the rest, both trimmed.
pub fn keyword(line: &str) -> (&str, &str) {
    let (word, rest) = line.split_once(char::is_whitespace).unwrap_or((line, ""));
    (word, rest.trim())
}

/// Returns the words of a line before a comment.
pub(super) fn words(rest: &str) -> impl Iterator<Item = &str> {
    rest.split_whitespace()
        .take_while(|word| !word.starts_with('#'))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_with_any_line_end_are_split() {
        let collect = |text: &str| {
            lines(text)
                .map(|(n, l)| (n, l.into_owned()))
                .collect::<Vec<_>>()
        };
        let expected = [(1, "f 1 2  3".to_owned()), (3, "g a".to_owned())];
        assert_eq!(collect("f 1 2 \\\n 3\ng a"), expected);
        assert_eq!(collect("f 1 2 \\\r\n 3\r\n  g a\r"), expected);
        assert_eq!(collect("f 1 2 \\\r3\rg a"), expected);
        assert_eq!(collect("f \\"), [(1, "f \\".to_owned())]);
        assert_eq!(decode(b"\xef\xbb\xbfv \xff"), "v \u{fffd}");
        assert_eq!(keyword("usemtl\ta b #1 "), ("usemtl", "a b #1"));
        assert_eq!(words("1 2 # 3").collect::<Vec<_>>(), ["1", "2"]);
    }
}
