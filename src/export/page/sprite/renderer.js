// Draws sprites with depth as the CPU does: displacements move first, then each pixel finds its place in the picture.
import { context, Program, target, texture } from '../gl.js';
import { WHOLE_VERTEX } from '../glsl.js';
import { raysOf, readSurroundings } from '../surroundings.js';
import { LEVELS, readSprite } from './field.js';
import { backToFront } from './layers.js';
import { GROW_FRAGMENT, LOOK_FRAGMENT, MOVE_FRAGMENT, MOVE_VERTEX, UNDER_FRAGMENT } from './shaders.js';
import { parallaxOf, transferOf } from './transfer.js';

/** Sides of moved fields are multiples of this: those of neighbouring eyes share their memory. */
const GRAIN = 64;

/** A coding as a shader takes it. */
const coded = ({ zero, scale, slopeScale }) => [zero, scale, slopeScale];

export class Renderer {
  constructor(canvas, header) {
    /** What its framebuffers must have. */
    this.buffers = { antialias: false, depth: false };
    const gl = context(canvas, this.buffers);
    Object.assign(this, { gl, header, environment: null, sprites: [], fields: null, frame: null });
    this.moveProgram = new Program(gl, MOVE_VERTEX, MOVE_FRAGMENT);
    this.growProgram = new Program(gl, WHOLE_VERTEX, GROW_FRAGMENT);
    this.lookProgram = new Program(gl, WHOLE_VERTEX, LOOK_FRAGMENT);
    this.underProgram = new Program(gl, WHOLE_VERTEX, UNDER_FRAGMENT);
    this.nothing = gl.createVertexArray();
    this.noCube = gl.createTexture();
  }

  /** Takes a part of the payload in. */
  add(part, bytes) {
    if (part.kind === 'environment') this.environment = readSurroundings(this.gl, part, bytes);
    else this.addSprite(part, bytes);
  }

  addSprite(part, bytes) {
    const { gl } = this;
    const { points, cells, coding, range, levels } = readSprite(bytes, part, this.header.rules);
    const field = texture(gl, gl.R32UI, part.cells);
    gl.texSubImage2D(gl.TEXTURE_2D, 0, 0, 0, ...part.cells, gl.RED_INTEGER, gl.UNSIGNED_INT, cells);
    const picture = texture(gl, gl.RGBA8, levels[0].size, LEVELS);
    levels.forEach(({ size, pixels }, i) => gl.texSubImage2D(gl.TEXTURE_2D, i, 0, 0, ...size, gl.RGBA, gl.UNSIGNED_BYTE, pixels));
    const cellPx = part.size.map((side, i) => side / part.cells[i]);
    this.sprites.push({ points, view: part.view, size: part.size, cells: part.cells, cellPx, field, picture, coding, range });
  }

  /** Makes fields of at least a size, unless they are there: two that are read and written in turns, and the depth of the first. */
  fieldsFor(extent) {
    const { gl, fields } = this;
    if (fields && extent.every((side, i) => side <= fields.size[i])) return fields;
    const size = extent.map((side, i) => Math.max(Math.ceil(side / GRAIN) * GRAIN, fields?.size[i] ?? 0));
    for (const { color, to } of fields?.both ?? []) {
      gl.deleteTexture(color);
      gl.deleteFramebuffer(to);
    }
    gl.deleteTexture(fields?.depth ?? null);
    const depth = texture(gl, gl.DEPTH_COMPONENT24, size);
    const both = [depth, null].map((depth) => {
      const color = texture(gl, gl.R32UI, size);
      return { color, to: target(gl, color, depth) };
    });
    return (this.fields = { size, depth, both });
  }

