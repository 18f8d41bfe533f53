//! No file uses a file that uses it: of two that need each other, one has something that belongs to neither.
//!
//! What counts is what the sources say with `use` and with paths from `crate`, `super` and `self`. Not counted are `mod.rs`, `lib.rs` and
//! `name.rs` beside a folder `name/`, which put together what lies below them, and tests.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::{Path, PathBuf};

/// Where crates have their sources.
const CRATES: [&str; 4] = ["src", "capture/src", "scenes/src", "viewer/src"];

/// A file and those that it uses.
type Uses = BTreeMap<PathBuf, BTreeSet<PathBuf>>;

#[test]
fn no_file_uses_a_file_that_uses_it() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let circles: Vec<String> = CRATES.iter().flat_map(|krate| circles(&uses(&root.join(krate)))).collect();
    assert!(circles.is_empty(), "files that use each other, each once around:\n{}", circles.join("\n"));
}

#[test]
fn a_circle_is_found_and_a_chain_is_none() {
    let folder = tempfile::tempdir().expect("a folder");
    let write = |name: &str, text: &str| {
        let path = folder.path().join(name);
        fs::create_dir_all(path.parent().expect("a folder")).expect("made");
        fs::write(path, text).expect("written");
    };
    write("lib.rs", "mod a; mod b; mod c;");
    write("a.rs", "use crate::{b::deeper::{B, other}, b};\n#[cfg(test)]\nmod tests { use crate::c::D; }");
    write("b/mod.rs", "mod deeper;");
    write("b/deeper.rs", "// use super::super::a::A;\nfn f() { super::super::c::g() }");
    write("c.rs", "pub struct C;");
    assert!(circles(&uses(folder.path())).is_empty());
    write("c.rs", "fn g() { crate::a::h() }");
    let found = circles(&uses(folder.path()));
    assert_eq!(found, ["a.rs -> b/deeper.rs -> c.rs -> a.rs"]);
}

/// What all files of a crate use of it, as paths from its root.
fn uses(root: &Path) -> Uses {
    let mut files = Vec::new();
    find_sources(root, &mut files);
    let modules: BTreeMap<Vec<String>, PathBuf> =
        files.iter().map(|file| (module_of(root, file), file.clone())).collect();
    let is_facade =
        |file: &Path| file.ends_with("mod.rs") || file.ends_with("lib.rs") || file.with_extension("").is_dir();
    let within = |file: &Path| file.strip_prefix(root).expect("below it").to_path_buf();
    let of = |(module, file): (&Vec<String>, &PathBuf)| {
        let text = without_tests_and_comments(&fs::read_to_string(file).expect("a source"));
        let used = paths(&text).into_iter().filter_map(|path| {
            let mut path = absolute(module, &path)?;
            while !path.is_empty() && !modules.contains_key(&path) {
                path.pop();
            }
            modules.get(&path)
        });
        (within(file), used.filter(|used| *used != file && !is_facade(used)).map(|used| within(used)).collect())
    };
    modules.iter().filter(|(_, file)| !is_facade(file)).map(of).collect()
}

fn find_sources(folder: &Path, found: &mut Vec<PathBuf>) {
    for entry in fs::read_dir(folder).expect("a folder").map(|entry| entry.expect("an entry").path()) {
        let is_test = entry.file_stem().is_some_and(|name| name == "tests");
        match entry.extension().and_then(|ending| ending.to_str()) {
            _ if is_test => {}
            Some("rs") => found.push(entry),
            _ if entry.is_dir() => find_sources(&entry, found),
            _ => {}
        }
    }
}

/// The module that a file is.
fn module_of(root: &Path, file: &Path) -> Vec<String> {
    let within = file.strip_prefix(root).expect("below it").with_extension("");
    let mut parts: Vec<String> = within.iter().map(|part| part.to_string_lossy().into_owned()).collect();
    parts.pop_if(|last| ["mod", "lib", "main"].contains(&last.as_str()));
    parts
}

