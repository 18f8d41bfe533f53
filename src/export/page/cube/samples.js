// Samples, read as samples.rs writes them.

/** Bytes of a sample in a vertex buffer: 11 + 20 bits of geometry, colour, column and row on the face. */
export const SAMPLE_BYTES = 12;

/** The vertices of a part, and of its blocks the place, the number of samples, and the extremes of the depth codes. */
export function readSamples(bytes, part, blockPx) {
  const vertices = new ArrayBuffer(part.samples * SAMPLE_BYTES);
  const [words, shorts] = [new Uint32Array(vertices), new Uint16Array(vertices)];
  const colors = new Uint8Array(vertices);
  const places = new DataView(bytes.buffer, bytes.byteOffset);
  const perSample = bytes.length - 9 * part.samples;
  const plane = (i) => perSample + i * part.samples;
  const [low, middle, high, splatLow, splatHigh] = [plane(0), plane(1), plane(2), plane(3), plane(4)];
  const [green, red, blue, alpha] = [plane(5), plane(6), plane(7), plane(8)];
  const codes = new Int32Array(part.samples);
  const splats = new Uint16Array(part.samples);
  const pixels = blockPx * blockPx;
  const [starts, counts] = [new Int32Array(pixels), new Int32Array(pixels)];
  const blocks = [];
  let [n, count] = [0, part.blocks * 4];
  const largest = (1 << 20) - 1;
  for (let block = 0; block < part.blocks; block++) {
    const [column, row] = [places.getUint16(block * 4, true), places.getUint16(block * 4 + 2, true)];
    const first = n;
    let [farthest, nearest] = [largest, 0];
    for (let i = 0; i < pixels; i++) {
      let here = 0;
      let byte;
      do here += byte = bytes[count++]; while (byte === 255);
      starts[i] = n;
      counts[i] = here;
      const [x, y] = [i % blockPx, Math.floor(i / blockPx)];
      const left = x > 0 ? counts[i - 1] : 0;
      const above = y > 0 ? counts[i - blockPx] : 0;
      const aboveLeft = x > 0 && y > 0 ? counts[i - blockPx - 1] : 0;
      for (let k = 0; k < here; k++, n++) {
        let beside = n - 1;
        if (left > 0) beside = starts[i - 1] + Math.max(left + k - here, 0);
        else if (above > 0) beside = starts[i - blockPx] + Math.max(above + k - here, 0);
        let expected = beside < 0 ? 0 : codes[beside];
        if (left === here && above === here && aboveLeft === here) {
          expected = codes[starts[i - 1] + k] + codes[starts[i - blockPx] + k] - codes[starts[i - blockPx - 1] + k];
          expected = Math.min(Math.max(expected, 0), largest);
        }
        const zigzag = bytes[low + n] | (bytes[middle + n] << 8) | (bytes[high + n] << 16);
        const code = expected + ((zigzag >>> 1) ^ -(zigzag & 1));
        codes[n] = code;
        splats[n] = ((beside < 0 ? 0 : splats[beside]) + bytes[splatLow + n] + (bytes[splatHigh + n] << 8)) & 0x7ff;
        farthest = Math.min(farthest, code);
        nearest = Math.max(nearest, code);
        words[n * 3] = code | (splats[n] << 20);
        const [to, from] = [n * 12 + 4, beside * 12 + 4];
        const g = bytes[green + n];
        const was = (c) => (beside < 0 ? 0 : colors[from + c]);
        colors[to] = was(0) + bytes[red + n] + g;
        colors[to + 1] = was(1) + g;
        colors[to + 2] = was(2) + bytes[blue + n] + g;
        colors[to + 3] = was(3) + bytes[alpha + n];
        shorts[n * 6 + 4] = column * blockPx + x;
        shorts[n * 6 + 5] = row * blockPx + y;
      }
    }
    blocks.push({ x: column * blockPx, y: row * blockPx, count: n - first, farthest, nearest });
  }
  if (n !== part.samples) throw new Error('a part of this page holds another number of samples than it says');
  return { vertices, blocks };
}
