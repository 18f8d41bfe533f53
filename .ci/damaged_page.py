#!/usr/bin/env python3
"""Cuts and changes a page at many places, opens each in headless Chromium, and requires that it says so.

    damaged_page.py PAGE.html

A page must show the word "damaged" and must not say that it is loading. Cuts before the first script ends, about 4 kB into the file,
are not tried: such a page is empty.
"""
import importlib.util
import os
import sys
import tempfile
import time

WAIT_S = 30
# The viewer may still be loading when the page is said to be damaged; it must not say otherwise afterwards.
SETTLE_S = 2
SHOWN = "document.body ? document.body.innerText : ''"


def variants(page):
    """Yields the name and the bytes of damaged pages."""
    first = page.index(b"</script>") + len(b"</script>")
    parts = page.index(b'id="part-0"')
    for name, at in {
        "after the watchdog": first,
        "in the style": page.index(b"<style>") + 200,
        "in the poster": page.index(b"base64,") + 100,
        "in the toolbar": page.index(b'id="bar"') + 60,
        "before the header": page.index(b'id="header"'),
        "in the header": page.index(b'id="header"') + 300,
        "in the viewer": page.index(b'type="module"') + 20000,
        "before the data": parts,
        "early in the data": parts + 20,
        "in the middle of the data": (parts + len(page)) // 2,
        "late in the data": page.rindex(b"</script>") - 10,
        "before the end": page.rindex(b'<p id="end"'),
    }.items():
        yield f"cut {name}, at {at}", page[:at]
    for name, at in {
        "the policy": page.index(b"script-src 'sha256-") + 30,
        "the watchdog": page.index(b"STALL_MS"),
        "the header": page.index(b'"parts":[{"') + 20,
        "the viewer": page.index(b"class Controls") + 8,
        "the first part": page.index(b">", parts) + 40,
        "the middle of the data": (parts + len(page)) // 2,
        "the tag of the last part": page.rindex(b"id=\"part-") + 5,
    }.items():
        changed = bytearray(page)
        changed[at] = ord("b") if changed[at] == ord("a") else ord("a")
        yield f"changed in {name}, at {at}", bytes(changed)


def main():
    here = os.path.dirname(os.path.abspath(__file__))
    spec = importlib.util.spec_from_file_location("page", os.path.join(here, "page.py"))
    page = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(page)
    with open(sys.argv[1], "rb") as file:
        whole = file.read()
    silent = 0
    chromium = page.Chromium()
    try:
        with tempfile.TemporaryDirectory() as folder:
            path = os.path.join(folder, "page.html")
            for name, content in variants(whole):
                with open(path, "wb") as file:
                    file.write(content)
                chromium.call("Page.navigate", url=f"file://{path}")
                started, text = time.time(), ""
                while time.time() - started < WAIT_S and ("damaged" not in text or "Loading" in text):
                    time.sleep(0.2)
                    text = chromium.evaluate(SHOWN) or ""
                time.sleep(SETTLE_S)
                text = chromium.evaluate(SHOWN) or ""
                said = [line for line in text.splitlines() if "damaged" in line]
                silent += not said or "Loading" in text
                print(f"{name}: {said[0] if said else f'NOTHING IS SAID: {text!r}'}", flush=True)
                chromium.call("Page.navigate", url="about:blank")
    finally:
        chromium.close()
    sys.exit(f"{silent} damaged pages do not say so" if silent else 0)


if __name__ == "__main__":
    main()
