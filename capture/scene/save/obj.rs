//! OBJ and MTL. Positions in `f64` have as many digits as an exact round trip needs. The format has
//! neither mirrored nor uninterpolated textures, nor texture coordinates of emission, nor opacities
//! of vertices, nor single-sided materials; [`losses`] counts them.

use super::{SaveError, SavedFile, by_material, png, unique_names};
use crate::load::file_stem;
use crate::material::{Material, Texture, Wrap};
use crate::scene::Scene;
use glam::Vec2;
use std::fmt::Write;
use std::path::Path;

pub(super) fn files(scene: &Scene, path: &Path) -> Result<Vec<SavedFile>, SaveError> {
    let stem = file_stem(path);
    let picture = |index: u32| format!("{stem}_{index}.png");
    let (names, library) = (unique_names(&scene.materials), format!("{stem}.mtl"));
    let mut files = vec![
        SavedFile {
            path: path.to_path_buf(),
            bytes: geometry(scene, &names, &library).into_bytes(),
        },
        SavedFile {
            path: path.with_file_name(&library),
            bytes: materials(scene, &names, |index| {
                let wrap = scene.textures[index as usize].sampler().wrap;
                let clamp = if wrap == [Wrap::Clamp; 2] {
                    "-clamp on "
                } else {
                    ""
                };
                format!("{clamp}{}", picture(index))
            })
            .into_bytes(),
        },
    ];
    for (index, texture) in scene.textures.iter().enumerate() {
        files.push(SavedFile {
            path: path.with_file_name(picture(index as u32)),
            bytes: png(index, texture)?,
        });
    }
    Ok(files)
}

/// Returns a note for each kind of data that is left out, with its count.
pub(super) fn losses(scene: &Scene) -> Vec<String> {
    let samplers = || scene.textures.iter().map(Texture::sampler);
    let is_wrapped = |wrap: [Wrap; 2]| wrap == [Wrap::Repeat; 2] || wrap == [Wrap::Clamp; 2];
    let other_set = |(a, b): &(&Vec2, &Vec2)| a != b;
    let sets = scene.emission_texcoords.iter().zip(&scene.texcoords);
    let kinds = [
        (
            samplers()
                .filter(|sampler| !is_wrapped(sampler.wrap))
                .count(),
            "textures are mirrored, or clamped along one axis: OBJ repeats them",
        ),
        (
            samplers().filter(|sampler| sampler.nearest).count(),
            "textures have sharp texels (nearest sampling): OBJ interpolates them",
        ),
        (
            sets.filter(other_set).count(),
            "vertices have other texture coordinates for emission: OBJ has one set",
        ),
        (
            scene
                .opacities
                .iter()
                .filter(|opacity| **opacity < 1.0)
                .count(),
            "vertices have an opacity below 1: OBJ has none",
        ),
        (
            scene
                .materials
                .iter()
                .filter(|material| material.single_sided)
                .count(),
            "materials are invisible from behind: OBJ shows both sides",
        ),
    ];
    kinds
        .into_iter()
        .filter(|(count, _)| *count > 0)
        .map(|(count, what)| format!("{count} {what}"))
        .collect()
}

fn geometry(scene: &Scene, names: &[String], library: &str) -> String {
    let mut text = format!(
        "# {}, metres, Y up\nmtllib {library}\n",
        scene.name.replace(['\n', '\r'], " ")
    );
    // Writing to a string cannot fail.
    let mut add = |line: std::fmt::Arguments| _ = text.write_fmt(line);
    for (i, p) in scene.positions.iter().enumerate() {
        match scene.colors.get(i).map(|c| c.map(srgb_from_linear)) {
            Some(c) => add(format_args!(
                "v {} {} {} {} {} {}\n",
                p.x, p.y, p.z, c.x, c.y, c.z
            )),
            None => add(format_args!("v {} {} {}\n", p.x, p.y, p.z)),
        }
    }
    scene
        .texcoords
        .iter()
        .for_each(|t| add(format_args!("vt {} {}\n", t.x, t.y)));
    scene
        .normals
        .iter()
        .for_each(|n| add(format_args!("vn {} {} {}\n", n.x, n.y, n.z)));
    let (texcoords, normals) = (!scene.texcoords.is_empty(), !scene.normals.is_empty());
    for (triangles, name) in by_material(scene)
        .iter()
        .zip(names)
        .filter(|(triangles, _)| !triangles.is_empty())
    {
        add(format_args!("usemtl {name}\n"));
        for vertices in triangles {
            let [a, b, c] = vertices.map(|v| v + 1);
            match (texcoords, normals) {
                (true, true) => add(format_args!("f {a}/{a}/{a} {b}/{b}/{b} {c}/{c}/{c}\n")),
                (true, false) => add(format_args!("f {a}/{a} {b}/{b} {c}/{c}\n")),
                (false, true) => add(format_args!("f {a}//{a} {b}//{b} {c}//{c}\n")),
                (false, false) => add(format_args!("f {a} {b} {c}\n")),
            }
        }
    }
    text
}

fn materials(scene: &Scene, names: &[String], picture: impl Fn(u32) -> String) -> String {
    let mut text = String::new();
    let mut add = |line: std::fmt::Arguments| _ = text.write_fmt(line);
    for (material, name) in scene.materials.iter().zip(names) {
        let Material {
            albedo: [r, g, b],
            emission: [er, eg, eb],
            ..
        } = material;
        add(format_args!("newmtl {name}\nKd {r} {g} {b}\n"));
        // Readers ignore a colour of 0 next to a map.
        if let Some(texture) = material
            .albedo_texture
            .filter(|_| material.albedo != [0.0; 3])
        {
            add(format_args!("map_Kd {}\n", picture(texture)));
        }
        if material.emission != [0.0; 3] {
            add(format_args!("Ke {er} {eg} {eb}\n"));
            if let Some(texture) = material.emission_texture {
                add(format_args!("map_Ke {}\n", picture(texture)));
            }
        }
        if let Some(texture) = material.cutout.and_then(|cutout| cutout.texture) {
            add(format_args!("map_d {}\n", picture(texture)));
        }
    }
    text
}

/// Encodes a linear value: vertex colours are sRGB in OBJ files, linear in a scene.
fn srgb_from_linear(linear: f32) -> f32 {
    if linear <= 0.003_130_8 {
        12.92 * linear
    } else {
        1.055 * linear.powf(1.0 / 2.4) - 0.055
    }
}
