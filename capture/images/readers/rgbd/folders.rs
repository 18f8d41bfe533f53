//! Reader of RGB-D sequences in folders: ScanNet (`color`, `depth`, `pose`, `intrinsic`), TUM
//! (`rgb.txt`, `depth.txt` or `associations.txt`, `groundtruth.txt`) and Replica (`results`,
//! `traj.txt`).

use crate::cameras::lens::{Distortion, Lens, Pinhole};
use crate::cameras::pose::Pose;
use crate::depth::{AssumedDepth, DepthSource};
use crate::depth_files;
use crate::readers::intrinsics::{create_pinhole, note_principal, pose_from_rows, read_intrinsics};
use crate::readers::json::{self, JsonObject};
use crate::readers::left_out::LeftOut;
use crate::readers::paths::{find_image, resolve};
use crate::readers::text;
use crate::views::color_images::{read_camera_size, read_size};
use crate::views::view::View;
use crate::{ImageSet, ImagesError};
use glam::{DMat4, DQuat, DVec3};
use headbox_core::depth_kind::DepthKind;
use headbox_core::files::InputFolder;
use headbox_core::read_note::ReadNote;
use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

/// Metres per step of depth of ScanNet.
const SCANNET_UNIT_M: f32 = 0.001;

/// Metres per step of depth of TUM.
const TUM_UNIT_M: f32 = 1.0 / 5000.0;

/// Largest difference of the times of an image, its depth and its pose, seconds.
const MAX_TIME_S: f64 = 0.02;

/// Steps of depth per metre, focal length, and principal point of Replica as NICE-SLAM renders it.
const REPLICA: [f64; 4] = [6553.5, 600.0, 599.5, 339.5];

/// Default camera of TUM's sensors at 640x480: focal lengths and principal point.
const TUM_CAMERA: [f64; 4] = [525.0, 525.0, 319.5, 239.5];

/// Opens the sequence in a folder; `None` if it has none of the layouts.
pub(crate) fn open(set: &InputFolder) -> Result<Option<ImageSet>, ImagesError> {
    let folder = set.path();
    let first = |names: &[&str]| {
        let mut folders = names.iter().map(|name| folder.join(name));
        folders.find(|folder| folder.is_dir())
    };
    let poses = first(&["pose", "poses"]);
    let colors = first(&["color", "rgb", "images"]);
    if let (Some(poses), Some(colors)) = (poses, colors) {
        return open_scannet(set, &poses, &colors).map(Some);
    }
    let is_listed = ["rgb.txt", ASSOCIATIONS].map(|name| folder.join(name).is_file());
    if folder.join("groundtruth.txt").is_file() && is_listed.contains(&true) {
        return open_tum(set).map(Some);
    }
    if folder.join("traj.txt").is_file() && folder.join("results").is_dir() {
        return open_replica(set).map(Some);
    }
    Ok(None)
}

/// Frames of a sequence.
struct Sequence {
    views: Vec<View>,
    left_out: LeftOut,
    without_depth: Vec<String>,
    /// Size of the images for which the intrinsics are, pixels, if a file states it.
    camera_px: Option<[u32; 2]>,
}

impl Sequence {
    fn new() -> Self {
        Self {
            views: Vec::new(),
            left_out: LeftOut::default(),
            without_depth: Vec::new(),
            camera_px: None,
        }
    }

    /// Adds a frame; `depth` is a file and metres per step of integers.
    fn add(
        &mut self,
        color: PathBuf,
        depth: Option<(PathBuf, f32)>,
        pose: Result<Pose, ImagesError>,
        lens: Pinhole,
    ) -> Result<(), ImagesError> {
        let name = text::file_name(&color);
        let centre_px = self
            .camera_px
            .map(|size| size.map(|side| f64::from(side) / 2.0));
        let centre_px = centre_px.unwrap_or(lens.principal_px);
        let frame = pose.and_then(|pose| Ok((pose, read_camera_size(&color, centre_px)?)));
        let Some((pose, size_px)) = self.left_out.keep(&name, frame)? else {
            return Ok(());
        };
        let depth = depth.filter(|(path, _)| path.is_file());
        if depth.is_none() {
            self.without_depth.push(name.clone());
        }
        // The formats state that depth is along the axis, but programs that render sets in them
        // write distances along the ray, too.
        let depth = depth.map(|(path, unit_m)| DepthSource {
            float_unit_m: 1.0,
            assumed: AssumedDepth {
                kind: true,
                unit: false,
            },
            ..DepthSource::metres(path, DepthKind::EyeDepth, unit_m)
        });
        let from_px = self.camera_px.unwrap_or(size_px);
        let lens = Lens::Pinhole(lens.scaled(from_px, size_px));
        self.views
            .push(View::new(name, size_px, lens, pose, color, depth));
        Ok(())
    }

