//! HTML pages: a capture and its WebGL 2 viewer in one file that works from disk; the data are
//! deflated.
//!
//! The viewer is the ES modules beside this file and those of the folder of what is shown (`cube`,
//! `house`, `lumigraph`, `sprite`), which are put into the page one after the other. Two of a kind
//! others build on: its `renderer.js`, and where the eye may be, `place.js` or, for what has a
//! headbox, `headbox.js`.

mod cube;
mod house;
mod lumigraph;
mod sprite;
mod texels;
mod text;

use super::{ExportError, poster};
use flate2::Compression;
use flate2::write::ZlibEncoder;
use headbox_core::camera::Camera;
use headbox_core::environment::Environment;
use headbox_cube::pack::CubeLdi;
use headbox_house::house::House;
use headbox_lumigraph::Lumigraph;
use headbox_sprite::SpriteSet;
use image::codecs::png::CompressionType;
use rayon::prelude::*;
use serde_json::{Value, json};
use std::io::{self, Write};

/// The modules of every viewer, each after those that it imports; those of what is shown are
/// between them.
const BEFORE: [&str; 7] = [
    include_str!("vectors.js"),
    include_str!("payload.js"),
    include_str!("camera.js"),
    include_str!("gl.js"),
    include_str!("glsl.js"),
    include_str!("surroundings.js"),
    include_str!("pictures.js"),
];
const AFTER: [&str; 4] = [
    include_str!("view.js"),
    include_str!("controls.js"),
    include_str!("headset.js"),
    include_str!("main.js"),
];
const TEMPLATE: &str = include_str!("page.html");
const STYLE: &str = include_str!("page.css");

/// The most bytes of a page: browsers keep its text in memory, next to what they unpack of it.
pub const MAX_PAGE_BYTES: u64 = 1 << 30;

/// A part of the data.
struct Part {
    /// Header of the part.
    header: Value,
    bytes: Vec<u8>,
}

/// A part as the page holds it.
struct PackedPart {
    header: Value,
    text: String,
}

/// Content of a page.
struct Content {
    /// Header that the viewer reads before the first part.
    header: Value,
    /// All data, in the order in which a view begins to need it.
    parts: Vec<Part>,
    /// A JPEG file of the first view.
    poster: Vec<u8>,
    /// The modules for what is of its kind, each after those that it imports.
    modules: &'static [&'static str],
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
    pub fn new(cube: &CubeLdi, name: &str) -> Result<Self, ExportError> {
        Self::of(cube::content(cube)?, name)
    }

    /// Makes a page to walk through a house, beginning with what a camera sees. It shows surfaces
    /// alone, no backdrops: what draws pages draws all of a home.
    ///
    /// # Errors
    /// [`ExportError::TooLarge`], or if there is no picture of it.
    pub fn of_house(house: &House, first: &Camera, name: &str) -> Result<Self, ExportError> {
        Self::of(house::content(house, first)?, name)
    }

    /// Makes a page of a layered lumigraph.
    ///
    /// # Errors
    /// [`ExportError::TooLarge`], or if there is no picture of it.
    pub fn of_lumigraph(lumigraph: &Lumigraph, name: &str) -> Result<Self, ExportError> {
        Self::of(lumigraph::content(lumigraph)?, name)
    }

    /// Makes a page of sprites with depth.
    ///
    /// # Errors
    /// [`ExportError::Empty`], [`ExportError::TooLarge`], or if there is no picture of it.
    pub fn of_sprites(set: &SpriteSet, name: &str) -> Result<Self, ExportError> {
        Self::of(sprite::content(set)?, name)
    }

    fn of(content: Content, name: &str) -> Result<Self, ExportError> {
        let Content {
            mut header,
            parts,
            poster,
            modules,
        } = content;
        let parts = parts
            .into_par_iter()
            .map(pack)
            .collect::<Result<Vec<_>, io::Error>>()?;
        let bytes = parts.iter().map(|part| part.text.len() as u64).sum();
        if bytes > MAX_PAGE_BYTES {
            return Err(ExportError::TooLarge {
                bytes,
                limit: MAX_PAGE_BYTES,
            });
        }
        header["name"] = name.into();
        header["parts"] = parts.iter().map(|part| part.header.clone()).collect();
        let title = escape(name);
        let before = TEMPLATE
            .replace("@TITLE@", &title)
            .replace("@STYLE@", STYLE)
            .replace("@POSTER@", &text::base64(&poster))
            .replace("@SCRIPT@", &script(modules))
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
            writeln!(
                to,
                "<script type=\"text/plain\" id=\"part-{i}\">{}</script>",
                part.text
            )?;
        }
        to.write_all(b"</body>\n</html>\n")
    }
}

