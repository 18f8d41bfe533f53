//! Reader of COLMAP's models, text and binary: `cameras`, `images`, and dense depth maps if
//! present.

use super::cameras::{model_of_number, parse_lens};
use crate::cameras::lens::Lens;
use crate::cameras::pose::Pose;
use crate::cameras::rectify::{ImageLens, ViewList};
use crate::depth::DepthSource;
use crate::readers::byte_reader::ByteReader;
use crate::readers::left_out::LeftOut;
use crate::readers::paths::{find_file, resolve_in};
use crate::readers::text;
use crate::views::view::View;
use crate::{ImageSet, ImagesError};
use glam::{DMat3, DQuat, DVec3};
use headbox_core::depth_kind::DepthKind;
use headbox_core::files::InputFolder;
use headbox_core::read_note::ReadNote;
use std::collections::BTreeMap;
use std::io::Read;
use std::path::{Path, PathBuf};

/// Intrinsics of an entry of `cameras`.
struct ColmapCamera {
    size_px: [u32; 2],
    lens: ImageLens,
}

/// Entry of `images`.
struct ColmapImage {
    pose: Result<Pose, String>,
    camera: u32,
    name: String,
}

/// Model in a folder or below it.
pub(super) struct ModelFolder {
    /// Folder of its files.
    pub(super) path: PathBuf,
    /// Extension of its files, `bin` or `txt`.
    pub(super) extension: &'static str,
    /// Note on other models, which are left out.
    note: Option<ReadNote>,
}

/// Folders of undistorted images with depth that COLMAP's reconstructors write beside `sparse`.
const DENSE: [&str; 2] = ["dense/0", "dense"];

/// Folder of depth maps in a dense one.
const DEPTH_MAPS: &str = "stereo/depth_maps";

/// Returns a note on depth that belongs to another model of the same images than the one that is
/// read.
fn note_dense(folder: &Path, model: &Path) -> Option<ReadNote> {
    let has_depth = |below: &&str| folder.join(below).join(DEPTH_MAPS).is_dir();
    let dense = folder.join(DENSE.into_iter().find(has_depth)?);
    let sentence = format!(
        "the depth in {} belongs to undistorted images: open that folder to use it",
        dense.display()
    );
    (!model.starts_with(&dense)).then(|| sentence.into())
}

/// Returns the extension of the model's files in a folder.
fn model_extension(folder: &Path) -> Option<&'static str> {
    let has = |extension: &&str| folder.join(format!("cameras.{extension}")).is_file();
    ["bin", "txt"].into_iter().find(has)
}

/// Finds the model in a folder or below it: of several models of a run, the one with most images.
pub(super) fn find_model(set: &InputFolder) -> Result<Option<ModelFolder>, ImagesError> {
    let folder = set.path();
    let dense = DENSE.map(|below| (format!("{below}/sparse"), false));
    let runs = ["sparse", "colmap/sparse"].map(|below| (below.to_owned(), true));
    let places = [(String::new(), false)]
        .into_iter()
        .chain(runs)
        .chain(dense);
    for (below, is_run) in places {
        let path = folder.join(below);
        let mut models = Vec::new();
        // A run writes its models to the subfolders 0, 1, 2, ...
        if is_run && path.is_dir() {
            for model in text::list_folder(&path)? {
                models.extend(model_extension(&model).map(|extension| (model, extension)));
            }
        }
        models.extend(model_extension(&path).map(|extension| (path, extension)));
        if models.len() < 2 {
            if let Some((path, extension)) = models.pop() {
                return Ok(Some(ModelFolder {
                    path,
                    extension,
                    note: None,
                }));
            }
            continue;
        }
        return choose_model(set, models).map(Some);
    }
    Ok(None)
}

