//! Chunks of PNG files: their palette and their texts.

/// First bytes of a PNG file.
pub const SIGNATURE: &[u8] = b"\x89PNG\r\n\x1a\n";

/// Length of a PNG file up to the end of its header chunk, bytes; other chunks follow.
const HEADER_END: usize = 33;

/// Chunks of a PNG file, each with its kind, up to the first that is not complete. Empty for other
/// files.
pub fn chunks(bytes: &[u8]) -> impl Iterator<Item = ([u8; 4], &[u8])> {
    let mut rest = bytes.strip_prefix(SIGNATURE).unwrap_or(&[]);
    std::iter::from_fn(move || {
        let (length, after) = rest.split_first_chunk::<4>()?;
        let (kind, after) = after.split_first_chunk::<4>()?;
        let length = u32::from_be_bytes(*length) as usize;
        let content = after.get(..length)?;
        const CHECKSUM_BYTES: usize = 4;
        rest = after.get(length + CHECKSUM_BYTES..)?;
        Some((*kind, content))
    })
}

/// Adds a text with a keyword, both Latin-1 and the keyword of 1 to 79 bytes, to a PNG file in
/// memory.
pub fn add_text(file: &mut Vec<u8>, keyword: &str, text: &str) {
    let content = [b"tEXt", keyword.as_bytes(), b"\0", text.as_bytes()].concat();
    let length = (content.len() as u32 - 4).to_be_bytes();
    let checksum = crc32fast::hash(&content).to_be_bytes();
    let chunk = [&length, content.as_slice(), &checksum].concat();
    file.splice(HEADER_END..HEADER_END, chunk);
}

/// Returns the first text with a keyword of a PNG file.
#[must_use]
pub fn text<'a>(bytes: &'a [u8], keyword: &str) -> Option<&'a str> {
    let texts = chunks(bytes).filter(|(kind, _)| kind == b"tEXt");
    let mut values = texts.filter_map(|(_, content)| {
        let value = content.strip_prefix(keyword.as_bytes())?;
        std::str::from_utf8(value.strip_prefix(b"\0")?).ok()
    });
    values.next()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::image::codec;

    #[test]
    fn texts_are_found_by_keyword() {
        let grey = ::image::ExtendedColorType::L8;
        let mut file = codec::png(&[1, 2, 3, 4], 2, 2, grey).expect("fits");
        add_text(&mut file, "noise", "38.5");
        add_text(&mut file, "noise of more", "1");
        assert_eq!(text(&file, "noise"), Some("38.5"));
        assert_eq!(text(&file, "Noise"), None);
        let decoded = codec::decode(&file, None, codec::MAX_BYTES).expect("valid");
        assert_eq!(decoded.image.as_bytes(), [1, 2, 3, 4]);
    }

    #[test]
    fn cut_file_has_its_complete_chunks() {
        let grey = ::image::ExtendedColorType::L8;
        let file = codec::png(&[7], 1, 1, grey).expect("fits");
        let kinds = |bytes: &[u8]| chunks(bytes).map(|(kind, _)| kind).collect::<Vec<_>>();
        assert_eq!(kinds(&file), [*b"IHDR", *b"IDAT", *b"IEND"]);
        assert_eq!(kinds(&file[..file.len() - 1]), [*b"IHDR", *b"IDAT"]);
        assert!(kinds(b"GIF89a").is_empty());
    }
}