  /** Makes the frame's own texture, unless it is there: light, which blends as light. */
  frameFor(size) {
    const { gl, frame } = this;
    if (frame?.size.every((side, i) => side === size[i])) return frame;
    gl.deleteTexture(frame?.color ?? null);
    gl.deleteFramebuffer(frame?.to ?? null);
    const color = texture(gl, gl.SRGB8_ALPHA8, size);
    return (this.frame = { size, color, to: target(gl, color, null) });
  }

  /** Draws what a camera sees to a part of a framebuffer that begins at `origin`. `shade`: 1 for full light. */
  draw(camera, framebuffer = null, origin = [0, 0], shade = 1) {
    const { gl, header } = this;
    const frame = this.frameFor(camera.size);
    gl.bindFramebuffer(gl.FRAMEBUFFER, frame.to);
    gl.clearColor(0, 0, 0, 0);
    gl.clear(gl.COLOR_BUFFER_BIT);
    for (const sprite of backToFront(this.sprites, camera.eye)) {
      const transfer = transferOf(sprite, camera, header.rules.edgeOn);
      if (transfer) this.drawSprite(sprite, transfer, camera);
    }
    gl.bindFramebuffer(gl.FRAMEBUFFER, framebuffer);
    gl.viewport(...origin, ...camera.size);
    gl.disable(gl.BLEND);
    const rays = raysOf(camera, origin, this.environment, this.noCube);
    this.underProgram.use({ ...rays, frame: frame.color, hole: [0, 0, 0], shade });
    gl.drawArrays(gl.TRIANGLES, 0, 3);
  }

  drawSprite(sprite, { fromFrame, epipole, side }, camera) {
    const { gl, header } = this;
    const parallax = parallaxOf(sprite, { epipole, side }, header.rules);
    const moved = this.move(sprite, parallax);
    gl.bindFramebuffer(gl.FRAMEBUFFER, this.frame.to);
    gl.viewport(0, 0, ...camera.size);
    gl.enable(gl.BLEND);
    gl.blendFunc(gl.ONE, gl.ONE_MINUS_SRC_ALPHA);
    const [perColumn, perRow, corner] = fromFrame;
    this.lookProgram.use({
      ...raysOf(camera, [0, 0], null, this.noCube),
      field: moved,
      picture: sprite.picture,
      ...{ perColumn, perRow, corner, epipole },
      cellPx: sprite.cellPx,
      from: parallax.from,
      extent: parallax.extent,
      newCoding: coded(parallax.coding),
      pictureSize: sprite.size,
      levels: LEVELS,
    });
    gl.drawArrays(gl.TRIANGLES, 0, 3);
  }

  /** First pass: the field that a sprite's displacements make where pure parallax takes them, without small gaps. */
  move({ field, cells, coding }, { epipole, from, extent, coding: newCoding }) {
    const { gl, header } = this;
    const { both } = this.fieldsFor(extent);
    const shared = { from, extent, newCoding: coded(newCoding) };
    gl.viewport(0, 0, ...extent);
    gl.disable(gl.BLEND);
    gl.bindVertexArray(this.nothing);
    gl.bindFramebuffer(gl.FRAMEBUFFER, both[0].to);
    gl.enable(gl.DEPTH_TEST);
    gl.depthFunc(gl.LESS);
    gl.depthMask(true);
    gl.clearBufferuiv(gl.COLOR, 0, [0, 0, 0, 0]);
    gl.clear(gl.DEPTH_BUFFER_BIT);
    this.moveProgram.use({ ...header.rules, ...shared, field, cells, coding: coded(coding), epipole });
    gl.drawArrays(gl.POINTS, 0, cells[0] * cells[1]);
    gl.disable(gl.DEPTH_TEST);
    let [read, write] = both;
    for (let step = 0; step < header.rules.fillSteps; step++) {
      gl.bindFramebuffer(gl.FRAMEBUFFER, write.to);
      this.growProgram.use({ ...shared, field: read.color });
      gl.drawArrays(gl.TRIANGLES, 0, 3);
      [read, write] = [write, read];
    }
    return read.color;
  }
}
