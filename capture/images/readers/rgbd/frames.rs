//! Reader of RGB-D frames: `frame-NNNNNN.color.png`, `.depth.png` (16 bits, millimetres) and
//! `.pose.txt` (camera to world), with 3x3 intrinsics next to them; the layout of the TSDF demo and
//! of 7-Scenes.

use crate::cameras::lens::Lens;
use crate::depth::DepthSource;
use crate::readers::intrinsics::{create_pinhole, note_principal, pose_from_rows, read_intrinsics};
use crate::readers::left_out::LeftOut;
use crate::readers::text;
use crate::views::color_images::read_camera_size;
use crate::views::view::View;
use crate::{ImageSet, ImagesError};
use headbox_core::depth_kind::DepthKind;
use headbox_core::files::InputFolder;
use headbox_core::read_note::ReadNote;
use std::path::{Path, PathBuf};

/// Camera of 7-Scenes, whose folders have no intrinsics: focal length and principal point, pixel
/// centres at integers.
const SEVEN_SCENES: [f64; 3] = [585.0, 320.0, 240.0];

/// Opens the frames in a folder or below it; `None` without poses.
pub(crate) fn open(set: &InputFolder) -> Result<Option<ImageSet>, ImagesError> {
    let folder = set.path();
    let mut sequences = Vec::new();
    find_sequences(folder, 3, &mut sequences)?;
    let Some((frame_folder, poses, mut notes)) = choose_sequence(folder, sequences) else {
        return Ok(None);
    };
    let pinhole = match find_intrinsics(&frame_folder, folder) {
        Some(file) => read_intrinsics(set, &file)?,
        None => {
            let [focal, x, y] = SEVEN_SCENES;
            notes.push(format!(
                "no camera-intrinsics.txt: assuming {focal} px at {x}, {y}, the camera of 7-Scenes"
            ).into());
            create_pinhole([focal; 2], [x, y])
        }
    };
    let lens = Lens::Pinhole(pinhole);
    let mut views = Vec::new();
    let mut left_out = LeftOut::default();
    let mut without_pose = Vec::new();
    let mut without_depth = Vec::new();
    for pose_file in poses {
        let stem = pose_file
            .to_string_lossy()
            .trim_end_matches("pose.txt")
            .to_owned();
        let pose = text::read_number_list(set, &pose_file).and_then(|numbers| {
            pose_from_rows(&numbers)
                .map_err(|cause| ImagesError::field(&pose_file, "the 4x4 pose", cause))
        });
        // Trackers write infinities where tracking was lost.
        if pose.is_err() && is_lost(set, &pose_file) {
            without_pose.push(text::file_name(&pose_file));
            continue;
        }
        let file = |extension: &str| PathBuf::from(format!("{stem}{extension}"));
        let color = [file("color.png"), file("color.jpg")]
            .into_iter()
            .find(|path| path.is_file());
        let color = color.unwrap_or_else(|| file("color.png"));
        let name = text::file_name(&color);
        let frame =
            pose.and_then(|pose| Ok((pose, read_camera_size(&color, pinhole.principal_px)?)));
        let Some((pose, size_px)) = left_out.keep(&text::file_name(&pose_file), frame)? else {
            continue;
        };
        let depth = Some(file("depth.png")).filter(|path| path.is_file());
        if depth.is_none() {
            without_depth.push(text::file_name(&color));
        }
        let depth = depth.map(|path| DepthSource::assumed(path, DepthKind::EyeDepth));
        views.push(View::new(name, size_px, lens, pose, color, depth));
    }
    notes.extend(left_out.finish()?);
    if views.is_empty() {
        return Err(ImagesError::field(
            &frame_folder,
            "frame-*.pose.txt",
            "no frame has a pose",
        ));
    }
    notes.extend(text::note_names(
        "skipped, because tracking was lost",
        &without_pose,
    ));
    notes.extend(text::note_names(text::WITHOUT_DEPTH, &without_depth));
    notes.extend(note_principal(&views));
    Ok(Some(ImageSet {
        notes,
        ..ImageSet::new(folder, "RGB-D frames", views)
    }))
}

/// Returns true if a pose file contains numbers that are not finite.
fn is_lost(set: &InputFolder, pose_file: &Path) -> bool {
    set.read_text(pose_file).is_ok_and(|text| {
        let text = text.to_lowercase();
        text.contains("inf") || text.contains("nan")
    })
}

/// Finds the intrinsics next to the frames, in a folder above them up to `folder`, or next to
/// `folder`.
fn find_intrinsics(frame_folder: &Path, folder: &Path) -> Option<PathBuf> {
    let names = ["camera-intrinsics.txt", "intrinsics.txt", "intrinsic.txt"];
    let parents = frame_folder
        .ancestors()
        .take_while(|parent| parent.starts_with(folder))
        .map(Path::to_path_buf);
    let folders = parents.chain(folder.parent().map(Path::to_path_buf));
    folders
        .flat_map(|folder| names.map(|name| folder.join(name)))
        .find(|file| file.is_file())
}

/// Folder of frames and its pose files, sorted by name.
type FrameFolder = (PathBuf, Vec<PathBuf>);

/// Finds the folders with poses, at most `levels` levels down.
fn find_sequences(
    folder: &Path,
    levels: u32,
    found: &mut Vec<FrameFolder>,
) -> Result<(), ImagesError> {
    let entries = text::list_folder(folder)?;
    let is_pose = |path: &&PathBuf| path.to_string_lossy().ends_with(".pose.txt");
    let poses: Vec<PathBuf> = entries.iter().filter(is_pose).cloned().collect();
    if !poses.is_empty() {
        found.push((folder.into(), poses));
    } else if levels > 0 {
        for below in entries.iter().filter(|path| path.is_dir()) {
            find_sequences(below, levels - 1, found)?;
        }
    }
    Ok(())
}

/// Chooses the sequence with most frames, and names the others: each has a world of its own.
fn choose_sequence(
    folder: &Path,
    mut sequences: Vec<FrameFolder>,
) -> Option<(PathBuf, Vec<PathBuf>, Vec<ReadNote>)> {
    let most = sequences.iter().map(|(_, poses)| poses.len()).max()?;
    let chosen = sequences
        .iter()
        .position(|(_, poses)| poses.len() == most)?;
    let (path, poses) = sequences.remove(chosen);
    let name = |path: &Path, count: usize| {
        let path = path.strip_prefix(folder).unwrap_or(path);
        format!("{} with {count} frames", path.display())
    };
    let others = sequences
        .iter()
        .map(|(path, poses)| name(path, poses.len()));
    let others: Vec<String> = others.collect();
    let note = (!others.is_empty()).then(|| {
        let read = name(&path, most);
        let sentence = format!("read the sequence {read}; open the others by themselves");
        ReadNote::with_names(&sentence, &others, 1)
    });
    Some((path, poses, note.into_iter().collect()))
}
