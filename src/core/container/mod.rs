//! Container of all our binary files: a kind, a version, and named sections with lengths and
//! checksums.
//!
//! ```text
//! offset  size  what
//! 0       8     magic "HEADBOX\0"
//! 8       4     kind, e.g. "cldi"
//! 12      4     version of that kind
//! 16      4     number of sections
//! 20      4     CRC-32 of the section table
//! 24      32*n  section table: name (12 bytes, zero-padded), CRC-32, offset (u64), length (u64)
//! ...           sections, each at a multiple of 64 bytes
//! ```
//!
//! Everything is little-endian. A reader trusts no number before it has checked it against the
//! length of the file.

mod stored;
#[cfg(test)]
mod tests;

pub use stored::StoredSection;

use crate::files::write_whole;
use crate::inputs::{HOMES, REPRESENTATIONS, SCENES, join_extensions};
use std::fs::File;
use std::io::{self, Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex};
use stored::read_exact_at;

#[cfg(target_endian = "big")]
compile_error!("arrays are written as they lie in memory: little-endian");

const MAGIC: [u8; 8] = *b"HEADBOX\0";
const HEADER_BYTES: usize = 24;
const ENTRY_BYTES: usize = 32;
const NAME_BYTES: usize = 12;
const ALIGNMENT: usize = 64;
const MAX_SECTIONS: usize = 4096;

/// Kind of content of a file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct FileKind {
    /// Four characters in the header.
    pub tag: [u8; 4],
    /// Name shown to the user.
    pub name: &'static str,
    /// The version that this program writes.
    pub version: u32,
    /// The oldest version that it reads.
    pub oldest: u32,
}

impl FileKind {
    /// `.ldi`
    pub const CUBE_LDI: Self = Self::new(*b"cldi", "cube LDI", 1, 3);
    /// `.shard`
    pub const SHARD: Self = Self::new(*b"shrd", "capture shard", 2, 2);
    /// `.sprite`
    pub const SPRITES: Self = Self::new(*b"sprt", "sprite", 1, 2);
    /// `.house`
    pub const HOUSE: Self = Self::new(*b"hous", "house", 1, 3);
    /// `.lumi`
    pub const LUMIGRAPH: Self = Self::new(*b"lumi", "lumigraph", 1, 2);
    /// Cached ray-traced frames of reports.
    pub const TRUTH: Self = Self::new(*b"trth", "truth frame", 1, 1);
    /// Cached samples of depth images.
    pub const SAMPLES: Self = Self::new(*b"smpl", "samples", 2, 2);
    /// Cached registration of an image set.
    pub const REGISTRATION: Self = Self::new(*b"regi", "registration", 1, 1);
    /// Cached refined poses of an image set.
    pub const POSES: Self = Self::new(*b"pose", "poses", 1, 1);
    /// Cached comparison of neighbouring views of an image set.
    pub const NEIGHBORS: Self = Self::new(*b"ngbr", "neighbours", 1, 1);
    /// All kinds.
    pub const ALL: [Self; 10] = [
        Self::CUBE_LDI,
        Self::SHARD,
        Self::SPRITES,
        Self::HOUSE,
        Self::LUMIGRAPH,
        Self::TRUTH,
        Self::SAMPLES,
        Self::REGISTRATION,
        Self::POSES,
        Self::NEIGHBORS,
    ];

    const fn new(tag: [u8; 4], name: &'static str, oldest: u32, version: u32) -> Self {
        Self {
            tag,
            name,
            version,
            oldest,
        }
    }
}

/// Suggests what to do about a file of another version.
fn advice_for_version(found: u32, expected: u32) -> &'static str {
    if found > expected {
        "update headbox"
    } else {
        "create the file again"
    }
}

/// Suggests how a foreign file can be used.
fn advice_for(path: &Path) -> String {
    // The file is written to the current folder: that of the scene may be read-only.
    let output =
        |extension| PathBuf::from(path.file_name().unwrap_or_default()).with_extension(extension);
    let ending = path
        .extension()
        .unwrap_or_default()
        .to_string_lossy()
        .to_lowercase();
    match ending.as_str() {
        scene if SCENES.contains(&scene) => {
            format!(
                "it is a scene: capture it first, with headbox capture {} -o {}",
                path.display(),
                output("ldi").display()
            )
        }
        home if HOMES.contains(&home) => {
            format!(
                "it is a home: convert it first, with headbox house {} -o {}",
                path.display(),
                output("house").display()
            )
        }
        "html" | "htm" => "it is a page: open it in a browser".into(),
        _ => {
            let own = [&REPRESENTATIONS[..], &["shard"]].concat();
            format!("give a {} file", join_extensions(&own))
        }
    }
}

