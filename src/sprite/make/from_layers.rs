//! Sprites from the planar layers of a photo sequence (S10).

use crate::{DepthImport, DisplacementFormat, SpriteError, SpritePlane, SpriteWithDepth};
use headbox_core::depth_kind::DepthKind;
use headbox_images::planar_layers::{PlanarLayer, PlanarLayers};

/// Builds a sprite from each layer, with the distances off its plane as displacements.
///
/// # Errors
/// Those of [`DepthImport::build`].
pub fn sprites_from_layers(
    layers: &PlanarLayers,
    format: DisplacementFormat,
) -> Result<Vec<SpriteWithDepth>, SpriteError> {
    let sprite = |layer: &PlanarLayer| {
        let import = DepthImport {
            color: layer.color.clone(),
            camera: layers.camera,
            depth: &layer.depth,
            depth_kind: DepthKind::EyeDepth,
            window_range_m: (0.0, 0.0),
            plane: Some(SpritePlane {
                normal: layer.normal,
                offset: layer.offset,
            }),
            format,
        };
        import.build()
    };
    layers.layers.iter().map(sprite).collect()
}
