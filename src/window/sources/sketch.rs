//! What stands in for a file that takes seconds to read: of an OBJ some of its vertices, of a glTF the boxes about its meshes, of a home or
//! house its plan, of a folder of images one of them.

use headbox_core::container::HOMES;
use headbox_model::load::home_lines;
use headbox_scene::load::gltf_boxes;
use headbox_core::image_file as picture;
use headbox_house::file::outlines;
use glam::{DVec2, DVec3, dvec2, dvec3};
use headbox_viewer::Thumbnail;
use std::fs::File;
use std::io::{Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};

/// Size of a sketch, pixels.
const SIZE: [u32; 2] = [640, 400];
/// Places of a file that are looked into for a vertex, and how far.
const PLACES: u64 = 20_000;
const REACH_BYTES: usize = 512;
/// Vertices outside of this share at each end of an axis do not decide what is shown.
const OUTLYING: f64 = 0.01;
/// Share of a plan's picture that is left free at each side.
const MARGIN: f64 = 0.06;
/// Behind the points, as the window is, and the points, from far to near.
const BACKGROUND: [u8; 4] = [16, 16, 16, 255];
const FAR: f64 = 70.0;
const NEAR: f64 = 210.0;
/// What a folder's depth is called; of pictures with other names one is shown.
const DEPTH_NAMES: [&str; 3] = ["depth", "disp", "mask"];

/// A picture of what a file holds, of what can be seen without reading all of it; `None` where there is nothing such.
pub fn sketch(path: &Path) -> Option<Thumbnail> {
    let extension = path.extension().map(|extension| extension.to_string_lossy().to_lowercase());
    match extension.as_deref() {
        _ if path.is_dir() => photograph(path),
        Some("obj") => points(&vertices(path)?, None),
        Some("gltf" | "glb") => points(&edges(&gltf_boxes(path)?), Some(DVec3::Y)),
        Some("house") => plan(&outlines(path).ok()?),
        Some(extension) if HOMES.contains(&extension) => plan(&home_lines(path).ok()?),
        _ => None,
    }
}

/// The walls of a home, or the outlines of its rooms, from above; `None` if there are none.
fn plan(walls: &[[DVec2; 2]]) -> Option<Thumbnail> {
    let low = walls.iter().flatten().copied().reduce(DVec2::min)?;
    let high = walls.iter().flatten().copied().reduce(DVec2::max)?;
    let size = dvec2(f64::from(SIZE[0]), f64::from(SIZE[1]));
    let extent = (high - low).max(DVec2::splat(f64::MIN_POSITIVE));
    let scale = (size * (1.0 - 2.0 * MARGIN) / extent).min_element();
    let mut pixels = vec![BACKGROUND; (SIZE[0] * SIZE[1]) as usize];
    for [start, end] in walls.iter().map(|wall| wall.map(|end| (end - (low + high) / 2.0) * scale + size / 2.0)) {
        // Half a pixel apart; what is not finite makes no steps.
        let steps = (start.distance(end) * 2.0).min(size.length() * 2.0) as u32;
        for step in 0..=steps {
            let at = start.lerp(end, f64::from(step) / f64::from(steps.max(1)));
            dot(&mut pixels, at, NEAR as u8);
        }
    }
    Some(Thumbnail { width: SIZE[0], height: SIZE[1], pixels })
}

/// A point two pixels wide and high: one alone is hardly seen. Of two the brighter remains.
fn dot(pixels: &mut [[u8; 4]], at: DVec2, grey: u8) {
    if !(0.0..f64::from(SIZE[0] - 1)).contains(&at.x) || !(0.0..f64::from(SIZE[1] - 1)).contains(&at.y) {
        return;
    }
    for (right, down) in [(0, 0), (1, 0), (0, 1), (1, 1)] {
        let pixel = &mut pixels[((at.y as u32 + down) * SIZE[0] + at.x as u32 + right) as usize];
        let grey = grey.max(pixel[0]);
        *pixel = [grey, grey, grey, 255];
    }
}

