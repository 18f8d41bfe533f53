//! Files of each kind through the sources, without a window.

use super::{open, show_live, show_view};
use glam::DVec3;
use headbox_core::camera::Camera;
use headbox_core::progress::Silent;
use headbox_cube::pack::{CubeLdi, SplatIndexLayout, Split};
use headbox_fixtures::{frame_at, image_set, plane_view, saved};
use headbox_house::backdrop::BackdropQuality;
use headbox_house::house::House;
use headbox_house::store::Store;
use headbox_house::variant::HouseVariant;
use headbox_house::walk_path::WalkPath;
use headbox_images::ImageSet;
use headbox_ldi::from_images::{ImageSetCapture, NearestImages};
use headbox_ldi::scene_source::SceneSource;
use headbox_lumigraph::{CameraGrid, GridParts, LumigraphCapture, Placement};
use headbox_photos::view_geometry::view::GeometryView;
use headbox_photos::view_geometry::{
    GeometryResources, GeometrySettings, SampleGrid, ViewGeometry,
};
use headbox_sprite::{DisplacementFormat, SlabCapture, SpriteSet, capture_slabs, slabs_at_gaps};
use headbox_trace::bvh::Tracer;
use headbox_trace::light::Lighting;
use headbox_viewer::{
    Control, FrameReport, FrameRequest, FrameSource, HeadboxRequest, Navigation, Pose, Refinement,
    SettingValues,
};
use std::path::Path;
use std::sync::Arc;

const SIZE: (u32, u32) = (96, 64);

/// Renders what `source` shows from `pose` with settings given as text.
fn render(
    source: &mut dyn FrameSource,
    pose: Pose,
    settings: &[(&str, &str)],
) -> (Vec<[u8; 4]>, FrameReport) {
    let known = source.settings();
    let mut values = SettingValues::initial(&known);
    settings
        .iter()
        .for_each(|(id, text)| values.set_text(&known, id, text).unwrap());
    let camera = pose.camera(SIZE.0, SIZE.1).unwrap();
    let request = FrameRequest {
        camera,
        settings: Arc::new(values),
        moving: false,
        complete: false,
        depth: false,
    };
    let mut pixels = vec![[1, 2, 3, 4]; (SIZE.0 * SIZE.1) as usize];
    let report = source.render(&request, &mut pixels).unwrap();
    (pixels, report)
}

/// Polls a live capture until it shows more than points; every frame must report its progress.
fn first_round(source: &mut dyn FrameSource) {
    let start = source.start_pose();
    loop {
        let (pixels, report) = render(source, start, &[]);
        assert!(pixels.iter().all(|pixel| pixel[3] == 255));
        if figure(&report, "depth pixels").is_some() {
            return;
        }
        assert!(report.ongoing.is_some() && report.refinement != Refinement::Done);
        std::thread::yield_now();
    }
}

fn figure(report: &FrameReport, name: &str) -> Option<f64> {
    report
        .figures
        .iter()
        .find(|f| f.name == name)
        .map(|f| f.value)
}

