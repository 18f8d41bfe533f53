// Draws a lumigraph: images from a grid of cameras, each pixel with a layer, blended ray by ray.
import { context, Program, texture } from '../gl.js';
import { WHOLE_VERTEX } from '../glsl.js';
import { pictureOf } from '../pictures.js';
import { raysOf, readSurroundings } from '../surroundings.js';
import { planOf, stepsOf } from './plan.js';
import { RAY_FRAGMENT } from './shaders.js';

export class Renderer {
  constructor(canvas, header) {
    /** What its framebuffers must have. */
    this.buffers = { antialias: false, depth: false };
    const gl = context(canvas, this.buffers);
    const { grid } = header;
    const cameras = grid.columns.length * grid.rows.length;
    const most = gl.getParameter(gl.MAX_ARRAY_TEXTURE_LAYERS);
    if (cameras > most) throw new Error(`This browser's graphics hold ${most} images, and this page has ${cameras}.`);
    Object.assign(this, { gl, header, environment: null, layers: [] });
    this.program = new Program(gl, WHOLE_VERTEX, RAY_FRAGMENT);
    this.nothing = gl.createVertexArray();
    this.noCube = gl.createTexture();
    // Levels down to two texels.
    this.levels = Math.floor(Math.log2(Math.min(...grid.size)));
    this.colors = this.pictures(gl.SRGB8_ALPHA8, cameras);
    this.indices = this.pictures(gl.R16UI, cameras);
    this.places = this.numbers(Math.max(grid.columns.length, grid.rows.length), 2);
    /** The cameras that are shown, a grid of their own; none until the first of them have come. */
    this.grid = null;
  }

  /** Shows the cameras of some columns and rows from now on; their images are there. */
  show({ columns, rows }) {
    const { gl, header: { grid } } = this;
    const { width } = this.places;
    const places = new Float32Array(width * 8);
    [[columns, grid.columns], [rows, grid.rows]].forEach(([shown, all], axis) =>
      shown.forEach((number, i) => places.set([all[number], number], (axis * width + i) * 4)),
    );
    this.fill(this.places, 2, places);
    this.grid = { ...grid, columns: columns.map((i) => grid.columns[i]), rows: rows.map((i) => grid.rows[i]) };
    this.steps = stepsOf(this.grid);
    this.whole = columns.length === grid.columns.length && rows.length === grid.rows.length;
    if (!this.whole) return;
    gl.bindTexture(gl.TEXTURE_2D_ARRAY, this.colors);
    gl.generateMipmap(gl.TEXTURE_2D_ARRAY);
  }

  /** A texture of one image for each camera. */
  pictures(format, cameras) {
    const { gl } = this;
    const made = gl.createTexture();
    gl.bindTexture(gl.TEXTURE_2D_ARRAY, made);
    gl.texStorage3D(gl.TEXTURE_2D_ARRAY, this.levels, format, ...this.header.grid.size, cameras);
    gl.texParameteri(gl.TEXTURE_2D_ARRAY, gl.TEXTURE_MIN_FILTER, gl.NEAREST_MIPMAP_NEAREST);
    gl.texParameteri(gl.TEXTURE_2D_ARRAY, gl.TEXTURE_MAG_FILTER, gl.NEAREST);
    return made;
  }

  /** A texture of four numbers a texel. */
  numbers(width, height) {
    return { width, texture: texture(this.gl, this.gl.RGBA32F, [width, height]) };
  }

  fill({ width, texture }, rows, values) {
    const { gl } = this;
    gl.bindTexture(gl.TEXTURE_2D, texture);
    gl.texSubImage2D(gl.TEXTURE_2D, 0, 0, 0, width, rows, gl.RGBA, gl.FLOAT, values);
  }

  /** Takes a part of the payload in. */
  async add(part, bytes) {
    const { gl } = this;
    if (part.kind === 'environment') this.environment = readSurroundings(gl, part, bytes);
    else if (part.kind === 'layers') {
      const ends = new Float64Array(bytes.slice().buffer);
      this.layers = Array.from({ length: ends.length / 2 }, (_, i) => [ends[2 * i], ends[2 * i + 1]]);
      this.plan = this.numbers(3, this.layers.length + 1);
    } else if (part.kind === 'indices') this.addIndices(part.camera, bytes);
    else await this.addColors(part, bytes);
  }

