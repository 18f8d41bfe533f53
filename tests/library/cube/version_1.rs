//! Files of version 1, older than the types of capture parameters and scene axes, stay readable,
//! except shards: `tests/version_1` has one of each kind, `tests/corpus` a house.

use headbox_core::bounces::Bounces;
use headbox_core::file_frame::{FileFrame, UpAxis};
use headbox_cube::model::parameters::MergeRule;
use headbox_cube::model::parameters::{CaptureParameters, Sampler};
use headbox_cube::pack::layout::CubeLdi;
use headbox_ldi::accumulate::shard;
use headbox_sprite::SpriteSet;
use std::path::{Path, PathBuf};

fn version_1_file(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("tests/version_1")
        .join(name)
}

/// Parameters of `--strata 3 --rays 3 --light-samples 1`.
const ASKED: CaptureParameters = CaptureParameters {
    strata: 3,
    rays_per_stratum: 3,
    bounces: Bounces::Exactly(1),
    light_samples: 1,
    seed: 0,
    novelty: 0.18,
    holes: 1.0, // nobody could ask for fewer
    sampler: Sampler::Stratified,
    merge_rule: MergeRule::Average,
};

#[test]
fn cubes() {
    let cube = CubeLdi::read(&version_1_file("cube.ldi")).expect("readable");
    assert_eq!(cube.info.scene, "builtin:miniature");
    assert_eq!(
        (cube.info.parameters, cube.info.frame),
        (ASKED, FileFrame::default())
    );
    assert_eq!(
        (
            cube.half_size(),
            cube.depth_pixel_count(),
            cube.info.rays_traced
        ),
        (0.000125, 106, 1125)
    );
}

/// Their classes had other bits.
#[test]
fn shards_are_refused() {
    let error = shard::read_info(&version_1_file("part.shard")).expect_err("refused");
    let message = error.to_string();
    assert!(message.contains("create the file again"), "{message}");
}

#[test]
fn sprites() {
    let set = SpriteSet::read(&version_1_file("picture.sprite")).expect("readable");
    assert_eq!(
        set.info.frame,
        FileFrame {
            up: UpAxis::Z,
            unit_m: 0.01
        }
    );
    assert_eq!(set.sprites().len(), 1);
}

#[test]
fn houses() {
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/corpus/a.house");
    let (house, _, _) = headbox_house::file::read(&file, u64::MAX).expect("readable");
    assert_eq!(
        house.scene().frame,
        FileFrame {
            up: UpAxis::Y,
            unit_m: 0.01
        }
    );
}

#[test]
fn current_files_have_same_names() {
    let cube = CubeLdi::read(&version_1_file("cube.ldi")).expect("readable");
    let written = serde_json::to_value(&cube.info).expect("JSON");
    for name in [
        "unit_m",
        "z_up",
        "strata",
        "rays_per_stratum",
        "novelty",
        "merge_rule",
        "bounces",
        "light_samples",
    ] {
        assert!(written.get(name).is_some(), "{name}: {written}");
    }
    let back: headbox_cube::model::info::CaptureInfo =
        serde_json::from_value(written).expect("readable");
    assert_eq!(back, cube.info);
}