#[test]
fn live_capture_saves_and_compares() {
    let dir = tempfile::tempdir().unwrap();
    let mut source = open("builtin:miniature").unwrap();
    let start = source.start_pose();
    assert!(source.bounds().unwrap().contains(start.eye));
    first_round(&mut *source);
    let file = dir.path().join("miniature.ldi");
    let said = source.save("save", &file).unwrap();
    assert!(
        said.contains("miniature.ldi") && said.ends_with(" px."),
        "{said}"
    );
    assert!(source.save("nonsense", &file).is_err());
    drop(source);

    let mut saved = open(file.to_str().unwrap()).unwrap();
    assert_eq!(saved.start_pose().eye, start.eye);
    let (plain, report) = render(&mut *saved, start, &[]);
    assert_eq!(report.refinement, Refinement::Done);
    let (other, _) = render(&mut *saved, start, &[("kernel", "paper")]);
    assert!(plain != other, "the kernel counts");
    assert!(
        plain.iter().all(|p| p[3] == 255),
        "no pixel keeps what was there"
    );

    for same in [("clip", "off"), ("threads", "1")] {
        assert!(render(&mut *saved, start, &[same]).0 == plain, "{same:?}");
    }
    let overlays = [
        "holes",
        "coverage",
        "depth",
        "layer",
        "face",
        "segment",
        "footprint",
        "overdraw",
        "clipping",
    ];
    for overlay in overlays {
        let (painted, report) = render(&mut *saved, start, &[("overlay", overlay)]);
        assert!(painted != plain && !report.legend.is_empty(), "{overlay}");
    }
    let (_, report) = render(&mut *saved, start, &[("overlay", "overdraw")]);
    let [mean, most] =
        ["draws a pixel, mean", "draws a pixel, most"].map(|name| figure(&report, name).unwrap());
    assert!(mean >= 1.0 && most >= mean, "{mean}, {most}");
    let parts =
        ["face+x", "face-x", "face+y", "face-y", "face+z", "face-z"].map(|face| (face, "off"));
    assert!(figure(&render(&mut *saved, start, &parts).1, "depth pixels") == Some(0.0));
    let aside = Pose {
        eye: start.eye - 0.5 * saved.bounds().unwrap().half_size.x * start.forward(),
        ..start
    };
    let marked = render(&mut *saved, aside, &[("epipole", "on")]).0;
    assert!(
        marked != render(&mut *saved, aside, &[]).0,
        "seen from behind, the centre is marked"
    );

    let (mut judged, mut report) = render(&mut *saved, start, &[("overlay", "error")]);
    while report.refinement != Refinement::Done {
        std::thread::yield_now();
        (judged, report) = render(&mut *saved, start, &[("overlay", "error")]);
    }
    let [flip, psnr_db] = ["FLIP", "PSNR"].map(|name| figure(&report, name).unwrap());
    // A coarse capture of a simple scene: far from perfect, but far from another image.
    assert!(
        flip > 0.0 && flip < 0.5 && psnr_db > 15.0,
        "FLIP {flip}, PSNR {psnr_db} dB"
    );
    assert!(judged != plain);
}

#[test]
fn captured_place_is_shown_and_not_captured_again() {
    let mut source = open("builtin:miniature").unwrap();
    first_round(&mut *source);
    let bounds = source.bounds().unwrap();
    let half_size_m = bounds.half_size.x;
    let mut capture = |centre: DVec3| {
        let request = HeadboxRequest::Capture {
            centre,
            half_size_m,
        };
        let said = source.request_headbox(request).unwrap();
        (said, source.headboxes().unwrap().bounds.len())
    };
    let (said, count) = capture(bounds.centre);
    assert!(said.contains("captured already") && count == 1, "{said}");
    let (said, count) = capture(bounds.centre + DVec3::X * half_size_m);
    assert!(said.starts_with("Capturing") && count == 2, "{said}");
}

#[test]
fn headbox_is_captured_again_in_changed_light() {
    let dir = tempfile::tempdir().unwrap();
    let file = dir.path().join("miniature.ldi");
    let mut source = open("builtin:miniature").unwrap();
    first_round(&mut *source);
    let start = source.start_pose();
    let low_sun = [("sun-elevation", "10"), ("sun-strength", "1")];
    loop {
        let (_, report) = render(&mut *source, start, &low_sun);
        assert!(
            figure(&report, "depth pixels").is_some(),
            "no gap between lights"
        );
        assert!(report.refinement != Refinement::Done, "not captured again");
        let said = source.save("save", &file).unwrap();
        let saved = CubeLdi::read(&file).unwrap().info.light;
        if let Some(sun) = saved.sun {
            assert!(sun.to_string().ends_with(",10"), "{sun}");
            assert!(
                saved.sun_strength.is_some() && said.ends_with(" px."),
                "{said}"
            );
            break;
        }
        assert!(said.contains("before the latest change"), "{said}");
        std::thread::sleep(std::time::Duration::from_millis(50));
    }
}

