#!/bin/sh
# Opens exports in programs that we did not write: GLB in the Khronos validator and three.js, splats in splat-transform and PlayCanvas.
#
#     .ci/outside.sh [OUT]
#
# OUT (default: target/outside) receives the pictures. Skipped with a line where there is no Chromium, or npm cannot fetch the programs.
set -eu
cd "$(dirname "$0")/.."
out=${1:-target/outside}
mkdir -p "$out"
out=$(cd "$out" && pwd)
for program in chromium python3 node npm; do
    if ! command -v $program >/dev/null; then
        echo "outside: skipped, there is no $program"
        exit 0
    fi
done
if ! timeout 90 npm install --silent --no-save --prefix "$out/npm" three@0.187 gltf-validator@2.0.0-dev.3.10 playcanvas@2.23 \
    @playcanvas/splat-transform@2.7 >/dev/null 2>&1; then
    echo "outside: skipped, npm could not fetch the programs"
    exit 0
fi
headbox=target/release/headbox
# The most that FLIP may say of three.js against the CPU.
most=0.08

"$headbox" capture builtin:interior -o "$out/room.ldi" --face-size 192 --strata 16 --rays 4 --light-samples 2 >"$out/room.txt"
for ending in glb ply; do "$headbox" export "$out/room.ldi" -o "$out/room.$ending"; done
"$headbox" export "$out/room.ldi" -o "$out/splats.glb" --gaussians

node .ci/outside/validate.mjs "$out/npm" "$out/room.glb"
node .ci/outside/validate.mjs "$out/npm" "$out/splats.glb"
echo "outside: the Khronos validator finds no error and nothing to warn of in room.glb and splats.glb"

splats() { head -c 500 "$1" | sed -n 's/^element vertex //p'; }
node "$out/npm/node_modules/@playcanvas/splat-transform/bin/cli.mjs" -w "$out/room.ply" "$out/rewritten.ply" >/dev/null 2>&1
[ "$(splats "$out/rewritten.ply")" = "$(splats "$out/room.ply")" ]
echo "outside: splat-transform reads $(splats "$out/room.ply") splats from room.ply"

cp .ci/outside/*.html "$out"
rm -f "$out/port"
python3 - "$out" >"$out/port" 2>/dev/null <<'PY' &
import functools, http.server, sys
handler = functools.partial(http.server.SimpleHTTPRequestHandler, directory=sys.argv[1])
server = http.server.ThreadingHTTPServer(("127.0.0.1", 0), handler)
print(server.server_port, flush=True)
server.serve_forever()
PY
server=$!
trap 'kill $server' EXIT
while [ ! -s "$out/port" ]; do sleep 0.1; done
at="http://127.0.0.1:$(cat "$out/port")"

# look NAME EYE LOOK_AT: the CPU's frame, three.js and PlayCanvas from an eye.
look() {
    "$headbox" render "$out/room.ldi" -o "$out/$1.cpu.png" --size 480x360 --fov 60 --eye "$2" --look-at "$3" >/dev/null
    .ci/page.py 480x360 "$at/three.html#file=room.glb&eye=$2&look-at=$3" "$out/$1.three.png" \
        "$at/playcanvas.html#file=room.ply&centre=0.2,1.45,0.9&eye=$2&look-at=$3" "$out/$1.playcanvas.png" >"$out/$1.txt"
    for viewer in three playcanvas; do
        "$headbox" compare "$out/$1.cpu.png" "$out/$1.$viewer.png" --json >"$out/$1.$viewer.json"
    done
    python3 - "$out/$1" "$1" $most <<'PY'
import json, sys
flip = {viewer: json.load(open(f"{sys.argv[1]}.{viewer}.json"))["flip"] for viewer in ("three", "playcanvas")}
print(f"outside: from eye {sys.argv[2]} FLIP {flip['three']:.4f} in three.js, {flip['playcanvas']:.4f} in PlayCanvas")
# Gaussians are soft: they are reported, and shall be the same picture.
sys.exit(flip["three"] > float(sys.argv[3]) or flip["playcanvas"] > 0.3)
PY
}

look one 0.2,1.45,0.9 0.2,1.45,-1.0
look two 0.4,1.55,0.7 1.0,1.30,-1.0
echo "outside: all is well; pictures are in $out"
