// The two passes. Rows of fields run downward, as those of pictures do.
import { CURVES, HEAD, SURROUNDINGS } from '../glsl.js';

/** Cells: a bit that says whether something shows, 15 of a value, twice 8 of its change per column and row; 0 where nothing is. */
const CELLS = `
const uint VISIBLE = 0x80000000u;
float valueOf(uint cell) { return float((cell >> 16) & 0x7fffu); }
vec2 slopesOf(uint cell) { return vec2(float(int(cell << 16) >> 24), float(int(cell << 24) >> 24)); }
`;

/** First pass: a cell as the small tilted plane that it is, where pure parallax takes it (Eq. 6 with C5; planes.rs). */
export const MOVE_VERTEX = `${HEAD}${CELLS}
uniform usampler2D field;
uniform ivec2 cells;
uniform vec3 coding;                     // of the field: value of 0, displacement of a step, of a unit of slope
uniform vec3 epipole;
uniform vec2 from, extent;               // where the new field begins, and its size
uniform float nearest, leastStretch, magnified;
flat out vec4 middle;                    // of the cell, and where it goes
flat out vec4 toward;                    // the epipole from there; whether it goes as a plane
flat out vec3 plane;                     // displacement there, and its slopes
flat out uint visible;
void main() {
  ivec2 column = ivec2(gl_VertexID % cells.x, gl_VertexID / cells.x);
  uint cell = texelFetch(field, column, 0).r;
  vec2 at = vec2(column) + 0.5;
  float d = (valueOf(cell) - coding.x) * coding.y;
  vec2 slope = slopesOf(cell) * coding.z;
  vec2 off = epipole.xy - at * epipole.z;
  float w = 1.0 + d * epipole.z;
  gl_Position = vec4(2.0, 2.0, 2.0, 1.0);
  if (w < nearest) return;
  float stretch = w + dot(off, slope);
  // Cells that stay side by side go one by one, as on the CPU, and what gaps they leave are filled.
  bool whole = stretch >= w * leastStretch && max(w, stretch) > magnified * w * w;
  vec2 moved = (at + d * epipole.xy) / w;
  vec2 low = moved, high = moved;
  for (int i = 0; i < 4 && whole; i++) {
    vec2 corner = vec2(i & 1, i >> 1) - 0.5;
    float there = d + dot(slope, corner), depth = 1.0 + there * epipole.z;
    if (depth < nearest) whole = false;
    vec2 to = at + (corner + there * off) / depth;
    low = min(low, to);
    high = max(high, to);
  }
  middle = vec4(at, moved);
  toward = vec4(off, epipole.z, whole ? 1.0 : 0.0);
  plane = vec3(d / w, slope / max(stretch, w * leastStretch));
  visible = cell & VISIBLE;
  vec2 reached = whole ? high - low : vec2(0.0);
  gl_Position = vec4(((whole ? (low + high) / 2.0 : moved) - from) / extent * 2.0 - 1.0, 0.0, 1.0);
  gl_PointSize = max(reached.x, reached.y) + 2.0;
}`;

export const MOVE_FRAGMENT = `${HEAD}
uniform vec2 from;
uniform vec3 newCoding;                  // value of 0, displacement of a step, of a unit of slope
flat in vec4 middle;
flat in vec4 toward;
flat in vec3 plane;
flat in uint visible;
out uint moved;
/** Cells by which a cell reaches beyond itself, for the rounding of its edges. */
const float MARGIN = 1e-3;
void main() {
  vec2 at = gl_FragCoord.xy + from;
  vec2 off = at - middle.xy;
  float d = plane.x + dot(plane.yz, at - middle.zw);
  vec2 within = abs(off - d * toward.xy);
  // Its own cell it reaches always; others where they are inside of it.
  bool own = floor(middle.zw) == floor(at);
  float reach = 0.5 * (1.0 - d * toward.z) + MARGIN;
  if (!own && (toward.w < 0.5 || max(within.x, within.y) > reach)) discard;
  uint value = uint(clamp(d / newCoding.y + newCoding.x + 0.5, 1.0, 32767.0));
  ivec2 slopes = ivec2(clamp(round(plane.yz / newCoding.z), -127.0, 127.0)) & 255;
  moved = visible | (value << 16) | uint((slopes.x << 8) | slopes.y);
  // What shows hides what does not, and what is nearer what is farther.
  gl_FragDepth = 1.0 - float(moved >> 16) / 65536.0;
}`;

