// Where a walker may stand: on the floors' free places, which floors.rs found from cells, portals and walls.
import { cellOf } from './cells.js';

/** Metres a second of somebody who walks. */
const WALK_M = 1.4;

export class Place {
  constructor(header) {
    const { start, floors } = header;
    Object.assign(this, { header, start, walks: true, speed: WALK_M, reach: 4, floors });
    this.free = floors.map(() => null);
  }

  /** The name of the room of an eye. */
  words(eye) {
    return this.header.cells[cellOf(this.header, eye)]?.name ?? '';
  }

  /** Takes over the free places of a floor. */
  take(part, bytes) {
    if (part.kind === 'floor') this.free[part.floor] = bytes;
  }

  /** A link may show a house from anywhere. */
  nearest(eye) {
    return eye;
  }

  /** The number of the storey whose eyes are nearest in height. */
  storeyOf(eye) {
    const apart = this.floors.map(({ height }) => Math.abs(height - eye[1]));
    return apart.indexOf(Math.min(...apart));
  }

  isFree(storey, [x, , z]) {
    const { low, step, columns, rows } = this.floors[storey];
    const [column, row] = [Math.round((x - low[0]) / step), Math.round((z - low[1]) / step)];
    return column >= 0 && row >= 0 && column < columns && row < rows && this.free[storey]?.[row * columns + column] === 1;
  }

  /** An eye that walks; it slides along walls. From where nobody can stand every way is open. Up and down lead to other storeys. */
  step(eye, step) {
    if (this.floors.length === 0) return eye.map((c, i) => c + step[i]);
    if (step[1] !== 0) return this.climbed(eye, Math.sign(step[1]));
    const storey = this.storeyOf(eye);
    const { height, step: grid } = this.floors[storey];
    const pieces = Math.max(Math.ceil(Math.hypot(step[0], step[2]) / grid), 1);
    const [dx, dz] = [step[0] / pieces, step[2] / pieces];
    let at = [eye[0], height, eye[2]];
    for (let i = 0; i < pieces; i++) {
      const ways = [[dx, dz], [dx, 0], [0, dz]].map(([x, z]) => [at[0] + x, height, at[2] + z]);
      const open = this.isFree(storey, at) ? ways.find((way) => this.isFree(storey, way)) : ways[0];
      at = open ?? at;
    }
    return at;
  }

  /** The free place nearest to an eye on the next storey; the eye itself where there is none. */
  climbed(eye, by) {
    const storey = this.storeyOf(eye) + by;
    const { low, step, columns, height } = this.floors[storey] ?? {};
    let best = eye;
    let nearest = Infinity;
    this.free[storey]?.forEach((free, i) => {
      const at = [low[0] + (i % columns) * step, height, low[1] + Math.floor(i / columns) * step];
      const apart = Math.hypot(at[0] - eye[0], at[2] - eye[2]);
      if (free === 1 && apart < nearest) [best, nearest] = [at, apart];
    });
    return best;
  }

  /** Where a head is that has moved by an offset since somebody stood at a place; light fades inside walls. */
  ofHead(from, offset) {
    const eye = from.map((c, i) => c + offset[i]);
    const inside = this.floors.length === 0 || !this.isFree(this.storeyOf(from), from) || this.isFree(this.storeyOf(from), eye);
    return { eye, outside: inside ? 0 : Infinity };
  }
}
