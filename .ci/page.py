#!/usr/bin/env python3
"""Opens pages in headless Chromium and takes their pictures.

    page.py WIDTHxHEIGHT [--before SCRIPT.js] [--click ID] [--then EXPRESSION] [--eyes] URL PICTURE.png [URL PICTURE.png ...]

A page is done when its title is `ready`, or when its body has the class `failed`; what it says then is printed, a line a page.
`--before` runs a script before the page's own, `--click` clicks on an element (and does not wait for the title), `--then` evaluates
something before the picture is taken, and `--eyes` takes the halves besides, as PICTURE.left.png and PICTURE.right.png. Talks to Chromium through its debugging pipe, for which Python's standard library suffices.
"""
import argparse
import base64
import json
import os
import shutil
import subprocess
import sys
import tempfile
import time

WAIT_S = 60
FLAGS = ["--headless=new", "--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--ignore-gpu-blocklist",
         "--hide-scrollbars", "--remote-debugging-pipe"]


class Chromium:
    def __init__(self):
        self.profile = tempfile.mkdtemp()
        command_read, self.commands = os.pipe()
        self.answers, answer_write = os.pipe()

        def connect():  # Chromium reads from descriptor 3 and writes to 4.
            spare = [os.dup(command_read), os.dup(answer_write)]
            for descriptor, end in zip(spare, (3, 4)):
                os.dup2(descriptor, end, inheritable=True)

        program = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
        self.process = subprocess.Popen([program, *FLAGS, f"--user-data-dir={self.profile}", "about:blank"],
                                        preexec_fn=connect, close_fds=False, stderr=subprocess.DEVNULL)
        os.close(command_read)
        os.close(answer_write)
        self.buffer, self.count, self.session = b"", 0, None
        target = self.call("Target.createTarget", url="about:blank")["targetId"]
        self.session = self.call("Target.attachToTarget", targetId=target, flatten=True)["sessionId"]
        self.call("Runtime.enable")
        self.call("Page.enable")

    def call(self, method, **parameters):
        self.count += 1
        message = {"id": self.count, "method": method, "params": parameters}
        if self.session:
            message["sessionId"] = self.session
        os.write(self.commands, json.dumps(message).encode() + b"\0")
        while True:
            while b"\0" not in self.buffer:
                piece = os.read(self.answers, 1 << 20)
                if not piece:
                    sys.exit("Chromium has gone")
                self.buffer += piece
            line, self.buffer = self.buffer.split(b"\0", 1)
            answer = json.loads(line)
            if answer.get("method") == "Runtime.exceptionThrown":
                sys.exit(f"the page failed: {json.dumps(answer['params']['exceptionDetails'])[:1000]}")
            if answer.get("id") == self.count:
                if "error" in answer:
                    sys.exit(f"{method}: {answer['error']}")
                return answer["result"]

    def evaluate(self, expression, **more):
        return self.call("Runtime.evaluate", expression=expression, returnByValue=True, **more)["result"].get("value")

    def shoot(self, picture, **more):
        data = self.call("Page.captureScreenshot", format="png", **more)["data"]
        with open(picture, "wb") as file:
            file.write(base64.b64decode(data))

    def close(self):
        self.process.terminate()
        self.process.wait()
        shutil.rmtree(self.profile, ignore_errors=True)


# The last part is loaded before the first frame of a small page is drawn.
IS_SHOWN = "document.getElementById('status')?.textContent.includes('is loaded') && document.body.classList.contains('drawn')"
STATE = "[document.title, document.body?.className, document.getElementById('status')?.textContent, {...document.body?.dataset}]"


def main():
    arguments = argparse.ArgumentParser()
    arguments.add_argument("size")
    arguments.add_argument("--before")
    arguments.add_argument("--click")
    arguments.add_argument("--then")
    arguments.add_argument("--eyes", action="store_true")
    arguments.add_argument("jobs", nargs="+")
    arguments = arguments.parse_args()
    width, height = map(int, arguments.size.split("x"))
    chromium = Chromium()
    try:
        chromium.call("Emulation.setDeviceMetricsOverride", width=width, height=height, deviceScaleFactor=1, mobile=False)
        if arguments.before:
            with open(arguments.before, encoding="utf-8") as script:
                chromium.call("Page.addScriptToEvaluateOnNewDocument", source=script.read())
        for url, picture in zip(arguments.jobs[::2], arguments.jobs[1::2]):
            chromium.call("Page.navigate", url=url)
            started, clicked, state = time.time(), False, None
            while time.time() - started < WAIT_S:
                time.sleep(0.1)
                state = chromium.evaluate(STATE) or ["", "", "", {}]
                if state[0] == "ready" or "failed" in (state[1] or ""):
                    break
                if arguments.click and not clicked and chromium.evaluate(IS_SHOWN):
                    clicked = True
                    chromium.evaluate(f"document.getElementById('{arguments.click}').click()", userGesture=True)
                if clicked and state[3].get("headsetEyes"):
                    time.sleep(1)
                    break
            if arguments.then:
                chromium.evaluate(arguments.then)
                time.sleep(0.5)
            chromium.shoot(picture)
            for half, x in (("left", 0), ("right", width // 2)) if arguments.eyes else ():
                clip = {"x": x, "y": 0, "width": width // 2, "height": height, "scale": 1}
                chromium.shoot(f"{picture.removesuffix('.png')}.{half}.png", clip=clip)
            print(json.dumps({"seconds": round(time.time() - started, 2), "title": state[0], "status": state[2], **state[3]}))
            chromium.call("Page.navigate", url="about:blank")
    finally:
        chromium.close()


if __name__ == "__main__":
    main()
