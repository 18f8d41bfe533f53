//! Ids of the papers' algorithms in the sources resolve in `docs/papers.md`, and the files named
//! there cite them. Decisions that comments cite exist in `docs/decisions/`, and the files that
//! decisions name exist.
//!
//! Documents name a source file by the end of its path (`peel.rs`, `render/mod.rs`), so that a file
//! can move.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

/// Names that look like ids but are none: the illuminant.
const NO_IDS: [&str; 1] = ["D65"];

fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

/// Collects the Rust files under a folder.
fn collect_sources(folder: &Path, files: &mut Vec<PathBuf>) {
    for entry in std::fs::read_dir(folder)
        .expect("a folder")
        .map(|entry| entry.expect("an entry").path())
    {
        if entry.is_dir() {
            collect_sources(&entry, files);
        } else if entry.extension().is_some_and(|extension| extension == "rs") {
            files.push(entry);
        }
    }
}

/// Returns the Rust files of the workspace.
fn sources() -> Vec<PathBuf> {
    let mut files = Vec::new();
    for folder in [
        "src", "capture", "scenes", "viewer", "tests", "benches", "examples",
    ] {
        collect_sources(&root().join(folder), &mut files);
    }
    files
}

/// Returns true if a word is an id: `S17`, `C3b`, `P-N10`.
fn is_id(word: &str) -> bool {
    let Some(rest) = word.strip_prefix(['R', 'S', 'P', 'L', 'E', 'C', 'D']) else {
        return false;
    };
    let number = rest
        .strip_prefix("-N")
        .or(rest.strip_suffix(['a', 'b']))
        .unwrap_or(rest);
    (1..=2).contains(&number.len())
        && number.bytes().all(|b| b.is_ascii_digit())
        && !NO_IDS.contains(&word)
}

/// Ids in the comments and strings of a text.
fn ids(text: &str) -> BTreeSet<&str> {
    let prose = text
        .lines()
        .filter(|line| line.contains("//") || line.contains('"'));
    prose
        .flat_map(|line| line.split(|c: char| !c.is_alphanumeric() && c != '-' && c != '_'))
        .filter(|w| is_id(w))
        .collect()
}

#[test]
fn papers_page_matches_citations() {
    let page = std::fs::read_to_string(root().join("docs/papers.md")).expect("the page");
    let known = ids_of_page(&page);
    let files = sources();
    let mut cited: BTreeMap<&Path, BTreeSet<String>> = BTreeMap::new();
    for file in &files {
        let text = std::fs::read_to_string(file).expect("text");
        for id in ids(&text) {
            // A variant of an algorithm (R2b) is listed with the algorithm.
            let resolves = known.contains(id) || known.contains(id.trim_end_matches(['a', 'b']));
            assert!(
                resolves,
                "{} cites {id}, which docs/papers.md does not list",
                file.display()
            );
            cited.entry(file).or_default().insert(id.to_string());
        }
    }
    let mut rows = 0;
    for line in page.lines().filter(|line| line.starts_with("| ")) {
        let cells: Vec<&str> = line.split('|').map(str::trim).collect();
        let Some(id) = cells.get(1).filter(|id| is_id(id)) else {
            continue;
        };
        // Tables with tests have one column more than the table of disagreements.
        let tests = if cells.len() > 5 {
            cells[cells.len() - 2]
        } else {
            ""
        };
        let implementation = line.strip_suffix(&format!("{tests} |")).unwrap_or(line);
        let aliases = implementation
            .split("(as ")
            .skip(1)
            .filter_map(|after| after.split(')').next());
        let accepted: Vec<&str> = aliases.chain([*id]).collect();
        for name in rust_files(implementation) {
            let cites = |ids: &BTreeSet<String>| accepted.iter().any(|id| ids.contains(*id));
            let found = cited
                .iter()
                .any(|(file, ids)| file.ends_with(name) && cites(ids));
            assert!(found, "docs/papers.md: no file {name} cites {id}");
            rows += 1;
        }
        for name in rust_files(tests) {
            assert!(
                files.iter().any(|file| file.ends_with(name)),
                "docs/papers.md: no test file {name}"
            );
        }
    }
    assert!(rows > 70, "{rows} files in rows");
}

/// Ids that have a table row or are named in the text about numbers.
fn ids_of_page(page: &str) -> BTreeSet<&str> {
    page.split(|c: char| !c.is_alphanumeric() && c != '-')
        .filter(|word| is_id(word))
        .collect()
}

/// Path suffixes of Rust files in backticks.
fn rust_files(text: &str) -> impl Iterator<Item = &str> {
    text.split('`')
        .filter(|word| word.ends_with(".rs") && !word.contains(' '))
}

#[test]
fn decisions_exist_and_are_indexed() {
    let folder = root().join("docs/decisions");
    let index = std::fs::read_to_string(folder.join("README.md")).expect("the index");
    let files = sources();
    let mut numbers = BTreeSet::new();
    for entry in std::fs::read_dir(&folder)
        .expect("a folder")
        .map(|entry| entry.expect("an entry"))
    {
        let name = entry.file_name().into_string().expect("UTF-8");
        if name == "README.md" {
            continue;
        }
        let text = std::fs::read_to_string(entry.path()).expect("text");
        let title = text
            .lines()
            .next()
            .and_then(|line| line.split_once(". "))
            .expect("a title")
            .1;
        assert!(
            index.contains(&format!("[{}]({name}) | {title} |", &name[..4])),
            "{name} is not in the index"
        );
        for heading in ["Context", "Decision", "Measured", "Rejected"] {
            assert_eq!(
                text.matches(&format!("\n## {heading}\n")).count(),
                1,
                "{name}: {heading}"
            );
        }
        for path in rust_files(&text) {
            assert!(
                files.iter().any(|file| file.ends_with(path)),
                "{name} names {path}, which does not exist"
            );
        }
        assert!(
            numbers.insert(name[..4].to_string()),
            "two decisions have the number of {name}"
        );
    }
    let mut cited = BTreeSet::new();
    for file in files
        .iter()
        .filter(|file| !file.ends_with("tests/library/report/citations.rs"))
    {
        let text = std::fs::read_to_string(file).expect("text");
        for after in text.split("docs/decisions").skip(1) {
            let number = after
                .strip_prefix('/')
                .and_then(|number| number.get(..4))
                .unwrap_or_default();
            assert!(
                numbers.contains(number),
                "{}: no decision docs/decisions{after:.9}",
                file.display()
            );
            cited.insert(number.to_string());
        }
    }
    assert!(cited.len() > 10, "{cited:?}");
}

#[test]
fn id_recognised_among_words() {
    assert!(
        ["S1", "R16", "C3b", "R2a", "P-N10", "D22"]
            .iter()
            .all(|id| is_id(id))
    );
    assert!(
        ["S", "S100", "D65", "X1", "Sb", "C3bb", "P-10", "S1c"]
            .iter()
            .all(|word| !is_id(word))
    );
}
