//! Joins cells that see each other where no portal was found, so that nothing is missing from their
//! views.

use super::{Cell, Finding, PortalModel};

/// Number of rays from each cell.
const RAYS: u32 = 2000;
/// Maximum number of stray rays between two cells that are attributed to cracks and rounding
/// errors: closed homes have one or two.
const MAX_STRAYS: usize = 10;

impl PortalModel {
    /// Joins and reports cells between which more than a few rays pass without crossing a portal
    /// (see [`Self::leaks`]). No room is joined to the outside: it would lose the outer sides of
    /// its walls.
    pub(crate) fn join_leaking_cells(&mut self) -> Vec<Finding> {
        if self.cells.len() < 2 || self.scene.triangles.is_empty() {
            return Vec::new();
        }
        let leaks = self.with_tracer(|model, tracer| model.stray_pairs(tracer, RAYS, 0));
        let mut findings = Vec::new();
        let mut joined: Vec<u32> = (0..self.cells.len() as u32).collect();
        for (&(from, into), &(rays, at)) in &leaks {
            let back = leaks.get(&(into, from)).map_or(0, |(rays, _)| *rays);
            let counted_already = back > 0 && into < from;
            if counted_already
                || rays + back <= MAX_STRAYS
                || self.is_outside(from)
                || self.is_outside(into)
            {
                continue;
            }
            let name = |cell: u32| self.cells[cell as usize].name.clone();
            findings.push(Finding::Joined {
                cells: [name(from), name(into)],
                rays: rays + back,
                at,
            });
            let [a, b] = [joined[from as usize], joined[into as usize]];
            joined
                .iter_mut()
                .filter(|to| **to == a.max(b))
                .for_each(|to| *to = a.min(b));
        }
        if !findings.is_empty() {
            self.unite(&joined);
        }
        findings
    }

    /// Merges each cell into the cell `joined` for it, and removes the portals between them.
    fn unite(&mut self, joined: &[u32]) {
        let old = std::mem::take(&mut self.cells);
        let mut new_of_old = vec![0_u32; old.len()];
        let mut triangles = Vec::with_capacity(self.scene.triangles.len());
        for first in (0..old.len()).filter(|&cell| joined[cell] as usize == cell) {
            let members: Vec<usize> = (0..old.len())
                .filter(|&cell| joined[cell] as usize == first)
                .collect();
            let begin = triangles.len() as u32;
            for &member in &members {
                new_of_old[member] = self.cells.len() as u32;
                let run = &old[member].triangles;
                triangles
                    .extend_from_slice(&self.scene.triangles[run.start as usize..run.end as usize]);
            }
            self.cells.push(Cell {
                name: members
                    .iter()
                    .map(|&m| old[m].name.as_str())
                    .collect::<Vec<_>>()
                    .join(" + "),
                space: members
                    .iter()
                    .flat_map(|&m| old[m].space.iter().cloned())
                    .collect(),
                triangles: begin..triangles.len() as u32,
            });
        }
        self.scene.triangles = triangles;
        self.outside = self.outside.map(|outside| new_of_old[outside as usize]);
        for cell in self.portals.iter_mut().flat_map(|p| &mut p.cells) {
            *cell = new_of_old.get(*cell as usize).copied().unwrap_or(*cell);
        }
        self.portals
            .retain(|portal| portal.cells[0] != portal.cells[1]);
    }
}
