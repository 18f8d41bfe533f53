// Texels of pictures.

/** Texels, four bytes each, from what texels.rs left of them: what each is more than the one on its left or, in the first column, above. */
export function readTexels(bytes, tiles, count) {
  const texels = new Uint8Array(count * 4);
  let alphas = count * 3;
  for (const { width, height, first, opaque } of tiles) {
    for (let i = 0; i < width * height; i++) {
      const [at, from] = [(first + i) * 4, (first + i) * 3];
      // The first is more than nothing, which it is as yet.
      const beside = i === 0 ? at : i % width > 0 ? at - 4 : at - width * 4;
      const green = bytes[from];
      texels[at] = texels[beside] + green + bytes[from + 1];
      texels[at + 1] = texels[beside + 1] + green;
      texels[at + 2] = texels[beside + 2] + green + bytes[from + 2];
      texels[at + 3] = opaque ? 255 : texels[beside + 3] + bytes[alphas++];
    }
  }
  return texels;
}
