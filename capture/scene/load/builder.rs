//! Builds a [`Scene`] from the vertices and triangles of a parser; drops triangles that cannot be
//! traced.

use super::lights::FileLights;
use super::notes::{Note, Notes};
use super::orientation::FrameHints;
use super::{LoadError, file_stem};
use crate::coplanar;
use crate::material::{Material, Texture};
use crate::scene::{Scene, Triangle, Vertex};
use glam::{DVec3, Vec2, Vec3};
use headbox_core::file_frame::FileFrame;
use headbox_core::headbox::Headbox;
use headbox_core::memory::{self, OverBudget};
use rayon::prelude::*;
use std::ops::Range;
use std::path::Path;

/// Least ratio of a triangle's doubled area to its longest edge squared. Below, its corners
/// coincide or are collinear except for rounding: `f64` positions are precise to 1e-16 of their
/// size, and files have 6 to 9 digits, so that intended triangles are far above.
const DEGENERATE_SHARE: f64 = 1e-12;

/// Largest component of a vertex colour that is not reported as cut to 1: half a step of 8 bits
/// above.
const MAX_COLOR: f32 = 1.0 + 0.5 / 255.0;

/// Memory of a vertex of a scene, bytes: position, normal, texture coordinate and colour.
const VERTEX_BYTES: usize = 56;

/// Memory of a triangle while the tree for tracing is built, bytes: 213 of a million triangles.
const TREE_BYTES: usize = 200;

/// A scene under construction.
#[derive(Debug, Default)]
pub(super) struct Builder {
    pub(super) frame: FileFrame,
    pub(super) notes: Notes,
    pub(super) lights: FileLights,
    scene: Scene,
    groups: Vec<Group>,
    hints: Option<FrameHints>,
    /// Number of vertices that are known to fit into memory.
    fitting_vertices: usize,
}

/// Error of a mesh that a scene cannot hold.
#[derive(Debug, thiserror::Error)]
pub(super) enum MeshError {
    /// Vertex indices would need more than 32 bits.
    #[error("it has more than 2^32 vertices")]
    TooManyVertices,
    #[error("its mesh {0}")]
    OverBudget(#[from] OverBudget),
}

impl MeshError {
    /// Converts to an error of loading `path`.
    pub(super) fn in_file(&self, path: &Path) -> LoadError {
        LoadError::malformed(path, self.to_string())
    }
}

/// A scene and the groups of its file.
#[derive(Clone, Debug)]
pub struct GroupedScene {
    /// The scene.
    pub scene: Scene,
    /// The groups in ascending order of triangles; several may have the same name.
    pub groups: Vec<Group>,
}

/// A named range of triangles: a group or object of an OBJ, a node of a glTF.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Group {
    /// The name in the file.
    pub name: String,
    /// Indices into [`Scene::triangles`].
    pub triangles: Range<u32>,
}

impl Builder {
    pub(super) fn new(frame: FileFrame, notes: Notes) -> Self {
        Self {
            frame,
            notes,
            ..Self::default()
        }
    }

    /// Builds a scene whose frame is not known: vertices stay in the file's axes and unit until
    /// [`Self::finish`] chooses a frame.
    pub(super) fn with_hints(hints: FrameHints, notes: Notes) -> Self {
        Self {
            hints: Some(hints),
            ..Self::new(FileFrame::default(), notes)
        }
    }

    /// Begins a group of this name for the next triangles.
    pub(super) fn begin_group(&mut self, name: &str) {
        let first = self.end_group();
        self.groups.push(Group {
            name: name.to_owned(),
            triangles: first..first,
        });
    }

    /// Ends the last group. Returns the number of triangles so far.
    fn end_group(&mut self) -> u32 {
        let end = self.scene.triangles.len() as u32;
        if let Some(last) = self.groups.last_mut() {
            last.triangles.end = end;
        }
        end
    }

    /// Returns the index of the first of `count` new vertices.
    ///
    /// # Errors
    /// If the index of the last one needs more than 32 bits, or they need more memory than is left.
    pub(super) fn next_vertex(&mut self, count: usize) -> Result<u32, MeshError> {
        let first = self.scene.positions.len();
        let end = first.saturating_add(count);
        u32::try_from(end).map_err(|_| MeshError::TooManyVertices)?;
        if end > self.fitting_vertices {
            // Polygon by polygon, an eighth more at a time.
            self.fitting_vertices = end.max(first + first / 8);
            let more = self.fitting_vertices - first;
            drop(memory::reserve((VERTEX_BYTES * more) as u64)?);
        }
        Ok(first as u32)
    }

