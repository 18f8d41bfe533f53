//! Overlapping triangles in one plane: rounding decides which of them passes the depth test, so
//! each of their pixels gets the one that rays meet ([`CoplanarTriangles::resolve`]).

use super::scan::{DrawnRows, DrawnTriangle};
use super::shade::PixelShader;
use super::weights::CornerWeights;
use super::{PixelContent, SurfaceId};
use headbox_scene::coplanar::CoplanarTriangles;
use std::collections::HashMap;

impl PixelShader<'_> {
    /// Replaces the triangles of pixels by overlapping ones that were drawn there, too.
    pub(super) fn resolve_coplanar(&self, target: &mut DrawnRows) {
        let coplanar: &CoplanarTriangles = &self.mesh.coplanar;
        if coplanar.is_empty() {
            return;
        }
        let is_shared = |id: SurfaceId| match id.content() {
            PixelContent::Triangle(primitive) => coplanar.is_shared(primitive),
            _ => false,
        };
        let shared = target.drawn.iter().filter(|drawn| is_shared(drawn.id));
        let drawn: HashMap<u32, DrawnTriangle> =
            shared.map(|drawn| (drawn.id.0, drawn.clone())).collect();
        if drawn.len() < 2 {
            return;
        }
        let rows = target.surface.chunks_mut(target.width as usize);
        for (y, row) in target.rows.clone().zip(rows) {
            for (x, surface) in (0..).zip(row) {
                if drawn.contains_key(&surface.0) {
                    let id = self.resolve_pixel([x, y], *surface);
                    let is_drawn = drawn
                        .get(&id.0)
                        .is_some_and(|it| it.columns.contains(&x) && it.rows.contains(&y));
                    if is_drawn {
                        *surface = id;
                    }
                }
            }
        }
    }

    /// Returns the triangle that a ray through a pixel's centre meets in place of the drawn one.
    fn resolve_pixel(&self, [x, y]: [u32; 2], drawn: SurfaceId) -> SurfaceId {
        let PixelContent::Triangle(primitive) = drawn.content() else {
            return drawn;
        };
        let (mesh, scene) = (self.mesh, self.mesh.scene());
        let corners = mesh.corners(&mesh.triangles[primitive as usize]);
        let weights = CornerWeights::new(self.view, corners).evaluate(x, y);
        let [column, row] = [x, y].map(|pixel| f64::from(pixel) + 0.5);
        let normal = scene.geometric_normal(primitive).as_dvec3();
        let (met, ..) = mesh.coplanar.resolve(
            normal.dot(self.camera.direction(column, row)) < 0.0,
            (primitive, weights.y, weights.z),
            |primitive, [u, v]| scene.is_solid(primitive, u, v),
        );
        SurfaceId(met)
    }
}
