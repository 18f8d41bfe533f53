// A sprite's displacements and its picture, as the two passes read them (displacements.rs, cell.rs, field.rs, texture.rs).
import { clamp } from '../vectors.js';
import { readTexels } from '../texels.js';

/** Sizes of a picture, each half of the one before: as many as show from about a sprite's own eye. */
export const LEVELS = 6;
/** Bytes of a stored displacement. */
const BYTES = { I8: 1, I16: 2, F32: 4 };
const MAX_VALUE = 32767;

/** Stored displacements, from what displacements.rs left of them. */
function readDisplacements(bytes, [width, height], format, scale) {
  const [count, size] = [width * height, BYTES[format]];
  const unused = 32 - 8 * size;
  const numbers = new Int32Array(count);
  for (let i = 0; i < count; i++) {
    let zigzag = 0;
    for (let byte = 0; byte < size; byte++) zigzag |= bytes[byte * count + i] << (8 * byte);
    const [left, above] = [numbers[i - 1], numbers[i - width]];
    let expected = i === 0 ? 0 : i % width === 0 ? above : left;
    if (i >= width && i % width > 0) {
      const ends = left < above ? [left, above] : [above, left];
      expected = clamp(left + above - numbers[i - width - 1], ...ends);
    }
    numbers[i] = ((expected + ((zigzag >>> 1) ^ -(zigzag & 1))) << unused) >> unused;
  }
  const stored = format === 'F32' ? new Float32Array(numbers.buffer) : Float32Array.from(numbers);
  return stored.map((number) => number * scale);
}

/** Displacements without the stairs of 8 bits: each goes toward the mean of its neighbours, no further than half a step. */
function smoothed(stored, [width, height], step, rounds) {
  let values = stored;
  for (let round = 0; round < rounds; round++) {
    const next = new Float32Array(values.length);
    for (let i = 0; i < values.length; i++) {
      const [x, y] = [i % width, Math.floor(i / width)];
      let [sum, count] = [0, 0];
      for (const [inside, stride] of [[x > 0 && x + 1 < width, 1], [y > 0 && y + 1 < height, width]]) {
        if (!inside || Math.abs(stored[i - stride] + stored[i + stride] - 2 * stored[i]) >= 1.5 * step) continue;
        sum += values[i - stride] + values[i + stride];
        count += 2;
      }
      const mean = count > 0 ? sum / count : values[i];
      next[i] = clamp(0.5 * (values[i] + mean), stored[i] - 0.5 * step, stored[i] + 0.5 * step);
    }
    values = next;
  }
  return values;
}

/** Slope at the middle of three neighbours, which does not cross edges; `undefined` beyond the border. */
function limited(before, here, after) {
  if (before === undefined) return after === undefined ? 0 : after - here;
  if (after === undefined) return here - before;
  const [left, right] = [here - before, after - here];
  const limit = 2 * Math.min(Math.abs(left), Math.abs(right));
  return left * right > 0 ? clamp(0.5 * (left + right), -limit, limit) : 0;
}

/** How cells hold displacements from `low` to `high` and slopes up to `steep` a cell; nearer is `side` times larger. */
export function codingOf(low, high, steep, side, steepest) {
  const slope = Math.min(steep, (high - low) * steepest);
  const step = (high - low + 2 * slope) / (MAX_VALUE - 1);
  if (!(step > 1e-37)) return { zero: 16384, scale: side, slopeScale: 1 };
  const zero = Math.round((side > 0 ? -(low - slope) / step : (high + slope) / step) + 1);
  return { zero, scale: step * side, slopeScale: slope > 1e-35 ? slope / 127 : 1 };
}

/** Which cells have something to show, under them or next to that. */
function visibleCells(texels, [width, height], [columns, rows]) {
  const ranges = (all, count) =>
    Array.from({ length: count }, (_, i) => {
      const edge = (k) => Math.floor((k * all) / count);
      return [Math.max(edge(i) - 1, 0), Math.min(edge(i + 1) + 1, all)];
    });
  const [across, down] = [ranges(width, columns), ranges(height, rows)];
  const visible = new Uint8Array(columns * rows);
  const shows = ([x0, x1], [y0, y1]) => {
    for (let y = y0; y < y1; y++) for (let x = x0; x < x1; x++) if (texels[(y * width + x) * 4 + 3] > 0) return 1;
    return 0;
  };
  for (let i = 0; i < visible.length; i++) visible[i] = shows(across[i % columns], down[Math.floor(i / columns)]);
  return visible;
}

