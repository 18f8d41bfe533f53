// Which cells show: portals clipped by portals, on directions from the eye (cull.rs).
import { add, cross, dot, length, normalize, scale, subtract } from '../vectors.js';

/** How far from a portal's plane an eye in its opening is in the cell on that side, metres (house.rs). */
const REVEAL_M = 0.3;
/** What grows windows, a sine; how near to its outline a portal is passed unclipped, metres; portals on a line, and views in all. */
const [SLACK, TOUCHING_M, DEPTH, VIEWS] = [1e-5, 1e-3, 32, 4096];

const pairs = (polygon) => polygon.map((a, i) => [a, polygon[(i + 1) % polygon.length]]);
const sum = (vectors) => vectors.reduce(add, [0, 0, 0]);
const unit = (v) => (length(v) > 0 ? normalize(v) : v);

/** Newell's normal of a polygon, of unit length; counter-clockwise seen from where it points. */
const normalOf = (polygon) => unit(sum(pairs(polygon).map(([a, b]) => cross(subtract(a, polygon[0]), subtract(b, polygon[0])))));

function inPrism({ outline, floor, ceiling }, [x, y, z]) {
  let inside = false;
  if (y >= floor && y < ceiling) {
    for (const [[ax, az], [bx, bz]] of pairs(outline)) {
      if (bz > z !== az > z && x < bx + ((z - bz) / (az - bz)) * (ax - bx)) inside = !inside;
    }
  }
  return inside;
}

/** The cell of an eye; null where there is none. In the thickness of a wall, between the sides of a portal, its plane decides. */
export function cellOf({ cells, portals, outside }, eye) {
  for (const { cells: sides, polygon } of portals) {
    const normal = normalOf(polygon);
    const inFront = dot(normal, subtract(eye, polygon[0]));
    const within = ([a, b]) => dot(cross(subtract(b, a), subtract(eye, a)), normal) >= 0;
    if (Math.abs(inFront) < REVEAL_M && pairs(polygon).every(within)) return sides[inFront < 0 ? 1 : 0];
  }
  const found = cells.findIndex(({ space }) => space.some((prism) => inPrism(prism, eye)));
  return found >= 0 ? found : outside;
}

/** The planes through the eye that bound a window: inward normals. */
export const planesOf = (window) => pairs(window).map(([a, b]) => cross(b, a)).filter((n) => length(n) > 0).map(normalize);

/** The part of a polygon of directions inside a window; null if there is none. */
function clip(polygon, window) {
  let edges = polygon;
  for (const plane of planesOf(window)) {
    const inside = (d) => dot(plane, d) + SLACK * length(d);
    edges = pairs(edges).flatMap(([here, there]) => {
      const [a, b] = [inside(here), inside(there)];
      const kept = a >= 0 ? [here] : [];
      return a >= 0 !== b >= 0 ? [...kept, add(here, scale(subtract(there, here), a / (a - b)))] : kept;
    });
  }
  return edges.length >= 3 ? edges : null;
}

/** The window through a portal from a cell, within another window; null if it shows nothing. */
function through({ cells, polygon }, eye, cell, window) {
  const outline = polygon.map((corner) => subtract(corner, eye));
  if (cells[0] !== cell) outline.reverse();
  const normal = normalOf(outline);
  const inFront = -dot(normal, outline[0]);
  const outward = pairs(outline).map(([a, b]) => -dot(unit(cross(subtract(b, a), normal)), a));
  if (Math.abs(inFront) <= TOUCHING_M && Math.max(...outward) <= TOUCHING_M) return window;
  return inFront > 0 ? clip(outline, window) : null;
}

/** What a camera sees, as the directions of its corners, counter-clockwise. */
function windowOf({ right, up, back, focal, principal, size }) {
  return [[0, size[1]], size, [size[0], 0], [0, 0]].map(([x, y]) => {
    const [across, down] = [(x - principal[0]) / focal[0], (y - principal[1]) / focal[1]];
    return subtract(subtract(scale(right, across), scale(up, down)), back);
  });
}

/** For each cell that shows, the windows through which it does; null where the eye is in no cell, and all may. */
export function visibleCells(house, camera) {
  const cell = cellOf(house, camera.eye);
  if (cell === null) return null;
  const seen = new Map();
  const stack = [{ cell, passed: [], window: windowOf(camera) }];
  for (let views = 0; stack.length > 0 && views < VIEWS; views++) {
    const { cell, passed, window } = stack.pop();
    seen.set(cell, [...(seen.get(cell) ?? []), planesOf(window)]);
    house.portals.forEach((portal, number) => {
      if (!portal.cells.includes(cell) || passed.includes(number) || passed.length >= DEPTH) return;
      const next = through(portal, camera.eye, cell, window);
      if (next) stack.push({ cell: portal.cells[portal.cells[0] === cell ? 1 : 0], passed: [...passed, number], window: next });
    });
  }
  return seen;
}

/** Whether a box may show through a window, given by its planes. */
export const mayShow = ([low, high], eye, planes) =>
  planes.every((plane) => dot(plane, subtract(plane.map((c, i) => (c > 0 ? high[i] : low[i])), eye)) >= -1e-3);