fn without_tests_and_comments(text: &str) -> String {
    let code = text.split("#[cfg(test)]\nmod ").next().unwrap_or_default();
    code.lines().map(|line| line.split("//").next().unwrap_or_default()).collect::<Vec<_>>().join("\n")
}

/// All paths of a text that begin in its own crate.
fn paths(text: &str) -> Vec<Vec<String>> {
    let mut found = Vec::new();
    let mut rest = text;
    while let Some(at) = ["crate::", "super::", "self::"].iter().filter_map(|start| rest.find(start)).min() {
        let is_whole = !rest[..at].ends_with(|c: char| c.is_alphanumeric() || c == '_' || c == ':');
        rest = &rest[at..];
        let end = branch(rest, &mut Vec::new(), &mut if is_whole { Some(&mut found) } else { None });
        rest = &rest[end.max(1)..];
    }
    found
}

/// Reads a path, and where it ends in braces all that it branches into; returns how much was read.
fn branch(text: &str, before: &mut Vec<String>, found: &mut Option<&mut Vec<Vec<String>>>) -> usize {
    let (mut at, depth) = (0, before.len());
    loop {
        let name: &str = &text[at..];
        let length = name.find(|c: char| !c.is_alphanumeric() && c != '_').unwrap_or(name.len());
        if length > 0 {
            before.push(name[..length].to_owned());
            at += length;
            if text[at..].starts_with("::") {
                at += 2;
                continue;
            }
        } else if text[at..].starts_with('{') {
            at += 1;
            while !text[at..].starts_with('}') && at < text.len() {
                let skipped = text[at..].len() - text[at..].trim_start_matches([' ', '\n', ',']).len();
                at += skipped;
                let read = if text[at..].starts_with('}') { 0 } else { branch(&text[at..], before, found) };
                at +=
                    if read == 0 && skipped == 0 { text[at..].chars().next().map_or(1, char::len_utf8) } else { read };
            }
            at = (at + 1).min(text.len());
            before.truncate(depth);
            return at;
        }
        if let Some(found) = found {
            found.push(before.clone());
        }
        before.truncate(depth);
        return at;
    }
}

/// A path from the root of its crate, said in a module.
fn absolute(module: &[String], path: &[String]) -> Option<Vec<String>> {
    let mut parts = path;
    let mut from = match parts.first().map(String::as_str) {
        Some("crate") => Vec::new(),
        _ => module.to_vec(),
    };
    while let Some((first, rest)) = parts.split_first() {
        match first.as_str() {
            "crate" | "self" => {}
            "super" => _ = from.pop()?,
            _ => break,
        }
        parts = rest;
    }
    from.extend(parts.iter().cloned());
    Some(from)
}

/// Each circle as the files once around, from the first by name.
fn circles(uses: &Uses) -> Vec<String> {
    let mut found = BTreeSet::new();
    for file in uses.keys() {
        if let Some(around) = shortest_way_back(uses, file)
            && around.iter().all(|other| other >= file)
        {
            let names: Vec<_> = around.iter().chain([file]).map(|file| file.display().to_string()).collect();
            found.insert(names.join(" -> "));
        }
    }
    found.into_iter().collect()
}

/// From a file along what is used until it is used itself, by the fewest steps.
fn shortest_way_back(uses: &Uses, file: &PathBuf) -> Option<Vec<PathBuf>> {
    let mut ways = vec![vec![file.clone()]];
    let mut seen = BTreeSet::new();
    let mut next = 0;
    while next < ways.len() {
        let way = ways[next].clone();
        next += 1;
        for used in uses.get(way.last()?).into_iter().flatten() {
            if used == file {
                return Some(way);
            }
            if seen.insert(used.clone()) {
                ways.push(way.iter().cloned().chain([used.clone()]).collect());
            }
        }
    }
    None
}