#[test]
fn sprites_are_shown_and_orbited() {
    let dir = tempfile::tempdir().unwrap();
    let file = dir.path().join("layers.sprite");
    write_sprites(&file);
    let mut source = open(file.to_str().unwrap()).unwrap();
    let start = source.start_pose();
    let Navigation::Orbit { pivot, nearest } = source.navigation() else {
        panic!("sprites are orbited")
    };
    assert!(nearest > 0.0 && start.forward().dot((pivot - start.eye).normalize()) > 0.999);
    let (front, report) = render(&mut *source, start, &[]);
    assert!(figure(&report, "pixels covered").unwrap() > 50.0);
    let aside = Pose::looking_at(
        start.eye + DVec3::X * 0.2 * start.eye.distance(pivot),
        pivot,
        start.fov_y_deg,
    );
    let (tilted, _) = render(&mut *source, aside, &[]);
    let (flat, _) = render(
        &mut *source,
        aside,
        &[
            ("variant", "homography"),
            ("sampling", "nearest"),
            ("fill", "0"),
        ],
    );
    assert!(front != tilted && tilted != flat);
}

/// Writes the built-in scene of layers as sprites.
fn write_sprites(file: &Path) {
    let scene = Arc::new(SceneSource::new("builtin:sprites").open().unwrap());
    let eye = scene.headbox.unwrap().centre;
    let tracer = Tracer::new(scene, eye);
    let lighting = Lighting::unmetered(&tracer, 0);
    let camera = Camera::look_at(eye, eye + DVec3::NEG_Z, DVec3::Y, 60.0, [128, 96]).unwrap();
    let slabs = slabs_at_gaps(&tracer, &camera, 4);
    let format = DisplacementFormat::I16;
    let capture = SlabCapture {
        tracer: &tracer,
        lighting: &lighting,
        lit: false,
        samples: 4,
        format,
    };
    let sprites = capture_slabs(&capture, &camera, &slabs, &Silent).unwrap();
    SpriteSet::new(sprites).write(file).unwrap();
}

/// Writes a plain house without backdrops, in a file that requests the coarsest ones.
fn write_house(file: &Path) -> House {
    let house = House::new(headbox_scenes::house(3, 0)).unwrap();
    let quality = BackdropQuality {
        face_px: 16,
        window_face_px: 16,
        texture_px: 16,
        images: 1,
        strata: 3,
        rays: 2,
        ..BackdropQuality::default()
    };
    headbox_house::file::write(file, &house, &Store::new(0), &quality).unwrap();
    house
}

fn pose_from_camera(camera: &Camera) -> Pose {
    Pose::looking_at(camera.eye(), camera.eye() + camera.forward(), 60.0)
}

#[test]
fn house_is_walked_between_rooms() {
    let dir = tempfile::tempdir().unwrap();
    let file = dir.path().join("bare.house");
    let house = write_house(&file);
    let mut source = open(file.to_str().unwrap()).unwrap();
    assert_eq!(
        (source.navigation(), source.bounds()),
        (Navigation::Walk, None)
    );
    let start = source.start_pose();
    let first = house.find_cell(start.eye).unwrap();
    let model = house.plan();
    let floor = model.cells[first as usize].space[0].floor_y;
    assert!(
        Some(first) != model.outside && (start.eye.y - floor - 1.6).abs() < 1e-9,
        "{start:?} in cell {first}"
    );
    let plan = source.plan().unwrap();
    let here = plan
        .room_at(start.eye)
        .map(|room| plan.rooms[room].name.as_str());
    assert_eq!(
        (here, plan.openings.len()),
        (
            Some(model.cells[first as usize].name.as_str()),
            model.portals.len()
        )
    );

    let mut cells = std::collections::BTreeSet::new();
    for camera in (WalkPath {
        poses: 24,
        ..WalkPath::default()
    })
    .cameras(&house)
    .unwrap()
    {
        let (pixels, report) = render(&mut *source, pose_from_camera(&camera), &[]);
        let cell = house.find_cell(camera.eye());
        let name = cell.map_or("in a wall", |cell| model.cells[cell as usize].name.as_str());
        assert!(
            report.facts.iter().any(|fact| fact.text.starts_with(name)),
            "{name}: {:?}",
            report.facts
        );
        assert_eq!(report.refinement, Refinement::Done);
        let colors: std::collections::BTreeSet<_> = pixels.iter().collect();
        assert!(
            colors.len() > 20,
            "{camera:?} sees {} colours",
            colors.len()
        );
        assert!(
            pixels.iter().all(|pixel| pixel[3] == 255),
            "a closed house has no holes"
        );
        cells.insert(cell);
    }
    assert!(cells.len() > 5, "{cells:?}");
}

