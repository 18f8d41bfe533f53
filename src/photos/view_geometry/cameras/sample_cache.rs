//! Depth samples cached on disk, so that a set of a thousand cameras reopens at once (E5): a
//! container file whose points are read when they are needed.
//!
//! A file is named by its inputs ([`cache::views_file_name`]): the views as the set and its
//! registration describe them, the grid, and the origin. So a changed set has another file, and a
//! damaged file is recomputed. Opening a file does not read its points: those of each camera have
//! their own checksum; they are read when the camera's image is loaded ([`read_on_load`]).

use super::samples::{MAX_PROBES, Probes, Samples};
use crate::cache::{self, PoseRecord};
use crate::view_geometry::{RealCamera, SampleGrid};
use glam::DVec3;
use headbox_core::container::{Container, ContainerWriter, FileError, FileKind};
use headbox_images::{Distortion, LoadedView, Pinhole, View};
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Camera in a file.
#[derive(Clone, Copy, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C)]
struct CameraRecord {
    pose: PoseRecord,
    focal_px: [f64; 2],
    principal_px: [f64; 2],
}

/// Sections of the points' coordinates.
const AXES: [&str; 3] = ["x", "y", "z"];

/// Header of a file.
#[derive(Serialize, Deserialize)]
struct Header {
    cameras: usize,
    /// Number of levels of detail per camera.
    levels: usize,
}

/// Returns the path of a set's sample file in a folder; `None` if a file of a view no longer
/// exists.
pub(crate) fn path(
    folder: &Path,
    views: &[View],
    grid: &SampleGrid,
    origin: DVec3,
) -> Option<PathBuf> {
    Some(folder.join(cache::views_file_name(
        "samples",
        &format!("{grid:?} {origin:?}"),
        views,
    )?))
}

/// Writes the samples of all cameras.
pub(crate) fn write(path: &Path, cameras: &[RealCamera]) -> Result<(), FileError> {
    let samples = || cameras.iter().map(|camera| &*camera.samples);
    let mut writer = ContainerWriter::new(FileKind::SAMPLES);
    let header = Header {
        cameras: cameras.len(),
        levels: samples().next().map_or(0, |samples| samples.counts().len()),
    };
    writer.section("info", move || Ok(serde_json::to_vec(&header)?));
    writer.section("cameras", || {
        Ok(to_bytes(cameras.iter().map(camera_record)))
    });
    writer.section("counts", move || {
        Ok(to_bytes(samples().flat_map(Samples::counts).copied()))
    });
    writer.section("probes", move || {
        let axes = samples().flat_map(|samples| samples.probes().axes.as_flattened());
        Ok(to_bytes(axes.copied()))
    });
    writer.section("checksums", move || {
        Ok(to_bytes(samples().map(Samples::checksum)))
    });
    for (axis, name) in AXES.into_iter().enumerate() {
        writer.section(name, move || {
            let points = cameras
                .iter()
                .flat_map(|camera| camera.samples.of_level(0)[axis]);
            Ok(points.flat_map(|value| value.to_le_bytes()).collect())
        });
    }
    writer.write(path)
}

fn to_bytes<T: bytemuck::NoUninit>(values: impl Iterator<Item = T>) -> Vec<u8> {
    bytemuck::cast_slice(&values.collect::<Vec<T>>()).to_vec()
}

fn camera_record(camera: &RealCamera) -> CameraRecord {
    CameraRecord {
        pose: camera.pose.into(),
        focal_px: camera.lens.focal_px,
        principal_px: camera.lens.principal_px,
    }
}

