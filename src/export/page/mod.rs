//! HTML pages: a capture with deflated data and its WebGL 2 viewer in one file that works from
//! disk.
//!
//! The viewer consists of the ES modules in this folder and in the folder of the representation
//! (`cube`, `house`, `lumigraph`, `sprite`), which are concatenated in the page. Every
//! representation provides a `renderer.js`, and the rule for valid eye positions: `place.js` or,
//! with a headbox, `headbox.js`.
//!
//! A page says so if it is damaged or was cut: `watchdog.js` is a script of its own that comes
//! before all else. It knows the number of bytes of the data, and checks that the page has an end
//! and that the viewer starts and goes on. The viewer verifies a CRC-32 of the header and of each
//! part.

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
use headbox_core::progress::Progress;
use headbox_cube::pack::CubeLdi;
use headbox_house::house::House;
use headbox_lumigraph::Lumigraph;
use headbox_sprite::SpriteSet;
use image::codecs::png::CompressionType;
use rayon::prelude::*;
use serde_json::{Value, json};
use sha2::{Digest, Sha256};
use std::io::{self, Write};

/// Modules of every viewer, each after those that it imports; those of the representation are
/// between the two lists.
const FIRST_MODULES: [&str; 7] = [
    include_str!("vectors.js"),
    include_str!("payload.js"),
    include_str!("camera.js"),
    include_str!("gl.js"),
    include_str!("glsl.js"),
    include_str!("surroundings.js"),
    include_str!("pictures.js"),
];
const LAST_MODULES: [&str; 4] = [
    include_str!("view.js"),
    include_str!("controls.js"),
    include_str!("headset.js"),
    include_str!("main.js"),
];
/// Script that runs before everything else of the page.
const WATCHDOG: &str = include_str!("watchdog.js");
const TEMPLATE: &str = include_str!("page.html");
const STYLE: &str = include_str!("page.css");

/// Maximum size of a page, bytes: browsers keep its text in memory, next to the unpacked data.
pub const MAX_PAGE_BYTES: u64 = 1 << 30;

/// Part of the data.
struct Part {
    header: Value,
    bytes: Vec<u8>,
}

/// Part as text of the page.
struct PackedPart {
    header: Value,
    text: String,
}

/// Content of a page.
struct Content {
    /// Header that the viewer reads before the first part.
    header: Value,
    /// All data, in the order in which a view needs them.
    parts: Vec<Part>,
    /// JPEG file of the first view.
    poster: Vec<u8>,
    /// Modules of the representation, each after those that it imports.
    modules: &'static [&'static str],
}

/// Text of a page.
pub struct Page {
    before: String,
    parts: Vec<PackedPart>,
}

impl Page {
    /// Makes a page of a cube LDI; `name` is its title.
    ///
    /// # Errors
    /// [`ExportError::Empty`], [`ExportError::TooLarge`].
    pub fn new(cube: &CubeLdi, name: &str, progress: &dyn Progress) -> Result<Self, ExportError> {
        Self::from_content(cube::content(cube)?, name, progress)
    }

    /// Makes a page of a house that starts with a camera's view. It draws all surfaces and no
    /// backdrops, as GPUs can.
    ///
    /// # Errors
    /// [`ExportError::TooLarge`], or if the poster cannot be rendered.
    pub fn from_house(
        house: &House,
        first: &Camera,
        name: &str,
        progress: &dyn Progress,
    ) -> Result<Self, ExportError> {
        Self::from_content(house::content(house, first)?, name, progress)
    }

    /// Makes a page of a layered lumigraph.
    ///
    /// # Errors
    /// [`ExportError::TooLarge`], or if the poster cannot be rendered.
    pub fn from_lumigraph(
        lumigraph: &Lumigraph,
        name: &str,
        progress: &dyn Progress,
    ) -> Result<Self, ExportError> {
        Self::from_content(lumigraph::content(lumigraph)?, name, progress)
    }

    /// Makes a page of sprites with depth.
    ///
    /// # Errors
    /// [`ExportError::Empty`], [`ExportError::TooLarge`], or if the poster cannot be rendered.
    pub fn from_sprites(
        set: &SpriteSet,
        name: &str,
        progress: &dyn Progress,
    ) -> Result<Self, ExportError> {
        Self::from_content(sprite::content(set)?, name, progress)
    }

