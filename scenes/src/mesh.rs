//! The mesh of a scene under construction, and its basic shapes.

use glam::{DMat3, DVec2, DVec3, Vec2, Vec3};
use headbox_core::headbox::Headbox;
use headbox_scene::material::{Gloss, Material, Texture};
use headbox_scene::scene::{Scene, Sky, Sun, Triangle};
use std::f64::consts::{FRAC_PI_2, TAU};

/// A vertex of a shape, world metres.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Vertex {
    pub(crate) position: DVec3,
    /// Normal, zero for flat shading.
    pub(crate) normal: DVec3,
    pub(crate) texcoord: DVec2,
    /// Factor of the albedo, linear RGB.
    pub(crate) color: [f64; 3],
}

impl Vertex {
    pub(crate) fn new(position: DVec3, normal: DVec3, texcoord: DVec2) -> Self {
        Self {
            position,
            normal,
            texcoord,
            color: [1.0; 3],
        }
    }
}

/// Tessellation of shapes.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Fineness {
    /// Maximum length of a cell of flat faces and tubes, metres.
    pub(crate) edge_m: f64,
    /// Factor of the number of sides of round shapes.
    pub(crate) round: f64,
}

impl Default for Fineness {
    /// Returns the coarsest tessellation: flat shapes undivided, round shapes with their nominal
    /// number of sides.
    fn default() -> Self {
        Self {
            edge_m: f64::INFINITY,
            round: 1.0,
        }
    }
}

/// A scene under construction.
#[derive(Debug, Default)]
pub(crate) struct Mesh {
    scene: Scene,
    /// Tessellation of the shapes that are added next.
    pub(crate) fineness: Fineness,
    /// Number of triangles of [`Self::add_grid`], if they are only counted.
    counted: Option<usize>,
}

impl Mesh {
    /// Creates a mesh that only counts the triangles of its grids.
    pub(crate) fn counting(fineness: Fineness) -> Self {
        Self {
            fineness,
            counted: Some(0),
            ..Self::default()
        }
    }

    /// Returns the number of triangles.
    pub(crate) fn triangle_count(&self) -> usize {
        self.counted.unwrap_or(self.scene.triangles.len())
    }

    /// Returns the number of cells along a flat edge of the given length, metres.
    pub(crate) fn cells(&self, length: f64) -> usize {
        (length / self.fineness.edge_m).ceil().clamp(1.0, 4096.0) as usize
    }

    /// Returns the number of sides of a round shape with the nominal number `sides`.
    pub(crate) fn sides(&self, sides: usize) -> usize {
        (sides as f64 * self.fineness.round).round().max(3.0) as usize
    }

    fn add_material(&mut self, material: Material) -> u32 {
        self.scene.materials.push(material);
        self.scene.materials.len() as u32 - 1
    }

    /// Adds a material of one colour, linear RGB.
    pub(crate) fn plain(&mut self, name: &str, albedo: [f32; 3]) -> u32 {
        self.add_material(Material {
            name: name.into(),
            albedo,
            ..Material::default()
        })
    }

    /// Adds a material with a texture.
    pub(crate) fn textured(&mut self, name: &str, texture: Texture) -> u32 {
        self.scene.textures.push(texture);
        self.add_material(Material {
            name: name.into(),
            albedo: [1.0; 3],
            albedo_texture: Some(self.scene.textures.len() as u32 - 1),
            ..Material::default()
        })
    }

    /// Adds a material that emits `emission` (linear RGB radiance).
    pub(crate) fn emissive(&mut self, name: &str, emission: [f32; 3]) -> u32 {
        self.add_material(Material {
            name: name.into(),
            albedo: [0.8; 3],
            emission,
            ..Material::default()
        })
    }

    /// Makes a material glossy, with a reflectance and a Phong exponent.
    pub(crate) fn glossy(&mut self, material: u32, reflectance: f32, exponent: f32) {
        self.scene.materials[material as usize].gloss = Some(Gloss {
            reflectance: [reflectance; 3],
            exponent,
        });
    }

    pub(crate) fn add_vertex(&mut self, vertex: Vertex) -> u32 {
        let scene = &mut self.scene;
        scene.positions.push(vertex.position);
        scene.normals.push(vertex.normal.as_vec3());
        scene.texcoords.push(vertex.texcoord.as_vec2());
        scene
            .colors
            .push(Vec3::from(vertex.color.map(|c| c as f32)));
        scene.positions.len() as u32 - 1
    }

    pub(crate) fn add_triangle(&mut self, vertices: [u32; 3], material: u32) {
        self.scene.triangles.push(Triangle { vertices, material });
    }

