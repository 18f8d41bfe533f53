//! Surfels: the samples of a capture as oriented surface elements in space, for formats without
//! cameras.

use glam::{DVec3, Vec3};
use headbox_core::cube_face::Face;
use headbox_cube::pack::CubeLdi;
use headbox_cube::render::footprint::rules::MAX_SLOPE;

/// Surface element of one sample.
pub(crate) struct Surfel {
    /// Position in world axes, metres from the centre of the headbox.
    pub(crate) position: DVec3,
    /// Unit normal, world axes.
    pub(crate) normal: DVec3,
    /// Offsets to the next samples of the surface, right and down on the face, metres.
    pub(crate) along: [DVec3; 2],
    /// Straight alpha.
    pub(crate) color_srgb: [u8; 4],
}

impl Surfel {
    /// Creates the surfel that a face sees in direction `d` (eye depth 1) at an inverse depth.
    pub(crate) fn new(
        face: Face,
        face_px: u32,
        d: DVec3,
        inverse_depth: f64,
        normal: DVec3,
        color_srgb: [u8; 4],
    ) -> Self {
        let pixel = 2.0 / f64::from(face_px);
        let slopes = Self::slopes(face, face_px, d, normal);
        let steps = [(face.right(), slopes[0]), (-face.up(), slopes[1])];
        Self {
            position: d / inverse_depth,
            normal,
            along: steps.map(|(step, slope)| (step * pixel - d * slope) / inverse_depth),
            color_srgb,
        }
    }

    /// Returns the relative change of inverse depth per pixel right and down on a plane that the
    /// face sees in direction `d`.
    pub(crate) fn slopes(face: Face, face_px: u32, d: DVec3, normal: DVec3) -> [f64; 2] {
        let pixel = 2.0 / f64::from(face_px);
        let most = f64::from(MAX_SLOPE) * pixel;
        // On a plane, inverse depth is proportional to n . d. `min` and `max` also turn 0 / 0 into
        // a number.
        [face.right(), -face.up()].map(|step| {
            (normal.dot(step) * pixel / normal.dot(d))
                .min(most)
                .max(-most)
        })
    }
}

/// Sample of a capture.
pub(crate) struct SurfaceSample {
    pub(crate) face: Face,
    /// Width of the face, pixels.
    pub(crate) face_px: u32,
    /// Its pixel on the face, from -1 to the width.
    pub(crate) column: i32,
    pub(crate) row: i32,
    /// [`DEPTH_PIXELS`], [`ENVIRONMENT`], or the number of a plane, from 1.
    pub(crate) surface: u32,
    /// Inverse depth, 1/m.
    pub(crate) inverse_depth: f64,
    /// Unit normal, world axes.
    pub(crate) normal: DVec3,
    /// Straight alpha.
    pub(crate) color_srgb: [u8; 4],
}

/// Surface of depth pixels.
pub(crate) const DEPTH_PIXELS: u32 = 0;

/// Surface of the environment.
pub(crate) const ENVIRONMENT: u32 = u32::MAX;

impl SurfaceSample {
    fn surfel(&self) -> Surfel {
        let (x, y) = (f64::from(self.column) + 0.5, f64::from(self.row) + 0.5);
        let d = self.face.direction(x, y, self.face_px);
        Surfel::new(
            self.face,
            self.face_px,
            d,
            self.inverse_depth,
            self.normal,
            self.color_srgb,
        )
    }
}

/// Returns the inverse depth, 1/m, for samples at infinity: so small that no eye in the headbox
/// sees them move by a face pixel.
pub(crate) fn min_inverse_depth(cube: &CubeLdi) -> f64 {
    let farthest = cube
        .segments
        .iter()
        .map(|s| s.inverse_depth(0))
        .fold(f64::INFINITY, f64::min);
    let still = (1.0 / (cube.info.half_size_m * f64::from(cube.face_size_px))).max(1.0 / 400.0);
    still.min(farthest / 1.25)
}

