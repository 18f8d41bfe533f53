//! A capture as one HTML page that works from disk: the data, deflated, and a viewer in WebGL 2.
//!
//! The viewer is the ES modules beside this file, which are put into the page one after the other. It draws by the rules of
//! [`crate::render::surface`], whose numbers travel in the page's header, so that its frames are held to the CPU's.

mod samples;
mod texels;
mod text;

use super::{ExportError, poster};
use crate::capture::rig::Face;
use crate::environment::Environment;
use crate::ldi::accumulate::DepthBins;
use crate::packed::splat_index::SPLAT_INDEX_COUNT;
use crate::packed::{PackedCube, PlaneSet};
use crate::render::{rules, surface};
use flate2::Compression;
use flate2::write::ZlibEncoder;
use rayon::prelude::*;
use serde_json::{Value, json};
use std::io::{self, Write};

/// The modules of the viewer, each after those that it imports.
const MODULES: [&str; 11] = [
    include_str!("vectors.js"),
    include_str!("payload.js"),
    include_str!("samples.js"),
    include_str!("planes.js"),
    include_str!("camera.js"),
    include_str!("view.js"),
    include_str!("gl.js"),
    SHADERS,
    include_str!("renderer.js"),
    include_str!("controls.js"),
    include_str!("headset.js"),
];
const SHADERS: &str = include_str!("shaders.js");
const MAIN: &str = include_str!("main.js");
const TEMPLATE: &str = include_str!("page.html");
const STYLE: &str = include_str!("page.css");

/// The most bytes of a page: browsers keep its text in memory, next to what they unpack of it.
pub const MAX_PAGE_BYTES: u64 = 1 << 30;

/// A part of the data.
struct Part {
    /// What the header says of it.
    header: Value,
    bytes: Vec<u8>,
}

/// A part as the page holds it.
struct PackedPart {
    header: Value,
    text: String,
}

/// The text of a page.
pub struct Page {
    before: String,
    parts: Vec<PackedPart>,
}

impl Page {
    /// Makes a page of a cube LDI; `name` is its title.
    ///
    /// # Errors
    /// [`ExportError::Empty`], [`ExportError::TooLarge`].
    pub fn new(cube: &PackedCube, name: &str) -> Result<Self, ExportError> {
        if cube.depth_pixel_count() == 0 && cube.planes.tiles.is_empty() && cube.environment.size_px == 0 {
            return Err(ExportError::Empty);
        }
        let at_least = cube.bytes() as u64 / 4;
        if at_least > MAX_PAGE_BYTES {
            return Err(ExportError::TooLarge { bytes: at_least, limit: MAX_PAGE_BYTES });
        }
        let parts = parts(cube).into_par_iter().map(pack).collect::<Result<Vec<_>, io::Error>>()?;
        let bytes = parts.iter().map(|part| part.text.len() as u64).sum();
        if bytes > MAX_PAGE_BYTES {
            return Err(ExportError::TooLarge { bytes, limit: MAX_PAGE_BYTES });
        }
        let header = header(cube, name, parts.iter().map(|part| part.header.clone()).collect());
        let title = escape(name);
        let before = TEMPLATE
            .replace("@TITLE@", &title)
            .replace("@STYLE@", STYLE)
            .replace("@POSTER@", &text::base64(&poster(cube)?))
            .replace("@SCRIPT@", &script())
            .replace("@HEADER@", &header.to_string().replace('<', "\\u003c"));
        Ok(Self { before, parts })
    }

    /// Writes it.
    ///
    /// # Errors
    /// What writing reports.
    pub fn write(&self, to: &mut dyn Write) -> io::Result<()> {
        to.write_all(self.before.as_bytes())?;
        for (i, part) in self.parts.iter().enumerate() {
            writeln!(to, "<script type=\"text/plain\" id=\"part-{i}\">{}</script>", part.text)?;
        }
        to.write_all(b"</body>\n</html>\n")
    }
}

/// The viewer as one module: imports and the word `export` are left out, as all stands in one scope.
fn script() -> String {
    let modules = MODULES.iter().chain([&MAIN]);
    let lines = modules.flat_map(|module| module.lines()).filter(|line| !line.starts_with("import "));
    let mut script = String::new();
    for line in lines {
        script += line.strip_prefix("export ").unwrap_or(line);
        script.push('\n');
    }
    // What `import * as shaders` names.
    let names: Vec<&str> =
        SHADERS.lines().filter_map(|line| line.strip_prefix("export const ")?.split(' ').next()).collect();
    script.replacen("class Renderer", &format!("const shaders = {{ {} }};\nclass Renderer", names.join(", ")), 1)
}

/// Text in HTML.
pub(crate) fn escape(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}

fn pack(part: Part) -> io::Result<PackedPart> {
    let mut deflate = ZlibEncoder::new(Vec::new(), Compression::best());
    deflate.write_all(&part.bytes)?;
    let packed = deflate.finish()?;
    let mut header = part.header;
    header["bytes"] = part.bytes.len().into();
    header["packed"] = packed.len().into();
    Ok(PackedPart { header, text: text::encode(&packed) })
}

