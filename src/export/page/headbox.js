// Where the eye may be: in the headbox, with a soft border.
import { clamp } from './vectors.js';

/** Half of a headbox, metres, below which the world is shown larger in a headset: a head has to fit in. */
const ROOM_M = 0.15;
/** Headbox edges a second at which keys move. */
const EDGES_A_SECOND = 0.4;
/** Share of half an edge over which steps outward end softly. */
const SOFT = 0.25;

export class Place {
  constructor({ halfSize }) {
    Object.assign(this, { halfSize, start: [0, 0, 0], walks: false });
    this.speed = EDGES_A_SECOND * 2 * halfSize;
    /** Metres for a finger's way over the whole page. */
    this.reach = 2 * halfSize;
  }

  /** The nearest place that an eye may be at. */
  nearest(eye) {
    return eye.map((c) => clamp(c, -this.halfSize, this.halfSize));
  }

  /** An eye that has moved by a step: the nearer the border, the less of a step outward is left. */
  step(eye, step) {
    return eye.map((from, i) => {
      const room = clamp((this.halfSize - from * Math.sign(step[i])) / (this.halfSize * SOFT), 0, 1);
      return clamp(from + step[i] * room, -this.halfSize, this.halfSize);
    });
  }

  /** Where a head is that has moved by an offset since a session began, and how far it is outside, metres. */
  ofHead(_, offset) {
    const wanted = offset.map((c) => c * Math.min(this.halfSize / ROOM_M, 1));
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
