#!/bin/sh
# Exports a capture as a page, opens it in headless Chromium with software GL, and holds what it shows to frames of the CPU.
#
#     .ci/page.sh [OUT]
#
# OUT (default: target/page) receives the pictures. Skipped with a line where there is no Chromium and none can be installed.
set -eu
cd "$(dirname "$0")/.."
out=${1:-target/page}
mkdir -p "$out"

if ! command -v chromium >/dev/null && command -v apt-get >/dev/null && [ "$(id -u)" = 0 ]; then
    DEBIAN_FRONTEND=noninteractive timeout 900 apt-get install -y -qq chromium >/dev/null 2>&1 || true
fi
if ! command -v chromium >/dev/null || ! command -v python3 >/dev/null; then
    echo "page: skipped, Chromium or Python could not be installed"
    exit 0
fi

headbox=target/release/headbox
here=$(cd "$out" && pwd)
# The most that FLIP may say of the page against the CPU.
most=0.05

# near A.png B.png MOST WORDS: what FLIP says of two pictures, and whether it is at most MOST.
near() {
    "$headbox" compare "$1" "$2" --json >"$2.json"
    python3 -c "import json, sys; flip = json.load(open('$2.json'))['flip']
print(f'page: $4: FLIP {flip:.4f}'); sys.exit(flip > $3)"
}

# hold FILE EYE LOOK_AT: the page against the CPU, seen from an eye.
hold() {
    "$headbox" render "$out/$1" -o "$out/$1.cpu.png" --size 320x240 --fov 60 --eye "$2" --look-at "$3" >/dev/null
    .ci/page.py 320x240 "file://$here/$1.html#eye=$2&look-at=$3&fov=60&ui=0" "$out/$1.page.png"
    near "$out/$1.cpu.png" "$out/$1.page.png" $most "$1 from $2"
}

capture="--face-size 96 --strata 10 --rays 4 --light-samples 2"
# shellcheck disable=SC2086 # a list of words
"$headbox" capture builtin:interior -o "$out/samples.ldi" $capture --error-px 0 >"$out/samples.txt"
# shellcheck disable=SC2086
"$headbox" capture builtin:interior -o "$out/planes.ldi" $capture >"$out/planes.txt"
for name in samples planes; do
    "$headbox" export "$out/$name.ldi" -o "$out/$name.ldi.html"
    hold "$name.ldi" 0.2,1.45,0.9 0.2,1.45,-1.0
    hold "$name.ldi" 0.4,1.55,0.7 1.0,1.30,-1.0
done
# Baked light, textures, doors, windows and the sky behind them.
"$headbox" house builtin:house --triangles 12000 --rays 0 --edge 1 --light-samples 2 --backdrops none -o "$out/home.house" >"$out/home.txt"
"$headbox" export "$out/home.house" -o "$out/home.house.html"
hold home.house -11.37,1.55,-4.25 -11.63,1.5,-3.29
hold home.house -2.24,1.55,-4.74 -1.45,1.38,-4.15
hold home.house 7.63,1.55,3.62 6.7,1.41,3.96
# What hides other things, cameras to all sides, and an eye beside them, behind them and before them.
"$headbox" lumigraph builtin:statue -o "$out/statue.lumi" --size 200x150 --samples 1 --unlit >"$out/statue.txt"
"$headbox" export "$out/statue.lumi" -o "$out/statue.lumi.html"
hold statue.lumi 0,0,0 0,0,-1
hold statue.lumi 1.2,0.9,0.2 0,0,-3.5
hold statue.lumi -0.5,-0.6,-0.6 0,0,-3.5
# Sprites: layers that overlap, and what is cut at gaps of depth, which is rough.
"$headbox" sprite builtin:sprites -o "$out/layers.sprite" --size 256x192 --samples 2 >"$out/layers.txt"
"$headbox" sprite builtin:interior -o "$out/cut.sprite" --size 256x192 --samples 2 >"$out/cut.txt"
for name in layers cut; do "$headbox" export "$out/$name.sprite" -o "$out/$name.sprite.html"; done
hold layers.sprite 0,0,0 0,0,-5
hold layers.sprite 0.25,0.2,-0.2 0.3,0,-5
hold layers.sprite -0.25,-0.25,0.25 0,0,-5
hold cut.sprite 0.1,1.5,0.8 0.9,1.4,-0.2
hold cut.sprite 0.3,1.4,1.0 1.0,1.4,0.2
# What a cube shows first, while the rest comes: a coarse picture of the same.
shell="headbox.renderer.missing = 1; headbox.renderer.segments = []; headbox.renderer.planes = null; headbox.draw(1)"
.ci/page.py 320x240 --then "$shell" "file://$here/planes.ldi.html#eye=0.4,1.55,0.7&look-at=1.0,1.30,-1.0&fov=60&ui=0" "$out/shell.png"
near "$out/planes.ldi.cpu.png" "$out/shell.png" 0.2 "planes.ldi by what comes first"
# What is shown while images come: those of the corner cameras alone, which leave some of what is hidden from them open.
.ci/page.py 320x240 --then "headbox.renderer.show(headbox.header.parts.find((part) => part.shows).shows); headbox.draw(1)" \
    "file://$here/statue.lumi.html#eye=-0.5,-0.6,-0.6&look-at=0,0,-3.5&fov=60&ui=0" "$out/corners.png"
