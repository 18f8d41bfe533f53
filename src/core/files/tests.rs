use super::*;
use std::fs::{read, write};

fn put(path: &Path, text: &str) -> io::Result<()> {
    write_whole(path, |w| w.write_all(text.as_bytes()))
}

fn names(folder: &Path) -> Vec<String> {
    let entries = fs::read_dir(folder).unwrap();
    let mut names: Vec<String> = entries
        .map(|entry| entry.unwrap().file_name().to_string_lossy().into_owned())
        .collect();
    names.sort();
    names
}

#[test]
fn failed_write_keeps_old_file() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("frame.png");
    put(&path, "old").unwrap();
    let failed = write_whole(&path, |w| {
        w.write_all(b"half of the n")?;
        Err(io::Error::other("disk full"))
    });
    assert!(failed.is_err());
    assert_eq!(read(&path).unwrap(), b"old");
    assert_eq!(
        names(dir.path()),
        ["frame.png"],
        "no temporary file is left"
    );
    put(&path, "new").unwrap();
    assert_eq!(read(&path).unwrap(), b"new");
}

#[test]
fn folders_are_created_on_first_write() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a/b/frame.png");
    check(&path).unwrap();
    check_folder(&dir.path().join("c/d")).unwrap();
    assert!(names(dir.path()).is_empty(), "checking makes nothing");
    put(&path, "x").unwrap();
    assert_eq!(read(&path).unwrap(), b"x");
    let below_a_file = path.join("c/frame.png");
    check(&below_a_file).unwrap_err();
    assert!(
        check_folder(&below_a_file)
            .unwrap_err()
            .to_string()
            .contains("is no folder")
            || cfg!(not(unix))
    );
    let message = put(&below_a_file, "x").unwrap_err().to_string();
    assert!(!message.contains(".part"), "{message}");
    assert!(
        check(dir.path())
            .unwrap_err()
            .to_string()
            .contains("it is a folder")
    );
}

#[test]
fn inputs_are_refused_under_any_name() {
    let dir = tempfile::tempdir().unwrap();
    let at = |name: &str| dir.path().join(name);
    write(at("scene.obj"), "precious").unwrap();
    fs::create_dir(at("folder")).unwrap();
    fs::hard_link(at("scene.obj"), at("hard.obj")).unwrap();
    let mut others = vec![at("scene.obj"), at("hard.obj"), at("folder/../scene.obj")];
    #[cfg(unix)]
    {
        std::os::unix::fs::symlink("scene.obj", at("link.obj")).unwrap();
        others.push(at("link.obj"));
    }
    put(&at("hard.obj"), "precious").unwrap();
    fs::remove_file(at("hard.obj")).unwrap();
    fs::hard_link(at("scene.obj"), at("hard.obj")).unwrap();
    protect_input(&at("scene.obj"));
    protect_input(&at("not there"));
    for path in others {
        for refused in [check(&path), put(&path, "x")] {
            let error = refused.expect_err("refused");
            assert!(
                error.kind() == io::ErrorKind::InvalidInput && error.to_string().contains("input"),
                "{error}"
            );
        }
    }
    assert_eq!(read(at("scene.obj")).unwrap(), b"precious");
    put(&at("other.obj"), "x").unwrap();
}

/// Inodes are used again: what was an input once protects no other file that comes to have its
/// identity.
#[test]
fn deleted_input_protects_nothing() {
    let dir = tempfile::tempdir().unwrap();
    let (gone, kept) = (dir.path().join("gone.obj"), dir.path().join("kept.obj"));
    write(&gone, "x").unwrap();
    fs::hard_link(&gone, &kept).unwrap(); // the identity stays in use, as if it had been given anew
    protect_input(&gone);
    check(&kept).unwrap_err();
    fs::remove_file(&gone).unwrap();
    put(&kept, "y").unwrap();
    assert_eq!(read(&kept).unwrap(), b"y");
}

#[cfg(unix)]
mod unix {
    use super::*;
    use std::os::unix::fs::{FileTypeExt, PermissionsExt, symlink};
    use std::process::Command;

    fn mode(path: &Path) -> u32 {
        fs::metadata(path).unwrap().permissions().mode() & 0o777
    }

    #[test]
    fn permissions_kept_read_only_refused() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a.png");
        put(&path, "old").unwrap();
        fs::set_permissions(&path, Permissions::from_mode(0o640)).unwrap();
        put(&path, "new").unwrap();
        assert_eq!(mode(&path), 0o640);
        fs::set_permissions(&path, Permissions::from_mode(0o444)).unwrap();
        for refused in [check(&path), put(&path, "x")] {
            assert!(
                refused
                    .expect_err("refused")
                    .to_string()
                    .contains("read-only")
            );
        }
        assert_eq!(
            (read(&path).unwrap(), mode(&path)),
            (b"new".to_vec(), 0o444)
        );
    }

    #[test]
    fn links_are_kept_and_targets_written() {
        let dir = tempfile::tempdir().unwrap();
        let at = |name: &str| dir.path().join(name);
        fs::create_dir(at("deep")).unwrap();
        write(at("deep/there.png"), "old").unwrap();
        symlink("deep/there.png", at("a.png")).unwrap();
        symlink("a.png", at("b.png")).unwrap();
        symlink("deep/not yet/frame.png", at("c.png")).unwrap();
        symlink("e.png", at("d.png")).unwrap();
        symlink("d.png", at("e.png")).unwrap();
        put(&at("b.png"), "through two").unwrap();
        put(&at("c.png"), "into nothing").unwrap();
        assert_eq!(read(at("deep/there.png")).unwrap(), b"through two");
        assert_eq!(read(at("deep/not yet/frame.png")).unwrap(), b"into nothing");
        for link in ["a.png", "b.png", "c.png"] {
            assert!(
                at(link).symlink_metadata().unwrap().is_symlink(),
                "{link} is still a link"
            );
        }
        assert!(put(&at("d.png"), "x").is_err(), "a circle");
    }

    #[test]
    fn fifo_is_streamed_to() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("pipe");
        assert!(
            Command::new("mkfifo")
                .arg(&path)
                .status()
                .unwrap()
                .success()
        );
        assert!(is_stream(&path).unwrap());
        check(&path).unwrap();
        let reader = std::thread::spawn({
            let path = path.clone();
            move || read(path).unwrap()
        });
        put(&path, "through the pipe").unwrap();
        assert_eq!(reader.join().unwrap(), b"through the pipe");
        assert!(path.symlink_metadata().unwrap().file_type().is_fifo());
    }

    /// A character device of our own with the numbers of the null device; only root can make one.
    #[test]
    fn device_is_streamed_to() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("null");
        let made = Command::new("mknod")
            .arg(&path)
            .args(["c", "1", "3"])
            .output();
        if !made.is_ok_and(|made| made.status.success())
            || OpenOptions::new().write(true).open(&path).is_err()
        {
            eprintln!("skipped: no device can be made here");
            return;
        }
        put(&path, "into nothing").unwrap();
        assert!(
            path.symlink_metadata()
                .unwrap()
                .file_type()
                .is_char_device()
        );
        assert_eq!(names(dir.path()), ["null"]);
    }

    #[test]
    fn socket_is_refused() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("socket");
        let _socket = std::os::unix::net::UnixListener::bind(&path).unwrap();
        assert!(
            put(&path, "x")
                .unwrap_err()
                .to_string()
                .contains("never written to")
        );
    }
}