/// The viewer as one module: imports and the word `export` are left out, as all stands in one
/// scope.
fn script(modules: &[&str]) -> String {
    let lines = BEFORE
        .iter()
        .chain(modules)
        .chain(&AFTER)
        .flat_map(|module| module.lines());
    let mut script = String::new();
    for line in lines.filter(|line| !line.starts_with("import ")) {
        script += line.strip_prefix("export ").unwrap_or(line);
        script.push('\n');
    }
    script
}

/// Text in HTML.
fn escape(text: &str) -> String {
    text.replace('&', "&amp;")
        .replace('<', "&lt;")
        .replace('>', "&gt;")
        .replace('"', "&quot;")
}

fn pack(part: Part) -> io::Result<PackedPart> {
    let mut deflate = ZlibEncoder::new(Vec::new(), Compression::best());
    deflate.write_all(&part.bytes)?;
    let packed = deflate.finish()?;
    let mut header = part.header;
    header["bytes"] = part.bytes.len().into();
    header["packed"] = packed.len().into();
    Ok(PackedPart {
        header,
        text: text::encode(&packed),
    })
}

/// Environment: red, green, blue and alpha in arrays of their own, each byte as the difference from
/// the one before.
fn environment(environment: &Environment) -> Part {
    let mut bytes = Vec::with_capacity(environment.texels.len() * 4);
    for channel in 0..4 {
        let mut before = 0u8;
        for texel in &environment.texels {
            bytes.push(texel[channel].wrapping_sub(before));
            before = texel[channel];
        }
    }
    Part {
        header: json!({"kind": "environment", "size": environment.size_px}),
        bytes,
    }
}

/// The smallest PNG file of some texels.
fn png(texels: &[[u8; 4]], size_px: [u32; 2]) -> Result<Vec<u8>, ExportError> {
    super::png(texels, size_px, CompressionType::Best)
}

#[cfg(test)]
mod tests {
    use super::*;
    use headbox_cube::pack::PlaneSet;
    use std::collections::HashSet;

    #[test]
    fn modules_share_one_scope_without_a_clash() {
        for modules in [
            cube::MODULES,
            house::MODULES,
            lumigraph::MODULES,
            sprite::MODULES,
        ] {
            one_scope_without_a_clash(&script(modules));
        }
    }

    fn one_scope_without_a_clash(script: &str) {
        let mut names = HashSet::new();
        for line in script.lines() {
            let declared = [
                "function ",
                "async function ",
                "async function* ",
                "class ",
                "const ",
                "let ",
            ];
            let Some(rest) = declared.iter().find_map(|word| line.strip_prefix(word)) else {
                continue;
            };
            for name in rest
                .trim_start_matches('[')
                .split([']', ' ', '('])
                .next()
                .unwrap_or("")
                .split(", ")
            {
                assert!(names.insert(name.to_owned()), "{name} is declared twice");
            }
        }
        assert!(names.len() > 40 && !script.contains("\nimport ") && !script.contains("\nexport "));
        assert!(!script.contains("</script") && !script.contains("<!--"));
    }

    #[test]
    fn empty_capture_is_refused() {
        let cube = CubeLdi {
            info: Default::default(),
            face_size_px: 8,
            layout: headbox_cube::pack::SplatIndexLayout::Normal,
            segments: Vec::new(),
            environment: Environment::default(),
            planes: PlaneSet::default(),
        };
        assert!(matches!(
            Page::new(&cube, "nothing"),
            Err(ExportError::Empty)
        ));
    }
}
