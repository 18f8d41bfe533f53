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
uniform vec2 tone;                       // linear up to the first, white from the second on
uniform float threshold, shade;
uniform sampler2D albedoTexture, emissionTexture, cutout;
in vec3 light;
in vec2 at;
out vec4 color;
// The tone curve (tone.rs), without sRGB encoding.
float compressed(float exposed) {
  float x = min(exposed, tone.y), s = 1.0 - tone.x;
  if (x <= tone.x) return x;
  float t = (x - tone.x) / s, w = (tone.y - tone.x) / s;
  return min(tone.x + s * t * (1.0 + t / (w * w)) / (1.0 + t), 1.0);
}
void main() {
  if (textureLod(cutout, at, 0.0).a < threshold) discard;
  vec3 lit = max(light * albedo * texture(albedoTexture, at).rgb, 0.0);
  vec3 all = lit + emission * texture(emissionTexture, at).rgb;
  color = vec4(srgb(vec3(compressed(all.r), compressed(all.g), compressed(all.b))) * shade, 1.0);
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