#[test]
fn built_in_house_is_lit_later() {
    let mut source = open("builtin:house").unwrap();
    assert_eq!(source.navigation(), Navigation::Walk);
    let (start, plan) = (source.start_pose(), source.plan().unwrap());
    let here = plan.rooms[plan.room_at(start.eye).unwrap()].name.clone();
    let (_, report) = render(&mut *source, start, &[]);
    assert!(
        report.facts[0].text.starts_with(&here),
        "{here}: {:?}",
        report.facts
    );
    // Dropping the source does not wait for the running light bake.
    assert!(matches!(report.refinement, Refinement::Later(_)));
}

/// Renders frames of a path like the window and like the command line.
#[test]
fn path_frames_match_command_line() {
    let dir = tempfile::tempdir().unwrap();
    let mut source = open("builtin:miniature").unwrap();
    first_round(&mut *source);
    let (file, path) = (
        dir.path().join("miniature.ldi"),
        dir.path().join("path.json"),
    );
    source.save("save", &file).unwrap();
    let mut source = open(file.to_str().unwrap()).unwrap();
    let (start, frame) = (source.start_pose(), source.file_frame());
    let poses = [0.0, 0.1, 0.2].map(|turn| start.turned(turn, -turn));
    let record = |pose: &Pose| {
        headbox_scene::camera_path::CameraRecord::new(
            pose.eye,
            pose.forward(),
            DVec3::Y,
            pose.fov_y_deg,
            &frame,
        )
    };
    let record = headbox_scene::camera_path::PathRecord {
        size: Some([SIZE.0, SIZE.1]),
        poses: poses.iter().map(record).collect(),
    };
    std::fs::write(&path, serde_json::to_string(&record).unwrap()).unwrap();
    let cube = CubeLdi::read(&file).unwrap();
    let cameras = headbox_scene::camera_path::read(&path, &frame, 30.0).unwrap();
    let (mut renderer, settings) = (
        headbox_cube::render::Renderer::new(),
        headbox_cube::render::RenderSettings::default(),
    );
    for (i, pose) in poses.into_iter().enumerate() {
        let written = &renderer.render(&cube, &cameras[i], &settings).color;
        let shown: Vec<u8> = render(&mut *source, pose, &[])
            .0
            .into_iter()
            .flatten()
            .collect();
        let differing = shown
            .iter()
            .zip(written.iter().flatten())
            .filter(|(a, b)| a != b)
            .count();
        // A pose is converted to degrees and a look-at point: the last bit of a direction may
        // change a sample's rounding.
        assert!(
            differing < shown.len() / 1000,
            "pose {i}: {differing} of {} bytes",
            shown.len()
        );
    }
}

