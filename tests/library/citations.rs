//! Every id of a paper's algorithm in the sources resolves in `docs/papers.md`, and every file named there cites its id; every
//! decision that a comment names has its entry in `docs/decisions.md`.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

/// What looks like an id and is none: the illuminant.
const NO_IDS: [&str; 1] = ["D65"];

fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

/// The Rust files under a folder.
fn sources(folder: &Path, to: &mut Vec<PathBuf>) {
    for entry in std::fs::read_dir(folder).expect("a folder").map(|entry| entry.expect("an entry").path()) {
        if entry.is_dir() {
            sources(&entry, to);
        } else if entry.extension().is_some_and(|extension| extension == "rs") {
            to.push(entry);
        }
    }
}

/// Whether a word is an id: `S17`, `C3b`, `P-N10`.
fn is_id(word: &str) -> bool {
    let Some(rest) = word.strip_prefix(['R', 'S', 'P', 'L', 'E', 'C', 'D']) else { return false };
    let number = rest.strip_prefix("-N").or(rest.strip_suffix(['a', 'b'])).unwrap_or(rest);
    (1..=2).contains(&number.len()) && number.bytes().all(|b| b.is_ascii_digit()) && !NO_IDS.contains(&word)
}

/// The ids in the comments and strings of a text.
fn ids(text: &str) -> BTreeSet<&str> {
    let prose = text.lines().filter(|line| line.contains("//") || line.contains('"'));
    prose
        .flat_map(|line| line.split(|c: char| !c.is_alphanumeric() && c != '-' && c != '_'))
        .filter(|w| is_id(w))
        .collect()
}

#[test]
fn every_citation_resolves_and_every_file_cites_what_it_holds() {
    let page = std::fs::read_to_string(root().join("docs/papers.md")).expect("the page");
    let known = ids_of_page(&page);
    let mut files = Vec::new();
    ["src", "capture", "scenes/src", "viewer/src", "tests"]
        .iter()
        .for_each(|folder| sources(&root().join(folder), &mut files));
    let mut cited: BTreeMap<PathBuf, BTreeSet<String>> = BTreeMap::new();
    for file in files {
        let text = std::fs::read_to_string(&file).expect("text");
        let name = file.strip_prefix(root()).expect("inside").to_path_buf();
        for id in ids(&text) {
            // A variant of one thing (R2b) is where the thing is.
            let resolves = known.contains(id) || known.contains(id.trim_end_matches(['a', 'b']));
            assert!(resolves, "{} cites {id}, of which docs/papers.md knows nothing", name.display());
            cited.entry(name.clone()).or_default().insert(id.to_string());
        }
    }
    let mut rows = 0;
    for line in page.lines().filter(|line| line.starts_with("| ") && !line.contains("not built")) {
        let Some(id) = line.split('|').nth(1).map(str::trim).filter(|id| is_id(id)) else { continue };
        for file in line.split('`').filter(|word| word.ends_with(".rs")) {
            let cites = cited.get(Path::new(file)).is_some_and(|ids| ids.contains(id));
            // A disagreement is settled where its parts are cited.
            assert!(cites || id == "D15", "{file} does not cite {id}");
            rows += 1;
        }
    }
    assert!(rows > 55, "{rows} rows with files");
}

/// The ids that have a row, or are named in the prose about numbers.
fn ids_of_page(page: &str) -> BTreeSet<&str> {
    page.split(|c: char| !c.is_alphanumeric() && c != '-').filter(|word| is_id(word)).collect()
}

/// The words of a file's comments, in one line.
fn comments(text: &str) -> String {
    let lines = text.lines().map(str::trim_start).filter(|line| line.starts_with("//"));
    lines.map(|line| line.trim_start_matches(['/', '!']).trim()).collect::<Vec<_>>().join(" ")
}

#[test]
fn every_decision_that_a_comment_names_has_an_entry() {
    let page = std::fs::read_to_string(root().join("docs/decisions.md")).expect("the page");
    let entries: Vec<String> =
        page.lines().filter_map(|line| line.strip_prefix("### ")).map(str::to_lowercase).collect();
    let mut files = Vec::new();
    ["src", "capture/src", "scenes/src", "viewer/src"]
        .iter()
        .for_each(|folder| sources(&root().join(folder), &mut files));
    let mut named = BTreeSet::new();
    for file in files {
        let comments = comments(&std::fs::read_to_string(&file).expect("text")).to_lowercase();
        for after in comments.split("docs/decisions.md").skip(1) {
            let title = after.trim_start_matches([':', ',']).trim_start();
            let entry = entries.iter().find(|entry| title.starts_with(entry.as_str()));
            named.insert(entry.unwrap_or_else(|| panic!("{}: no decision {title:.60}", file.display())).clone());
        }
    }
    assert!(named.len() > 10, "{named:?}");
    // A file that an entry names is there.
    for path in page.split('`').filter(|word| word.ends_with(".rs")) {
        assert!(root().join(path).is_file(), "docs/decisions.md names {path}, which is not there");
    }
}

#[test]
fn an_id_is_told_from_other_words() {
    assert!(["S1", "R16", "C3b", "R2a", "P-N10", "D22"].iter().all(|id| is_id(id)));
    assert!(["S", "S100", "D65", "X1", "Sb", "C3bb", "P-10", "S1c"].iter().all(|word| !is_id(word)));
}