    fn from_content(
        content: Content,
        name: &str,
        progress: &dyn Progress,
    ) -> Result<Self, ExportError> {
        let mut header = content.header;
        let bytes = content.parts.iter().map(|part| part.bytes.len() as u64);
        progress.begin("compressing", "bytes", bytes.sum());
        let pack_part = |part: Part| {
            let bytes = part.bytes.len() as u64;
            let packed = pack(part);
            progress.advance(bytes);
            packed
        };
        let parts = content
            .parts
            .into_par_iter()
            .map(pack_part)
            .collect::<Result<Vec<_>, io::Error>>()?;
        let text_bytes = parts.iter().map(|part| part.text.len() as u64).sum();
        check_size(text_bytes)?;
        header["name"] = name.into();
        header["parts"] = parts.iter().map(|part| part.header.clone()).collect();
        let script = script(content.modules);
        let policy = format!(
            "default-src 'none'; img-src data:; style-src {}; script-src {} {}",
            policy_source(STYLE),
            policy_source(WATCHDOG),
            policy_source(&script)
        );
        let header = header.to_string().replace('<', "\\u003c");
        let slots = [
            ("POLICY", policy),
            ("BYTES", text_bytes.to_string()),
            ("WATCHDOG", WATCHDOG.into()),
            ("TITLE", escape(name)),
            ("STYLE", STYLE.into()),
            ("POSTER", text::base64(&content.poster)),
            ("SCRIPT", script),
            ("CRC32", crc32fast::hash(header.as_bytes()).to_string()),
            ("HEADER", header),
        ];
        Ok(Self {
            before: fill(TEMPLATE, &slots),
            parts,
        })
    }

    /// Writes the page.
    ///
    /// # Errors
    /// Errors of writing.
    pub fn write(&self, to: &mut dyn Write) -> io::Result<()> {
        to.write_all(self.before.as_bytes())?;
        for (i, part) in self.parts.iter().enumerate() {
            writeln!(
                to,
                "<script type=\"text/plain\" id=\"part-{i}\">{}</script>",
                part.text
            )?;
        }
        to.write_all(b"<p id=\"end\" hidden></p>\n</body>\n</html>\n")
    }
}

/// Rejects a page of at least `bytes` bytes that is too large.
fn check_size(bytes: u64) -> Result<(), ExportError> {
    if bytes > MAX_PAGE_BYTES {
        return Err(ExportError::TooLarge {
            bytes,
            limit: MAX_PAGE_BYTES,
        });
    }
    Ok(())
}

/// Concatenates the viewer to one module: drops imports and the word `export`, as all modules share
/// one scope.
fn script(modules: &[&str]) -> String {
    let lines = FIRST_MODULES
        .iter()
        .chain(modules)
        .chain(&LAST_MODULES)
        .flat_map(|module| module.lines());
    let mut script = String::new();
    for line in lines.filter(|line| !line.starts_with("import ")) {
        script += line.strip_prefix("export ").unwrap_or(line);
        script.push('\n');
    }
    script
}

/// Fills the slots of a template, `@NAME@`, in one pass: a value that contains the name of a slot
/// stays as it is. Values must be escaped for their place.
fn fill(template: &str, slots: &[(&str, String)]) -> String {
    let mut page = String::new();
    for (i, part) in template.split('@').enumerate() {
        let slot = slots.iter().find(|(name, _)| i % 2 == 1 && *name == part);
        page += slot.map_or(part, |(_, value)| value);
    }
    page
}

/// Returns the source of a Content-Security-Policy that allows an inline text: its hash. The
/// template puts a line break before the text.
fn policy_source(text: &str) -> String {
    let hash = Sha256::new().chain_update("\n").chain_update(text);
    format!("'sha256-{}'", text::base64(&hash.finalize()))
}

/// Escapes text for HTML; drops control characters.
fn escape(text: &str) -> String {
    text.replace(char::is_control, "")
        .replace('&', "&amp;")
        .replace('<', "&lt;")
        .replace('>', "&gt;")
        .replace('"', "&quot;")
        .replace('\'', "&#39;")
}

fn pack(part: Part) -> io::Result<PackedPart> {
    let mut deflate = ZlibEncoder::new(Vec::new(), Compression::best());
    deflate.write_all(&part.bytes)?;
    let packed = deflate.finish()?;
    let mut header = part.header;
    header["bytes"] = part.bytes.len().into();
    header["packed"] = packed.len().into();
    header["crc32"] = crc32fast::hash(&packed).into();
    let text = text::encode(&packed);
    header["text"] = text.len().into();
    Ok(PackedPart { header, text })
}

/// Encodes the environment: red, green, blue and alpha in separate arrays, each byte as the
/// difference from the previous one.
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

/// Encodes an integer as an unsigned one with its sign in the lowest bit.
fn zigzag(number: i32) -> u32 {
    (number << 1 ^ number >> 31) as u32
}

