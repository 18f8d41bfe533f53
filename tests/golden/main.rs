//! Golden outputs: runs the commands of `commands.txt` and compares the SHA-256 of every file that
//! they write with `sums.txt`. `commands.txt` describes its format, how to check another build and
//! how to record sums.

#![cfg(unix)] // commands are lines of a POSIX shell
#![expect(
    clippy::unwrap_used,
    reason = "in a test a panic is the failure report"
)]

use serde_json::Value;
use sha2::{Digest, Sha256};
use std::collections::{BTreeMap, HashMap};
use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::{Instant, SystemTime};
use std::{env, fs};

/// Content of `commands.txt`.
#[derive(Default)]
struct Suite {
    cases: Vec<Case>,
    /// Patterns of JSON keys and CSV columns whose values differ from run to run.
    volatile: Vec<String>,
    /// Patterns of files that are not recorded.
    unrecorded: Vec<String>,
}

/// Commands that run together in one shell.
#[derive(Default)]
struct Case {
    name: String,
    script: String,
    /// Paths without which the case is skipped.
    needs: Vec<String>,
}

/// SHA-256 and size of each output, by `case/file`.
type Sums = BTreeMap<String, Sum>;

#[derive(Debug, PartialEq)]
struct Sum {
    sha256: String,
    size: usize,
}

impl Suite {
    fn parse(text: &str) -> Self {
        let mut suite = Self::default();
        for line in text
            .lines()
            .filter(|line| !line.is_empty() && !line.starts_with('#'))
        {
            let words = || line.split_whitespace().skip(1).map(str::to_owned);
            match (line.split(' ').next().unwrap(), suite.cases.last_mut()) {
                ("volatile", None) => suite.volatile.extend(words()),
                ("unrecorded", None) => suite.unrecorded.extend(words()),
                ("case", _) => suite.cases.push(Case {
                    name: words().collect(),
                    ..Case::default()
                }),
                ("needs", Some(case)) => case.needs.extend(words()),
                (_, Some(case)) => writeln!(case.script, "{line}").unwrap(),
                (_, None) => panic!("commands.txt: before the first case: {line}"),
            }
        }
        suite
    }

    /// Sum of an output without its volatile parts; `None` if it is not recorded.
    fn sum(&self, file: &str, bytes: &[u8]) -> Option<Sum> {
        if matches(&self.unrecorded, file) {
            return None;
        }
        let filtered = match file.rsplit('.').next() {
            Some("json") => self.filter_json(bytes),
            Some("csv") => self.filter_csv(bytes),
            _ => None,
        };
        let bytes = filtered.as_ref().map_or(bytes, String::as_bytes);
        let sha256 = Sha256::digest(bytes)
            .iter()
            .map(|byte| format!("{byte:02x}"))
            .collect();
        Some(Sum {
            sha256,
            size: bytes.len(),
        })
    }

    /// JSON without volatile keys; `None` if it has none, so that its bytes count as they are.
    fn filter_json(&self, bytes: &[u8]) -> Option<String> {
        let mut value = serde_json::from_slice(bytes).ok()?;
        self.remove_keys(&mut value).then(|| value.to_string())
    }

    /// Removes volatile keys, and returns true if there were any.
    fn remove_keys(&self, value: &mut Value) -> bool {
        match value {
            Value::Object(fields) => {
                let count = fields.len();
                fields.retain(|key, _| !matches(&self.volatile, key));
                let removed = fields.len() < count;
                fields
                    .values_mut()
                    .fold(removed, |removed, field| self.remove_keys(field) | removed)
            }
            Value::Array(items) => items
                .iter_mut()
                .fold(false, |removed, item| self.remove_keys(item) | removed),
            _ => false,
        }
    }

    /// CSV without volatile columns. Commas in quotation marks separate nothing.
    fn filter_csv(&self, bytes: &[u8]) -> Option<String> {
        let text = std::str::from_utf8(bytes).ok()?;
        let cells = |line: &str| {
            let mut quoted = false;
            let separates = |c| {
                quoted ^= c == '"';
                c == ',' && !quoted
            };
            line.split(separates).map(str::to_owned).collect::<Vec<_>>()
        };
        let header = cells(text.lines().next()?);
        let filter = |line| {
            let kept = header
                .iter()
                .zip(cells(line))
                .filter(|(column, _)| !matches(&self.volatile, column));
            kept.map(|(_, cell)| cell).collect::<Vec<_>>().join(",")
        };
        Some(text.lines().map(filter).collect::<Vec<_>>().join("\n"))
    }
}

