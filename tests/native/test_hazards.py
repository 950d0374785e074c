"""The page of hazards: every test that it names exists, and everything that ends a run is on it."""

import re
from pathlib import Path

from pandis.runtime import device as hdapi

HERE = Path(__file__).parent
PAGE = (HERE.parents[1] / "docs" / "hazards.md").read_text()


def test_every_test_that_the_page_names_exists():
    named = set(re.findall(r"`(test_\w+)`", PAGE))
    assert len(named) > 25
    files = {path.stem for path in HERE.glob("test_*.py")}
    functions = set()
    for path in HERE.glob("test_*.py"):
        functions |= set(re.findall(r"^def (test_\w+)", path.read_text(), re.MULTILINE))
    assert named <= files | functions


def test_every_hazard_has_what_prevents_it_and_what_remains():
    rows = [row.split("|")[1:-1] for row in PAGE.splitlines() if re.match(r"\| \d+ \|", row)]
    assert [int(row[0]) for row in rows] == list(range(1, len(rows) + 1))
    for _, hazard, severity, design, safeguard, shown, left in rows:
        assert severity.strip() in ("light", "lasting"), hazard
        prevented = design.strip() != "–" or safeguard.strip() != "–"
        assert prevented == (shown.strip() != "–"), hazard  # what is said to help is shown to
        assert prevented or left.strip() != "–", hazard


def test_whatever_ends_a_run_is_on_the_page():
    words = {
        hdapi.ERROR: "reports an error", hdapi.SPEED: "speed beyond the limit",
        hdapi.NUMBER: "no number", hdapi.OVERRUN: "long calls", hdapi.WATCHDOG: "missing calls",
        hdapi.GAP: "Late calls", hdapi.INTERRUPTED: "Signals", hdapi.CALIBRATION: "calibration",
        hdapi.SWITCH: "switch is opened", hdapi.HOT: "is hot", hdapi.UNSTABLE: "gives energy",
        hdapi.BUSY: "One run at a time", hdapi.LIMITS: "limits themselves are checked",
        hdapi.ENCODER: "an encoder sticks or drifts",
        hdapi.LIBRARY: "OpenHaptics", hdapi.DEVICE: "Another device", hdapi.DONE: "",
    }  # fmt: skip
    assert set(words) == set(range(len(hdapi._NAMES)))
    assert [said for said in words.values() if said not in PAGE] == []
