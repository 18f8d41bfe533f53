// What lies at infinity: a cube map.

/** GL's six faces of a cube map in the order of ours. GL looks at them from outside: z is turned round in the shader. */
export const CUBE_ORDER = [0, 1, 2, 3, 5, 4];

/** A cube map of four arrays of a byte a texel (red, green, blue, whether it is known), all of them differences to the texel before. */
export function readSurroundings(gl, { size }, bytes) {
  const count = size * size * 6;
  const texels = new Uint8Array(count * 4);
  for (let c = 0; c < 4; c++) {
    for (let i = 0, value = 0; i < count; i++) texels[i * 4 + c] = value += bytes[c * count + i];
  }
  // What no miss has reached must not weigh.
  for (let i = 0; i < texels.length; i += 4) if (texels[i + 3] === 0) texels.fill(0, i, i + 3);
  const made = gl.createTexture();
  gl.bindTexture(gl.TEXTURE_CUBE_MAP, made);
  gl.texStorage2D(gl.TEXTURE_CUBE_MAP, 1, gl.RGBA8, size, size);
  CUBE_ORDER.forEach((face, ours) => {
    const pixels = texels.subarray(ours * size * size * 4, (ours + 1) * size * size * 4);
    const to = gl.TEXTURE_CUBE_MAP_POSITIVE_X + face;
    gl.texSubImage2D(to, 0, 0, 0, size, size, gl.RGBA, gl.UNSIGNED_BYTE, pixels);
  });
  for (const name of [gl.TEXTURE_MIN_FILTER, gl.TEXTURE_MAG_FILTER]) gl.texParameteri(gl.TEXTURE_CUBE_MAP, name, gl.LINEAR);
  return made;
}

/** The uniforms of a frame's rays; `origin`: where in its framebuffer the frame begins. */
export function raysOf({ right, up, back, focal, principal, size }, origin, environment, none) {
  return { right, up, back, focal, principal, size, origin, environment: environment ?? none, hasEnvironment: environment !== null };
}
