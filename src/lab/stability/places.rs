//! Cases of position and size of the scene: at large offsets, f32 coordinates lose all detail.

use super::Case;
use super::fixtures::{
    capture, case_rng, draw, largest, look_along, pack, random_direction, rms_levels, small_capture,
};
use glam::{DVec3, Vec3, dvec3};
use headbox_core::camera::Camera;
use headbox_core::file_frame::{FileFrame, UpAxis};
use headbox_cube::render::RenderSettings;
use headbox_ldi::rays::trace_and_accumulate::blocked_share;
use headbox_scene::camera_path::CameraRecord;
use headbox_scene::load::{LoadOptions, load};
use headbox_scene::scene::Scene;
use headbox_trace::bvh::{Ray, Tracer};
use std::fmt::Write as _;
use std::sync::Arc;

/// Error bound of distances, metres: rounding of a decimal coordinate of 1e7 m to f64 (9e-10 m each
/// way, twice), and of distances of some metres to f32.
const OFFSET_BOUND: f64 = 4e-6;

pub(super) fn cases() -> Vec<Case> {
    let offset_reason = "f64 keeps 1e7 m to 2e-9 m; the tracer subtracts the headbox's centre before it goes to f32, which keeps some metres to 5e-7 m.";
    vec![
        Case {
            name: "offset of 1e3 m in an OBJ file",
            what: "Stairs of centimetres 1e3 m from the origin: error of the distances that rays find.",
            unit: "m",
            bound: OFFSET_BOUND,
            reason: offset_reason,
            measure: |seed| offset_in_obj(seed, 1e3),
        },
        Case {
            name: "offset of 1e5 m in an OBJ file",
            what: "The same, 1e5 m.",
            unit: "m",
            bound: OFFSET_BOUND,
            reason: "The same.",
            measure: |seed| offset_in_obj(seed, 1e5),
        },
        Case {
            name: "offset of 1e7 m in an OBJ file",
            what: "The same, 1e7 m.",
            unit: "m",
            bound: OFFSET_BOUND,
            reason: "The same.",
            measure: |seed| offset_in_obj(seed, 1e7),
        },
        Case {
            name: "offset of 1e3 m in a glTF node",
            what: "The same stairs, a node each, the offset in the nodes' translations or matrices.",
            unit: "m",
            bound: OFFSET_BOUND,
            reason: "Node transforms are read from the file's text in f64 and composed in f64.",
            measure: |seed| offset_in_nodes(seed, 1e3),
        },
        Case {
            name: "offset of 1e5 m in a glTF node",
            what: "The same, 1e5 m.",
            unit: "m",
            bound: OFFSET_BOUND,
            reason: "The same.",
            measure: |seed| offset_in_nodes(seed, 1e5),
        },
        Case {
            name: "offset of 1e7 m in a glTF node",
            what: "The same, 1e7 m.",
            unit: "m",
            bound: OFFSET_BOUND,
            reason: "The same; in f32, steps would be 1 m.",
            measure: |seed| offset_in_nodes(seed, 1e7),
        },
        Case {
            name: "scene moved by 1e7 m",
            what: "The same scene and headbox at the origin and 1e7 m away, captured and drawn: root mean square difference.",
            unit: "levels",
            bound: 1.0,
            reason: "Everything after loading is relative to the headbox's centre; what the offset itself rounds away is 2e-9 m.",
            measure: |seed| {
                let mut rng = case_rng(seed, 21);
                changed_by(seed, 1.0, random_direction(&mut rng) * 1e7)
            },
        },
        Case {
            name: "scene scaled by 1e-3",
            what: "The same scene a thousandth as large.",
            unit: "levels",
            bound: 1.0,
            reason: "Nothing depends on the unit: bins, tolerances and lifts are relative. Rounding differs, as 1e-3 is no power of two, and a few rays at edges hit something else.",
            measure: |seed| changed_by(seed, 1e-3, DVec3::ZERO),
        },
        Case {
            name: "scene scaled by 1e4",
            what: "The same scene 1e4 times as large.",
            unit: "levels",
            bound: 1.0,
            reason: "The same.",
            measure: |seed| changed_by(seed, 1e4, DVec3::ZERO),
        },
        Case {
            name: "geometry 1 mm from the headbox",
            what: "Panels 1 mm before every face (scene contact), eyes on the face in the middle of a panel that fills the view: share of pixels that show the wall behind it, or nothing.",
            unit: "%",
            bound: f64::INFINITY,
            reason: "At 1 mm a sample is 1,300 px wide, footprints end at 32 px, and one looks through between them. More arithmetic would not help: the capture has no such detail.",
            measure: |seed| near_contact(seed, 1e-9),
        },
        Case {
            name: "how near panels stay closed",
            what: "The same panels, eyes from 4 cm to 2 mm away: the nearest distance from which more than 1 % of the frame shows what is behind.",
            unit: "cm",
            bound: 4.0,
            reason: "At 4 cm a sample is 32 px wide, half of the largest footprint; twice as near, footprints only just touch.",
            measure: |seed| {
                let is_open = |gap: &f64| near_contact(seed, *gap).is_none_or(|share| share > 1.0);
                Some(
                    [0.08, 0.06, 0.05, 0.04, 0.03, 0.02, 0.01, 0.004]
                        .iter()
                        .find(|gap| is_open(gap))
                        .map_or(0.0, |gap| gap * 50.0),
                )
            },
        },
        Case {
            name: "geometry 4 cm from the eye",
            what: "The same panels, eyes 4 cm away from them.",
            unit: "%",
            bound: 1.0,
            reason: "A sample is 32 px wide, half of the largest footprint: the panel is closed.",
            measure: |seed| near_contact(seed, 0.08),
        },
        Case {
            name: "headbox that geometry touches",
            what: "A headbox whose half-size reaches through the panels of the same scene by up to half: the capture must still be made, and say that it is blocked (0 = said).",
            unit: "",
            bound: 0.0,
            reason: "A user's mistake is reported, not hidden.",
            measure: |seed| {
                let scene = Arc::new(headbox_scenes::build("contact", 0)?);
                let half = case_rng(seed, 23).between(0.6, 0.75);
                let parameters = small_capture(8, 12);
                capture(Arc::clone(&scene), DVec3::ZERO, half, 16, parameters)?;
                let share = blocked_share(&Tracer::new(scene, DVec3::ZERO), half);
                Some(if share > 0.0 { 0.0 } else { 1.0 })
            },
        },
        Case {
            name: "camera file at 1e7 m",
            what: "A camera written as JSON and read back, its eye 1e7 m from the origin: shift of what is 2 m ahead.",
            unit: "px",
            bound: 2e-5,
            reason: "The look-at point lies a metre ahead, so that its direction keeps 1e7 m * 2^-52 = 2e-9 of its length; at f = 500 px that is 1e-6 px, eye and look-at point count twice.",
            measure: |seed| {
                let mut rng = case_rng(seed, 24);
                let eye = random_direction(&mut rng) * 1e7;
                let camera = look_along(eye, random_direction(&mut rng), 60.0, [640, 480]).ok()?;
                let frame = FileFrame::default();
                let up = camera.world_from_eye().y_axis;
                let mut record =
                    CameraRecord::new(camera.eye(), camera.forward(), up, 60.0, &frame);
                record.size = Some([640, 480]);
                let text = serde_json::to_string(&record).ok()?;
                let read: CameraRecord = serde_json::from_str(&text).ok()?;
                let back = read.camera(&frame).ok()?;
                largest([[0.5, 0.5], [320.0, 240.0], [639.5, 400.0]].map(|[x, y]| {
                    let [px, py, _] = back.project(camera.eye() + camera.direction(x, y) * 2.0)?;
                    Some((px - x).hypot(py - y))
                }))
            },
        },
    ]
}

