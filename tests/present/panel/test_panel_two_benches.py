"""Two benches in one folder, looked at from pages that stay open: nobody is led to the wrong one."""

import json
import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from bench.campaign.queue import BenchQueue, RunOrder
from tests.benches import FOG_BENCH
from tests.present.panel.browser import DESK, NEEDED, PHONE, Panel, browser_page, until, write_now
from tests.present.panel.test_panel_queue import bench_with_panel

pytestmark = [*NEEDED, pytest.mark.concurrent]


@pytest.fixture(autouse=True)
def state(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))


@pytest.fixture
def panel(tmp_path: Path) -> Iterator[Panel]:
    (tmp_path / "runs").mkdir()
    found = Panel(tmp_path / "runs")
    yield found
    found.kill()


@PHONE
def test_a_page_stays_with_an_alarm_until_it_is_seen(panel: Panel, width: int) -> None:
    """The bench that a page shows loses its process; the other one, which runs well, must not take its place."""
    from playwright.sync_api import expect

    command = [sys.executable, "-c", "input()"]
    with subprocess.Popen(command, stdin=subprocess.PIPE) as gone, browser_page(width) as page:
        write_now(panel.runs / "east", "east", pid=gone.pid)
        page.goto(panel.url)
        title = page.locator("[data-live=title]")
        expect(title).to_have_text("east")
        write_now(panel.runs / "west", "west")
        expect(page.locator("[data-benches]")).to_contain_text("bench of west")
        gone.kill()
        gone.wait()
        expect(page.get_by_test_id("state")).to_have_text("Process gone")
        before = page.evaluate("window.gyrobench.messages")
        for number in range(40):  # longer than the panel takes to look for sessions anew
            write_now(panel.runs / "west", "west", time_s=float(number))
            page.wait_for_timeout(100)
        assert page.evaluate("window.gyrobench.messages") > before
        expect(title).to_have_text("east")
        # a page that is opened now shows it too
        other = page.context.new_page()
        other.goto(panel.url)
        expect(other.get_by_test_id("state")).to_have_text("Process gone")
        page.get_by_test_id("name").fill("Ada")
        page.get_by_test_id("acknowledge").click()
        expect(title).to_have_text("west")


@PHONE
def test_an_abort_reaches_the_bench_that_was_shown_when_it_was_asked_for(panel: Panel, width: int) -> None:
    from playwright.sync_api import expect

    write_now(panel.runs / "east", "east")
    with browser_page(width) as page:
        page.goto(panel.url)
        expect(page.locator("[data-live=title]")).to_have_text("east")
        page.wait_for_function("window.gyrobench?.messages > 0")
        page.get_by_test_id("abort").click()
        expect(page.get_by_test_id("abort-what")).to_have_text("east on bench of east")
        write_now(panel.runs / "west", "west")
        write_now(panel.runs / "east", "east", state="ended", outcome="completed")
        expect(page.locator("[data-live=title]")).to_have_text("west")
        page.get_by_test_id("abort-now").click()
        expect(page.get_by_text("Nothing runs.")).to_be_visible()
        assert list((panel.runs / "west" / "live" / "requests").iterdir()) == []


@DESK
def test_each_bench_has_its_own_queue_on_every_page(tmp_path: Path, width: int) -> None:
    """Also a bench on which nothing has run yet is in the strip, with what waits for it."""
    from playwright.sync_api import expect

    files = []
    for name in ("east lab", "west lab"):
        file = tmp_path / f"{name[:4]}.toml"
        file.write_text(re.sub(r'name = "[^"]*"', f'name = "{name}"', FOG_BENCH, count=1))
        files += ["--bench", file]
    west = BenchQueue(tmp_path / "runs", files[3])
    panel = Panel(tmp_path / "runs", *files)
    try:
        west.add(RunOrder(procedure="known-state"), "Ada")
        write_now(panel.runs / "lot", "lot", campaign={"title": "Lot 7", "bench": "west lab"})
        with browser_page(width) as page:
            for address in ("", "?bench=west%20lab", "history", "trends", f"queue/{west.name}"):
                page.goto(panel.url + address)
                strip, pages = (
                    page.get_by_role("navigation", name=name, exact=True) for name in ("Benches", "Pages")
                )
                expect(strip.get_by_role("link", name=re.compile("^east lab"))).to_contain_text(
                    "nothing goes on"
                )
                expect(strip.get_by_role("link", name=re.compile("^west lab"))).to_contain_text(
                    "1 waiting, queue held"
                )
                link = pages.get_by_role("link", name="Queue of west lab")
                assert link.get_attribute("href") == f"/queue/{west.name}"
                assert page.evaluate("document.documentElement.scrollWidth") <= width
            # the strip of a page that is open follows what happens
            page.goto(f"{panel.url}history")
            write_now(panel.runs / "lot", "lot", campaign={"title": "Lot 7", "bench": "west lab"}, chamber=5)
            expect(strip).to_contain_text("Cannot be read")
            expect(strip.locator("[aria-current]")).to_have_count(0)  # this page is of no bench
            strip.get_by_role("link", name=re.compile("^east lab")).click()
            expect(page.get_by_role("heading", name="Queue", exact=True)).to_be_visible()
            expect(page.locator(".bench-name")).to_have_text("east lab")
    finally:
        panel.kill()


@DESK
def test_a_page_that_follows_a_bench_asks_the_first_question_of_each_run(tmp_path: Path, width: int) -> None:
    """Every run is a process that counts its questions from 1: an answer on a page is to one of them only."""
    from playwright.sync_api import expect

    with bench_with_panel(tmp_path, max_rate_dps=15, min_temp_c=-50) as bench, browser_page(width) as page:
        for turns in (1.0, 2.0):
            order = RunOrder(procedure="constant-rotation", parameters={"turns": turns, "rate_dps": 12.0})
            bench.queue.add(order, "Ada")
        bench.queue.let_go("Ada")
        name = json.dumps(bench.queue.bench).strip('"')
        page.goto(f"{bench.panel.url}?bench={name}")
        page.get_by_test_id("name").fill("Ada")
        for number in (1, 2):
            expect(page.get_by_test_id("question")).to_contain_text("Mount")
            page.get_by_test_id("answer-yes").click()
            until(lambda number=number: len(bench.queue.state().ended) == number, "the run to end")
        # a page that is loaded while the queue goes shows the same bench
        page.reload()
        expect(page.get_by_test_id("state")).to_have_text("Completed")
    assert [item.ended.outcome for item in bench.queue.state().ended] == ["completed", "completed"]
