// Cameras as the CPU's: world right-handed, Y up; looking along -back; pixels with row 0 on top.
import { add, cross, dot, length, normalize, scale, subtract } from './vectors.js';

/** A camera at `eye` (from the headbox's centre) that looks along `forward`. */
export function lookAlong(eye, forward, up, fovDegrees, size) {
  const ahead = normalize(forward);
  let held = cross(ahead, up);
  if (length(held) < 1e-6) held = cross(ahead, Math.abs(ahead[1]) < 0.9 ? [0, 1, 0] : [0, 0, 1]);
  const right = normalize(held);
  const focal = size[1] / 2 / Math.tan((fovDegrees * Math.PI) / 360);
  const principal = [size[0] / 2, size[1] / 2];
  return { eye, right, up: cross(right, ahead), back: scale(ahead, -1), focal: [focal, focal], principal, size };
}

/** The camera of one eye of a headset: a pose relative to the headbox's centre, and a projection. */
export function ofHeadset(eye, matrix, projection, size) {
  const column = (i) => [matrix[i * 4], matrix[i * 4 + 1], matrix[i * 4 + 2]];
  const focal = [(projection[0] * size[0]) / 2, (projection[5] * size[1]) / 2];
  const principal = [(size[0] * (1 - projection[8])) / 2, (size[1] * (1 + projection[9])) / 2];
  return { eye, right: column(0), up: column(1), back: column(2), focal, principal, size };
}

/** The camera of a larger picture, by a margin on each side. */
export function withMargin(camera, margin) {
  const principal = camera.principal.map((c) => c + margin);
  return { ...camera, principal, size: camera.size.map((s) => s + 2 * margin) };
}

/** A vector in the camera's axes: pixels per eye depth right and down, and eye depth. */
export function toFrame(camera, v) {
  return [dot(camera.right, v) * camera.focal[0], -dot(camera.up, v) * camera.focal[1], -dot(camera.back, v)];
}

/**
 * From positions (x, y) of a face and inverse depth q to the frame: one + x * x_ + y * y_ + q * q_ is (X w, Y w, w), X and Y in
 * pixels from the principal point, w = eye depth in the frame over eye depth in the face (transfer.rs).
 */
export function transfer(camera, face, facePx) {
  const step = 2 / facePx;
  const origin = add(subtract(face.normal, face.right), face.up);
  return {
    one: toFrame(camera, origin),
    x: toFrame(camera, scale(face.right, step)),
    y: toFrame(camera, scale(face.up, -step)),
    q: scale(toFrame(camera, camera.eye), -1),
  };
}

/** Whether a box of a face, columns and rows and inverse depths, may be in the picture. */
export function mayBeSeen(camera, { one, x, y, q }, [x0, x1], [y0, y1], [q0, q1], wNear) {
  const [cx, cy] = camera.principal;
  const [width, height] = camera.size;
  let outside = 31;
  for (let corner = 0; corner < 8 && outside; corner++) {
    const [px, py, pq] = [corner & 1 ? x1 : x0, corner & 2 ? y1 : y0, corner & 4 ? q1 : q0];
    const at = (i) => one[i] + px * x[i] + py * y[i] + pq * q[i];
    const [hx, hy, w] = [at(0), at(1), at(2)];
    const left = hx < -cx * w ? 1 : 0;
    const right = hx > (width - cx) * w ? 2 : 0;
    const top = hy < -cy * w ? 4 : 0;
    const bottom = hy > (height - cy) * w ? 8 : 0;
    outside &= left | right | top | bottom | (w < wNear ? 16 : 0);
  }
  return outside === 0;
}