/// Returns true if a name matches one of some patterns, which may have one `*`.
fn matches(patterns: &[String], name: &str) -> bool {
    patterns
        .iter()
        .any(|pattern| match pattern.split_once('*') {
            Some((start, end)) => name.starts_with(start) && name.ends_with(end),
            None => name == pattern,
        })
}

/// Folder in which the cases run, with the files that are in it so far.
struct Workspace {
    folder: PathBuf,
    program: PathBuf,
    files: HashMap<PathBuf, SystemTime>,
}

impl Workspace {
    /// Makes an empty folder that the repository's `tests` and `../shared` are linked into.
    fn new(folder: PathBuf) -> Self {
        let program =
            env::var_os("HEADBOX").unwrap_or_else(|| env!("CARGO_BIN_EXE_headbox").into());
        let program = fs::canonicalize(program).unwrap();
        let _ = fs::remove_dir_all(&folder);
        fs::create_dir_all(&folder).unwrap();
        for (name, target) in [("tests", "tests"), ("shared", "../shared")] {
            let target = Path::new(env!("CARGO_MANIFEST_DIR")).join(target);
            std::os::unix::fs::symlink(target, folder.join(name)).unwrap();
        }
        Self {
            folder,
            program,
            files: HashMap::new(),
        }
    }

    /// Runs a case. Returns the files that it has written, and what went wrong.
    fn run(&mut self, case: &Case) -> (Vec<String>, String) {
        let script = format!("headbox() {{ \"$HEADBOX\" \"$@\"; }}\n{}", case.script);
        let output = Command::new("sh")
            .args(["-euc", &script])
            .current_dir(&self.folder)
            .env("HEADBOX", &self.program)
            .env("XDG_CACHE_HOME", self.folder.join(".cache"))
            .env_remove("HEADBOX_EMBREE") // its rows in reports are not recorded
            .output()
            .unwrap();
        let (mut written, mut problems) = (Vec::new(), String::new());
        if !output.status.success() {
            let messages = String::from_utf8_lossy(&output.stderr);
            write!(
                problems,
                "case {} failed: {messages}\n{}",
                case.name, case.script
            )
            .unwrap();
        }
        for path in files_below(&self.folder) {
            let modified = path.metadata().unwrap().modified().unwrap();
            let file = path
                .strip_prefix(&self.folder)
                .unwrap()
                .to_str()
                .unwrap()
                .to_owned();
            match self.files.insert(path, modified) {
                None => written.push(file),
                Some(before) if before == modified => {}
                Some(_) => writeln!(
                    problems,
                    "case {} overwrites {file} of an earlier case",
                    case.name
                )
                .unwrap(),
            }
        }
        (written, problems)
    }
}

/// Lists the files in a folder and its folders. Links and hidden folders are not entered.
fn files_below(folder: &Path) -> Vec<PathBuf> {
    let mut paths: Vec<_> = fs::read_dir(folder)
        .unwrap()
        .map(|entry| entry.unwrap().path())
        .collect();
    paths.retain(|path| {
        !path.is_symlink() && !path.file_name().unwrap().to_string_lossy().starts_with('.')
    });
    paths
        .into_iter()
        .flat_map(|path| {
            if path.is_dir() {
                files_below(&path)
            } else {
                vec![path]
            }
        })
        .collect()
}

fn parse_sums(text: &str) -> Sums {
    let sum = |line: &str| {
        let mut words = line.splitn(3, ' ');
        let sum = Sum {
            sha256: words.next()?.to_owned(),
            size: words.next()?.parse().ok()?,
        };
        Some((words.next()?.to_owned(), sum))
    };
    text.lines()
        .map(|line| sum(line).unwrap_or_else(|| panic!("sums.txt: {line}")))
        .collect()
}

/// Names of outputs that differ from the recorded ones, or that only one side has.
fn differences(expected: &Sums, actual: &Sums) -> Vec<String> {
    let differ = |name: &&String| expected.get(*name) != actual.get(*name);
    let added = actual.keys().filter(|name| !expected.contains_key(*name));
    expected
        .keys()
        .chain(added)
        .filter(differ)
        .cloned()
        .collect()
}

