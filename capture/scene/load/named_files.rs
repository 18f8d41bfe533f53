//! Search for the files that a scene file names: material files, images and buffers.

use super::encoding::{decode_percent, name_of_bytes, respellings, spellings_of_file};
use super::lines::without_comment;
use headbox_core::files::{FoundInput, InputFolder, fold_name};
use std::collections::BTreeSet;
use std::ffi::OsStr;
use std::path::Path;

/// Finds the file that a file in the folder `base` of a scene calls `written`, relative to `base`
/// or to the scene: as it is written; then ignoring case and normalization and in other encodings;
/// then by the end of its path, because some programs write paths of their machine. If there is
/// none, the name may end before a comment, or have characters as in a URI (`%20`).
///
/// # Errors
/// The cause, for notes: there is no such file, or it may not be read.
pub(super) fn find_file(
    written: &str,
    base: &Path,
    scene: &InputFolder,
) -> Result<FoundInput, String> {
    let bases = [base, scene.path()];
    let bases = if base == scene.path() {
        &bases[..1]
    } else {
        &bases[..]
    };
    let mut refusal = None;
    let decoded = written
        .contains('%')
        .then(|| name_of_bytes(decode_percent(written)));
    let names = [Some(written), without_comment(written), decoded.as_deref()];
    for name in names.into_iter().flatten() {
        match scene.find(bases, name, true, accept_spellings) {
            Ok(Some(found)) => return Ok(found),
            Ok(None) => {}
            Err(error) => {
                refusal.get_or_insert(error);
            }
        }
    }
    Err(refusal.map_or_else(|| "no such file".into(), |refusal| refusal.to_string()))
}

/// Returns a test for names that differ from that written in case, Unicode normalization or
/// encoding alone.
fn accept_spellings(written: &str) -> impl Fn(&OsStr) -> bool + use<> {
    let mut wanted: BTreeSet<String> = respellings(written)
        .iter()
        .map(|name| fold_name(name))
        .collect();
    wanted.insert(fold_name(written));
    move |name: &OsStr| !spellings_of_file(name).is_disjoint(&wanted)
}