/// Creates random stairs: returns the direction of their offset, and the left edge and height of
/// each step relative to the offset, metres.
fn stairs(seed: u64) -> (DVec3, Vec<(f64, f64)>) {
    let mut rng = case_rng(seed, 20);
    // Thousandths, which the decimals of the file represent exactly.
    let mut thousandth = |low: f64, high: f64| (rng.between(low, high) * 1e3).round() / 1e3;
    let direction = dvec3(
        thousandth(-1.0, 1.0),
        thousandth(-1.0, 1.0),
        thousandth(-1.0, 1.0),
    );
    let steps = (0..12)
        .map(|i| (f64::from(i) * 0.1 - 0.6, thousandth(-2.0, -1.0)))
        .collect();
    (direction, steps)
}

/// Traces a ray down from 1 m above the offset onto the middle of each step; returns the largest
/// error of a distance, metres.
fn distance_error(scene: Scene, offset: DVec3, stairs: &[(f64, f64)]) -> Option<f64> {
    let centre = offset + DVec3::Y;
    let tracer = Tracer::new(Arc::new(scene), centre);
    largest(stairs.iter().map(|&(left, height)| {
        let ray = Ray {
            origin: dvec3(left + 0.05, 0.0, 0.03).as_vec3(),
            direction: Vec3::NEG_Y,
            t_min: 0.0,
            t_max: f32::INFINITY,
        };
        Some((f64::from(tracer.closest(&ray)?.t) - (1.0 - height)).abs())
    }))
}

