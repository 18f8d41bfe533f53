//! The registry.

use super::*;

#[test]
fn files_are_known_by_tag_and_by_extension() {
    let dir = tempfile::tempdir().expect("a folder");
    for representation in BUILT_IN {
        let path = dir.path().join(format!("x.{}", representation.extension));
        let found = find(&path).expect("known by its extension");
        assert_eq!(found.name, representation.name);
        assert!((representation.open)(&path).is_err(), "there is no file");
    }
    assert!(find(&dir.path().join("notes.txt")).is_none());
}

#[test]
fn flags_have_one_meaning_in_a_view() {
    for representation in BUILT_IN {
        let settings = (representation.settings)();
        for (i, setting) in settings.iter().enumerate() {
            let is_same = |other: &Setting| other.id == setting.id;
            assert!(!settings[..i].iter().any(is_same), "{}", setting.id);
        }
        let flags: Vec<_> = settings.iter().filter_map(|setting| setting.flag).collect();
        for (i, flag) in flags.iter().enumerate() {
            assert!(!flags[..i].contains(flag), "{flag} twice");
        }
    }
}
