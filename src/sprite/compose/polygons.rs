//! Polygons among images (S25): objects too near for an image, or added to a place that was
//! captured without them.
//!
//! They are rasterised ([`headbox_raster`]) once per frame, with a depth per pixel
//! (`polygon_raster.rs`), against which cube LDIs are depth-tested.

use glam::DVec3;
use headbox_core::camera::Camera;
use headbox_core::color::tone::ToneMap;
use headbox_core::cube_face::Face;
use headbox_core::progress::Progress;
use headbox_cube::pack::CubeLdi;
use headbox_cube::render::{RenderSettings, Renderer};
use headbox_model::bake::{BakeOptions, bake_unmetered};
use headbox_raster::RasterMesh;
use headbox_scene::scene::{Scene, SceneError, Sky, SkyError, SkyPicture};
use std::ops::ControlFlow;
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};

/// Error of adding polygons to images.
#[derive(Debug, thiserror::Error)]
pub enum PolygonsError {
    /// The scene is invalid.
    #[error(transparent)]
    Scene(#[from] SceneError),
    /// The cube LDI does not yield a valid sky.
    #[error("the light about the polygons: {0}")]
    Light(#[from] SkyError),
    /// A camera for the surroundings of the polygons is invalid.
    #[error(transparent)]
    Camera(#[from] headbox_core::camera::CameraError),
}

/// Triangle model that is drawn among images.
#[derive(Debug)]
pub struct Polygons {
    pub(super) mesh: RasterMesh,
    /// Lowest and highest corner of its bounding box, world metres.
    bounds: [DVec3; 2],
    /// Tone curve of the images among which the polygons are drawn.
    pub(super) tone: ToneMap,
}

/// Number of rows of the latitude-longitude image of the surroundings.
const SURROUNDINGS_ROWS: u32 = 64;

impl Polygons {
    /// Creates polygons from a scene in world metres, without light: albedo, vertex colours and
    /// emission.
    ///
    /// # Errors
    /// [`PolygonsError::Scene`].
    pub fn new(scene: Scene) -> Result<Self, PolygonsError> {
        scene.validate()?;
        let all = 0..scene.triangles.len() as u32;
        let [low, high] = scene.bounds();
        let mesh = RasterMesh::new(
            Arc::new(scene),
            std::slice::from_ref(&all),
            (low + high) / 2.0,
        );
        Ok(Self {
            mesh,
            bounds: [low, high],
            tone: ToneMap::default(),
        })
    }

    /// Creates polygons lit by the image of a cube LDI, as seen from the middle of the polygons or
    /// from the nearest position in the headbox. They cast shadows and reflect light onto
    /// themselves, but not onto the surfaces of the cube. Radiance above the range of the cube's
    /// tone curve is clipped (at white, unless the cube was captured with `--tone hdr`), so that
    /// suns and lamps give less light than in reality. The shading of the polygons is clipped at
    /// white.
    ///
    /// # Errors
    /// [`PolygonsError`].
    pub fn lit_by(
        mut scene: Scene,
        cube: &CubeLdi,
        progress: &dyn Progress,
    ) -> Result<Self, PolygonsError> {
        scene.validate()?;
        let [low, high] = scene.bounds();
        scene.sky = Some(Sky::Picture(Arc::new(surroundings(
            cube,
            (low + high) / 2.0,
        )?)));
        scene.sun = None;
        scene.lamps.clear();
        for material in &mut scene.materials {
            material.emission = material.emission.map(|c| c * cube.info.exposure);
        }
        let reported = AtomicUsize::new(0);
        let baked = bake_unmetered(&Arc::new(scene), &BakeOptions::default(), &|done, all| {
            match reported.fetch_max(done, Ordering::Relaxed) {
                0 => progress.begin("light of the polygons", "samples", all as u64),
                before => progress.advance(done.saturating_sub(before) as u64),
            }
            if progress.is_cancelled() {
                ControlFlow::Break(())
            } else {
                ControlFlow::Continue(())
            }
        });
        Ok(Self {
            tone: cube.info.tone,
            ..Self::new(baked.scene)?
        })
    }

    /// Returns the corners of the bounding box, world metres.
    pub(super) fn corners(&self) -> impl Iterator<Item = DVec3> + use<> {
        let bounds = self.bounds;
        (0..8).map(move |i| DVec3::from_array([0, 1, 2].map(|axis| bounds[i >> axis & 1][axis])))
    }
}

/// Renders the surroundings of a position from a cube LDI, as linear radiance under its exposure.
fn surroundings(cube: &CubeLdi, place: DVec3) -> Result<SkyPicture, PolygonsError> {
    let half = DVec3::splat(cube.info.half_size_m);
    let eye = place.clamp(cube.info.centre - half, cube.info.centre + half);
    let side = SURROUNDINGS_ROWS;
    let mut renderer = Renderer::new();
    let mut faces = Vec::with_capacity(Face::ALL.len());
    for face in Face::ALL {
        let camera = Camera::from_parts(
            eye,
            face.world_from_eye(),
            f64::from(side) / 2.0,
            side,
            side,
        )?;
        faces.push(
            renderer
                .render(cube, &camera, &RenderSettings::default())
                .color
                .clone(),
        );
    }
    let texel = |i: u32| {
        let [azimuth, elevation] = [
            (f64::from(i % (2 * side)) + 0.5) / f64::from(side) * std::f64::consts::PI
                - std::f64::consts::PI,
            (0.5 - (f64::from(i / (2 * side)) + 0.5) / f64::from(side)) * std::f64::consts::PI,
        ];
        // North (-Z) is in the middle; east (+X) is to its right.
        let toward = DVec3::new(
            azimuth.sin() * elevation.cos(),
            elevation.sin(),
            -azimuth.cos() * elevation.cos(),
        );
        let face = Face::containing(toward);
        let [x, y, _] = face.project(toward, side);
        let [column, row] = [x, y].map(|at| (at as u32).min(side - 1));
        let color = faces[face.index()]
            .get((row * side + column) as usize)
            .copied()
            .unwrap_or_default();
        [color[0], color[1], color[2]].map(|level| cube.info.tone.exposed(level))
    };
    Ok(SkyPicture::new(
        [2 * side, side],
        (0..2 * side * side).map(texel).collect(),
        0.0,
    )?)
}

/// Transforms a scene: scales it about its origin, turns it about the up axis of the world, from
/// north (-Z) to east (+X), and moves its origin to `at`, world metres.
pub fn place(scene: &mut Scene, scale: f64, turn_deg: f64, at: DVec3) {
    let (sin, cos) = turn_deg.to_radians().sin_cos();
    let turned = |p: DVec3| DVec3::new(p.x * cos - p.z * sin, p.y, p.x * sin + p.z * cos);
    for position in &mut scene.positions {
        *position = turned(*position * scale) + at;
    }
    for normal in &mut scene.normals {
        *normal = turned(normal.as_dvec3()).as_vec3();
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Vec3;

    #[test]
    fn placed_is_scaled_then_turned_then_moved() {
        let mut scene = headbox_scenes::build("bump", 0).expect("built in");
        scene.positions[0] = DVec3::new(0.0, 0.5, -1.0);
        scene.normals = vec![Vec3::NEG_Z; scene.positions.len()];
        place(&mut scene, 2.0, 90.0, DVec3::new(10.0, 20.0, 30.0));
        // A quarter of a turn from north to east.
        assert!(
            (scene.positions[0] - DVec3::new(12.0, 21.0, 30.0)).length() < 1e-12,
            "{}",
            scene.positions[0]
        );
        assert!((scene.normals[0] - Vec3::X).length() < 1e-6);
    }
}
