//! Portals at borders without a wall: where the outline of a cell runs through open space, the
//! neighbour is visible.
//!
//! Rays, not the plan, find the walls, so that a lintel, a half-high wall, a post or a missing wall
//! is treated as it was built. Rays cross the border perpendicularly on a grid. Each run of
//! adjacent columns with a passing ray becomes one upright rectangle from the lowest to the highest
//! passing ray, with ends refined by bisection. A portal may be larger than the opening (geometry
//! in it occludes what is behind), never smaller.

use super::polygon::Polygon;
use super::{Finding, Portal, PortalModel, Prism, doubled_area};
use glam::{DVec2, DVec3, Vec3Swizzles};
use headbox_trace::bvh::{Ray, Tracer};
use rayon::prelude::*;
use std::collections::VecDeque;
use std::ops::Range;

/// Spacing of the rays along a border and in height, metres; a post or slit narrower than this may
/// be missed.
const GRID_M: f64 = 0.1;

/// Maximum numbers of steps along a border and in height: 204 m and 51 m at [`GRID_M`]; larger
/// borders have wider steps.
const MAX_STEPS: [usize; 2] = [2048, 512];

/// Distance of the outermost rays from a border's ends, floor and ceiling, metres.
const RIM_M: f64 = 0.01;

/// Maximum distance of the neighbour's space beyond a border, metres: a gap in a thick wall.
const REACH_M: f64 = 0.4;

/// Step of the search for the neighbour, metres.
const STEP_M: f64 = 0.01;

/// Distances from the border at which rays begin and end, metres; the first that is inside the cell
/// is used. Rooms may be drawn to the middle of their walls.
const CLEAR_M: [f64; 4] = [0.3, 0.15, 0.06, 0.02];

/// Number of bisections of [`GRID_M`] that locate an opening's ends.
const HALVINGS: u32 = 7;

/// Minimum width and height of an opening, metres: between cells, and to the outside, where frames
/// end slightly before walls. Smaller ones are cracks.
const MIN_SIZE_M: [f64; 2] = [0.04, 0.15];

/// A vertical side of a cell's space.
#[derive(Clone, Copy)]
struct Border {
    cell: u32,
    from: DVec2,
    /// Unit vector along the edge.
    along: DVec2,
    /// Unit normal out of the cell.
    outward: DVec2,
    length: f64,
    floor: f64,
    ceiling: f64,
}

/// Space beyond a border at one position.
#[derive(Clone, Copy, PartialEq)]
struct SpaceBeyond {
    cell: u32,
    /// Distance between the border and that space, metres.
    gap: f64,
}

/// Open part of a border.
#[derive(Clone, Copy)]
struct BorderOpening {
    beyond: SpaceBeyond,
    /// Start and end along the border, metres from its beginning.
    span: [f64; 2],
    /// Lowest and highest height, world metres.
    heights: [f64; 2],
}

impl PortalModel {
    /// Adds a portal wherever there is neither a wall nor a portal between two cells, or between a
    /// cell and the outside. The space in a gap between a border and its neighbour is added to the
    /// neighbour. `tracer` is over this model's geometry (see [`Self::with_tracer`]), whose
    /// triangles need not be assigned to cells yet. Reports rooms that are open to the outside: a
    /// wall may be missing.
    pub(crate) fn open_borders(&mut self, tracer: &Tracer) -> Vec<Finding> {
        let mut findings = Vec::new();
        let mut borders: VecDeque<Border> = self.borders().into();
        while let Some(border) = borders.pop_front() {
            let openings = BorderSearch::new(self, tracer, border).openings();
            for opening in openings {
                findings.extend(self.add_opening(&border, &opening, &mut borders));
            }
        }
        findings
    }

    /// Returns the borders of all cells except the outside.
    fn borders(&self) -> Vec<Border> {
        let cells = (0_u32..)
            .zip(&self.cells)
            .filter(|(cell, _)| !self.is_outside(*cell));
        let prisms = cells.flat_map(|(cell, it)| it.space.iter().map(move |prism| (cell, prism)));
        prisms
            .flat_map(|(cell, prism)| Border::sides(cell, prism))
            .collect()
    }

