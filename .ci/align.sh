#!/bin/sh
# Estimates the poses of eight rendered pictures with pycolmap and compares them with the known ones.
#
#     .ci/align.sh [OUT]
#
# OUT (default: target/align) receives the pictures. Skipped with a line where pip cannot fetch pycolmap.
set -eu
cd "$(dirname "$0")/.."
out=${1:-target/align}
rm -rf "$out"
mkdir -p "$out/pictures"
if ! python3 -m venv "$out/python" >/dev/null 2>&1 ||
    ! timeout 180 "$out/python/bin/pip" install --quiet pycolmap==4.2.1 numpy >/dev/null 2>&1; then
    echo "align: skipped, pip could not fetch pycolmap"
    exit 0
fi
PATH="$(cd "$out/python/bin" && pwd):$PATH"
headbox=target/release/headbox

"$headbox" truth builtin:interior -o "$out/known" --images 4x2 --size 640x480 --unlit --samples 16 >"$out/known.txt" 2>&1
cp "$out"/known/images/*.png "$out/pictures"
"$headbox" images "$out/pictures" --align >/dev/null 2>"$out/align.txt"
python3 - "$out" <<'PY'
import itertools, json, statistics, sys
import pycolmap

out = sys.argv[1]
frames = json.load(open(out + "/known/transforms.json"))["frames"]
known = {f["file_path"].split("/")[-1]: [row[3] for row in f["transform_matrix"][:3]] for f in frames}
model = pycolmap.Reconstruction(out + "/pictures/sparse/0")
found = {image.name: list(image.projection_center()) for image in model.images.values()}
assert len(found) >= 6 and set(found) <= set(known), sorted(found)


def distance(places, pair):
    return sum((a - b) ** 2 for a, b in zip(*(places[name] for name in pair))) ** 0.5


pairs = list(itertools.combinations(sorted(found), 2))
scale = statistics.median(distance(known, pair) / distance(found, pair) for pair in pairs)
worst = max(abs(scale * distance(found, pair) - distance(known, pair)) for pair in pairs)
share = worst / max(distance(known, pair) for pair in pairs)
print(f"align: poses of {len(found)} of {len(known)} pictures, distances between eyes within {share:.1%} of the largest")
# The focal length is estimated, too, from pictures that are at most a metre apart.
assert share < 0.1
PY
