// Draws a capture as the CPU does: samples are tents, those of one surface are averaged, surfaces are laid over one another.
import { mayBeSeen, transfer, withMargin } from '../camera.js';
import { context, Program, target, texture } from '../gl.js';
import { WHOLE_VERTEX } from '../glsl.js';
import { raysOf, readSurroundings } from '../surroundings.js';
import { ATLAS_PX, readPlanes, TILE_BYTES } from './planes.js';
import { readSamples, SAMPLE_BYTES } from './samples.js';
import { readShell } from './shell.js';
import { FILL_FRAGMENT, finishFragment, laidFragment, SAMPLE_FRAGMENT, SAMPLE_VERTEX, TILE_FRAGMENT, TILE_VERTEX } from './shaders.js';

/** Pixels around a frame in which samples are drawn whose tents may reach into it. */
const MARGIN_PX = 16;

/** Surfaces in a pixel that are told apart. */
const LAYERS = Array.from({ length: 4 }, (_, i) => i);

/** The same of rims: pixels that plane textures cover partly. More of them make no visible difference. */
const RIM_LAYERS = [0, 1];

export class Renderer {
  constructor(canvas, header) {
    /** What its framebuffers must have. */
    this.buffers = { antialias: false, depth: false };
    const gl = context(canvas, this.buffers);
    if (!gl.getExtension('EXT_color_buffer_float') && !gl.getExtension('EXT_color_buffer_half_float')) {
      throw new Error('This browser cannot add up light in WebGL 2 (no EXT_color_buffer_float), which the view needs.');
    }
    Object.assign(this, { gl, header, segments: [], targets: null, planes: null, environment: null, shell: null, missing: header.parts.length });
    this.normals = null;
    this.makePrograms();
    this.samples = gl.createBuffer();
    gl.bindBuffer(gl.ARRAY_BUFFER, this.samples);
    gl.bufferData(gl.ARRAY_BUFFER, Math.max(header.samples, 1) * SAMPLE_BYTES, gl.STATIC_DRAW);
    this.sampleArray = gl.createVertexArray();
    gl.bindVertexArray(this.sampleArray);
    gl.vertexAttribIPointer(0, 1, gl.UNSIGNED_INT, SAMPLE_BYTES, 0);
    gl.vertexAttribPointer(1, 4, gl.UNSIGNED_BYTE, true, SAMPLE_BYTES, 4);
    gl.vertexAttribPointer(2, 2, gl.UNSIGNED_SHORT, false, SAMPLE_BYTES, 8);
    for (const i of [0, 1, 2]) gl.enableVertexAttribArray(i);
    this.nothing = gl.createVertexArray();
    this.drawn = 0;
  }

  makePrograms() {
    const { gl } = this;
    this.sampleProgram = new Program(gl, SAMPLE_VERTEX, SAMPLE_FRAGMENT);
    this.tileProgram = new Program(gl, TILE_VERTEX, TILE_FRAGMENT);
    this.laidProgram = new Program(gl, WHOLE_VERTEX, laidFragment(RIM_LAYERS));
    this.finishProgram = new Program(gl, WHOLE_VERTEX, finishFragment(LAYERS));
    this.fillProgram = new Program(gl, WHOLE_VERTEX, FILL_FRAGMENT);
    // For what has no texture (yet).
    this.noTexture = texture(gl, gl.RGBA8, [1, 1]);
    this.noCube = gl.createTexture();
  }

  /** Takes a part of the payload in. */
  async add(part, bytes) {
    const kinds = { shell: 'addShell', normals: 'addNormals', environment: 'addEnvironment', planes: 'addPlanes', samples: 'addSamples' };
    await this[kinds[part.kind]](part, bytes);
    this.missing--;
  }

  async addShell(part, bytes) {
    this.shell = await readShell(this.gl, part, bytes);
  }

  addNormals(part, bytes) {
    const { gl } = this;
    const values = new Int16Array(bytes.buffer, bytes.byteOffset, bytes.length / 2);
    const texels = new Float32Array((values.length / 3) * 4);
    values.forEach((v, i) => (texels[Math.floor(i / 3) * 4 + (i % 3)] = v / 32767));
    this.normals = texture(gl, gl.RGBA32F, [values.length / 3, 1]);
    gl.texSubImage2D(gl.TEXTURE_2D, 0, 0, 0, values.length / 3, 1, gl.RGBA, gl.FLOAT, texels);
  }

