#!/bin/sh
# Opens the real window on a virtual display, plays a scripted path in it, lets it take its own picture, and checks that
# something is to be seen. Without a display, one sentence and exit 1.
#
#     .ci/window.sh [OUT]
#
# OUT (default: target/window) receives the pictures and what each run measured. Needs Xvfb and a software OpenGL driver
# (Debian: xvfb libgl1 libgl1-mesa-dri libxcursor1 libxi6 libxrender1 libxkbcommon-x11-0).
set -eu
cd "$(dirname "$0")/.."
out=${1:-target/window}
mkdir -p "$out"

cargo build --release -p headbox -p headbox-viewer --bin headbox --example checker_room --example not_blank
headbox=target/release/headbox
viewer=target/release/examples/checker_room
not_blank=target/release/examples/not_blank

# Xvfb chooses a free display number and writes it to descriptor 3.
: >"$out/display"
Xvfb -displayfd 3 -screen 0 1600x1000x24 3>"$out/display" 2>"$out/xvfb.log" &
xvfb=$!
trap 'kill $xvfb 2>/dev/null || true' EXIT
waited=0
until [ -s "$out/display" ]; do
    if [ "$waited" -ge 60 ] || ! kill -0 $xvfb 2>/dev/null; then
        cat "$out/xvfb.log" >&2
        echo "Xvfb did not start" >&2
        exit 1
    fi
    sleep 1
    waited=$((waited + 1))
done
DISPLAY=:$(cat "$out/display")
export DISPLAY
unset WAYLAND_DISPLAY
# A list of its own of what was opened last: a long one of somebody's pushes the pictures off the start page.
XDG_STATE_HOME=$(cd "$out" && pwd)/state
XDG_CACHE_HOME=$(cd "$out" && pwd)/cache
export XDG_STATE_HOME XDG_CACHE_HOME
rm -rf "$XDG_STATE_HOME" "$XDG_CACHE_HOME"

# Six poses that turn and step through the middle of the room.
cat >"$out/path.json" <<'JSON'
{"size": [1280, 720], "poses": [
  {"time_s": 0.0, "eye": [0.0, 0.0, 0.0], "look_at": [0.2, -0.15, -1.0], "up": [0, 1, 0], "fov": 60},
  {"time_s": 0.4, "eye": [0.1, 0.0, -0.1], "look_at": [0.9, -0.3, -1.0], "up": [0, 1, 0], "fov": 60},
  {"time_s": 0.8, "eye": [0.3, 0.1, -0.3], "look_at": [0.7, -0.5, -1.4], "up": [0, 1, 0], "fov": 70},
  {"time_s": 1.2, "eye": [0.3, 0.2, -0.4], "look_at": [0.6, -0.7, -1.8], "up": [0, 1, 0], "fov": 70},
  {"time_s": 1.6, "eye": [0.0, 0.2, -0.3], "look_at": [0.4, -0.5, -1.6], "up": [0, 1, 0], "fov": 70},
  {"time_s": 2.0, "eye": [-0.2, 0.1, -0.2], "look_at": [0.2, -0.3, -1.6], "up": [0, 1, 0], "fov": 65}
]}
JSON

# run NAME ARGUMENTS...: plays the path, and looks at the picture taken at its end.
run() {
    name=$1
    shift
    echo "window: $name"
    timeout 120 "$viewer" "$@" --path "$out/path.json" --exit-after-path --size 1280x720 --out "$out" \
        --screenshot "$out/$name.png" >"$out/$name.json"
    cat "$out/$name.json"
    "$not_blank" "$out/$name.png"
}

run room room --every-pose
run room_in_time room --set block=4
run compare room --every-pose --compare overlay=distance
run stereo ball --every-pose --stereo cross
run plan hall --every-pose --set overlay=face

# Every kind of file with the real program. The poses stay inside the headboxes of the built-in scenes.
"$headbox" capture builtin:interior -o "$out/interior.ldi" --face-size 256 --strata 12 --rays 8 --light-samples 2 >"$out/capture.txt"
cat >"$out/inside.json" <<'JSON'
[{"eye": [0.2, 1.45, 0.9], "look_at": [0.2, 1.45, -1.0], "fov": 60},
 {"eye": [0.3, 1.45, 0.8], "look_at": [0.6, 1.40, -1.0], "fov": 60},
 {"eye": [0.4, 1.55, 0.7], "look_at": [1.0, 1.30, -1.0], "fov": 70}]
JSON

