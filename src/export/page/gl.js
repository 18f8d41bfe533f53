// WebGL 2, with fewer words.

/** The context of a canvas; `buffers`: what it must have. */
export function context(canvas, buffers) {
  const gl = canvas.getContext('webgl2', { alpha: false, powerPreference: 'high-performance', xrCompatible: true, ...buffers });
  if (!gl) throw new Error('This browser has no WebGL 2, which the view needs. Another one, or a newer one, will show it.');
  return gl;
}

/** A program whose uniforms are set by name. Textures are numbered as they come. */
export class Program {
  constructor(gl, vertex, fragment) {
    this.gl = gl;
    this.program = gl.createProgram();
    for (const [kind, source] of [[gl.VERTEX_SHADER, vertex], [gl.FRAGMENT_SHADER, fragment]]) {
      const shader = gl.createShader(kind);
      gl.shaderSource(shader, source);
      gl.compileShader(shader);
      gl.attachShader(this.program, shader);
    }
    gl.linkProgram(this.program);
    if (!gl.getProgramParameter(this.program, gl.LINK_STATUS) && !gl.isContextLost()) {
      const logs = gl.getAttachedShaders(this.program).map((shader) => gl.getShaderInfoLog(shader));
      throw new Error(`a shader does not compile here: ${logs.join(' ')}${gl.getProgramInfoLog(this.program)}`);
    }
    this.uniforms = new Map();
    const count = gl.getProgramParameter(this.program, gl.ACTIVE_UNIFORMS) ?? 0;
    let unit = 0;
    for (let i = 0; i < count; i++) {
      const { name, type } = gl.getActiveUniform(this.program, i);
      const location = gl.getUniformLocation(this.program, name);
      const target = this.textureTarget(type);
      this.uniforms.set(name.replace('[0]', ''), { location, type, target, unit: target ? unit++ : 0 });
    }
  }

  textureTarget(type) {
    const { gl } = this;
    if (type === gl.SAMPLER_2D || type === gl.UNSIGNED_INT_SAMPLER_2D) return gl.TEXTURE_2D;
    if (type === gl.SAMPLER_2D_ARRAY || type === gl.UNSIGNED_INT_SAMPLER_2D_ARRAY) return gl.TEXTURE_2D_ARRAY;
    return type === gl.SAMPLER_CUBE ? gl.TEXTURE_CUBE_MAP : null;
  }

  /** Makes this the program in use, and sets uniforms; what a shader does not use is passed over. */
  use(values) {
    this.gl.useProgram(this.program);
    for (const [name, value] of Object.entries(values)) {
      const uniform = this.uniforms.get(name);
      if (uniform) this.set(uniform, value);
    }
  }

  set({ location, type, target, unit }, value) {
    const { gl } = this;
    if (target) {
      gl.activeTexture(gl.TEXTURE0 + unit);
      gl.bindTexture(target, value);
      gl.uniform1i(location, unit);
    } else if (type === gl.FLOAT) gl.uniform1f(location, value);
    else if (type === gl.INT || type === gl.BOOL) gl.uniform1i(location, value);
    else if (type === gl.INT_VEC2) gl.uniform2iv(location, value);
    else if (type === gl.INT_VEC3) gl.uniform3iv(location, value);
    else if (type === gl.FLOAT_VEC2) gl.uniform2fv(location, value);
    else if (type === gl.FLOAT_VEC3) gl.uniform3fv(location, value);
    else throw new Error(`no uniform of type ${type}`);
  }
}

/** An empty texture, at one size or several, whose texels are fetched one by one. */
export function texture(gl, format, [width, height], levels = 1) {
  const made = gl.createTexture();
  gl.bindTexture(gl.TEXTURE_2D, made);
  gl.texStorage2D(gl.TEXTURE_2D, levels, format, width, height);
  const between = levels > 1 ? gl.NEAREST_MIPMAP_NEAREST : gl.NEAREST;
  gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MIN_FILTER, between);
  gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MAG_FILTER, gl.NEAREST);
  return made;
}

/** Where to draw: textures for colour and depth, either of which may be absent. */
export function target(gl, color, depth) {
  const made = gl.createFramebuffer();
  gl.bindFramebuffer(gl.FRAMEBUFFER, made);
  const attach = (point, to) => gl.framebufferTexture2D(gl.FRAMEBUFFER, point, gl.TEXTURE_2D, to, 0);
  if (color) attach(gl.COLOR_ATTACHMENT0, color);
  else gl.drawBuffers([gl.NONE]);
  if (depth) attach(gl.DEPTH_ATTACHMENT, depth);
  return made;
}
