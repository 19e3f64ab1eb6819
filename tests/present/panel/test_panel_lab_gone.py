"""A lab that goes away in the middle of a run, beside a bench that goes on: each page says what is so."""

import re
from pathlib import Path

import pytest

from bench.campaign.queue import RunOrder
from bench.control.live import drop_answer, read_now
from bench.record.recording import read_manifest
from tests.present.panel.browser import NEEDED, browser_page, until, write_now
from tests.present.panel.test_panel_queue import bench_with_panel

pytestmark = [*NEEDED, pytest.mark.concurrent]


def test_a_lab_that_goes_away_is_told_on_every_page_and_stops_no_other_bench(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from playwright.sync_api import expect

    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    with bench_with_panel(tmp_path, max_rate_dps=15, min_temp_c=-50) as bench:
        runs, queue = bench.panel.runs, bench.queue
        other = runs / "other"
        write_now(other, "Lot 7", time_s=60.0)
        order = RunOrder(procedure="constant-rotation", parameters={"turns": 10_000.0, "rate_dps": 12.0})
        queue.start(queue.add(order, "Ada").id, "Ada")
        until(lambda: any(runs.glob("*/manifest.json")), "the run to begin")
        (run,) = (path.parent for path in runs.glob("*/manifest.json"))
        until(lambda: (read_now(run) or {}).get("prompts"), "the question")
        drop_answer(run, read_now(run)["prompts"][0]["id"], "yes", "Ada")
        with browser_page() as page:
            page.goto(f"{bench.panel.url}?session={run.name}")
            rate = page.locator("[data-live=rate]")
            expect(rate).to_have_text(re.compile(r"^\+12\.0"))
            beside = page.context.new_page()
            beside.goto(f"{bench.panel.url}?session=other")
            expect(beside.locator("[data-live=elapsed]")).to_have_text("0:01:00")
            bench.lab.close()
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
            page.goto(bench.address)
            expect(page.locator("[data-held]")).to_contain_text("did not end well")
        until(
            lambda: queue._reap() or not queue._children, "the run's process to end"
        )  # it is ours, started here
        manifest = read_manifest(run)
        assert manifest.outcome == "aborted" and "NOT CONFIRMED SAFE" in manifest.reason
