//! Reading of a `.house` file.

use super::header::{
    CaptureRecord, CellRecord, Content, HOUSE_FILE, HouseFileError, HouseHeader, MaterialRecord,
    PortalRecord, SKY, section_name,
};
use crate::backdrop::{Backdrop, BackdropQuality, PortalSprite, TextureSet};
use crate::house::House;
use crate::store::Store;
use headbox_core::container::{Container, FileError, Section};
use headbox_core::headbox::Headbox;
use headbox_cube::pack::CubeLdi;
use headbox_model::{Cell, Portal, PortalModel, Prism};
use headbox_scene::material::{Cutout, Material, Texture};
use headbox_scene::scene::{Scene, Sky, SkyGradient, SkyPicture, Sun, Triangle};
use headbox_sprite::SpriteWithDepth;
use std::path::Path;
use std::sync::Arc;

/// Reads a house and its backdrops, and checks them, so that the house can be walked.
///
/// # Errors
/// See [`HouseFileError`].
pub fn read(
    path: &Path,
    budget_bytes: u64,
) -> Result<(House, Store, BackdropQuality), HouseFileError> {
    let file = Container::open(path, HOUSE_FILE)?;
    let info = file.section("info")?;
    let mut header: HouseHeader = info.json()?;
    let captures = std::mem::take(&mut header.captures);
    let quality = header.quality;
    let model = read_model(&file, &info, header)?;
    let house = House::new(model).map_err(|source| HouseFileError::House {
        path: path.into(),
        source,
    })?;
    let store = Store::new(budget_bytes);
    for (number, record) in captures.into_iter().enumerate() {
        let key = (record.at, record.kind);
        let backdrop = read_backdrop(file.section(&section_name(number))?, &info, &house, record)?;
        store.insert(key, Arc::new(backdrop));
    }
    Ok((house, store, quality))
}

/// Reads a section of one array.
fn read_array<T: bytemuck::Pod>(
    file: &Container,
    name: &str,
    count: usize,
) -> Result<Vec<T>, FileError> {
    let mut section = file.section(name)?;
    let values = section.array(count)?;
    section.end()?;
    Ok(values)
}

/// Reads a section of one array that files have only if it is not empty.
fn read_rare_array<T: bytemuck::Pod>(
    file: &Container,
    name: &str,
    count: usize,
) -> Result<Vec<T>, FileError> {
    if count == 0 {
        return Ok(Vec::new());
    }
    read_array(file, name, count)
}

fn read_sky(
    file: &Container,
    info: &Section,
    (size, turn_deg): ([u32; 2], f64),
) -> Result<Sky, FileError> {
    let count = (size[0] as usize).saturating_mul(size[1] as usize);
    let picture = SkyPicture::new(size, read_array(file, SKY, count)?, turn_deg);
    picture
        .map(|picture| Sky::Picture(Arc::new(picture)))
        .map_err(|error| info.damaged("a picture of the sky", error.to_string()))
}

