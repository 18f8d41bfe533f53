// What shaders of several renderers share.

export const HEAD = `#version 300 es
precision highp float;
precision highp int;
precision highp sampler2D;
precision highp sampler2DArray;
precision highp usampler2D;
precision highp usampler2DArray;
precision highp samplerCube;
`;

/** sRGB's two curves. */
export const CURVES = `
vec3 linear(vec3 c) { return mix(c / 12.92, pow((c + 0.055) / 1.055, vec3(2.4)), step(0.04045, c)); }
vec3 srgb(vec3 c) { return mix(c * 12.92, 1.055 * pow(c, vec3(1.0 / 2.4)) - 0.055, step(0.0031308, c)); }
`;

/** A triangle that covers the frame, behind everything. */
export const WHOLE_VERTEX = `${HEAD}
void main() { gl_Position = vec4(vec2(gl_VertexID & 1, gl_VertexID >> 1) * 4.0 - 1.0, 1.0, 1.0); }`;

/** The ray of a pixel, and what lies at infinity there: sRGB; alpha 0 where nothing is known. Wants the uniforms of `raysOf`. */
export const SURROUNDINGS = `
uniform samplerCube environment;
uniform bool hasEnvironment;
uniform vec3 right, up, back;
uniform vec2 focal, principal, size, origin;
/** Of this fragment in the frame, row 0 on top. */
vec2 inFrame() { return vec2(gl_FragCoord.x - origin.x, size.y - (gl_FragCoord.y - origin.y)); }
vec3 directionAt(vec2 pixel) {
  vec2 off = (pixel - principal) / focal;
  return right * off.x - up * off.y - back;
}
vec4 surroundings(vec3 direction) {
  vec4 far = hasEnvironment ? texture(environment, direction * vec3(1.0, 1.0, -1.0)) : vec4(0.0);
  return far.a > 0.0 ? vec4(far.rgb / far.a, 1.0) : vec4(0.0);
}
`;