    fn finish(
        self,
        folder: &Path,
        format: &'static str,
        mut notes: Vec<ReadNote>,
    ) -> Result<ImageSet, ImagesError> {
        notes.extend(self.left_out.finish()?);
        notes.extend(text::note_names(text::WITHOUT_DEPTH, &self.without_depth));
        notes.extend(note_principal(&self.views));
        if self.views.is_empty() {
            return Err(ImagesError::field(folder, format, "lists no frame"));
        }
        Ok(ImageSet {
            notes,
            ..ImageSet::new(folder, format, self.views)
        })
    }
}

/// Reads a number at the end of a name, so that 10 follows 9.
fn number_of(path: &Path) -> (Option<u64>, String) {
    let stem = path.file_stem().unwrap_or_default().to_string_lossy();
    (stem.parse().ok(), stem.into_owned())
}

fn open_scannet(set: &InputFolder, poses: &Path, colors: &Path) -> Result<ImageSet, ImagesError> {
    let folder = set.path();
    let names = ["intrinsic_color.txt", "intrinsic_depth.txt"];
    let places = ["intrinsic", "intrinsics", ""];
    let find = |name: &str| {
        let files = places.map(|place| folder.join(place).join(name));
        files.into_iter().find(|file| file.is_file())
    };
    let shared = ["camera-intrinsics.txt", "intrinsics.txt", "intrinsic.txt"];
    let Some(file) = find(names[0]).or_else(|| shared.into_iter().find_map(find)) else {
        let cause = "is missing: a ScanNet sequence (color, depth, pose) needs its intrinsics";
        let expected = folder.join("intrinsic").join(names[0]);
        return Err(ImagesError::field(&expected, "the file", cause));
    };
    let lens = read_intrinsics(set, &file)?;
    let is_pose = |path: &PathBuf| path.extension().is_some_and(|extension| extension == "txt");
    let mut poses = text::list_folder(poses)?;
    poses.retain(is_pose);
    poses.sort_by_key(|path| number_of(path));
    let posed: BTreeSet<String> = poses.iter().map(|path| number_of(path).1).collect();
    let mut unposed = text::list_folder(colors)?;
    unposed.retain(|image| image.is_file() && !posed.contains(&number_of(image).1));
    let unposed: Vec<String> = unposed.iter().map(|image| text::file_name(image)).collect();
    let mut notes = Vec::from_iter(text::note_names("left out without a pose", &unposed));
    let mut sequence = Sequence::new();
    for pose_file in poses {
        let (_, stem) = number_of(&pose_file);
        let pose = text::read_number_list(set, &pose_file).and_then(|numbers| {
            pose_from_rows(&numbers)
                .map_err(|cause| ImagesError::field(&pose_file, "the 4x4 pose", cause))
        });
        let depth = folder.join("depth").join(format!("{stem}.png"));
        let color = find_image(colors, &stem);
        sequence.add(color, Some((depth, SCANNET_UNIT_M)), pose, lens)?;
    }
    if let Some(depth_file) = find(names[1]) {
        let depth_lens = read_intrinsics(set, &depth_file)?;
        notes.extend(note_depth_camera(&sequence.views, &depth_lens));
    }
    sequence.finish(folder, "ScanNet sequence", notes)
}

