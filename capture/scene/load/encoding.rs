//! Encodings of text files and of file names.
//!
//! A text is UTF-8, or UTF-16 or UTF-32 by its byte-order mark. Others come from programs that
//! write the encoding of their country; no encoding loses a byte, so that names stay distinct.

use super::notes::{Note, Notes};
use encoding_rs::{
    BIG5, EUC_KR, Encoding, GB18030, MACINTOSH, SHIFT_JIS, UTF_8, UTF_16BE, UTF_16LE, WINDOWS_1250,
    WINDOWS_1251, WINDOWS_1252,
};
use headbox_core::files::fold_name;
use std::borrow::Cow;
use std::collections::BTreeSet;
use std::ffi::OsStr;
use unicode_normalization::UnicodeNormalization;

/// Encodings in which a name may have been written and, wrongly, been read.
const OF_NAMES: [&Encoding; 9] = [
    UTF_8,
    GB18030,
    SHIFT_JIS,
    WINDOWS_1252,
    BIG5,
    EUC_KR,
    WINDOWS_1251,
    WINDOWS_1250,
    MACINTOSH,
];

/// Decodes a text: by its byte-order mark, as UTF-8, or in the encoding that its bytes suggest,
/// which is noted with the `file` if it matters outside comments.
pub fn decode_text<'a>(bytes: &'a [u8], file: &str, notes: &mut Notes) -> Cow<'a, str> {
    let (text, guess) = decode(bytes);
    if let Some(guess) = guess {
        notes.add_named(Note::EncodingGuessed, format!("{file} ({guess})"));
    }
    text
}

/// Decodes a text as [`decode_text`] does. Returns the name of a guessed encoding, too.
fn decode(bytes: &[u8]) -> (Cow<'_, str>, Option<&'static str>) {
    let bytes = bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes);
    if let Some(text) = decode_utf32(bytes) {
        return (text.into(), None);
    }
    if let Some((encoding, mark)) = Encoding::for_bom(bytes) {
        let (text, damaged) = encoding.decode_without_bom_handling(&bytes[mark..]);
        return (text, damaged.then_some("damaged"));
    }
    if let Some(encoding) = utf16_without_mark(bytes) {
        return (
            encoding.decode_without_bom_handling(bytes).0,
            Some(encoding.name()),
        );
    }
    if let Ok(text) = std::str::from_utf8(bytes) {
        return (text.into(), None);
    }
    let encoding = suggested_encoding(bytes);
    let (text, _) = encoding.decode_without_bom_handling(bytes);
    let matters = bytes
        .split(|&byte| byte == b'\n' || byte == b'\r')
        .any(|l| {
            let statement = l.trim_ascii_start();
            !statement.starts_with(b"#") && !statement.is_ascii()
        });
    (text, matters.then_some(encoding.name()))
}

/// Decodes a text that begins with the byte-order mark of UTF-32, which in little-endian order
/// begins like that of UTF-16.
fn decode_utf32(bytes: &[u8]) -> Option<String> {
    let (code, bytes): (fn([u8; 4]) -> u32, _) = match bytes {
        [0xff, 0xfe, 0, 0, rest @ ..] => (u32::from_le_bytes, rest),
        [0, 0, 0xfe, 0xff, rest @ ..] => (u32::from_be_bytes, rest),
        _ => return None,
    };
    let codes = bytes.as_chunks().0.iter().map(|&bytes| code(bytes));
    let character = |code| char::from_u32(code).unwrap_or(char::REPLACEMENT_CHARACTER);
    Some(codes.map(character).collect())
}

/// Returns the encoding of a text that begins with two ASCII characters of two bytes each.
fn utf16_without_mark(bytes: &[u8]) -> Option<&'static Encoding> {
    match bytes {
        [1..=127, 0, 1..=127, 0, ..] => Some(UTF_16LE),
        [0, 1..=127, 0, 1..=127, ..] => Some(UTF_16BE),
        _ => None,
    }
}

/// Returns the encoding that the bytes of a text suggest, one in which they have no error.
///
/// Chinese of GB 2312 has pairs of bytes above 160, Japanese has lead bytes below that, and
/// Western European letters stand alone between ASCII ones.
fn suggested_encoding(bytes: &[u8]) -> &'static Encoding {
    let fits = |encoding: &'static Encoding| {
        encoding
            .decode_without_bom_handling_and_without_replacement(bytes)
            .is_some()
    };
    let runs = || {
        bytes
            .chunk_by(|a, b| a.is_ascii() == b.is_ascii())
            .filter(|run| !run.is_ascii())
    };
    let is_gb2312 = runs().all(|run| {
        let (pairs, rest) = run.as_chunks::<2>();
        rest.is_empty() && pairs.iter().all(|pair| pair[0] > 160 && pair[1] > 160)
    });
    let is_western = runs().all(|run| run.len() == 1 && run[0] > 160);
    let is_japanese = runs().any(|run| matches!(run[0], 0x81..=0x9f));
    if is_gb2312 && fits(GB18030) {
        GB18030
    } else if is_western {
        WINDOWS_1252
    } else if is_japanese && fits(SHIFT_JIS) {
        SHIFT_JIS
    } else if fits(GB18030) {
        GB18030
    } else if fits(SHIFT_JIS) {
        SHIFT_JIS
    } else {
        WINDOWS_1252 // has a character for each byte
    }
}

