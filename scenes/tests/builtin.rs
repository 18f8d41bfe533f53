//! Every built-in scene is valid, reproducible, and leaves its suggested headbox free.

use glam::DVec3;
use headbox_scene::scene::Scene;

/// Returns true if a triangle overlaps the axis-aligned cube of half-size `half` about the origin:
/// there is no separating axis among the three of the cube, the triangle's normal, and the nine
/// cross products of their edges (Akenine-Moeller 2001).
fn overlaps([a, b, c]: [DVec3; 3], half: f64) -> bool {
    let edges = [b - a, c - b, a - c];
    let normal = edges[0].cross(edges[1]);
    let products = edges
        .iter()
        .flat_map(|edge| DVec3::AXES.map(|axis| axis.cross(*edge)));
    DVec3::AXES
        .into_iter()
        .chain([normal])
        .chain(products)
        .all(|axis| {
            let places = [a, b, c].map(|p| p.dot(axis));
            let reach = half * axis.abs().element_sum();
            let low = places.into_iter().fold(f64::INFINITY, f64::min);
            let high = places.into_iter().fold(f64::NEG_INFINITY, f64::max);
            low <= reach && high >= -reach
        })
}

/// Number of triangles in the suggested headbox grown by `margin` on all sides.
fn intruders(scene: &Scene, margin: f64) -> usize {
    let headbox = scene
        .headbox
        .expect("every built-in scene suggests a headbox");
    let half = headbox.half_size_m + margin;
    let corners = |t| scene.corners(t).map(|p| p - headbox.centre);
    (0..scene.triangles.len() as u32)
        .filter(|&t| overlaps(corners(t), half))
        .count()
}

/// A hash of everything that the geometry consists of.
fn fingerprint(scene: &Scene) -> u64 {
    let positions = scene
        .positions
        .iter()
        .flat_map(|p| p.to_array())
        .map(f64::to_bits);
    let triangles = scene
        .triangles
        .iter()
        .flat_map(|t| t.vertices.into_iter().chain([t.material]))
        .map(u64::from);
    let texels = scene
        .textures
        .iter()
        .flat_map(|t| t.texels())
        .map(|&texel| u64::from(u32::from_le_bytes(texel)));
    let all = positions.chain(triangles).chain(texels);
    all.fold(0, |hash, value| {
        (hash.rotate_left(7_u32) ^ value).wrapping_mul(0x2545_F491_4F6C_DD1D)
    })
}

#[test]
fn overlap_test_finds_all_contacts() {
    let triangle = |z: f64| {
        [
            DVec3::new(-9.0, -9.0, z),
            DVec3::new(9.0, -9.0, z),
            DVec3::new(0.0, 9.0, z),
        ]
    };
    assert!(
        overlaps(triangle(0.99), 1.0),
        "cuts through without a corner inside"
    );
    assert!(!overlaps(triangle(1.01), 1.0));
    let beyond_a_corner = [
        DVec3::new(3.1, 0.0, 0.0),
        DVec3::new(0.0, 3.1, 0.0),
        DVec3::new(0.0, 0.0, 3.1),
    ];
    assert!(!overlaps(beyond_a_corner, 1.0), "only the normal separates");
    assert!(overlaps(beyond_a_corner.map(|p| p * 0.9), 1.0));
}

#[test]
fn scenes_are_valid_with_free_headbox() {
    for builtin in headbox_scenes::all() {
        let scene = builtin.build(1);
        assert_eq!(scene.validate(), Ok(()), "{}", builtin.name);
        assert_eq!(scene.name, builtin.name);
        assert_eq!(
            intruders(&scene, 0.0),
            0,
            "{}: the headbox is not free",
            builtin.name
        );
        assert!(
            scene
                .normals
                .iter()
                .all(|n| n.length() < 1e-6 || (n.length() - 1.0).abs() < 1e-5),
            "{}",
            builtin.name
        );
        let flat = (0..scene.triangles.len() as u32).filter(|&t| {
            let [a, b, c] = scene.corners(t);
            (b - a).cross(c - a) == DVec3::ZERO
        });
        assert_eq!(flat.count(), 0, "{}: triangles without area", builtin.name);
    }
}

#[test]
fn scenes_depend_on_seed_only() {
    for builtin in headbox_scenes::all() {
        let [once, again, other] = [7, 7, 8].map(|seed| fingerprint(&builtin.build(seed)));
        assert_eq!(once, again, "{}", builtin.name);
        let is_seeded = !["edge-on", "contact"].contains(&builtin.name);
        assert_eq!(
            once != other,
            is_seeded,
            "{}: whether the seed matters",
            builtin.name
        );
    }
}

#[test]
fn tree_has_documented_leaves() {
    let tree = headbox_scenes::build("tree", 3).expect("built in");
    let leaf = tree
        .materials
        .iter()
        .position(|m| m.name == "leaf")
        .expect("has leaves");
    let leaves = tree
        .triangles
        .iter()
        .filter(|t| t.material as usize == leaf)
        .count();
    assert!(leaves >= 400_000, "{leaves}");
}

#[test]
fn hard_cases_have_documented_sizes() {
    let scene = |name| headbox_scenes::build(name, 1).expect("built in");
    let contact = scene("contact");
    assert_eq!(intruders(&contact, 0.000_99), 0);
    // Six panels of two triangles; at a margin of 1.01 mm all of them are reached.
    assert_eq!(intruders(&contact, 0.001_01), 12);

    let edge_on = scene("edge-on");
    let planes = edge_on
        .triangles
        .iter()
        .enumerate()
        .filter(|(_, t)| edge_on.materials[t.material as usize].name == "blade");
    let distances: Vec<f64> = planes
        .map(|(i, _)| {
            let [a, b, c] = edge_on.corners(i as u32);
            (b - a).cross(c - a).normalize().dot(a).abs()
        })
        .collect();
    assert_eq!(distances.len(), 48);
    assert!(
        distances.iter().all(|&d| d < 1e-15),
        "the planes contain the centre: {distances:?}"
    );

    let [low, high] = scene("far-offset").bounds();
    assert!(low.abs().min_element() > 9.9e4 && (high - low).max_element() < 10.0);
    let [low, high] = scene("miniature").bounds();
    assert!(
        ((high - low).max_element() - 1e-3).abs() < 1e-12,
        "{:?}",
        high - low
    );
}

#[test]
fn interior_has_textures_lamp_and_windows() {
    let interior = headbox_scenes::build("interior", 1).expect("built in");
    assert!(interior.textures.len() >= 10, "{}", interior.textures.len());
    assert!(interior.materials.iter().any(|m| m.emission != [0.0; 3]));
    assert!(interior.sun.is_some() && interior.sky.is_some());
}