/** A step of filling: a gap takes its neighbour's plane, of those that show the farthest (S9, C7; fill.rs). */
export const GROW_FRAGMENT = `${HEAD}${CELLS}
uniform usampler2D field;
uniform vec2 extent;
uniform vec3 newCoding;
out uint grown;
uint best = 0xffffffffu;
void look(ivec2 at, float steps, int slope) {
  if (any(lessThan(at, ivec2(0))) || any(greaterThanEqual(at, ivec2(extent)))) return;
  uint cell = texelFetch(field, at, 0).r;
  if (cell == 0u) return;
  float value = clamp(valueOf(cell) + slopesOf(cell)[slope] * steps + 0.5, 1.0, 32767.0);
  best = min(best, ((cell & (VISIBLE | 0xffffu)) | (uint(value) << 16)) ^ VISIBLE);
}
void main() {
  ivec2 at = ivec2(gl_FragCoord.xy);
  grown = texelFetch(field, at, 0).r;
  if (grown != 0u) return;
  float ratio = newCoding.z / newCoding.y;
  look(at - ivec2(1, 0), ratio, 0);
  look(at + ivec2(1, 0), -ratio, 0);
  look(at - ivec2(0, 1), ratio, 1);
  look(at + ivec2(0, 1), -ratio, 1);
  if (best != 0xffffffffu) grown = best ^ VISIBLE;
}`;

/** Second pass: a pixel's place on the plane, the displacement that was moved there, and the picture (Eq. 8 with C5; backward.rs). */
export const LOOK_FRAGMENT = `${HEAD}${CELLS}${CURVES}${SURROUNDINGS}
uniform usampler2D field;
uniform sampler2D picture;               // times alpha
uniform vec3 perColumn, perRow, corner;  // from the frame to the plane, in pixels of the picture
uniform vec3 epipole;
uniform vec2 cellPx, from, extent;
uniform vec3 newCoding;
uniform ivec2 pictureSize;
uniform int levels;
out vec4 light;                          // linear, times alpha
vec4 texel(ivec2 at, int level) {
  ivec2 size = (pictureSize + (1 << level) - 1) >> level;
  if (any(lessThan(at, ivec2(0))) || any(greaterThanEqual(at, size))) return vec4(0.0);
  return texelFetch(picture, at, level);
}
/** The level whose texels are about as large as the frame's pixels. */
int levelAt(vec2 plane, float w) {
  vec2 x = (perColumn.xy - plane * perColumn.z) / w, y = (perRow.xy - plane * perRow.z) / w;
  float stretch = max(dot(x, x), dot(y, y));
  int level = 0;
  for (; level < levels - 1 && stretch >= 2.0; level++) stretch /= 4.0;
  return level;
}
void main() {
  vec2 pixel = inFrame();
  vec3 h = perColumn * pixel.x + (perRow * pixel.y + corner);
  if (h.z <= 0.0) discard;
  vec2 plane = h.xy / h.z;
  int level = levelAt(plane, h.z);
  vec2 rim = vec2(float(1 << level) + 1.0);
  if (any(lessThan(plane, from * cellPx - rim)) || any(greaterThan(plane, (from + extent) * cellPx + rim))) discard;
  vec2 at = plane / cellPx - from;
  vec2 column = clamp(floor(at), vec2(0.0), extent - 1.0);
  uint cell = texelFetch(field, ivec2(column), 0).r;
  if (cell == 0u) discard;
  float d = (valueOf(cell) - newCoding.x) * newCoding.y + dot(slopesOf(cell) * newCoding.z, at - column - 0.5);
  float w = 1.0 - d * epipole.z;
  if (w <= 0.0) discard;
  vec2 place = (plane - d * epipole.xy) / w / float(1 << level) - 0.5;
  ivec2 first = ivec2(floor(clamp(place, vec2(-2.0), vec2(65536.0))));
  vec2 share = place - floor(place);
  vec4 upper = mix(texel(first, level), texel(first + ivec2(1, 0), level), share.x);
  vec4 lower = mix(texel(first + ivec2(0, 1), level), texel(first + ivec2(1, 1), level), share.x);
  vec4 found = mix(upper, lower, share.y);
  if (found.a <= 0.0) discard;
  light = vec4(linear(found.rgb / found.a) * found.a, found.a);
}`;

/** All sprites over what lies at infinity. */
export const UNDER_FRAGMENT = `${HEAD}${CURVES}${SURROUNDINGS}
uniform sampler2D frame;                 // linear, times alpha
uniform vec3 hole;
uniform float shade;
out vec4 color;
void main() {
  vec4 seen = texelFetch(frame, ivec2(gl_FragCoord.xy - origin), 0);
  vec4 far = surroundings(directionAt(inFrame()));
  vec3 light = far.a > 0.0 ? seen.rgb + linear(far.rgb) * (1.0 - seen.a) : seen.a > 0.0 ? seen.rgb / seen.a : linear(hole);
  color = vec4(srgb(min(light, 1.0)) * shade, 1.0);
}`;
