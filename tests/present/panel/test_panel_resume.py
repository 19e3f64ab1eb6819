"""A campaign that was stopped goes on from the browser: what is done stays, what was cut short is run again."""

import json
from pathlib import Path

import pytest

from bench.record.recording import read_manifest
from tests.present.panel.browser import NEEDED, PHONE, browser_page
from tests.present.panel.test_panel_queue import bench_with_panel

pytestmark = [*NEEDED, pytest.mark.concurrent]
TWO_RUNS = """
title = "Two turns"
[[run]]
name = "short"
procedure = "constant-rotation"
parameters = { rate_dps = 12, turns = 1, rest_s = 10 }
[[run]]
name = "long"
procedure = "constant-rotation"
parameters = { rate_dps = 12, turns = 200, rest_s = 10 }
"""


@PHONE
def test_a_stopped_campaign_is_gone_on_with_from_the_browser(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, width: int
) -> None:
    from playwright.sync_api import expect

    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    with bench_with_panel(tmp_path) as bench, browser_page(width) as page:
        (bench.bench_file.parent / "turns.toml").write_text(TWO_RUNS)

        def answer_until(done: str) -> None:
            """Press what the live page asks for, until a run of the campaign is there."""
            page.wait_for_function(
                "(done) => { document.querySelector('[data-testid=answer-yes]')?.click(); return eval(done); }",
                arg=done,
                polling=300,
            )

        page.goto(bench.address)
        page.get_by_test_id("name").fill("Ada")
        page.get_by_test_id("campaign").select_option("turns.toml")
        page.get_by_test_id("start-now").click()
        page.get_by_test_id("start-yes").click()
        page.get_by_role("link", name="Watch it").click()
        expect(page.locator("[data-live=title]")).to_have_text("Two turns")
        expect(page.get_by_test_id("name")).to_have_value("Ada")
        turning = "document.querySelector('[data-live=rate]').textContent.startsWith('+12.0')"
        answer_until(f"document.querySelector('[data-live=run]').textContent === 'long' && {turning}")
        (folder,) = (path.parent for path in bench.panel.runs.glob("turns-*/campaign.toml"))
        page.get_by_test_id("abort").click()
        page.get_by_test_id("abort-now").click()
        expect(page.get_by_test_id("state")).to_have_text("Aborted")

        # the queue is held; the campaign is offered, with what is done of it
        page.goto(bench.address)
        expect(page.locator("[data-held]")).to_contain_text("did not end well")
        page.route("**/assets/*.js", lambda route: route.abort())
        page.reload()
        offered = page.locator(".resume")
        expect(offered.get_by_role("button")).to_be_disabled()  # what it does has not come yet
        page.unroute("**/assets/*.js")
        page.reload()
        expect(offered).to_contain_text("Two turns")
        offered.get_by_role("button", name="Go on with it").click()
        expect(page.locator("[data-waiting]")).to_contain_text("Two turns")
        page.locator("[data-waiting]").get_by_role("button", name="Start").click()
        page.get_by_test_id("start-yes").click()
        page.get_by_role("link", name="Watch it").click()
        expect(page.get_by_test_id("name")).to_have_value("Ada")
        answer_until("document.querySelector('[data-testid=state]').textContent === 'Completed'")
        expect(page.get_by_role("link", name="certificate").first).to_be_visible()
        assert page.evaluate("document.documentElement.scrollWidth") <= width

    journal = [json.loads(line) for line in (folder / "events.jsonl").read_text().splitlines()]
    ended = [(row["run"], row["outcome"]) for row in journal if row["kind"] == "run_ended"]
    assert ended == [("short", "completed"), ("long", "aborted"), ("long", "completed")]
    assert [row["run"] for row in journal if row["kind"] == "set_aside"] == ["long"]
    assert [row["by"] for row in journal if row["kind"] in ("started", "continued")] == ["Ada", "Ada"]
    outcomes = {
        path.name: read_manifest(path).outcome for path in (folder / "runs").iterdir() if path.is_dir()
    }
    assert outcomes["short"] == "completed" and sorted(outcomes.values()).count("completed") == 2