#[test]
fn every_house_variant_shows_backdrops() {
    let dir = tempfile::tempdir().unwrap();
    let file = dir.path().join("bare.house");
    write_house(&file);
    let mut source = open(file.to_str().unwrap()).unwrap();
    let start = source.start_pose();
    let Control::Choice { options, selected } = source.settings().remove(0).control else {
        panic!("a choice")
    };
    assert_eq!(
        (options.len(), selected),
        (HouseVariant::ALL.len(), 0),
        "geometry first: the file has nothing else"
    );
    let (geometry, _) = render(&mut *source, start, &[("variant", "geometry")]);
    for variant in &options {
        let settings = [("variant", variant.as_str())];
        let (mut pixels, mut report) = render(&mut *source, start, &settings);
        while report.refinement != Refinement::Done {
            std::thread::yield_now();
            (pixels, report) = render(&mut *source, start, &settings);
        }
        let [portals, missing] =
            ["portals as backdrops", "backdrops missing"].map(|name| figure(&report, name));
        assert_eq!(
            (portals > Some(0.0), missing),
            (variant != "geometry", Some(0.0)),
            "{variant}"
        );
        assert_eq!(pixels != geometry, variant != "geometry", "{variant}");
        let holes = figure(&report, "hole pixels").unwrap();
        assert!(
            holes < 0.2 * pixels.len() as f64,
            "{variant}: {holes} holes"
        );
    }
    let settings = [("variant", "window-ldi"), ("overlay", "backdrops")];
    let overlaid = render(&mut *source, start, &settings).0;
    let grey = overlaid
        .iter()
        .filter(|&&[r, g, b, _]| r == g && g == b)
        .count();
    assert!(
        grey > 0 && grey < overlaid.len(),
        "geometry is grey, backdrops are not"
    );
}

#[test]
fn lumigraph_starts_at_its_cameras() {
    let dir = tempfile::tempdir().unwrap();
    let file = dir.path().join("a.lumi");
    let scene = Arc::new(SceneSource::new("builtin:bump").open().unwrap());
    let origin = scene.headbox.unwrap().centre;
    let tracer = Tracer::new(scene, origin);
    let lighting = Lighting::measure(&tracer, 0);
    let parts = GridParts {
        origin,
        world_from_eye: glam::DMat3::IDENTITY,
        columns: CameraGrid::even_positions(3, 1.0),
        rows: CameraGrid::even_positions(3, 1.0),
        focal_px: 60.0,
        // As wide as the frames below: nothing is known outside of the images.
        size_px: [96, 64],
        convergence: 0.3,
    };
    let capture = LumigraphCapture {
        tracer: &tracer,
        lighting: &lighting,
        lit: false,
        samples: 2,
    };
    let raw = capture
        .run(&CameraGrid::new(parts).unwrap(), &Silent)
        .unwrap();
    raw.layered(100, Placement::Uniform)
        .unwrap()
        .write(&file)
        .unwrap();
    let mut source = open(file.to_str().unwrap()).unwrap();
    let start = source.start_pose();
    assert!(
        start.eye == origin
            && start.forward().distance(DVec3::NEG_Z) < 1e-9
            && source.speed_m_per_s() >= 1.0
    );
    let (colors, report) = render(&mut *source, start, &[]);
    let layers = |report: &FrameReport| figure(report, "layers after merging").unwrap();
    assert!(layers(&report) < 30.0 && figure(&report, "pixels covered") == Some(100.0));
    let (unmerged, all) = render(&mut *source, start, &[("merge", "0")]);
    assert!(
        layers(&all) > 60.0 && unmerged != colors,
        "{}",
        layers(&all)
    );
    assert!(render(&mut *source, start, &[("skip", "off")]).0 == colors);
    let mut seen = vec![colors];
    for overlay in ["layer", "merged layers", "camera"] {
        let (pixels, _) = render(&mut *source, start, &[("overlay", overlay)]);
        assert!(!seen.contains(&pixels), "{overlay}");
        seen.push(pixels);
    }
}

#[test]
fn damaged_house_is_refused() {
    let dir = tempfile::tempdir().unwrap();
    let file = dir.path().join("damaged.house");
    std::fs::write(&file, "not a house").unwrap();
    let message = open(file.to_str().unwrap()).err().unwrap().to_string();
    assert!(
        message.contains("damaged.house") && !message.contains('\n'),
        "{message}"
    );
}

