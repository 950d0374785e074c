"""What a tick takes on a page in Chromium, under a pointer that presses and slides; prints it.

Usage: .venv/bin/python tests/benchmarks/page.py FILE... (`.pandis` files of `make all`, say)
A browser's clock is coarse (0.1 ms): the mean is of all ticks, the percentiles are of batches.
"""

import re
import sys
import tempfile
from pathlib import Path

from common import ROOT

sys.path.insert(0, str(ROOT / "tests/helpers"))

from browser import Browser
from pandis.bridges.web import write_page

TOUCH, ROUNDS, WAY = "document.querySelector('section.touch')", 10, 150


def driven(file, folder):
    """Press and slide to and fro; return the page's figures."""
    page = folder / "touch.html"
    write_page(page, [file], 0.1, stiffness=400.0)
    with Browser(folder) as browser:
        browser.open(page)
        browser.until(f"{TOUCH}.dataset.ticks > 500")
        box = browser.value(
            "JSON.stringify(document.querySelector('canvas').getBoundingClientRect())"
        )
        left, top, width = (float(value) for value in re.findall(r":(-?[\d.]+)", box)[:3])
        scale = width / browser.value("document.querySelector('canvas').width")
        x, y = left + 480 * scale, top + 340 * scale
        browser.pointer("mouseMoved", x, y)
        browser.pointer("mousePressed", x, y, button="left", buttons=1, clickCount=1)
        touching = 0
        for step in range(ROUNDS * 2 * WAY):
            along = step % (2 * WAY)
            at = x + (along if along < WAY else 2 * WAY - along)
            browser.pointer("mouseMoved", at, y, button="left", buttons=1)
            touching += browser.value(f"{TOUCH}.dataset.state & 1")
        told = browser.value(f"({{...{TOUCH}.dataset}})")
        return {key: float(told[key]) for key in ("ticks", "mean", "slow", "slowest")} | {
            "touching": touching / (ROUNDS * 2 * WAY)
        }


if __name__ == "__main__":
    for name in sys.argv[1:]:
        with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as made:
            print(Path(name).stem, driven(Path(name), Path(made)))
