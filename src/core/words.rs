//! What libraries say of damaged files, in the words of people who never heard of them.

use exr::error::Error as ExrError;
use image::ImageError;
use image::error::{ImageFormatHint, UnsupportedErrorKind};
use serde_json::error::Category;
use std::io::ErrorKind;

/// Why a text is not the JSON that is expected, and where.
pub fn of_json(error: &serde_json::Error) -> String {
    let said = error.to_string();
    let words = said.rsplit_once(" at line ").map_or(said.as_str(), |(words, _)| words);
    match error.classify() {
        Category::Syntax => format!("it is no JSON (line {}, column {})", error.line(), error.column()),
        Category::Eof => format!("it ends in the midst of its JSON (line {})", error.line()),
        Category::Data => format!("line {}: {}", error.line(), of_value(words)),
        Category::Io => words.to_owned(),
    }
}

/// What a value is, and what it should be.
fn of_value(words: &str) -> String {
    const OURS: [(&str, &str); 8] = [
        ("integer `", "the number `"),
        ("floating point `", "the number `"),
        ("string \"", "the text \""),
        ("boolean `", "`"),
        ("a sequence", "a list"),
        ("sequence", "a list"),
        ("a map", "an object"),
        ("map", "an object"),
    ];
    let ours = |part: &str| {
        let known = OURS.iter().find(|(theirs, _)| part.starts_with(theirs));
        known.map_or(part.to_owned(), |(theirs, ours)| part.replacen(theirs, ours, 1))
    };
    let is_told = ["invalid type: ", "invalid value: "].iter().find_map(|start| words.strip_prefix(start));
    match is_told.and_then(|told| told.split_once(", expected ")) {
        Some((found, expected)) => format!("{} where {} is expected", ours(found), ours(expected)),
        None => words.replace("missing field `", "there is no field `"),
    }
}

/// Why a file is no picture that can be read.
pub fn of_picture(error: &ImageError) -> String {
    let known = |hint: &ImageFormatHint| match hint {
        ImageFormatHint::Exact(format) => Some(format!("{format:?}").to_uppercase()),
        _ => None,
    };
    match error {
        ImageError::Decoding(error) => match known(&error.format_hint()) {
            Some(kind) => format!("it is no {kind} picture, or a damaged one"),
            None => "it is no picture, or a damaged one".into(),
        },
        ImageError::Unsupported(error) if matches!(error.kind(), UnsupportedErrorKind::Format(_)) => {
            "it is no picture of a kind that is read, such as .png or .jpg".into()
        }
        ImageError::Limits(_) => "it would take more memory than a picture may".into(),
        ImageError::IoError(error) if error.kind() == ErrorKind::UnexpectedEof => "it ends too soon".into(),
        error => error.to_string(),
    }
}

/// Why a file is no EXR that can be read.
pub fn of_exr(error: &ExrError) -> String {
    match error {
        ExrError::Io(error) if error.kind() == ErrorKind::UnexpectedEof => "it ends too soon".into(),
        ExrError::Io(error) => error.to_string(),
        ExrError::NotSupported(what) => format!("it is an EXR of a kind that is not read ({what})"),
        ExrError::Invalid(what) => format!("it is no EXR, or a damaged one ({what})"),
        ExrError::Aborted => error.to_string(),
    }
}

/// What is said of a failure, without the system's numbers and with our words for its commonest ones.
pub fn plain(text: &str) -> String {
    let mut plain = String::with_capacity(text.len());
    let mut rest = text;
    while let Some(at) = rest.find(" (os error ") {
        let Some(end) = rest[at..].find(')') else { break };
        plain.push_str(&rest[..at]);
        rest = &rest[at + end + 1..];
    }
    plain.push_str(rest);
    const OURS: [(&str, &str); 9] = [
        ("No such file or directory", "there is no such file"),
        ("Is a directory", "it is a folder; give the name of a file"),
        ("Not a directory", "a file stands where a folder is needed"),
        ("Permission denied", "the system does not permit it"),
        ("No space left on device", "the disk is full"),
        ("Broken pipe", "who reads it has stopped"),
        ("EOF while parsing", "it ends in the midst of"),
        ("missing field `", "there is no field `"),
        ("invalid Zip archive: Could not find EOCD", "it is no ZIP archive, or only the beginning of one"),
    ];
    OURS.iter().fold(plain, |plain, (theirs, ours)| plain.replace(theirs, ours))
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::path::Path;

    #[test]
    fn json_is_told_by_what_it_is_and_what_it_should_be() {
        let said = |text: &str| of_json(&serde_json::from_str::<Vec<[f64; 2]>>(text).unwrap_err());
        assert_eq!(said("no JSON"), "it is no JSON (line 1, column 2)");
        assert_eq!(said("[[1, 2],\n[3"), "it ends in the midst of its JSON (line 2)");
        assert_eq!(said("\n5"), "line 2: the number `5` where a list is expected");
        assert_eq!(said("[[1, \"x\"]]"), "line 1: the text \"x\" where f64 is expected");
        assert_eq!(said("{}"), "line 1: an object where a list is expected");
    }

    #[test]
    fn pictures_are_told_by_their_kind() {
        let said = |name: &str, bytes: &[u8]| {
            let read = crate::image_file::decode(bytes, Some(Path::new(name)), crate::image_file::MAX_BYTES);
            read.unwrap_err().to_string()
        };
        assert_eq!(said("a.png", b"this is none"), "it is no PNG picture, or a damaged one");
        assert_eq!(said("a", b"this is none"), "it is no picture of a kind that is read, such as .png or .jpg");
        let mut png = crate::image_file::png(&[7; 12], 2, 2, image::ExtendedColorType::Rgb8).unwrap();
        png.truncate(png.len() / 2);
        assert!(["it ends too soon", "it is no PNG picture, or a damaged one"].contains(&said("a.png", &png).as_str()));
    }
}
