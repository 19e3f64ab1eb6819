"""The panel in a real browser beside an emulated run: values move, a question is answered, an abort ends safe."""

import json
import os
import shutil
import socket
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from urllib.request import urlopen

import pytest

from bench.control.live import read_now
from drivers.base.clock import WallClock, utc_now

BROWSER = shutil.which("chromium") or shutil.which("google-chrome")
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
pytestmark = [
    pytest.mark.skipif(
        BROWSER is None, reason="no Chromium here: `apt-get install chromium` tests the panel"
    ),
    pytest.mark.timeout(600),
    pytest.mark.concurrent,
    pytest.mark.slow,
]


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

    def __init__(self, runs: Path) -> None:
        self.runs = runs
        with socket.create_server(("127.0.0.1", 0)) as server:
            self.port = server.getsockname()[1]
        self.url = f"http://127.0.0.1:{self.port}/"
        self.start()

    def start(self) -> None:
        command = "from bench.present.cli import main; main()"
        self.process = subprocess.Popen(
            [sys.executable, "-c", command, "panel", str(self.runs), "--port", str(self.port)],
            stdout=subprocess.DEVNULL,
            # NiceGUI takes these for a test of its own kind
            env={name: text for name, text in os.environ.items() if not name.startswith("PYTEST_")},
        )
        until(self.answers, "the panel to answer")

    def answers(self) -> bool:
        assert self.process.poll() is None, "the panel ended"
        try:
            with urlopen(self.url, timeout=10) as page:
                return page.status == 200
        except OSError:
            return False

    def kill(self) -> None:
        self.process.kill()
        self.process.wait()


@pytest.fixture
def panel(tmp_path: Path) -> Iterator[Panel]:
    runs = tmp_path / "runs"
    runs.mkdir()
    found = Panel(runs)
    yield found
    found.kill()


@pytest.fixture
def session(panel: Panel, tmp_path: Path) -> Iterator[subprocess.Popen]:
    log = (tmp_path / "session.log").open("w")
    process = subprocess.Popen(
        [sys.executable, str(Path(__file__).with_name("session.py")), str(panel.runs)],
        stdout=log,
        env=os.environ | {"OMP_NUM_THREADS": "1", "XDG_STATE_HOME": str(tmp_path / "state")},
    )
    yield process
    if process.poll() is None:
        process.terminate()
        process.wait(PATIENCE_S)
    log.close()


