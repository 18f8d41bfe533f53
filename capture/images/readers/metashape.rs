//! Reader of Agisoft Metashape's cameras (`File > Export > Export Cameras`, XML) next to images.

use super::intrinsics::pose_from_rows;
use super::left_out::LeftOut;
use super::paths::find_named_image;
use super::text;
use crate::cameras::camera_model::{CameraModel, Polynomial, Projection};
use crate::cameras::lens::{Distortion, Lens, Pinhole};
use crate::cameras::pose::Pose;
use crate::cameras::rectify::{ImageLens, ViewList};
use crate::views::color_images::read_size;
use crate::views::view::View;
use crate::{ImageSet, ImagesError};
use glam::{DMat3, DMat4, DVec3};
use headbox_core::files::InputFolder;
use headbox_core::read_note::ReadNote;
use roxmltree::{Document, Node};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// Maximum length of a file of cameras, bytes: some kilobytes each.
const MAX_BYTES: u64 = 1 << 30;

/// Opens the set in a folder; `None` without a file of cameras.
pub(crate) fn open(folder: &InputFolder) -> Result<Option<ImageSet>, ImagesError> {
    for file in text::list_folder(folder.path())? {
        let is_xml = file.extension().is_some_and(|extension| extension == "xml");
        let is_small = std::fs::metadata(&file).is_ok_and(|data| data.len() <= MAX_BYTES);
        if !(is_xml && is_small) {
            continue;
        }
        let text = text::read_text(folder, &file)?;
        if text.contains("<chunk") && text.contains("<sensors") {
            return read(folder, &file, &text).map(Some);
        }
    }
    Ok(None)
}

/// Camera of a sensor.
struct Sensor {
    size_px: [u32; 2],
    lens: ImageLens,
    has_skew: bool,
}

fn child<'a>(node: Node<'a, 'a>, name: &str) -> Option<Node<'a, 'a>> {
    node.children().find(|node| node.has_tag_name(name))
}

fn number(node: Node, name: &str) -> Option<f64> {
    child(node, name)?.text()?.trim().parse().ok()
}

fn numbers(node: Option<Node>) -> Option<Vec<f64>> {
    let text = node?.text()?;
    text.split_whitespace()
        .map(|word| word.parse().ok())
        .collect()
}

fn read(folder: &InputFolder, file: &Path, text: &str) -> Result<ImageSet, ImagesError> {
    let bad = |field: &str, cause: &str| ImagesError::field(file, field, cause);
    let document =
        Document::parse(text).map_err(|error| bad("the file", &format!("is not XML: {error}")))?;
    let (chunk, others) = choose_chunk(&document).ok_or_else(|| bad("chunk", "is missing"))?;
    let mut sensors = BTreeMap::new();
    let mut notes: Vec<ReadNote> = others.into_iter().collect();
    for node in chunk
        .descendants()
        .filter(|node| node.has_tag_name("sensor"))
    {
        let id = node.attribute("id").unwrap_or_default();
        let sensor = read_sensor(node)
            .map_err(|cause| ImagesError::field(file, format!("sensor {id}"), cause));
        sensors.insert(id, sensor);
    }
    let skewed = sensors
        .values()
        .filter(|sensor| matches!(sensor, Ok(s) if s.has_skew))
        .count();
    if skewed > 0 {
        notes.push(format!("the skew (b2) of {skewed} sensors is ignored").into());
    }
    let cameras: Vec<Node> = chunk.descendants().filter(is_camera).collect();
    let component = largest_component(&cameras);
    let (transform, note) = ChunkTransform::read(chunk, component);
    notes.extend(note);
    let mut list = ViewList::default();
    let mut left_out = LeftOut::default();
    let mut is_empty = true;
    for camera in cameras {
        let label = camera.attribute("label").unwrap_or_default();
        let frame = || {
            let fail = |cause: &str| ImagesError::field(file, format!("camera {label}"), cause);
            let rows = numbers(child(camera, "transform")).ok_or_else(|| fail("is not aligned"))?;
            if matches!(camera.attribute("enabled"), Some("0" | "false")) {
                return Err(fail("is disabled"));
            }
            if camera.attribute("component_id") != component {
                return Err(fail("is of a smaller component"));
            }
            let pose = pose_from_rows(&rows).map_err(|cause| fail(&cause))?;
            let pose = transform.apply(pose);
            let id = camera.attribute("sensor_id").unwrap_or_default();
            let sensor = match sensors.get(id) {
                Some(Ok(sensor)) => sensor,
                Some(Err(error)) => return Err(fail(&format!("has an unusable sensor: {error}"))),
                None => return Err(fail(&format!("refers to sensor {id}, which is missing"))),
            };
            let color = find_color(folder, file, label)?;
            let color = color.ok_or_else(|| fail("has no image file"))?;
            let size_px = read_size(&color)?;
            if size_px != sensor.size_px {
                let [w, h] = sensor.size_px;
                let cause = format!("is {}x{} pixels, not {w}x{h}", size_px[0], size_px[1]);
                return Err(ImagesError::invalid_picture(&color, cause));
            }
            let lens = Lens::Equirectangular;
            Ok((
                View::new(label.into(), size_px, lens, pose, color, None),
                sensor.lens,
            ))
        };
        if let Some((view, lens)) = left_out.keep(label, frame())? {
            is_empty = false;
            list.push(view, lens);
        }
    }
    let (views, more) = list.finish();
    notes.extend(more);
    notes.extend(left_out.finish()?);
    if is_empty {
        return Err(bad("cameras", "lists no camera of Metashape"));
    }
    Ok(ImageSet {
        notes,
        ..ImageSet::new(folder.path(), "Metashape cameras", views)
    })
}