/// Opens the file of `views` cameras, whose points stay in it.
pub(crate) fn open(path: &Path, views: usize) -> Result<Vec<RealCamera>, FileError> {
    let file = Container::open(path, FileKind::SAMPLES)?;
    let mut info = file.section("info")?;
    let Header { cameras, levels } = info.json()?;
    if cameras != views {
        return Err(info.damaged(format!("{views} cameras"), cameras.to_string()));
    }
    info = file.section("counts")?;
    let total = cameras
        .checked_mul(levels)
        .filter(|_| levels > 0)
        .ok_or_else(|| info.damaged("levels of detail", "none"))?;
    let counts: Vec<u32> = info.array(total)?;
    let records: Vec<CameraRecord> = file.section("cameras")?.array(cameras)?;
    let probes: Vec<[[f32; MAX_PROBES]; 3]> = file.section("probes")?.array(cameras)?;
    let checksums: Vec<u32> = file.section("checksums")?.array(cameras)?;
    let axes = file.stored(AXES)?;
    let available = axes.each_ref().map(|axis| axis.count::<f32>());
    let mut first = 0;
    let mut opened = Vec::with_capacity(cameras);
    for (((record, probes), counts), checksum) in records
        .iter()
        .zip(probes)
        .zip(counts.chunks(levels))
        .zip(checksums)
    {
        // The finest level has all points.
        let count = counts.iter().copied().max().unwrap_or(0) as usize;
        if available.iter().any(|points| first + count > *points) {
            return Err(info.damaged(
                format!("{} points or more", first + count),
                format!("{available:?}"),
            ));
        }
        let samples = Samples::stored(
            &axes,
            first..first + count,
            counts.to_vec(),
            Probes::new(probes),
            checksum,
        );
        first += count;
        opened.push(RealCamera {
            pose: record.pose.into(),
            lens: Pinhole {
                focal_px: record.focal_px,
                principal_px: record.principal_px,
                distortion: Distortion::default(),
            },
            left_out: false,
            samples: Arc::new(samples),
        });
    }
    Ok(opened)
}

