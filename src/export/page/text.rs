//! Encoding of bytes as text of a page: seven bits per character, at a cost of 8/7 and a little,
//! whatever charset a server declares.
//!
//! A script element preserves every ASCII character except three: NUL, carriage return, and `<`,
//! which might end it. U+0080, U+0081 and U+0082 replace them. Base64 costs 4/3.

/// Characters that a script element does not preserve.
const REPLACED: [u8; 3] = [0, b'\r', b'<'];

/// Encodes bytes in groups of seven bits, from the lowest of the first byte on.
pub(super) fn encode(bytes: &[u8]) -> String {
    let mut text = String::with_capacity(bytes.len() * 7 / 6);
    let (mut bits, mut bit_count) = (0u32, 0);
    for byte in bytes {
        bits |= u32::from(*byte) << bit_count;
        bit_count += 8;
        while bit_count >= 7 {
            text.push(character(bits as u8 & 127));
            (bits, bit_count) = (bits >> 7, bit_count - 7);
        }
    }
    if bit_count > 0 {
        text.push(character(bits as u8 & 127));
    }
    text
}

fn character(seven: u8) -> char {
    match REPLACED.iter().position(|replaced| *replaced == seven) {
        Some(i) => char::from(128 + i as u8),
        None => char::from(seven),
    }
}

/// Encodes bytes as Base64, for the poster, which is shown before any script runs.
pub(super) fn base64(bytes: &[u8]) -> String {
    const DIGITS: &[u8; 64] = b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    let mut text = String::with_capacity(bytes.len().div_ceil(3) * 4);
    for three in bytes.chunks(3) {
        let word = three.iter().enumerate().fold(0u32, |word, (i, byte)| {
            word | u32::from(*byte) << (16 - 8 * i)
        });
        for i in 0..4 {
            let digit = char::from(DIGITS[(word >> (18 - 6 * i)) as usize & 63]);
            text.push(if i <= three.len() { digit } else { '=' });
        }
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Decodes as `payload.js` does.
    fn decode(text: &str, count: usize) -> Vec<u8> {
        let (mut bits, mut bit_count, mut bytes) = (0u32, 0, Vec::new());
        for c in text.chars() {
            let c = c as usize;
            bits |= u32::from(if c < 128 { c as u8 } else { REPLACED[c - 128] }) << bit_count;
            bit_count += 7;
            if bit_count >= 8 && bytes.len() < count {
                bytes.push(bits as u8);
                (bits, bit_count) = (bits >> 8, bit_count - 8);
            }
        }
        bytes
    }

    #[test]
    fn base64_matches_rfc_4648() {
        for (bytes, expected) in [
            ("", ""),
            ("f", "Zg=="),
            ("fo", "Zm8="),
            ("foo", "Zm9v"),
            ("foobar", "Zm9vYmFy"),
        ] {
            assert_eq!(base64(bytes.as_bytes()), expected);
        }
    }

    #[test]
    fn encoded_bytes_round_trip() {
        for length in [0, 1, 6, 7, 8, 1000] {
            let bytes: Vec<u8> = (0..length)
                .map(|i: u32| (i.wrapping_mul(2_654_435_761) >> 13) as u8)
                .collect();
            let text = encode(&bytes);
            assert_eq!(decode(&text, bytes.len()), bytes);
            assert!(
                !text.contains(['\0', '\r', '<']) && text.len() <= bytes.len() * 6 / 5 + 4,
                "{length}"
            );
        }
    }
}
