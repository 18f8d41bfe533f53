//! Collects vertices and triangles from a parser, drops what cannot be traced, and makes the [`Scene`].

use super::LoadError;
use super::lights::FileLights;
use super::notes::{Note, Notes};
use super::orientation::FrameHints;
use crate::material::{Material, Texture};
use crate::scene::{Scene, Triangle};
use glam::{DVec3, Vec2, Vec3};
use headbox_core::file_frame::FileFrame;
use headbox_core::headbox::Headbox;
use rayon::prelude::*;
use std::ops::Range;
use std::path::Path;

/// A triangle whose doubled area is below this share of its longest edge squared has no area: its corners coincide or
/// lie on a line but for rounding (an `f64` position carries 1e-16 of its size; files print 6 to 9 digits, so a
/// triangle that someone meant is far above this).
const DEGENERATE_SHARE: f64 = 1e-12;

/// A vertex in the file's axes and unit.
#[derive(Clone, Copy, Debug)]
pub(super) struct Vertex {
    pub(super) position: DVec3,
    /// Zero where there is none.
    pub(super) normal: Vec3,
    pub(super) texcoord: Vec2,
    /// Linear RGB.
    pub(super) color: Vec3,
}

/// The scene while it is being read.
#[derive(Debug, Default)]
pub(super) struct Builder {
    pub(super) frame: FileFrame,
    pub(super) notes: Notes,
    pub(super) lights: FileLights,
    scene: Scene,
    groups: Vec<Group>,
    hints: Option<FrameHints>,
}

/// A scene and the groups that its file divides it into.
#[derive(Clone, Debug)]
pub struct GroupedScene {
    /// The scene.
    pub scene: Scene,
    /// Runs of its triangles that belong to a group, in ascending order; a name may come back.
    pub groups: Vec<Group>,
}

/// A run of triangles under a name: a group or object of an OBJ, a node of a glTF.
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

    /// For a file that does not say how it is oriented: what is pushed stays in its axes and unit until [`Self::finish`]
    /// has seen all of it.
    pub(super) fn to_be_oriented(hints: FrameHints, notes: Notes) -> Self {
        Self {
            hints: Some(hints),
            ..Self::new(FileFrame::default(), notes)
        }
    }

    /// The triangles to come belong to a group of this name.
    pub(super) fn begin_group(&mut self, name: &str) {
        let first = self.end_group();
        self.groups.push(Group {
            name: name.to_owned(),
            triangles: first..first,
        });
    }

    /// Ends the run of the group that was begun last; the number of triangles so far.
    fn end_group(&mut self) -> u32 {
        let end = self.scene.triangles.len() as u32;
        if let Some(last) = self.groups.last_mut() {
            last.triangles.end = end;
        }
        end
    }

    /// Index that the first of the next `count` vertices will get, or `None` when 32 bits do not hold the last.
    pub(super) fn next_vertex(&self, count: usize) -> Option<u32> {
        let first = self.scene.positions.len();
        u32::try_from(first.checked_add(count)?)
            .ok()
            .and(u32::try_from(first).ok())
    }

    /// Adds a vertex. Whatever is not finite becomes neutral, but for the position: [`Self::push_triangle`] deals
    /// with that.
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
        self.scene.colors.push(if vertex.color.is_finite() {
            vertex.color.clamp(Vec3::ZERO, Vec3::ONE)
        } else {
            Vec3::ONE
        });
    }

    /// Adds a triangle of vertices pushed before, unless it cannot be traced, which is counted.
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

    /// Tells what speaks against the axes and the unit that the file's format rules.
    pub(super) fn report_doubts(&mut self, hints: &FrameHints) {
        // What says where its headbox is was made for it.
        if self.scene.headbox.is_none() {
            self.notes.told.extend(hints.doubts(&self.scene));
        }
    }

    /// Says where the headbox is, in the file's axes and unit; the first that does counts.
    pub(super) fn place_headbox(&mut self, centre: DVec3, half_size: f64) {
        let half_size_m = half_size * self.frame.unit_m;
        self.scene.headbox.get_or_insert(Headbox {
            centre: self.frame.world_from_file(centre),
            half_size_m,
        });
    }

    /// Brings what was pushed in the file's axes and unit to the world's.
    fn orient(&mut self) {
        let Some(hints) = self.hints.take() else {
            return;
        };
        let (frame, notes) = hints.choose_frame(&self.scene);
        self.frame = frame;
        self.notes.told.extend(notes);
        self.scene
            .positions
            .iter_mut()
            .for_each(|p| *p = frame.world_from_file(*p));
        self.scene
            .normals
            .iter_mut()
            .for_each(|n| *n = frame.world_direction_from_file(n.as_dvec3()).as_vec3());
    }

    /// The finished scene, under its own lights or the default sun and sky. `path` is the file for messages; its stem names the scene.
    ///
    /// # Errors
    /// [`LoadError::Unusable`] if no triangle was left; any other cause in it would be a defect of the loader.
    pub(super) fn finish(
        mut self,
        path: &Path,
        materials: Vec<Material>,
        textures: Vec<Texture>,
    ) -> Result<GroupedScene, LoadError> {
        self.end_group();
        self.scene.materials = materials;
        self.orient();
        self.groups.retain(|group| !group.triangles.is_empty());
        self.notes
            .add(Note::Duplicate, duplicate_count(&self.scene));
        self.notes.add_file(path);
        let FileLights { sun, sky, lamps } = self.lights.or_default(&mut self.notes);
        discard_unused_vertices(&mut self.scene);
        let mut scene = Scene {
            name: path
                .file_stem()
                .unwrap_or_default()
                .to_string_lossy()
                .into_owned(),
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
        match scene.validate() {
            Ok(()) => Ok(GroupedScene {
                scene,
                groups: self.groups,
            }),
            Err(cause) => {
                let survived = scene.summary.notes.join("; ");
                Err(LoadError::Unusable {
                    path: path.to_path_buf(),
                    cause,
                    survived,
                })
            }
        }
    }
}

/// Empties an array that says nothing.
fn clear_if_all<T: PartialEq>(values: &mut Vec<T>, neutral: T) {
    if values.iter().all(|value| *value == neutral) {
        *values = Vec::new();
    }
}

/// Removes the vertices that no triangle uses (among them those that are not finite), keeping the order of the rest.
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
    retain_where(&mut scene.colors, &used);
}

fn retain_where<T>(values: &mut Vec<T>, keep: &[bool]) {
    let mut keep = keep.iter();
    values.retain(|_| keep.next().copied().unwrap_or(false));
    values.shrink_to_fit();
}

/// Number of triangles whose three corners are, in any order, exactly those of an earlier triangle.
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
    let hash = |triangle: usize| {
        corners(triangle)
            .as_flattened()
            .iter()
            .fold(0_u64, |hash, &bits| {
                (hash.rotate_left(5) ^ bits).wrapping_mul(0x9E37_79B9_7F4A_7C15) // the multiplier of FxHash's kin
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
