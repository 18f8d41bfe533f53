//! Lines of text files of any operating system.

use std::borrow::Cow;

/// Returns the trimmed lines of a text with their numbers from 1. A backslash at its end continues
/// a line in the next one, except in a comment, where it may end a folder of Windows; it has the
/// number of its first part. Lines end in line feeds, with or without carriage returns, or in
/// carriage returns alone.
pub fn lines(text: &str) -> impl Iterator<Item = (usize, Cow<'_, str>)> {
    let mut parts = text
        .split('\n')
        .flat_map(|line| line.trim_end_matches('\r').split('\r'))
        .enumerate();
    std::iter::from_fn(move || {
        let (index, part) = parts.next()?;
        let part = part.trim();
        if !is_continued(part) {
            return Some((index + 1, Cow::from(part)));
        }
        let mut line = part.to_owned();
        let mut continues = true;
        while continues {
            let Some((_, next)) = parts.next() else { break };
            let next = next.trim();
            line.pop();
            line.push(' ');
            line.push_str(next);
            continues = is_continued(next);
        }
        Some((index + 1, line.into()))
    })
}

/// Returns true if a part of a line ends in a backslash that is not in a comment.
fn is_continued(part: &str) -> bool {
    let is_comment = |(at, _)| part[..at].is_empty() || part[..at].ends_with(char::is_whitespace);
    part.ends_with('\\') && !part.match_indices('#').any(is_comment)
}

/// Splits a line into its first word and the rest, both trimmed.
pub fn keyword(line: &str) -> (&str, &str) {
    let (word, rest) = line.split_once(char::is_whitespace).unwrap_or((line, ""));
    (word, rest.trim())
}

/// Returns the words of a line before a comment, which may follow a number without a space.
pub fn words(rest: &str) -> impl Iterator<Item = &str> {
    // Programs in C print NaN as "1.#QNAN".
    let comment = rest
        .match_indices('#')
        .find(|(at, _)| !rest[..*at].ends_with('.'));
    comment
        .map_or(rest, |(at, _)| &rest[..at])
        .split_whitespace()
}

/// Parses a number. The many spellings of NaN and infinity by other programs are NaN.
pub(super) fn number(word: &str) -> Option<f64> {
    word.parse().ok().or_else(|| {
        let lower = word.to_ascii_lowercase();
        let is_nan = ["nan", "inf", "ind", "#"]
            .iter()
            .any(|mark| lower.contains(mark));
        is_nan.then_some(f64::NAN)
    })
}

/// Returns true if a word before a comment is a number with a comma for the decimal point.
pub(super) fn has_decimal_comma(line: &str) -> bool {
    words(line).any(|word| word.contains(',') && word.replacen(',', ".", 1).parse::<f64>().is_ok())
}

/// Returns a name without the comment behind it; `None` if there is none. A number sign before a
/// digit belongs to the name, as in `Material #25`.
pub fn without_comment(name: &str) -> Option<&str> {
    let is_comment = |&(at, _): &(usize, &str)| {
        name[..at].ends_with(char::is_whitespace)
            && !name[at + 1..].starts_with(|c: char| c.is_ascii_digit())
    };
    let (at, _) = name.match_indices('#').find(is_comment)?;
    Some(name[..at].trim_end()).filter(|name| !name.is_empty())
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
        assert_eq!(
            collect("f 1 2 \\\n3\rg a"),
            expected[..1]
                .iter()
                .cloned()
                .chain([(3, "g a".to_owned())])
                .collect::<Vec<_>>()
        );
        assert_eq!(collect("f \\"), [(1, "f \\".to_owned())]);
        assert_eq!(
            collect("# C:\\models\\\nv 1"),
            [(1, "# C:\\models\\".to_owned()), (2, "v 1".to_owned())]
        );
        assert_eq!(
            collect("v 1 2 3 # C:\\scans\\\nv 1"),
            [
                (1, "v 1 2 3 # C:\\scans\\".to_owned()),
                (2, "v 1".to_owned())
            ]
        );
        assert_eq!(keyword("usemtl\ta b #1 "), ("usemtl", "a b #1"));
        assert!(has_decimal_comma("v 0 -1,5e3") && !has_decimal_comma("v a,b 1 # 0,5"));
        assert_eq!(without_comment("a #1 # b"), Some("a #1"));
        assert_eq!(without_comment("a#b #1"), None);
        assert_eq!(words("1 2 # 3").collect::<Vec<_>>(), ["1", "2"]);
        assert_eq!(words("1/1 2/2#3").collect::<Vec<_>>(), ["1/1", "2/2"]);
        assert_eq!(words("1.#QNAN 2 #3").collect::<Vec<_>>(), ["1.#QNAN", "2"]);
    }
    #[test]
    fn continued_lines_take_linear_time() {
        let text = "f 1 \\\n".repeat(400_000);
        let start = std::time::Instant::now();
        assert_eq!(lines(&text).count(), 1);
        assert!(
            start.elapsed().as_secs() < 5,
            "quadratic time takes minutes"
        );
    }
}