/// Returns the distance of the environment, metres: behind samples at infinity, to avoid z-fighting
/// with them.
pub(crate) fn environment_distance(cube: &CubeLdi) -> f64 {
    1.2 / min_inverse_depth(cube)
}

/// Converts a texel from premultiplied to straight alpha.
pub(crate) fn straight([r, g, b, a]: [u8; 4]) -> [u8; 4] {
    let divide = |c: u8| (u32::from(c) * 255 / u32::from(a).max(1)).min(255) as u8;
    [divide(r), divide(g), divide(b), a]
}

/// Iterates over the surfels of all [`surface_samples`].
pub(crate) fn surfels(cube: &CubeLdi, sky: bool) -> impl Iterator<Item = Surfel> {
    surface_samples(cube, sky).map(|sample| sample.surfel())
}

/// Iterates over all depth pixels, all texels of plane textures, and with `sky` those of the
/// environment, at a large distance.
pub(crate) fn surface_samples(cube: &CubeLdi, sky: bool) -> impl Iterator<Item = SurfaceSample> {
    let environment = sky.then(|| environment(cube)).into_iter().flatten();
    depth_pixels(cube).chain(texels(cube)).chain(environment)
}

fn depth_pixels(cube: &CubeLdi) -> impl Iterator<Item = SurfaceSample> {
    cube.segments.iter().flat_map(move |segment| {
        let pixels = (0..segment.height).flat_map(|y| (0..segment.width).map(move |x| (x, y)));
        pixels.flat_map(move |(x, y)| {
            segment.pixel(x, y).iter().map(move |pixel| {
                let found = segment.decode(cube.layout, *pixel);
                SurfaceSample {
                    face: segment.face,
                    face_px: cube.face_size_px,
                    column: (segment.x0 + x) as i32,
                    row: (segment.y0 + y) as i32,
                    surface: DEPTH_PIXELS,
                    inverse_depth: found.inverse_depth.max(f64::MIN_POSITIVE),
                    normal: found.normal,
                    color_srgb: found.color_srgb,
                }
            })
        })
    })
}

fn texels(cube: &CubeLdi) -> impl Iterator<Item = SurfaceSample> {
    let set = &cube.planes;
    let face_px = cube.face_size_px;
    let min_inverse_depth = min_inverse_depth(cube);
    let tiles = set.tiles.iter().filter_map(|tile| {
        let plane = set.planes.get(tile.plane as usize)?;
        Some((tile, plane, set.texels.get(tile.texel_range())?))
    });
    tiles.flat_map(move |(tile, plane, texels)| {
        let face = Face::ALL[usize::from(tile.face) % 6];
        let n = plane.normal_per_distance.as_dvec3();
        let [q, along_x, along_y] = plane.inverse_depth(face, face_px);
        let visible = texels.iter().enumerate().filter(|(_, texel)| texel[3] > 0);
        visible.map(move |(i, texel)| {
            let width = usize::from(tile.width);
            let column = i32::from(tile.x0) + (i % width) as i32;
            let row = i32::from(tile.y0) + (i / width) as i32;
            let (x, y) = (f64::from(column) + 0.5, f64::from(row) + 0.5);
            let outward = || face.direction(x, y, face_px).normalize();
            SurfaceSample {
                face,
                face_px,
                column,
                row,
                surface: tile.plane.saturating_add(1),
                inverse_depth: (q + along_x * x + along_y * y).max(min_inverse_depth),
                normal: -n.try_normalize().unwrap_or_else(outward),
                color_srgb: straight(*texel),
            }
        })
    })
}