/// Transform from the coordinates of a chunk or component to those of its project.
struct ChunkTransform {
    scale: f64,
    turn: Pose,
}

impl ChunkTransform {
    const IDENTITY: Self = Self {
        scale: 1.0,
        turn: Pose::IDENTITY,
    };

    /// Reads the transform of the component if it has one, else that of the chunk; returns also a
    /// note if it is not the identity.
    fn read(chunk: Node, component: Option<&str>) -> (Self, Option<ReadNote>) {
        let is_own = |node: &Node| {
            node.has_tag_name("component")
                && component.is_some_and(|id| node.attribute("id") == Some(id))
        };
        let own = chunk.descendants().find(is_own);
        let node = own.and_then(|own| child(own, "transform"));
        let Some(node) = node.or_else(|| child(chunk, "transform")) else {
            return (Self::IDENTITY, None);
        };
        let scale = number(node, "scale").filter(|scale| scale.is_finite() && *scale > 0.0);
        let scale = scale.unwrap_or(1.0);
        let turn = read_turn(node);
        let use_of_turn = if turn.is_some() {
            "applied"
        } else {
            "left out, as they lead to the globe or are not a rotation"
        };
        let note = format!(
            "the transform of the chunk scales by {scale}; its rotation and translation are {use_of_turn}"
        );
        let has_effect = turn.is_none_or(|turn| turn != Pose::IDENTITY) || scale != 1.0;
        let turn = turn.unwrap_or(Pose::IDENTITY);
        let transform = Self { scale, turn };
        (transform, has_effect.then(|| note.into()))
    }

    fn apply(&self, pose: Pose) -> Pose {
        Pose {
            eye: self.turn.to_world(pose.eye * self.scale),
            world_from_eye: self.turn.world_from_eye * pose.world_from_eye,
        }
    }
}

/// Reads the rotation and translation of a transform. Those to the globe would put the eyes
/// thousands of kilometres from the origin, and are left out.
fn read_turn(node: Node) -> Option<Pose> {
    /// Longest translation within a project, metres.
    const FARTHEST_M: f64 = 1e5;
    let list = |name| child(node, name).map(|node| numbers(Some(node)));
    let rotation = list("rotation").unwrap_or_else(|| Some(DMat3::IDENTITY.to_cols_array().into()));
    let translation = list("translation").unwrap_or_else(|| Some(vec![0.0; 3]));
    let rotation: [f64; 9] = rotation?.try_into().ok()?;
    let translation: [f64; 3] = translation?.try_into().ok()?;
    let mut matrix = DMat4::from_mat3(DMat3::from_cols_array(&rotation).transpose());
    matrix.w_axis = DVec3::from(translation).extend(1.0);
    let turn = Pose::from_opengl(matrix).ok()?;
    (turn.eye.length() < FARTHEST_M).then_some(turn)
}

fn is_camera(node: &Node) -> bool {
    node.has_tag_name("camera") && node.has_attribute("sensor_id")
}