    /// Adds the portal of an opening, and the space in its gap to the neighbour. Appends the
    /// borders of that space to `borders`.
    fn add_opening(
        &mut self,
        border: &Border,
        opening: &BorderOpening,
        borders: &mut VecDeque<Border>,
    ) -> Option<Finding> {
        let BorderOpening {
            beyond,
            span,
            heights: [low, high],
        } = *opening;
        let [start, end] = span.map(|s| border.from + border.along * s);
        let is_outside = self.is_outside(beyond.cell);
        if beyond.gap > 0.0 && !is_outside {
            let far = border.outward * (beyond.gap + STEP_M);
            let prism = Prism {
                outline: vec![start, end, end + far, start + far],
                floor_y: low,
                ceiling_y: high,
            };
            borders.extend(Border::sides(beyond.cell, &prism));
            self.cells.get_mut(beyond.cell as usize)?.space.push(prism);
        }
        // The direction from `a` to `b` cross up points into the border's cell.
        let [a, b] = if border.along.perp().dot(border.outward) < 0.0 {
            [start, end]
        } else {
            [end, start]
        };
        let at = |p: DVec2, y: f64| DVec3::new(p.x, y, p.y);
        let polygon = vec![at(a, low), at(b, low), at(b, high), at(a, high)];
        let name = if is_outside { "gap" } else { "passage" };
        self.portals.push(Portal {
            name: name.into(),
            cells: [border.cell, beyond.cell],
            polygon,
        });
        is_outside.then(|| Finding::NoWall {
            cell: self.cells[border.cell as usize].name.clone(),
            width: span[1] - span[0],
            height: high - low,
            at: at((start + end) / 2.0, (low + high) / 2.0),
        })
    }
}

impl Border {
    /// Returns the sides of a prism; none if it has no area.
    fn sides(cell: u32, prism: &Prism) -> Vec<Self> {
        let outline = &prism.outline;
        let area = doubled_area(outline);
        let edge = |(&a, &b): (&DVec2, &DVec2)| {
            let length = a.distance(b);
            let along = (b - a).try_normalize()?;
            let outward = -along.perp() * area.signum();
            let (floor, ceiling) = (prism.floor_y, prism.ceiling_y);
            let is_valid = area != 0.0
                && area.is_finite()
                && length > 2.0 * RIM_M
                && ceiling - floor > 2.0 * RIM_M;
            is_valid.then_some(Self {
                cell,
                from: a,
                along,
                outward,
                length,
                floor,
                ceiling,
            })
        };
        let next = outline.iter().cycle().skip(1);
        outline.iter().zip(next).filter_map(edge).collect()
    }

    /// Returns the point `s` metres along the edge at height `y`, `out` metres beyond it.
    fn point(&self, s: f64, y: f64, out: f64) -> DVec3 {
        let p = self.from + self.along * s + self.outward * out;
        DVec3::new(p.x, y, p.y)
    }
}

/// Returns evenly spaced coordinates from `low` to `high`, a rim away from both, with at most the
/// grid's spacing, or with `max_steps` steps.
fn grid_coordinates(low: f64, high: f64, max_steps: usize) -> Vec<f64> {
    let span = high - low - 2.0 * RIM_M;
    let steps = ((span / GRID_M).ceil() as usize).clamp(1, max_steps);
    (0..=steps)
        .map(|i| low + RIM_M + span * i as f64 / steps as f64)
        .collect()
}

/// Search for openings in a border.
struct BorderSearch<'a> {
    model: &'a PortalModel,
    tracer: &'a Tracer,
    border: Border,
    /// Prisms within reach of the border, with their cells, in the order of the model.
    prisms: Vec<(u32, &'a Prism)>,
    /// Heights of their floors and ceilings, ascending.
    levels: Vec<f64>,
    /// Polygons of the portals within reach of the border.
    polygons: Vec<Polygon<'a>>,
}

/// A column of rays through a border.
struct Column {
    beyond: SpaceBeyond,
    /// Rows whose rays reach the space beyond.
    open: Vec<usize>,
    /// First and last row in an existing portal.
    portal: Option<[usize; 2]>,
}

impl Column {
    /// Returns true if two columns can belong to one opening.
    fn continues(&self, other: &Self) -> bool {
        self.beyond.cell == other.beyond.cell && self.portal.is_some() == other.portal.is_some()
    }
}

