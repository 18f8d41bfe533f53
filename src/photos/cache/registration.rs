//! Cached registration of a set's views.

use super::{CacheOrigin, PoseRecord, read_or_make, views_file_name};
use bytemuck::{Pod, Zeroable};
use headbox_core::container::{Container, ContainerWriter, FileError, FileKind};
use headbox_images::{
    Distortion, Exposure, ImageSet, ImagesError, Pinhole, Registration, RegistrationModel,
    RegistrationReport, RegistrationStep,
};
use serde::{Deserialize, Serialize};
use std::path::Path;

/// Version of the registration method; changes with it.
const HOW: &str = "registration with offsets of levels";

/// Registration of a view in the file; zeros for an unregistered one.
#[derive(Clone, Copy, Pod, Zeroable)]
#[repr(C)]
struct ViewRecord {
    /// 1 for a registered view.
    is_registered: f64,
    focal_px: [f64; 2],
    principal_px: [f64; 2],
    radial: [f64; 6],
    tangential: [f64; 2],
    pose: PoseRecord,
    gain: [f64; 3],
    offset: [f64; 3],
}

/// A [`RegistrationReport`] in the file.
#[derive(Clone, Copy, Pod, Zeroable)]
#[repr(C)]
struct ReportRecord {
    levels: [f64; 3],
    /// Index of the applied model in [`MODELS`].
    applied: f64,
    focal_px: [f64; 2],
    offset: [f64; 2],
    gain: [f64; 2],
    sampled_views: f64,
    views: f64,
}

/// Number of values of a report.
const REPORT: usize = size_of::<ReportRecord>() / size_of::<f64>();

/// Models in the order of their indices in the file.
const MODELS: [RegistrationModel; 3] = [
    RegistrationModel::AsGiven,
    RegistrationModel::SharedOffset,
    RegistrationModel::PerView,
];

/// Header of a file.
#[derive(Serialize, Deserialize)]
struct Header {
    views: usize,
    /// True if a registration was found.
    is_found: bool,
}

/// Report on a set, or `None`, and the registration of each of its views.
type CachedRegistration = (Option<RegistrationReport>, Vec<Option<Registration>>);

/// Registers a set's views with [`ImageSet::register`], or reads the result of an earlier run from
/// `folder`.
///
/// # Errors
/// [`ImagesError`] of the first view that cannot be loaded.
pub fn register(
    set: &mut ImageSet,
    folder: Option<&Path>,
    look: &(dyn Fn(RegistrationStep) + Sync),
) -> Result<(Option<RegistrationReport>, CacheOrigin), ImagesError> {
    let name = views_file_name("registration", HOW, &set.views);
    let views = set.views.len();
    let make = || {
        let report = set.register(look)?;
        Ok((
            report,
            set.views.iter().map(|view| view.registration).collect(),
        ))
    };
    let ((report, registrations), was) =
        read_or_make(folder, name, |file| open(file, views), make, write)?;
    set.views
        .iter_mut()
        .zip(registrations)
        .for_each(|(view, registration)| view.registration = registration);
    Ok((report, was))
}

fn write(path: &Path, (report, registrations): &CachedRegistration) -> Result<(), FileError> {
    let header = Header {
        views: registrations.len(),
        is_found: report.is_some(),
    };
    let records: Vec<ViewRecord> = registrations.iter().map(view_record).collect();
    let report: Vec<ReportRecord> = report.iter().map(report_record).collect();
    let mut writer = ContainerWriter::new(FileKind::REGISTRATION);
    writer.section("info", move || Ok(serde_json::to_vec(&header)?));
    writer.section("report", || Ok(bytemuck::cast_slice(&report).to_vec()));
    writer.section("views", || Ok(bytemuck::cast_slice(&records).to_vec()));
    writer.write(path)
}

/// Reads the registration of `views` views.
fn open(path: &Path, views: usize) -> Result<CachedRegistration, FileError> {
    let file = Container::open(path, FileKind::REGISTRATION)?;
    let info = file.section("info")?;
    let header: Header = info.json()?;
    if header.views != views {
        return Err(info.damaged(format!("{views} views"), header.views.to_string()));
    }
    let mut section = file.section("report")?;
    let report = if header.is_found {
        let report = read_report(bytemuck::cast(section.values::<f64, REPORT>()?));
        Some(report.ok_or_else(|| section.damaged("what is applied", "another number"))?)
    } else {
        None
    };
    let records: Vec<ViewRecord> = file.section("views")?.array(views)?;
    Ok((report, records.iter().map(read_registration).collect()))
}

fn view_record(registration: &Option<Registration>) -> ViewRecord {
    let Some(Registration {
        lens,
        pose,
        exposure,
    }) = *registration
    else {
        return ViewRecord::zeroed();
    };
    ViewRecord {
        is_registered: 1.0,
        focal_px: lens.focal_px,
        principal_px: lens.principal_px,
        radial: lens.distortion.radial,
        tangential: lens.distortion.tangential,
        pose: pose.into(),
        gain: exposure.gain.map(f64::from),
        offset: exposure.offset.map(f64::from),
    }
}

