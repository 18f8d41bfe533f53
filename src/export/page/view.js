// Where the eye is and where it looks, and the words for that in a link: file axes and units, as on the command line.
import { Place } from './place.js';
import { add, alongAxes, clamp, cross, fromAxes, levelAxes, normalize, scale, subtract } from './vectors.js';

const MAX_PITCH = (89 * Math.PI) / 180;

/** World metres of a position in the scene's file, and back. */
const worldFromFile = ({ unit, zUp }, p) => scale(zUp ? [p[0], p[2], -p[1]] : p, unit);
const fileFromWorld = ({ unit, zUp }, p) => scale(zUp ? [p[0], -p[2], p[1]] : p, 1 / unit);

function numbers(text) {
  const found = (text ?? '').split(',').map(Number);
  return found.length === 3 && found.every(Number.isFinite) ? found : null;
}

export class View {
  constructor(header) {
    this.header = header;
    this.place = new Place(header);
    /** To the right, up and back of a level eye: photographs may have any direction up. */
    this.axes = levelAxes(normalize(header.up ?? [0, 1, 0]));
    this.reset();
  }

  reset() {
    this.eye = this.place.start;
    this.forward = normalize(this.header.ahead);
    this.up = this.axes[1];
    this.fov = this.header.fov ?? 60;
  }

  /** Takes over what a link says, as far as it says it. */
  restore(hash) {
    const words = new URLSearchParams(hash.replace(/^#/, ''));
    const { centre, frame } = this.header;
    const eye = numbers(words.get('eye'));
    if (eye) this.eye = this.place.nearest(subtract(worldFromFile(frame, eye), centre));
    const target = numbers(words.get('look-at'));
    if (target) {
      const forward = subtract(subtract(worldFromFile(frame, target), centre), this.eye);
      if (Math.hypot(...forward) > 0) this.forward = normalize(forward);
    }
    const fov = Number(words.get('fov') || NaN);
    if (fov >= 1 && fov <= 170) this.fov = fov;
    return { ui: words.get('ui') !== '0' };
  }

  /** What a link must say to show this view. */
  link() {
    const { centre, frame } = this.header;
    const text = (p) => fileFromWorld(frame, p).map((c) => Number(c.toPrecision(9))).join(',');
    const eye = add(centre, this.eye);
    return `#eye=${text(eye)}&look-at=${text(add(eye, this.forward))}&fov=${Number(this.fov.toFixed(2))}`;
  }

  /** Turns to the right and upward, radians. */
  turn(yaw, pitch) {
    const [x, y, z] = alongAxes(this.axes, this.forward);
    const direction = Math.atan2(x, -z) + yaw;
    const height = clamp(Math.asin(clamp(y, -1, 1)) + pitch, -MAX_PITCH, MAX_PITCH);
    const level = [Math.sin(direction) * Math.cos(height), Math.sin(height), -Math.cos(direction) * Math.cos(height)];
    this.forward = fromAxes(this.axes, level);
    this.up = this.axes[1];
  }

  /** Moves by metres to the right, up and ahead, as far as the place allows. */
  move(right, up, ahead) {
    const toRight = normalize(cross(this.forward, this.up));
    const toTop = this.axes[1];
    // Who walks looks up and down without rising.
    const toFront = this.place.walks ? cross(toTop, toRight) : this.forward;
    this.eye = this.place.step(this.eye, add(add(scale(toRight, right), scale(toTop, up)), scale(toFront, ahead)));
  }

  zoom(factor) {
    this.fov = clamp(this.fov * factor, 15, 110);
  }
}