#[test]
fn image_folder_is_shown() {
    let eyes = [DVec3::ZERO, DVec3::X * 0.2, DVec3::Y * 0.2];
    let views = eyes.map(|eye| plane_view(eye, 3.0, [96, 64]));
    let folder = tempfile::tempdir().unwrap();
    let on_disk: Vec<_> = views
        .iter()
        .enumerate()
        .map(|(i, view)| saved(view, folder.path(), &i.to_string()))
        .collect();
    let set = image_set(folder.path(), &on_disk);
    let resources = GeometryResources {
        grid: SampleGrid::default(),
        budget: 1 << 30,
        cache: None,
    };
    let geometry = ViewGeometry::open(
        &set,
        &on_disk.iter().collect::<Vec<_>>(),
        &resources,
        &Silent,
    )
    .unwrap();
    let start = frame_at(DVec3::new(0.05, 0.05, 0.0), [96, 64]);
    let mut source = show_view(
        Box::new(GeometryView::new(
            geometry,
            &start,
            GeometrySettings::default(),
        )),
        folder.path(),
    );
    assert!(source.title().ends_with("(view-dependent geometry)"));
    let pose = source.start_pose();
    let (blended, report) = render(&mut *source, pose, &[]);
    assert_eq!(
        (report.refinement, figure(&report, "cameras used")),
        (Refinement::Done, Some(3.0))
    );
    assert!(blended.iter().all(|pixel| pixel[3] == 255));
    assert!(
        blended != render(&mut *source, pose, &[("texturing", "geometry-nearest")]).0,
        "what textures counts"
    );
    let (_, one) = render(&mut *source, pose, &[("cameras", "1")]);
    assert_eq!(figure(&one, "cameras used"), Some(1.0));
    let mut painted = vec![blended];
    for overlay in ["holes", "camera", "owners", "mesh", "age"] {
        let (pixels, report) = render(&mut *source, pose, &[("overlay", overlay)]);
        assert!(
            !painted.contains(&pixels) && !report.legend.is_empty(),
            "{overlay}"
        );
        assert!(pixels.iter().all(|pixel| pixel[3] == 255));
        painted.push(pixels);
    }
    let away = Pose::looking_at(pose.eye, pose.eye + DVec3::Z, 60.0);
    let (_, report) = render(&mut *source, away, &[]);
    assert!(
        report
            .facts
            .iter()
            .any(|fact| fact.text.contains("none of the 3 cameras")),
        "{:?}",
        report.facts
    );
}

/// Renders until the refinement is done.
fn settled(
    source: &mut dyn FrameSource,
    pose: Pose,
    settings: &[(&str, &str)],
) -> (Vec<[u8; 4]>, FrameReport) {
    loop {
        let (pixels, report) = render(source, pose, settings);
        if report.refinement == Refinement::Done {
            return (pixels, report);
        }
        std::thread::yield_now();
    }
}

/// Images of a plane from cameras one metre apart.
fn six_images(folder: &Path) -> ImageSet {
    let view = |i: u32| {
        saved(
            &plane_view(DVec3::X * f64::from(i), 3.0, [96, 64]),
            folder,
            &format!("image {i}"),
        )
    };
    image_set(folder, &(0..6).map(view).collect::<Vec<_>>())
}

