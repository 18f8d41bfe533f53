//! Page of a house: its surfaces with their light and textures, its sky, and its walkable area.
//!
//! Backdrops are left out: they replace geometry for rendering on a CPU, and a GPU that displays
//! pages can draw a whole home. The page determines visible cells itself by the rule of
//! [`headbox_house::portal_culling`] (`cells.js`), to skip the other cells' vertices.

mod chunks;
mod floors;

use super::{Content, Part, environment, png};
use crate::{ExportError, POSTER_PX, jpeg};
use chunks::{Chunk, POSITION_STEP_M};
use floors::Floor;
use glam::DVec3;
use headbox_core::camera::Camera;
use headbox_house::house::House;
use headbox_house::portal_culling::{Limits, visible_cells};
use headbox_house::settings::WalkSettings;
use headbox_house::store::Store;
use headbox_house::walk::Walker;
use headbox_model::{Cell, Portal};
use headbox_scene::material::{Material, Sampler, Texture};
use serde_json::{Value, json};
use std::collections::BTreeSet;

pub(super) const MODULES: &[&str] = &[
    include_str!("cells.js"),
    include_str!("mesh.js"),
    include_str!("place.js"),
    include_str!("shaders.js"),
    include_str!("renderer.js"),
];

/// Builds the content of a page of a house.
pub(super) fn content(house: &House, first: &Camera) -> Result<Content, ExportError> {
    let (scene, floors) = (house.scene(), floors::floors(house));
    let mut parts = Vec::new();
    if house.sky().size_px > 0 {
        parts.push(environment(house.sky()));
    }
    parts.extend(floors.iter().enumerate().map(|(number, floor)| Part {
        header: json!({"kind": "floor", "floor": number}),
        bytes: floor.free.clone(),
    }));
    let shown = first_visible_cells(house, first);
    let chunks = chunks::chunks(house);
    let used: BTreeSet<u32> = chunks.iter().flat_map(Chunk::materials).collect();
    let is_first = |chunk: &Chunk| {
        shown
            .as_ref()
            .is_none_or(|cells| cells.contains(&chunk.cell))
    };
    let (now, later): (Vec<_>, Vec<_>) = chunks.iter().partition(|chunk| is_first(chunk));
    parts.extend(now.iter().map(|chunk| mesh(chunk, false)));
    parts.extend(textures(&scene.materials, &used, &scene.textures)?);
    parts.extend(later.iter().map(|chunk| mesh(chunk, true)));
    let header = header(house, first, &floors);
    Ok(Content {
        header,
        parts,
        poster: poster(house, first)?,
        modules: MODULES,
    })
}

/// Returns the cells that are visible in the first view; `None` for all, also if culling stops at a
/// limit.
fn first_visible_cells(house: &House, first: &Camera) -> Option<BTreeSet<u32>> {
    let cell = house.find_cell(first.eye())?;
    let found = visible_cells(house.plan(), first, cell, &Limits::default(), |_, _| true);
    found
        .is_complete
        .then(|| found.views.iter().map(|view| view.cell).collect())
}

fn mesh(chunk: &Chunk, later: bool) -> Part {
    let header = json!({
        "kind": "mesh", "later": later, "cell": chunk.cell, "box": chunk.bounds, "runs": chunk.runs, "vertices": chunk.vertices,
        "triangles": chunk.triangles, "textured": chunk.textured,
    });
    Part {
        header,
        bytes: chunk.bytes.clone(),
    }
}

/// Encodes the textures of the used materials, each as a PNG file.
fn textures(
    materials: &[Material],
    used: &BTreeSet<u32>,
    all: &[Texture],
) -> Result<Vec<Part>, ExportError> {
    let materials = used
        .iter()
        .filter_map(|number| materials.get(*number as usize));
    let numbers: BTreeSet<u32> = materials
        .flat_map(|m| {
            [
                m.albedo_texture,
                m.emission_texture,
                m.cutout.and_then(|cutout| cutout.texture),
            ]
        })
        .flatten()
        .collect();
    let textures = numbers
        .into_iter()
        .filter_map(|number| Some((number, all.get(number as usize)?)));
    textures
        .map(|(number, texture)| {
            let bytes = png(texture.texels(), [texture.width(), texture.height()])?;
            let mut header = json!({"kind": "texture", "texture": number, "later": true});
            if texture.sampler() != Sampler::default() {
                header["sampler"] = json!(texture.sampler());
            }
            Ok(Part { header, bytes })
        })
        .collect()
}

fn header(house: &House, first: &Camera, floors: &[Floor]) -> Value {
    let (scene, plan, exposure) = (house.scene(), house.plan(), house.lighting().exposure);
    let origin = house.mesh().origin();
    let local = |p: DVec3| p - origin;
    let cell = |cell: &Cell| {
        let prisms = cell.space.iter().map(|prism| {
            let outline: Vec<_> = prism.outline.iter().map(|p| [p.x - origin.x, p.y - origin.z]).collect();
            json!({"outline": outline, "floor": prism.floor_y - origin.y, "ceiling": prism.ceiling_y - origin.y})
        });
        json!({"name": cell.name, "space": prisms.collect::<Vec<_>>()})
    };
    let portal = |p: &Portal| json!({"cells": p.cells, "polygon": p.polygon.iter().map(|corner| local(*corner)).collect::<Vec<_>>()});
    let material = |m: &Material| {
        let mut record = json!({
            "albedo": m.albedo.map(|c| c * exposure), "emission": m.emission.map(|c| c.max(0.0) * exposure),
            "albedoTexture": m.albedo_texture, "emissionTexture": m.emission_texture,
            "cutout": m.cutout.map(|cutout| json!([cutout.texture, cutout.threshold])),
        });
        if m.single_sided {
            record["singleSided"] = json!(true);
        }
        record
    };
    json!({
        "centre": origin,
        "frame": {"unit": scene.frame.unit_m, "zUp": bool::from(scene.frame.up)},
        "start": local(first.eye()),
        "ahead": first.forward(),
        "step": POSITION_STEP_M,
        "tone": house.lighting().tone.range(),
        "materials": scene.materials.iter().map(material).collect::<Vec<_>>(),
        "cells": plan.cells.iter().map(cell).collect::<Vec<_>>(),
        "portals": plan.portals.iter().map(portal).collect::<Vec<_>>(),
        "outside": plan.outside,
        "floors": floors.iter().map(|floor| floor.header(origin)).collect::<Vec<_>>(),
    })
}

/// Renders the first view as a JPEG file.
fn poster(house: &House, first: &Camera) -> Result<Vec<u8>, ExportError> {
    let camera = Camera::look_at(
        first.eye(),
        first.eye() + first.forward(),
        DVec3::Y,
        60.0,
        POSTER_PX,
    )?;
    jpeg(
        Walker::new()
            .frame(house, &Store::new(0), &camera, &WalkSettings::default())
            .0,
    )
}