/// Returns a note if the depth camera has another field of view than the colour camera.
fn note_depth_camera(views: &[View], depth_lens: &Pinhole) -> Option<ReadNote> {
    let (lens, size_px, depth_px) = views.iter().find_map(|view| {
        let size = depth_files::read_size(&view.depth.as_ref()?.path);
        Some((view.pinhole()?, view.size_px, size.ok()??))
    })?;
    let expected = depth_lens.scaled(depth_px, size_px);
    let differs = |k: usize| {
        let focal = (expected.focal_px[k] / lens.focal_px[k] - 1.0).abs();
        let principal = expected.principal_px[k] - lens.principal_px[k];
        focal > 0.02 || principal.abs() > 0.05 * f64::from(size_px[k])
    };
    (0..2).any(differs).then(|| {
        "the depth camera (intrinsic_depth.txt) has another field of view than the colour camera: \
         depth is taken as registered to colour"
            .into()
    })
}

/// Entry of a list of TUM: time, seconds, and the words behind it.
type TimedLine = (f64, Vec<String>);

/// Reads a list of TUM, sorted by time.
fn read_timed(set: &InputFolder, file: &Path) -> Result<Vec<TimedLine>, ImagesError> {
    let text = text::read_text(set, file)?;
    let mut lines = Vec::new();
    for (number, line) in text::numbered_lines(&text).filter(|(_, line)| !line.is_empty()) {
        let mut words = line.split([' ', '\t', ',']).filter(|word| !word.is_empty());
        let time = words.next().and_then(|word| word.parse::<f64>().ok());
        let time = time.filter(|time| time.is_finite()).ok_or_else(|| {
            let cause = "expected a time in seconds, then what was recorded";
            ImagesError::field(file, format!("line {number}"), cause)
        })?;
        lines.push((time, words.map(str::to_owned).collect()));
    }
    lines.sort_by(|a, b| a.0.total_cmp(&b.0));
    Ok(lines)
}

/// List of TUM's `associate.py` and of ICL-NUIM: time and image, time and depth, in either order.
const ASSOCIATIONS: &str = "associations.txt";

/// Reads associated images and depths, both with the time of the image.
fn read_associations(set: &InputFolder, file: &Path) -> Result<[Vec<TimedLine>; 2], ImagesError> {
    let (mut colors, mut depths) = (Vec::new(), Vec::new());
    for (time, words) in read_timed(set, file)? {
        let other_time = words.get(1).and_then(|word| word.parse().ok());
        let ([first, _, second], Some(other_time)) = (words.as_slice(), other_time) else {
            let cause = "expected a time and an image, then a time and its depth";
            return Err(ImagesError::field(file, format!("time {time}"), cause));
        };
        let is_depth_first = first.to_lowercase().contains("depth");
        let (color, depth, time) = if is_depth_first {
            (second, first, other_time)
        } else {
            (first, second, time)
        };
        colors.push((time, vec![color.clone()]));
        depths.push((time, vec![depth.clone()]));
    }
    Ok([colors, depths])
}

/// Returns the entry nearest in time, if it is near enough.
fn nearest(lines: &[TimedLine], time: f64) -> Option<&[String]> {
    let after = lines.partition_point(|line| line.0 < time);
    let candidates = lines[after.saturating_sub(1)..].iter().take(2);
    let (at, words) =
        candidates.min_by(|a, b| (a.0 - time).abs().total_cmp(&(b.0 - time).abs()))?;
    ((at - time).abs() <= MAX_TIME_S + 1e-9).then_some(words)
}

/// Converts TX TY TZ QX QY QZ QW to a pose.
pub(super) fn pose_from_words(words: &[String]) -> Result<DMat4, String> {
    let numbers: Option<Vec<f64>> = words.iter().map(|word| word.parse().ok()).collect();
    let Some(&[tx, ty, tz, qx, qy, qz, qw]) = numbers.as_deref() else {
        return Err("expected TX TY TZ QX QY QZ QW".into());
    };
    let rotation = DQuat::from_xyzw(qx, qy, qz, qw);
    if !(rotation.is_finite() && rotation.length() > 1e-6) {
        return Err("has a quaternion that is not a rotation".into());
    }
    let position = DVec3::new(tx, ty, tz);
    Ok(DMat4::from_rotation_translation(
        rotation.normalize(),
        position,
    ))
}