    /// Adds a grid of `columns` by `rows` cells over `vertex(column, row)`, counter-clockwise if
    /// columns go right and rows go up. Triangles with two equal corners (at a pole) are left out.
    pub(crate) fn add_grid(
        &mut self,
        columns: usize,
        rows: usize,
        material: u32,
        vertex: impl Fn(usize, usize) -> Vertex,
    ) {
        if let Some(counted) = &mut self.counted {
            *counted += 2 * columns * rows;
            return;
        }
        let mut indices = Vec::with_capacity((columns + 1) * (rows + 1));
        for row in 0..=rows {
            for column in 0..=columns {
                indices.push(self.add_vertex(vertex(column, row)));
            }
        }
        let at = |column: usize, row: usize| indices[row * (columns + 1) + column];
        for row in 0..rows {
            for column in 0..columns {
                let [a, b] = [at(column, row), at(column + 1, row)];
                let [d, c] = [at(column, row + 1), at(column + 1, row + 1)];
                for triangle in [[a, b, c], [a, c, d]] {
                    let [p, q, r] = triangle.map(|v| self.scene.positions[v as usize]);
                    if p != q && q != r && r != p {
                        self.add_triangle(triangle, material);
                    }
                }
            }
        }
    }

    /// Adds a flat rectangle from `corner` along two edges; its front is on the side of `right x
    /// up`. One period of the texture is `tile` metres; zero stretches it over the rectangle.
    pub(crate) fn add_rectangle(
        &mut self,
        corner: DVec3,
        right: DVec3,
        up: DVec3,
        tile: f64,
        material: u32,
    ) {
        let normal = right.cross(up).normalize_or_zero();
        let size = if tile > 0.0 {
            DVec2::new(right.length(), up.length()) / tile
        } else {
            DVec2::ONE
        };
        let (columns, rows) = (self.cells(right.length()), self.cells(up.length()));
        self.add_grid(columns, rows, material, |column, row| {
            let at = DVec2::new(column as f64 / columns as f64, row as f64 / rows as f64);
            Vertex::new(corner + right * at.x + up * at.y, normal, at * size)
        });
    }

    /// Adds a box about `centre`, rotated by `world_from_box`, with its front outside.
    pub(crate) fn add_box(
        &mut self,
        centre: DVec3,
        half: DVec3,
        world_from_box: DMat3,
        tile: f64,
        material: u32,
    ) {
        for axis in 0..3 {
            for side in [-1.0, 1.0] {
                // The texture is upright on the four sides.
                let (right_axis, up_axis) = [(2, 1), (0, 2), (0, 1)][axis];
                let direction = |axis: usize| world_from_box.col(axis) * half[axis];
                let (normal, up) = (direction(axis) * side, direction(up_axis));
                let right = direction(right_axis);
                let right = if right.cross(up).dot(normal) < 0.0 {
                    -right
                } else {
                    right
                };
                self.add_rectangle(
                    centre + normal - right - up,
                    right * 2.0,
                    up * 2.0,
                    tile,
                    material,
                );
            }
        }
    }

    /// Adds an axis-aligned box between two opposite corners.
    pub(crate) fn add_block(
        &mut self,
        low: impl Into<DVec3>,
        high: impl Into<DVec3>,
        tile: f64,
        material: u32,
    ) {
        let (low, high) = (low.into(), high.into());
        self.add_box(
            (low + high) / 2.0,
            (high - low) / 2.0,
            DMat3::IDENTITY,
            tile,
            material,
        );
    }

    /// Adds a tube along `path` (centre and radius at each step), open at both ends. The texture
    /// goes once around and repeats every `tile` metres along the path.
    pub(crate) fn add_tube(
        &mut self,
        path: &[(DVec3, f64)],
        sides: usize,
        tile: f64,
        material: u32,
    ) {
        let Some(&(start, _)) = path.first() else {
            return;
        };
        let sides = self.sides(sides);
        let path = self.subdivide(path);
        let direction = |i: usize| {
            (path[(i + 1).min(path.len() - 1)].0 - path[i.saturating_sub(1)].0).normalize_or_zero()
        };
        // Parallel transport of the frame, so that the tube does not twist.
        let mut across = direction(0).any_orthonormal_vector();
        let mut frames = Vec::with_capacity(path.len());
        let (mut along, mut previous) = (0.0, start);
        for (i, &(centre, _)) in path.iter().enumerate() {
            let forward = direction(i);
            across = across
                .reject_from(forward)
                .try_normalize()
                .unwrap_or(across);
            along += centre.distance(previous);
            previous = centre;
            frames.push((across, forward.cross(across), along / tile));
        }
        self.add_grid(sides, path.len() - 1, material, |column, row| {
            let (x_axis, y_axis, v) = frames[row];
            let u = column as f64 / sides as f64;
            let (sin, cos) = (u * TAU).sin_cos();
            let normal = x_axis * cos + y_axis * sin;
            Vertex::new(path[row].0 + normal * path[row].1, normal, DVec2::new(u, v))
        });
    }

    /// Subdivides the steps of a path.
    fn subdivide(&self, path: &[(DVec3, f64)]) -> Vec<(DVec3, f64)> {
        let mut fine: Vec<_> = path.first().copied().into_iter().collect();
        for step in path.windows(2) {
            let [(a, thin), (b, thick)] = [step[0], step[1]];
            let cells = self.cells(a.distance(b));
            fine.extend(
                (1..cells)
                    .map(|i| i as f64 / cells as f64)
                    .map(|s| (a.lerp(b, s), thin + (thick - thin) * s)),
            );
            fine.push((b, thick));
        }
        fine
    }

