// What is shown first: a small picture with depth in all directions from the middle of the headbox (shell.rs).
import { CUBE_ORDER } from '../surroundings.js';

/** A cube map whose faces a function fills in, GL's order of them given. */
function cubeMap(gl, format, size, fill) {
  const made = gl.createTexture();
  gl.bindTexture(gl.TEXTURE_CUBE_MAP, made);
  gl.texStorage2D(gl.TEXTURE_CUBE_MAP, 1, format, size, size);
  CUBE_ORDER.forEach((face, ours) => fill(gl.TEXTURE_CUBE_MAP_POSITIVE_X + face, ours));
  for (const name of [gl.TEXTURE_MIN_FILTER, gl.TEXTURE_MAG_FILTER]) gl.texParameteri(gl.TEXTURE_CUBE_MAP, name, gl.LINEAR);
  return made;
}

/** Colours and 1 / eye depths, each a cube map. */
export async function readShell(gl, { depthPx, nearest }, bytes) {
  const pixels = depthPx * depthPx;
  const codes = new Uint8Array(6 * pixels);
  for (let i = 0, code = 0; i < codes.length; i++) codes[i] = code += bytes[i];
  const file = new Blob([bytes.subarray(codes.length)], { type: 'image/jpeg' });
  const picture = await createImageBitmap(file, { colorSpaceConversion: 'none' });
  const colorPx = picture.width;
  const faces = await Promise.all(CUBE_ORDER.map((_, ours) => createImageBitmap(picture, 0, ours * colorPx, colorPx, colorPx)));
  const shellColor = cubeMap(gl, gl.RGBA8, colorPx, (to, ours) =>
    gl.texSubImage2D(to, 0, 0, 0, colorPx, colorPx, gl.RGBA, gl.UNSIGNED_BYTE, faces[ours]),
  );
  gl.pixelStorei(gl.UNPACK_ALIGNMENT, 1);
  const shellDepth = cubeMap(gl, gl.R8, depthPx, (to, ours) => {
    const face = codes.subarray(ours * pixels, (ours + 1) * pixels);
    gl.texSubImage2D(to, 0, 0, 0, depthPx, depthPx, gl.RED, gl.UNSIGNED_BYTE, face);
  });
  gl.pixelStorei(gl.UNPACK_ALIGNMENT, 4);
  return { shellColor, shellDepth, shellNearest: nearest };
}

/** Where a ray of a pixel meets the shell: the nearest of equal steps of 1 / eye depth at which it is behind it, then halved. */
export const SHELL = `
uniform samplerCube shellColor, shellDepth;
uniform float shellNearest;              // 1 / eye depth of 1
uniform bool hasShell;
uniform vec3 eye;
float ofFace(vec3 p) { return max(max(abs(p.x), abs(p.y)), abs(p.z)); }
/** By how much a point of the ray is behind the shell: at 1 / eye depth q its direction from the middle is that of ray + q eye. */
float behindShell(vec3 ray, float q) {
  vec3 at = ray + q * eye;
  return texture(shellDepth, at * vec3(1.0, 1.0, -1.0)).r * shellNearest * ofFace(at) - q;
}
/** Colour, and 1 / eye depth. */
vec4 shellAlong(vec3 ray) {
  const int STEPS = 32;
  float room = 1.0 - ofFace(eye) * shellNearest;
  float most = ofFace(ray) * shellNearest / max(room, 0.1), front = most, back = 0.0;
  for (int i = 1; i <= STEPS; i++) {
    back = most * float(STEPS - i) / float(STEPS);
    if (behindShell(ray, back) >= 0.0) break;
    front = back;
  }
  for (int i = 0; i < 5; i++) {
    float middle = (front + back) / 2.0;
    if (behindShell(ray, middle) >= 0.0) back = middle;
    else front = middle;
  }
  return vec4(texture(shellColor, (ray + back * eye) * vec3(1.0, 1.0, -1.0)).rgb, back);
}
`;
