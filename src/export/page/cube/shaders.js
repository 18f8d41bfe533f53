// The shaders. Rows of all targets but the last run downward, as those of pictures do.
import { CURVES, HEAD, SURROUNDINGS } from '../glsl.js';
import { SHELL } from './shell.js';

/**
 * Which surface of a pixel something is on. Of each pixel the nearest surface is found first, as 1 / eye depth, then what lies on
 * it is added up; then the same for what lies behind that surface, and so on (surface.rs; Everitt's depth peeling, 2001).
 */
const PEELING = `
uniform sampler2D nearest;   // of this surface; only while it is added up
uniform sampler2D before;    // of the surface in front of this one
uniform sampler2D sumBefore; // what that surface holds of the pixel
uniform int layer;
uniform bool adds;
uniform float nearM;
uniform float opaque;
/** Share of the tolerance that applies to opaque pixels of planes, whose depth is exact (peel.rs). */
const float OPAQUE_TOLERANCE = 0.25;
float inverseDepthAt(sampler2D depths) { return (1.0 - texelFetch(depths, ivec2(gl_FragCoord.xy), 0).r) / nearM; }
/** Whether 1 / eye depth q is on this surface, or may be the nearest behind the one before it. */
bool isHere(float q, float apart) {
  if (layer > 0) {
    if (q + apart >= inverseDepthAt(before)) return false;
    if (texelFetch(sumBefore, ivec2(gl_FragCoord.xy), 0).a >= opaque) return false;
  }
  return !adds || q + apart >= inverseDepthAt(nearest);
}
`;

/** A sample: its tent in the frame, from the plane on which it lies (size.rs, tent.rs). */
export const SAMPLE_VERTEX = `${HEAD}
uniform vec3 one, xStep, yStep, perInverseDepth;
uniform vec2 range;      // inverse depth of code 0, and of a step
uniform vec2 frame, principal;
uniform sampler2D normals;
uniform float pixel, maxSlope, minRadius, maxRadius, minPeak, wNear, nearM, tolerance, bin;
layout(location = 0) in uint geometry;
layout(location = 1) in vec4 color;
layout(location = 2) in vec2 at;
flat out vec3 tint;
flat out vec4 tent;      // middle, 1 / radii
flat out vec3 weighs;    // peak; 1 / eye depth; what another surface is apart
void main() {
  float q = range.x + float(geometry & 0xfffffu) * range.y;
  vec2 p = at + 0.5;
  vec3 h = one + xStep * p.x + yStep * p.y + perInverseDepth * q;
  if (h.z < wNear) {
    gl_Position = vec4(2.0, 2.0, 2.0, 1.0);
    return;
  }
  vec3 n = texelFetch(normals, ivec2(int(geometry >> 20u), 0), 0).xyz;
  vec2 along = vec2(n.x, -n.y) * pixel;
  float ray = dot(along, p) - n.x + n.y - n.z;
  vec2 slope = clamp(along / (abs(ray) < 1e-12 ? 1e-12 : ray), -maxSlope * pixel, maxSlope * pixel) * q;
  vec3 right = xStep + perInverseDepth * slope.x;
  vec3 down = yStep + perInverseDepth * slope.y;
  float reciprocal = 1.0 / h.z;
  vec2 middle = h.xy * reciprocal;
  vec2 ofRight = (right.xy - middle * right.z) * reciprocal;
  vec2 ofDown = (down.xy - middle * down.z) * reciprocal;
  vec2 radii = clamp(sqrt(ofRight * ofRight + ofDown * ofDown), minRadius, maxRadius);
  float area = abs(ofRight.x * ofDown.y - ofRight.y * ofDown.x);
  float peak = max(min(area / (min(radii.x, radii.y) * sqrt(radii.x * radii.y)), 1.0), minPeak) * color.a;
  float inverseDepth = q * reciprocal;
  tint = color.rgb;
  tent = vec4(middle + principal, 1.0 / radii);
  weighs = vec3(peak, inverseDepth, max(inverseDepth * tolerance, bin));
  gl_Position = vec4(tent.xy / frame * 2.0 - 1.0, 1.0 - 2.0 * min(inverseDepth * nearM, 1.0), 1.0);
  gl_PointSize = 2.0 * max(radii.x, radii.y) + 1.0;
}`;

export const SAMPLE_FRAGMENT = `${HEAD}${PEELING}
uniform float steps;     // weights are whole numbers of 1 / steps
uniform float tolerance;
uniform bool hasPlanes;
uniform sampler2D planeDepth;
flat in vec3 tint;
flat in vec4 tent;
flat in vec3 weighs;
out vec4 sum;
/** Whether the sample is farther behind an opaque pixel of a plane than another may be on its surface, if nothing is nearer. */
bool isBehindPlane() {
  if (!hasPlanes || !adds || layer > 0) return false;
  float front = inverseDepthAt(nearest);
  float least = front * (1.0 + tolerance * (1.0 - OPAQUE_TOLERANCE));
  return inverseDepthAt(planeDepth) >= front && weighs.y + weighs.z < least;
}
void main() {
  vec2 height = max(1.0 - abs(gl_FragCoord.xy - tent.xy) * tent.zw, 0.0);
  float weight = floor(height.x * height.y * weighs.x * steps + 0.5) / steps;
  if (weight <= 0.0 || !isHere(weighs.y, weighs.z) || isBehindPlane()) discard;
  sum = vec4(tint * weight, weight);
}`;

