"""A served lab is killed in the middle of a run, beside a bench that goes on, and comes back."""

import os
import re
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from bench.campaign.queue import BenchQueue, RunOrder
from bench.control.live import drop_answer, read_now
from bench.record.recording import read_manifest
from tests.benches import FOG_BENCH
from tests.present.panel.browser import NEEDED, PATIENCE_S, PHONE, Panel, browser_page, until, write_now

pytestmark = [*NEEDED, pytest.mark.concurrent]


def serve_lab(plain: Path, bench_file: Path) -> subprocess.Popen[bytes]:
    """Serve a lab as one does by hand; its ports are in the bench file when this returns."""
    bench_file.unlink(missing_ok=True)
    command = "from bench.present.cli import main; main()"
    words = ("lab", "--bench", str(plain), "--virtual", "--write", str(bench_file))
    process = subprocess.Popen([sys.executable, "-c", command, *words], stdout=subprocess.DEVNULL)
    until(bench_file.exists, "the lab")
    return process


GONE = re.compile("emulated lab is gone|port is gone")
"""Which of the lab's ends is noticed first, its clock's or a port's, is chance."""


@PHONE
def test_a_lab_that_is_killed_is_told_on_every_page_and_comes_back(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, width: int
) -> None:
    from playwright.sync_api import expect

    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    plain, bench_file = tmp_path / "plain.toml", tmp_path / "files" / "bench.toml"
    plain.write_text(FOG_BENCH)
    bench_file.parent.mkdir()
    lab = serve_lab(plain, bench_file)
    panel = Panel(tmp_path / "runs", "--bench", bench_file)
    runs, queue = panel.runs, BenchQueue(panel.runs, bench_file)
    try:
        other = runs / "other"
        write_now(other, "Lot 7", time_s=60.0)
        order = RunOrder(procedure="constant-rotation", parameters={"turns": 10_000.0, "rate_dps": 12.0})
        queue.start(queue.add(order, "Ada").id, "Ada")
        until(lambda: any(runs.glob("*/manifest.json")), "the run to begin")
        (run,) = (path.parent for path in runs.glob("*/manifest.json"))
        until(lambda: (read_now(run) or {}).get("prompts"), "the question")
        drop_answer(run, read_now(run)["prompts"][0]["id"], "yes", "Ada")
        with browser_page(width) as page:
            page.goto(f"{panel.url}?session={run.name}")
            rate = page.locator("[data-live=rate]")
            expect(rate).to_have_text(re.compile(r"^\+12\.0"))
            beside = page.context.new_page()
            beside.goto(f"{panel.url}?session=other")
            expect(beside.locator("[data-live=elapsed]")).to_have_text("0:01:00")
            os.kill(lab.pid, signal.SIGKILL)
            lab.wait()
            expect(page.locator("[data-banner]")).to_have_class(re.compile("bad"))
            expect(page.get_by_test_id("state")).not_to_have_text("Running")
            expect(page.locator("[data-part=press]")).to_contain_text("GO AND LOOK NOW")
            expect(page.locator("[data-live='table.age']")).to_contain_text("last read")
            expect(page.get_by_test_id("abort")).to_be_disabled()
            write_now(other, "Lot 7", time_s=120.0)
            expect(beside.locator("[data-live=elapsed]")).to_have_text("0:02:00")
            expect(beside.get_by_test_id("state")).to_have_text("Running")
            own = beside.locator("[data-benches] .bench.bad")
            expect(own).to_have_count(1)
            expect(own).not_to_contain_text("Lot 7")
            until(lambda: queue._reap() or not queue._children, "the run's process to end")  # started here
            manifest = read_manifest(run)
            assert manifest.outcome == "aborted" and "NOT CONFIRMED SAFE" in manifest.reason

            # the queue is held and shows why; the lab is served anew, on other ports, and the run is repeated
            page.goto(f"{panel.url}queue/{queue.name}")
            expect(page.locator("[data-held]")).to_contain_text("did not end well")
            expect(page.locator("[data-ended]")).to_contain_text(GONE)
            lab = serve_lab(plain, bench_file)
            page.locator("[data-ended]").get_by_role("link", name="Repeat").click()
            expect(page.locator("#p-turns")).to_have_value("10000")
            page.locator("#p-turns").fill("2")
            page.get_by_test_id("name").fill("Ada")
            expect(page.locator("[data-plan-body]")).to_contain_text("12 °/s")
            page.get_by_test_id("start-now").click()
            page.get_by_test_id("start-yes").click()
            page.get_by_role("link", name="Watch it").click()
            # a press before the page is connected is lost, and an answer needs its name
            page.wait_for_function("window.gyrobench?.messages > 0")
            expect(page.get_by_test_id("name")).to_have_value("Ada")
            page.get_by_test_id("answer-yes").click()
            expect(page.get_by_test_id("state")).to_have_text("Completed")
            expect(page.locator("[data-list=alarms]")).to_contain_text(GONE)
            assert page.evaluate("document.documentElement.scrollWidth") <= width
    finally:
        panel.kill()
        lab.terminate()
        lab.wait(PATIENCE_S)