def test_an_operator_sees_answers_and_aborts(panel: Panel, session: subprocess.Popen) -> None:
    from playwright.sync_api import expect, sync_playwright

    run = panel.runs / "turn"
    requested, wrong = [], []
    patience_ms = 1000.0 * PATIENCE_S
    expect.set_options(timeout=patience_ms)
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=BROWSER, args=FLAGS)
        context = browser.new_context(viewport={"width": 1280, "height": 900})
        context.set_default_timeout(patience_ms)
        context.on("request", lambda request: requested.append(request.url))
        page = context.new_page()
        page.on("pageerror", lambda error: wrong.append(str(error)))
        page.goto(panel.url)
        second = context.new_page()
        second.goto(panel.url)
        state = page.get_by_test_id("state")

        # the question, on both pages; answered on one
        for each in (page, second):
            expect(each.get_by_test_id("question")).to_contain_text("close the door")
        expect(state).to_have_text("Waiting for you")
        page.get_by_test_id("name").fill("Ada")
        page.get_by_test_id("answer-yes").click()
        for each in (page, second):
            expect(each.get_by_test_id("question")).to_have_count(0)
        expect(state).to_have_text("Running")

        # values move: the table turns, the chamber cools, the curves grow
        page.wait_for_function("document.querySelector('[data-live=rate]').textContent.startsWith('+5.0')")
        page.wait_for_function(
            "parseFloat(document.querySelector('[data-live=air]').textContent.replace('−', '-')) < 20"
        )
        before = page.evaluate("window.gyrobench.messages")
        page.wait_for_function(f"window.gyrobench.messages > {before + 5} && window.gyrobench.rows() > 5")
        assert page.locator("[data-plot=temperature] canvas").count() == 1

        # a panel that dies does not touch the run, and the page comes back by itself
        page.evaluate("window.ofTheFirstPanel = true")
        panel.kill()
        page.wait_for_selector("body.cut-off")
        time_s = read_now(run)["time_s"]
        until(lambda: read_now(run)["time_s"] > time_s + 60.0, "the run to go on without the panel")
        panel.start()
        page.wait_for_function("!window.ofTheFirstPanel && window.gyrobench?.messages > 0")
        expect(state).to_have_text("Running")

        # abort asks once
        page.get_by_test_id("abort").click()
        page.get_by_text("Keep running").click()
        expect(page.get_by_test_id("abort-now")).to_be_hidden()
        assert read_now(run)["state"] == "running"
        page.get_by_test_id("name").fill("Ada")
        page.get_by_test_id("abort").click()
        page.get_by_test_id("abort-now").click()
        expect(state).to_have_text("Aborted")
        done = page.locator('[data-part="done"]')
        expect(done).to_contain_text("table at rest")
        expect(done).to_contain_text("chamber at rest")
        expect(page.get_by_test_id("abort")).to_be_disabled()
        assert session.wait(PATIENCE_S) == 0

        # the record says who, and the history has the report
        events = [json.loads(line) for line in (run / "events.jsonl").read_text().splitlines()]
        assert next(row for row in events if row["kind"] == "answer")["by"] == "Ada"
        assert next(row for row in events if row["kind"] == "request")["action"] == "abort"
        assert events[-1]["outcome"] == "aborted"
        link = page.locator('.history a[href="/report/turn"]')
        expect(link).to_be_visible()
        with urlopen(panel.url + "report/turn", timeout=PATIENCE_S) as report:
            assert "script" not in report.headers["Content-Security-Policy"]
            assert "Run aborted" in report.read().decode()
        browser.close()
    assert any(url.startswith(panel.url) for url in requested)
    outside = [url for url in requested if not url.startswith((panel.url, "data:", "blob:"))]
    assert outside == [] and wrong == []


def write_now(session: Path, title: str) -> None:
    """Write what a living session of that campaign writes."""
    (session / "live" / "requests").mkdir(parents=True)
    now = {"format": 1, "utc": utc_now(), "pid": os.getpid(), "state": "running", "gyros": {}}
    now |= {"campaign": {"title": title, "folder": str(session), "number": 1, "count": 2, "run": "one"}}
    (session / "live" / "now.json").write_text(json.dumps(now | {"run": None, "prompts": []}))


def test_two_benches_in_one_folder_are_both_shown(panel: Panel) -> None:
    from playwright.sync_api import expect, sync_playwright

    write_now(panel.runs / "first", "Lot <12>")
    expect.set_options(timeout=1000.0 * PATIENCE_S)
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=BROWSER, args=FLAGS)
        context = browser.new_context()
        context.set_default_timeout(1000.0 * PATIENCE_S)
        page = context.new_page()
        page.goto(panel.url)
        title, others = page.locator("[data-live=title]"), page.get_by_test_id("others")
        expect(title).to_contain_text("Lot <12>")
        expect(others).to_be_hidden()
        write_now(panel.runs / "second lot", "Lot 13")
        expect(others).to_contain_text("Lot 13")
        expect(title).to_contain_text("Lot <12>")
        page.get_by_role("link", name="Lot 13").click()
        expect(title).to_contain_text("Lot 13")
        expect(page.get_by_role("link", name="Lot <12>")).to_be_visible()
        page.wait_for_function("window.gyrobench?.messages > 0")
        expect(title).to_contain_text("Lot 13")
        page.get_by_test_id("abort").click()
        page.get_by_test_id("abort-now").click()
        dropped = panel.runs / "second lot" / "live" / "requests"
        until(lambda: any(dropped.iterdir()), "the request")
        assert not any((panel.runs / "first" / "live" / "requests").iterdir())
        page.goto(panel.url + "?session=../first")
        expect(page.get_by_test_id("state")).to_have_text("Not here")
        browser.close()