/** Cells of value and slopes, how they are coded, and the least and largest displacement, 0 among them. */
function cellsOf(values, visible, [width, height], steepest) {
  const count = values.length;
  const slopes = [new Float32Array(count), new Float32Array(count)];
  let [low, high, steep] = [Infinity, -Infinity, 0];
  for (let i = 0; i < count; i++) {
    const [x, y] = [i % width, Math.floor(i / width)];
    slopes[0][i] = limited(x > 0 ? values[i - 1] : undefined, values[i], x + 1 < width ? values[i + 1] : undefined);
    slopes[1][i] = limited(y > 0 ? values[i - width] : undefined, values[i], y + 1 < height ? values[i + width] : undefined);
    [low, high] = [Math.min(low, values[i]), Math.max(high, values[i])];
    steep = Math.max(steep, Math.abs(slopes[0][i]), Math.abs(slopes[1][i]));
  }
  const coding = codingOf(low, high, steep, 1, steepest);
  const units = (slope) => clamp(Math.round(slope / coding.slopeScale), -127, 127) & 255;
  const cells = new Uint32Array(count);
  for (let i = 0; i < count; i++) {
    const value = Math.floor(clamp(values[i] / coding.scale + coding.zero + 0.5, 1, MAX_VALUE));
    cells[i] = (visible[i] << 31) | (value << 16) | (units(slopes[0][i]) << 8) | units(slopes[1][i]);
  }
  return { cells, coding, range: [Math.min(low, 0), Math.max(high, 0)] };
}

/** The picture times its alpha at all sizes, with room for halving: beyond its edge it is transparent. */
function levelsOf(texels, [width, height]) {
  const grain = 1 << (LEVELS - 1);
  let [columns, rows] = [width, height].map((side) => Math.ceil(side / grain) * grain);
  let pixels = new Uint8Array(columns * rows * 4);
  for (let y = 0; y < height; y++) {
    for (let x = 0; x < width; x++) {
      const [to, from] = [(y * columns + x) * 4, (y * width + x) * 4];
      const alpha = (pixels[to + 3] = texels[from + 3]);
      for (let c = 0; c < 3; c++) pixels[to + c] = (texels[from + c] * alpha * 2 + 255) / 510;
    }
  }
  const levels = [{ size: [columns, rows], pixels }];
  while (levels.length < LEVELS) {
    const before = { columns, pixels };
    [columns, rows] = [columns / 2, rows / 2];
    pixels = new Uint8Array(columns * rows * 4);
    for (let i = 0; i < pixels.length; i++) {
      const [x, y, c] = [(i >> 2) % columns, Math.floor((i >> 2) / columns), i & 3];
      const at = (2 * y * before.columns + 2 * x) * 4 + c;
      const below = at + before.columns * 4;
      pixels[i] = (before.pixels[at] + before.pixels[at + 4] + before.pixels[below] + before.pixels[below + 4] + 2) >> 2;
    }
    levels.push({ size: [columns, rows], pixels });
  }
  return levels;
}

/** A sprite of a part: points of its surface, its field, its picture. */
export function readSprite(bytes, part, { smoothing, steepest }) {
  const coordinates = new Float32Array(bytes.slice(0, part.points * 12).buffer);
  const points = Array.from({ length: part.points }, (_, i) => Array.from(coordinates.subarray(3 * i, 3 * i + 3)));
  const [[width, height], [columns, rows]] = [part.size, part.cells];
  const displacements = bytes.subarray(part.points * 12);
  const stored = readDisplacements(displacements, part.cells, part.format, part.scale);
  const step = part.format === 'I8' ? part.scale : 0;
  const values = smoothed(stored, part.cells, step, step > 0 ? smoothing : 0);
  const picture = { width, height, first: 0, opaque: part.opaque };
  const texels = readTexels(displacements.subarray(columns * rows * BYTES[part.format]), [picture], width * height);
  const visible = visibleCells(texels, part.size, part.cells);
  return { ...cellsOf(values, visible, part.cells, steepest), points, levels: levelsOf(texels, part.size) };
}