/// Vertices from all over an OBJ.
fn vertices(path: &Path) -> Option<Vec<DVec3>> {
    let mut file = File::open(path).ok()?;
    let length = file.metadata().ok()?.len();
    let mut bytes = [0; REACH_BYTES];
    let mut found = Vec::new();
    for place in 0..PLACES.min(length / REACH_BYTES as u64) {
        file.seek(SeekFrom::Start(length / PLACES.min(length / REACH_BYTES as u64) * place)).ok()?;
        let read = file.read(&mut bytes).ok()?;
        let text = String::from_utf8_lossy(&bytes[..read]);
        // The first line is whole only by chance, and so is the last.
        let whole = text.split('\n').skip(1).take(text.matches('\n').count().saturating_sub(1));
        found.extend(whole.filter_map(vertex).next());
    }
    Some(found)
}

fn vertex(line: &str) -> Option<DVec3> {
    let mut numbers = line.trim().strip_prefix("v ")?.split_whitespace().map(str::parse);
    let mut next = || numbers.next()?.ok();
    Some(dvec3(next()?, next()?, next()?)).filter(|place| place.is_finite())
}

/// Points along the edges of boxes, evenly dealt out: corner `i` of a box lies at the far end of axis `k` where bit `k` of `i` is set.
fn edges(boxes: &[[DVec3; 8]]) -> Vec<DVec3> {
    const MOST_ON_EDGE: usize = 400;
    const AXES: [usize; 3] = [1, 2, 4];
    let on_edge = (PLACES as usize / (12 * boxes.len().max(1))).clamp(2, MOST_ON_EDGE);
    let of_box = |corners: &[DVec3; 8]| {
        let ends = AXES
            .iter()
            .flat_map(|&axis| (0..8).filter(move |near| near & axis == 0).map(move |near| [near, near | axis]));
        let ends: Vec<[DVec3; 2]> = ends.map(|ends| ends.map(|corner| corners[corner])).collect();
        let along = move |[near, far]: [DVec3; 2]| {
            (0..on_edge).map(move |step| near.lerp(far, step as f64 / (on_edge - 1) as f64))
        };
        ends.into_iter().flat_map(along)
    };
    boxes.iter().flat_map(of_box).filter(|place| place.is_finite()).collect()
}

/// Points seen from above at a slant, and from where `up` is up if that is known; `None` if they are too few to tell anything.
fn points(vertices: &[DVec3], up: Option<DVec3>) -> Option<Thumbnail> {
    const FEWEST: usize = 100;
    if vertices.len() < FEWEST {
        return None;
    }
    let end = |axis: usize, share: f64| {
        let mut values: Vec<f64> = vertices.iter().map(|place| place[axis]).collect();
        values.sort_by(f64::total_cmp);
        values[((values.len() - 1) as f64 * share) as usize]
    };
    let low = DVec3::from_array([0, 1, 2].map(|axis| end(axis, OUTLYING)));
    let high = DVec3::from_array([0, 1, 2].map(|axis| end(axis, 1.0 - OUTLYING)));
    let (middle, extent) = ((low + high) / 2.0, high - low);
    // Of an OBJ nothing is known yet of what is up: scenes are mostly wider than they are high.
    let up = up.unwrap_or(if extent.z < extent.y { DVec3::Z } else { DVec3::Y });
    let ahead = (DVec3::NEG_X + DVec3::NEG_Y + DVec3::NEG_Z + up * 0.2).normalize();
    let right = ahead.cross(up).normalize();
    let above = right.cross(ahead);
    let scale = f64::from(SIZE[1]) / extent.length().max(f64::MIN_POSITIVE);
    let mut pixels = vec![BACKGROUND; (SIZE[0] * SIZE[1]) as usize];
    for place in vertices {
        let from_middle = *place - middle;
        let at = [from_middle.dot(right), -from_middle.dot(above)].map(|length| length * scale);
        let at = DVec2::from(at) + dvec2(f64::from(SIZE[0]), f64::from(SIZE[1])) / 2.0;
        let nearness = (0.5 - from_middle.dot(ahead) / extent.length()).clamp(0.0, 1.0);
        dot(&mut pixels, at, (FAR + (NEAR - FAR) * nearness) as u8);
    }
    Some(Thumbnail { width: SIZE[0], height: SIZE[1], pixels })
}