/** A picture on a plane, as large as fits its place in the frame (plan.rs: LEAST_AREA_PX). */
export const TILE_VERTEX = `${HEAD}
uniform vec3 one[6], xStep[6], yStep[6], right[6], up[6], normal[6];
uniform vec3 perInverseDepth;
uniform vec2 frame, principal;
uniform float pixel, wNear, nearM;
layout(location = 0) in vec3 plane;
layout(location = 1) in vec4 place;      // left, top, width, height
layout(location = 2) in uint face;
layout(location = 3) in uvec4 atlas;
out vec2 texel;
flat out vec4 inAtlas;                   // column, row, layer
flat out vec2 last;
flat out float spread;                   // of four lookups around the texel that smooth as the level between two sizes does; 0: one
void main() {
  uint f = min(face, 5u);
  vec3 q = vec3(dot(plane, right[f]) * pixel, -dot(plane, up[f]) * pixel, dot(plane, normal[f] - right[f] + up[f]));
  mat3 toFrame = mat3(xStep[f] + perInverseDepth * q.x, yStep[f] + perInverseDepth * q.y, one[f] + perInverseDepth * q.z);
  vec2 extent = place.zw - 1.0;
  vec2 corner = vec2(gl_VertexID & 1, gl_VertexID >> 1);
  vec2 within = corner * extent + (corner * 2.0 - 1.0) * 1e-3;
  vec3 at = vec3(place.xy + 0.5 + within, 1.0);
  vec3 h = toFrame * at;
  int level = 0;
  spread = 0.0;
  bool inFront = true;
  for (int i = 0; i < 4; i++) inFront = inFront && (toFrame * vec3(place.xy + 0.5 + vec2(i & 1, i >> 1) * extent, 1.0)).z >= wNear;
  if (inFront) {
    vec3 middle = toFrame * vec3(place.xy + 0.5 + extent / 2.0, 1.0);
    vec2 x = toFrame[0].xy - toFrame[0].z * middle.xy / middle.z;
    vec2 y = toFrame[1].xy - toFrame[1].z * middle.xy / middle.z;
    float areaPx = abs(x.x * y.y - x.y * y.x) / (middle.z * middle.z);
    for (; level < 3 && areaPx < 0.19; level++) areaPx *= 4.0;
    if (level < 3 && areaPx < 0.385) spread = 1.0 / 6.0;
  }
  float smaller = float(1 << level);
  texel = within / smaller;
  last = ceil(extent / smaller);
  uint from = level == 0 ? atlas.x : level == 1 ? atlas.y : level == 2 ? atlas.z : atlas.w;
  inAtlas = vec4(float(from & 2047u), float((from >> 11u) & 2047u), float(from >> 22u), 0.0);
  gl_Position = vec4((h.xy + principal * h.z) / frame * 2.0 - h.z, h.z - 2.0 * nearM * dot(q, at), h.z);
}`;

/**
 * Opaque pixels of plane textures, or their rims: pixels that a texture covers partly. Textures that meet have half of their border's
 * pixels each: coverages of rims of one surface add up, so that nothing shines through (`add_rims` in surface_canvas).
 */
export const TILE_FRAGMENT = `${HEAD}${PEELING}
uniform sampler2DArray texels;
uniform bool rims;                       // else the opaque pixels
uniform float steps, tolerance, bin;
in vec2 texel;
flat in vec4 inAtlas;
flat in vec2 last;
flat in float spread;
out vec4 sum;
vec4 texelAt(vec2 at) { return textureLod(texels, vec3((inAtlas.xy + at + 0.5) / 2048.0, inAtlas.z), 0.0); }
void main() {
  vec2 at = clamp(texel, vec2(0.0), last);
  vec4 found;
  if (spread > 0.0) {
    // The outermost texels are not smoothed across, so that textures that share them still meet.
    vec2 d = min(vec2(spread), min(at, last - at));
    found = (texelAt(at + d) + texelAt(at - d) + texelAt(at + vec2(d.x, -d.y)) + texelAt(at + vec2(-d.x, d.y))) / 4.0;
  } else {
    found = texelAt(at);
  }
  float weight = floor(found.a * steps + 0.5) / steps;
  float q = (1.0 - gl_FragCoord.z) / nearM;
  if (weight <= 0.0 || rims == (found.a > 0.998) || !isHere(q, max(q * tolerance, bin))) discard;
  sum = vec4(found.rgb / found.a * weight, weight);
}`;