fn environment(cube: &CubeLdi) -> impl Iterator<Item = SurfaceSample> {
    let size_px = cube.environment.size_px;
    let inverse_depth = 1.0 / environment_distance(cube);
    let per_face = size_px as usize * size_px as usize;
    let texels = cube.environment.texels.iter().enumerate();
    let known = texels.filter(|(_, texel)| texel[3] > 0);
    known.map(move |(i, color_srgb)| {
        let x = (i % per_face) as u32 % size_px;
        let y = (i % per_face) as u32 / size_px;
        let face = Face::ALL[(i / per_face) % 6];
        let d = face.direction(f64::from(x) + 0.5, f64::from(y) + 0.5, size_px);
        SurfaceSample {
            face,
            face_px: size_px,
            column: x as i32,
            row: y as i32,
            surface: ENVIRONMENT,
            inverse_depth,
            normal: -d.normalize(),
            color_srgb: *color_srgb,
        }
    })
}

/// Gaussian on a surface: the axes of its ellipse and the normal, orthonormal and right-handed, and
/// its two standard deviations.
pub(crate) struct Ellipse {
    pub(crate) axes: [Vec3; 3],
    pub(crate) deviations: [f32; 2],
}

impl Surfel {
    /// Returns the ellipse of a Gaussian with a standard deviation of `spacings` sample spacings:
    /// the principal axes of both steps.
    pub(crate) fn ellipse(&self, spacings: f64) -> Ellipse {
        let [a, b] = self.along;
        let first = a
            .try_normalize()
            .unwrap_or_else(|| self.normal.any_orthonormal_vector());
        let normal = a.cross(b).try_normalize().unwrap_or(self.normal);
        let second = normal.cross(first);
        // The covariance a a^T + b b^T in the plane, and the angle to its larger axis.
        let (x, y) = (b.dot(first), b.dot(second));
        let (xx, xy, yy) = (a.length_squared() + x * x, x * y, y * y);
        let angle = (2.0 * xy).atan2(xx - yy) / 2.0;
        let (mean, apart) = ((xx + yy) / 2.0, ((xx - yy) / 2.0).hypot(xy));
        let deviation = |variance: f64| (variance.max(0.0).sqrt() * spacings) as f32;
        let major = first * angle.cos() + second * angle.sin();
        let axes = [major, normal.cross(major), normal].map(|axis| axis.as_vec3());
        Ellipse {
            axes,
            deviations: [deviation(mean + apart), deviation(mean - apart)],
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::dvec3;

    #[test]
    fn ellipses_have_the_covariance_of_both_steps() {
        let along = [dvec3(0.2, 0.0, 0.1), dvec3(-0.05, 0.3, 0.02)];
        let surfel = Surfel {
            position: DVec3::ZERO,
            normal: DVec3::Z,
            along,
            color_srgb: [0; 4],
        };
        let Ellipse { axes, deviations } = surfel.ellipse(0.5);
        for probe in [
            dvec3(1.0, 0.0, 0.0),
            dvec3(0.3, -0.7, 0.2),
            dvec3(0.0, 0.1, 1.0),
        ] {
            let expected: f64 = along
                .iter()
                .map(|step| (step.dot(probe) * 0.5).powi(2))
                .sum();
            let found: f32 = (0..2)
                .map(|i| (axes[i].dot(probe.as_vec3()) * deviations[i]).powi(2))
                .sum();
            assert!(
                (f64::from(found) - expected).abs() < 1e-6,
                "{found} {expected}"
            );
        }
        assert!(
            (axes[0].cross(axes[1]) - axes[2]).length() < 1e-6,
            "right-handed"
        );
    }

    #[test]
    fn steps_stay_on_the_plane() {
        let normal = dvec3(0.3, 0.5, 0.8).normalize();
        let d = Face::NegZ.direction(10.5, 30.5, 64);
        let surfel = Surfel::new(Face::NegZ, 64, d, 0.25, normal, [0; 4]);
        assert!((surfel.position - d * 4.0).length() < 1e-12);
        surfel
            .along
            .iter()
            .for_each(|step| assert!(step.dot(normal).abs() < 1e-12));
    }
}