/// Error of reading or writing one of our files.
#[derive(Debug, thiserror::Error)]
pub enum FileError {
    /// I/O error.
    #[error("{}: {source}", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// Cause.
        source: io::Error,
    },
    /// Not one of our files.
    #[error("{}: not a headbox file (it does not begin with \"HEADBOX\"); {}", path.display(), advice_for(path))]
    NotOurs {
        /// The file.
        path: PathBuf,
    },
    /// One of our files, of another kind.
    #[error("{}: it is {found}, where a {expected} is expected", path.display())]
    OtherKind {
        /// The file.
        path: PathBuf,
        /// Expected kind.
        expected: &'static str,
        /// Actual kind.
        found: String,
    },
    /// Unsupported version.
    #[error("{}: version {found} of the {kind} format; this program reads version {expected}: {}", path.display(), advice_for_version(*found, *expected))]
    Version {
        /// The file.
        path: PathBuf,
        /// Kind of the file.
        kind: &'static str,
        /// Newest version that this program reads.
        expected: u32,
        /// Version of the file.
        found: u32,
    },
    /// Damaged section.
    #[error("{}: section \"{section}\" is damaged: expected {expected}, found {found}; copy the file again or recreate it", path.display())]
    Damaged {
        /// The file.
        path: PathBuf,
        /// Name of the section.
        section: String,
        /// Expected content.
        expected: String,
        /// Actual content.
        found: String,
    },
}

/// Deferred bytes of a section.
type SectionBytes<'a> = Box<dyn FnOnce() -> io::Result<Vec<u8>> + 'a>;

/// Writer of a container file.
pub struct ContainerWriter<'a> {
    kind: FileKind,
    sections: Vec<(&'a str, SectionBytes<'a>)>,
}

impl<'a> ContainerWriter<'a> {
    /// Creates an empty file of a kind.
    pub fn new(kind: FileKind) -> Self {
        Self {
            kind,
            sections: Vec::new(),
        }
    }

    /// Adds a section. Its name is at most 12 bytes long, which [`Self::write`] checks; `bytes` is
    /// called while the file is written, so that only one section at a time is in memory.
    pub fn section(&mut self, name: &'a str, bytes: impl FnOnce() -> io::Result<Vec<u8>> + 'a) {
        self.sections.push((name, Box::new(bytes)));
    }

    /// Writes the file, completely or not at all.
    ///
    /// # Errors
    /// [`FileError::Io`].
    pub fn write(self, path: &Path) -> Result<(), FileError> {
        write_whole(path, |w| self.write_to(w)).map_err(|source| io_error(path, source))
    }

    /// Returns the size that the file will have, bytes.
    ///
    /// # Errors
    /// Those of the sections.
    pub fn size(self) -> io::Result<u64> {
        let mut file = io::Cursor::new(Vec::new());
        self.write_to(&mut file)?;
        Ok(file.get_ref().len() as u64)
    }

    fn write_to(self, w: &mut (impl Write + Seek)) -> io::Result<()> {
        let count = self.sections.len();
        let mut table = Vec::with_capacity(count * ENTRY_BYTES);
        let mut at = HEADER_BYTES + count * ENTRY_BYTES;
        w.write_all(&vec![0; at])?;
        for (name, bytes) in self.sections {
            let mut padded = [0; NAME_BYTES];
            padded
                .get_mut(..name.len())
                .ok_or_else(|| {
                    io::Error::other(format!("the section name \"{name}\" is too long"))
                })?
                .copy_from_slice(name.as_bytes());
            let bytes = bytes()?;
            let start = at.next_multiple_of(ALIGNMENT);
            w.write_all(&[0; ALIGNMENT][..start - at])?;
            w.write_all(&bytes)?;
            at = start + bytes.len();
            table.extend(padded);
            table.extend(crc32fast::hash(&bytes).to_le_bytes());
            table.extend((start as u64).to_le_bytes());
            table.extend((bytes.len() as u64).to_le_bytes());
        }
        w.seek(SeekFrom::Start(0))?;
        w.write_all(&MAGIC)?;
        w.write_all(&self.kind.tag)?;
        w.write_all(&self.kind.version.to_le_bytes())?;
        w.write_all(&(count as u32).to_le_bytes())?;
        w.write_all(&crc32fast::hash(&table).to_le_bytes())?;
        w.write_all(&table)
    }
}

/// Open container file whose section table was checked. Sections are read on demand.
pub struct Container {
    path: PathBuf,
    file: Arc<Mutex<File>>,
    sections: Vec<Entry>,
}

struct Entry {
    name: String,
    checksum: u32,
    start: u64,
    length: u64,
}

