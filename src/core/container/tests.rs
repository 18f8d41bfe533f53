use super::*;

const KIND: FileKind = FileKind::new(*b"test", "test file", 3, 3);

fn write(dir: &Path) -> PathBuf {
    let mut writer = ContainerWriter::new(KIND);
    writer.section("numbers", || {
        Ok(bytemuck::cast_slice(&[1u32, 2, 3]).to_vec())
    });
    writer.section("empty", || Ok(Vec::new()));
    let path = dir.join("a.test");
    writer.write(&path).unwrap();
    path
}

#[test]
fn sections_round_trip() {
    let dir = tempfile::tempdir().unwrap();
    let file = Container::open(&write(dir.path()), KIND).unwrap();
    let mut numbers = file.section("numbers").unwrap();
    assert_eq!(numbers.array::<u32>(3).unwrap(), [1, 2, 3]);
    numbers.end().unwrap();
    file.section("empty").unwrap().end().unwrap();
    assert!(file.section("absent").is_err() && file.stored(["numbers", "absent"]).is_err());
    let [numbers, empty] = file.stored(["numbers", "empty"]).unwrap();
    assert_eq!((numbers.count::<u32>(), numbers.count::<u64>()), (3, 1));
    assert_eq!(numbers.values::<u32>(1..3).unwrap(), [2, 3]);
    assert!(numbers.values::<u32>(1..4).is_err() && empty.values::<f32>(0..0).unwrap().is_empty());
    assert!(
        file.section("numbers")
            .unwrap()
            .array::<u64>(usize::MAX)
            .is_err(),
        "no allocation from a wild count"
    );
}

#[test]
fn stored_section_of_truncated_file_is_error() {
    let dir = tempfile::tempdir().unwrap();
    let path = write(dir.path());
    let file = Container::open(&path, KIND).unwrap();
    let [numbers] = file.stored(["numbers"]).unwrap();
    assert!(numbers.values::<u32>(0..3).is_ok());
    // Another program truncates the file while it is open.
    File::options()
        .write(true)
        .open(&path)
        .unwrap()
        .set_len(130)
        .unwrap();
    assert!(numbers.values::<u32>(0..3).is_err() && file.section("numbers").is_err());
}

#[test]
fn flipped_bits_and_truncations_are_detected() {
    let dir = tempfile::tempdir().unwrap();
    let path = write(dir.path());
    let good = std::fs::read(&path).unwrap();
    let readable = |bytes: &[u8]| {
        std::fs::write(&path, bytes).unwrap();
        let file = Container::open(&path, KIND)?;
        file.section("empty")?.end()?;
        file.section("numbers")?.array::<u32>(3)
    };
    assert!(readable(&good).is_ok());
    // Between the table and the first section, and behind its 12 bytes, there is padding up to a
    // multiple of 64.
    let padding =
        |byte: usize| (HEADER_BYTES + 2 * ENTRY_BYTES..128).contains(&byte) || byte >= 128 + 12;
    for byte in (0..good.len()).filter(|&byte| !padding(byte)) {
        for bit in 0..8 {
            let mut bad = good.clone();
            bad[byte] ^= 1 << bit;
            assert!(readable(&bad).is_err(), "bit {bit} of byte {byte}");
        }
    }
    for length in 0..128 + 12 {
        assert!(readable(&good[..length]).is_err(), "cut to {length} bytes");
    }
}

#[test]
fn errors_name_the_file_and_the_expectation() {
    let dir = tempfile::tempdir().unwrap();
    let path = write(dir.path());
    let other = FileKind {
        version: 4,
        oldest: 4,
        ..KIND
    };
    let message = Container::open(&path, other).err().unwrap().to_string();
    assert!(
        message.contains("a.test")
            && message.contains("version 3")
            && message.contains("reads version 4: create the file again"),
        "{message}"
    );
    let older = FileKind {
        version: 2,
        oldest: 1,
        ..KIND
    };
    let message = Container::open(&path, older).err().unwrap().to_string();
    assert!(message.contains("version 2: update headbox"), "{message}");
    let newer = FileKind {
        version: 4,
        oldest: 3,
        ..KIND
    };
    assert!(
        Container::open(&path, newer).is_ok(),
        "an older version is still read"
    );
    let other = FileKind {
        tag: *b"cldi",
        name: "cube LDI",
        ..KIND
    };
    let message = Container::open(&path, other).err().unwrap().to_string();
    assert!(
        message.contains("a cube LDI is expected") && message.contains("\"test\""),
        "{message}"
    );
    assert_eq!(Container::peek_kind(&path).unwrap(), Some(*b"test"));
}

#[test]
fn failing_section_leaves_no_file() {
    let dir = tempfile::tempdir().unwrap();
    let mut writer = ContainerWriter::new(KIND);
    writer.section("broken", || Err(io::Error::other("out of ideas")));
    assert!(writer.write(&dir.path().join("b.test")).is_err());
    assert_eq!(std::fs::read_dir(dir.path()).unwrap().count(), 0);
}
