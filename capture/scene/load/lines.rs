//! Text files as lines, whatever they were written on.

use std::borrow::Cow;

/// The text of a file: UTF-8 where it is that, a byte-order mark taken off, anything else replaced.
pub fn decode(bytes: &[u8]) -> Cow<'_, str> {
    String::from_utf8_lossy(bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes))
}

/// The lines of a text with their numbers from 1, without leading and trailing space; a line that ends in a backslash
/// goes on in the next one and has the number of its first part. Lines end in line feeds (after a carriage return or
/// not), or in carriage returns alone if the text has no line feed.
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

/// The first word of a line and the rest, both without surrounding space.
pub fn keyword(line: &str) -> (&str, &str) {
    let (word, rest) = line.split_once(char::is_whitespace).unwrap_or((line, ""));
    (word, rest.trim())
}

/// The words of a line up to a comment.
pub(super) fn words(rest: &str) -> impl Iterator<Item = &str> {
    rest.split_whitespace()
        .take_while(|word| !word.starts_with('#'))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_of_every_system_with_continuations() {
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