impl<'a> BorderSearch<'a> {
    fn new(model: &'a PortalModel, tracer: &'a Tracer, border: Border) -> Self {
        const REACH: f64 = REACH_M + CLEAR_M[0];
        let corners =
            [0.0, border.length].map(|s| [-REACH, REACH].map(|out| border.point(s, 0.0, out)));
        let corners = corners.as_flattened();
        let low = corners
            .iter()
            .copied()
            .reduce(DVec3::min)
            .unwrap_or_default();
        let high = corners
            .iter()
            .copied()
            .reduce(DVec3::max)
            .unwrap_or_default();
        let touches = |points: &mut dyn Iterator<Item = DVec2>| {
            let bounds = points.fold(None, |bounds: Option<[DVec2; 2]>, p| {
                let [min, max] = bounds.unwrap_or([p, p]);
                Some([min.min(p), max.max(p)])
            });
            bounds.is_some_and(|[min, max]| max.cmpge(low.xz()).all() && min.cmple(high.xz()).all())
        };
        let cells = (0_u32..).zip(&model.cells);
        let prisms: Vec<(u32, &Prism)> = cells
            .flat_map(|(cell, it)| it.space.iter().map(move |prism| (cell, prism)))
            .filter(|(_, prism)| touches(&mut prism.outline.iter().copied()))
            .collect();
        let mut levels: Vec<f64> = prisms
            .iter()
            .flat_map(|(_, prism)| [prism.floor_y, prism.ceiling_y])
            .collect();
        levels.sort_by(f64::total_cmp);
        // Includes the portals of earlier borders, so that an opening is not found again from the
        // neighbour's side.
        let portals = model.portals.iter();
        let polygons = portals
            .filter(|portal| touches(&mut portal.polygon.iter().map(|p| p.xz())))
            .filter_map(|portal| Polygon::new(&portal.polygon).ok())
            .collect();
        Self {
            model,
            tracer,
            border,
            prisms,
            levels,
            polygons,
        }
    }

    /// Returns the cell that contains a point within reach of the border, as
    /// [`PortalModel::cell_at`] does.
    fn cell_at(&self, p: DVec3) -> Option<u32> {
        let inside = self.prisms.iter().find(|(_, prism)| prism.contains(p));
        inside.map_or(self.model.outside, |(cell, _)| Some(*cell))
    }

    fn openings(&self) -> Vec<BorderOpening> {
        let [columns, rows] = MAX_STEPS;
        let columns = grid_coordinates(0.0, self.border.length, columns);
        let rows = grid_coordinates(self.border.floor, self.border.ceiling, rows);
        let trace = |&s: &f64| self.column(s, &rows);
        let found: Vec<Option<Column>> = columns.par_iter().map(trace).collect();
        let mut openings = Vec::new();
        let mut first = 0;
        while first < columns.len() {
            let Some(start) = &found[first] else {
                first += 1;
                continue;
            };
            let run: Vec<&Column> = found[first..]
                .iter()
                .map_while(Option::as_ref)
                .take_while(|column| start.continues(column))
                .collect();
            let span = self.span(&columns, &rows, first, run.len());
            // An existing portal in the run leaves an opening below it and one above it.
            let bottom = run
                .iter()
                .filter_map(|column| Some(column.portal?[0]))
                .min()
                .unwrap_or(rows.len());
            let top = run
                .iter()
                .filter_map(|column| Some(column.portal?[1]))
                .max()
                .unwrap_or(rows.len());
            let run_columns = &columns[first..first + run.len()];
            for range in [0..bottom, top..rows.len()] {
                openings.extend(self.opening(run_columns, &rows, &run, range, span));
            }
            first += run.len();
        }
        openings
    }

    /// Returns start and end along the border of a run of `count` columns from `first` on.
    fn span(&self, columns: &[f64], rows: &[f64], first: usize, count: usize) -> [f64; 2] {
        let same_as = |known: f64, s: f64| match (self.column(known, rows), self.column(s, rows)) {
            (Some(known), Some(other)) => known.continues(&other),
            _ => false,
        };
        let last = columns[first + count - 1];
        let start = if first == 0 {
            0.0
        } else {
            bisect(columns[first], columns[first - 1], |s| {
                same_as(columns[first], s)
            })
        };
        let end = columns
            .get(first + count)
            .map_or(self.border.length, |&next| {
                bisect(last, next, |s| same_as(last, s))
            });
        [start, end]
    }

    /// Returns the opening of a run of columns in a range of rows; `None` without an open row or
    /// for a crack.
    fn opening(
        &self,
        columns: &[f64],
        rows: &[f64],
        run: &[&Column],
        range: Range<usize>,
        span: [f64; 2],
    ) -> Option<BorderOpening> {
        let gap = run
            .iter()
            .map(|column| column.beyond.gap)
            .fold(0.0, f64::max);
        let beyond = SpaceBeyond {
            gap,
            ..run[0].beyond
        };
        let open = || {
            run.iter()
                .flat_map(|column| column.open.iter().copied())
                .filter(|row| range.contains(row))
        };
        let (lowest, highest) = (open().min()?, open().max()?);
        let is_open = |y: f64| {
            columns.iter().any(|&s| {
                self.beyond(s, y)
                    .is_some_and(|other| self.passes(s, y, other))
            })
        };
        let low = if lowest == 0 {
            self.border.floor
        } else {
            bisect(rows[lowest], rows[lowest - 1], is_open)
        };
        let high = rows.get(highest + 1).map_or(self.border.ceiling, |&next| {
            bisect(rows[highest], next, is_open)
        });
        let min_size = MIN_SIZE_M[usize::from(self.model.is_outside(beyond.cell))];
        let is_large = span[1] - span[0] >= min_size && high - low >= min_size;
        is_large.then_some(BorderOpening {
            beyond,
            span,
            heights: [low, high],
        })
    }

