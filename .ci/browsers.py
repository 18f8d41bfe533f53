#!/usr/bin/env python3
"""Opens pages in Firefox or WebKit, on a display, and takes their pictures.

    browsers.py firefox|webkit WIDTHxHEIGHT URL PICTURE.png [URL PICTURE.png ...]

A page is done when its title is `ready`, or when its body has the class `failed`; what it says then is printed, a line a page. Talks to
Firefox by Marionette and to WebKitGTK's MiniBrowser by WebKitWebDriver, for which Python's standard library suffices.
"""
import base64
import glob
import json
import os
import shutil
import socket
import subprocess
import sys
import tempfile
import time
import urllib.request

WAIT_S = 90
STATE = """return [document.title, document.body && document.body.className, (document.getElementById('status') || {}).textContent,
    Object.assign({}, document.body && document.body.dataset)]"""
QUIET = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}


def free_port():
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


class Firefox:
    def __init__(self):
        port = free_port()
        self.profile = tempfile.mkdtemp()
        with open(f"{self.profile}/user.js", "w", encoding="utf-8") as settings:
            settings.write(f'user_pref("marionette.port", {port});\nuser_pref("webgl.force-enabled", true);\n')
        program = shutil.which("firefox-esr") or shutil.which("firefox")
        self.process = subprocess.Popen([program, "--marionette", "--no-remote", "--profile", self.profile], **QUIET)
        self.socket, self.buffer, self.count = None, b"", 0
        while self.socket is None:
            try:
                self.socket = socket.create_connection(("127.0.0.1", port))
            except OSError:
                time.sleep(0.2)
        self.receive()
        self.call("WebDriver:NewSession")

    def receive(self):
        while b":" not in self.buffer:
            self.buffer += self.socket.recv(1 << 16)
        length, self.buffer = self.buffer.split(b":", 1)
        while len(self.buffer) < int(length):
            self.buffer += self.socket.recv(1 << 20)
        message, self.buffer = self.buffer[: int(length)], self.buffer[int(length):]
        return json.loads(message)

    def call(self, command, **parameters):
        self.count += 1
        message = json.dumps([0, self.count, command, parameters]).encode()
        self.socket.sendall(b"%d:%b" % (len(message), message))
        _, _, error, result = self.receive()
        if error:
            sys.exit(f"{command}: {error}")
        return result

    def size(self, width, height):
        self.call("WebDriver:SetWindowRect", width=width, height=height)

    def open(self, url):
        self.call("WebDriver:Navigate", url=url)

    def evaluate(self, script):
        return self.call("WebDriver:ExecuteScript", script=script, args=[])["value"]

    def shoot(self):
        return self.call("WebDriver:TakeScreenshot", full=False)["value"]

    def close(self):
        self.process.terminate()
        self.process.wait()
        shutil.rmtree(self.profile, ignore_errors=True)


class WebKit:
    def __init__(self):
        port = free_port()
        self.process = subprocess.Popen(["WebKitWebDriver", f"--port={port}"], **QUIET,
                                        env={**os.environ, "WEBKIT_DISABLE_SANDBOX_THIS_IS_DANGEROUS": "1"})
        time.sleep(1)
        self.session = f"http://127.0.0.1:{port}"
        browser = {"binary": sorted(glob.glob("/usr/lib/*/webkit2gtk-4.*/MiniBrowser"))[-1], "args": ["--automation"]}
        made = self.call("POST", "/session", capabilities={"alwaysMatch": {"webkitgtk:browserOptions": browser}})
        self.session += f"/session/{made['sessionId']}"

    def call(self, method, path, **parameters):
        data = json.dumps(parameters).encode() if method == "POST" else None
        request = urllib.request.Request(self.session + path, method=method, data=data, headers={"Content-Type": "application/json"})
        with urllib.request.urlopen(request, timeout=WAIT_S) as answer:
            return json.loads(answer.read())["value"]

    def size(self, width, height):
        self.call("POST", "/window/rect", width=width, height=height)

    def open(self, url):
        self.call("POST", "/url", url=url)

    def evaluate(self, script):
        return self.call("POST", "/execute/sync", script=script, args=[])

    def shoot(self):
        return self.call("GET", "/screenshot")

    def close(self):
        self.call("DELETE", "")
        self.process.terminate()


def main():
    name, size, *jobs = sys.argv[1:]
    wanted = [int(side) for side in size.split("x")]
    browser = {"firefox": Firefox, "webkit": WebKit}[name]()
    try:
        window = wanted
        for _ in range(3):  # What a window has around its page is found out.
            browser.size(*window)
            time.sleep(0.5)
            has = browser.evaluate("return [innerWidth, innerHeight]")
            window = [window[i] + wanted[i] - has[i] for i in range(2)]
        for url, picture in zip(jobs[::2], jobs[1::2]):
            browser.open("about:blank")
            browser.open(url)
            started, state = time.time(), None
            while time.time() - started < WAIT_S:
                time.sleep(0.2)
                state = browser.evaluate(STATE)
                if state[0] == "ready" or "failed" in (state[1] or ""):
                    break
            time.sleep(0.5)
            with open(picture, "wb") as file:
                file.write(base64.b64decode(browser.shoot()))
            print(json.dumps({"browser": name, "title": state[0], "status": state[2], **state[3]}))
    finally:
        browser.close()


main()