fn open_tum(set: &InputFolder) -> Result<ImageSet, ImagesError> {
    let folder = set.path();
    let [colors_file, depth_file, poses_file] =
        ["rgb.txt", "depth.txt", "groundtruth.txt"].map(|name| folder.join(name));
    let poses = read_timed(set, &poses_file)?;
    let [colors, depths] = if !colors_file.is_file() {
        read_associations(set, &folder.join(ASSOCIATIONS))?
    } else if depth_file.is_file() {
        [
            read_timed(set, &colors_file)?,
            read_timed(set, &depth_file)?,
        ]
    } else {
        [read_timed(set, &colors_file)?, Vec::new()]
    };
    let mut notes = Vec::new();
    let own = [
        "camera-intrinsics.txt",
        "intrinsics.txt",
        "intrinsic.txt",
        "calibration.txt",
    ]
    .map(|name| folder.join(name));
    let own = own.into_iter().find(|file| file.is_file());
    let lens = own.as_deref().map(|file| read_intrinsics(set, file));
    let mut lens = lens.transpose()?;
    let mut sequence = Sequence::new();
    for (time, words) in &colors {
        let written = words.first().map_or("", String::as_str);
        let color = resolve(set, &colors_file, &format!("time {time}"), written)?;
        let lens = match lens {
            Some(lens) => lens,
            None => *lens.insert(sensor_lens(folder, &color, &mut notes)?),
        };
        let pose = nearest(&poses, *time)
            .ok_or_else(|| format!("has no pose within {MAX_TIME_S} s of {time}"))
            .and_then(|words| Pose::from_opencv(pose_from_words(words)?));
        let pose = pose.map_err(|cause| ImagesError::field(&poses_file, "the file", cause));
        let depth = nearest(&depths, *time)
            .and_then(|words| words.first())
            .map(|written| resolve(set, &depth_file, "depth", written))
            .transpose()?;
        sequence.add(color, depth.map(|path| (path, TUM_UNIT_M)), pose, lens)?;
    }
    sequence.finish(folder, "TUM RGB-D sequence", notes)
}

/// Returns the camera of TUM's sensors, which its folders do not state.
fn sensor_lens(
    folder: &Path,
    color: &Path,
    notes: &mut Vec<ReadNote>,
) -> Result<Pinhole, ImagesError> {
    let size_px = read_size(color)?;
    if size_px != [640, 480] {
        let cause = format!(
            "is missing: the images of this TUM RGB-D sequence have {}x{} pixels, not the 640x480 of \
             TUM's sensors; write the 3x3 intrinsics, pixel centres at integers",
            size_px[0], size_px[1]
        );
        let file = folder.join("camera-intrinsics.txt");
        return Err(ImagesError::field(&file, "the file", cause));
    }
    // Calibrations of the three sensors: focal lengths, principal point, k1, k2, p1, p2, k3.
    let sensors = [
        (
            "freiburg1",
            [
                517.3, 516.5, 318.6, 255.3, 0.2624, -0.9531, -0.0054, 0.0026, 1.1633,
            ],
        ),
        (
            "freiburg2",
            [
                520.9, 521.0, 325.1, 249.7, 0.2312, -0.7849, -0.0033, -0.0001, 0.9172,
            ],
        ),
        (
            "freiburg3",
            [535.4, 539.2, 320.1, 247.6, 0.0, 0.0, 0.0, 0.0, 0.0],
        ),
    ];
    let path = std::fs::canonicalize(folder).unwrap_or_else(|_| folder.into());
    let path = path.to_string_lossy().into_owned();
    let sensor = sensors.iter().find(|(name, _)| path.contains(name));
    let Some((name, k)) = sensor else {
        let [fx, fy, cx, cy] = TUM_CAMERA;
        notes.push(
            format!(
            "no camera-intrinsics.txt: assuming {fx} px at {cx}, {cy}, the default of TUM's sensors"
        )
        .into(),
        );
        return Ok(create_pinhole([fx, fy], [cx, cy]));
    };
    notes.push(
        format!("no camera-intrinsics.txt: assuming the camera of {name}, from the folder's name")
            .into(),
    );
    let distortion = Distortion {
        radial: [k[4], k[5], k[8], 0.0, 0.0, 0.0],
        tangential: [k[6], k[7]],
    };
    let pinhole = create_pinhole([k[0], k[1]], [k[2], k[3]]);
    Ok(Pinhole {
        distortion,
        ..pinhole
    })
}

