//! Keys of `transforms.json` that describe depth: those of nerfstudio and of instant-ngp.

use crate::depth::{AssumedDepth, DepthSource};
use crate::readers::json::JsonObject;
use crate::{ImagesError, resolve};
use headbox_core::depth_kind::DepthKind;
use headbox_core::files::InputFolder;
use serde_json::Value;
use std::collections::BTreeMap;

/// Keys of a depth file: nerfstudio's and instant-ngp's.
const PATHS: [&str; 2] = ["depth_file_path", "depth_path"];

/// Metres per stored value of every depth file, as nerfstudio reads them.
const UNIT: &str = "depth_unit_scale_factor";

/// Metres per step of integer depth files, as instant-ngp reads them.
const INTEGER_UNIT: &str = "integer_depth_scale";

/// Keys about depth that change nothing here.
const WITHOUT_EFFECT: [&str; 1] = ["enable_depth_loading"];

/// Returns the depth of a frame, if it has any.
pub(super) fn read(
    folder: &InputFolder,
    root: &JsonObject,
    view: &JsonObject,
    kind: DepthKind,
) -> Result<Option<DepthSource>, ImagesError> {
    let Some(key) = PATHS.into_iter().find(|key| view.has(key)) else {
        return Ok(None);
    };
    let field = view.field_path(key);
    let path = resolve(folder, view.file, &field, view.text(key)?)?;
    let assumed = DepthSource::assumed(path, kind);
    let stated = AssumedDepth {
        unit: false,
        ..assumed.assumed
    };
    // Fields that a frame lacks are taken from the file's root.
    let find_unit = |key: &str| {
        let owner = [view, root].into_iter().find(|owner| owner.has(key));
        owner.map(|owner| read_unit(owner, key)).transpose()
    };
    Ok(Some(match (find_unit(UNIT)?, find_unit(INTEGER_UNIT)?) {
        (Some(unit_m), _) => DepthSource {
            unit_m,
            float_unit_m: unit_m,
            assumed: stated,
            ..assumed
        },
        (None, Some(unit_m)) => DepthSource {
            unit_m,
            assumed: stated,
            ..assumed
        },
        (None, None) => assumed,
    }))
}

fn read_unit(owner: &JsonObject, key: &str) -> Result<f32, ImagesError> {
    let unit_m = owner.number(key)? as f32;
    if unit_m > 0.0 && unit_m.is_finite() {
        Ok(unit_m)
    } else {
        Err(owner.error(key, "must be above 0: metres per step of depth"))
    }
}

/// Returns a note for each key about depth that is not read, with the number of frames that have
/// it.
pub(super) fn note_unknown(root: &Value) -> Vec<String> {
    let is_known = |key: &str| {
        PATHS.contains(&key) || WITHOUT_EFFECT.contains(&key) || [UNIT, INTEGER_UNIT].contains(&key)
    };
    let unknown = |value: &Value| -> Vec<String> {
        let keys = value
            .as_object()
            .into_iter()
            .flat_map(|object| object.keys());
        let about_depth = keys.filter(|key| key.to_lowercase().contains("depth") && !is_known(key));
        about_depth.cloned().collect()
    };
    let expected = format!("expected {}, {UNIT} and {INTEGER_UNIT}", PATHS.join(" or "));
    let mut notes: Vec<String> = unknown(root)
        .into_iter()
        .map(|key| format!("\"{key}\" is an unknown key of depth and ignored; {expected}"))
        .collect();
    let frames = root.get("frames").and_then(Value::as_array);
    let mut counts: BTreeMap<String, usize> = BTreeMap::new();
    for key in frames.into_iter().flatten().flat_map(unknown) {
        *counts.entry(key).or_default() += 1;
    }
    notes.extend(counts.into_iter().map(|(key, count)| {
        format!("\"{key}\" of {count} frames is an unknown key of depth and ignored; {expected}")
    }));
    notes
}