    /// Traces the rays of a column; `None` if no ray passes.
    fn column(&self, s: f64, rows: &[f64]) -> Option<Column> {
        let mut reached = Vec::new();
        let mut portal: Option<[usize; 2]> = None;
        // The space beyond changes only at floors and ceilings.
        let mut known = None;
        for (row, &y) in rows.iter().enumerate() {
            let storey = self.levels.partition_point(|&level| level <= y);
            let beyond = match known {
                Some((same, beyond)) if same == storey => beyond,
                _ => self.beyond(s, y),
            };
            known = Some((storey, beyond));
            let Some(beyond) = beyond else { continue };
            if self.is_in_portal(s, y) {
                portal = Some([portal.map_or(row, |[first, _]| first), row]);
            } else if self.passes(s, y, beyond) {
                reached.push((beyond, row));
            }
        }
        // A room takes precedence over the outside.
        let (beyond, _) = *reached
            .iter()
            .min_by_key(|(beyond, _)| self.model.is_outside(beyond.cell))?;
        let open = reached
            .iter()
            .filter(|(other, _)| other.cell == beyond.cell)
            .map(|(_, row)| *row)
            .collect();
        Some(Column {
            beyond,
            open,
            portal,
        })
    }

    /// Returns true if there is already a portal within the reach of a wall.
    fn is_in_portal(&self, s: f64, y: f64) -> bool {
        let [near, far] =
            [-CLEAR_M[0], REACH_M + CLEAR_M[0]].map(|out| self.border.point(s, y, out));
        self.polygons
            .iter()
            .any(|polygon| polygon.hit(near, far - near, 0.0).is_some_and(|t| t <= 1.0))
    }

    /// Returns the nearest other cell beyond the border, else the outside; `None` where the border
    /// is inside of its own cell or of one that takes precedence over it.
    fn beyond(&self, s: f64, y: f64) -> Option<SpaceBeyond> {
        let cell_at = |out: f64| self.cell_at(self.border.point(s, y, out));
        let own = Some(self.border.cell);
        if cell_at(-STEP_M) != own || cell_at(STEP_M) == own {
            return None;
        }
        let is_room = |cell: u32| !self.model.is_outside(cell) && cell != self.border.cell;
        let steps = (1..=(REACH_M / STEP_M) as u32).map(|step| f64::from(step) * STEP_M);
        let room = steps
            .clone()
            .find_map(|out| Some((out, cell_at(out).filter(|&cell| is_room(cell))?)));
        match room {
            // Spaces closer than a step are adjacent.
            Some((out, cell)) => Some(SpaceBeyond {
                cell,
                gap: if out <= STEP_M { 0.0 } else { out },
            }),
            // The other side of a thin part of its own cell.
            None if steps.clone().any(|out| cell_at(out) == own) => None,
            None => Some(SpaceBeyond {
                cell: self.model.outside?,
                gap: 0.0,
            }),
        }
    }

    /// Returns true if a ray from the cell perpendicular to the border reaches the space beyond.
    fn passes(&self, s: f64, y: f64, beyond: SpaceBeyond) -> bool {
        let at = |out: f64| self.border.point(s, y, out);
        let clear = |cell: u32, from: f64, side: f64| {
            let mut distances = CLEAR_M.into_iter().map(|clear| from + side * clear);
            distances.find(|&out| self.cell_at(at(out)) == Some(cell))
        };
        let far = if self.model.is_outside(beyond.cell) {
            Some(REACH_M + CLEAR_M[0])
        } else {
            clear(beyond.cell, beyond.gap, 1.0)
        };
        let (Some(near), Some(far)) = (clear(self.border.cell, 0.0, -1.0), far) else {
            return false;
        };
        let (origin, end) = (at(near), at(far));
        let ray = Ray {
            t_max: 1.0,
            ..Ray::new(
                (origin - self.tracer.origin()).as_vec3(),
                (end - origin).as_vec3(),
            )
        };
        !self.is_in_portal(s, y) && !self.tracer.occluded(&ray)
    }
}

/// Bisects between `yes`, where a condition holds, and `no`, where it does not. Returns the end of
/// the last interval on the side of `no`.
fn bisect(mut yes: f64, mut no: f64, holds: impl Fn(f64) -> bool) -> f64 {
    for _ in 0..HALVINGS {
        let middle = (yes + no) / 2.0;
        *(if holds(middle) { &mut yes } else { &mut no }) = middle;
    }
    no
}
