// Mouse, fingers, keys and the sensors of phones.
import { alongAxes, cross, fromAxes, normalize } from './vectors.js';

const MOVES = { KeyW: [0, 0, 1], KeyS: [0, 0, -1], KeyD: [1, 0, 0], KeyA: [-1, 0, 0], KeyE: [0, 1, 0], KeyQ: [0, -1, 0] };
const TURNS = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] };

export class Controls {
  constructor(canvas, view, changed) {
    Object.assign(this, { canvas, view, changed, fingers: new Map(), keys: new Set(), gyroscope: false });
    canvas.addEventListener('pointerdown', (event) => this.down(event));
    canvas.addEventListener('pointermove', (event) => this.drag(event));
    for (const end of ['pointerup', 'pointercancel']) canvas.addEventListener(end, ({ pointerId }) => this.fingers.delete(pointerId));
    canvas.addEventListener('wheel', (event) => this.wheel(event), { passive: false });
    // Keys work wherever the focus is: on nothing, on the canvas, or on a button that was clicked.
    addEventListener('keydown', (event) => this.key(event));
    addEventListener('keyup', ({ code }) => this.keys.delete(code));
    addEventListener('blur', () => this.keys.clear());
  }

  /** Radians for one pixel of the page. */
  perPixel() {
    return (this.view.fov * Math.PI) / 180 / this.canvas.clientHeight;
  }

  down(event) {
    this.canvas.setPointerCapture(event.pointerId);
    this.fingers.set(event.pointerId, [event.clientX, event.clientY]);
  }

  drag(event) {
    const before = this.fingers.get(event.pointerId);
    if (!before) return;
    const now = [event.clientX, event.clientY];
    const [dx, dy] = [now[0] - before[0], now[1] - before[1]];
    if (this.fingers.size === 1 && !event.shiftKey) this.view.turn(-dx * this.perPixel(), dy * this.perPixel());
    else {
      const { reach, walks } = this.view.place;
      const metres = reach / this.canvas.clientHeight;
      this.view.move(-dx * metres, walks ? 0 : dy * metres, walks ? dy * metres : 0);
      const other = [...this.fingers].find(([id]) => id !== event.pointerId)?.[1];
      if (other) {
        const apart = (from) => Math.max(Math.hypot(from[0] - other[0], from[1] - other[1]), 1);
        this.view.zoom(apart(before) / apart(now));
      }
    }
    this.fingers.set(event.pointerId, now);
    this.changed();
  }

  wheel(event) {
    event.preventDefault();
    this.view.zoom(Math.exp(event.deltaY * (event.deltaMode === 1 ? 0.03 : 0.001)));
    this.changed();
  }

  key(event) {
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    const zooms = { Equal: 1 / 1.1, NumpadAdd: 1 / 1.1, Minus: 1.1, NumpadSubtract: 1.1 };
    const storeys = this.view.place.walks ? MOVES[event.code]?.[1] : 0;
    if (storeys) this.view.move(0, event.repeat ? 0 : storeys, 0);
    else if (MOVES[event.code] || TURNS[event.code]) this.keys.add(event.code);
    else if (zooms[event.code]) this.view.zoom(zooms[event.code]);
    else if (event.code === 'Home' || event.code === 'KeyR') this.view.reset();
    else return;
    event.preventDefault();
    this.changed();
  }

  /** Moves by the keys that are held down; whether any are. */
  step(seconds) {
    const distance = this.view.place.speed * seconds;
    for (const code of this.keys) {
      if (MOVES[code]) this.view.move(...MOVES[code].map((c) => c * distance));
      else this.view.turn(...TURNS[code].map((c) => c * seconds));
    }
    return this.keys.size > 0;
  }

  /** Looks where the device points, from now on or no longer. */
  async toggleGyroscope() {
    this.gyroscope = !this.gyroscope;
    if (!this.gyroscope) {
      removeEventListener('deviceorientation', this.orient);
      return;
    }
    const permission = await globalThis.DeviceOrientationEvent?.requestPermission?.();
    if (permission && permission !== 'granted') {
      this.gyroscope = false;
      throw new Error('The device does not tell how it is held.');
    }
    let ahead = null;
    this.orient = ({ alpha, beta, gamma }) => {
      if (alpha === null) return;
      const [forward, up] = heldAs(alpha, beta, gamma, screen.orientation?.angle ?? 0);
      // The compass does not matter: what was ahead stays ahead.
      const { axes } = this.view;
      const [x, , z] = alongAxes(axes, this.view.forward);
      ahead ??= Math.atan2(x, -z) - Math.atan2(forward[0], -forward[2]);
      [this.view.forward, this.view.up] = [forward, up].map((v) => fromAxes(axes, turned(v, ahead)));
      this.changed();
    };
    addEventListener('deviceorientation', this.orient);
  }
}

/** A vector turned to the right about Y. */
const turned = ([x, y, z], angle) => [x * Math.cos(angle) - z * Math.sin(angle), y, x * Math.sin(angle) + z * Math.cos(angle)];

/** Forward and up, Y up, of a screen held by the angles of the Device Orientation specification (Z-X'-Y'', Z up), degrees. */
function heldAs(alpha, beta, gamma, screenAngle) {
  const [a, b, c, s] = [alpha, beta, gamma, screenAngle].map((angle) => (angle * Math.PI) / 180);
  const column = (x, y, z) => {
    const [x1, z1] = [x * Math.cos(c) + z * Math.sin(c), z * Math.cos(c) - x * Math.sin(c)];
    const [y1, z2] = [y * Math.cos(b) - z1 * Math.sin(b), y * Math.sin(b) + z1 * Math.cos(b)];
    const [x2, y2] = [x1 * Math.cos(a) - y1 * Math.sin(a), x1 * Math.sin(a) + y1 * Math.cos(a)];
    return [x2, z2, -y2]; // east, north, up to X, Y, Z
  };
  const forward = normalize(column(0, 0, -1));
  const right = normalize(column(Math.cos(s), Math.sin(s), 0));
  return [forward, cross(right, forward)];
}
