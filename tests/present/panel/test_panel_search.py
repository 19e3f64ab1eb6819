"""A search for a missing effect is planned, started, stopped and gone on with from the browser."""

import json
import shutil
from pathlib import Path

import pytest

from bench.campaign import HUNT_FILE
from tests.present.panel.browser import DESK, NEEDED, browser_page, until
from tests.present.panel.test_panel_queue import bench_with_panel, fits_the_screen

pytestmark = [*NEEDED, pytest.mark.concurrent]
NOMINAL = Path(__file__).parents[3] / "examples" / "nominal" / "fog_on_its_bench.toml"


@DESK
def test_a_search_is_started_stopped_and_gone_on_with(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, width: int
) -> None:
    from playwright.sync_api import expect

    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    with bench_with_panel(tmp_path, max_rate_dps=15, min_temp_c=-60) as bench, browser_page(width) as page:
        (bench.bench_file.parent / "nominal").mkdir()
        shutil.copy(NOMINAL, bench.bench_file.parent / "nominal")
        page.goto(bench.address)
        page.get_by_test_id("name").fill("Ada")
        page.get_by_test_id("campaign").select_option("turns.toml")
        plan = page.locator("[data-plan-body]")
        expect(plan).to_contain_text("12 °/s")
        page.get_by_test_id("model").select_option(f"nominal/{NOMINAL.name}")
        expect(plan).to_contain_text("at most 60:00:00")
        expect(page.get_by_test_id("campaign")).to_have_value("")
        expect(page.get_by_test_id("rehearse")).to_be_hidden()
        page.get_by_label("Bench time").fill("a day")
        expect(plan).to_contain_text("a search needs its bench time")
        expect(page.get_by_test_id("start-now")).to_be_disabled()
        page.get_by_label("Bench time").fill("20")
        expect(plan).to_contain_text("at most 20:00:00")
        fits_the_screen(page)
        page.get_by_test_id("start-now").click()
        expect(page.locator("#sure-head")).to_have_text(
            f"Start a search from fog on its bench on {bench.queue.bench}?"
        )
        page.get_by_test_id("start-yes").click()
        page.get_by_role("link", name="Watch it").click()
        expect(page.locator("[data-live=title]")).to_contain_text("search for what fog on its bench lacks")
        page.wait_for_function("window.gyrobench?.messages > 0")
        page.get_by_test_id("abort").click()
        page.get_by_test_id("abort-now").click()
        expect(page.get_by_test_id("state")).to_have_text("Aborted")
        (folder,) = (path.parent for path in bench.panel.runs.glob(f"*/{HUNT_FILE}"))
        journal = [json.loads(line) for line in (folder / "events.jsonl").read_text().splitlines()]
        assert [row["kind"] for row in journal if row["kind"] in ("sought", "next_run")] == [
            "sought",
            "next_run",
        ]
        assert [row["by"] for row in journal if row["kind"] == "started"] == ["Ada"]

        until(lambda: bench.queue.state().current is None, "the queue to see the end")
        page.goto(bench.address)
        page.locator(".resume").get_by_role("button", name="Go on with it").click()
        expect(page.locator("[data-waiting] .detail")).to_have_text(f"go on in {folder.name}")
        page.locator("[data-waiting]").get_by_role("button", name="Start").click()
        page.get_by_test_id("start-yes").click()
        page.get_by_role("link", name="Watch it").click()
        expect(page.get_by_test_id("state")).to_have_text("Waiting for you")
