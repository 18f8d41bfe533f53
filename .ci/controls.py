#!/usr/bin/env python3
"""Looks around in the page of a cube LDI as people do, in headless Chromium: mouse, wheel, fingers, keys, a link, a phone's sensors.

    controls.py URL
"""
import math
import sys
import time

from page import STATE, WAIT_S, Chromium

VIEW = "[headbox.view.eye, headbox.view.forward, headbox.view.fov]"


def heading(forward):
    return math.degrees(math.atan2(forward[0], -forward[2]))


def main():
    page = Chromium()
    try:
        page.call("Emulation.setDeviceMetricsOverride", width=360, height=640, deviceScaleFactor=1, mobile=True)
        page.call("Emulation.setTouchEmulationEnabled", enabled=True, maxTouchPoints=2)
        page.call("Page.navigate", url=sys.argv[1])
        started = time.time()
        while "is loaded" not in str((page.evaluate(STATE) or ["", "", ""])[2]):
            assert time.time() - started < WAIT_S, "the page does not load"
            time.sleep(0.2)
        look_around(page)
    finally:
        page.close()


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
    page.evaluate("document.getElementById('canvas').focus()")
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
