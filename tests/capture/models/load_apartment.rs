//! Portal model of a real home, if its files are present: from its export, and from its plan alone.

use super::homes::{cells, load};
use headbox_model::Finding;
use headbox_model::load::{LoadedModel, ModelOptions, load_model};
use headbox_trace::bvh::{Ray, Tracer};
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::Arc;

fn apartment() -> Option<PathBuf> {
    let path = Path::new(concat!(
        env!("CARGO_MANIFEST_DIR"),
        "/../shared/data/apartment"
    ));
    path.is_dir().then(|| path.to_path_buf())
}

#[test]
fn apartment_has_its_rooms_and_doors() {
    let Some(folder) = apartment() else {
        println!("skipped: no shared/data/apartment");
        return;
    };
    let LoadedModel { model, findings } =
        load_model(&folder.join("Home.xml"), &ModelOptions::default()).expect("loads");
    assert_eq!(model.scene.validate(), Ok(()));
    let names: Vec<&str> = model.cells.iter().map(|cell| cell.name.as_str()).collect();
    let rooms = [
        "Bathroom",
        "Bedroom #1",
        "Living room",
        "Room 5",
        "Kitchen",
        "Bedroom #2",
        "Bedroom #3",
        "Corridor",
    ];
    assert_eq!(names, [&rooms[..], &["Outside"]].concat());
    // 21 doors and windows, four of them in the rail of the balcony, which is outside.
    assert_eq!(model.portals.len(), 17);
    let is_coplanar = |f: &&Finding| matches!(f, Finding::Coplanar { .. });
    let others: Vec<&Finding> = findings.iter().filter(|f| !is_coplanar(f)).collect();
    assert_eq!(others.len(), 4, "{findings:?}");
    assert!(
        others
            .iter()
            .all(|f| matches!(f, Finding::SameCell { name, .. } if name == "Fixed window"))
    );
    assert!(model.reachable(0).iter().all(|reached| *reached));
    assert_eq!(model.check(), []);
    let between = |a: &str, b: &str| {
        let pair = [a, b].map(|name| names.iter().position(|n| *n == name).expect("a cell") as u32);
        model
            .portals
            .iter()
            .filter(|p| p.cells == pair || p.cells == [pair[1], pair[0]])
            .count()
    };
    assert_eq!(
        [
            between("Living room", "Corridor"),
            between("Kitchen", "Living room")
        ],
        [1, 2]
    );
    assert_eq!(
        [
            between("Living room", "Outside"),
            between("Corridor", "Outside")
        ],
        [4, 0]
    );
    // Every cell has at least its own floor, ceiling and furniture.
    assert!(model.cells.iter().all(|cell| cell.triangles.len() > 1000));

    let tracer = Tracer::new(
        Arc::new(model.scene.clone()),
        glam::DVec3::new(5.0, 1.0, 4.0),
    );
    assert_eq!(model.leaks(&tracer, 500, 1), []);
    let archive = load_model(
        &folder.join("3-BedroomApartment.sh3d"),
        &ModelOptions::default(),
    )
    .expect("loads");
    assert_eq!(cells(&archive.model), cells(&model));

    let alone = tempfile::tempdir().expect("a folder");
    fs::copy(
        folder.join("3-BedroomApartment.sh3d"),
        alone.path().join("alone.sh3d"),
    )
    .expect("copied");
    let built = load(&alone, "alone.sh3d").model;
    assert_eq!(
        (&built.portals, built.check()),
        (&model.portals, Vec::new())
    );
    let of_built = Tracer::new(Arc::new(built.scene.clone()), tracer.origin());
    assert_eq!(built.leaks(&of_built, 500, 1), []);
    // Rays from the centre of every room, with the export and without.
    let (mut same, mut all) = (0, 0);
    for cell in model.cells.iter().filter(|cell| !cell.space.is_empty()) {
        let outline = &cell.space[0].outline;
        let middle = outline.iter().sum::<glam::DVec2>() / outline.len() as f64;
        let origin = (glam::dvec3(middle.x, 1.5, middle.y) - tracer.origin()).as_vec3();
        for i in 0..2000_u32 {
            // A spiral on the sphere.
            let (y, turn) = (
                1.0 - (f64::from(i) + 0.5) / 1000.0,
                f64::from(i) * 2.399_963,
            );
            let flat = (1.0 - y * y).sqrt();
            let direction = glam::dvec3(flat * turn.cos(), y, flat * turn.sin()).as_vec3();
            let ray = Ray {
                origin,
                direction,
                t_min: 0.0,
                t_max: f32::INFINITY,
            };
            let [a, b] =
                [&tracer, &of_built].map(|tracer| tracer.closest(&ray).map_or(1e9, |hit| hit.t));
            all += 1;
            same += u32::from((a - b).abs() < 0.01 * a);
        }
    }
    println!("{same} of {all} rays meet what they meet in the export");
    assert!(same * 100 > all * SAME_PERCENT, "{same} of {all}");
}

/// Percentage of rays that hit a surface at the same distance (1 %) with an export and without.
const SAME_PERCENT: u32 = 95;