/// Returns the lowest bytes of all numbers, then the next ones, up to `width` bytes per number.
fn byte_planes(numbers: &[u32], width: usize) -> Vec<u8> {
    (0..width)
        .flat_map(|k| numbers.iter().map(move |number| number.to_le_bytes()[k]))
        .collect()
}

/// Encodes texels as a PNG file with the best compression.
fn png(texels: &[[u8; 4]], size_px: [u32; 2]) -> Result<Vec<u8>, ExportError> {
    super::png(texels, size_px, CompressionType::Best)
}

#[cfg(test)]
mod tests {
    use super::*;
    use headbox_core::progress::Silent;
    use headbox_cube::pack::PlaneSet;
    use std::collections::HashSet;

    #[test]
    fn hostile_names_stay_text() {
        let name = "@HEADER@ @SCRIPT@ onload='alert(1)' \"><script>\u{1b}";
        let slots = [
            ("TITLE", escape(name)),
            (
                "HEADER",
                json!({ "name": name }).to_string().replace('<', "\\u003c"),
            ),
            ("SCRIPT", "run()".into()),
        ];
        let page = fill(
            "<b title=\"@TITLE@\">@HEADER@<script>@SCRIPT@</script>",
            &slots,
        );
        let text = "@HEADER@ @SCRIPT@ onload=&#39;alert(1)&#39; &quot;&gt;&lt;script&gt;";
        assert!(page.starts_with(&format!("<b title=\"{text}\">")), "{page}");
        assert_eq!(page.matches("run()").count(), 1, "{page}");
        assert_eq!(page.matches("<script>").count(), 1, "{page}");
    }

    #[test]
    fn every_slot_of_the_template_is_filled() {
        let names = [
            "POLICY", "BYTES", "WATCHDOG", "TITLE", "STYLE", "POSTER", "SCRIPT", "CRC32", "HEADER",
        ];
        let page = fill(TEMPLATE, &names.map(|name| (name, String::new())));
        assert!(!page.contains('@'), "{page}");
    }

    #[test]
    fn page_declares_size_and_checksums_before_data() {
        let part = |i: u8| Part {
            header: json!({"kind": "test"}),
            bytes: (0..1000).map(|k: u32| (k * k) as u8 ^ i).collect(),
        };
        let content = Content {
            header: json!({}),
            parts: vec![part(3), part(5)],
            poster: vec![1, 2, 3],
            modules: cube::MODULES,
        };
        let page = Page::from_content(content, "a < b", &Silent).expect("small");
        let mut bytes = Vec::new();
        page.write(&mut bytes).expect("in memory");
        let html = String::from_utf8(bytes).expect("UTF-8");
        let between = |start: &str, end: &str| {
            let (_, rest) = html.split_once(start).expect(start);
            rest.split_once(end).expect(end).0
        };
        let declared = between("\"headbox-bytes\" content=\"", "\"");
        let of_texts: usize = page.parts.iter().map(|part| part.text.len()).sum();
        assert_eq!(declared, of_texts.to_string());
        // The first script is the watchdog, and the policy allows it and the viewer.
        let watchdog = between("<script>\n", "</script>");
        assert!(watchdog == WATCHDOG && html.find(watchdog) < html.find("<style>"));
        let viewer = between("<script type=\"module\" async>\n", "</script>");
        for script in [watchdog, viewer] {
            assert!(between("script-src ", "\"").contains(&policy_source(script)));
        }
        let tag_and_header = between("id=\"header\" data-crc32=\"", "</script>");
        let (checksum, header) = tag_and_header.split_once("\">").expect("a tag");
        assert_eq!(checksum, crc32fast::hash(header.as_bytes()).to_string());
        let header: Value = serde_json::from_str(header).expect("JSON");
        for (declared, part) in header["parts"]
            .as_array()
            .expect("parts")
            .iter()
            .zip(&page.parts)
        {
            assert_eq!(declared["text"], part.text.len());
            assert!(declared["crc32"].is_u64() && declared == &part.header);
        }
        assert_eq!(html.matches("id=\"end\"").count(), 1, "one end");
        assert!(html.rfind("id=\"part-1\"") < html.rfind("<p id=\"end\""));
    }

    #[test]
    fn modules_declare_each_name_once() {
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
            // Constants of shaders have a scope of their own.
            let Some(rest) = declared
                .iter()
                .find_map(|word| line.strip_prefix(word))
                .filter(|rest| !rest.starts_with("float "))
            else {
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
            Page::new(&cube, "nothing", &Silent),
            Err(ExportError::Empty)
        ));
    }
}