near "$out/statue.lumi.cpu.png" "$out/corners.png" 0.08 "statue.lumi by its corner cameras"

echo "page: damaged data and an old browser are told, and the poster stays"
python3 - "$out" <<'PY'
import sys
out = sys.argv[1]
page = open(f"{out}/samples.ldi.html", encoding="utf-8", newline="").read()
at = page.index('id="part-1">') + 400
open(f"{out}/damaged.html", "w", encoding="utf-8", newline="").write(page[:at] + ("a" if page[at] != "a" else "b") * 20 + page[at + 20:])
open(f"{out}/old.js", "w").write("HTMLCanvasElement.prototype.getContext = () => null;")
PY
.ci/page.py 320x240 "file://$here/damaged.html" "$out/damaged.png" | tee "$out/damaged.txt"
grep -q 'This page is damaged' "$out/damaged.txt"
.ci/page.py 320x240 --before "$out/old.js" "file://$here/samples.ldi.html" "$out/old.png" | tee "$out/old.txt"
grep -q 'no WebGL 2' "$out/old.txt"
.ci/damaged_page.py "$out/samples.ldi.html"
.ci/controls.py "file://$here/samples.ldi.html"
.ci/controls.py "file://$here/layers.sprite.html"
# A headset, emulated by iwer, where npm can fetch it.
if command -v npm >/dev/null && timeout 120 npm install --silent --no-save --prefix "$out/npm" iwer@2 >/dev/null 2>&1; then
    emulator="$out/npm/node_modules/iwer/build/iwer.min.js"
    {
        cat "$emulator"
        echo
        echo 'const headset = new IWER.XRDevice(IWER.metaQuest3); headset.installRuntime({ forceInstall: true }); headset.stereoEnabled = true;'
    } >"$out/headset.js"
    # both FILE X Y Z: each eye, from X, Y, Z on, the middle of the headbox. The head goes 100 mm to the right and 50 mm up; eyes are 63 mm
    # apart and see 90 degrees each.
    both() {
        .ci/page.py 320x160 --before "$out/headset.js" --click headset --eyes --then "headset.position.x += 0.1; headset.position.y += 0.05" \
            "file://$here/$1.html#eye=$2,$3,$4&look-at=$2,$3,-1" "$out/headset.png" | tee "$out/headset.txt"
        grep -q '"headsetEyes": "2"' "$out/headset.txt"
        for eye in left:0.0685 right:0.1315; do
            at=$(python3 -c "print(f'{$2 + ${eye#*:}:.4f},{$3 + 0.05:.4f}')")
            "$headbox" render "$out/$1" -o "$out/eye.cpu.png" --size 160x160 --fov 90 --eye "$at,$4" --look-at "$at,-1" >/dev/null
            near "$out/eye.cpu.png" "$out/headset.${eye%:*}.png" $most "the ${eye%:*} eye of a headset, $1"
        done
    }
    both samples.ldi 0.2 1.45 0.9
    both layers.sprite 0 0 0
else
    echo "page: headset skipped, npm could not fetch its emulator"
fi
# Other engines, where they are installed: Gecko, and Safari's WebKit.
for browser in firefox webkit; do
    program=WebKitWebDriver
    [ $browser = webkit ] || program=firefox-esr
    if ! command -v $program >/dev/null || ! command -v xvfb-run >/dev/null; then
        echo "page: $browser skipped, $program or xvfb-run is not installed"
        continue
    fi
    set --
    for file in planes.ldi:0.4,1.55,0.7:1.0,1.30,-1.0 home.house:7.63,1.55,3.62:6.7,1.41,3.96 statue.lumi:-0.5,-0.6,-0.6:0,0,-3.5 \
        layers.sprite:0.25,0.2,-0.2:0.3,0,-5; do
        name=${file%%:*} at=${file##*:} eye=${file#*:}
        eye=${eye%:*}
        "$headbox" render "$out/$name" -o "$out/$name.wide.png" --size 512x240 --fov 60 --eye "$eye" --look-at "$at" >/dev/null
        set -- "$@" "file://$here/$name.html#eye=$eye&look-at=$at&fov=60&ui=0" "$out/$name.$browser.png"
    done
    LIBGL_ALWAYS_SOFTWARE=1 xvfb-run -a -s "-screen 0 1280x1024x24" .ci/browsers.py $browser 512x240 "$@" "file://$here/damaged.html" \
        "$out/damaged.$browser.png" | tee "$out/$browser.txt"
    grep -q 'This page is damaged' "$out/$browser.txt"
    for name in planes.ldi home.house statue.lumi layers.sprite; do
        near "$out/$name.wide.png" "$out/$name.$browser.png" $most "$name in $browser"
    done
done
echo "page: all is well; pictures are in $out"
