// What a frame needs of a lumigraph: its layers, merged as far as the eye cannot tell them apart, and where they lie in the images
// (plan.rs, merge.rs, bounds.rs of the lumigraph). Plane space: x to the right, y up, z to where the cameras look.
import { dot, scale, subtract } from '../vectors.js';

/** How far neighbouring cameras may disagree, pixels of an image or of the frame; and how far apart merged layers are neighbours. */
const [TOLERANCE_PX, NEIGHBOURS] = [1, 1.5];
/** Least forward part of a direction, and least share of the eye's own depth at which a layer is drawn. */
const [LEAST_FORWARD, LEAST_AHEAD] = [1e-6, 1e-6];
/** A coarser level serves from this share of an octave later on. */
const SHARPER = 0.25;
/** Cells that are asked to each side of a ray's own where something hides what it meets. */
const WIDER = 2;

/** A camera in plane space: its eye, the direction of pixel position (0, 0), and what a column and a row add to it. */
function viewOf(grid, { eye, right, up, back, focal, principal, size }) {
  const inPlane = (v) => [dot(grid.right, v), dot(grid.up, v), -dot(grid.back, v)];
  const along = (x, y) => {
    const [across, down] = [(x - principal[0]) / focal[0], (y - principal[1]) / focal[1]];
    return inPlane(subtract(subtract(scale(right, across), scale(up, down)), back));
  };
  const start = along(0, 0);
  return { eye: inPlane(eye), start, step: [subtract(along(1, 0), start), subtract(along(0, 1), start)], size };
}

const directionAt = ({ start, step }, [x, y]) => start.map((c, i) => c + step[0][i] * x + step[1][i] * y);

/** The slopes of a pixel position; null if it does not look forward. */
function slopesAt(view, at) {
  const [x, y, z] = directionAt(view, at);
  return z > LEAST_FORWARD ? [x / z, y / z] : null;
}

/** Pixels of the frame for a unit of slope, the most anywhere and in the middle; null if the middle does not look forward. */
function pxPerSlope(view) {
  const at = ([x, y]) => [view.size[0] * x, view.size[1] * y];
  const scaleAt = (share) => {
    const [slopes, z] = [slopesAt(view, at(share)), directionAt(view, at(share))[2]];
    if (!slopes) return null;
    const [a, b] = view.step.map((step) => [0, 1].map((i) => (step[i] - slopes[i] * step[2]) / z));
    const area = Math.abs(a[0] * b[1] - a[1] * b[0]);
    const squares = a[0] ** 2 + a[1] ** 2 + b[0] ** 2 + b[1] ** 2;
    const least = 0.5 * (squares - Math.sqrt(Math.max(squares ** 2 - 4 * area ** 2, 0)));
    return area > 0 && least > 0 ? [1 / Math.sqrt(least), 1 / Math.sqrt(area)] : null;
  };
  const middle = scaleAt([0.5, 0.5]);
  if (!middle) return null;
  const shares = [0, 0.5, 1].flatMap((x) => [0, 0.5, 1].map((y) => [x, y]));
  return [Math.max(...shares.map((share) => scaleAt(share)?.[0] ?? 0), middle[1]), middle[1]];
}

/** How far from the nearest camera rays that may meet something cross the plane beside the grid, metres. */
function besideTheGrid(grid, layers, view) {
  const [width, height] = view.size;
  const corners = [[0, 0], [width, 0], [0, height], [width, height]].map((corner) => slopesAt(view, corner));
  if (layers.length === 0 || corners.includes(null)) return 0;
  const behind = -view.eye[2];
  let beside = 0;
  for (const disparity of [layers[0][0], layers[layers.length - 1][1]]) {
    if (1 + behind * disparity <= LEAST_AHEAD) continue;
    [grid.columns, grid.rows].forEach((places, axis) => {
      const ends = [places[0], places[places.length - 1]];
      const half = grid.size[axis] / 2 / grid.focal;
      const frame = corners.map((slopes) => view.eye[axis] - slopes[axis] * view.eye[2]);
      const crossings = [-1, 1].map((side) => {
        const seen = ends.map((place) => place + (side * half - place * grid.convergence) / disparity);
        const point = side < 0 ? Math.min(...seen) : Math.max(...seen);
        return view.eye[axis] + ((point - view.eye[axis]) * behind * disparity) / (1 + behind * disparity);
      });
      const [low, high] = [Math.max(Math.min(...crossings), Math.min(...frame)), Math.min(Math.max(...crossings), Math.max(...frame))];
      beside = Math.max(beside, ends[0] - low, high - ends[1]);
    });
  }
  return beside;
}

