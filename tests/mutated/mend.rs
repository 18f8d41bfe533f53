//! Mutations inside formats with checksums or lengths of their own, which stay valid.

use crate::mutations::{MutationRng, mutate};
use std::io::{Cursor, Read, Write};
use zip::write::SimpleFileOptions;

/// Mutates the content of a file whose format is known by its name; `None` for others.
pub(crate) fn mutate_inside(name: &str, original: &[u8], rng: &mut MutationRng) -> Option<Vec<u8>> {
    match name.rsplit_once('.')?.1 {
        "png" => Some(mutate_png(original, rng)),
        "sh3d" => Some(mutate_archive(original, rng)),
        "glb" => mutate_glb(original, rng),
        _ => None,
    }
}

/// Mutates a chunk of a PNG file.
fn mutate_png(original: &[u8], rng: &mut MutationRng) -> Vec<u8> {
    let (signature, mut rest) = original.split_at(8);
    let mut chunks = Vec::new();
    while let Some((length, after)) = rest.split_first_chunk::<4>() {
        let length = u32::from_be_bytes(*length) as usize;
        chunks.push((after[..4].to_vec(), after[4..4 + length].to_vec()));
        rest = &after[8 + length..];
    }
    let which = rng.below(chunks.len());
    mutate(&mut chunks[which].1, rng);
    let mut file = signature.to_vec();
    for (kind, content) in chunks {
        let body = [kind, content].concat();
        file.extend((body.len() as u32 - 4).to_be_bytes());
        file.extend(&body);
        file.extend(crc32fast::hash(&body).to_be_bytes());
    }
    file
}

/// Mutates a file of a ZIP archive.
fn mutate_archive(original: &[u8], rng: &mut MutationRng) -> Vec<u8> {
    let mut archive = zip::ZipArchive::new(Cursor::new(original)).expect("an archive");
    let mut files = Vec::new();
    for i in 0..archive.len() {
        let mut entry = archive.by_index(i).expect("an entry");
        let mut content = Vec::new();
        entry.read_to_end(&mut content).expect("read");
        let name = entry.name().expect("UTF-8").into_owned();
        files.push((name, content));
    }
    let which = rng.below(files.len());
    mutate(&mut files[which].1, rng);
    let mut writer = zip::ZipWriter::new(Cursor::new(Vec::new()));
    for (name, content) in files {
        writer
            .start_file(name, SimpleFileOptions::default())
            .expect("started");
        writer.write_all(&content).expect("written");
    }
    writer.finish().expect("finished").into_inner()
}

/// Mutates a chunk of a GLB file.
fn mutate_glb(original: &[u8], rng: &mut MutationRng) -> Option<Vec<u8>> {
    let mut rest = original.get(12..)?;
    let mut chunks = Vec::new();
    while let Some((length, after)) = rest.split_first_chunk::<4>() {
        let end = 4 + u32::from_le_bytes(*length) as usize;
        chunks.push((after.get(..4)?.to_vec(), after.get(4..end)?.to_vec()));
        rest = &after[end..];
    }
    let which = rng.below(chunks.len());
    mutate(&mut chunks.get_mut(which)?.1, rng);
    let mut body = Vec::new();
    for (kind, mut content) in chunks {
        let padding = if kind == b"JSON" { b' ' } else { 0 };
        content.resize(content.len().next_multiple_of(4), padding);
        body.extend((content.len() as u32).to_le_bytes());
        body.extend(kind);
        body.extend(content);
    }
    let mut file = original[..8].to_vec();
    file.extend((12 + body.len() as u32).to_le_bytes());
    file.extend(body);
    Some(file)
}
