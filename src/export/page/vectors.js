// Vectors of three numbers, in double precision: eyes may be far from the origin.

export const add = (a, b) => [a[0] + b[0], a[1] + b[1], a[2] + b[2]];
export const subtract = (a, b) => [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
export const scale = (a, s) => [a[0] * s, a[1] * s, a[2] * s];
export const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
export const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
export const length = (a) => Math.hypot(a[0], a[1], a[2]);
export const normalize = (a) => scale(a, 1 / length(a));

/** Axes to the right, up and back of a level eye in a world with this direction up: X, Y and Z for Y. */
export function levelAxes(up) {
  const right = normalize(cross(up, Math.abs(up[2]) < 0.9 ? [0, 0, 1] : [1, 0, 0]));
  return [right, up, cross(right, up)];
}

/** A vector's parts along axes, and the vector with such parts. */
export const alongAxes = (axes, v) => axes.map((axis) => dot(axis, v));
export const fromAxes = ([a, b, c], [x, y, z]) => add(add(scale(a, x), scale(b, y)), scale(c, z));

export const clamp = (x, low, high) => Math.min(Math.max(x, low), high);