/// Chooses the chunk with most aligned cameras, and names the others: each has coordinates of its
/// own.
fn choose_chunk<'a>(document: &'a Document<'a>) -> Option<(Node<'a, 'a>, Option<ReadNote>)> {
    let nodes = document.descendants();
    let chunks: Vec<Node> = nodes.filter(|node| node.has_tag_name("chunk")).collect();
    let count = |chunk: &Node| {
        let is_aligned = |node: &Node| is_camera(node) && child(*node, "transform").is_some();
        chunk.descendants().filter(is_aligned).count()
    };
    let counts: Vec<usize> = chunks.iter().map(count).collect();
    let most = counts.iter().copied().max()?;
    let chosen = counts.iter().position(|&count| count == most)?;
    let name = |i: usize| {
        let label = chunks[i].attribute("label").map(str::to_owned);
        let label = label.unwrap_or_else(|| (i + 1).to_string());
        format!("{label} with {} cameras", counts[i])
    };
    let others: Vec<String> = (0..chunks.len())
        .filter(|&i| i != chosen)
        .map(name)
        .collect();
    let sentence = format!("read the chunk {}, the largest; left out", name(chosen));
    Some((chunks[chosen], text::note_names(&sentence, &others)))
}

/// Returns the component with most aligned cameras.
fn largest_component<'a>(cameras: &[Node<'a, 'a>]) -> Option<&'a str> {
    let mut counts: BTreeMap<Option<&str>, usize> = BTreeMap::new();
    let aligned = cameras
        .iter()
        .filter(|camera| child(**camera, "transform").is_some());
    for camera in aligned {
        *counts.entry(camera.attribute("component_id")).or_default() += 1;
    }
    let most = counts.values().copied().max()?;
    counts.into_iter().find(|(_, count)| *count == most)?.0
}

/// Finds the image of a camera, whose label is the file's name with or without its extension.
fn find_color(
    folder: &InputFolder,
    file: &Path,
    label: &str,
) -> Result<Option<PathBuf>, ImagesError> {
    let name = Path::new(label).file_name().and_then(|name| name.to_str());
    name.map_or(Ok(None), |name| find_named_image(folder, file, name))
}

/// Reads a sensor: Brown's distortion about the centre of the image, or an equidistant fisheye.
fn read_sensor(node: Node) -> Result<Sensor, String> {
    let resolution = child(node, "resolution").ok_or("has no resolution")?;
    let side = |name: &str| {
        let side = resolution
            .attribute(name)
            .and_then(|side| side.parse::<u32>().ok());
        side.filter(|side| (1..=headbox_core::camera::Camera::MAX_SIDE_PX).contains(side))
            .ok_or_else(|| format!("has no {name} in pixels"))
    };
    let size_px = [side("width")?, side("height")?];
    let kind = node.attribute("type").unwrap_or("frame");
    if kind == "spherical" {
        return Ok(Sensor {
            size_px,
            lens: ImageLens::Direct(Lens::Equirectangular),
            has_skew: false,
        });
    }
    let calibrations = || {
        node.children()
            .filter(|node| node.has_tag_name("calibration"))
    };
    let adjusted = calibrations().find(|node| node.attribute("class") == Some("adjusted"));
    let calibration = adjusted
        .or_else(|| calibrations().next())
        .ok_or("has no calibration of its lens")?;
    let value = |name: &str| number(calibration, name).unwrap_or(0.0);
    let focal = number(calibration, "f")
        .or_else(|| number(calibration, "fy"))
        .ok_or("has no focal length")?;
    let focal_px = [
        number(calibration, "fx").unwrap_or(focal) + value("b1"),
        focal,
    ];
    let principal_px = [
        f64::from(size_px[0]) / 2.0 + value("cx"),
        f64::from(size_px[1]) / 2.0 + value("cy"),
    ];
    let k = ["k1", "k2", "k3", "k4"].map(value);
    // Metashape's p1 is OpenCV's p2.
    let tangential = [value("p2"), value("p1")];
    let projection = match kind {
        "frame" if k[3] == 0.0 => {
            let lens = Pinhole {
                focal_px,
                principal_px,
                distortion: Distortion {
                    radial: [k[0], k[1], k[2], 0.0, 0.0, 0.0],
                    tangential,
                },
            };
            return Ok(Sensor {
                size_px,
                lens: ImageLens::Direct(Lens::Pinhole(lens.checked()?)),
                has_skew: value("b2") != 0.0,
            });
        }
        "frame" => Projection::Plane(Polynomial::of_plane(&k, tangential)),
        "fisheye" | "equidistant_fisheye" => {
            Projection::Fisheye(Polynomial::of_angles(&k, tangential, [0.0; 4], false))
        }
        other => {
            return Err(format!(
                "is of the type {other}; expected frame, fisheye or spherical"
            ));
        }
    };
    let model = CameraModel {
        focal_px,
        principal_px,
        projection,
    };
    Ok(Sensor {
        size_px,
        lens: ImageLens::Resampled(model.checked()?),
        has_skew: value("b2") != 0.0,
    })
}