#[test]
fn outputs_equal_recorded_sums() {
    let suite = Suite::parse(include_str!("commands.txt"));
    let mut recorded = parse_sums(include_str!("sums.txt"));
    let bless = env::var_os("HEADBOX_BLESS").is_some();
    let golden = Path::new(env!("CARGO_TARGET_TMPDIR")).with_file_name("golden");
    let mut workspace = Workspace::new(golden.join(if bless { "expected" } else { "actual" }));
    let (mut all, mut failures, mut report) = (Sums::new(), String::new(), String::new());
    let place = |folder: &str, file: &str, sum: Option<&Sum>| {
        let path = golden.join(folder).join(file);
        let is_it = fs::read(&path).is_ok_and(|bytes| suite.sum(file, &bytes).as_ref() == sum);
        let place = if is_it {
            path.display().to_string()
        } else {
            "not stored".into()
        };
        sum.map_or("none".into(), |sum| {
            format!("{} ({} bytes), {place}", sum.sha256, sum.size)
        })
    };
    for case in &suite.cases {
        let prefix = format!("{}/", case.name);
        let expected: Sums = recorded
            .extract_if(.., |name, _| name.starts_with(&prefix))
            .collect();
        if let Some(absent) = case
            .needs
            .iter()
            .find(|path| !workspace.folder.join(path).exists())
        {
            println!("skipped {}: there is no {absent}", case.name);
            all.extend(expected);
            continue;
        }
        let started = Instant::now();
        let (written, problems) = workspace.run(case);
        println!("{:6.1} s  {}", started.elapsed().as_secs_f64(), case.name);
        failures += &problems;
        let sum = |file: &String| {
            let bytes = fs::read(workspace.folder.join(file)).unwrap();
            Some((format!("{prefix}{file}"), suite.sum(file, &bytes)?))
        };
        let actual: Sums = written.iter().filter_map(sum).collect();
        let differ = differences(&expected, &actual);
        if !differ.is_empty() {
            let counts = format!("{} of {} outputs differ", differ.len(), expected.len());
            write!(
                report,
                "case {}: {counts}, written by\n{}",
                case.name, case.script
            )
            .unwrap();
        }
        for name in &differ {
            let file = &name[prefix.len()..];
            let [expected, actual] = [("expected", &expected), ("actual", &actual)]
                .map(|(folder, sums)| place(folder, file, sums.get(name)));
            writeln!(
                report,
                "  {file}\n    expected {expected}\n    actual   {actual}"
            )
            .unwrap();
        }
        all.extend(actual);
    }
    recorded.keys().for_each(|name| {
        writeln!(report, "{name} is recorded, but there is no such case").unwrap();
    });
    assert!(failures.is_empty(), "\n{failures}");
    if bless {
        let line = |(name, sum): (&String, &Sum)| format!("{} {} {name}\n", sum.sha256, sum.size);
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/golden/sums.txt");
        return fs::write(path, all.iter().map(line).collect::<String>()).unwrap();
    }
    assert!(report.is_empty(), "\n{report}");
}

#[test]
fn flipped_bit_is_a_difference() {
    let suite = Suite::parse("volatile ms\n");
    let sums =
        |file: &str, bytes: &[u8]| Sums::from([(file.into(), suite.sum(file, bytes).unwrap())]);
    let json = r#"{"ms": 1, "flip": [{"ms": 2, "at": 3}]}"#;
    for (file, text) in [
        ("a.ldi", "HEADBOX"),
        ("a.json", json),
        ("a.csv", "pose,ms,holes\n0,1,2\n"),
    ] {
        let expected = sums(file, text.as_bytes());
        let mut flipped = text.to_owned().into_bytes();
        let last = flipped.iter().rposition(u8::is_ascii_alphanumeric).unwrap();
        flipped[last] ^= 1;
        assert!(differences(&expected, &expected).is_empty());
        assert_eq!(differences(&expected, &sums(file, &flipped)), [file]);
        assert_eq!(differences(&expected, &Sums::new()), [file], "not written");
        assert_eq!(differences(&Sums::new(), &expected), [file], "not recorded");
    }
}

#[test]
fn volatile_part_is_no_difference() {
    let suite = Suite::parse("volatile ms *_ms\nunrecorded *.svg\n");
    let sum = |file: &str, text: &str| suite.sum(file, text.as_bytes());
    assert_eq!(
        sum("a.json", r#"{"a": [{"ms": 2, "b": 3}]}"#),
        sum("a.json", r#"{"a": [{"ms": [4], "b": 3}]}"#)
    );
    assert_eq!(
        sum("a.csv", "\"a,b\",warp_ms,c\n0,1,2\n"),
        sum("a.csv", "\"a,b\",warp_ms,c\n0,3,2\n")
    );
    assert_eq!(sum("chart.svg", "<svg/>"), None);
}