fn read_model(
    file: &Container,
    info: &Section,
    header: HouseHeader,
) -> Result<PortalModel, FileError> {
    if !header.frame.is_sane() {
        return Err(info.damaged(
            "a unit between 1e-9 and 1e9 m",
            header.frame.unit_m.to_string(),
        ));
    }
    let count = header.triangles;
    let mut runs = header.cells.iter().map(|cell| cell.triangles);
    if let Some(run) = runs.find(|&[start, end]| start > end || end as usize > count) {
        return Err(info.damaged(
            format!("cells with some of {count} triangles"),
            format!("{run:?}"),
        ));
    }
    let is_cell = |&cell: &u32| (cell as usize) < header.cells.len();
    if !header.outside.iter().all(is_cell) {
        return Err(info.damaged("an outside that is a cell", format!("{:?}", header.outside)));
    }
    let triangle = |[a, b, c, material]: [u32; 4]| Triangle {
        vertices: [a, b, c],
        material,
    };
    let material = |m: MaterialRecord| Material {
        name: m.name,
        albedo: m.albedo,
        albedo_texture: m.albedo_texture,
        emission: m.emission,
        emission_texture: m.emission_texture,
        gloss: None,
        cutout: m
            .cutout
            .map(|(texture, threshold)| Cutout { texture, threshold }),
        single_sided: m.single_sided,
    };
    let mut texels = file.section("texels")?;
    let mut samplers = header.samplers.iter();
    let textures = header.textures.iter().map(|&[width, height]| {
        let sampler = samplers.next().copied().unwrap_or_default();
        let texels = texels.array((width as usize).saturating_mul(height as usize))?;
        let texture = Texture::new(width, height, texels);
        let texture = texture.map(|texture| texture.with_sampler(sampler));
        texture.ok_or_else(|| {
            info.damaged(
                "textures of at least one texel",
                format!("{width}x{height}"),
            )
        })
    });
    let textures = textures.collect::<Result<_, _>>()?;
    texels.end()?;
    let gradient = header.sky.map(|[zenith, horizon, ground]| {
        Sky::Gradient(SkyGradient {
            zenith,
            horizon,
            ground,
        })
    });
    let sky = header
        .sky_picture
        .map(|header| read_sky(file, info, header))
        .transpose()?
        .or(gradient);
    let scene = Scene {
        name: header.name,
        positions: read_array(file, "positions", header.positions)?,
        normals: read_array(file, "normals", header.normals)?,
        texcoords: read_array(file, "texcoords", header.texcoords)?,
        colors: read_array(file, "colors", header.colors)?,
        emission_texcoords: read_rare_array(file, "emission_texcoords", header.emission_texcoords)?,
        opacities: read_rare_array(file, "opacities", header.opacities)?,
        triangles: read_array(file, "triangles", count)?
            .into_iter()
            .map(triangle)
            .collect(),
        materials: header.materials.into_iter().map(material).collect(),
        textures,
        sun: header
            .sun
            .map(|(direction, irradiance, angular_radius_rad)| Sun {
                direction,
                irradiance,
                angular_radius_rad,
            }),
        sky,
        tone: header.tone,
        frame: header.frame,
        headbox: header.headbox.map(|(centre, half_size_m)| Headbox {
            centre,
            half_size_m,
        }),
        ..Scene::default()
    };
    let prism = |(outline, floor_y, ceiling_y)| Prism {
        outline,
        floor_y,
        ceiling_y,
    };
    let cell = |cell: CellRecord| Cell {
        name: cell.name,
        space: cell.space.into_iter().map(prism).collect(),
        triangles: cell.triangles[0]..cell.triangles[1],
    };
    let portal = |p: PortalRecord| Portal {
        name: p.name,
        cells: p.cells,
        polygon: p.polygon,
    };
    let mut model = PortalModel {
        scene,
        cells: header.cells.into_iter().map(cell).collect(),
        portals: header.portals.into_iter().map(portal).collect(),
        outside: header.outside,
    };
    model.scene.summary.notes = header.notes;
    Ok(model)
}

fn read_backdrop(
    mut section: Section,
    info: &Section,
    house: &House,
    record: CaptureRecord,
) -> Result<Backdrop, FileError> {
    let opening = record.at.opening(house).ok_or_else(|| {
        info.damaged(
            "captures of portals that exist",
            format!("portal {}", record.at.portal),
        )
    })?;
    let backdrop = match record.content {
        Content::Cubes(headers) => {
            let cubes = headers
                .into_iter()
                .map(|header| CubeLdi::from_arrays(header, &mut section));
            Backdrop::Cubes(cubes.collect::<Result<_, _>>()?)
        }
        Content::Sprite(header) => {
            let sprite = SpriteWithDepth::from_arrays(&header, &mut section)?;
            Backdrop::Sprite(Box::new(PortalSprite::new(sprite)))
        }
        Content::Textures { size, places } => {
            let [width, height] = size;
            let finite = places.iter().all(|place| place.is_finite());
            if width == 0 || height == 0 || places.is_empty() || !finite {
                let found = format!("{} of {width}x{height}", places.len());
                return Err(section.damaged("textures with texels and finite places", found));
            }
            let per_texture = (width as usize).saturating_mul(height as usize);
            let texels = section.array(per_texture.saturating_mul(places.len()))?;
            Backdrop::Textures(TextureSet {
                opening,
                size,
                places,
                texels,
            })
        }
    };
    section.end()?;
    Ok(backdrop)
}