  addEnvironment(part, bytes) {
    this.environment = readSurroundings(this.gl, part, bytes);
  }

  addPlanes(part, bytes) {
    const { gl } = this;
    const { vertices, pictures, layers, count, partial } = readPlanes(bytes, part);
    const atlas = gl.createTexture();
    gl.bindTexture(gl.TEXTURE_2D_ARRAY, atlas);
    gl.texStorage3D(gl.TEXTURE_2D_ARRAY, 1, gl.RGBA8, ATLAS_PX, ATLAS_PX, layers);
    for (const { size: [width, height], picture, place: [x, y, layer] } of pictures) {
      gl.texSubImage3D(gl.TEXTURE_2D_ARRAY, 0, x, y, layer, width, height, 1, gl.RGBA, gl.UNSIGNED_BYTE, picture);
    }
    for (const name of [gl.TEXTURE_MIN_FILTER, gl.TEXTURE_MAG_FILTER]) gl.texParameteri(gl.TEXTURE_2D_ARRAY, name, gl.LINEAR);
    const array = gl.createVertexArray();
    gl.bindVertexArray(array);
    gl.bindBuffer(gl.ARRAY_BUFFER, gl.createBuffer());
    gl.bufferData(gl.ARRAY_BUFFER, vertices, gl.STATIC_DRAW);
    gl.vertexAttribPointer(0, 3, gl.FLOAT, false, TILE_BYTES, 0);
    gl.vertexAttribPointer(1, 4, gl.SHORT, false, TILE_BYTES, 12);
    gl.vertexAttribIPointer(2, 1, gl.UNSIGNED_INT, TILE_BYTES, 20);
    gl.vertexAttribIPointer(3, 4, gl.UNSIGNED_INT, TILE_BYTES, 24);
    for (const i of [0, 1, 2, 3]) {
      gl.enableVertexAttribArray(i);
      gl.vertexAttribDivisor(i, 1);
    }
    this.planes = { atlas, array, count, partial };
  }

  addSamples(part, bytes) {
    const { gl, header } = this;
    const { vertices, blocks } = readSamples(bytes, part, header.blockPx);
    gl.bindBuffer(gl.ARRAY_BUFFER, this.samples);
    gl.bufferSubData(gl.ARRAY_BUFFER, this.drawn * SAMPLE_BYTES, new Uint8Array(vertices));
    const { face, min, step } = header.segments[part.segment];
    let first = this.drawn;
    for (const block of blocks) {
      block.first = first;
      block.inverseDepths = [min + block.farthest * step, min + block.nearest * step];
      first += block.count;
    }
    this.drawn = first;
    this.segments.push({ face, range: [min, step], blocks });
  }

  /** Makes the textures for frames of a size, unless they are there. */
  resize([width, height]) {
    const { gl } = this;
    if (this.targets?.width === width && this.targets.height === height) return;
    if (this.targets) this.freeTargets();
    const size = [width, height];
    const pair = (format) => ({ color: texture(gl, format, size), depth: texture(gl, gl.DEPTH_COMPONENT24, size) });
    /** `tested`: depths that everything must be in front of. */
    const layer = (tested) => {
      const { color, depth } = pair(gl.RGBA16F);
      return { color, depth, toDepth: target(gl, null, depth), toColor: target(gl, color, tested) };
    };
    const planes = pair(gl.RGBA8);
    const frame = texture(gl, gl.RGBA8, size);
    this.targets = {
      width,
      height,
      layers: LAYERS.map(() => layer(null)),
      planes: { ...planes, to: target(gl, planes.color, planes.depth) },
      rims: RIM_LAYERS.map(() => layer(planes.depth)),
      frame: { color: frame, depth: null, to: target(gl, frame, null) },
    };
  }

  freeTargets() {
    const { gl } = this;
    const { layers, planes, rims, frame } = this.targets;
    for (const { color, depth, toDepth, toColor, to } of [...layers, planes, ...rims, frame]) {
      gl.deleteTexture(color);
      gl.deleteTexture(depth);
      for (const made of [toDepth, toColor, to]) if (made) gl.deleteFramebuffer(made);
    }
  }

