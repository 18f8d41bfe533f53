// Pictures on planes: their texels at four sizes in the layers of one atlas, and what is drawn of each (planes.rs, mips.rs).
import { readTexels } from '../texels.js';

/** Texels a side of a layer. */
export const ATLAS_PX = 2048;
/** Sizes of a picture, each half of the one before. */
export const LEVELS = 4;
/** Bytes of a picture in a vertex buffer: normal over distance, place and size, face, and where its sizes are in the atlas. */
export const TILE_BYTES = 44;

/** Texels along a side at a size: every second one of the larger, and the last. */
const side = (length, level) => Math.ceil((length - 1) / 2 ** level) + 1;

/**
 * Numbers that lie in `outer` runs of `length` times `inner`, at half the length, times 16: of each and its neighbours -1, 4, 10, 4, -1
 * sixteenths; those at the ends are kept as they are.
 */
function halveAlong(from, outer, length, inner) {
  const [shorter, last] = [side(length, 1), length - 1];
  const to = new Int32Array(outer * shorter * inner);
  for (let run = 0; run < outer; run++) {
    for (let i = 0; i < shorter; i++) {
      const out = (run * shorter + i) * inner;
      const middle = (run * length + Math.min(2 * i, last)) * inner;
      if (i === 0 || 2 * i >= last) {
        for (let k = 0; k < inner; k++) to[out + k] = 16 * from[middle + k];
        continue;
      }
      const [near, far, end] = [inner, 2 * inner, 2 * i + 1 < last ? 2 * inner : inner];
      for (let k = middle; k < middle + inner; k++) {
        to[out + k - middle] = 10 * from[k] + 4 * (from[k - near] + from[k + near]) - from[k - far] - from[k + end];
      }
    }
  }
  return to;
}

/** A picture at half of its size. */
function halve(from, [width, height]) {
  const sums = halveAlong(halveAlong(from, height, width, 4), 1, height, side(width, 1) * 4);
  const to = new Uint8ClampedArray(sums.length);
  for (let i = 0; i < sums.length; i++) to[i] = (sums[i] + 128) >> 8;
  // No colour is more than alpha.
  for (let i = 0; i < to.length; i += 4) for (let c = 0; c < 3; c++) to[i + c] = Math.min(to[i + c], to[i + 3]);
  return new Uint8Array(to.buffer);
}

/** Places for rectangles on shelves: the tallest first, each layer filled before the next. */
function shelves(rectangles) {
  const order = rectangles.map((_, i) => i).sort((a, b) => rectangles[b][1] - rectangles[a][1]);
  const places = [];
  let [x, y, layer, shelf] = [0, 0, 0, 0];
  for (const i of order) {
    const [width, height] = rectangles[i];
    if (x + width > ATLAS_PX) [x, y, shelf] = [0, y + shelf, 0];
    if (y + height > ATLAS_PX) [x, y, shelf, layer] = [0, 0, 0, layer + 1];
    places[i] = [x, y, layer];
    x += width;
    shelf = Math.max(shelf, height);
  }
  return [places, rectangles.length ? layer + 1 : 0];
}

/** The pictures of a set, each at all of its sizes, with a place in the atlas; `partial`: how many are not opaque everywhere. */
export function readPlanes(bytes, part) {
  const view = new DataView(bytes.buffer, bytes.byteOffset);
  const tiles = [];
  for (let i = 0; i < part.tiles; i++) {
    const at = part.planes * 12 + i * 20;
    const plane = view.getUint32(at, true) * 12;
    tiles.push({
      normal: [0, 4, 8].map((offset) => view.getFloat32(plane + offset, true)),
      first: view.getUint32(at + 4, true),
      x0: view.getInt16(at + 8, true),
      y0: view.getInt16(at + 10, true),
      width: view.getUint16(at + 12, true),
      height: view.getUint16(at + 14, true),
      face: view.getUint16(at + 16, true),
      opaque: view.getUint16(at + 18, true) === 1,
    });
  }
  const texels = readTexels(bytes.subarray(part.planes * 12 + part.tiles * 20), tiles, part.texels);
  const pictures = [];
  for (const { width, height, first } of tiles) {
    let size = [width, height];
    let picture = texels.subarray(first * 4, (first + width * height) * 4);
    pictures.push({ size, picture });
    for (let level = 1; level < LEVELS; level++) {
      const smaller = [side(width, level), side(height, level)];
      picture = halve(picture, size);
      size = smaller;
      pictures.push({ size, picture });
    }
  }
  const [places, layers] = shelves(pictures.map(({ size }) => size));
  pictures.forEach((picture, i) => (picture.place = places[i]));
  const partial = tiles.filter(({ opaque }) => !opaque).length;
  return { vertices: vertices(tiles, places), pictures, layers, count: tiles.length, partial };
}

/** Vertices of all tiles; those that are not opaque everywhere come first. */
function vertices(tiles, places) {
  const buffer = new DataView(new ArrayBuffer(tiles.length * TILE_BYTES));
  const order = tiles.map((_, i) => i).sort((a, b) => tiles[a].opaque - tiles[b].opaque);
  order.forEach((i, position) => {
    const tile = tiles[i];
    const at = position * TILE_BYTES;
    tile.normal.forEach((c, k) => buffer.setFloat32(at + 4 * k, c, true));
    [tile.x0, tile.y0, tile.width, tile.height].forEach((c, k) => buffer.setInt16(at + 12 + 2 * k, c, true));
    buffer.setUint32(at + 20, tile.face, true);
    for (let level = 0; level < LEVELS; level++) {
      const [x, y, layer] = places[i * LEVELS + level];
      buffer.setUint32(at + 24 + 4 * level, x + ATLAS_PX * (y + ATLAS_PX * layer), true);
    }
  });
  return buffer.buffer;
}