/** Opaque pixels and rims of plane textures, added to the surfaces of samples. */
export const laidFragment = (rims) => `${HEAD}${PEELING}
uniform sampler2D planeColor, planeDepth;
${rims.map((i) => `uniform sampler2D rimSum${i}, rimDepth${i};`).join('\n')}
uniform float tolerance, bin;
out vec4 sum;
float front = 1.0;
void add(sampler2D sums, sampler2D depths, float tolerated) {
  vec4 found = texelFetch(sums, ivec2(gl_FragCoord.xy), 0);
  float depth = texelFetch(depths, ivec2(gl_FragCoord.xy), 0).r;
  float q = max((1.0 - depth) / nearM, 0.0);
  if (found.a <= 0.0 || !isHere(q, max(q * tolerated, bin))) return;
  sum += found;
  front = min(front, depth);
}
void main() {
  sum = vec4(0.0);
  add(planeColor, planeDepth, tolerance * OPAQUE_TOLERANCE);
${rims.map((i) => `  add(rimSum${i}, rimDepth${i}, tolerance);`).join('\n')}
  if (sum.a <= 0.0) discard;
  gl_FragDepth = front;
}`;

/** Surfaces over one another and over the environment, in linear light (surface.rs, finish.rs). */
export const finishFragment = (layers) => `${HEAD}${CURVES}${SURROUNDINGS}${SHELL}
${layers.map((i) => `uniform sampler2D sum${i};`).join('\n')}
uniform sampler2D nearest;               // surface of each pixel
uniform float margin, opaque, rampStart, nearM;
out vec4 color;                          // alpha: whether anything is known
/** Share of the shell's 1 / eye depth below which something is behind it. */
const float BEHIND = 0.8;
/** A surface over what is behind it, which fills what it leaves open as it fills the pixel. */
vec4 over(vec4 sum, vec4 behind) {
  if (sum.a <= 0.0) return behind;
  float ramp = 1.0 - (opaque - sum.a) * (1.0 - rampStart) / (opaque - rampStart);
  float share = min(max(sum.a, ramp), 1.0);
  float rest = (1.0 - share) * (share < 1.0 ? min(behind.a / (1.0 - share), 1.0) : 0.0);
  return vec4((linear(sum.rgb / sum.a) * share + behind.rgb * rest) / (share + rest), share + rest);
}
void main() {
  vec2 pixel = inFrame();
  ivec2 at = ivec2(pixel + margin);
  vec4 seen = vec4(0.0);
${layers.map((i) => `  seen = over(texelFetch(sum${i}, at, 0), seen);`).reverse().join('\n')}
  bool known = seen.a > 0.0;
  if (hasShell) {
    // While parts are missing what has come is laid over the shell, unless it belongs behind it.
    vec4 first = shellAlong(directionAt(pixel));
    float q = (1.0 - texelFetch(nearest, at, 0).r) / nearM;
    seen.rgb = mix(linear(first.rgb), seen.rgb, q < first.a * BEHIND ? 0.0 : seen.a);
    known = true;
  } else if (seen.a < 1.0) {
    vec4 far = surroundings(directionAt(pixel));
    if (far.a > 0.0) seen.rgb = linear(far.rgb) * (1.0 - seen.a) + seen.rgb * seen.a;
    known = known || far.a > 0.0;
  }
  color = vec4(srgb(seen.rgb), known ? 1.0 : 0.0);
}`;

/** Holes of a few pixels take the colour of the farthest of the pixels beside them, and grow shut from their rims (fill.rs). */
export const FILL_FRAGMENT = `${HEAD}
uniform sampler2D frame;
uniform sampler2D nearest;               // surface of each pixel; rows downward, with a margin
uniform vec2 size, origin;
uniform float margin, shade;
uniform vec3 hole;
out vec4 color;
const ivec2 BESIDE[4] = ivec2[4](ivec2(-1, 0), ivec2(1, 0), ivec2(0, 1), ivec2(0, -1));
/** Colour of a pixel, and how far it is: -1 where nothing is known, 1 at infinity. */
vec4 at(ivec2 p) {
  if (any(lessThan(p, ivec2(0))) || any(greaterThanEqual(p, ivec2(size)))) return vec4(hole, -1.0);
  vec4 found = texelFetch(frame, p, 0);
  ivec2 downward = ivec2(p.x, int(size.y) - 1 - p.y) + int(margin);
  return found.a > 0.5 ? vec4(found.rgb, texelFetch(nearest, downward, 0).r) : vec4(hole, -1.0);
}
vec4 grown(ivec2 p) {
  vec4 found = at(p);
  if (found.a >= 0.0) return found;
  for (int i = 0; i < 4; i++) {
    vec4 beside = at(p + BESIDE[i]);
    if (beside.a > found.a) found = beside;
  }
  return found;
}
void main() {
  ivec2 p = ivec2(gl_FragCoord.xy - origin);
  vec4 found = grown(p);
  if (found.a < 0.0) {
    for (int i = 0; i < 4; i++) {
      vec4 beside = grown(p + BESIDE[i]);
      if (beside.a > found.a) found = beside;
    }
  }
  color = vec4(found.rgb * shade, 1.0);
}`;