  /** Draws what a camera sees to a part of a framebuffer that begins at `origin`. `shade`: 1 for full light. */
  draw(camera, framebuffer = null, origin = [0, 0], shade = 1) {
    const { gl, header } = this;
    const large = withMargin(camera, MARGIN_PX);
    this.resize(large.size);
    const nearM = header.halfSize * 0.005;
    const transfers = header.faces.map((face) => transfer(large, face, header.facePx));
    const shared = {
      ...header.rules,
      frame: large.size,
      principal: large.principal,
      normals: this.normals ?? this.noTexture,
      nearM,
    };
    gl.viewport(0, 0, ...large.size);
    gl.disable(gl.CULL_FACE);
    const hasPlanes = this.planes !== null;
    if (hasPlanes) this.drawPlanes(shared, transfers);
    const draws = this.normals ? this.inView(large, transfers) : [];
    this.targets.layers.forEach((_, i) => this.drawLayer(i, shared, draws, hasPlanes));
    this.finish(camera, framebuffer, origin, shade, nearM);
  }

  /** What of the samples may be seen: of each part the runs of its blocks. */
  inView(camera, transfers) {
    const { header } = this;
    return this.segments.map(({ face, range, blocks }) => {
      const runs = [];
      let end = -1;
      for (const { x, y, first, count, inverseDepths } of blocks) {
        const [columns, rows] = [[x, x + header.blockPx], [y, y + header.blockPx]];
        if (!mayBeSeen(camera, transfers[face], columns, rows, inverseDepths, header.rules.wNear)) continue;
        if (first === end) runs[runs.length - 1][1] += count;
        else runs.push([first, count]);
        end = first + count;
      }
      const { one, x, y, q } = transfers[face];
      return { runs, uniforms: { one, xStep: x, yStep: y, perInverseDepth: q, range } };
    }).filter(({ runs }) => runs.length > 0);
  }

  /** Plane textures: first their opaque pixels, then the nearest surfaces of rims in front of these. */
  drawPlanes(shared, transfers) {
    const { gl, header } = this;
    const { array, count, partial, atlas } = this.planes;
    const { planes, rims, width, height } = this.targets;
    const all = (of) => transfers.flatMap(of);
    const ofFaces = (of) => header.faces.flatMap(of);
    gl.bindFramebuffer(gl.FRAMEBUFFER, planes.to);
    gl.colorMask(true, true, true, true);
    gl.depthMask(true);
    gl.clearColor(0, 0, 0, 0);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    gl.enable(gl.DEPTH_TEST);
    gl.depthFunc(gl.LESS);
    gl.disable(gl.BLEND);
    gl.bindVertexArray(array);
    const uniforms = {
      ...shared,
      one: all((t) => t.one),
      xStep: all((t) => t.x),
      yStep: all((t) => t.y),
      right: ofFaces((face) => face.right),
      up: ofFaces((face) => face.up),
      normal: ofFaces((face) => face.normal),
      perInverseDepth: transfers[0].q,
      texels: atlas,
    };
    const drawTiles = (number, passes) => {
      this.tileProgram.use({ ...uniforms, ...passes });
      gl.drawArraysInstanced(gl.TRIANGLE_STRIP, 0, 4, number);
    };
    const none = this.noTexture;
    drawTiles(count, { rims: false, adds: false, layer: 0, nearest: none, before: none, sumBefore: none });
    rims.forEach(({ color, depth, toDepth, toColor }, i) => {
      const passes = { rims: true, layer: i, before: rims[i - 1]?.depth ?? none, sumBefore: rims[i - 1]?.color ?? none };
      // Depths start from those of the opaque pixels, so that only rims in front of them are drawn.
      gl.bindFramebuffer(gl.READ_FRAMEBUFFER, planes.to);
      gl.bindFramebuffer(gl.DRAW_FRAMEBUFFER, toDepth);
      gl.blitFramebuffer(0, 0, width, height, 0, 0, width, height, gl.DEPTH_BUFFER_BIT, gl.NEAREST);
      gl.bindFramebuffer(gl.FRAMEBUFFER, toDepth);
      gl.depthMask(true);
      gl.disable(gl.BLEND);
      drawTiles(partial, { ...passes, adds: false, nearest: none });
      gl.bindFramebuffer(gl.FRAMEBUFFER, toColor);
      gl.clear(gl.COLOR_BUFFER_BIT);
      gl.depthMask(false);
      gl.enable(gl.BLEND);
      gl.blendFunc(gl.ONE, gl.ONE);
      drawTiles(partial, { ...passes, adds: true, nearest: depth });
    });
  }

