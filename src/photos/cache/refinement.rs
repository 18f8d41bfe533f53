//! Cached refinement of the poses of a set's views.

use super::{CacheOrigin, PoseRecord, read_or_make, views_file_name};
use headbox_core::container::{Container, ContainerWriter, FileError, FileKind};
use headbox_images::{ImageSet, ImagesError, Pose, RefinementReport, RefinementStep};
use serde::{Deserialize, Serialize};
use std::path::Path;

/// Version of the refinement method; changes with it.
const HOW: &str = "poses by points and planes, if colours agree better";

/// Header of a file.
#[derive(Serialize, Deserialize)]
struct Header {
    views: usize,
    report: Option<Report>,
}

/// A [`RefinementReport`] as it is serialised.
#[derive(Serialize, Deserialize)]
#[serde(remote = "RefinementReport")]
struct ReportFormat {
    #[serde(rename = "apart")]
    surface_distance: [f64; 2],
    levels: [f64; 2],
    #[serde(rename = "is_kept")]
    is_applied: bool,
    #[serde(rename = "moved")]
    movement: [f64; 2],
    pairs: usize,
    views: usize,
}

#[derive(Serialize, Deserialize)]
struct Report(#[serde(with = "ReportFormat")] RefinementReport);

/// Report on a set, or `None`, and the pose of each of its views.
type CachedPoses = (Option<RefinementReport>, Vec<Pose>);

/// Refines the poses of a set's views with [`ImageSet::refine_poses`], or reads the result of an
/// earlier run from `folder`.
///
/// # Errors
/// [`ImagesError`] of the first view that cannot be loaded.
pub fn refine_poses(
    set: &mut ImageSet,
    folder: Option<&Path>,
    look: &(dyn Fn(RefinementStep) + Sync),
) -> Result<(Option<RefinementReport>, CacheOrigin), ImagesError> {
    let name = views_file_name("poses", HOW, &set.views);
    let views = set.views.len();
    let make = || {
        let report = set.refine_poses(look)?;
        Ok((report, set.views.iter().map(|view| view.pose).collect()))
    };
    let ((report, poses), was) = read_or_make(folder, name, |file| open(file, views), make, write)?;
    set.views
        .iter_mut()
        .zip(poses)
        .for_each(|(view, pose)| view.pose = pose);
    Ok((report, was))
}

fn write(path: &Path, (report, poses): &CachedPoses) -> Result<(), FileError> {
    let header = Header {
        views: poses.len(),
        report: report.clone().map(Report),
    };
    let records: Vec<PoseRecord> = poses.iter().map(|pose| (*pose).into()).collect();
    let mut writer = ContainerWriter::new(FileKind::POSES);
    writer.section("info", move || Ok(serde_json::to_vec(&header)?));
    writer.section("poses", || Ok(bytemuck::cast_slice(&records).to_vec()));
    writer.write(path)
}

/// Reads the poses of `views` views.
fn open(path: &Path, views: usize) -> Result<CachedPoses, FileError> {
    let file = Container::open(path, FileKind::POSES)?;
    let info = file.section("info")?;
    let header: Header = info.json()?;
    if header.views != views {
        return Err(info.damaged(format!("{views} views"), header.views.to_string()));
    }
    let records: Vec<PoseRecord> = file.section("poses")?.array(views)?;
    Ok((
        header.report.map(|Report(report)| report),
        records.into_iter().map(Pose::from).collect(),
    ))
}

#[cfg(test)]
mod tests {
    use super::*;
    pub(crate) use crate::view_geometry::tests::{image_set, plane_view, saved};
    use glam::DVec3;

    #[test]
    fn poses_cached_until_files_change() {
        let pictures = tempfile::tempdir().expect("a folder");
        let cache = tempfile::tempdir().expect("a folder");
        let view = |i: usize| {
            let eye = DVec3::new(0.1 * i as f64, 0.0, 0.0);
            let mut view = saved(
                &plane_view(eye, 3.0, [96, 72]),
                pictures.path(),
                &format!("{i}"),
            );
            view.pose.eye.z += if i == 2 { 0.05 } else { 0.0 };
            view
        };
        let views: Vec<_> = (0..5).map(view).collect();
        let refine = |views: &[_]| {
            let mut set = image_set(pictures.path(), views);
            let (report, was) =
                refine_poses(&mut set, Some(cache.path()), &|_| {}).expect("refines");
            (report, was, set.views)
        };
        let (report, first, refined) = refine(&views);
        assert!(
            report.as_ref().is_some_and(|report| report.is_applied)
                && first == CacheOrigin::default(),
            "{report:?} {first:?}"
        );
        assert!(
            (refined[2].pose.eye.z - refined[1].pose.eye.z).abs() < 0.005,
            "{refined:?}"
        );
        let (again, second, same) = refine(&views);
        assert!(
            second.kept && again == report && same == refined,
            "{second:?}"
        );
        assert!(!refine(&views[1..]).1.kept, "other views");
        for file in std::fs::read_dir(cache.path()).expect("read").flatten() {
            let whole = std::fs::read(file.path()).expect("read");
            std::fs::write(file.path(), &whole[..whole.len() - 1]).expect("written");
        }
        let (_, anew, same) = refine(&views);
        assert!(
            !anew.kept
                && anew.note.is_some_and(|note| note.contains("made anew"))
                && same == refined
        );
    }
}