/// Measures stairs at an offset in the vertices of an OBJ file.
fn offset_in_obj(seed: u64, distance: f64) -> Option<f64> {
    let (direction, stairs) = stairs(seed);
    let offset = direction * distance;
    let mut text = String::new();
    for (left, height) in &stairs {
        for (x, z) in [(0.0, -0.2), (0.0, 0.2), (0.1, 0.2), (0.1, -0.2)] {
            writeln!(
                text,
                "v {:.6} {:.6} {:.6}",
                offset.x + left + x,
                offset.y + height,
                offset.z + z
            )
            .ok()?;
        }
        text += "f -4 -3 -2 -1\n";
    }
    distance_error(load_text("stairs.obj", &text)?, offset, &stairs)
}

/// Measures stairs at an offset in the nodes of a glTF file.
fn offset_in_nodes(seed: u64, distance: f64) -> Option<f64> {
    let (direction, stairs) = stairs(seed);
    let offset = direction * distance;
    let node = |(i, (left, height)): (usize, &(f64, f64))| {
        let [x, y, z] = [offset.x + left, offset.y + height, offset.z];
        if i % 2 == 0 {
            format!("{{\"mesh\":0,\"translation\":[{x:.6},{y:.6},{z:.6}]}}")
        } else {
            format!("{{\"mesh\":0,\"matrix\":[1,0,0,0,0,1,0,0,0,0,1,0,{x:.6},{y:.6},{z:.6},1]}}")
        }
    };
    let nodes: Vec<String> = stairs.iter().enumerate().map(node).collect();
    let all: Vec<String> = (0..nodes.len()).map(|i| i.to_string()).collect();
    let corners: [[f32; 3]; 4] = [
        [0.0, 0.0, -0.2],
        [0.0, 0.0, 0.2],
        [0.1, 0.0, 0.2],
        [0.1, 0.0, -0.2],
    ];
    let mut bytes: Vec<u8> = bytemuck::cast_slice(&corners).to_vec();
    bytes.extend(
        [0u16, 1, 2, 0, 2, 3]
            .iter()
            .flat_map(|index| index.to_le_bytes()),
    );
    let text = format!(
        "{{\"asset\":{{\"version\":\"2.0\"}},\"scene\":0,\"scenes\":[{{\"nodes\":[{}]}}],\"nodes\":[{}],\
         \"meshes\":[{{\"primitives\":[{{\"attributes\":{{\"POSITION\":0}},\"indices\":1}}]}}],\
         \"accessors\":[{{\"bufferView\":0,\"componentType\":5126,\"count\":4,\"type\":\"VEC3\"}},\
         {{\"bufferView\":1,\"componentType\":5123,\"count\":6,\"type\":\"SCALAR\"}}],\
         \"bufferViews\":[{{\"buffer\":0,\"byteLength\":48}},{{\"buffer\":0,\"byteOffset\":48,\"byteLength\":12}}],\
         \"buffers\":[{{\"byteLength\":60,\"uri\":\"data:application/octet-stream;base64,{}\"}}]}}",
        all.join(","),
        nodes.join(","),
        base64(&bytes),
    );
    distance_error(load_text("stairs.gltf", &text)?, offset, &stairs)
}

