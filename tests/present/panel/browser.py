"""A panel in a process of its own, and a browser that looks at it: for the tests of its pages."""

import json
import os
import shutil
import socket
import ssl
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Literal
from urllib.error import HTTPError
from urllib.request import urlopen

import pytest

from bench.present.report._file import find_browser
from drivers.base.clock import WallClock, utc_now

if TYPE_CHECKING:
    from playwright.sync_api import Page

BROWSER = shutil.which("chromium-headless-shell") or find_browser() or None
"""Without a window first: the same engine, half the processor time."""
FLAGS = [
    "--no-sandbox",
    "--disable-gpu",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
]
PATIENCE_S = 60.0
NEEDED = [
    pytest.mark.skipif(
        BROWSER is None, reason="no Chromium here: `apt-get install chromium` tests the panel"
    ),
    pytest.mark.timeout(600),
    pytest.mark.slow,
]

DESK = pytest.mark.parametrize("width", [1280])
PHONE = pytest.mark.parametrize("width", [390])
"""Screens in px: what is done at a desk and what is done beside the bench. Every page at both, light and dark:
`test_panel_accessible.py`."""


def until(condition, what: str) -> None:
    """Wait for a condition outside of the browser."""
    clock = WallClock()
    try:
        while not condition():
            assert clock.now() < PATIENCE_S, f"waited in vain for {what}"
            clock.sleep(0.1)
    finally:
        clock.close()


class Panel:
    """A panel in a process of its own, on a port that was free."""

    def __init__(self, runs: Path, *options: object) -> None:
        self.runs = runs
        self.options = [str(option) for option in options]
        with socket.create_server(("127.0.0.1", 0)) as server:
            self.port = server.getsockname()[1]
        scheme = "https" if "--certificate" in self.options else "http"
        self.url = f"{scheme}://127.0.0.1:{self.port}/"
        self.start()

    @property
    def trusting(self) -> ssl.SSLContext | None:
        """What takes the panel's own certificate for good."""
        return ssl._create_unverified_context() if self.url.startswith("https") else None

    def start(self) -> None:
        command = "from bench.present.cli import main; main()"
        self.process = subprocess.Popen(
            [sys.executable, "-c", command, "panel", str(self.runs), "--port", str(self.port), *self.options],
            stdout=subprocess.DEVNULL,
            # NiceGUI takes these for a test of its own kind; a panel that is killed leaves its scratch folder
            env={name: text for name, text in os.environ.items() if not name.startswith("PYTEST_")}
            | {"TMPDIR": str(self.runs.parent)},
        )
        until(self.answers, "the panel to answer")

    def answers(self) -> bool:
        assert self.process.poll() is None, "the panel ended"
        try:
            with urlopen(self.url, timeout=10, context=self.trusting) as page:
                return page.status == 200
        except HTTPError as refused:
            return refused.code == 401  # it asks who is there
        except OSError:
            return False

    def kill(self) -> None:
        self.process.kill()
        self.process.wait()


def write_now(session: Path, title: str, **more) -> None:
    """Write what a living session of that campaign writes."""
    (session / "live" / "requests").mkdir(parents=True, exist_ok=True)
    now = {"format": 1, "utc": utc_now(), "pid": os.getpid(), "state": "running", "gyros": {}}
    campaign = {"title": title, "bench": f"bench of {title}", "number": 1, "count": 2, "run": "one"}
    now |= {"campaign": campaign, "run": None, "prompts": []} | more
    part = session / "live" / "now.json.part"
    part.write_text(json.dumps(now))
    part.replace(session / "live" / "now.json")


@contextmanager
def browser_page(width: int = 1280, scheme: Literal["light", "dark"] = "light") -> "Iterator[Page]":
    """A page of a browser of that width, light or dark; the time that something takes to come is the test's."""
    from playwright.sync_api import expect, sync_playwright

    expect.set_options(timeout=1000.0 * PATIENCE_S)
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=BROWSER, args=FLAGS)
        context = browser.new_context(
            viewport={"width": width, "height": 900},
            color_scheme=scheme,
            reduced_motion="reduce",
            ignore_https_errors=True,
        )
        context.set_default_timeout(1000.0 * PATIENCE_S)
        yield context.new_page()
        browser.close()


def serious(page: "Page", within: str = "html") -> list[str]:
    """Return what axe-core calls serious or critical in a part of a page: rule, place and what it says.

    axe-core (MPL-2.0, Deque Systems) comes with the package axe-playwright-python; only tests use it.
    """
    import axe_playwright_python

    script = Path(axe_playwright_python.__file__).with_name("axe.min.js").read_text(encoding="utf-8")
    page.wait_for_function("!document.querySelector('[class*=enter-active]')")
    page.wait_for_function("document.getAnimations().every((one) => one.playState !== 'running')")
    if not page.evaluate("'axe' in window"):
        page.evaluate(script)
    found = page.evaluate(f"axe.run({within!r}, {{ resultTypes: ['violations'] }})")
    assert len(found["passes"]) > 5, "axe has looked at nothing"
    return [
        f"{violation['id']}: {node['target']}: {node['failureSummary']}"
        for violation in found["violations"]
        if violation["impact"] in ("serious", "critical")
        for node in violation["nodes"]
    ]
