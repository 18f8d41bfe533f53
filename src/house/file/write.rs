//! Writing of a `.house` file.

use super::header::{
    CaptureRecord, CellRecord, Content, HOUSE_FILE, HouseHeader, MaterialRecord, PortalRecord, SKY,
    needs_version_3, section_name,
};
use crate::backdrop::{Backdrop, BackdropQuality};
use crate::house::House;
use crate::store::{Key, Store};
use headbox_core::container::{ContainerWriter, FileError, FileKind};
use headbox_cube::pack::CubeLdi;
use headbox_model::{Cell, Portal};
use headbox_scene::material::{Material, Texture};
use headbox_scene::scene::{Scene, Sky, Triangle};
use std::path::Path;
use std::sync::Arc;

/// Writes a house and the backdrops of a store, completely or not at all.
///
/// # Errors
/// [`FileError::Io`].
pub fn write(
    path: &Path,
    house: &House,
    store: &Store,
    quality: &BackdropQuality,
) -> Result<(), FileError> {
    let captures = store.all();
    let names: Vec<String> = (0..captures.len()).map(section_name).collect();
    let scene: &Scene = house.scene();
    let header = create_header(house, quality, &captures);
    let version = if needs_version_3(scene) {
        3
    } else if captures.iter().any(|(_, backdrop)| backdrop.has_planes()) {
        2
    } else {
        1
    };
    let mut writer = ContainerWriter::new(FileKind {
        version,
        ..HOUSE_FILE
    });
    writer.section("info", move || Ok(serde_json::to_vec(&header)?));
    write_array(&mut writer, "positions", &scene.positions);
    write_array(&mut writer, "normals", &scene.normals);
    write_array(&mut writer, "texcoords", &scene.texcoords);
    write_array(&mut writer, "colors", &scene.colors);
    if !scene.emission_texcoords.is_empty() {
        write_array(&mut writer, "emission_texcoords", &scene.emission_texcoords);
    }
    if !scene.opacities.is_empty() {
        write_array(&mut writer, "opacities", &scene.opacities);
    }
    writer.section("triangles", || {
        let numbers = |t: &Triangle| [t.vertices[0], t.vertices[1], t.vertices[2], t.material];
        let triangles: Vec<_> = scene.triangles.iter().map(numbers).collect();
        Ok(bytemuck::cast_slice(&triangles).to_vec())
    });
    writer.section("texels", || {
        let texels = scene
            .textures
            .iter()
            .flat_map(|t| t.texels().as_flattened());
        Ok(texels.copied().collect())
    });
    if let Some(Sky::Picture(picture)) = &scene.sky {
        write_array(&mut writer, SKY, picture.texels());
    }
    for (name, (_, backdrop)) in names.iter().zip(&captures) {
        writer.section(name, || {
            Ok(match &**backdrop {
                Backdrop::Cubes(cubes) => cubes
                    .iter()
                    .map(CubeLdi::arrays)
                    .collect::<Vec<_>>()
                    .concat(),
                Backdrop::Textures(set) => bytemuck::cast_slice(&set.texels).to_vec(),
                Backdrop::Sprite(sprite) => sprite.sprite().arrays(),
            })
        });
    }
    writer.write(path)
}

fn create_header(
    house: &House,
    quality: &BackdropQuality,
    captures: &[(Key, Arc<Backdrop>)],
) -> HouseHeader {
    let (scene, plan) = (house.scene(), house.plan());
    let material = |m: &Material| MaterialRecord {
        name: m.name.clone(),
        albedo: m.albedo,
        albedo_texture: m.albedo_texture,
        emission: m.emission,
        emission_texture: m.emission_texture,
        cutout: m.cutout.map(|cutout| (cutout.texture, cutout.threshold)),
        single_sided: m.single_sided,
    };
    let cell = |cell: &Cell| CellRecord {
        name: cell.name.clone(),
        space: cell
            .space
            .iter()
            .map(|p| (p.outline.clone(), p.floor_y, p.ceiling_y))
            .collect(),
        triangles: [cell.triangles.start, cell.triangles.end],
    };
    let portal = |p: &Portal| PortalRecord {
        name: p.name.clone(),
        cells: p.cells,
        polygon: p.polygon.clone(),
    };
    let capture = |((at, kind), backdrop): &(Key, Arc<Backdrop>)| CaptureRecord {
        at: *at,
        kind: *kind,
        content: match &**backdrop {
            Backdrop::Cubes(cubes) => Content::Cubes(cubes.iter().map(CubeLdi::header).collect()),
            Backdrop::Textures(set) => Content::Textures {
                size: set.size,
                places: set.places.clone(),
            },
            Backdrop::Sprite(sprite) => Content::Sprite(sprite.sprite().header()),
        },
    };
    let (sky, sky_picture) = match &scene.sky {
        None => (None, None),
        Some(Sky::Gradient(sky)) => (Some([sky.zenith, sky.horizon, sky.ground]), None),
        Some(Sky::Picture(picture)) => (None, Some((picture.size(), picture.turn_deg()))),
    };
    HouseHeader {
        name: scene.name.clone(),
        frame: scene.frame,
        sun: scene
            .sun
            .map(|sun| (sun.direction, sun.irradiance, sun.angular_radius_rad)),
        sky,
        sky_picture,
        tone: scene.tone,
        headbox: scene
            .headbox
            .map(|headbox| (headbox.centre, headbox.half_size_m)),
        notes: scene.summary.notes.clone(),
        positions: scene.positions.len(),
        normals: scene.normals.len(),
        texcoords: scene.texcoords.len(),
        colors: scene.colors.len(),
        triangles: scene.triangles.len(),
        emission_texcoords: scene.emission_texcoords.len(),
        opacities: scene.opacities.len(),
        samplers: if needs_version_3(scene) {
            scene.textures.iter().map(Texture::sampler).collect()
        } else {
            Vec::new()
        },
        textures: scene
            .textures
            .iter()
            .map(|t| [t.width(), t.height()])
            .collect(),
        materials: scene.materials.iter().map(material).collect(),
        cells: plan.cells.iter().map(cell).collect(),
        portals: plan.portals.iter().map(portal).collect(),
        outside: plan.outside,
        quality: *quality,
        captures: captures.iter().map(capture).collect(),
    }
}

/// Adds a section of one array.
fn write_array<'a, T: bytemuck::NoUninit>(
    writer: &mut ContainerWriter<'a>,
    name: &'a str,
    values: &'a [T],
) {
    writer.section(name, || Ok(bytemuck::cast_slice(values).to_vec()));
}