    /// Adds a box with soft edges, for cushions and mattresses: a superellipsoid of exponent 8 over
    /// the cells of a box.
    pub(crate) fn add_cushion(
        &mut self,
        centre: DVec3,
        half: DVec3,
        world_from_box: DMat3,
        tile: f64,
        material: u32,
    ) {
        const EXPONENT: i32 = 8;
        let cells = half
            .to_array()
            .map(|h| self.cells(2.0 * h).max(self.sides(8)));
        for axis in 0..3 {
            for side in [-1.0, 1.0] {
                let (right, up) = ((axis + 1) % 3, (axis + 2) % 3);
                let (columns, rows) = (cells[right], cells[up]);
                self.add_grid(columns, rows, material, |column, row| {
                    // Columns are reversed on one side, so that the front is outside on both.
                    let across = side * (2.0 * column as f64 / columns as f64 - 1.0);
                    let along = 2.0 * row as f64 / rows as f64 - 1.0;
                    let mut on_box = DVec3::ZERO;
                    (on_box[axis], on_box[right], on_box[up]) = (side, across, along);
                    let norm = on_box
                        .to_array()
                        .map(|c| c.powi(EXPONENT))
                        .iter()
                        .sum::<f64>();
                    let place = on_box / norm.powf(1.0 / f64::from(EXPONENT));
                    let normal = world_from_box
                        * (DVec3::from(place.to_array().map(|c| c.powi(EXPONENT - 1))) / half);
                    let texcoord = DVec2::new(across * half[right], along * half[up]) / tile;
                    Vertex::new(
                        centre + world_from_box * (place * half),
                        normal.normalize_or_zero(),
                        texcoord,
                    )
                });
            }
        }
    }

    /// Adds a vertical cylinder with a disk at each end.
    pub(crate) fn add_cylinder(
        &mut self,
        base: DVec3,
        radius: f64,
        height: f64,
        sides: usize,
        material: u32,
    ) {
        let top = base + DVec3::Y * height;
        self.add_tube(&[(base, radius), (top, radius)], sides, 1.0, material);
        for (centre, normal) in [(base, DVec3::NEG_Y), (top, DVec3::Y)] {
            self.add_disk(centre, radius, normal, sides, material);
        }
    }

    /// Adds a horizontal disk whose front is on the side of `normal` (up or down).
    pub(crate) fn add_disk(
        &mut self,
        centre: DVec3,
        radius: f64,
        normal: DVec3,
        sides: usize,
        material: u32,
    ) {
        let sides = self.sides(sides);
        self.add_grid(sides, 1, material, |column, row| {
            let turn = column as f64 / sides as f64 * TAU * normal.y.signum();
            let rim = DVec3::new(turn.cos(), 0.0, -turn.sin()) * radius * (1 - row) as f64;
            Vertex::new(centre + rim, normal, DVec2::new(rim.x, rim.z))
        });
    }

    /// Adds a sphere.
    pub(crate) fn add_ball(&mut self, centre: DVec3, radius: f64, sides: usize, material: u32) {
        self.add_sphere(centre, radius, -FRAC_PI_2, FRAC_PI_2, sides, material);
    }

    /// Adds a zone of a sphere between the latitudes `from` and `to`, radians.
    pub(crate) fn add_sphere(
        &mut self,
        centre: DVec3,
        radius: f64,
        from: f64,
        to: f64,
        sides: usize,
        material: u32,
    ) {
        let sides = self.sides(sides);
        let rows = (sides / 2).max(1);
        self.add_grid(sides, rows, material, |column, row| {
            let texcoord = DVec2::new(column as f64 / sides as f64, row as f64 / rows as f64);
            let longitude = texcoord.x * TAU;
            let latitude = from + (to - from) * texcoord.y;
            // The poles are exact, so that triangles without area are detected.
            let is_pole = (row == rows && to >= FRAC_PI_2) || (row == 0 && from <= -FRAC_PI_2);
            let rim = if is_pole { 0.0 } else { latitude.cos() };
            let normal = DVec3::new(
                longitude.cos() * rim,
                latitude.sin(),
                -longitude.sin() * rim,
            );
            Vertex::new(centre + normal * radius, normal, texcoord)
        });
    }

    /// Returns the finished scene with the default sun and sky, and a headbox.
    pub(crate) fn finish(self, name: &str, centre: DVec3, half_size_m: f64) -> Scene {
        let mut scene = self.scene;
        if scene.colors.iter().all(|&color| color == Vec3::ONE) {
            scene.colors = Vec::new();
        }
        if scene
            .texcoords
            .iter()
            .all(|&texcoord| texcoord == Vec2::ZERO)
        {
            scene.texcoords = Vec::new();
        }
        Scene {
            name: name.into(),
            sun: Some(Sun::default()),
            sky: Some(Sky::default()),
            headbox: Some(Headbox {
                centre,
                half_size_m,
            }),
            ..scene
        }
    }
}