/// Chooses the model with most images, and names the others.
fn choose_model(
    set: &InputFolder,
    models: Vec<(PathBuf, &'static str)>,
) -> Result<ModelFolder, ImagesError> {
    let images: Vec<u64> = models
        .iter()
        .map(|(path, extension)| {
            count_images(set, &path.join(format!("images.{extension}")), extension)
        })
        .collect();
    let most = images.iter().copied().max().unwrap_or(0);
    let chosen = images.iter().position(|&count| count == most).unwrap_or(0);
    let name = |i: usize| {
        let path = models[i].0.strip_prefix(set.path()).unwrap_or(&models[i].0);
        format!("{} with {} images", path.display(), images[i])
    };
    let others: Vec<String> = (0..models.len())
        .filter(|&i| i != chosen)
        .map(name)
        .collect();
    let note = format!(
        "{} models: read {}, the largest; left out {}",
        models.len(),
        name(chosen),
        others.join(", ")
    );
    let (path, extension) = models[chosen].clone();
    Ok(ModelFolder {
        path,
        extension,
        note: Some(note.into()),
    })
}

/// Returns the number of images that a file of images lists, 0 if it cannot be read.
fn count_images(set: &InputFolder, file: &Path, extension: &str) -> u64 {
    if set.check(file).is_err() {
        return 0;
    }
    if extension == "txt" {
        let text = text::read_text(set, file).unwrap_or_default();
        return text::numbered_lines(&text)
            .filter(|(_, line)| is_image_line(line))
            .count() as u64;
    }
    let mut count = [0; 8];
    let read = std::fs::File::open(file).and_then(|mut file| file.read_exact(&mut count));
    read.map_or(0, |()| u64::from_le_bytes(count))
}

/// Opens the set in a folder; `None` without a model.
pub(crate) fn open(set: &InputFolder) -> Result<Option<ImageSet>, ImagesError> {
    let folder = set.path();
    let Some(model) = find_model(set)? else {
        return Ok(None);
    };
    let cameras_file = model.path.join(format!("cameras.{}", model.extension));
    let images_file = model.path.join(format!("images.{}", model.extension));
    let (format, cameras, images) = if model.extension == "bin" {
        let cameras = binary_cameras(set, &cameras_file)?;
        let images = binary_images(set, &images_file)?;
        ("COLMAP model (binary)", cameras, images)
    } else {
        let cameras = text_cameras(set, &cameras_file)?;
        (
            "COLMAP model (text)",
            cameras,
            text_images(set, &images_file)?,
        )
    };
    if images.is_empty() {
        return Err(ImagesError::field(
            &images_file,
            "the file",
            "contains no image",
        ));
    }
    let mut views = Vec::new();
    let mut left_out = LeftOut::default();
    let pictures = find_image_folder(set, &model.path, &images);
    for image in images {
        let field = format!("image {}", image.name);
        let camera = match cameras.get(&image.camera) {
            Some(camera) => camera.as_ref().map_err(|cause| {
                let camera = format!("camera {}", image.camera);
                ImagesError::field(&cameras_file, camera, cause)
            }),
            None => {
                let cause = format!(
                    "refers to camera {}, which is missing in {}",
                    image.camera,
                    cameras_file.display()
                );
                Err(ImagesError::field(&images_file, field.clone(), cause))
            }
        };
        let pose = image.pose;
        let pose = pose.map_err(|cause| ImagesError::field(&images_file, field, cause));
        let usable = camera.and_then(|camera| Ok((camera, pose?)));
        let Some((&ColmapCamera { size_px, lens }, pose)) = left_out.keep(&image.name, usable)?
        else {
            continue;
        };
        let color = resolve_in(set, &pictures, &images_file, "name", &image.name)?;
        let workspaces = [Some(folder), model.path.parent()].into_iter().flatten();
        let kinds = ["geometric", "photometric"].into_iter();
        let depth = workspaces
            .flat_map(|workspace| kinds.clone().map(move |kind| (workspace, kind)))
            .find_map(|(workspace, kind)| {
                let file = format!("{}.{kind}.bin", image.name);
                let path = workspace.join(DEPTH_MAPS).join(file);
                path.is_file()
                    .then(|| DepthSource::metres(path, DepthKind::EyeDepth, 1.0))
            });
        // The list sets the lens.
        let view = View::new(
            image.name,
            size_px,
            Lens::Equirectangular,
            pose,
            color,
            depth,
        );
        views.push((view, lens));
    }
    views.sort_by(|(a, _), (b, _)| a.name.cmp(&b.name));
    let mut list = ViewList::default();
    for (view, lens) in views {
        list.push(view, lens);
    }
    let (views, mut notes) = list.finish();
    notes.extend(model.note);
    notes.extend(note_dense(folder, &model.path));
    notes.extend(left_out.finish()?);
    Ok(Some(ImageSet {
        notes,
        ..ImageSet::new(folder, format, views)
    }))
}

/// Finds the folder of a model's images by the first images' names: `images`, or a folder that
/// contains the model.
fn find_image_folder(set: &InputFolder, model: &Path, images: &[ColmapImage]) -> PathBuf {
    let folder = set.path();
    /// Number of images that are looked for: some may be missing.
    const FIRST: usize = 16;
    // Of images in several sizes, the largest that is there.
    let smaller = ["images_2", "images_4", "images_8"];
    // Undistorted images stand beside their model, below the originals.
    let beside = model.parent().map(|parent| parent.join("images"));
    let mut candidates: Vec<PathBuf> = beside.into_iter().collect();
    candidates.extend([folder.join("images"), model.join("images")]);
    candidates.extend(smaller.map(|name| folder.join(name)));
    candidates.push(folder.to_owned());
    candidates.extend(
        model
            .ancestors()
            .skip(2)
            .take(1)
            .map(|above| above.join("images")),
    );
    candidates
        .iter()
        .find(|candidate| {
            let mut first = images.iter().take(FIRST);
            first.any(|image| matches!(find_file(set, candidate, &image.name), Ok(Some(_))))
        })
        .cloned()
        .unwrap_or_else(|| folder.join("images"))
}

/// Cameras by their number; an unusable one has the cause, as the rest of a sentence.
type ColmapCameras = BTreeMap<u32, Result<ColmapCamera, String>>;

fn parse_camera(model: &str, size: [u64; 2], parameters: &[f64]) -> Result<ColmapCamera, String> {
    let lens = parse_lens(model, parameters)?;
    let side = |side: u64| {
        u32::try_from(side)
            .ok()
            .filter(|side| (1..=headbox_core::camera::Camera::MAX_SIDE_PX).contains(side))
    };
    let (Some(width), Some(height)) = (side(size[0]), side(size[1])) else {
        return Err(format!("is {}x{} pixels", size[0], size[1]));
    };
    Ok(ColmapCamera {
        size_px: [width, height],
        lens,
    })
}

fn parse_pose([w, x, y, z]: [f64; 4], translation: [f64; 3]) -> Result<Pose, String> {
    let quaternion = DQuat::from_xyzw(x, y, z, w);
    if !(quaternion.length() > 1e-6 && quaternion.is_finite()) {
        return Err("has a quaternion that is not a rotation".into());
    }
    Pose::from_camera_from_world(
        DMat3::from_quat(quaternion.normalize()),
        DVec3::from(translation),
    )
}

fn binary_cameras(set: &InputFolder, file: &Path) -> Result<ColmapCameras, ImagesError> {
    let bytes = text::read_bytes(set, file)?;
    let mut bytes = ByteReader { file, rest: &bytes };
    let mut cameras = BTreeMap::new();
    for _ in 0..bytes.u64()? {
        let id = bytes.u32()?;
        let model = bytes.u32()?;
        let size = [bytes.u64()?, bytes.u64()?];
        let (name, count) = model_of_number(model).ok_or_else(|| {
            ImagesError::field(
                file,
                format!("camera {id}"),
                format!("has the unknown model number {model}"),
            )
        })?;
        let parameters: Result<Vec<f64>, _> = (0..count).map(|_| bytes.f64()).collect();
        cameras.insert(id, parse_camera(name, size, &parameters?));
    }
    Ok(cameras)
}

fn binary_images(set: &InputFolder, file: &Path) -> Result<Vec<ColmapImage>, ImagesError> {
    let bytes = text::read_bytes(set, file)?;
    let mut bytes = ByteReader { file, rest: &bytes };
    let mut images = Vec::new();
    for _ in 0..bytes.u64()? {
        let _id = bytes.u32()?;
        let quaternion = bytes.f64s()?;
        let translation = bytes.f64s()?;
        let camera = bytes.u32()?;
        let end = bytes
            .rest
            .iter()
            .position(|&byte| byte == 0)
            .ok_or_else(|| bytes.truncated())?;
        let name = String::from_utf8_lossy(bytes.take(end)?).into_owned();
        bytes.take(1)?;
        bytes.skip_list(24)?; // features
        let pose = parse_pose(quaternion, translation);
        images.push(ColmapImage { pose, camera, name });
    }
    Ok(images)
}

fn text_cameras(set: &InputFolder, file: &Path) -> Result<ColmapCameras, ImagesError> {
    let text = text::read_text(set, file)?;
    let mut cameras = BTreeMap::new();
    for (number, line) in text::numbered_lines(&text).filter(|(_, line)| !line.is_empty()) {
        let bad = || {
            ImagesError::field(
                file,
                format!("line {number}"),
                "expected CAMERA_ID MODEL WIDTH HEIGHT PARAMS[]",
            )
        };
        let mut words = line.split_whitespace();
        let (Some(id), Some(model)) = (words.next().and_then(|id| id.parse().ok()), words.next())
        else {
            return Err(bad());
        };
        let numbers: Option<Vec<f64>> = words.map(|word| word.parse().ok()).collect();
        let numbers = numbers
            .filter(|numbers| numbers.len() >= 2)
            .ok_or_else(bad)?;
        let size = [numbers[0] as u64, numbers[1] as u64];
        cameras.insert(id, parse_camera(model, size, &numbers[2..]));
    }
    Ok(cameras)
}

/// Fields of a line of an image: quaternion, translation, camera and name.
type ImageLine<'a> = ([f64; 7], u32, &'a str);

