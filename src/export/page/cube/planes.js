// Pictures on planes: their texels at four sizes in the layers of one atlas, and what is drawn of each (planes.rs, mips.rs).

/** Texels a side of a layer. */
export const ATLAS_PX = 2048;
/** Sizes of a picture, each half of the one before. */
export const LEVELS = 4;
/** Bytes of a picture in a vertex buffer: normal over distance, place and size, face, and where its sizes are in the atlas. */
export const TILE_BYTES = 44;

/** Texels along a side at a size: every second one of the larger, and the last. */
const side = (length, level) => Math.ceil((length - 1) / 2 ** level) + 1;

/** Texels, four bytes each, from what texels.rs left of them: what each is more than the one on its left or, in the first column, above. */
function readTexels(bytes, tiles, count) {
  const texels = new Uint8Array(count * 4);
  let alphas = count * 3;
  for (const { width, height, first, opaque } of tiles) {
    for (let i = 0; i < width * height; i++) {
      const [at, from] = [(first + i) * 4, (first + i) * 3];
      const beside = i % width > 0 ? at - 4 : at - width * 4;
      const was = (c) => (i === 0 ? 0 : texels[beside + c]);
      const green = bytes[from];
      texels[at] = was(0) + green + bytes[from + 1];
      texels[at + 1] = was(1) + green;
      texels[at + 2] = was(2) + green + bytes[from + 2];
      texels[at + 3] = opaque ? 255 : was(3) + bytes[alphas++];
    }
  }
  return texels;
}

/** Of a texel, what is taken of it and of its neighbours into one of half as many, in sixteenths. */
const HALVING = [-1, 4, 10, 4, -1];

/** Which texels of a line are taken into the `i`th of half as many, and their weights; those at the ends are kept as they are. */
function taps(i, length) {
  const [middle, last] = [2 * i, length - 1];
  if (middle === 0 || middle >= last) return [[Math.min(middle, last), 16]];
  return HALVING.map((weight, k) => [Math.min(Math.max(middle + k - 2, 0), last), weight]);
}

/** A picture at half of its size. */
function halve(from, [width, height], [newWidth, newHeight]) {
  const to = new Uint8Array(newWidth * newHeight * 4);
  for (let y = 0; y < newHeight; y++) {
    const rows = taps(y, height);
    for (let x = 0; x < newWidth; x++) {
      const sum = [0, 0, 0, 0];
      for (const [column, across] of taps(x, width)) {
        for (const [row, down] of rows) {
          for (let c = 0; c < 4; c++) sum[c] += across * down * from[(row * width + column) * 4 + c];
        }
      }
      const at = (y * newWidth + x) * 4;
      const mean = sum.map((c) => Math.min(Math.max(Math.floor((c + 128) / 256), 0), 255));
      for (let c = 0; c < 4; c++) to[at + c] = Math.min(mean[c], mean[3]);
    }
  }
  return to;
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

/** The pictures of a set, each at all of its sizes, with a place in the atlas. */
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
      picture = halve(picture, size, smaller);
      size = smaller;
      pictures.push({ size, picture });
    }
  }
  const [places, layers] = shelves(pictures.map(({ size }) => size));
  pictures.forEach((picture, i) => (picture.place = places[i]));
  return { vertices: vertices(tiles, places), pictures, layers, count: tiles.length };
}

function vertices(tiles, places) {
  const buffer = new DataView(new ArrayBuffer(tiles.length * TILE_BYTES));
  tiles.forEach((tile, i) => {
    const at = i * TILE_BYTES;
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
