//! Writes scenes for other programs: OBJ with MTL and textures, and GLB.
//!
//! [`crate::load`] reads back the same triangles with the same colours, in the order of their
//! materials. Neither format stores the sun and the sky. Positions are world metres, Y up.

mod glb;
mod obj;

use crate::load::extension_of;
use crate::material::{Material, Texture};
use crate::scene::Scene;
use image::ImageEncoder;
use image::codecs::png::PngEncoder;
use std::collections::HashSet;
use std::path::{Path, PathBuf};

/// A file to be written.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SavedFile {
    /// Path of the file.
    pub path: PathBuf,
    /// Content of the file.
    pub bytes: Vec<u8>,
}

/// Error of saving a scene.
#[derive(Debug, thiserror::Error)]
pub enum SaveError {
    /// The extension is not that of a supported format.
    #[error("{0}: a scene is saved as .obj or .glb")]
    Format(PathBuf),
    /// The scene is invalid.
    #[error(transparent)]
    Scene(#[from] crate::scene::SceneError),
    /// A texture could not be written as PNG.
    #[error("texture {index} could not be written as PNG: {cause}")]
    Texture {
        /// Index into [`Scene::textures`].
        index: usize,
        /// The error of the encoder.
        cause: image::ImageError,
    },
    /// The file would be larger than the format allows.
    #[error("it takes {0} bytes, and a GLB file holds at most 4 GB")]
    TooLarge(usize),
    /// The container could not be written.
    #[error("GLB could not be written: {0}")]
    Glb(String),
}

/// Encodes a scene as files without writing them; the one named `path` is first. An `.obj` has an
/// `.mtl` and one PNG per texture next to it, a `.glb` is a single file.
///
/// # Errors
/// See [`SaveError`].
pub fn scene_files(scene: &Scene, path: &Path) -> Result<Vec<SavedFile>, SaveError> {
    scene.validate()?;
    match extension_of(path).as_str() {
        "obj" => obj::files(scene, path),
        "glb" => Ok(vec![SavedFile {
            path: path.to_path_buf(),
            bytes: glb::bytes(scene)?,
        }]),
        _ => Err(SaveError::Format(path.to_path_buf())),
    }
}

/// Returns a note for each kind of data that [`scene_files`] leaves out, because the format of
/// `path` lacks it.
pub fn losses(scene: &Scene, path: &Path) -> Vec<String> {
    let mut losses = match extension_of(path).as_str() {
        "obj" => obj::losses(scene),
        _ => Vec::new(),
    };
    let is_glossy = |material: &&Material| material.gloss.is_some();
    let glossy = scene.materials.iter().filter(is_glossy).count();
    if glossy > 0 {
        losses.push(format!(
            "{glossy} materials are glossy: they are saved as matt"
        ));
    }
    losses
}

fn png(index: usize, texture: &Texture) -> Result<Vec<u8>, SaveError> {
    let mut bytes = Vec::new();
    let (texels, color) = (
        texture.texels().as_flattened(),
        image::ExtendedColorType::Rgba8,
    );
    let written =
        PngEncoder::new(&mut bytes).write_image(texels, texture.width(), texture.height(), color);
    written.map_err(|cause| SaveError::Texture { index, cause })?;
    Ok(bytes)
}

/// Returns a unique name without white space for each material.
fn unique_names(materials: &[Material]) -> Vec<String> {
    let mut taken = HashSet::new();
    let name = |(index, material): (usize, &Material)| {
        let mut name = material
            .name
            .replace(|c: char| c.is_whitespace() || c.is_control(), "_");
        if name.is_empty() {
            name = format!("material_{index}");
        }
        if taken.contains(&name) {
            name += &format!("_{index}");
        }
        taken.insert(name.clone());
        name
    };
    materials.iter().enumerate().map(name).collect()
}

/// Returns the vertex indices of the triangles of each material, in the order of the scene.
fn by_material(scene: &Scene) -> Vec<Vec<[u32; 3]>> {
    let mut all = vec![Vec::new(); scene.materials.len()];
    scene
        .triangles
        .iter()
        .for_each(|triangle| all[triangle.material as usize].push(triangle.vertices));
    all
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::load::{LoadOptions, load};
    use crate::material::{Cutout, Gloss, Sampler, Wrap};
    use crate::scene::Triangle;
    use glam::{DVec3, Vec2, Vec3, dvec3};

    /// Two materials with textures, one of them with a cut-out from another texture; emission above
    /// 1; vertex colours; far from the origin.
    fn scene() -> Scene {
        let at = dvec3(1e6, -3.25, 17.0);
        let corner = |i: u32| at + dvec3(f64::from(i % 3), f64::from(i / 3), 0.1 * f64::from(i));
        let painted =
            |seed: u8| Texture::from_fn(8, 8, |x, y| [30 * x as u8, 30 * y as u8, seed, 255]);
        let holes = Texture::from_fn(8, 8, |x, y| {
            [9, 9, 9, if (x + y) % 3 == 0 { 0 } else { 255 }]
        });
        let lamp = Material {
            name: "a lamp".into(),
            emission: [9.0, 5.0, 0.0],
            ..Material::default()
        };
        let leaf = Material {
            name: "a lamp".into(),
            albedo: [0.25, 0.5, 0.125],
            albedo_texture: Some(0),
            cutout: Some(Cutout {
                texture: Some(2),
                threshold: 0.5,
            }),
            ..Material::default()
        };
        let screen = Material {
            name: "screen".into(),
            albedo_texture: Some(1),
            emission: [0.5; 3],
            emission_texture: Some(1),
            ..Material::default()
        };
        Scene {
            name: "all there is".into(),
            positions: (0..9).map(corner).collect(),
            normals: (0..9)
                .map(|i| Vec3::new(0.1 * i as f32, 0.2, 1.0).normalize())
                .collect(),
            texcoords: (0..9)
                .map(|i| Vec2::new(0.13 * i as f32, 1.5 - 0.21 * i as f32))
                .collect(),
            colors: (0..9)
                .map(|i| Vec3::new(0.1 * i as f32, 0.5, 1.0))
                .collect(),
            triangles: [[0, 1, 3], [1, 4, 3], [3, 4, 6], [4, 7, 6], [1, 2, 4]]
                .into_iter()
                .zip([0, 1, 0, 2, 1])
                .map(|(vertices, material)| Triangle { vertices, material })
                .collect(),
            materials: vec![lamp, leaf, screen],
            textures: vec![painted(1), painted(200), holes],
            ..Scene::default()
        }
    }

    /// Corners of a triangle; albedo, emission, normal and opacity at an inner point.
    type TriangleAttributes = ([DVec3; 3], [f32; 3], [f32; 3], Vec3, bool);

    /// Returns the appearance of each triangle, sorted by material.
    fn appearance(scene: &Scene) -> Vec<TriangleAttributes> {
        let mut order: Vec<u32> = (0..scene.triangles.len() as u32).collect();
        order.sort_by_key(|&i| scene.triangles[i as usize].material);
        order
            .into_iter()
            .map(|i| {
                let surface = scene.surface(i, 0.31, 0.27);
                (
                    scene.corners(i),
                    surface.albedo,
                    surface.emission,
                    surface.shading_normal,
                    scene.is_solid(i, 0.31, 0.27),
                )
            })
            .collect()
    }

    #[test]
    fn losses_of_obj_are_counted() {
        let mut scene = scene();
        let [obj, glb] = ["a.obj", "a.glb"].map(Path::new);
        assert_eq!(losses(&scene, obj), [""; 0]);
        let sampler = |wrap, nearest| Sampler { wrap, nearest };
        let samplers = [
            sampler([Wrap::Mirror; 2], false),
            sampler([Wrap::Clamp, Wrap::Repeat], true),
            sampler([Wrap::Clamp; 2], false),
        ];
        for (texture, sampler) in scene.textures.iter_mut().zip(samplers) {
            *texture = texture.with_sampler(sampler);
        }
        scene.emission_texcoords = scene.texcoords.clone();
        scene.emission_texcoords[3].x += 1.0;
        scene.opacities = vec![1.0; 9];
        scene.opacities[..2].fill(0.75);
        scene.materials[0].single_sided = true;
        let found = losses(&scene, obj);
        let starts = [
            "2 textures are mirrored",
            "1 textures have sharp texels",
            "1 vertices have other texture coordinates",
            "2 vertices have an opacity",
            "1 materials are invisible from behind",
        ];
        assert_eq!(found.len(), starts.len(), "{found:?}");
        for (note, start) in found.iter().zip(starts) {
            assert!(note.starts_with(start), "{note}");
        }
        assert_eq!(losses(&scene, glb), [""; 0]);
        scene.materials[1].gloss = Some(Gloss {
            reflectance: [0.1; 3],
            exponent: 9.0,
        });
        let matt = ["1 materials are glossy: they are saved as matt"];
        assert_eq!(losses(&scene, glb), matt);
    }

    #[test]
    fn saved_scene_round_trips() {
        let (scene, folder) = (scene(), tempfile::tempdir().expect("a folder"));
        let expected = appearance(&scene);
        for (name, count, off_m) in [("far.obj", 5, 0.0), ("far.glb", 1, 1e-6)] {
            let path = folder.path().join(name);
            let files = scene_files(&scene, &path).expect("saved");
            assert_eq!(files.len(), count, "{name}");
            files
                .iter()
                .for_each(|file| std::fs::write(&file.path, &file.bytes).expect("written"));
            let read = load(&path, &LoadOptions::default()).expect("read back");
            assert_eq!(read.summary.notes, Vec::<String>::new(), "{name}");
            let found = appearance(&read);
            assert_eq!(found.len(), expected.len(), "{name}");
            for (a, b) in found.iter().zip(&expected) {
                assert!(
                    (0..3).all(|i| a.0[i].distance(b.0[i]) <= off_m),
                    "{name}: {:?} for {:?}",
                    a.0,
                    b.0
                );
                let near = |a: [f32; 3], b: [f32; 3]| {
                    (0..3).all(|c| (a[c] - b[c]).abs() < 2e-5 * b[c].max(1.0))
                };
                assert!(
                    near(a.1, b.1) && near(a.2, b.2) && a.3.distance(b.3) < 1e-5,
                    "{name}: {a:?} for {b:?}"
                );
                assert_eq!(a.4, b.4, "{name}: what is there");
            }
        }
        assert!(matches!(
            scene_files(&scene, Path::new("scene.stl")),
            Err(SaveError::Format(_))
        ));
        assert!(matches!(
            scene_files(&Scene::default(), Path::new("a.obj")),
            Err(SaveError::Scene(_))
        ));
    }

    #[test]
    fn glb_keeps_samplers_opacities_sides_and_emission_texcoords() {
        let mut scene = scene();
        let sampler = Sampler {
            wrap: [Wrap::Mirror, Wrap::Clamp],
            nearest: true,
        };
        scene.textures[1] = scene.textures[1].with_sampler(sampler);
        scene.emission_texcoords = (0..9).map(|i| Vec2::splat(0.07 * i as f32)).collect();
        scene.opacities = (0..9).map(|i| 1.0 - 0.1 * i as f32).collect();
        scene.materials[1].single_sided = true;
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("a.glb");
        let files = scene_files(&scene, &path).expect("saved");
        std::fs::write(&path, &files[0].bytes).expect("written");
        let read = load(&path, &LoadOptions::default()).expect("read back");
        let material = |name: &str| {
            let found = read.materials.iter().find(|material| material.name == name);
            found.expect("kept")
        };
        assert!(!material("screen").single_sided);
        assert!(read.materials.iter().any(|material| material.single_sided));
        let screen = material("screen").albedo_texture.expect("kept");
        assert_eq!(read.textures[screen as usize].sampler(), sampler);
        for (a, b) in appearance(&read).iter().zip(&appearance(&scene)) {
            let near = |a: [f32; 3], b: [f32; 3]| {
                (0..3).all(|c| (a[c] - b[c]).abs() < 2e-5 * b[c].max(1.0))
            };
            assert!(near(a.1, b.1) && near(a.2, b.2), "{a:?} for {b:?}");
            assert_eq!(a.4, b.4, "what is there");
        }
    }
}
