//! `headbox demo`: what a first visitor sees.

use crate::run::succeeds;

/// Minimum lead over the cube map, dB; at the farthest eye 7 at small sizes, 12 at full ones.
const LEAD_DB: f64 = 4.0;

#[test]
fn demo_shows_that_a_cube_map_fails_off_the_centre() {
    let dir = tempfile::tempdir().unwrap();
    let printed = succeeds(dir.path(), &["demo", "--quick", "--no-window"]);
    let out = dir.path().join("headbox-demo");

    // The picture, and the time of the whole, are announced before the work.
    let order = [
        "first.png",
        " in all: capture",
        "demo.ldi",
        "ray tracer needs",
        "demo.png",
    ];
    let places: Vec<usize> = order
        .iter()
        .map(|text| {
            printed
                .to_lowercase()
                .find(text)
                .unwrap_or_else(|| panic!("{text}: {printed}"))
        })
        .collect();
    assert!(places.is_sorted(), "{printed}");

    let table = std::fs::read_to_string(out.join("table.csv")).unwrap();
    let rows: Vec<Vec<f64>> = table
        .lines()
        .skip(1)
        .map(|line| {
            line.split(',')
                .map(|value| value.parse().unwrap())
                .collect()
        })
        .collect();
    // Columns: distance, PSNR and FLIP of the frame, PSNR and FLIP of the cube map, times.
    assert!(
        rows.is_sorted_by(|a, b| a[0] < b[0]) && rows[0][0] > 0.0,
        "{table}"
    );
    for row in &rows {
        assert!(row[1] >= row[3] + LEAD_DB && row[2] < row[4], "{table}");
    }
    let picture = image::open(out.join("demo.png")).unwrap();
    let frame = image::open(out.join("frame_2.png")).unwrap();
    assert_eq!(picture.height(), frame.height());
    assert!(picture.width() > 3 * frame.width());
}