# show NAME FILE ARGUMENTS...: opens FILE, plays a path or a few frames, and looks at the picture taken at the end.
show() {
    name=$1
    shift
    echo "window: headbox view $*"
    timeout 300 "$headbox" view "$@" --window-size "$size" --out "$out" --screenshot "$out/$name.png" --json >"$out/$name.json"
    tr -d ' \n' <"$out/$name.json"
    echo
    "$not_blank" "$out/$name.png"
}

size=960x600
show start_page
show ldi "$out/interior.ldi" --path "$out/inside.json" --every-pose
show ldi_stereo "$out/interior.ldi" --path "$out/inside.json" --every-pose --stereo cross --no-panels
show ldi_compare "$out/interior.ldi" --path "$out/inside.json" --every-pose --compare kernel=paper
size=480x300 # truth is traced to the end; the panels would cover three quarters of it
show ldi_error "$out/interior.ldi" --when-refined --set overlay=error --no-panels
size=960x600
for overlay in depth footprint overdraw clipping; do
    show "ldi_$overlay" "$out/interior.ldi" --frames 3 --set "overlay=$overlay" --path "$out/inside.json"
done
show scene builtin:sprites --frames 3
show layers "$out/interior.ldi" builtin:statue@at=0.5,0,-0.8@scale=0.4 --frames 3 --path "$out/inside.json"
if "$headbox" sprite --help >/dev/null 2>&1; then
    "$headbox" sprite builtin:sprites --size 320x240 -o "$out/layers.sprite" >"$out/sprite.txt"
    show sprite "$out/layers.sprite" --frames 3
fi

# Its backdrops are built while the window is open.
"$headbox" house builtin:house --triangles 12000 --rays 0 --unlit -o "$out/small.house" --backdrops none >"$out/house.txt"
show house "$out/small.house" --when-refined --set variant=texture
show house_builtin builtin:house --frames 3

echo "window: next to no room"
for size in 1x1 64x24 24x64; do
    timeout 60 "$headbox" view "$out/interior.ldi" --window-size "$size" --frames 3 --json --out "$out" >"$out/tiny_$size.json"
done

echo "window: a pose at infinity"
echo '[{"eye": [1e999, 0, 0], "look_at": [0, 0, -1], "fov": 60}]' >"$out/infinite.json"
if timeout 60 "$headbox" view "$out/interior.ldi" --path "$out/infinite.json" --exit-after-path 2>"$out/infinite.txt"; then
    echo "expected an error" >&2
    exit 1
fi
cat "$out/infinite.txt"

echo "window: a file that is none"
echo "not an LDI" >"$out/damaged.ldi"
if timeout 60 "$headbox" view "$out/damaged.ldi" 2>"$out/damaged.txt"; then
    echo "expected an error" >&2
    exit 1
fi
cat "$out/damaged.txt"

echo "window: a failing view"
if timeout 60 "$viewer" room --set fail=on --frames 3 2>"$out/fails.txt"; then
    echo "expected an error" >&2
    exit 1
fi
cat "$out/fails.txt"

echo "window: no display"
status=0
env -u DISPLAY timeout 60 "$headbox" view "$out/interior.ldi" >"$out/no_display.json" 2>"$out/no_display.txt" || status=$?
cat "$out/no_display.txt"
if [ "$status" -ne 1 ] || [ "$(wc -l <"$out/no_display.txt")" -ne 1 ] || ! grep -q 'no display' "$out/no_display.txt"; then
    echo "expected one sentence about the missing display and exit 1, got exit $status" >&2
    exit 1
fi
echo "window: a display without OpenGL"
: >"$out/bare_display"
Xvfb -displayfd 3 -screen 0 640x480x24 -extension GLX 3>"$out/bare_display" 2>"$out/xvfb_bare.log" &
bare=$!
trap 'kill $xvfb $bare 2>/dev/null || true' EXIT
while [ ! -s "$out/bare_display" ] && kill -0 $bare 2>/dev/null; do sleep 1; done
status=0
# EGL finds no driver either, and glutin must not fall back to one.
DISPLAY=:$(cat "$out/bare_display") __EGL_VENDOR_LIBRARY_FILENAMES=/nowhere.json timeout 60 \
    "$headbox" view "$out/interior.ldi" --frames 3 >"$out/no_opengl.json" 2>"$out/no_opengl.txt" || status=$?
cat "$out/no_opengl.txt"
if [ "$status" -ne 1 ] || ! grep -q 'no OpenGL.*headbox export' "$out/no_opengl.txt"; then
    echo "expected a sentence about the missing OpenGL and exit 1, got exit $status" >&2
    exit 1
fi
echo "window: all is well; pictures are in $out"
