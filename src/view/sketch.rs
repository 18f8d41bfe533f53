//! What stands in for a file that takes seconds to read: of an OBJ some of its vertices, of a home its plan, of a folder of images one
//! of them.

use crate::capture::load::home_walls;
use crate::capture::picture;
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
        Some("obj") => points(&vertices(path)?),
        Some("xml" | "sh3d") => plan(&home_walls(path).ok()?),
        _ => None,
    }
}

/// The walls of a home from above; `None` if there are none.
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

/// Points seen from above at a slant; `None` if they are too few to tell anything.
fn points(vertices: &[DVec3]) -> Option<Thumbnail> {
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
    // Nothing is known yet of what is up: scenes are mostly wider than they are high.
    let up = if extent.z < extent.y { DVec3::Z } else { DVec3::Y };
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
        let lit = picture.pixels.iter().filter(|pixel| **pixel != BACKGROUND).count();
        assert_eq!(picture.pixels.len(), (SIZE[0] * SIZE[1]) as usize);
        assert!(lit > 1_000, "{lit}");
        std::fs::write(file("short.obj"), "v 0 0 0\n").expect("written");
        assert_eq!(sketch(&file("short.obj")), None);
        assert_eq!(sketch(&file("absent.glb")), None);
        let home = r#"<home wallHeight="250"><wall xStart="0" yStart="0" xEnd="500" yEnd="0" height="250" thickness="10"/>
            <wall xStart="500" yStart="0" xEnd="500" yEnd="300" height="250" thickness="10"/></home>"#;
        std::fs::write(file("Home.xml"), home).expect("written");
        let picture = sketch(&file("Home.xml")).expect("a plan");
        let lit = picture.pixels.iter().filter(|pixel| **pixel != BACKGROUND).count();
        // Two walls, each two pixels wide, that fill 88 % of the height.
        let expected = 2.0 * 0.88 * f64::from(SIZE[1]) * (1.0 + 500.0 / 300.0);
        assert!((lit as f64 / expected - 1.0).abs() < 0.05, "{lit} of {expected}");

        std::fs::create_dir(file("images")).expect("made");
        assert_eq!(sketch(folder.path()), None, "no picture");
        let red = image::RgbImage::from_pixel(8, 6, image::Rgb([200, 0, 0]));
        red.save(file("images/b.png")).expect("saved");
        image::RgbImage::new(8, 6).save(file("images/a_depth.png")).expect("saved");
        let picture = sketch(folder.path()).expect("the picture below");
        assert!(picture.pixels.iter().all(|pixel| pixel[0] > 190 && pixel[1] < 10), "not the depth");
    }
}
