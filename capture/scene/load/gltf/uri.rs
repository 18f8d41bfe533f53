//! URIs of glTF: data in the URI, or a file.

use super::super::encoding::{decode_percent, name_of_bytes};
use super::super::named_files::find_file;
use headbox_core::files::InputFolder;

/// Resource of a URI.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum UriTarget {
    /// A file, relative to the scene file.
    File(String),
    /// Bytes in the URI itself, or the decoding error.
    Data(Result<Vec<u8>, String>),
}

/// Resolves a URI of a file in `folder`.
pub(super) fn resolve(uri: &str, folder: &InputFolder) -> UriTarget {
    let (scheme, data) = uri.split_once(':').unwrap_or_default();
    if !scheme.eq_ignore_ascii_case("data") {
        let mut names = file_names(uri);
        let is_there = |name: &String| find_file(name, folder.path(), folder).is_ok();
        let found = names.iter().skip(1).position(is_there);
        let found = match found {
            Some(other) if !is_there(&names[0]) => other + 1,
            _ => 0,
        };
        return UriTarget::File(names.swap_remove(found));
    }
    UriTarget::Data(match data.split_once(',') {
        Some((head, body)) if is_base64(head) => decode_base64(&decode_percent(body)),
        Some((_, body)) => Ok(decode_percent(body)),
        None => Err("a data URI without a comma".into()),
    })
}

/// Returns true if the head of a data URI ends with `;base64`.
fn is_base64(head: &str) -> bool {
    let last = head.rsplit_once(';').map(|(_, last)| last.trim());
    last.is_some_and(|it| it.eq_ignore_ascii_case("base64"))
}

/// Returns the names that a file of a URI may have, the most likely first: decoded, without query
/// and fragment, and as it is written.
fn file_names(uri: &str) -> Vec<String> {
    let path = uri.strip_prefix("file://").unwrap_or(uri);
    let decoded = |path: &str| name_of_bytes(decode_percent(path));
    let end = path.find(['?', '#']).unwrap_or(path.len());
    let mut names = vec![decoded(path), decoded(&path[..end]), path.to_owned()];
    names.dedup();
    names
}

/// Decodes base64 (RFC 4648, both alphabets); white space and padding are ignored.
fn decode_base64(text: &[u8]) -> Result<Vec<u8>, String> {
    let mut bytes = Vec::with_capacity(text.len() / 4 * 3);
    let (mut bits, mut count) = (0_u32, 0);
    for (place, &character) in text.iter().enumerate() {
        let value = match character {
            b'A'..=b'Z' => character - b'A',
            b'a'..=b'z' => character - b'a' + 26,
            b'0'..=b'9' => character - b'0' + 52,
            b'+' | b'-' => 62,
            b'/' | b'_' => 63,
            b'=' | b' ' | b'\t' | b'\r' | b'\n' => continue,
            _ => {
                return Err(format!(
                    "character {place} of its base64 text is not base64"
                ));
            }
        };
        (bits, count) = (bits << 6 | u32::from(value), count + 6);
        if count >= 8 {
            count -= 8;
            bytes.push((bits >> count) as u8); // the cast drops the bits of earlier bytes
        }
    }
    Ok(bytes)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn uris_are_resolved() {
        // Test vectors of RFC 4648, section 10.
        for (text, bytes) in [
            ("", ""),
            ("Zg==", "f"),
            ("Zm8=", "fo"),
            ("Zm9v", "foo"),
            ("Zm9v YmFy", "foobar"),
        ] {
            let decoded = decode_base64(text.as_bytes());
            assert_eq!(decoded, Ok(bytes.as_bytes().to_vec()));
        }
        let temporary = tempfile::tempdir().expect("a folder");
        let folder = InputFolder::new(temporary.path());
        let resolve = |uri: &str| resolve(uri, &folder);
        assert_eq!(
            resolve("data:application/octet-stream;base64,-_8="),
            UriTarget::Data(Ok(vec![0xfb, 0xff]))
        );
        for uri in ["DATA:image/png;BASE64,-_8=", "data:;base64,-%5F8%3D"] {
            assert_eq!(resolve(uri), UriTarget::Data(Ok(vec![0xfb, 0xff])), "{uri}");
        }
        for (uri, file) in [("a%20b.png", "a%20b.png"), ("c.png?v=3#x", "c.png")] {
            std::fs::write(temporary.path().join(file), "").expect("written");
            assert_eq!(resolve(uri), UriTarget::File(file.into()));
        }
        assert_eq!(resolve("data:,a%20b"), UriTarget::Data(Ok(b"a b".to_vec())));
        assert!(matches!(resolve("data:;base64,?"), UriTarget::Data(Err(_))));
        assert!(matches!(resolve("data:x"), UriTarget::Data(Err(_))));
        assert_eq!(
            resolve("my%20wood%.png%4"),
            UriTarget::File("my wood%.png%4".into())
        );
        // Names of programs for Windows, in Latin-1.
        std::fs::write(temporary.path().join("\u{fc}.png"), "").expect("written");
        assert_eq!(resolve("%FC.png"), UriTarget::File("\u{fc}.png".into()));
    }
}