impl Container {
    /// Opens a file of the given kind.
    ///
    /// # Errors
    /// See [`FileError`].
    pub fn open(path: &Path, kind: FileKind) -> Result<Self, FileError> {
        let io = |source| io_error(path, source);
        let damaged = |expected: String, found: String| damaged(path, "header", expected, found);
        let mut file = File::open(path).map_err(io)?;
        let length = file.metadata().map_err(io)?.len();
        let mut read = |count: usize| {
            let mut bytes = Vec::new();
            let read = Read::by_ref(&mut file)
                .take(count as u64)
                .read_to_end(&mut bytes);
            read.map(|_| bytes).map_err(io)
        };
        let header = read(HEADER_BYTES)?;
        let count = check_header(path, &header, kind)?;
        let table = read(count * ENTRY_BYTES)?;
        if table.len() < count * ENTRY_BYTES {
            return Err(damaged(
                format!("a table of {count} sections"),
                format!("a file of {length} bytes (truncated)"),
            ));
        }
        if crc32fast::hash(&table) != word(&header, 20) {
            return Err(damaged(
                "a section table that matches its checksum".into(),
                "another".into(),
            ));
        }
        let sections = table
            .chunks_exact(ENTRY_BYTES)
            .map(|entry| check_entry(path, entry, length))
            .collect::<Result<Vec<Entry>, _>>()?;
        let end = sections
            .iter()
            .map(|s| s.start + s.length)
            .fold((HEADER_BYTES + table.len()) as u64, u64::max);
        if length > end {
            return Err(damaged(
                format!("a file of {end} bytes"),
                format!("{} more bytes", length - end),
            ));
        }
        Ok(Self {
            path: path.into(),
            file: Arc::new(Mutex::new(file)),
            sections,
        })
    }

    /// Reads the kind tag of a file; `None` if it is not one of ours.
    ///
    /// # Errors
    /// If the file cannot be opened.
    pub fn peek_kind(path: &Path) -> io::Result<Option<[u8; 4]>> {
        let mut header = Vec::new();
        File::open(path)?.take(12).read_to_end(&mut header)?;
        Ok(header
            .strip_prefix(&MAGIC)
            .and_then(|rest| rest.try_into().ok()))
    }

    /// Returns sections that stay on disk.
    ///
    /// # Errors
    /// [`FileError::Damaged`] if one is absent.
    pub fn stored<const N: usize>(
        &self,
        names: [&str; N],
    ) -> Result<[StoredSection; N], FileError> {
        let entries = names.map(|name| self.entry(name));
        let entries = entries.into_iter().collect::<Result<Vec<&Entry>, _>>()?;
        // Their ends were checked against the file's.
        let section = |entry: &Entry| {
            let bytes = entry.start..entry.start + entry.length;
            StoredSection::new(Arc::clone(&self.file), bytes)
        };
        Ok(std::array::from_fn(|i| section(entries[i])))
    }

    fn entry(&self, name: &str) -> Result<&Entry, FileError> {
        self.sections
            .iter()
            .find(|s| s.name == name)
            .ok_or_else(|| damaged(&self.path, name, "to be present", "no such section"))
    }

    /// Reads a section and verifies its checksum.
    ///
    /// # Errors
    /// [`FileError::Damaged`] if it is absent or does not match its checksum, [`FileError::Io`] if
    /// it cannot be read.
    pub fn section(&self, name: &str) -> Result<Section, FileError> {
        let entry = self.entry(name)?;
        // The length was checked against the file's, so the allocation is no larger than the file.
        let mut bytes = vec![0; entry.length as usize];
        read_exact_at(&self.file, entry.start, &mut bytes)
            .map_err(|source| io_error(&self.path, source))?;
        let found = crc32fast::hash(&bytes);
        if found != entry.checksum {
            return Err(damaged(
                &self.path,
                name,
                format!("checksum {:08x}", entry.checksum),
                format!("{found:08x}"),
            ));
        }
        Ok(Section {
            path: self.path.clone(),
            name: name.to_owned(),
            bytes,
            at: 0,
        })
    }
}

fn word(bytes: &[u8], at: usize) -> u32 {
    u32::from_le_bytes([bytes[at], bytes[at + 1], bytes[at + 2], bytes[at + 3]])
}

fn io_error(path: &Path, source: io::Error) -> FileError {
    FileError::Io {
        path: path.into(),
        source,
    }
}

fn damaged(
    path: &Path,
    section: &str,
    expected: impl Into<String>,
    found: impl Into<String>,
) -> FileError {
    FileError::Damaged {
        path: path.into(),
        section: section.into(),
        expected: expected.into(),
        found: found.into(),
    }
}