  async addColors({ camera, shows }, bytes) {
    const { gl } = this;
    const picture = await pictureOf(bytes, Infinity);
    gl.bindTexture(gl.TEXTURE_2D_ARRAY, this.colors);
    gl.texSubImage3D(gl.TEXTURE_2D_ARRAY, 0, 0, 0, camera, picture.width, picture.height, 1, gl.RGBA, gl.UNSIGNED_BYTE, picture);
    picture.close();
    if (shows) this.show(shows);
  }

  /** Layers of an image's pixels: each less the one before, low bytes, then high ones; smaller ones by vote (pyramid.rs). */
  addIndices(camera, bytes) {
    const { gl } = this;
    let [width, height] = this.header.grid.size;
    const count = width * height;
    let level = new Uint16Array(count);
    for (let i = 0, index = 0; i < count; i++) level[i] = index = (index + bytes[i] + (bytes[count + i] << 8)) & 0xffff;
    gl.bindTexture(gl.TEXTURE_2D_ARRAY, this.indices);
    gl.pixelStorei(gl.UNPACK_ALIGNMENT, 2);
    for (let i = 0; i < this.levels; i++) {
      gl.texSubImage3D(gl.TEXTURE_2D_ARRAY, i, 0, 0, camera, width, height, 1, gl.RED_INTEGER, gl.UNSIGNED_SHORT, level);
      [level, width, height] = halved(level, width, height);
    }
    gl.pixelStorei(gl.UNPACK_ALIGNMENT, 4);
  }

  /** Draws what a camera sees to a part of a framebuffer that begins at `origin`. `shade`: 1 for full light. */
  draw(camera, framebuffer = null, origin = [0, 0], shade = 1) {
    const { gl, grid } = this;
    if (!grid) return;
    // Smaller images are made once, when all are there.
    const { view, count, numbers } = planOf(grid, this.layers, camera, this.whole ? this.levels : 1);
    this.fill(this.plan, count, numbers);
    gl.bindFramebuffer(gl.FRAMEBUFFER, framebuffer);
    gl.viewport(...origin, ...camera.size);
    gl.disable(gl.BLEND);
    gl.bindVertexArray(this.nothing);
    this.program.use({
      ...raysOf(camera, origin, this.environment, this.noCube),
      colors: this.colors,
      indices: this.indices,
      layers: this.plan.texture,
      places: this.places.texture,
      counts: [count, grid.columns.length, grid.rows.length],
      inRow: this.header.grid.columns.length,
      picture: grid.size,
      eye: view.eye,
      start: view.start,
      right1: view.step[0],
      down1: view.step[1],
      steps: this.steps.length > 0 ? this.steps.flat() : [0, 0],
      stepCount: this.steps.length,
      hole: [0, 0, 0],
      shade,
    });
    gl.drawArrays(gl.TRIANGLES, 0, 3);
  }
}

/** Layers at half the size: of four the one that most have; of those that tie, the nearest. */
function halved(from, width, height) {
  const [w, h] = [Math.max(width >> 1, 1), Math.max(height >> 1, 1)];
  const to = new Uint16Array(w * h);
  const four = new Uint16Array(4);
  for (let y = 0; y < h; y++) {
    for (let x = 0; x < w; x++) {
      const at = 2 * y * width + 2 * x;
      const [right, below] = [2 * x + 1 < width ? 1 : 0, 2 * y + 1 < height ? width : 0];
      four[0] = from[at];
      four[1] = from[at + right];
      four[2] = from[at + below];
      four[3] = from[at + below + right];
      let [best, votes] = [0, 0];
      for (let i = 0; i < 4; i++) {
        let same = 0;
        for (let j = 0; j < 4; j++) if (four[j] === four[i]) same++;
        if (same > votes || (same === votes && four[i] > best)) [best, votes] = [four[i], same];
      }
      to[y * w + x] = best;
    }
  }
  return [to, w, h];
}
