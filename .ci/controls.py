#!/usr/bin/env python3
"""Looks around in the page of a cube LDI as people do, in headless Chromium: mouse, wheel, fingers, keys, a link, a phone's sensors.

    controls.py URL [PICTURE.png]

PICTURE.png receives the page as it is first seen.
"""
import math
import sys
import time

from page import IS_SHOWN, WAIT_S, Chromium

HINT = "((hint) => (hint?.checkVisibility() ? hint.innerText : ''))(document.getElementById('hint'))"
VIEW = "[headbox.view.eye, headbox.view.forward, headbox.view.fov]"


def heading(forward):
    return math.degrees(math.atan2(forward[0], -forward[2]))


def main():
    page = Chromium()
    try:
        page.call("Emulation.setDeviceMetricsOverride", width=640, height=480, deviceScaleFactor=1, mobile=False)
        load(page)
        press_keys(page)
        page.call("Emulation.setDeviceMetricsOverride", width=360, height=640, deviceScaleFactor=1, mobile=True)
        page.call("Emulation.setTouchEmulationEnabled", enabled=True, maxTouchPoints=2)
        load(page)
        assert "two fingers" in page.evaluate(HINT), "fingers have a hint of their own"
        look_around(page)
    finally:
        page.close()


def load(page):
    page.call("Page.navigate", url="about:blank")
    page.call("Page.navigate", url=sys.argv[1])
    started = time.time()
    while not page.evaluate(IS_SHOWN):
        assert time.time() - started < WAIT_S, "the page does not load"
        time.sleep(0.2)
    if len(sys.argv) > 2:
        page.shoot(sys.argv[2])


def press_keys(page):
    """Keys work before any click, and after clicks on buttons, which keep the focus."""
    hint, keys_shown = page.evaluate(HINT), "!document.getElementById('keys').hidden"
    assert "WASD" in hint and "two fingers" not in hint, f"a hint at first: {hint}"

    def press(code, key, moves=True):
        before = page.evaluate(VIEW)
        page.call("Input.dispatchKeyEvent", type="keyDown", code=code, key=key)
        started = time.time()
        while moves and page.evaluate(VIEW) == before and time.time() - started < 20:
            time.sleep(0.1)  # Frames take long without a GPU.
        page.call("Input.dispatchKeyEvent", type="keyUp", code=code, key=key)
        return before != page.evaluate(VIEW)

    assert press("KeyS", "s"), "keys work without a click"
    assert page.evaluate(HINT) == "", "the hint goes with the first input"
    for button in "link", "help":
        box = f"(({{x, y, width, height}}) => [x + width / 2, y + height / 2])(document.getElementById('{button}').getBoundingClientRect())"
        x, y = page.evaluate(box)
        for kind in "mousePressed", "mouseReleased":
            page.call("Input.dispatchMouseEvent", type=kind, x=x, y=y, button="left", buttons=1, clickCount=1)
        assert page.evaluate("document.activeElement.id") == button
        assert press("ArrowLeft", "ArrowLeft") and press("KeyW", "w"), f"keys work after a click on {button}"
    assert page.evaluate(keys_shown), "the button shows the keys"
    press("Slash", "?", moves=False)
    assert not page.evaluate(keys_shown), "? hides and shows the keys"


def look_around(page):
    view = lambda: page.evaluate(VIEW)
    start = view()
    for kind, x in ("mousePressed", 180), ("mouseMoved", 220), ("mouseReleased", 220):
        page.call("Input.dispatchMouseEvent", type=kind, x=x, y=300, button="left", buttons=1, clickCount=1)
    # 640 pixels are 60 degrees.
    assert abs(heading(view()[1]) - heading(start[1]) + 40 * 60 / 640) < 0.1, "a drag to the right turns to the left"
    page.call("Input.dispatchMouseEvent", type="mouseWheel", x=180, y=300, deltaX=0, deltaY=-200)
    time.sleep(0.5)
    assert view()[2] < 55, "the wheel zooms in"
    fov = view()[2]
    fingers = lambda left, right: [{"x": left, "y": 300, "id": 1}, {"x": right, "y": 300, "id": 2}]
    page.call("Input.dispatchTouchEvent", type="touchStart", touchPoints=fingers(150, 210))
    page.call("Input.dispatchTouchEvent", type="touchMove", touchPoints=fingers(120, 240))
    page.call("Input.dispatchTouchEvent", type="touchEnd", touchPoints=[])
    assert abs(view()[2] - fov / 2) < 0.1, "fingers twice as far apart see half as much"
    half, steps = page.evaluate("headbox.header.halfSize"), [0.0]
    page.call("Input.dispatchKeyEvent", type="keyDown", code="KeyW", key="w")
    while steps[-1] < half * 0.999 and len(steps) < 60:
        time.sleep(0.5)
        steps.append(max(map(abs, view()[0])))
    page.call("Input.dispatchKeyEvent", type="keyUp", code="KeyW", key="w")
    assert half * 0.999 <= steps[-1] <= half, f"W goes to the border of the headbox, and no farther: {steps}"
    link, there = page.evaluate("headbox.view.link()"), view()
    page.call("Input.dispatchKeyEvent", type="keyDown", code="Home", key="Home")
    assert view() == start, "Home goes back"
    page.evaluate(f"headbox.view.restore('{link}')")
    apart = [abs(a - b) for was, now in zip(there[:2], view()[:2]) for a, b in zip(was, now)]
    assert max(apart) < 1e-6, "a link restores the view"
    assert page.evaluate("document.getElementById('gyroscope').hidden") is False, "phones are offered their sensors"
    page.evaluate("headbox.controls.toggleGyroscope()")
    before, held = heading(view()[1]), []
    for alpha, beta in (0, 90), (30, 90), (30, 110):
        page.call("DeviceOrientation.setDeviceOrientationOverride", alpha=alpha, beta=beta, gamma=0)
        time.sleep(0.5)
        held.append(view()[1])
    assert abs(heading(held[0]) - before) < 0.5 and abs(heading(held[1]) - before + 30) < 0.5, "a phone turned to the left looks there"
    assert abs(math.degrees(math.asin(held[2][1])) - 20) < 0.5, "a phone tilted back looks up"
    print("page: mouse, wheel, fingers, keys, link and sensors do what they say")


main()