    /// Adds a vertex in the file's axes and unit. Attributes that are not finite become neutral,
    /// except the position, which [`Self::push_triangle`] checks.
    pub(super) fn push_vertex(&mut self, vertex: Vertex) {
        let normal = self
            .frame
            .world_direction_from_file(vertex.normal.as_dvec3())
            .as_vec3();
        self.scene
            .positions
            .push(self.frame.world_from_file(vertex.position));
        self.scene.normals.push(normal.normalize_or_zero());
        self.scene.texcoords.push(if vertex.texcoord.is_finite() {
            vertex.texcoord
        } else {
            Vec2::ZERO
        });
        let is_cut = vertex.color.is_finite() && vertex.color.max_element() > MAX_COLOR;
        self.notes.add(Note::ColorAboveOne, usize::from(is_cut));
        self.scene.colors.push(if vertex.color.is_finite() {
            vertex.color.clamp(Vec3::ZERO, Vec3::ONE)
        } else {
            Vec3::ONE
        });
        self.push_rare_attributes(vertex);
    }

    /// Adds the attributes of the last vertex that few files have: their arrays stay empty until a
    /// vertex differs from the neutral one.
    fn push_rare_attributes(&mut self, vertex: Vertex) {
        let scene = &mut self.scene;
        let (last, earlier) = match scene.texcoords.split_last() {
            Some((last, earlier)) => (*last, earlier),
            None => return,
        };
        let texcoord = if vertex.emission_texcoord.is_finite() {
            vertex.emission_texcoord
        } else {
            last
        };
        if !scene.emission_texcoords.is_empty() {
            scene.emission_texcoords.push(texcoord);
        } else if texcoord != last {
            scene.emission_texcoords = earlier.to_vec();
            scene.emission_texcoords.push(texcoord);
        }
        let opacity = if vertex.opacity.is_finite() {
            vertex.opacity.clamp(0.0, 1.0)
        } else {
            1.0
        };
        if !scene.opacities.is_empty() {
            scene.opacities.push(opacity);
        } else if opacity != 1.0 {
            scene.opacities = vec![1.0; earlier.len()];
            scene.opacities.push(opacity);
        }
    }

    /// Adds a triangle of existing vertices, or counts it if it cannot be traced.
    pub(super) fn push_triangle(&mut self, vertices: [u32; 3], material: u32) {
        let [a, b, c] = vertices.map(|vertex| self.scene.positions[vertex as usize]);
        if ![a, b, c].into_iter().all(DVec3::is_finite) {
            self.notes.add(Note::NotFinite, 1);
            return;
        }
        let longest = (b - a)
            .length_squared()
            .max((c - a).length_squared())
            .max((c - b).length_squared());
        let doubled_area = (b - a).cross(c - a).length();
        // Also false where huge coordinates overflow to infinity or NaN.
        if doubled_area > longest * DEGENERATE_SHARE {
            self.scene.triangles.push(Triangle { vertices, material });
        } else {
            self.notes.add(Note::Degenerate, 1);
        }
    }

    /// Reports evidence against the axes and the unit that the file's format defines.
    pub(super) fn report_doubts(&mut self, hints: &FrameHints) {
        // A file with a headbox was written by headbox.
        if self.scene.headbox.is_none() {
            self.notes.messages.extend(hints.doubts(&self.scene));
        }
    }

    /// Sets the headbox, in the file's axes and unit, unless it is set.
    pub(super) fn place_headbox(&mut self, centre: DVec3, half_size: f64) {
        let half_size_m = half_size * self.frame.unit_m;
        self.scene.headbox.get_or_insert(Headbox {
            centre: self.frame.world_from_file(centre),
            half_size_m,
        });
    }

    /// Chooses the frame of a scene with hints and converts it to world axes and metres.
    fn apply_hints(&mut self) {
        let Some(hints) = self.hints.take() else {
            return;
        };
        let (frame, notes) = hints.choose_frame(&self.scene);
        self.frame = frame;
        self.notes.messages.extend(notes);
        self.scene
            .positions
            .iter_mut()
            .for_each(|p| *p = frame.world_from_file(*p));
        self.scene
            .normals
            .iter_mut()
            .for_each(|n| *n = frame.world_direction_from_file(n.as_dvec3()).as_vec3());
    }