/// Returns what a name may be if it, or the file system, was read in a wrong encoding; empty for
/// ASCII.
pub(super) fn respellings(name: &str) -> BTreeSet<String> {
    if name.is_ascii() {
        return BTreeSet::new();
    }
    // No encoding but UTF-8 has the marks of decomposed letters.
    let name = compose(name);
    let encoded = OF_NAMES.iter().filter_map(|encoding| {
        let (bytes, _, unmappable) = encoding.encode(&name);
        (!unmappable).then_some(bytes)
    });
    encoded.flat_map(|bytes| spellings(&bytes)).collect()
}

/// Composes the letters of a name (Unicode NFC): macOS stores `ü` as `u` and a combining mark.
pub fn compose(name: &str) -> String {
    name.nfc().collect()
}

/// Returns the [folded](fold_name) spellings of a file name of the file system: one if it is UTF-8.
pub(super) fn spellings_of_file(name: &OsStr) -> BTreeSet<String> {
    match name.to_str() {
        Some(name) => BTreeSet::from([fold_name(name)]),
        None => spellings(name.as_encoded_bytes())
            .iter()
            .map(|name| fold_name(name))
            .collect(),
    }
}

/// Returns the name that bytes are as UTF-8; if they are not, one from which [`respellings`] finds
/// the name in their encoding.
pub(super) fn name_of_bytes(bytes: Vec<u8>) -> String {
    String::from_utf8(bytes).unwrap_or_else(|error| {
        let (name, _) = WINDOWS_1252.decode_without_bom_handling(error.as_bytes());
        name.into_owned() // it has a character for each byte
    })
}

/// Decodes `%41` as `A`; a percent sign without two hexadecimal digits stays.
pub(super) fn decode_percent(text: &str) -> Vec<u8> {
    let mut bytes = Vec::with_capacity(text.len());
    let mut rest = text.as_bytes();
    while let Some((&first, after)) = rest.split_first() {
        let digit = |i: usize| after.get(i).and_then(|&b| char::from(b).to_digit(16));
        match (first, digit(0), digit(1)) {
            (b'%', Some(high), Some(low)) => {
                bytes.push((high * 16 + low) as u8);
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

/// Returns what bytes are in each encoding in which they have no error.
fn spellings(bytes: &[u8]) -> BTreeSet<String> {
    OF_NAMES
        .iter()
        .filter_map(|encoding| encoding.decode_without_bom_handling_and_without_replacement(bytes))
        .map(Cow::into_owned)
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn encoding_of_text_is_recognised() {
        let text = "usemtl 木\n";
        let utf16: Vec<u8> = text.encode_utf16().flat_map(u16::to_le_bytes).collect();
        assert_eq!(decode(text.as_bytes()), (text.into(), None));
        assert_eq!(decode(&utf16), (text.into(), Some("UTF-16LE")));
        let mark = [b"\xff\xfe\0\0".as_slice()].concat();
        let utf32: Vec<u8> = text
            .chars()
            .flat_map(|c| u32::from(c).to_le_bytes())
            .collect();
        assert_eq!(decode(&[mark, utf32].concat()), (text.into(), None));
        let marked = [b"\xff\xfe".as_slice(), &utf16].concat();
        assert_eq!(decode(&marked), (text.into(), None));
        let big: Vec<u8> = "\u{feff}v 1"
            .encode_utf16()
            .flat_map(u16::to_be_bytes)
            .collect();
        assert_eq!(decode(&big), ("v 1".into(), None));
        for (text, encoding) in [
            ("usemtl 木头地板\n", GB18030),
            ("usemtl 表 テクスチャ\n", SHIFT_JIS),
            ("usemtl grün\nusemtl Façade\n", WINDOWS_1252),
        ] {
            let bytes = encoding.encode(text).0;
            assert_eq!(decode(&bytes), (text.into(), Some(encoding.name())));
        }
        assert_eq!(decode(b"# gr\xfcn\nv 1").1, None, "a comment only");
        assert_eq!(decode(b"g \x81\xff\x8d\xfd").0.chars().count(), 6);
    }

    #[test]
    fn name_read_in_a_wrong_encoding_is_respelled() {
        assert!(
            respellings("ľ.png").contains("木.png"),
            "GBK taken for UTF-8"
        );
        assert!(
            respellings("黱.png").contains("ün.png"),
            "Latin-1 taken for GBK"
        );
        assert!(respellings("a.png").is_empty());
    }
}