const widest = (places) => Math.max(0, ...places.slice(1).map((place, i) => place - places[i]));

/** Layers that are shown as one, near ones first, what is at infinity last: numbers from 1 for the farthest, disparity, level. */
function merged(grid, layers, view, levels) {
  const behind = -view.eye[2];
  const [most, middle] = pxPerSlope(view) ?? [grid.focal, grid.focal];
  const tolerance = TOLERANCE_PX * Math.max(1 / grid.focal, 1 / most);
  const spacing = Math.max(widest(grid.columns), widest(grid.rows), besideTheGrid(grid, layers, view));
  const allows = (min, max, bound) =>
    1 + max * behind > 0 && (spacing * (max - min)) / (2 + (max + min) * behind) <= bound;
  const found = [];
  const add = (indices, drawn) => {
    const ahead = 1 + behind * drawn;
    const finer = Math.log2((grid.focal * ahead) / middle);
    const level = Math.min(Math.max(Math.floor(finer - SHARPER), 0), levels - 1);
    if (ahead > LEAST_AHEAD) found.unshift({ indices, wide: [...indices], drawn, level });
  };
  add([0, 0], 0);
  for (let first = 0, end; first < layers.length; first = end) {
    end = first + 1;
    while (end < layers.length && allows(layers[first][0], layers[end][1], tolerance)) end++;
    add([first + 1, end], 0.5 * (layers[first][0] + layers[end - 1][1]));
  }
  for (let i = 1; i < found.length; i++) {
    const [front, back] = [found[i - 1], found[i]];
    // What is at infinity is nobody's neighbour.
    if (back.drawn > 0 && allows(back.drawn, front.drawn, NEIGHBOURS * tolerance)) {
      front.wide[0] = back.indices[0];
      back.wide[1] = front.indices[1];
    }
  }
  return found;
}

/** Where cells beside are looked for, near ones first: columns and rows from a ray's own. */
export function stepsOf({ columns, rows }) {
  const [x, y] = [columns, rows].map((places) => Math.max(Math.min(WIDER, places.length - 2), 0));
  const range = (most) => Array.from({ length: 2 * most + 1 }, (_, i) => i - most);
  const all = range(y).flatMap((row) => range(x).map((column) => [column, row])).filter(([column, row]) => column || row);
  return all.sort((a, b) => a[0] ** 2 + a[1] ** 2 - b[0] ** 2 - b[1] ** 2);
}

/**
 * What a frame shows: its rays in plane space, and for each merged layer twelve numbers. The texel of a ray with slopes (a, b) in the
 * image of a camera at (s, t) is (scale * a + x - shift * s, -scale * b + y + shift * t).
 */
export function planOf(grid, layers, camera, levels) {
  const view = viewOf(grid, camera);
  const found = merged(grid, layers, view, levels);
  const numbers = found.flatMap(({ indices, wide, drawn, level }) => {
    const coarser = 0.5 ** level;
    const focal = grid.focal * coarser;
    const [x, y] = grid.size.map((side) => (side / 2) * coarser);
    const [ex, ey, ez] = view.eye;
    const place = [focal * (1 - ez * drawn), x + focal * ex * drawn, y - focal * ey * drawn, focal * (drawn - grid.convergence)];
    return [...place, ...indices, ...wide, level, 0, 0, 0];
  });
  return { view, count: found.length, numbers: new Float32Array(numbers) };
}