    /// Finishes the scene, with its own lights or the default sun and sky. `path` is for messages;
    /// its stem is the scene's name.
    ///
    /// # Errors
    /// [`LoadError::Unusable`] if no triangle is left, any other cause in it is a bug of the
    /// loader; [`LoadError::Malformed`] if tracing it would take more memory than is left.
    pub(super) fn finish(
        mut self,
        path: &Path,
        materials: Vec<Material>,
        textures: Vec<Texture>,
    ) -> Result<GroupedScene, LoadError> {
        if let Some(cause) = self.notes.take_over_budget() {
            return Err(LoadError::malformed(path, cause));
        }
        let tree = memory::reserve((TREE_BYTES * self.scene.triangles.len()) as u64);
        drop(tree.map_err(|error| LoadError::malformed(path, format!("tracing it {error}")))?);
        self.end_group();
        self.scene.materials = materials;
        self.apply_hints();
        self.groups.retain(|group| !group.triangles.is_empty());
        let (duplicates, conflicts) = rayon::join(
            || duplicate_count(&self.scene),
            || coplanar::count_conflicts(&self.scene),
        );
        self.notes.add(Note::Duplicate, duplicates);
        self.notes.add(Note::Coplanar, conflicts);
        self.notes.add_file(path);
        let FileLights { sun, sky, lamps } = self.lights.with_defaults(&mut self.notes);
        discard_unused_vertices(&mut self.scene);
        let mut scene = Scene {
            name: file_stem(path),
            textures,
            sun,
            sky,
            lamps,
            frame: self.frame,
            summary: self.notes.summary(),
            ..self.scene
        };
        clear_if_all(&mut scene.normals, Vec3::ZERO);
        clear_if_all(&mut scene.texcoords, Vec2::ZERO);
        clear_if_all(&mut scene.colors, Vec3::ONE);
        clear_if_all(&mut scene.opacities, 1.0);
        match scene.validate() {
            Ok(()) => Ok(GroupedScene {
                scene,
                groups: self.groups,
            }),
            Err(cause) => Err(LoadError::Unusable {
                path: path.to_path_buf(),
                cause,
                notes: scene.summary.notes,
            }),
        }
    }
}

/// Empties an array whose values are all neutral.
fn clear_if_all<T: PartialEq>(values: &mut Vec<T>, neutral: T) {
    if values.iter().all(|value| *value == neutral) {
        *values = Vec::new();
    }
}

/// Removes the vertices that no triangle uses, among them those that are not finite; the order of
/// the others stays.
fn discard_unused_vertices(scene: &mut Scene) {
    let mut used = vec![false; scene.positions.len()];
    scene
        .triangles
        .iter()
        .flat_map(|t| t.vertices)
        .for_each(|vertex| used[vertex as usize] = true);
    let mut kept = 0;
    let new_index: Vec<u32> = used
        .iter()
        .map(|&used| {
            kept += u32::from(used);
            kept.wrapping_sub(1)
        })
        .collect();
    scene
        .triangles
        .iter_mut()
        .for_each(|t| t.vertices = t.vertices.map(|vertex| new_index[vertex as usize]));
    retain_where(&mut scene.positions, &used);
    retain_where(&mut scene.normals, &used);
    retain_where(&mut scene.texcoords, &used);
    retain_where(&mut scene.emission_texcoords, &used);
    retain_where(&mut scene.colors, &used);
    retain_where(&mut scene.opacities, &used);
}

fn retain_where<T>(values: &mut Vec<T>, keep: &[bool]) {
    let mut keep = keep.iter();
    values.retain(|_| keep.next().copied().unwrap_or(false));
    values.shrink_to_fit();
}

/// Returns the number of triangles with exactly the three corners, in any order, of an earlier one.
fn duplicate_count(scene: &Scene) -> usize {
    let corners = |triangle: usize| {
        // Adding zero makes -0 and 0 the same bits.
        let position = |vertex: u32| {
            scene.positions[vertex as usize]
                .to_array()
                .map(|x| (x + 0.0).to_bits())
        };
        let mut corners = scene.triangles[triangle].vertices.map(position);
        corners.sort_unstable();
        corners
    };
    // FxHash.
    let hash = |triangle: usize| {
        corners(triangle)
            .as_flattened()
            .iter()
            .fold(0_u64, |hash, &bits| {
                (hash.rotate_left(5) ^ bits).wrapping_mul(0x9E37_79B9_7F4A_7C15)
            })
    };
    let mut order: Vec<(u64, usize)> = (0..scene.triangles.len())
        .into_par_iter()
        .map(|t| (hash(t), t))
        .collect();
    order.par_sort_unstable();
    let repeats = |same_hash: &[(u64, usize)]| {
        if same_hash.len() < 2 {
            return 0;
        }
        let mut keys: Vec<_> = same_hash
            .iter()
            .map(|&(_, triangle)| corners(triangle))
            .collect();
        keys.sort_unstable();
        keys.windows(2).filter(|pair| pair[0] == pair[1]).count()
    };
    order.chunk_by(|a, b| a.0 == b.0).map(repeats).sum()
}
