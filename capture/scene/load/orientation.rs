//! Guesses the up axis and the unit of an OBJ, which the format does not define.
//!
//! The user's options win, then statements in the comments at the head of the file. Otherwise three
//! pieces of evidence speak for Z or for Y: faces that a group or material calls a floor, the
//! largest horizontal plane in the lower half, and a base at the origin. Without evidence it is Y,
//! as in most OBJ files. The unit follows from the height. Notes report guesses other than Y and
//! metres and doubtful ones, with the option that overrides them. glTF defines Y up and metres:
//! there the same evidence causes notes and nothing else.

use super::LoadOptions;
use crate::scene::Scene;
use glam::DVec3;
use headbox_core::file_frame::{FileFrame, UpAxis};

/// Triangles of a box; scenes with fewer give no evidence.
const MIN_TRIANGLES: usize = 12;
/// Least thickness of a scene relative to its extent. In thinner ones (pictures, bare ground) only
/// names are evidence.
const MIN_THICKNESS: f64 = 0.01;
/// Least share of named floors in the scene's area.
const MIN_FLOOR_SHARE: f64 = 0.01;
/// Cosine of the angle (11 degrees) within which a normal is parallel to an axis.
const PARALLEL_COSINE: f64 = 0.98;
/// Slices of each axis in which planes are searched.
const SLICES: usize = 400;
/// Difference between the shares of the scene's area in the largest planes that is full evidence.
const PLANE_SHARE: f64 = 0.05;
/// Distances of the base from the origin, as shares of the extent: at the origin, and off it.
const ORIGIN_SHARES: [f64; 2] = [0.02, 0.1];
/// Sum of the evidence above which Z is up. Test files with Z up have 0.99 or more.
const Z_THRESHOLD: f64 = 0.5;
/// Sum above which Y is reported as doubtful. Test files with a clear Y have -0.28 or less.
const DOUBT_THRESHOLD: f64 = -0.2;
/// Greatest height of a scene in metres and of one in centimetres, file units: buildings and trees
/// are 2 to 30 m high.
const MAX_HEIGHTS: [f64; 2] = [120.0, 1_500.0];
/// Range of heights that are not reported, metres.
const USUAL_HEIGHT_M: std::ops::Range<f64> = 0.5..25.0;

/// Evidence for the up axis and the unit apart from the triangles.
#[derive(Clone, Debug, Default)]
pub(super) struct FrameHints {
    pub(super) options: LoadOptions,
    /// Words of the comments at the head of an OBJ, lower case, each between spaces.
    pub(super) comments: String,
    /// Faces of an OBJ that have the name of a floor.
    pub(super) floors: AxisAreas,
}

impl FrameHints {
    /// Chooses the frame of an OBJ scene whose positions are still those of the file. Returns notes
    /// on guesses that the user may want to override.
    pub(super) fn choose_frame(&self, scene: &Scene) -> (FileFrame, Vec<String>) {
        let mut notes = Vec::new();
        let up = self.options.up.unwrap_or_else(|| {
            let (sum, reasons) = self.evidence_for_z(scene);
            if sum > Z_THRESHOLD {
                notes.push(format!(
                    "Z is taken as up ({reasons}); use --up y if that is wrong"
                ));
            } else if sum > DOUBT_THRESHOLD {
                let note = "Y is taken as up without clear evidence; use --up z if that is wrong";
                notes.push(note.into());
            }
            (sum > Z_THRESHOLD).into()
        });
        let unit_m = self.options.unit_m.unwrap_or_else(|| {
            let height = height(scene, up);
            let stated = self.stated_unit();
            let unit_m = stated.unwrap_or_else(|| guess_unit(scene, height));
            let is_certain = stated.is_some() || is_flat(scene) || USUAL_HEIGHT_M.contains(&height);
            if unit_m != 1.0 || !is_certain {
                let height_m = height * unit_m;
                let other = if unit_m == 1.0 { "cm or another" } else { "m" };
                notes.push(format!(
                    "the unit is taken as {unit_m} m, which makes the scene {height_m:.1} m high; \
                     use --unit {other} if that is wrong"
                ));
            }
            unit_m
        });
        (FileFrame { up, unit_m }, notes)
    }

    /// Returns notes on evidence against Y up and metres in a glTF scene, whose Y is up already.
    pub(super) fn doubts(&self, scene: &Scene) -> Vec<String> {
        let mut notes = Vec::new();
        let (sum, reasons) = self.evidence_for_z(scene);
        if self.options.up.is_none() && sum > Z_THRESHOLD {
            notes.push(format!(
                "Y is up, as glTF defines, but Z seems to be ({reasons}); use --up z if so"
            ));
        }
        let height = height(scene, UpAxis::Y);
        if self.options.unit_m.is_none() && guess_unit(scene, height) != 1.0 {
            notes.push(format!(
                "the unit is 1 m, as glTF defines, which makes the scene {height:.1} m high; use \
                 --unit cm or another if that is wrong"
            ));
        }
        notes
    }