#[test]
fn cubes_of_the_nearest_images_follow_the_eye() {
    let folder = tempfile::tempdir().unwrap();
    let set = six_images(folder.path());
    let near =
        || NearestImages::new(set.clone(), ImageSetCapture::suggest(&set), usize::MAX).unwrap();
    let start = frame_at(DVec3::X * 0.2, [SIZE.0, SIZE.1]);
    let mut source = show_live(near(), folder.path(), &start).unwrap();
    assert!(source.bounds().is_none() && source.start_pose().eye == start.eye());
    let made_of = |report: &FrameReport| {
        report
            .facts
            .iter()
            .find(|fact| fact.name == "made of")
            .unwrap()
            .text
            .clone()
    };
    let (_, report) = settled(source.as_mut(), source_pose(0.2), &[]);
    assert_eq!(made_of(&report), "image 0, image 1, image 2");
    // The last cube is shown while the next is built.
    let (_, report) = render(source.as_mut(), source_pose(4.6), &[("images", "2")]);
    assert!(report.refinement != Refinement::Done || made_of(&report) == "image 5, image 4");
    let (pixels, report) = settled(source.as_mut(), source_pose(4.6), &[("images", "2")]);
    assert_eq!(made_of(&report), "image 5, image 4");
    let (mut expected, camera) = (near(), source_pose(4.6).camera(SIZE.0, SIZE.1).unwrap());
    let chosen = expected.nearest(&camera, 2);
    let ldi = expected.cube(&chosen).unwrap();
    let cube = CubeLdi::pack(&ldi, SplatIndexLayout::Normal, Split::Auto).unwrap();
    let mut renderer = headbox_cube::render::Renderer::new();
    assert!(pixels == renderer.render(&cube, &camera, &Default::default()).color);
}

#[test]
fn vanished_image_reported_once() {
    let folder = tempfile::tempdir().unwrap();
    let set = six_images(folder.path());
    // Only the data used last stay in memory.
    let near = NearestImages::new(set.clone(), ImageSetCapture::suggest(&set), 0).unwrap();
    let start = frame_at(DVec3::ZERO, [SIZE.0, SIZE.1]);
    let mut source = show_live(near, folder.path(), &start).unwrap();
    std::fs::remove_file(&set.views[5].color).unwrap();
    let values = SettingValues::initial(&source.settings());
    let camera = source_pose(5.0).camera(SIZE.0, SIZE.1).unwrap();
    let request = FrameRequest {
        camera,
        settings: Arc::new(values),
        moving: false,
        complete: false,
        depth: false,
    };
    let mut pixels = vec![[0; 4]; (SIZE.0 * SIZE.1) as usize];
    let error = loop {
        match source.render(&request, &mut pixels) {
            Err(error) => break error,
            Ok(_) => std::thread::yield_now(),
        }
    };
    assert!(error.contains("image 5.png"), "{error}");
    let report = source.render(&request, &mut pixels).unwrap();
    assert_eq!(report.refinement, Refinement::Done);
    assert!(
        report
            .facts
            .iter()
            .any(|fact| fact.text == "image 0, image 1, image 2")
    );
}

/// Pose on the X axis that looks down -Z.
fn source_pose(x: f64) -> Pose {
    Pose::looking_at(DVec3::X * x, DVec3::new(x, 0.0, -1.0), 60.0)
}

#[test]
fn depth_in_the_middle_is_reported_on_request() {
    let folder = tempfile::tempdir().unwrap();
    let near = NearestImages::new(
        six_images(folder.path()),
        ImageSetCapture::suggest(&six_images(folder.path())),
        NearestImages::DEFAULT_BUDGET,
    )
    .unwrap();
    let start = frame_at(DVec3::ZERO, [96, 64]);
    let mut source = show_live(near, folder.path(), &start).unwrap();
    let pose = source.start_pose();
    let mut depth_m = |depth: bool| {
        let camera = pose.camera(400, 300).unwrap();
        let request = FrameRequest {
            camera: camera.cropped(200..208, 150..158).unwrap(),
            settings: Arc::new(SettingValues::initial(&source.settings())),
            moving: true,
            complete: false,
            depth,
        };
        source.render(&request, &mut [[0; 4]; 64]).unwrap().depth_m
    };
    assert_eq!(depth_m(false), None);
    // The plane of the images is 3 m away, and stored in steps of inverse depth.
    let depth_m = depth_m(true).unwrap();
    assert!((depth_m - 3.0).abs() < 0.03, "{depth_m} m");
}
