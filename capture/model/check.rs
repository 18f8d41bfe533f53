//! Validation of portal models, with a sentence for each problem, and repair of problems that would
//! break a walkthrough.

use super::polygon::{Polygon, Shape, crosses_itself};
use super::{Portal, PortalModel, Prism};
use glam::DVec3;
use headbox_core::file_frame::FileFrame;
use std::fmt;

/// Severity of a [`Finding`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Severity {
    /// The model is usable, but may not be rendered as intended.
    Warning,
    /// The object cannot be used and is left out.
    Error,
}

impl fmt::Display for Severity {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(if *self == Self::Error {
            "error"
        } else {
            "warning"
        })
    }
}

/// A problem of a portal model. Its text is a sentence with the problem and its consequence.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum Finding {
    /// There is no cell except the outside.
    #[error("there is no cell besides the outside; all geometry is shown as one cell")]
    NoCells,
    /// There is no portal.
    #[error("there is no portal, so no cell is seen from another; each is shown by itself")]
    NoPortals,
    /// A portal refers to a cell that does not exist.
    #[error(
        "portal {portal} ({name}) leads to cell {cell}, but there are {cells} cells; it is left out"
    )]
    MissingCell {
        /// Index of the portal.
        portal: usize,
        /// Its name.
        name: String,
        /// Index of the missing cell.
        cell: u32,
        /// Number of cells.
        cells: usize,
    },
    /// A portal leads from a cell to itself.
    #[error("portal {portal} ({name}) has {cell} on both of its sides; it is left out")]
    SameCell {
        /// Index of the portal.
        portal: usize,
        /// Its name.
        name: String,
        /// Name of the cell.
        cell: String,
    },
    /// The polygon of a portal is not usable.
    #[error("portal {portal} ({name}) {shape}; it is left out")]
    Shape {
        /// Index of the portal.
        portal: usize,
        /// Its name.
        name: String,
        /// Problem of its shape.
        shape: Shape,
    },
    /// The corners of a portal run clockwise seen from its first cell.
    #[error(
        "portal {portal} ({name}) runs clockwise seen from its first cell; its corners are reversed"
    )]
    Clockwise {
        /// Index of the portal.
        portal: usize,
        /// Its name.
        name: String,
    },
    /// A portal does not lie on the border of one of its cells.
    #[error(
        "portal {portal} ({name}) does not touch {cell}; it is kept, but what is seen through it may be wrong"
    )]
    NotAdjacent {
        /// Index of the portal.
        portal: usize,
        /// Its name.
        name: String,
        /// Name of the cell, or both names.
        cell: String,
        /// True if it touches neither of its cells.
        neither: bool,
    },
    /// A cell that is not the outside has no space.
    #[error("cell {cell} ({name}) has no space, so no eye can be in it")]
    NoSpace {
        /// Index of the cell.
        cell: u32,
        /// Its name.
        name: String,
    },
    /// A prism of a cell's space is invalid.
    #[error("cell {cell} ({name}): part {part} of its space {flaw}")]
    Space {
        /// Index of the cell.
        cell: u32,
        /// Its name.
        name: String,
        /// Index of the prism.
        part: usize,
        /// Flaw of the prism.
        flaw: Flaw,
    },
    /// A cell cannot be reached through portals.
    #[error("cell {cell} ({name}) cannot be reached through portals from {from}")]
    Unreachable {
        /// Index of the cell.
        cell: u32,
        /// Its name.
        name: String,
        /// Name of the cell in which the search began.
        from: String,
    },
    /// A cell is open to the outside where it has no door or window.
    #[error(
        "{cell} has no wall to the outside over {width:.2} x {height:.2} m about {:.2}, {:.2}, {:.2} (in the \
         file's axes and unit): one may be missing; it is taken as a portal",
        at.x, at.y, at.z
    )]
    NoWall {
        /// Name of the cell.
        cell: String,
        /// Width of the opening, metres.
        width: f64,
        /// Height of the opening, metres.
        height: f64,
        /// Centre of the opening, world metres.
        at: DVec3,
    },
    /// Rays passed between two cells without crossing a portal, and the cells were joined.
    #[error(
        "{} and {} see each other without a portal ({rays} rays, one at {:.2}, {:.2}, {:.2} in the file's axes and \
         unit); they are joined to one cell",
        cells[0], cells[1], at.x, at.y, at.z
    )]
    Joined {
        /// Names of the cells.
        cells: [String; 2],
        /// Number of rays that passed.
        rays: usize,
        /// Position of one of them, world metres.
        at: DVec3,
    },
    /// Surfaces of different materials overlap in one plane.
    #[error(
        "{cell}: surfaces of different materials lie over each other in one plane over {area:.2} m2, most about {:.2}, {:.2}, \
         {:.2} (in the file's axes and unit); they will flicker (move one, or leave it out)",
        at.x, at.y, at.z
    )]
    Coplanar {
        /// Name of the cell.
        cell: String,
        /// Area of the overlap, square metres.
        area: f64,
        /// Centre of the largest overlap, world metres.
        at: DVec3,
    },
    /// Rays pass between two cells without crossing a portal.
    #[error(
        "{rays} of {of} rays pass from {from} into {into} without crossing a portal (one at {:.2}, {:.2}, {:.2} in the \
         file's axes and unit); what they see there will be missing",
        at.x, at.y, at.z
    )]
    Leak {
        /// Name of the cell that they leave.
        from: String,
        /// Name of the cell that they enter.
        into: String,
        /// Number of such rays.
        rays: usize,
        /// Number of rays sent from all cells.
        of: usize,
        /// Position of one of them, world metres.
        at: DVec3,
    },
}