    /// Returns the sum of the evidence that Z is up, each piece between -1 (Y is up) and 1, and the
    /// reasons for Z.
    fn evidence_for_z(&self, scene: &Scene) -> (f64, String) {
        let states = |axis: &str| {
            let phrases = [" A up ", " up A ", " up axis A "];
            let is_stated = |phrase: &&str| self.comments.contains(&phrase.replace('A', axis));
            phrases.iter().any(is_stated)
        };
        match (states("y"), states("z")) {
            (false, true) => return (f64::INFINITY, "its comments say so".into()),
            (true, false) => return (f64::NEG_INFINITY, String::new()),
            _ => {}
        }
        let mut evidence = Vec::new();
        let (planes, area) = largest_planes(scene);
        let floors = self.floors;
        if scene.triangles.len() >= MIN_TRIANGLES && floors.total > MIN_FLOOR_SHARE * area {
            let share = (floors.parallel.z - floors.parallel.y) / floors.total;
            evidence.push((share, "named floors are horizontal"));
        }
        if !is_flat(scene) {
            let plane = (planes.z - planes.y) / (area * PLANE_SHARE);
            evidence.push((plane.clamp(-1.0, 1.0), "a large plane lies low"));
            let [low, high] = scene.bounds();
            let offset = low.abs() / (high - low);
            let [at, near] = ORIGIN_SHARES.map(|share| offset.cmplt(DVec3::splat(share)));
            if at.z && !near.y {
                evidence.push((1.0, "its base is at the origin"));
            } else if at.y && !near.z {
                evidence.push((-1.0, "the base of Y is at the origin"));
            }
        }
        if evidence.is_empty() {
            return (f64::NEG_INFINITY, String::new());
        }
        let sum = evidence.iter().map(|(weight, _)| weight).sum();
        let for_z = evidence.iter().filter(|(weight, _)| *weight > 0.1);
        let reasons: Vec<&str> = for_z.map(|(_, reason)| *reason).collect();
        (sum, reasons.join(", "))
    }

    /// Returns the unit that the comments state, as in `# File units = meters`, in metres.
    fn stated_unit(&self) -> Option<f64> {
        let is_filler = |word: &str| matches!(word, "is" | "are" | "in");
        let words = self.comments.split(' ').filter(|word| !is_filler(word));
        let mut after_unit = words.skip_while(|word| !matches!(*word, "unit" | "units"));
        match after_unit.nth(1)? {
            "m" | "metre" | "metres" | "meter" | "meters" => Some(1.0),
            "dm" | "decimetres" | "decimeters" => Some(0.1),
            "cm" | "centimetres" | "centimeters" => Some(0.01),
            "mm" | "millimetres" | "millimeters" => Some(0.001),
            "inch" | "inches" => Some(0.0254),
            "ft" | "foot" | "feet" => Some(0.3048),
            _ => None,
        }
    }
}

/// Returns the words of the comments at the head of an OBJ, lower case, each between spaces.
pub(super) fn head_comments(text: &str) -> String {
    let is_head =
        |line: &&str| line.is_empty() || line.starts_with('#') || line.starts_with("mtllib");
    let head = text.lines().map(str::trim_start).take_while(is_head);
    comment_words(head.filter(|line| line.starts_with('#')))
}

/// Returns the first words of comments, lower case, each between spaces.
pub(super) fn comment_words<'a>(lines: impl Iterator<Item = &'a str>) -> String {
    /// Words further down rarely describe the file.
    const MAX_WORDS: usize = 500;
    let words = lines
        .flat_map(|line| line.split(|c: char| !c.is_ascii_alphanumeric()))
        .filter(|word| !word.is_empty());
    words
        .take(MAX_WORDS)
        .fold(" ".into(), |text, word| text + &word.to_lowercase() + " ")
}

/// Area of faces: in total, and of those whose normal is parallel to each axis.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct AxisAreas {
    parallel: DVec3,
    total: f64,
}

impl AxisAreas {
    /// Adds a face by its area times its normal.
    pub(super) fn add(&mut self, face: DVec3) {
        if face.is_finite() {
            self.parallel += parallel_area(face);
            self.total += face.length();
        }
    }
}

/// Returns the face's area for the axis that its normal is parallel to, and 0 for the others.
fn parallel_area(face: DVec3) -> DVec3 {
    let area = face.length();
    let is_parallel = face.abs().cmpgt(DVec3::splat(PARALLEL_COSINE * area));
    DVec3::select(is_parallel, DVec3::splat(area), DVec3::ZERO)
}

/// Returns the area of the largest plane across each axis in the lower half of the scene, and the
/// area of all triangles.
fn largest_planes(scene: &Scene) -> (DVec3, f64) {
    let [low, high] = scene.bounds();
    let mut planes = vec![DVec3::ZERO; SLICES / 2];
    let mut total = 0.0;
    for triangle in 0..scene.triangles.len() as u32 {
        let [a, b, c] = scene.corners(triangle);
        let face = (b - a).cross(c - a) / 2.0;
        total += face.length();
        let slice = ((a + b + c) / 3.0 - low) / (high - low) * SLICES as f64;
        for axis in 0..3 {
            if let Some(plane) = planes.get_mut(slice[axis] as usize) {
                plane[axis] += parallel_area(face)[axis];
            }
        }
    }
    (planes.into_iter().fold(DVec3::ZERO, DVec3::max), total)
}

/// Returns true if the scene lies in one plane, or nearly, or has fewer triangles than a box.
fn is_flat(scene: &Scene) -> bool {
    let [low, high] = scene.bounds();
    let extent = high - low;
    extent.min_element() < MIN_THICKNESS * extent.max_element()
        || scene.triangles.len() < MIN_TRIANGLES
}

/// Returns the extent along the up axis, file units.
fn height(scene: &Scene, up: UpAxis) -> f64 {
    let [low, high] = scene.bounds();
    let extent = high - low;
    if up == UpAxis::Z { extent.z } else { extent.y }
}

/// Returns the most likely unit of a scene, metres.
fn guess_unit(scene: &Scene, height: f64) -> f64 {
    if is_flat(scene) || height <= MAX_HEIGHTS[0] {
        1.0
    } else if height <= MAX_HEIGHTS[1] {
        0.01
    } else {
        0.001
    }
}
