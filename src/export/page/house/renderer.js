// Draws a house of cells and portals: the surfaces of the cells that show, by depth, over the sky.
import { context, Program } from '../gl.js';
import { WHOLE_VERTEX } from '../glsl.js';
import { pictureOf } from '../pictures.js';
import { raysOf, readSurroundings } from '../surroundings.js';
import { mayShow, visibleCells } from './cells.js';
import { readMesh, VERTEX_BYTES } from './mesh.js';
import { MESH_FRAGMENT, MESH_VERTEX, SKY_FRAGMENT } from './shaders.js';

/** What is nearer than this is not drawn, metres. */
const NEAR_M = 0.02;

export class Renderer {
  constructor(canvas, header) {
    /** What its framebuffers must have. */
    this.buffers = { antialias: true, depth: true };
    const gl = context(canvas, this.buffers);
    Object.assign(this, { gl, header, pieces: [], environment: null, textures: [] });
    this.meshProgram = new Program(gl, MESH_VERTEX, MESH_FRAGMENT);
    this.skyProgram = new Program(gl, WHOLE_VERTEX, SKY_FRAGMENT);
    this.nothing = gl.createVertexArray();
    this.noCube = gl.createTexture();
    this.white = gl.createTexture();
    gl.bindTexture(gl.TEXTURE_2D, this.white);
    gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA8, 1, 1, 0, gl.RGBA, gl.UNSIGNED_BYTE, new Uint8Array(4).fill(255));
  }

  /** Takes a part of the payload in. */
  async add(part, bytes) {
    if (part.kind === 'environment') this.environment = readSurroundings(this.gl, part, bytes);
    else if (part.kind === 'mesh') this.addMesh(part, bytes);
    else if (part.kind === 'texture') await this.addTexture(part, bytes);
  }

  addMesh(part, bytes) {
    const { gl } = this;
    const { vertices, corners } = readMesh(bytes, part, this.header.step);
    const array = gl.createVertexArray();
    gl.bindVertexArray(array);
    gl.bindBuffer(gl.ARRAY_BUFFER, gl.createBuffer());
    gl.bufferData(gl.ARRAY_BUFFER, vertices, gl.STATIC_DRAW);
    gl.vertexAttribPointer(0, 3, gl.FLOAT, false, VERTEX_BYTES, 0);
    gl.vertexAttribPointer(1, 3, gl.HALF_FLOAT, false, VERTEX_BYTES, 12);
    gl.vertexAttribPointer(2, 2, gl.FLOAT, false, VERTEX_BYTES, 20);
    for (const i of [0, 1, 2]) gl.enableVertexAttribArray(i);
    gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, gl.createBuffer());
    gl.bufferData(gl.ELEMENT_ARRAY_BUFFER, corners, gl.STATIC_DRAW);
    this.pieces.push({ array, cell: part.cell, box: part.box, runs: part.runs });
  }

  /** A picture with its sampler, wrapping around without one, with smaller copies made in linear light. */
  async addTexture({ texture, sampler }, bytes) {
    const { gl } = this;
    const picture = await pictureOf(bytes, gl.getParameter(gl.MAX_TEXTURE_SIZE));
    const made = gl.createTexture();
    gl.bindTexture(gl.TEXTURE_2D, made);
    gl.texImage2D(gl.TEXTURE_2D, 0, gl.SRGB8_ALPHA8, gl.RGBA, gl.UNSIGNED_BYTE, picture);
    picture.close();
    gl.generateMipmap(gl.TEXTURE_2D);
    gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MIN_FILTER, gl.LINEAR_MIPMAP_LINEAR);
    if (sampler) {
      const modes = { Repeat: gl.REPEAT, Mirror: gl.MIRRORED_REPEAT, Clamp: gl.CLAMP_TO_EDGE };
      gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_WRAP_S, modes[sampler.wrap[0]]);
      gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_WRAP_T, modes[sampler.wrap[1]]);
      if (sampler.nearest) gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MAG_FILTER, gl.NEAREST);
    }
    const finer = gl.getExtension('EXT_texture_filter_anisotropic');
    if (finer) gl.texParameteri(gl.TEXTURE_2D, finer.TEXTURE_MAX_ANISOTROPY_EXT, 4);
    this.textures[texture] = made;
  }

  /** Draws what a camera sees to a part of a framebuffer that begins at `origin`. `shade`: 1 for full light. */
  draw(camera, framebuffer = null, origin = [0, 0], shade = 1) {
    const { gl, header } = this;
    gl.bindFramebuffer(gl.FRAMEBUFFER, framebuffer);
    gl.viewport(...origin, ...camera.size);
    // The other eye's half stays.
    gl.enable(gl.SCISSOR_TEST);
    gl.scissor(...origin, ...camera.size);
    gl.disable(gl.CULL_FACE);
    gl.disable(gl.BLEND);
    gl.enable(gl.DEPTH_TEST);
    gl.depthFunc(gl.LESS);
    gl.depthMask(true);
    gl.clearDepth(1);
    gl.clear(gl.DEPTH_BUFFER_BIT);
    const { eye, right, up, back, focal, principal, size } = camera;
    this.meshProgram.use({ eye, right, up, back, focal, principal, size, nearM: NEAR_M, tone: header.tone, shade });
    for (const { array, runs } of this.inView(camera)) {
      gl.bindVertexArray(array);
      let first = 0;
      for (const [material, triangles] of runs) {
        this.meshProgram.use(this.paint(header.materials[material]));
        if (header.materials[material].singleSided) gl.enable(gl.CULL_FACE);
        else gl.disable(gl.CULL_FACE);
        gl.drawElements(gl.TRIANGLES, triangles * 3, gl.UNSIGNED_SHORT, first * 6);
        first += triangles;
      }
    }
    gl.disable(gl.CULL_FACE);
    gl.depthFunc(gl.LEQUAL);
    gl.bindVertexArray(this.nothing);
    this.skyProgram.use({ ...raysOf(camera, origin, this.environment, this.noCube), hole: [0, 0, 0], shade });
    gl.drawArrays(gl.TRIANGLES, 0, 3);
    gl.disable(gl.SCISSOR_TEST);
  }

  /** The pieces of the cells that show. */
  inView(camera) {
    const seen = visibleCells(this.header, camera);
    if (seen === null) return this.pieces;
    return this.pieces.filter(({ cell, box }) => seen.get(cell)?.some((planes) => mayShow(box, camera.eye, planes)));
  }

  /** The uniforms of a material; until its pictures have come it is plain. */
  paint({ albedo, emission, albedoTexture, emissionTexture, cutout }) {
    const texture = (number) => this.textures[number] ?? this.white;
    const [holes, threshold] = cutout ?? [null, 0];
    return {
      albedo,
      emission,
      threshold,
      albedoTexture: texture(albedoTexture),
      emissionTexture: texture(emissionTexture),
      cutout: texture(holes),
    };
  }
}
