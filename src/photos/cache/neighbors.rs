//! Cached comparison of a set's neighbouring views.

use super::{CacheOrigin, read_or_make, views_file_name};
use headbox_core::container::{Container, ContainerWriter, FileError, FileKind};
use headbox_images::{ImageSet, ImagesError, check_neighbors};
use serde::{Deserialize, Serialize};
use std::path::Path;

/// Version of the comparison; changes with its method, its thresholds and the text of its warnings.
const HOW: &str = "neighbours in usual units";

/// Number of pairs that are compared; `headbox images` compares more.
const PAIRS: usize = 4;

/// Doubts about the depth of a set.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct DepthDoubts {
    /// True if the colours of neighbours agree with another unit of depth only.
    pub is_unit_doubtful: bool,
    /// Warnings, one sentence each.
    pub warnings: Vec<String>,
}

/// Compares a few pairs of neighbours with [`check_neighbors`], or reads the result of an earlier
/// run from `folder`.
///
/// # Errors
/// [`ImagesError`] of the first view that cannot be loaded.
pub fn compare_neighbors(
    set: &ImageSet,
    folder: Option<&Path>,
) -> Result<(DepthDoubts, CacheOrigin), ImagesError> {
    let name = views_file_name("neighbors", HOW, &set.views);
    let make = || {
        let report = check_neighbors(set, PAIRS, &mut |_| {})?;
        Ok(DepthDoubts {
            is_unit_doubtful: report.is_unit_doubtful,
            warnings: report.warnings,
        })
    };
    read_or_make(folder, name, open, make, write)
}

fn write(path: &Path, doubts: &DepthDoubts) -> Result<(), FileError> {
    let mut writer = ContainerWriter::new(FileKind::NEIGHBORS);
    writer.section("doubts", || Ok(serde_json::to_vec(doubts)?));
    writer.write(path)
}

fn open(path: &Path) -> Result<DepthDoubts, FileError> {
    Container::open(path, FileKind::NEIGHBORS)?
        .section("doubts")?
        .json()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::view_geometry::tests::{image_set, plane_view, saved};
    use glam::DVec3;

    #[test]
    fn doubts_cached_until_files_change() {
        let pictures = tempfile::tempdir().expect("a folder");
        let cache = tempfile::tempdir().expect("a folder");
        let save = |i: usize, distance_m: f64| {
            let eye = DVec3::new(0.02 * i as f64, 0.0, 0.0);
            let view = plane_view(eye, distance_m, [96, 72]);
            saved(&view, pictures.path(), &format!("{i}"))
        };
        let views = [0, 1].map(|i| save(i, 3.0));
        let compare = || {
            let set = image_set(pictures.path(), &views);
            compare_neighbors(&set, Some(cache.path())).expect("loads")
        };
        let (doubts, first) = compare();
        assert_eq!((doubts.warnings.len(), first), (0, CacheOrigin::default()));
        let (again, second) = compare();
        assert!(second.kept && again == doubts, "{second:?}");
        // A second view whose depth is half of the first's.
        save(1, 1.5);
        let (doubts, third) = compare();
        assert!(!third.kept, "another picture");
        assert!(doubts.warnings.join("").contains("disagree"), "{doubts:?}");
        assert_eq!(compare().0, doubts);
    }
}
