// A ray at a time: which layer it meets, and the blend of the four cameras that it lies between (kernel.rs, taps.rs).
import { CURVES, HEAD, SURROUNDINGS } from '../glsl.js';

export const RAY_FRAGMENT = `${HEAD}${CURVES}${SURROUNDINGS}
uniform sampler2DArray colors;           // of each camera
uniform usampler2DArray indices;         // of layers: 0 at infinity
uniform sampler2D layers;                // three texels each, near ones first
uniform sampler2D places;                // of the cameras that are shown, and their numbers: columns, then rows
uniform ivec3 counts;                    // layers, columns, rows
uniform int inRow;                       // cameras, shown or not
uniform ivec2 picture;                   // pixels of an image
uniform vec3 eye, start, right1, down1;  // in plane space: the eye, and the directions of pixels
uniform vec2 steps[24];                  // cells beside
uniform int stepCount;
uniform vec3 hole;
uniform float shade;
out vec4 result;

const float LEAST_WEIGHT = 1.0 / 1024.0, LEAST_OPEN = 1.0 / 256.0, LEAST_FORWARD = 1e-6;

/** The cameras about a crossing of the plane, or those some cells from there: numbers and places to either side, weight of the second. */
struct Sides { ivec2 number; vec2 place; float weight; bool away; };

Sides sidesOf(int axis, float crossing, int shift) {
  int count = axis == 0 ? counts.y : counts.z;
  int cell = 0;
  for (int i = 1; i < count - 1; i++) if (texelFetch(places, ivec2(i, axis), 0).r <= crossing) cell = i;
  int most = max(count - 2, 0);
  int low = clamp(cell + shift, 0, most);
  int high = min(low + 1, count - 1);
  vec2 first = texelFetch(places, ivec2(low, axis), 0).rg, second = texelFetch(places, ivec2(high, axis), 0).rg;
  vec2 at = vec2(first.x, second.x);
  float weight = clamp((crossing - at.x) / max(at.y - at.x, 1e-30), LEAST_WEIGHT, 1.0 - LEAST_WEIGHT);
  return Sides(ivec2(first.y, second.y), at, weight, cell + shift < 0 || cell + shift > most);
}

/** Adds what shows one of some layers among the four texels around a position, times a weight. */
void addTaps(vec2 at, ivec2 size, int camera, int level, ivec2 range, float weight, inout vec4 sum) {
  vec2 p = clamp(at - 0.5, vec2(0.0), vec2(size - 1));
  ivec2 first = min(ivec2(p), size - 2);
  vec2 share = p - vec2(first);
  for (int i = 0; i < 4; i++) {
    ivec3 texel = ivec3(first + ivec2(i & 1, i >> 1), camera);
    int index = int(texelFetch(indices, texel, level).r);
    if (index < range.x || index > range.y) continue;
    vec2 part = mix(1.0 - share, share, vec2(i & 1, i >> 1));
    sum += vec4(texelFetch(colors, texel, level).rgb, 1.0) * (weight * part.x * part.y);
  }
}

bool isInside(vec2 at, ivec2 size) { return all(greaterThanEqual(at, vec2(0.0))) && all(lessThan(at, vec2(size))); }

/** What the cameras of a cell show of a ray; a layer's neighbours count as it where \`loose\`. */
void look(vec2 slopes, Sides across, Sides up, bool loose, inout vec3 color, inout float open) {
  for (int i = 0; i < counts.x && open >= LEAST_OPEN; i++) {
    vec4 place = texelFetch(layers, ivec2(0, i), 0);
    vec4 ranges = texelFetch(layers, ivec2(1, i), 0);
    int level = int(texelFetch(layers, ivec2(2, i), 0).r);
    ivec2 range = ivec2(loose ? ranges.zw : ranges.xy);
    ivec2 size = max(picture >> level, ivec2(1));
    vec2 u = slopes.x * place.x + place.y - across.place * place.w;
    vec2 v = -slopes.y * place.x + place.z + up.place * place.w;
    vec4 sum = vec4(0.0);
    float showing = 0.0, passing = 0.0;
    for (int k = 0; k < 4; k++) {
      bool second = (k & 1) == 1, upper = k > 1;
      vec2 at = vec2(second ? u.y : u.x, upper ? v.y : v.x);
      if (!isInside(at, size)) continue;
      int camera = (upper ? up.number.y : up.number.x) * inRow + (second ? across.number.y : across.number.x);
      float weight = (second ? across.weight : 1.0 - across.weight) * (upper ? up.weight : 1.0 - up.weight);
      int index = int(texelFetch(indices, ivec3(ivec2(at), camera), level).r);
      if (index < range.x) passing += weight;
      else if (index <= range.y) {
        showing += weight;
        addTaps(at, size, camera, level, range, weight, sum);
      }
    }
    if (showing > 0.0 && sum.a > 0.0) {
      float taken = open * showing / (showing + passing);
      color += sum.rgb / sum.a * taken;
      open -= taken;
    }
  }
}

/** Whether a camera that looks along a ray to infinity sees something instead. */
bool isHidden(vec2 slopes, Sides across, Sides up) {
  vec4 place = texelFetch(layers, ivec2(0, counts.x - 1), 0);
  int level = int(texelFetch(layers, ivec2(2, counts.x - 1), 0).r);
  ivec2 size = max(picture >> level, ivec2(1));
  vec2 u = slopes.x * place.x + place.y - across.place * place.w;
  vec2 v = -slopes.y * place.x + place.z + up.place * place.w;
  for (int k = 0; k < 4; k++) {
    vec2 at = vec2((k & 1) == 1 ? u.y : u.x, k > 1 ? v.y : v.x);
    int camera = (k > 1 ? up.number.y : up.number.x) * inRow + ((k & 1) == 1 ? across.number.y : across.number.x);
    if (isInside(at, size) && texelFetch(indices, ivec3(ivec2(at), camera), level).r > 0u) return true;
  }
  return false;
}

void main() {
  vec2 pixel = inFrame();
  vec3 direction = start + right1 * pixel.x + down1 * pixel.y;
  vec3 color = vec3(0.0);
  float open = 1.0;
  bool hidden = false;
  if (direction.z > LEAST_FORWARD) {
    vec2 slopes = direction.xy / direction.z;
    vec2 crossing = eye.xy - slopes * eye.z;
    Sides across = sidesOf(0, crossing.x, 0), up = sidesOf(1, crossing.y, 0);
    look(slopes, across, up, false, color, open);
    if (open >= 1.0) {
      hidden = isHidden(slopes, across, up);
      if (hidden) look(slopes, across, up, true, color, open);
      for (int i = 0; i < stepCount && hidden && open >= LEAST_OPEN; i++) {
        across = sidesOf(0, crossing.x, int(steps[i].x));
        up = sidesOf(1, crossing.y, int(steps[i].y));
        if (!across.away && !up.away) look(slopes, across, up, false, color, open);
      }
    }
  }
  vec3 seen = open < 1.0 ? srgb(min(color / (1.0 - open), 1.0)) : hole;
  if (open >= 1.0 && !hidden) {
    vec4 far = surroundings(directionAt(pixel));
    if (far.a > 0.0) seen = far.rgb;
  }
  result = vec4(seen * shade, 1.0);
}`;
