// The order in which an eye sees sprites (set.rs).
import { dot, length, subtract } from '../vectors.js';

/** Least and greatest distance of a sprite's points from a plane. */
function sides({ points }, { normal, offset }) {
  let [low, high] = [Infinity, -Infinity];
  for (const point of points) {
    const distance = dot(normal, point) + offset;
    [low, high] = [Math.min(low, distance), Math.max(high, distance)];
  }
  return [low, high];
}

/** What an eye needs to know of a sprite: its points, its plane with the eye on the positive side, how far its middle is. */
function shapeOf({ points, view }, eye) {
  const mean = [0, 1, 2].map((c) => points.reduce((sum, point) => sum + point[c], 0) / Math.max(points.length, 1));
  const offset = view.distance - dot(view.normal, view.eye);
  const side = dot(view.normal, eye) + offset < 0 ? -1 : 1;
  const plane = { normal: view.normal.map((c) => c * side), offset: offset * side };
  return { points, plane, distance: length(subtract(mean, eye)) };
}

/** Whether a shape has to be drawn before another: it lies beyond the other's plane, or the other before its own. */
function isBehind(shape, other) {
  return sides(shape, other.plane)[1] < sides(other, other.plane)[0] || sides(other, shape.plane)[0] > sides(shape, shape.plane)[1];
}

/** Sprites from back to front; where their planes leave a choice, the farther one first. */
export function backToFront(sprites, eye) {
  const left = sprites.map((sprite, number) => ({ sprite, number, shape: shapeOf(sprite, eye) }));
  left.sort((a, b) => b.shape.distance - a.shape.distance || a.number - b.number);
  const order = [];
  while (left.length > 0) {
    const free = left.findIndex((a) => left.every((b) => a === b || !isBehind(b.shape, a.shape)));
    order.push(...left.splice(Math.max(free, 0), 1));
  }
  return order.map(({ sprite }) => sprite);
}
