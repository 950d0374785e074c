"""Chromium by its pipe of commands: real pointers on a page, and what the page says."""

import json
import os
import select
import shutil
import subprocess
import sys
import time

import pytest

#: Seconds for an answer, beside other work.
PATIENCE = 60
#: Puts two pipes where Chromium reads commands and answers, and becomes Chromium.
_PLACED = """
import os, sys
import fcntl
take, give = (fcntl.fcntl(int(number), fcntl.F_DUPFD, 10) for number in sys.argv[1:3])
os.dup2(take, 3)
os.dup2(give, 4)
os.execv(sys.argv[3], sys.argv[3:])
"""


class Browser:
    """A page in Chromium without a window."""

    def __init__(self, folder):
        found = shutil.which("chromium") or shutil.which("chromium-browser")
        if found is None:
            pytest.skip("no Chromium here: apt-get install chromium")
        (take, self._write), (self._read, give) = os.pipe(), os.pipe()
        arguments = [
            "--headless", "--no-sandbox", "--disable-gpu", "--no-first-run",
            "--disable-background-networking", "--disable-component-update", "--disable-sync",
            "--remote-debugging-pipe", f"--user-data-dir={folder / 'profile'}",
            "--window-size=1200,1000", "about:blank",
        ]  # fmt: skip
        command = [sys.executable, "-c", _PLACED, str(take), str(give), found, *arguments]
        self._process = subprocess.Popen(command, pass_fds=(take, give), stderr=subprocess.DEVNULL)
        os.close(take)
        os.close(give)
        self._rest, self._count, self.said, self._session = b"", 0, [], None
        page = next(t for t in self._ask("Target.getTargets")["targetInfos"] if t["type"] == "page")
        held = self._ask("Target.attachToTarget", targetId=page["targetId"], flatten=True)
        self._session = held["sessionId"]
        self._ask("Runtime.enable")

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self._process.kill()
        self._process.wait()
        os.close(self._read)
        os.close(self._write)

    def _ask(self, method, **values):
        self._count += 1
        asked = {"id": self._count, "method": method, "params": values}
        if self._session:
            asked["sessionId"] = self._session
        os.write(self._write, json.dumps(asked).encode() + b"\0")
        while True:
            while b"\0" not in self._rest:
                assert select.select([self._read], [], [], PATIENCE)[0], f"no answer to {method}"
                part = os.read(self._read, 1 << 16)
                assert part, "Chromium has ended"
                self._rest += part
            text, _, self._rest = self._rest.partition(b"\0")
            told = json.loads(text)
            if told.get("method") in ("Runtime.exceptionThrown", "Runtime.consoleAPICalled"):
                self.said.append(told["params"])
            if told.get("id") == self._count:
                assert "error" not in told, told
                return told["result"]

    def open(self, page):
        """Open a file, and wait until it is there."""
        self._ask("Page.enable")
        self._ask("Page.navigate", url=page.as_uri())
        self.until("document.readyState === 'complete'")

    def value(self, expression):
        """Return what an expression is on the page."""
        found = self._ask("Runtime.evaluate", expression=expression, returnByValue=True)
        assert "exceptionDetails" not in found, found
        return found["result"].get("value")

    def until(self, expression, seconds=PATIENCE):
        """Ask until an expression is true on the page."""
        end = time.monotonic() + seconds
        while not self.value(expression):
            assert time.monotonic() < end, f"it never became true: {expression}; {self.said}"

    def pointer(self, kind, x, y, **more):
        """Move, press or release the pointer, as a hand would."""
        self._ask("Input.dispatchMouseEvent", type=kind, x=x, y=y, **more)

    def picture(self, path):
        """Write what is seen as a PNG."""
        import base64

        path.write_bytes(base64.b64decode(self._ask("Page.captureScreenshot")["data"]))
