// Where the eye may be: about the cameras and behind them, not beyond the nearest thing.
import { add, clamp, dot, scale } from './vectors.js';

export class Place {
  constructor({ grid, nearest }) {
    const across = ([first, ...rest]) => (rest.length > 0 ? rest[rest.length - 1] - first : 0);
    const [width, height] = [across(grid.columns), across(grid.rows)];
    const extent = Math.max(width, height, nearest / 10);
    /** Axes of the plane; how far the eye may go along each, to either side. */
    this.axes = [grid.right, grid.up, grid.back];
    this.ends = [[-width - extent / 4, width + extent / 4], [-height - extent / 4, height + extent / 4], [-nearest / 2, 4 * (extent + nearest)]];
    Object.assign(this, { start: [0, 0, 0], walks: false, speed: extent / 2, reach: extent });
  }

  /** The nearest place that an eye may be at. */
  nearest(eye) {
    return this.axes.map((axis, i) => scale(axis, clamp(dot(axis, eye), ...this.ends[i]))).reduce(add);
  }

  /** An eye that has moved by a step. */
  step(eye, step) {
    return this.nearest(add(eye, step));
  }

  /** Where a head is that has moved by an offset since a session began, and how far it is outside, metres. */
  ofHead(from, offset) {
    const wanted = add(from, offset);
    const eye = this.nearest(wanted);
    return { eye, outside: Math.hypot(...wanted.map((c, i) => c - eye[i])) };
  }

  /** What a place is called. */
  words() {
    return '';
  }

  /** Of a part of the payload; none is for this. */
  take() {}
}