fn read_registration(record: &ViewRecord) -> Option<Registration> {
    (record.is_registered > 0.0).then_some(Registration {
        lens: Pinhole {
            focal_px: record.focal_px,
            principal_px: record.principal_px,
            distortion: Distortion {
                radial: record.radial,
                tangential: record.tangential,
            },
        },
        pose: record.pose.into(),
        exposure: Exposure {
            gain: record.gain.map(|gain| gain as f32),
            offset: record.offset.map(|offset| offset as f32),
        },
    })
}

fn report_record(report: &RegistrationReport) -> ReportRecord {
    let applied = MODELS.iter().position(|model| *model == report.applied);
    ReportRecord {
        levels: report.levels,
        applied: applied.unwrap_or_default() as f64,
        focal_px: report.focal_px,
        offset: report.offset,
        gain: report.gain.map(f64::from),
        sampled_views: report.sampled_views as f64,
        views: report.views as f64,
    }
}

fn read_report(record: ReportRecord) -> Option<RegistrationReport> {
    let applied = (0u8..)
        .zip(MODELS)
        .find(|(index, _)| f64::from(*index) == record.applied);
    Some(RegistrationReport {
        levels: record.levels,
        applied: applied?.1,
        focal_px: record.focal_px,
        offset: record.offset,
        gain: record.gain.map(|gain| gain as f32),
        sampled_views: record.sampled_views as usize,
        views: record.views as usize,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    pub(crate) use crate::view_geometry::tests::{image_set, plane_view, saved};
    use glam::{DMat3, DVec3};
    use headbox_images::Pose;

    fn some(i: usize) -> Registration {
        let part = |k: usize| ((i * 31 + k) as f64 * 0.7).sin() / 3.0;
        let distortion = Distortion {
            radial: [1, 2, 3, 4, 5, 6].map(part),
            tangential: [7, 8].map(part),
        };
        Registration {
            lens: Pinhole {
                focal_px: [9, 10].map(part),
                principal_px: [11, 12].map(part),
                distortion,
            },
            pose: Pose {
                eye: DVec3::from_array([13, 14, 15].map(part)),
                world_from_eye: DMat3::from_cols_array(&std::array::from_fn(|k| part(16 + k))),
            },
            exposure: Exposure {
                gain: [25, 26, 27].map(|k| part(k) as f32),
                offset: [28, 29, 30].map(|k| part(k) as f32),
            },
        }
    }

    #[test]
    fn registration_cache_round_trips() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("file");
        let report = RegistrationReport {
            levels: [1.0, 0.1, f64::INFINITY],
            applied: RegistrationModel::PerView,
            focal_px: [585.0, 511.1],
            offset: [0.1, 0.2],
            gain: [0.8, 1.3],
            sampled_views: 48,
            views: 50,
        };
        let found: CachedRegistration = (Some(report), vec![Some(some(0)), None, Some(some(2))]);
        write(&path, &found).expect("written");
        assert_eq!(open(&path, 3).expect("read"), found);
        assert!(open(&path, 4).is_err(), "of other views");
        let nothing: CachedRegistration = (None, vec![None; 3]);
        write(&path, &nothing).expect("written");
        assert_eq!(open(&path, 3).expect("read"), nothing);
        write(&path, &found).expect("written");
        let whole = std::fs::read(&path).expect("read");
        for at in [whole.len() - 1, whole.len() / 2, 30] {
            std::fs::write(&path, &whole[..at]).expect("written");
            assert!(open(&path, 3).is_err(), "{at} bytes");
            let mut broken = whole.clone();
            broken[at] ^= 0x55;
            std::fs::write(&path, broken).expect("written");
            assert!(open(&path, 3).is_err(), "byte {at}");
        }
    }

    #[test]
    fn registration_cached_until_files_change() {
        let pictures = tempfile::tempdir().expect("a folder");
        let cache = tempfile::tempdir().expect("a folder");
        let place = |i: usize| DVec3::new(0.02 * i as f64, 0.01 * (i % 2) as f64, 0.0);
        let view = |i: usize| {
            saved(
                &plane_view(place(i), 3.0, [96, 72]),
                pictures.path(),
                &format!("{i}"),
            )
        };
        let views: Vec<_> = (0..6).map(view).collect();
        let register = |views: &[_]| {
            let mut set = image_set(pictures.path(), views);
            let (report, was) = register(&mut set, Some(cache.path()), &|_| {}).expect("registers");
            (report, was, set.views)
        };
        let (report, first, registered) = register(&views);
        assert!(
            report.is_some() && first == CacheOrigin::default(),
            "{first:?}"
        );
        assert!(registered.iter().all(|view| view.registration.is_some()));
        let (again, second, same) = register(&views);
        assert!(
            second
                == CacheOrigin {
                    kept: true,
                    note: None
                }
                && again == report
                && same == registered
        );
        assert!(!register(&views[1..]).1.kept, "other views");
        let file = std::fs::read_dir(cache.path())
            .expect("read")
            .flatten()
            .map(|entry| entry.path());
        file.for_each(|file| std::fs::write(file, b"HEADBOX").expect("written"));
        let (_, anew, same) = register(&views);
        assert!(
            !anew.kept
                && anew.note.is_some_and(|note| note.contains("made anew"))
                && same == registered
        );
        saved(&plane_view(place(0), 2.0, [96, 72]), pictures.path(), "0");
        assert!(!register(&views).1.kept, "another picture");
    }
}