/// Reads the number in the name of a file of Replica: `frame000012.jpg`.
fn frame_number(path: &Path) -> Option<usize> {
    let stem = path.file_stem()?.to_string_lossy();
    let digits = stem.trim_start_matches(|c: char| !c.is_ascii_digit());
    digits.parse().ok()
}

fn open_replica(set: &InputFolder) -> Result<ImageSet, ImagesError> {
    let folder = set.path();
    let mut notes = Vec::new();
    let mut sequence = Sequence::new();
    let [mut scale, focal, x, y] = REPLICA;
    let above = folder.parent().map(|parent| parent.join("cam_params.json"));
    let file = [Some(folder.join("cam_params.json")), above]
        .into_iter()
        .flatten()
        .find(|file| file.is_file());
    let lens = if let Some(file) = file {
        let value = json::read(set, &file)?;
        let camera = JsonObject::root(&file, &value).object("camera")?;
        scale = camera.number("scale")?;
        if scale <= 0.0 {
            return Err(camera.error("scale", "must be above 0: steps of depth per metre"));
        }
        let [fx, fy, cx, cy] = ["fx", "fy", "cx", "cy"].map(|key| camera.number(key));
        if camera.has("w") && camera.has("h") {
            sequence.camera_px = Some([camera.side("w")?, camera.side("h")?]);
        }
        let lens = create_pinhole([fx?, fy?], [cx?, cy?]);
        lens.checked().map_err(|cause| camera.error("fx", cause))?
    } else {
        notes.push(
            format!(
            "no cam_params.json: assuming {focal} px at {x}, {y} and {scale} steps of depth per \
             metre, the camera of Replica"
        )
        .into(),
        );
        create_pinhole([focal; 2], [x, y])
    };
    let trajectory = folder.join("traj.txt");
    let text = text::read_text(set, &trajectory)?;
    let results = text::list_folder(&folder.join("results"))?;
    let named = |prefix: &str| -> Vec<(Option<usize>, &PathBuf)> {
        let has_prefix = |path: &&PathBuf| text::file_name(path).starts_with(prefix);
        let mut files: Vec<_> = results.iter().filter(has_prefix).collect();
        files.sort_by_key(|path| frame_number(path));
        files
            .into_iter()
            .map(|path| (frame_number(path), path))
            .collect()
    };
    let colors = named("frame");
    let depths: BTreeMap<_, _> = named("depth").into_iter().collect();
    let lines: Vec<(usize, &str)> = text::numbered_lines(&text)
        .filter(|(_, line)| !line.is_empty())
        .collect();
    if colors.len() != lines.len() {
        notes.push(
            format!(
                "traj.txt has {} poses for {} images; those without a partner are left out",
                lines.len(),
                colors.len()
            )
            .into(),
        );
    }
    let has_all = colors.len() == lines.len();
    for (i, (number, color)) in colors.into_iter().enumerate() {
        // Some of the images keep the numbers of their lines.
        let index = number.filter(|_| !has_all).unwrap_or(i);
        let Some((line_number, line)) = lines.get(index) else {
            continue;
        };
        let words = line.split_whitespace();
        let numbers: Result<Vec<f64>, _> = words.map(str::parse).collect();
        let pose = numbers
            .map_err(|_| "expected 16 numbers".to_owned())
            .and_then(|numbers| pose_from_rows(&numbers))
            .map_err(|cause| ImagesError::field(&trajectory, format!("line {line_number}"), cause));
        let depth = depths
            .get(&number)
            .map(|path| ((*path).clone(), (1.0 / scale) as f32));
        sequence.add(color.clone(), depth, pose, lens)?;
    }
    sequence.finish(folder, "Replica sequence", notes)
}