fn base64(bytes: &[u8]) -> String {
    const DIGITS: &[u8; 64] = b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    let mut text = String::new();
    for chunk in bytes.chunks(3) {
        let byte = |i: usize| u32::from(chunk.get(i).copied().unwrap_or(0));
        let group = byte(0) << 16 | byte(1) << 8 | byte(2);
        for digit in 0..4 {
            text.push(if digit <= chunk.len() {
                char::from(DIGITS[(group >> (18 - 6 * digit)) as usize & 63])
            } else {
                '='
            });
        }
    }
    text
}

/// Loads a scene from the text of a file.
fn load_text(name: &str, text: &str) -> Option<Scene> {
    let folder = tempfile::tempdir().ok()?;
    let path = folder.path().join(name);
    std::fs::write(&path, text).ok()?;
    let options = LoadOptions {
        up: Some(UpAxis::Y),
        unit_m: Some(1.0),
    };
    load(&path, &options).ok()
}

/// Compares the scene `bump` with the same scene scaled and moved; returns the root mean square
/// difference of frames, levels.
fn changed_by(seed: u64, scale: f64, offset: DVec3) -> Option<f64> {
    let mut rng = case_rng(seed, 22);
    let original = headbox_scenes::build("bump", 0)?;
    let headbox = original.headbox?;
    let place = |p: DVec3| p * scale + offset;
    let mut changed = original.clone();
    changed.positions.iter_mut().for_each(|p| *p = place(*p));
    let pairs = [
        (original, 1.0, headbox.centre),
        (changed, scale, place(headbox.centre)),
    ];
    let offset = rng.in_cube(0.9);
    let forward = (dvec3(0.0, 0.0, -1.0) + rng.in_cube(0.3)).normalize();
    let frames = pairs.map(|(scene, scale, centre)| {
        let half = headbox.half_size_m * scale;
        let parameters = small_capture(8, 12);
        let cube = pack(&capture(Arc::new(scene), centre, half, 40, parameters)?)?;
        let eye = centre + offset * half;
        // The target is at the scale of the scene.
        let target = eye + forward * half * 8.0;
        let camera = Camera::look_at(eye, target, DVec3::Y, 60.0, [64, 48]).ok()?;
        let frame = draw(&cube, &camera, &RenderSettings::default());
        // Two empty frames would be equal.
        let shown = frame
            .coverage
            .iter()
            .filter(|c| c.splat_share() > 0)
            .count();
        (2 * shown > frame.coverage.len()).then_some(frame)
    });
    let [a, b] = frames;
    Some(rms_levels(&a?, &b?))
}

/// Returns the largest share of pixels that show the wall behind a panel or a hole, percent, from
/// eyes at `gap` half-sizes from a face of the headbox.
fn near_contact(seed: u64, gap: f64) -> Option<f64> {
    let scene = Arc::new(headbox_scenes::build("contact", 0)?);
    let headbox = scene.headbox?;
    let parameters = small_capture(8, 12);
    let ldi = capture(scene, headbox.centre, headbox.half_size_m, 48, parameters)?;
    let cube = pack(&ldi)?;
    let mut rng = case_rng(seed, 25);
    largest((0..3).map(|_| {
        let axis = rng.below(3) as usize;
        let side = if rng.below(2) == 0 { -1.0 } else { 1.0 };
        let outward = DVec3::AXES[axis] * side;
        let (right, up) = (DVec3::AXES[(axis + 1) % 3], DVec3::AXES[(axis + 2) % 3]);
        // The middle of the panel, which covers a quarter of the face.
        let middle = (right * side - up) * 0.5 * headbox.half_size_m;
        let eye = headbox.centre + outward * headbox.half_size_m * (1.0 - gap) + middle;
        let camera = look_along(eye, outward, 60.0, [48, 36]).ok()?;
        let frame = draw(&cube, &camera, &RenderSettings::default());
        // The panel's greens and yellows have more red or green than blue, unlike the walls' greys
        // and blues.
        let through = |c: &&[u8; 4]| c[2] >= c[0] && c[2] >= c[1];
        Some(100.0 * frame.color.iter().filter(through).count() as f64 / frame.color.len() as f64)
    }))
}