/// One of the pictures of a folder, as small as a sketch.
fn photograph(folder: &Path) -> Option<Thumbnail> {
    let image = picture::read(&first_picture(folder, 2)?, picture::MAX_BYTES).ok()?;
    let image = image.thumbnail(SIZE[0], SIZE[1]).to_rgba8();
    let pixels = image.pixels().map(|pixel| [pixel.0[0], pixel.0[1], pixel.0[2], 255]).collect();
    Some(Thumbnail { width: image.width(), height: image.height(), pixels })
}

/// The first picture by name in a folder or, so many deep, below it.
fn first_picture(folder: &Path, deep: u32) -> Option<PathBuf> {
    let mut paths: Vec<PathBuf> =
        std::fs::read_dir(folder).ok()?.filter_map(|entry| Some(entry.ok()?.path())).collect();
    paths.sort();
    let is_picture = |path: &&PathBuf| {
        let name = path.file_name().unwrap_or_default().to_string_lossy().to_lowercase();
        let extension = name.rsplit_once('.').map_or("", |(_, extension)| extension);
        ["jpg", "jpeg", "png", "webp"].contains(&extension) && !DEPTH_NAMES.iter().any(|depth| name.contains(depth))
    };
    let here = paths.iter().find(is_picture).cloned();
    let below = || paths.iter().filter(|path| deep > 0 && path.is_dir()).find_map(|path| first_picture(path, deep - 1));
    here.or_else(below)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::fmt::Write;

    #[test]
    fn an_obj_is_points_and_a_folder_one_of_its_pictures() {
        let folder = tempfile::tempdir().expect("a folder");
        let file = |name: &str| folder.path().join(name);
        let mut text = String::from("# a slab\n");
        for i in 0..40_000 {
            writeln!(text, "v {} {} {}", i % 200, 0.01 * f64::from(i % 7), i / 200).expect("text");
        }
        std::fs::write(file("slab.obj"), &text).expect("written");
        let picture = sketch(&file("slab.obj")).expect("points");
        let lit_of = |picture: &Thumbnail| picture.pixels.iter().filter(|pixel| **pixel != BACKGROUND).count();
        let lit = lit_of(&picture);
        assert_eq!(picture.pixels.len(), (SIZE[0] * SIZE[1]) as usize);
        assert!(lit > 1_000, "{lit}");
        std::fs::write(file("short.obj"), "v 0 0 0\n").expect("written");
        assert_eq!(sketch(&file("short.obj")), None);
        assert_eq!(sketch(&file("absent.glb")), None);
        let home = r#"<home wallHeight="250"><wall xStart="0" yStart="0" xEnd="500" yEnd="0" height="250" thickness="10"/>
            <wall xStart="500" yStart="0" xEnd="500" yEnd="300" height="250" thickness="10"/></home>"#;
        std::fs::write(file("Home.xml"), home).expect("written");
        let lit = lit_of(&sketch(&file("Home.xml")).expect("a plan"));
        // Two walls, each two pixels wide, that fill 88 % of the height.
        let expected = 2.0 * 0.88 * f64::from(SIZE[1]) * (1.0 + 500.0 / 300.0);
        assert!((lit as f64 / expected - 1.0).abs() < 0.05, "{lit} of {expected}");

        let toml = "scene = \"none.obj\"\nup = \"z\"\n[[cell]]\nname = \"hall\"\n[[cell.prism]]\n\
            outline = [[0, 0], [500, 0], [500, 300], [0, 300]]\nfloor = 0\nceiling = 250\n";
        std::fs::write(file("home.toml"), toml).expect("written");
        let lit = lit_of(&sketch(&file("home.toml")).expect("a plan, though its scene is not there"));
        assert!((lit as f64 / (2.0 * expected) - 1.0).abs() < 0.05, "a whole rectangle: {lit} of {}", 2.0 * expected);

        std::fs::create_dir(file("images")).expect("made");
        assert_eq!(sketch(folder.path()), None, "no picture");
        let red = image::RgbImage::from_pixel(8, 6, image::Rgb([200, 0, 0]));
        red.save(file("images/b.png")).expect("saved");
        image::RgbImage::new(8, 6).save(file("images/a_depth.png")).expect("saved");
        let picture = sketch(folder.path()).expect("the picture below");
        assert!(picture.pixels.iter().all(|pixel| pixel[0] > 190 && pixel[1] < 10), "not the depth");
    }
    #[test]
    fn a_glb_is_the_boxes_of_its_meshes_where_its_nodes_stand_and_a_house_its_plan() {
        let folder = tempfile::tempdir().expect("a folder");
        let file = |name: &str| folder.path().join(name);
        let scene = headbox_ldi::scene_source::SceneSource::new("builtin:interior").open().expect("a scene");
        for saved in headbox_scene::save::scene_files(&scene, &file("room.glb")).expect("saved") {
            std::fs::write(saved.path, saved.bytes).expect("written");
        }
        let boxes = gltf_boxes(&file("room.glb")).expect("boxes");
        let ends = |corners: &mut dyn Iterator<Item = DVec3>| {
            corners.fold([DVec3::INFINITY, DVec3::NEG_INFINITY], |[low, high], at| [low.min(at), high.max(at)])
        };
        let [found, bounds] = [ends(&mut boxes.iter().flatten().copied()), scene.bounds()];
        let off = [0, 1].map(|i| found[i].distance(bounds[i]));
        assert!(off.iter().all(|off| *off < 1e-3), "{found:?}, not {bounds:?}");
        assert!(sketch(&file("room.glb")).is_some());
        // Neither needs what follows its JSON.
        let bytes = std::fs::read(file("room.glb")).expect("read");
        let json_end = 20 + u32::from_le_bytes([bytes[12], bytes[13], bytes[14], bytes[15]]) as usize;
        std::fs::write(file("begun.glb"), &bytes[..json_end]).expect("written");
        assert_eq!(gltf_boxes(&file("begun.glb")).expect("boxes").len(), boxes.len());
        std::fs::write(file("cut.glb"), &bytes[..json_end / 2]).expect("written");
        assert_eq!(gltf_boxes(&file("cut.glb")), None);
        let mut model = headbox_scenes::house(0, 2_000);
        model.mend();
        let rooms = model.cells.iter().filter(|cell| !cell.space.is_empty()).count();
        let house = headbox_house::house::House::new(model).expect("a house");
        let store = headbox_house::store::Store::new(1 << 20);
        headbox_house::file::write(&file("a.house"), &house, &store, &Default::default()).expect("written");
        let lines = outlines(&file("a.house")).expect("a plan");
        assert!(lines.len() >= 4 * rooms && rooms > 10, "{} sides of {rooms} rooms", lines.len());
        assert!(sketch(&file("a.house")).is_some());
        let unit = [0, 1, 2, 3, 4, 5, 6, 7].map(|i| dvec3(f64::from(i & 1), f64::from(i >> 1 & 1), f64::from(i >> 2)));
        let on_edges = edges(&[unit]);
        assert!(on_edges.iter().all(|at| at.to_array().iter().filter(|c| **c == 0.0 || **c == 1.0).count() >= 2));
        assert_eq!(on_edges.len(), 12 * 400);
    }
}