/// Checks magic, kind and version; returns the number of sections.
fn check_header(path: &Path, header: &[u8], kind: FileKind) -> Result<usize, FileError> {
    if !header.starts_with(&MAGIC) {
        return Err(FileError::NotOurs { path: path.into() });
    }
    if header.len() < HEADER_BYTES {
        return Err(damaged(
            path,
            "header",
            format!("{HEADER_BYTES} bytes"),
            format!("{} (truncated)", header.len()),
        ));
    }
    if header[8..12] != kind.tag {
        let tag = &header[8..12];
        let found = match FileKind::ALL.iter().find(|kind| kind.tag == tag) {
            Some(kind) => format!("a {}", kind.name),
            None => {
                let tag = tag.escape_ascii();
                format!("a headbox file of an unknown kind (\"{tag}\")")
            }
        };
        return Err(FileError::OtherKind {
            path: path.into(),
            expected: kind.name,
            found,
        });
    }
    let found = word(header, 12);
    if !(kind.oldest..=kind.version).contains(&found) {
        return Err(FileError::Version {
            path: path.into(),
            kind: kind.name,
            expected: kind.version,
            found,
        });
    }
    let count = word(header, 16) as usize;
    if count > MAX_SECTIONS {
        return Err(damaged(
            path,
            "header",
            format!("at most {MAX_SECTIONS} sections"),
            count.to_string(),
        ));
    }
    Ok(count)
}

/// Reads one entry of the section table and checks it against the length of the file.
fn check_entry(path: &Path, entry: &[u8], file_length: u64) -> Result<Entry, FileError> {
    let name = String::from_utf8_lossy(&entry[..NAME_BYTES])
        .trim_end_matches('\0')
        .to_owned();
    let long = |at: usize| u64::from(word(entry, at)) | u64::from(word(entry, at + 4)) << 32;
    let checksum = word(entry, NAME_BYTES);
    let start = long(NAME_BYTES + 4);
    let length = long(NAME_BYTES + 12);
    if start
        .checked_add(length)
        .is_none_or(|end| end > file_length)
    {
        return Err(damaged(
            path,
            &name,
            format!("{length} bytes from byte {start}"),
            format!("a file of {file_length} bytes (truncated?)"),
        ));
    }
    Ok(Entry {
        name,
        checksum,
        start,
        length,
    })
}

/// Bytes of a section, with a read position.
pub struct Section {
    path: PathBuf,
    name: String,
    bytes: Vec<u8>,
    at: usize,
}

impl Section {
    /// Creates the error of a damaged section.
    pub fn damaged(&self, expected: impl Into<String>, found: impl Into<String>) -> FileError {
        damaged(&self.path, &self.name, expected, found)
    }

    /// Returns the bytes that have not been read.
    pub fn rest(&self) -> &[u8] {
        &self.bytes[self.at..]
    }

    /// Reads the next `count` values; their length is checked before memory is allocated.
    ///
    /// # Errors
    /// [`FileError::Damaged`] if the section ends before.
    pub fn array<T: bytemuck::Pod>(&mut self, count: usize) -> Result<Vec<T>, FileError> {
        let rest = self.bytes.len() - self.at;
        let Some(bytes) = count
            .checked_mul(size_of::<T>())
            .filter(|&bytes| bytes <= rest)
        else {
            return Err(self.damaged(
                format!("{count} more values of {} bytes", size_of::<T>()),
                format!("{rest} bytes"),
            ));
        };
        let values = bytemuck::pod_collect_to_vec(&self.bytes[self.at..self.at + bytes]);
        self.at += bytes;
        Ok(values)
    }

    /// Reads the next `N` values.
    ///
    /// # Errors
    /// [`FileError::Damaged`] if the section ends before.
    pub fn values<T: bytemuck::Pod, const N: usize>(&mut self) -> Result<[T; N], FileError> {
        let values = self.array(N)?;
        values
            .try_into()
            .map_err(|_| self.damaged(format!("{N} values"), "fewer"))
    }

    /// Parses the whole section as JSON.
    ///
    /// # Errors
    /// [`FileError::Damaged`] with the parser's message.
    pub fn json<T: serde::de::DeserializeOwned>(&self) -> Result<T, FileError> {
        serde_json::from_slice(&self.bytes)
            .map_err(|error| self.damaged("JSON of this version", error.to_string()))
    }

    /// Checks that the section was read to its end.
    ///
    /// # Errors
    /// [`FileError::Damaged`] if bytes remain.
    pub fn end(&self) -> Result<(), FileError> {
        let rest = self.bytes.len() - self.at;
        if rest == 0 {
            Ok(())
        } else {
            Err(self.damaged("its end", format!("{rest} more bytes")))
        }
    }
}
