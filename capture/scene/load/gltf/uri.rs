//! URIs as glTF uses them: data inside the URI, or a file beside.

/// What a URI refers to.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Target {
    /// A file, relative to the scene file.
    File(String),
    /// The bytes in the URI itself, or why they cannot be decoded.
    Data(Result<Vec<u8>, String>),
}

pub(super) fn resolve(uri: &str) -> Target {
    match uri.strip_prefix("data:") {
        Some(data) => Target::Data(match data.split_once(',') {
            Some((head, body)) if head.ends_with(";base64") => decode_base64(body),
            Some((_, body)) => Ok(decode_percent(body)),
            None => Err("a data URI without a comma".into()),
        }),
        None => {
            let path = uri.strip_prefix("file://").unwrap_or(uri);
            Target::File(String::from_utf8_lossy(&decode_percent(path)).into_owned())
        }
    }
}

/// `%41` is `A`; a percent sign that no two hexadecimal digits follow stands for itself.
fn decode_percent(text: &str) -> Vec<u8> {
    let mut bytes = Vec::with_capacity(text.len());
    let mut rest = text.as_bytes();
    while let Some((&first, after)) = rest.split_first() {
        let digit = |i: usize| after.get(i).and_then(|&b| char::from(b).to_digit(16));
        match (first, digit(0), digit(1)) {
            (b'%', Some(high), Some(low)) => {
                bytes.push((high * 16 + low) as u8); // at most 255
                rest = &after[2..];
            }
            _ => {
                bytes.push(first);
                rest = after;
            }
        }
    }
    bytes
}

/// RFC 4648, also its alphabet for URLs; white space and padding are skipped.
fn decode_base64(text: &str) -> Result<Vec<u8>, String> {
    let mut bytes = Vec::with_capacity(text.len() / 4 * 3);
    let (mut bits, mut count) = (0_u32, 0);
    for (place, character) in text.bytes().enumerate() {
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
            bytes.push((bits >> count) as u8); // the bits above are those of earlier bytes
        }
    }
    Ok(bytes)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn uris_of_every_kind() {
        // The test vectors of RFC 4648, section 10.
        for (text, bytes) in [
            ("", ""),
            ("Zg==", "f"),
            ("Zm8=", "fo"),
            ("Zm9v", "foo"),
            ("Zm9v YmFy", "foobar"),
        ] {
            assert_eq!(decode_base64(text), Ok(bytes.as_bytes().to_vec()));
        }
        assert_eq!(
            resolve("data:application/octet-stream;base64,-_8="),
            Target::Data(Ok(vec![0xfb, 0xff]))
        );
        assert_eq!(resolve("data:,a%20b"), Target::Data(Ok(b"a b".to_vec())));
        assert!(matches!(resolve("data:;base64,?"), Target::Data(Err(_))));
        assert!(matches!(resolve("data:x"), Target::Data(Err(_))));
        assert_eq!(
            resolve("my%20wood%.png%4"),
            Target::File("my wood%.png%4".into())
        );
        assert_eq!(resolve("%FF"), Target::File("\u{fffd}".into()));
    }
}
