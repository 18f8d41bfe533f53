//! Mutated portal models, houses with their backdrops, and cached truth.

use crate::mutations::{Alone, corpus, corpus_folder, written_bytes};
use glam::{DVec3, dvec3};
use headbox_core::camera::Camera;
use headbox_core::progress::Silent;
use headbox_house::backdrop::{Backdrop, BackdropKind, BackdropQuality, PortalSide};
use headbox_house::file;
use headbox_house::house::House;
use headbox_house::settings::{Near, WalkSettings};
use headbox_house::store::Store;
use headbox_house::walk::Walker;
use headbox_lab::truths::Truths;
use headbox_model::load::{ModelOptions, load_model};
use headbox_trace::bvh::Tracer;
use headbox_trace::light::Lighting;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use tempfile::TempDir;

/// Smallest backdrops.
const TINY: BackdropQuality = BackdropQuality {
    face_px: 12,
    window_face_px: 12,
    window_back_m: 1.0,
    images: 1,
    radius_m: 1.0,
    eye_height_m: 1.5,
    texture_px: 8,
    strata: 2,
    rays: 2,
    seed: 0,
};
/// Budget of the store; no backdrop of the corpus needs more.
const BUDGET_BYTES: u64 = 64 << 20;

/// Reads a portal model with the geometry of the corpus's home, and prepares a walk if it is valid.
fn read_model(path: &Path) -> bool {
    let Ok(loaded) = load_model(path, &ModelOptions::default()) else {
        return false;
    };
    assert_eq!(
        loaded.model.scene.validate(),
        Ok(()),
        "what is loaded is sound"
    );
    House::new(loaded.model).is_ok()
}

/// Copies the home's geometry to the folder of a model, and reads the model.
fn read_beside_home(path: &Path) -> bool {
    let obj = path.with_file_name("home.obj");
    if !obj.exists() {
        std::fs::copy(corpus_folder().join("home.obj"), obj).expect("copied");
    }
    read_model(path)
}

#[test]
fn sweet_home_plans() {
    let alone = Alone::lock();
    alone.try_mutations("Home.xml", &[corpus("Home.xml")], false, read_beside_home);
}

#[test]
fn sweet_home_archives() {
    let alone = Alone::lock();
    alone.try_mutations("home.sh3d", &[corpus("home.sh3d")], false, read_beside_home);
}

#[test]
fn portal_models() {
    let alone = Alone::lock();
    alone.try_mutations("flat.toml", &[corpus("flat.toml")], false, read_beside_home);
}

/// The corpus's apartment with a backdrop of each kind of content: cubes, textures, a sprite.
fn house_bytes() -> Vec<u8> {
    let loaded =
        load_model(&corpus_folder().join("flat.toml"), &ModelOptions::default()).expect("loads");
    let house = House::new(loaded.model).expect("walkable");
    let store = Store::new(BUDGET_BYTES);
    for kind in [
        BackdropKind::WindowLdi,
        BackdropKind::Textures,
        BackdropKind::Sprite,
        BackdropKind::TwoImages,
    ] {
        for side in [0, 1] {
            let at = PortalSide { portal: 0, side };
            let backdrop = Backdrop::capture(&house, at, kind, &TINY).expect("captured");
            assert!(store.insert((at, kind), Arc::new(backdrop)), "kept");
        }
    }
    written_bytes(|path| file::write(path, &house, &store, &TINY).expect("written"))
}

/// Reads a house and renders three frames of it.
fn read_house(path: &Path) -> bool {
    let Ok((house, store, _)) = file::read(path, BUDGET_BYTES) else {
        return false;
    };
    let mut walker = Walker::new();
    for (eye, to) in [
        (dvec3(1.5, 1.5, 1.5), DVec3::X),
        (dvec3(6.5, 1.2, 2.0), DVec3::NEG_X),
        (dvec3(4.0, 1.0, 1.5), dvec3(0.3, 0.1, 1.0)),
    ] {
        let camera = Camera::look_at(eye, eye + to, DVec3::Y, 80.0, [17, 11]).expect("valid");
        for kind in [
            None,
            Some(BackdropKind::WindowLdi),
            Some(BackdropKind::Textures),
            Some(BackdropKind::Sprite),
            Some(BackdropKind::TwoImages),
        ] {
            let settings = WalkSettings {
                backdrops: kind,
                near: Near::Distance(0.5),
                persistence: true,
                ..Default::default()
            };
            walker.frame(&house, &store, &camera, &settings);
        }
    }
    true
}

#[test]
fn house_files() {
    let alone = Alone::lock();
    alone.try_mutations("a.house", &[house_bytes()], true, read_house);
}

/// A cache with one frame of truth.
struct TruthCache {
    tracer: Tracer,
    lighting: Lighting,
    camera: Camera,
    folder: TempDir,
}

impl TruthCache {
    fn new() -> Self {
        let scene = Arc::new(headbox_scenes::build("bump", 0).expect("built in"));
        let centre = scene.headbox.expect("it has one").centre;
        let tracer = Tracer::new(scene, centre);
        let lighting = Lighting::measure(&tracer, 0);
        let camera =
            Camera::look_at(centre, centre - DVec3::Z, DVec3::Y, 60.0, [5, 3]).expect("valid");
        let cached = Self {
            tracer,
            lighting,
            camera,
            folder: tempfile::tempdir().expect("a folder"),
        };
        cached.check();
        cached
    }

    /// The file of the frame.
    fn file(&self) -> PathBuf {
        let mut files = std::fs::read_dir(self.folder.path())
            .expect("there")
            .flatten();
        files.next().expect("one frame").path()
    }

    /// Requests the frame with the current content of the file.
    fn check(&self) {
        let truths = Truths::new(
            &self.tracer,
            &self.lighting,
            false,
            Some(self.folder.path().into()),
        );
        let frame = truths.frame(&self.camera, 1, &Silent).frame;
        assert_eq!(
            (frame.width, frame.height),
            (5, 3),
            "whatever the file says"
        );
        assert_eq!((frame.color.len(), frame.coverage.len()), (15, 15));
    }

    /// Requests the frame with another file in its place.
    fn check_with(&self, path: &Path) -> bool {
        std::fs::copy(path, self.file()).expect("copied");
        self.check();
        true
    }
}

#[test]
fn kept_truth() {
    let alone = Alone::lock();
    let cached = TruthCache::new();
    let original = std::fs::read(cached.file()).expect("read");
    alone.try_mutations("a.truth", &[original], true, |path| cached.check_with(path));
}

/// Files of earlier failures, and a small file of every kind, must give a valid result or an error.
#[test]
fn corpus_files_are_valid_or_errors() {
    let cached = TruthCache::new();
    let mut replayed = 0;
    for entry in std::fs::read_dir(corpus_folder())
        .expect("the corpus")
        .flatten()
    {
        let path = entry.path();
        match path.extension().and_then(|e| e.to_str()) {
            Some("xml" | "sh3d" | "toml") => drop(read_model(&path)),
            Some("house") => drop(read_house(&path)),
            Some("truth") => drop(cached.check_with(&path)),
            _ => continue,
        }
        replayed += 1;
    }
    assert!(replayed >= 6, "{replayed} files");
}