fn header(cube: &PackedCube, name: &str, parts: Vec<Value>) -> Value {
    let info = &cube.info;
    let face_px = f64::from(cube.face_size_px);
    let faces = Face::ALL.map(|face| json!({"right": face.right(), "up": face.up(), "normal": face.normal()}));
    let segments: Vec<Value> = cube.segments.iter().map(|segment| {
        json!({"face": segment.face.index(), "min": segment.inverse_depth(0), "step": segment.inverse_depth_step()})
    }).collect();
    json!({
        "name": name,
        "centre": info.centre,
        "halfSize": info.half_size_m,
        "frame": {"unit": info.frame.unit_m, "zUp": bool::from(info.frame.up)},
        "ahead": ahead(cube),
        "facePx": cube.face_size_px,
        "blockPx": samples::BLOCK_PX,
        "samples": cube.depth_pixel_count(),
        "faces": faces,
        "segments": segments,
        "rules": {
            "pixel": 2.0 / face_px,
            "tolerance": surface::SurfaceCanvas::tolerance(cube.face_size_px),
            "bin": DepthBins::new(info.half_size_m, cube.face_size_px).inverse_depth(1.0),
            "maxSlope": rules::MAX_SLOPE,
            "minRadius": rules::MIN_RADIUS_PX,
            "maxRadius": rules::MAX_RADIUS_PX,
            "minPeak": rules::MIN_PEAK,
            "wNear": rules::W_NEAR,
            "steps": rules::WEIGHT_STEPS,
            "opaque": rules::OPAQUE_WEIGHT,
            "minShare": rules::MIN_SHARE,
        },
        "parts": parts,
    })
}

/// Where the view looks at first.
fn ahead(cube: &PackedCube) -> glam::DVec3 {
    cube.info.ahead.unwrap_or(glam::DVec3::NEG_Z)
}

/// All data, in the order in which a view begins to need it.
fn parts(cube: &PackedCube) -> Vec<Part> {
    let mut parts = vec![normals(cube)];
    parts.extend((cube.environment.size_px > 0).then(|| environment(&cube.environment)));
    parts.extend((!cube.planes.tiles.is_empty()).then(|| planes(&cube.planes)));
    let mut segments: Vec<usize> = (0..cube.segments.len()).collect();
    let toward = |i: &usize| cube.segments[*i].face.normal().dot(ahead(cube));
    segments.sort_by(|a, b| toward(b).total_cmp(&toward(a)));
    for i in segments {
        for part in samples::parts(&cube.segments[i]) {
            let header = json!({
                "kind": "samples", "segment": i, "blocks": part.blocks, "samples": part.samples, "ahead": toward(&i) > 0.5,
            });
            parts.push(Part { header, bytes: part.bytes });
        }
    }
    parts
}

/// The normals that splat indices stand for, in the face's frame, as 16-bit integers of 1/32767.
fn normals(cube: &PackedCube) -> Part {
    let normals = (0..SPLAT_INDEX_COUNT as u32).flat_map(|index| cube.layout.normal(index).to_array());
    let bytes = normals.flat_map(|c| ((c * 32767.0).round() as i16).to_le_bytes()).collect();
    Part { header: json!({"kind": "normals"}), bytes }
}

/// Red, green, blue and alpha in arrays of their own, each byte less the one before.
fn environment(environment: &Environment) -> Part {
    let mut bytes = Vec::with_capacity(environment.texels.len() * 4);
    for channel in 0..4 {
        let mut before = 0u8;
        for texel in &environment.texels {
            bytes.push(texel[channel].wrapping_sub(before));
            before = texel[channel];
        }
    }
    Part { header: json!({"kind": "environment", "size": environment.size_px}), bytes }
}

/// Planes and pictures as they lie in memory, and the rests of their texels.
fn planes(set: &PlaneSet) -> Part {
    let mut bytes = bytemuck::cast_slice(&set.planes).to_vec();
    bytes.extend_from_slice(bytemuck::cast_slice(&set.tiles));
    bytes.extend(texels::rests(set));
    let header = json!({
        "kind": "planes", "planes": set.planes.len(), "tiles": set.tiles.len(), "texels": set.texels.len(),
    });
    Part { header, bytes }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::HashSet;

    #[test]
    fn modules_share_one_scope_without_a_clash() {
        let script = script();
        let mut names = HashSet::new();
        for line in script.lines() {
            let declared = ["function ", "async function ", "async function* ", "class ", "const ", "let "];
            let Some(rest) = declared.iter().find_map(|word| line.strip_prefix(word)) else { continue };
            for name in rest.trim_start_matches('[').split([']', ' ', '(']).next().unwrap_or("").split(", ") {
                assert!(names.insert(name.to_owned()), "{name} is declared twice");
            }
        }
        assert!(names.len() > 40 && !script.contains("\nimport ") && !script.contains("\nexport "));
        assert!(!script.contains("</script") && !script.contains("<!--"));
    }

    #[test]
    fn an_empty_capture_is_no_page() {
        let cube = PackedCube {
            info: Default::default(),
            face_size_px: 8,
            layout: crate::packed::SplatIndexLayout::Normal,
            segments: Vec::new(),
            environment: Environment::default(),
            planes: PlaneSet::default(),
        };
        assert!(matches!(Page::new(&cube, "nothing"), Err(ExportError::Empty)));
    }
}