/// Returns a callback that reads a camera's samples from `file` when its image is loaded, and
/// verifies them, so that no frame waits for a disk or shows damaged data. Damaged samples are
/// recomputed from the view, and the file is removed, to be rewritten the next time.
pub(crate) fn read_on_load(
    cameras: &[RealCamera],
    grid: SampleGrid,
    origin: DVec3,
    file: Option<PathBuf>,
) -> impl Fn(u32, &LoadedView) -> Option<Arc<Samples>> + Send + Sync + use<> {
    let samples: Vec<Arc<Samples>> = cameras
        .iter()
        .map(|camera| Arc::clone(&camera.samples))
        .collect();
    move |camera, view| {
        let stored = samples.get(camera as usize)?;
        let read = stored.read_or(|| Samples::new(view, &grid, origin))?;
        if let Some(file) = file.as_ref().filter(|_| stored.is_damaged()) {
            // A file that cannot be removed is found damaged again the next time.
            let _ = std::fs::remove_file(file);
        }
        Some(Arc::new(read))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    pub(crate) use crate::view_geometry::tests::{frame, frame_at, image_set, plane_view, saved};
    use crate::view_geometry::{GeometryResources, GeometrySettings, GeometryStats, ViewGeometry};
    use headbox_core::camera::Camera;
    use headbox_core::frame::Frame;
    use headbox_core::progress::Silent;
    use tempfile::TempDir;

    const SIZE: [u32; 2] = [96, 72];

    /// Folders of images and of the cache, and three views in the first.
    fn saved_views() -> (TempDir, TempDir, Vec<View>) {
        let folders = [0; 2].map(|_| tempfile::tempdir().expect("a folder"));
        let [pictures, cache] = folders;
        let view = |(x, name): (f64, &str)| {
            let view = plane_view(DVec3::new(x, 0.0, 0.0), 3.0, SIZE);
            saved(&view, pictures.path(), name)
        };
        let views = [(0.0, "a"), (0.1, "b"), (0.2, "c")].map(view).to_vec();
        (pictures, cache, views)
    }

    fn default_frame(geometry: &ViewGeometry, camera: &Camera) -> (Frame, GeometryStats) {
        frame(geometry, camera, &GeometrySettings::default())
    }

    fn open(views: &[View], cache: &Path) -> ViewGeometry {
        let set = image_set(cache, views);
        let resources = GeometryResources {
            cache: Some(cache.into()),
            ..GeometryResources::default()
        };
        ViewGeometry::open(&set, &views.iter().collect::<Vec<_>>(), &resources, &Silent)
            .expect("opens")
    }

    fn files(folder: &Path) -> Vec<PathBuf> {
        std::fs::read_dir(folder).map_or(Vec::new(), |entries| {
            entries.flatten().map(|entry| entry.path()).collect()
        })
    }

    #[test]
    fn reopened_set_needs_no_image() {
        let (_pictures, cache, views) = saved_views();
        let camera = frame_at(DVec3::new(0.05, 0.02, 0.1), SIZE);
        let settings = GeometrySettings::default();
        let expected = frame(&open(&views, cache.path()), &camera, &settings);
        let again = open(&views, cache.path());
        assert_eq!(again.pictures.bytes(), 0, "nothing was read");
        assert!(
            again.notes().is_empty() && cache::evict_to(cache.path(), 0) == 0,
            "it is in use"
        );
        let found = frame(&again, &camera, &settings);
        assert!(found.0 == expected.0 && found.1.samples == expected.1.samples);
        let samples = |geometry: &ViewGeometry| {
            geometry
                .cameras
                .iter()
                .map(|camera| camera.samples.bytes())
                .sum::<usize>()
        };
        assert!(
            samples(&again) < 3 * 2048,
            "points are not kept with the cameras: {}",
            samples(&again)
        );
        for coarse in [1, 3, 9] {
            let settings = GeometrySettings {
                level: coarse,
                ..settings
            };
            assert!(frame(&again, &camera, &settings).1.samples * 3 < found.1.samples);
        }
    }

    #[test]
    fn changed_view_is_resampled() {
        let (pictures, cache, views) = saved_views();
        open(&views, cache.path());
        saved(&plane_view(DVec3::ZERO, 2.0, SIZE), pictures.path(), "a");
        let camera = frame_at(DVec3::ZERO, SIZE);
        let settings = GeometrySettings {
            cameras: 1,
            ..GeometrySettings::default()
        };
        let (nearer, _) = frame(&open(&views, cache.path()), &camera, &settings);
        assert_eq!(files(cache.path()).len(), 2);
        let set = image_set(pictures.path(), &views);
        let views_in_set: Vec<&View> = views.iter().collect();
        let uncached =
            ViewGeometry::open(&set, &views_in_set, &GeometryResources::default(), &Silent)
                .expect("opens");
        assert!(frame(&uncached, &camera, &settings).0 == nearer);
        open(&views[1..], cache.path());
        assert_eq!(files(cache.path()).len(), 3, "other views, another file");
    }

    #[test]
    fn damaged_cache_file_is_rewritten() {
        let (_pictures, cache, views) = saved_views();
        let camera = frame_at(DVec3::ZERO, SIZE);
        let expected = default_frame(&open(&views, cache.path()), &camera);
        let file = files(cache.path()).pop().expect("a file");
        let whole = std::fs::read(&file).expect("read");
        let cameras = super::open(&file, 3).expect("whole");
        let damages: [Vec<u8>; 5] = [
            Vec::new(),
            whole[..40].to_vec(),
            whole[..whole.len() - 100].to_vec(),
            whole
                .iter()
                .enumerate()
                .map(|(i, byte)| if i == 700 { !byte } else { *byte })
                .collect(),
            b"HEADBOX\0trth and something else".to_vec(),
        ];
        for damage in damages {
            std::fs::remove_file(&file).expect("removed");
            std::fs::write(&file, &damage).expect("written");
            assert!(super::open(&file, 3).is_err(), "{} bytes", damage.len());
            let anew = open(&views, cache.path());
            assert!(
                matches!(anew.notes(), [note] if note.contains("made anew")),
                "{:?}",
                anew.notes()
            );
            assert!(default_frame(&anew, &camera).0 == expected.0);
            assert_eq!(std::fs::read(&file).expect("read"), whole);
        }
        // A file that says nothing true of its points.
        let short: Vec<RealCamera> = cameras.iter().take(2).cloned().collect();
        write(&file, &short).expect("written");
        assert_eq!(open(&views, cache.path()).cameras().len(), 3);
        // A cache that cannot be written.
        let nowhere = cache.path().join("file");
        std::fs::write(&nowhere, b"no folder").expect("written");
        assert!(default_frame(&open(&views, &nowhere), &camera).0 == expected.0);
    }

    #[test]
    fn damaged_points_are_recomputed() {
        let (_pictures, cache, views) = saved_views();
        let camera = frame_at(DVec3::new(0.05, 0.0, 0.1), SIZE);
        let expected = default_frame(&open(&views, cache.path()), &camera);
        let file = files(cache.path()).pop().expect("a file");
        let whole = std::fs::read(&file).expect("read");
        let cameras = super::open(&file, 3).expect("whole");
        assert!(
            cameras
                .iter()
                .all(|camera| camera.samples.read_or(Samples::default).is_some()
                    && !camera.samples.is_damaged())
        );
        // The last byte of the second camera's last point, whichever axis is last in the file.
        let of_one = whole.len() - 1 - 4 * cameras[2].samples.counts()[0] as usize;
        let damaged: Vec<u8> = whole
            .iter()
            .zip(0..)
            .map(|(byte, i)| byte ^ u8::from(i == of_one))
            .collect();
        std::fs::remove_file(&file).expect("removed");
        std::fs::write(&file, damaged).expect("written");
        let mended = open(&views, cache.path());
        assert!(
            mended.notes().is_empty() && mended.repaired().is_empty(),
            "points are not read yet"
        );
        let found = default_frame(&mended, &camera);
        assert!(found.0 == expected.0 && found.1.samples == expected.1.samples);
        assert!(
            matches!(&mended.repaired()[..], [why] if why.contains("samples of b")),
            "{:?}",
            mended.repaired()
        );
        assert!(!file.exists(), "it is made anew the next time");
        open(&views, cache.path());
        assert_eq!(std::fs::read(&file).expect("read"), whole);
    }

    #[test]
    fn cache_file_truncated_while_open_is_recomputed() {
        let (_pictures, cache, views) = saved_views();
        let camera = frame_at(DVec3::new(0.05, 0.0, 0.1), SIZE);
        let expected = default_frame(&open(&views, cache.path()), &camera);
        let geometry = open(&views, cache.path());
        let file = files(cache.path()).pop().expect("a file");
        let file = std::fs::File::options().write(true).open(file);
        file.and_then(|file| file.set_len(100)).expect("truncated");
        assert!(default_frame(&geometry, &camera).0 == expected.0);
        assert_eq!(geometry.repaired().len(), 3, "{:?}", geometry.repaired());
    }

    #[test]
    fn vanished_images_are_skipped() {
        let (_pictures, cache, views) = saved_views();
        open(&views, cache.path());
        let geometry = open(&views, cache.path());
        std::fs::remove_file(&views[0].color).expect("removed");
        std::fs::write(&views[1].color, b"no picture").expect("written");
        let (shown, stats) = default_frame(&geometry, &frame_at(DVec3::ZERO, SIZE));
        assert!(
            stats.cameras_used == 1 && stats.hole_pixels < 96 * 72 / 4,
            "{stats:?}"
        );
        assert_eq!(
            geometry.pictures.lost().len(),
            2,
            "{:?}",
            geometry.pictures.lost()
        );
        assert!(shown.color.iter().any(|color| color[0] > 0));
    }
}
