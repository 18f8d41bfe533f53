//! Promise of the guide: it names every flag.

use crate::run::succeeds;
use std::collections::BTreeSet;
use std::path::Path;

/// Flags of every command, described once.
const SHARED: [&str; 7] = [
    "--allow-outside",
    "--help",
    "--json",
    "--memory",
    "--output",
    "--search",
    "--threads",
];

/// Returns the pages of the guide and the README, sorted by name.
fn pages() -> Vec<String> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let guide = std::fs::read_dir(root.join("docs/guide")).expect("the guide");
    let mut files: Vec<_> = guide.map(|page| page.expect("a page").path()).collect();
    files.push(root.join("README.md"));
    files.sort();
    let read = |file| std::fs::read_to_string(file).expect("a page in UTF-8");
    files.iter().map(read).collect()
}

/// Returns the flags that a text names.
fn flags(text: &str) -> BTreeSet<&str> {
    let is_of_flag = |c: char| c == '-' || c.is_ascii_lowercase() || c.is_ascii_digit();
    text.split(|c| !is_of_flag(c))
        .filter(|word| word.starts_with("--") && word.len() > 2)
        .collect()
}

/// Returns the commands in the help of the program.
fn commands(help: &str) -> Vec<&str> {
    let lines = help.lines().skip_while(|line| *line != "Commands:").skip(1);
    lines
        .take_while(|line| !line.is_empty())
        .filter_map(|line| line.split_whitespace().next())
        .filter(|command| *command != "help")
        .collect()
}

/// Returns the flags that the help of a command lists, without those that its texts only mention.
fn listed_flags(help: &str) -> BTreeSet<&str> {
    help.lines()
        .filter(|line| line.trim_start().starts_with('-'))
        .filter_map(|line| line.split_whitespace().find(|word| !word.ends_with(',')))
        .filter(|flag| flag.starts_with("--"))
        .collect()
}

/// Returns true if a page is about a command: it names `headbox COMMAND` or `COMMAND ...` as code.
fn is_about(page: &str, command: &str) -> bool {
    let names = [
        format!("headbox {command}"),
        format!("`{command} "),
        format!("`{command}`"),
    ];
    names.iter().any(|name| page.contains(name))
}

#[test]
fn guide_names_every_flag_on_a_page_of_its_command() {
    let folder = tempfile::tempdir().expect("a folder");
    let pages = pages();
    let help = succeeds(folder.path(), &["--help"]);
    let commands = commands(&help);
    assert!(commands.len() > 15, "{commands:?}");
    let mut missing = Vec::new();
    for command in commands {
        let about = pages.iter().filter(|page| is_about(page, command));
        let named: BTreeSet<&str> = about.flat_map(|page| flags(page)).collect();
        let help = succeeds(folder.path(), &[command, "--help"]);
        let listed = listed_flags(&help);
        assert!(listed.contains("--help"), "{command}: {listed:?}");
        let absent = listed.iter().filter(|flag| !named.contains(*flag));
        let own = absent.filter(|flag| !SHARED.contains(flag));
        missing.extend(own.map(|flag| format!("{command} {flag}")));
    }
    assert!(
        missing.is_empty(),
        "flags that no page of docs/guide names with their command: {missing:#?}"
    );
    let all: BTreeSet<&str> = pages.iter().flat_map(|page| flags(page)).collect();
    for flag in SHARED {
        assert!(all.contains(flag), "{flag} is described nowhere");
    }
}

#[test]
fn unnamed_flags_are_found() {
    let help = "Options:\n  -o, --output <F>  Output of --near\n          - far: Beyond --near\n      --far <M>\n          Of --cut\n\n  -h, --help\n";
    let listed: Vec<&str> = listed_flags(help).into_iter().collect();
    assert_eq!(listed, ["--far", "--help", "--output"]);
    let named: Vec<&str> = flags("`render --far 2`, `--display-unit`s -- a")
        .into_iter()
        .collect();
    assert_eq!(named, ["--display-unit", "--far"]);
    assert!(is_about("`render --far 2`", "render") && !is_about("rendering", "render"));
}