/// Flaw of a prism.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum Flaw {
    /// Fewer than three corners, or one that is not finite.
    #[error("has no outline of three or more corners; no eye can be in it")]
    NoOutline,
    /// The ceiling is not above the floor.
    #[error("has no height; no eye can be in it")]
    NoHeight,
    /// Two edges of the outline cross.
    #[error("has an outline that crosses itself; places enclosed twice are taken as outside it")]
    CrossesItself,
}

impl Flaw {
    /// Returns the first flaw of a prism.
    fn find(prism: &Prism) -> Option<Self> {
        if prism.outline.len() < 3 || !prism.outline.iter().all(|corner| corner.is_finite()) {
            return Some(Self::NoOutline);
        }
        let height = prism.ceiling_y - prism.floor_y;
        if height.is_nan() || height <= 0.0 {
            return Some(Self::NoHeight);
        }
        let outline: Vec<DVec3> = prism
            .outline
            .iter()
            .map(|corner| DVec3::new(corner.x, 0.0, corner.y))
            .collect();
        crosses_itself(&outline, DVec3::Y).then_some(Self::CrossesItself)
    }
}

impl Finding {
    /// Severity of the finding.
    pub fn severity(&self) -> Severity {
        match self {
            Self::NoCells
            | Self::MissingCell { .. }
            | Self::SameCell { .. }
            | Self::Shape { .. } => Severity::Error,
            _ => Severity::Warning,
        }
    }

    /// Converts the position in the finding from world metres to the axes and unit of the model's
    /// file, in which its sentence reports positions.
    pub fn in_file(mut self, frame: &FileFrame) -> Self {
        if let Self::NoWall { at, .. }
        | Self::Joined { at, .. }
        | Self::Coplanar { at, .. }
        | Self::Leak { at, .. } = &mut self
        {
            *at = frame.file_from_world(*at);
        }
        self
    }

    fn is_error(&self) -> bool {
        self.severity() == Severity::Error
    }

    /// Index of the affected portal, if any.
    pub fn portal(&self) -> Option<usize> {
        match self {
            Self::MissingCell { portal, .. }
            | Self::SameCell { portal, .. }
            | Self::Shape { portal, .. }
            | Self::Clockwise { portal, .. }
            | Self::NotAdjacent { portal, .. } => Some(*portal),
            _ => None,
        }
    }
}

/// Distances before and behind a portal at which its cells are looked up, metres: beyond rounding
/// errors, within the reveal of a thin wall.
const PROBES_M: [f64; 3] = [0.002, 0.02, 0.06];

impl PortalModel {
    /// Returns all problems of cells and portals that need no rays (see [`Self::leaks`]).
    pub fn check(&self) -> Vec<Finding> {
        let mut findings = Vec::new();
        if (0..self.cells.len()).all(|cell| self.is_outside(cell as u32)) {
            findings.push(Finding::NoCells);
        } else if self.portals.is_empty() {
            findings.push(Finding::NoPortals);
        }
        let mut usable = vec![true; self.portals.len()];
        for (index, portal) in self.portals.iter().enumerate() {
            if let Some(finding) = self.check_portal(index, portal) {
                usable[index] = !finding.is_error();
                findings.push(finding);
            }
        }
        for (cell, it) in (0_u32..).zip(&self.cells) {
            if it.space.is_empty() && !self.is_outside(cell) {
                findings.push(Finding::NoSpace {
                    cell,
                    name: it.name.clone(),
                });
            }
            let flaws = it
                .space
                .iter()
                .enumerate()
                .filter_map(|(part, prism)| Some((part, Flaw::find(prism)?)));
            findings.extend(flaws.map(|(part, flaw)| Finding::Space {
                cell,
                name: it.name.clone(),
                part,
                flaw,
            }));
        }
        if let Some(from) = self.first_cell(&usable) {
            let reached = self.reachable_by(from, &usable);
            let name = |cell: u32| self.cells[cell as usize].name.clone();
            let unreached = (0_u32..).zip(reached).filter(|(_, reached)| !reached);
            findings.extend(unreached.map(|(cell, _)| Finding::Unreachable {
                cell,
                name: name(cell),
                from: name(from),
            }));
        }
        findings
    }

