// A piece of a cell's surfaces as chunks.rs wrote it.

/** Bytes of a vertex: position, three floats; colour, four halves; texture coordinate, two floats. */
export const VERTEX_BYTES = 28;

/** Reads arrays one after another, each as its bytes from the lowest on: all lowest bytes, then the next, and so on. */
class Reader {
  constructor(bytes) {
    Object.assign(this, { bytes, at: 0 });
  }

  /** The next `count` numbers of some bytes each, unsigned. */
  numbers(count, width) {
    const { bytes, at } = this;
    this.at += count * width;
    if (this.at > bytes.length) throw new Error('a part of this page is shorter than it says');
    const values = new Uint32Array(count);
    for (let k = 0; k < width; k++) for (let i = 0; i < count; i++) values[i] |= bytes[at + k * count + i] << (8 * k);
    return values;
  }

  /** Numbers of which each is given as what it is more than the one before, by zigzag. */
  sums(count, width) {
    const values = this.numbers(count, width);
    let sum = 0;
    for (let i = 0; i < count; i++) values[i] = sum = (sum + ((values[i] >>> 1) ^ -(values[i] & 1))) | 0;
    return values;
  }
}

/** The vertices of a piece, and its triangles' corners. */
export function readMesh(bytes, { vertices: count, triangles, textured }, step) {
  const reader = new Reader(bytes);
  const corners = new Uint16Array(triangles * 3);
  let next = 0;
  // Each as far back from the first vertex that has not been named yet.
  reader.numbers(triangles * 3, 2).forEach((back, i) => {
    corners[i] = next - back;
    if (back === 0) next++;
  });
  const vertices = new ArrayBuffer(count * VERTEX_BYTES);
  const [floats, words, halves] = [new Float32Array(vertices), new Uint32Array(vertices), new Uint16Array(vertices)];
  /** Puts the values of all vertices into every vertex's place `at` of an array of so many places a vertex. */
  const put = (array, at, places, values) => values.forEach((value, i) => (array[i * places + at] = value));
  const positions = (values) => Float64Array.from(values, (value) => (value | 0) * step);
  for (let axis = 0; axis < 3; axis++) put(floats, axis, VERTEX_BYTES / 4, positions(reader.sums(count, 4)));
  for (let channel = 0; channel < 3; channel++) put(halves, 6 + channel, VERTEX_BYTES / 2, reader.sums(count, 2));
  for (let axis = 0; textured && axis < 2; axis++) put(words, 5 + axis, VERTEX_BYTES / 4, reader.sums(count, 4));
  return { vertices, corners };
}
