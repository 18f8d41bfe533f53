// From a sprite's camera to another: homography of the plane and epipole, and where pure parallax takes displacements (transfer.rs,
// pure_parallax.rs).
import { toFrame } from '../camera.js';
import { add, cross, dot, length, scale, subtract } from '../vectors.js';
import { codingOf } from './field.js';

/** The product of a matrix, column by column, and a vector. */
const times = ([x, y, z], v) => add(add(scale(x, v[0]), scale(y, v[1])), scale(z, v[2]));

/** The inverse of a matrix, column by column. */
function inverse([a, b, c]) {
  const rows = [cross(b, c), cross(c, a), cross(a, b)];
  const determinant = dot(a, rows[0]);
  return [0, 1, 2].map((column) => rows.map((row) => row[column] / determinant));
}

/** The maps of a sprite for a camera; null where nothing shows. */
export function transferOf({ view, size }, camera, edgeOn) {
  const { eye, right, down, corner, normal, distance, middle } = view;
  const offset = subtract(camera.eye, eye);
  const height = dot(normal, offset) + distance;
  if (!(Math.abs(height) > edgeOn * length(subtract(camera.eye, middle)))) return null;
  const project = (v) => {
    const [x, y, w] = toFrame(camera, v);
    return [x + camera.principal[0] * w, y + camera.principal[1] * w, w];
  };
  const baseline = project(scale(offset, -1));
  const inFrame = [right, down, corner].map((v) => add(project(v), scale(baseline, -dot(v, normal) / distance)));
  const shows = [[0, 0], [1, 0], [0, 1], [1, 1]].some(([x, y]) => times(inFrame, [x * size[0], y * size[1], 1])[2] > 0);
  const fromFrame = inverse(inFrame);
  const epipole = times(fromFrame, scale(baseline, 1 / distance));
  const finite = [...fromFrame.flat(), ...epipole].every(Number.isFinite);
  return shows && finite ? { fromFrame, epipole, side: Math.sign(height) } : null;
}

/** First and last cell that positions from 0 to a length can reach, at most as far again beyond either end. */
function reach(all, range, epipole, epipoleZ) {
  const ends = [0, all].flatMap((x) => range.map((d) => (x + d * epipole) / (1 + d * epipoleZ)));
  return [Math.floor(Math.max(Math.min(0, ...ends), -all)), Math.ceil(Math.min(Math.max(all, ...ends), 2 * all))];
}

/** The first pass: the epipole in cells, and where the field that it makes lies, its size and its coding. */
export function parallaxOf({ coding, range, cells, cellPx }, { epipole, side }, { nearest, steepest }) {
  const [x, y, z] = [epipole[0] / cellPx[0], epipole[1] / cellPx[1], epipole[2]];
  const limit = (nearest - 1) / z;
  const inFront = z > 0 ? range.map((d) => Math.max(d, limit)) : z < 0 ? range.map((d) => Math.min(d, limit)) : range;
  const [columns, rows] = [reach(cells[0], inFront, x, z), reach(cells[1], inFront, y, z)];
  const ends = inFront.map((d) => d / (1 + d * z));
  const shallowest = Math.min(1, ...inFront.map((d) => 1 + d * z));
  return {
    epipole: [x, y, z],
    from: [columns[0], rows[0]],
    extent: [columns[1] - columns[0], rows[1] - rows[0]],
    coding: codingOf(Math.min(...ends), Math.max(...ends), ((127 * coding.slopeScale) / shallowest) * 1.25, side, steepest),
  };
}
