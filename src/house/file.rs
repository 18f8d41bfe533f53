//! The `.house` file: a portal model with the backdrops behind its portals.
//!
//! Sections: `info` (JSON: a [`HouseHeader`], with a header per backdrop), the scene's arrays as in
//! memory (`positions` f64, `normals`, `texcoords` and `colors` f32, `triangles` u32, four each:
//! corners and material), `texels` (RGBA8, texture after texture), `sky` (f32, three per texel) if
//! the sky is an image, and a section per backdrop, `c` and its number: a cube's environment,
//! segments and plane textures, or textures.
//!
//! If vertices have them, there are also `emission_texcoords` and `opacities` (f32).
//!
//! Version 2 is for houses with plane textures, version 3 for houses with samplers other than the
//! default one, emission texture coordinates, opacities or single-sided materials; others are
//! written as version 1.

use super::backdrop::{
    Backdrop, BackdropKind, BackdropQuality, PortalSide, PortalSprite, TextureSet,
};
use super::house::{House, HouseError};
use super::store::{Key, Store};
use glam::{DVec2, DVec3, Vec3};
use headbox_core::container::{Container, ContainerWriter, FileError, FileKind, Section};
use headbox_core::file_frame::FileFrame;
use headbox_core::headbox::Headbox;
use headbox_core::read_note::ReadNote;
use headbox_cube::pack::CubeLdi;
use headbox_cube::pack::file::CubeHeader;
use headbox_model::{Cell, Portal, PortalModel, Prism};
use headbox_scene::material::{Cutout, Material, Sampler, Texture};
use headbox_scene::scene::{Scene, Sky, SkyGradient, SkyPicture, Sun, Triangle};
use headbox_sprite::{SpriteHeader, SpriteWithDepth};
use serde::{Deserialize, Serialize};
use std::path::Path;
use std::sync::Arc;

/// Kind of the `.house` file.
pub const HOUSE_FILE: FileKind = FileKind::HOUSE;

/// Error of reading a house.
#[derive(Debug, thiserror::Error)]
pub enum HouseFileError {
    /// The file cannot be read, or is damaged.
    #[error(transparent)]
    File(#[from] FileError),
    /// The model in the file is invalid.
    #[error("{}: {source}", path.display())]
    House {
        /// The file.
        path: std::path::PathBuf,
        /// Cause.
        source: HouseError,
    },
}

/// Content of a file except its arrays.
#[derive(Serialize, Deserialize)]
struct HouseHeader {
    name: String,
    #[serde(flatten)]
    frame: FileFrame,
    sun: Option<(Vec3, [f32; 3], f32)>,
    sky: Option<[[f32; 3]; 3]>,
    /// Size of a sky image (columns, rows) and its rotation, degrees; it replaces `sky`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    sky_picture: Option<([u32; 2], f64)>,
    headbox: Option<(DVec3, f64)>,
    notes: Vec<ReadNote>,
    positions: usize,
    normals: usize,
    texcoords: usize,
    colors: usize,
    triangles: usize,
    #[serde(default, skip_serializing_if = "is_zero")]
    emission_texcoords: usize,
    #[serde(default, skip_serializing_if = "is_zero")]
    opacities: usize,
    /// Width and height of each texture.
    textures: Vec<[u32; 2]>,
    /// Sampler of each texture; empty if all have the default one.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    samplers: Vec<Sampler>,
    materials: Vec<MaterialRecord>,
    cells: Vec<CellRecord>,
    portals: Vec<PortalRecord>,
    outside: Option<u32>,
    quality: BackdropQuality,
    captures: Vec<CaptureRecord>,
}

#[derive(Serialize, Deserialize)]
struct MaterialRecord {
    name: String,
    albedo: [f32; 3],
    albedo_texture: Option<u32>,
    emission: [f32; 3],
    emission_texture: Option<u32>,
    cutout: Option<(Option<u32>, f32)>,
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    single_sided: bool,
}

fn is_zero(count: &usize) -> bool {
    *count == 0
}

/// Returns true if a scene needs version 3.
fn needs_version_3(scene: &Scene) -> bool {
    let is_plain = |texture: &Texture| texture.sampler() == Sampler::default();
    !scene.emission_texcoords.is_empty()
        || !scene.opacities.is_empty()
        || !scene.textures.iter().all(is_plain)
        || scene.materials.iter().any(|m| m.single_sided)
}

#[derive(Serialize, Deserialize)]
struct CellRecord {
    name: String,
    /// Corners, floor, ceiling.
    space: Vec<(Vec<DVec2>, f64, f64)>,
    triangles: [u32; 2],
}

#[derive(Serialize, Deserialize)]
struct PortalRecord {
    name: String,
    cells: [u32; 2],
    polygon: Vec<DVec3>,
}

#[derive(Serialize, Deserialize)]
struct CaptureRecord {
    at: PortalSide,
    kind: BackdropKind,
    content: Content,
}

#[derive(Serialize, Deserialize)]
enum Content {
    Cubes(Vec<CubeHeader>),
    Textures { size: [u32; 2], places: Vec<DVec3> },
    Sprite(SpriteHeader),
}

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

/// Section of the sky image.
const SKY: &str = "sky";

fn section_name(number: usize) -> String {
    format!("c{number}")
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