  /** One surface of each pixel: first how far it is, then what lies on it. */
  drawLayer(i, shared, draws, hasPlanes) {
    const { gl } = this;
    const { layers, planes, rims } = this.targets;
    const { color, depth, toDepth, toColor } = layers[i];
    const before = i > 0 ? layers[i - 1] : { color: this.noTexture, depth: this.noTexture };
    const uniforms = { ...shared, layer: i, before: before.depth, sumBefore: before.color };
    const ofRims = rims.map(({ color, depth }, k) => ({ [`rimSum${k}`]: color, [`rimDepth${k}`]: depth }));
    const laid = Object.assign({ planeColor: planes.color, planeDepth: planes.depth }, ...ofRims);
    const drawAll = (adds) => {
      const passes = { ...uniforms, adds, nearest: adds ? depth : this.noTexture };
      if (hasPlanes) {
        gl.bindVertexArray(this.nothing);
        this.laidProgram.use({ ...passes, ...laid });
        gl.drawArrays(gl.TRIANGLES, 0, 3);
      }
      gl.bindVertexArray(this.sampleArray);
      this.sampleProgram.use({ ...passes, hasPlanes, planeDepth: hasPlanes ? planes.depth : this.noTexture });
      for (const { runs, uniforms } of draws) {
        this.sampleProgram.use(uniforms);
        for (const [first, count] of runs) gl.drawArrays(gl.POINTS, first, count);
      }
    };
    gl.bindFramebuffer(gl.FRAMEBUFFER, toDepth);
    gl.enable(gl.DEPTH_TEST);
    gl.depthFunc(gl.LESS);
    gl.depthMask(true);
    gl.disable(gl.BLEND);
    gl.clear(gl.DEPTH_BUFFER_BIT);
    drawAll(false);
    gl.bindFramebuffer(gl.FRAMEBUFFER, toColor);
    gl.disable(gl.DEPTH_TEST);
    gl.enable(gl.BLEND);
    gl.blendFunc(gl.ONE, gl.ONE);
    gl.clearColor(0, 0, 0, 0);
    gl.clear(gl.COLOR_BUFFER_BIT);
    drawAll(true);
  }

  /** Puts surfaces and environment together, and fills small holes. */
  finish(camera, framebuffer, origin, shade, nearM) {
    const { gl, header, targets, shell } = this;
    const hasShell = shell !== null && this.missing > 0;
    const sums = targets.layers.map(({ color }, i) => [`sum${i}`, color]);
    gl.bindFramebuffer(gl.FRAMEBUFFER, targets.frame.to);
    gl.viewport(0, 0, ...camera.size);
    gl.disable(gl.BLEND);
    gl.bindVertexArray(this.nothing);
    this.finishProgram.use({
      ...header.rules,
      ...Object.fromEntries(sums),
      ...raysOf(camera, [0, 0], this.environment, this.noCube),
      ...(hasShell ? shell : { shellColor: this.noCube, shellDepth: this.noCube }),
      hasShell,
      eye: camera.eye,
      nearest: targets.layers[0].depth,
      nearM,
      margin: MARGIN_PX,
    });
    gl.drawArrays(gl.TRIANGLES, 0, 3);
    gl.bindFramebuffer(gl.FRAMEBUFFER, framebuffer);
    gl.viewport(...origin, ...camera.size);
    this.fillProgram.use({
      frame: targets.frame.color,
      nearest: targets.layers[0].depth,
      size: camera.size,
      origin,
      margin: MARGIN_PX,
      hole: [0, 0, 0],
      shade,
    });
    gl.drawArrays(gl.TRIANGLES, 0, 3);
  }
}
