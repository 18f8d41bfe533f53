//! Registry of the kinds of input: file name extensions, and what is made of each kind.
//!
//! File dialogs, messages about unknown files, and the table in the project's README come from
//! [`INPUTS`].

/// File name extensions of scenes.
pub const SCENES: [&str; 5] = ["obj", "gltf", "glb", "ply", "stl"];

/// File name extensions of homes: Sweet Home 3D plans, their archives, and TOML models.
pub const HOMES: [&str; 3] = ["xml", "sh3d", "toml"];

/// File name extensions of deep images.
pub const DEEP_IMAGES: [&str; 1] = ["exr"];

/// File name extensions of pictures of the sky.
pub const SKIES: [&str; 2] = ["hdr", "exr"];

/// File name extensions of photographs and renders.
pub const PHOTOGRAPHS: [&str; 12] = [
    "png", "jpg", "jpeg", "tif", "tiff", "webp", "bmp", "tga", "gif", "ppm", "pgm", "exr",
];

/// File name extensions of representations, which can be shown.
pub const REPRESENTATIONS: [&str; 4] = ["ldi", "sprite", "lumi", "house"];

/// A kind of input.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct InputKind {
    /// Name in messages, plural.
    pub name: &'static str,
    /// File name extensions, lower case, without the dot; none for folders.
    pub extensions: &'static [&'static str],
    /// Inputs of the kind that are not files.
    pub others: &'static [&'static str],
    /// Explanation in the table.
    pub description: &'static str,
    /// Outputs, in Markdown.
    pub outputs: &'static str,
    /// True if the window opens it.
    pub is_shown: bool,
}

/// All kinds of input.
pub const INPUTS: [InputKind; 7] = [
    InputKind {
        name: "scenes",
        extensions: &SCENES,
        others: &["builtin:NAME"],
        description: "to look around in, seen from one side, or seen from outside, with gloss",
        outputs: "`.ldi`, `.sprite` (layers with depth), `.lumi` (a lumigraph)",
        is_shown: true,
    },
    InputKind {
        name: "homes",
        extensions: &HOMES,
        others: &[],
        description: "of many rooms: Sweet Home 3D, or a scene and a list of its doors",
        outputs: "`.house` (all rooms), `.ldi` (one)",
        is_shown: true,
    },
    InputKind {
        name: "image sets",
        extensions: &[],
        others: &["a folder"],
        description: "of photographs or renders with known cameras, with depth or without",
        outputs: "frames, `.ldi`, `.sprite`, `.lumi`",
        is_shown: true,
    },
    InputKind {
        name: "photographs",
        extensions: &PHOTOGRAPHS,
        others: &[],
        description: "in such a folder, or with depth for a sprite (`--color`)",
        outputs: "as the folder, `.sprite`",
        is_shown: false,
    },
    InputKind {
        name: "deep images",
        extensions: &DEEP_IMAGES,
        others: &[],
        description: "of film renderers",
        outputs: "`.ldi`",
        is_shown: true,
    },
    InputKind {
        name: "skies",
        extensions: &SKIES,
        others: &[],
        description: "as equirectangular pictures, the light of a scene (`--sky`)",
        outputs: "as the scene",
        is_shown: false,
    },
    InputKind {
        name: "own files",
        extensions: &REPRESENTATIONS,
        others: &[],
        description: "captured from these",
        outputs: "frames, films, page; of `.ldi` and `.sprite` also `.glb`, `.ply`, deep `.exr`; of `.house` walk-throughs",
        is_shown: true,
    },
];

impl InputKind {
    /// Lists the extensions with their dots, and the inputs that are not files.
    fn forms(&self) -> Vec<String> {
        let extensions = self.extensions.iter().map(|name| format!(".{name}"));
        let others = self.others.iter().map(|name| (*name).to_owned());
        extensions.chain(others).collect()
    }
}

/// Returns the extensions of the files that the window opens, each once.
pub fn shown_extensions() -> Vec<&'static str> {
    let mut all: Vec<&str> = Vec::new();
    for kind in INPUTS.iter().filter(|kind| kind.is_shown) {
        all.extend(kind.extensions);
    }
    all
}

/// Lists the inputs that the window opens, for messages: `scenes (.obj, .gltf), a folder`.
pub fn describe_shown() -> String {
    let kinds = INPUTS.iter().filter(|kind| kind.is_shown);
    let kinds: Vec<String> = kinds
        .map(|kind| format!("{} ({})", kind.name, kind.forms().join(", ")))
        .collect();
    kinds.join(", ")
}

/// Lists extensions for messages: `.obj, .gltf or .glb`.
pub fn join_extensions(extensions: &[&str]) -> String {
    let dotted: Vec<String> = extensions.iter().map(|name| format!(".{name}")).collect();
    match &dotted[..] {
        [first @ .., last] if !first.is_empty() => format!("{} or {last}", first.join(", ")),
        few => few.concat(),
    }
}

/// Formats [`INPUTS`] as a table in Markdown.
pub fn table() -> String {
    let mut table = String::from("| what | opens | comes out |\n|---|---|---|\n");
    for kind in &INPUTS {
        let forms = kind.forms();
        let forms = forms.iter().map(|form| {
            if form.contains(' ') {
                form.clone()
            } else {
                format!("`{form}`")
            }
        });
        let forms: Vec<String> = forms.collect();
        table += &format!(
            "| {} {} | {} | {} |\n",
            kind.name,
            kind.description,
            forms.join(", "),
            kind.outputs
        );
    }
    table
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::path::Path;

    #[test]
    fn extensions_are_joined_for_messages() {
        assert_eq!(join_extensions(&["a"]), ".a");
        assert_eq!(join_extensions(&["a", "b", "c"]), ".a, .b or .c");
    }

    /// Each extension leads to one kind in the window, so that a file is opened in one way.
    #[test]
    fn shown_extensions_are_unique() {
        let mut all = shown_extensions();
        all.sort_unstable();
        let count = all.len();
        all.dedup();
        assert_eq!(all.len(), count, "{all:?}");
    }

    #[test]
    fn photographs_can_be_decoded() {
        for extension in PHOTOGRAPHS.iter().filter(|name| **name != "exr") {
            let format = ::image::ImageFormat::from_extension(extension);
            let is_read = format.is_some_and(|format| format.reading_enabled());
            assert!(is_read, "{extension}");
        }
    }

    /// `HEADBOX_BLESS=1` writes the table instead.
    #[test]
    fn readme_has_table_of_inputs() {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../README.md");
        let readme = std::fs::read_to_string(&path).expect("README.md");
        let expected = table();
        let start = readme.find("| what | opens |").expect("the table");
        let rest = &readme[start..];
        let end = start + rest.find("\n\n").expect("the end of the table") + 1;
        if std::env::var_os("HEADBOX_BLESS").is_some() {
            let blessed = format!("{}{expected}{}", &readme[..start], &readme[end..]);
            std::fs::write(&path, blessed).expect("README.md is written");
            return;
        }
        assert!(
            readme[start..end] == expected,
            "README.md differs from the registry; HEADBOX_BLESS=1 writes:\n{expected}"
        );
    }
}
