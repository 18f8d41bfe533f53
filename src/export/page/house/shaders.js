// The shaders of geometry: colours as the rasteriser of the CPU mixes them (shade.rs).
import { CURVES, HEAD, SURROUNDINGS } from '../glsl.js';

export const MESH_VERTEX = `${HEAD}
uniform vec3 eye, right, up, back;
uniform vec2 focal, principal, size;
uniform float nearM;
layout(location = 0) in vec3 position;
layout(location = 1) in vec3 color;
layout(location = 2) in vec2 texcoord;
out vec3 light;
out vec2 at;
void main() {
  vec3 d = position - eye;
  float w = -dot(back, d);
  vec2 frame = vec2(dot(right, d), dot(up, d)) * focal * 2.0 + w * vec2(2.0 * principal.x - size.x, size.y - 2.0 * principal.y);
  // Depth is linear in 1 / w: 1 at infinity.
  gl_Position = vec4(frame / size, w - 2.0 * nearM, w);
  light = color;
  at = vec2(texcoord.x, 1.0 - texcoord.y);
}`;

export const MESH_FRAGMENT = `${HEAD}${CURVES}
uniform vec3 albedo, emission;           // under the exposure
uniform float exposure, threshold, shade;
uniform sampler2D albedoTexture, emissionTexture, cutout;
in vec3 light;
in vec2 at;
out vec4 color;
void main() {
  if (textureLod(cutout, at, 0.0).a < threshold) discard;
  vec3 lit = clamp(light * albedo * texture(albedoTexture, at).rgb, 0.0, exposure);
  vec3 all = lit + emission * texture(emissionTexture, at).rgb;
  color = vec4(srgb(min(all, 1.0)) * shade, 1.0);
}`;

/** What is behind all surfaces. */
export const SKY_FRAGMENT = `${HEAD}${SURROUNDINGS}
uniform vec3 hole;
uniform float shade;
out vec4 color;
void main() {
  vec4 far = surroundings(directionAt(inFrame()));
  color = vec4((far.a > 0.0 ? far.rgb : hole) * shade, 1.0);
}`;