    /// Removes unusable portals and reverses those whose corners run the wrong way.
    ///
    /// Returns the findings of [`Self::check`] before the repair. Portal indices are those of the
    /// repaired model; removed portals are numbered after the last portal.
    pub fn repair(&mut self) -> Vec<Finding> {
        let unusable: Vec<bool> = (self.portals.iter().enumerate())
            .map(|(index, portal)| {
                self.check_portal(index, portal)
                    .is_some_and(|finding| finding.is_error())
            })
            .collect();
        let portals = std::mem::take(&mut self.portals).into_iter().zip(unusable);
        let (left_out, kept): (Vec<_>, Vec<_>) = portals.partition(|(_, unusable)| *unusable);
        let count = kept.len();
        self.portals = kept
            .into_iter()
            .chain(left_out)
            .map(|(portal, _)| portal)
            .collect();
        let findings = self.check();
        for finding in &findings {
            if let Finding::Clockwise { portal, .. } = finding {
                self.portals[*portal].polygon.reverse();
            }
        }
        self.portals.truncate(count);
        findings
    }

    /// Removes T-junctions from the scene (see [`headbox_scene::scene::Scene::stitch`]); each cell
    /// keeps its surfaces.
    pub fn stitch(&mut self) {
        let firsts = self.scene.stitch();
        for cell in &mut self.cells {
            let first = |triangle: u32| firsts.get(triangle as usize).copied().unwrap_or_default();
            cell.triangles = first(cell.triangles.start)..first(cell.triangles.end);
        }
    }

    /// Returns, for each cell, true if it is reachable from `from` through portals; all false if
    /// there is no such cell.
    pub fn reachable(&self, from: u32) -> Vec<bool> {
        self.reachable_by(from, &vec![true; self.portals.len()])
    }

    /// Same as [`Self::reachable`], through usable portals only.
    fn reachable_by(&self, from: u32, usable: &[bool]) -> Vec<bool> {
        let mut reached = vec![false; self.cells.len()];
        let mut open = vec![from];
        while let Some(cell) = open.pop() {
            match reached.get_mut(cell as usize) {
                Some(reached) if !*reached => *reached = true,
                _ => continue,
            }
            let behind = self
                .portals_from(cell)
                .filter(|(portal, _)| usable[*portal])
                .map(|(_, behind)| behind);
            open.extend(behind);
        }
        reached
    }

    /// Returns the start of the search: the first cell with a usable portal, else the first cell.
    fn first_cell(&self, usable: &[bool]) -> Option<u32> {
        let count = self.cells.len() as u32;
        let with_portal =
            (0..count).find(|&cell| self.portals_from(cell).any(|(portal, _)| usable[portal]));
        with_portal.or((count > 0).then_some(0))
    }

    pub(crate) fn is_outside(&self, cell: u32) -> bool {
        self.outside == Some(cell)
    }

    /// Returns the worst problem of a portal.
    fn check_portal(&self, portal: usize, it: &Portal) -> Option<Finding> {
        let (name, cells) = (it.name.clone(), self.cells.len());
        if let Some(&cell) = it.cells.iter().find(|&&cell| cell as usize >= cells) {
            return Some(Finding::MissingCell {
                portal,
                name,
                cell,
                cells,
            });
        }
        if it.cells[0] == it.cells[1] {
            return Some(Finding::SameCell {
                portal,
                name,
                cell: self.cells[it.cells[0] as usize].name.clone(),
            });
        }
        let polygon = match Polygon::new(&it.polygon) {
            Ok(polygon) => polygon,
            Err(shape) => {
                return Some(Finding::Shape {
                    portal,
                    name,
                    shape,
                });
            }
        };
        let touches = |side: f64, cell: u32| {
            PROBES_M.iter().any(|step| {
                self.cell_at(polygon.centroid + polygon.normal * (side * step)) == Some(cell)
            })
        };
        let touched = [touches(1.0, it.cells[0]), touches(-1.0, it.cells[1])];
        if touched == [true, true] {
            return None;
        }
        if touches(-1.0, it.cells[0]) && touches(1.0, it.cells[1]) {
            return Some(Finding::Clockwise { portal, name });
        }
        let missed: Vec<&str> = (0..2)
            .filter(|&side| !touched[side])
            .map(|side| self.cells[it.cells[side] as usize].name.as_str())
            .collect();
        Some(Finding::NotAdjacent {
            portal,
            name,
            cell: missed.join(" or "),
            neither: missed.len() == 2,
        })
    }
}