/// Parses a line of an image; `None` for others, such as the image's points (X, Y, POINT3D_ID).
fn parse_image_line(line: &str) -> Option<ImageLine<'_>> {
    let mut rest = line;
    let mut next = || {
        let (word, tail) = rest.split_once(char::is_whitespace)?;
        rest = tail.trim_start();
        Some(word)
    };
    let _id: u32 = next()?.parse().ok()?;
    let mut numbers = [0.0; 7];
    for number in &mut numbers {
        *number = next()?.parse().ok()?;
    }
    let camera = next()?.parse().ok()?;
    let is_number = |word: &str| word.parse::<f64>().is_ok();
    // Points at whole pixels look like an image whose name consists of numbers.
    let words = rest.split_whitespace().count();
    let is_points = words.is_multiple_of(3) && rest.split_whitespace().all(is_number);
    (!rest.is_empty() && !is_points).then_some((numbers, camera, rest))
}

fn is_image_line(line: &str) -> bool {
    parse_image_line(line).is_some()
}

/// Reads the images. The line of an image's points may be empty or missing.
fn text_images(set: &InputFolder, file: &Path) -> Result<Vec<ColmapImage>, ImagesError> {
    let text = text::read_text(set, file)?;
    let mut images = Vec::new();
    let is_number = |word: &str| word.parse::<f64>().is_ok();
    for (number, line) in text::numbered_lines(&text).filter(|(_, line)| !line.is_empty()) {
        let Some((numbers, camera, name)) = parse_image_line(line) else {
            let is_points = line.split_whitespace().take(3).all(is_number)
                && line.split_whitespace().count() % 3 == 0;
            if is_points && !images.is_empty() {
                continue;
            }
            return Err(ImagesError::field(
                file,
                format!("line {number}"),
                "expected IMAGE_ID QW QX QY QZ TX TY TZ CAMERA_ID NAME, or the points of an image",
            ));
        };
        let [qw, qx, qy, qz, tx, ty, tz] = numbers;
        let pose = parse_pose([qw, qx, qy, qz], [tx, ty, tz]);
        images.push(ColmapImage {
            pose,
            camera,
            name: name.into(),
        });
    }
    Ok(images)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn images(text: &str) -> Vec<String> {
        let folder = tempfile::tempdir().expect("a folder");
        let file = folder.path().join("images.txt");
        std::fs::write(&file, text).expect("written");
        let images = text_images(&InputFolder::new(folder.path()), &file).expect("images");
        images.into_iter().map(|image| image.name).collect()
    }

    #[test]
    fn image_lines_recognised_by_content() {
        let image = |i: u32| format!("{i} 1 0 0 0 0.1 0 0 1 {i} a.png\n");
        let expected = ["1 a.png", "2 a.png"];
        for between in [
            "",
            "\n",
            "\n\n",
            "# next\n",
            "1.5 2 -1 3 4 7\n",
            "\n10 20 -1\n",
        ] {
            assert_eq!(
                images(&(image(1) + between + &image(2))),
                expected,
                "{between:?}"
            );
        }
        // Twelve whole numbers: the points of image 1.
        let points = "1 1 0 0 0 0 0 0 1 5 6 -1\n";
        assert_eq!(images(&(image(1) + points + &image(2) + points)), expected);
        let aligned = "1  1 0 0 0\t 0.1  0 0 1  1 a.png\n\n2 1 0 0 0 0 0 0 1\t2 a.png";
        assert_eq!(images(aligned), expected);
    }

    #[test]
    fn line_without_image_refused() {
        let folder = tempfile::tempdir().expect("a folder");
        let file = folder.path().join("images.txt");
        for text in [
            "1 1 0 0 0 0.1 0 0 a.png\n",
            "1 1 0 0 0 0 0 0 1 a.png\n\nfoo bar\n",
        ] {
            std::fs::write(&file, text).expect("written");
            let error = text_images(&InputFolder::new(folder.path()), &file)
                .err()
                .expect("an error")
                .to_string();
            assert!(
                error.contains("line") && error.contains("CAMERA_ID"),
                "{error}"
            );
        }
    }
}
