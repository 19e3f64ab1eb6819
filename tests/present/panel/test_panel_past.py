"""Recorded runs on the panel: curves as the record has them, figures with intervals, notes; also in a browser."""

import asyncio
import json
import math
from pathlib import Path
from typing import ClassVar
from urllib.error import HTTPError
from urllib.request import Request, urlopen

import numpy as np
import pytest

from bench.control.run_record import decode_run
from bench.present.panel._figure_store import FigureStore
from bench.present.panel._run_curves import POINTS, run_curves
from bench.present.panel._trend import MONTH_S, Interval, difference, mean_difference, slope, trends
from bench.present.panel._worker import answer
from bench.record.events.run import Outcome, PhaseBegun
from bench.record.recording import (
    EventLog,
    Manifest,
    Run,
    read_manifest,
    seal,
    table_writer,
    verify,
    write_manifest,
)
from bench.record.run_notes import read_notes
from tests.present.panel.browser import NEEDED, PATIENCE_S, PHONE, Panel, browser_page, serious
from tests.record.recording.test_recover import left_open
from tests.record.recording.test_run_notes import PNG

SPIKE_S, SPIKE_C = 4321.0, 61.5


def record(folder: Path, unit: str, month: int, *, bias_dph: float = 10.0, warm_s: float = 600.0) -> Path:
    """Write a run of two hours: air 25 degC with one spike of a second, a gyro at 10 Hz that sees a step."""
    folder.mkdir(parents=True)
    manifest = Manifest(
        run_id=folder.name,
        procedure="known-state",
        started_utc=f"2026-{month:02d}-05T09:00:00.000+00:00",
        bench={"bench": {"name": "one"}},
        units={"g": unit},
    )
    write_manifest(folder, manifest)
    log = EventLog(folder)
    log.event(1.0, PhaseBegun("warm_up"))
    log.event(warm_s, PhaseBegun("turn_<b>"))
    log.event(7200.0, Outcome("completed", "", True))
    log.close()
    second = np.arange(7200.0) + 0.5
    air = np.where(np.floor(second) == SPIKE_S, SPIKE_C, 25.0 + 0.001 * second)
    rate = np.where(second < warm_s, 0.0, 5.0)
    with table_writer(folder / "chamber.parquet", "chamber") as writer:
        columns = {
            "time_ns": (second * 1e9).astype(np.int64),
            "air_temp_c": air,
            "set_point_c": 25.0 + 0.0 * air,
        }
        writer.write(columns)
    with table_writer(folder / "turntable.parquet", "table") as writer:
        writer.write({"time_ns": (second * 1e9).astype(np.int64), "angle_deg": rate, "rate_dps": rate})
    tenth = np.arange(72_000) * 0.1 + 0.05
    noise = 0.01 * np.random.default_rng(month).standard_normal(len(tenth))
    with table_writer(folder / "gyro_g.parquet", "gyro") as writer:
        writer.write(
            {
                "time_ns": (tenth * 1e9).astype(np.int64),
                "valid": np.ones(len(tenth), dtype=np.bool_),
                "rate_dps": bias_dph / 3600.0 + np.where(tenth < warm_s, 0.0, 5.0) + noise,
                "temp_c": 30.0 + 0.0 * tenth,
            }
        )
    measured = [
        {
            "name": "output at rest",
            "value": bias_dph,
            "unit": "deg/h",
            "low": 0.0,
            "high": 20.0,
            "passed": True,
        }
    ]
    seal(folder, manifest, outcome="completed", duration_s=7200.0, measurements=tuple(measured))
    return folder


@pytest.fixture(scope="module")
def runs(tmp_path_factory) -> Path:
    root = tmp_path_factory.mktemp("past") / "runs"
    for month, (unit, bias) in enumerate(
        (("A-1", 10.0), ("A-1", 10.5), ("A-1", 11.0), ("B-2", 12.0), ("B-2", 12.1)), 1
    ):
        record(root / f"run-{month}", unit, month, bias_dph=bias, warm_s=600.0 * month)
    (root / "broken").mkdir()
    (root / "broken" / "manifest.json").write_text('{"run_id": 5')
    (root / "run-2" / "report.html").write_text("an old report")
    return root


class TestCurves:
    def test_a_spike_of_a_second_stays_and_means_are_those_of_the_samples(self, runs: Path) -> None:
        found = run_curves(runs / "run-1")
        curves = {curve["key"]: curve for curve in found["curves"]}
        assert max(curves["air"]["high"]) == SPIKE_C and len(curves["air"]["t"]) <= POINTS
        rate = curves["g.rate"]
        late = [low for t, low in zip(rate["t"], rate["low"], strict=True) if t > 610.0]
        assert np.mean(late) == pytest.approx(5.0 + 10.0 / 3600.0, abs=4 * 0.01 / math.sqrt(66_000))
        assert found["phases"] == [["warm_up", 1.0, 600.0], ["turn_<b>", 600.0, 7200.0]]
        assert found["end_s"] == 7200.0

    def test_a_stretch_has_every_sample_and_a_gap_ends_the_line(self, runs: Path) -> None:
        found = run_curves(runs / "run-1", 4300.0, 4340.0)
        air = next(curve for curve in found["curves"] if curve["key"] == "air")
        assert air["t"] == [4300.5 + k for k in range(40)] and air["high"][21] == SPIKE_C
        nothing = run_curves(runs / "run-1", 9000.0, 9100.0)
        assert nothing["curves"] == []

    def test_a_broken_run_is_an_answer_and_ends_nothing(self, runs: Path) -> None:
        for asked in ({"job": "curves", "run": str(runs / "broken")}, {"job": "?"}, 5):
            assert "problem" in json.loads(answer(json.dumps(asked)))
        assert "curves" in json.loads(answer(json.dumps({"job": "curves", "run": str(runs / "run-1")})))


class TestTrends:
    def test_a_slope_is_that_of_the_textbook(self) -> None:
        # NIST/SEMATECH handbook form: y = 2 x + 1 with residuals +-1 in turn about five months
        found = slope([k * MONTH_S for k in range(5)], [1.0, 3.0, 5.0, 7.0, 9.0])
        assert found is not None and (found.value, found.low, found.high) == pytest.approx((2.0, 2.0, 2.0))
        found = slope([k * MONTH_S for k in range(4)], [0.0, 2.0, 0.0, 2.0])
        # slope 0.4, residual sum 3.2, s = sqrt(1.6), Sxx = 5, t(0.975, 2) = 4.302653
        assert found is not None and found.value == pytest.approx(0.4)
        assert found.high - found.value == pytest.approx(4.302653 * math.sqrt(1.6 / 5.0), rel=1e-6)
        assert slope([0.0, 1.0], [0.0, 1.0]) is None and slope([1.0, 1.0, 1.0], [1.0, 2.0, 3.0]) is None

    def test_differences_have_the_intervals_of_independent_errors(self) -> None:
        found = difference(Interval(10.0, 9.0, 13.0), Interval(20.0, 16.0, 21.0))
        assert (found.value, found.low, found.high) == pytest.approx(
            (10.0, 10.0 - 5.0, 10.0 + math.hypot(1.0, 1.0))
        )
        assert difference(Interval(1.0), Interval(2.0, 1.0, 3.0)) == Interval(1.0)
        # Welch: means 2 and 6, variances 1 and 4 of 3 each, t(0.975, 2.941176) = 3.218...
        welch = mean_difference([1.0, 2.0, 3.0], [4.0, 6.0, 8.0])
        from scipy.stats import ttest_ind

        judged = ttest_ind([4.0, 6.0, 8.0], [1.0, 2.0, 3.0], equal_var=False).confidence_interval(0.95)
        assert welch is not None and (welch.low, welch.high) == pytest.approx(
            (judged.low, judged.high), rel=1e-9
        )
        assert (
            mean_difference([0.2, 0.2], [0.2 + 1e-16, 0.2]) == Interval(0.0)
            and mean_difference([1.0], [1.0, 2.0]) is None
        )

    def test_figures_are_worked_out_once_a_change(self, runs: Path, tmp_path: Path) -> None:
        names = [f"run-{k}" for k in range(1, 6)]
        store = FigureStore(runs, tmp_path)
        assert store.known(names) == {}
        asyncio.run(store.work())
        known = store.known([*names, "broken"])
        assert set(known) == set(names) and known["run-1"]["figures"][0]["value"] == 10.0
        again = FigureStore(runs, tmp_path)
        assert dict(again.known(names)) == dict(known)
        manifest = read_manifest(runs / "run-5")
        seal(runs / "run-5", manifest, outcome="invalid", measurements=())
        assert set(again.known(names)) == {"run-1", "run-2", "run-3", "run-4"}
        seal(runs / "run-5", manifest, outcome="completed")
        points = [
            row | {"run": name, "time_s": 0.0} for name, found in known.items() for row in found["figures"]
        ]
        (figure,) = trends(points, ["A-1", "B-2"])
        assert (figure["figure"], figure["of"]) == ("known-state: output at rest", "deg/h")
        assert [len(unit["points"]) for unit in figure["units"]] == [3, 2]
        (runs / ".figures" / "figures.sqlite").write_bytes(b"no database")
        assert FigureStore(runs, tmp_path).known(names) == {}


def post(url: str, body: object, **headers: str) -> tuple[int, str]:
    request = Request(url, json.dumps(body).encode(), {"content-type": "application/json"} | headers)
    try:
        with urlopen(request, timeout=PATIENCE_S) as found:
            return found.status, found.read().decode()
    except HTTPError as refused:
        return refused.code, refused.read().decode()


@PHONE
class TestInABrowser:
    pytestmark: ClassVar = [*NEEDED, pytest.mark.concurrent]

    @pytest.fixture
    def panel(self, runs: Path):
        found = Panel(runs)
        yield found
        found.kill()

    def test_runs_chosen_in_the_list_lie_over_one_another(self, panel: Panel, width: int) -> None:
        from playwright.sync_api import expect

        with browser_page(width) as page:
            wrong: list[str] = []
            page.on("pageerror", lambda error: wrong.append(str(error)))
            page.goto(f"{panel.url}history")
            for name in ("run-1", "run-3"):
                page.get_by_role("checkbox", name=name).check()
            page.get_by_test_id("lay").click()
            lanes = page.get_by_test_id("lanes")
            expect(lanes).to_have_attribute("data-loaded", "true")
            expect(lanes.locator("canvas")).to_have_count(1)
            series = "window.gyrobenchCurves.chart.data.lanes.flatMap(lane => lane.series.map(one => one.id))"
            assert set(page.evaluate(series)) >= {"run-1 air", "run-3 air", "run-1 g.rate", "run-3 table"}

            # over a common time the steps are 1200 s apart; by phase they fall together
            step = """(name) => {
                const lane = window.gyrobenchCurves.chart.data.lanes.find((one) => one.title === "Table rate");
                const curve = lane.series.find((one) => one.id === `${name} table`);
                return curve.t[curve.high.findIndex((rate) => rate > 4)];
            }"""
            assert page.evaluate(step, "run-3") - page.evaluate(step, "run-1") == pytest.approx(
                1200.0, abs=15.0
            )
            page.get_by_test_id("align").select_option("turn_<b>")
            expect(lanes).to_have_attribute("data-finer", "0 6600")
            assert page.evaluate(step, "run-3") == pytest.approx(page.evaluate(step, "run-1"), abs=15.0)

            # zoomed by dragging, the values come finer; read off at the cursor, by mouse and by key
            page.get_by_test_id("align").select_option("")
            field = page.get_by_role("group", name="Curves.")
            box = field.bounding_box()
            assert box is not None
            page.get_by_label("Show a phase").select_option(label="warm up")
            expect(lanes).to_have_attribute("data-finer", "1 1800")
            page.get_by_role("button", name="Show everything").click()
            y = box["y"] + 60
            page.mouse.move(box["x"] + 100, y)
            page.mouse.down()
            page.mouse.move(box["x"] + 200, y, steps=4)
            page.mouse.up()
            before, after = (
                page.evaluate(f"window.gyrobenchCurves.{what}") for what in ("chart.data.full", "view()")
            )
            share = 100.0 / (box["width"] - 80.0)
            assert after[1] - after[0] == pytest.approx(share * (before[1] - before[0]), rel=0.02)
            expect(lanes).to_have_attribute("data-finer", f"{after[0]} {after[1]}".replace(".0 ", " "))
            field.focus()
            page.keyboard.press("Escape")
            page.keyboard.press("Home")
            page.keyboard.press("ArrowRight")
            reading = page.locator(".reading")
            expect(reading).to_contain_text("run-1, table 5 °/s")
            expect(reading).to_contain_text("run-3, air")
            assert page.evaluate("document.documentElement.scrollWidth") <= width
            assert wrong == [] and serious(page) == []

    def test_a_note_with_a_picture_is_kept_beside_the_run(
        self, panel: Panel, width: int, tmp_path: Path
    ) -> None:
        from playwright.sync_api import expect

        run = panel.runs / "run-2"
        before = len(read_notes(run))
        picture = tmp_path / "mount.png"
        picture.write_bytes(PNG)
        with browser_page(width) as page:
            page.goto(f"{panel.url}history")
            page.locator(".run-row", has=page.get_by_label("run-2")).get_by_role(
                "link", name="curves"
            ).click()
            # curves that come push the form down: a press in that moment would miss its button
            expect(page.get_by_test_id("lanes")).to_have_attribute("data-loaded", "true")
            page.get_by_label("Note", exact=True).fill(f"bolt <b>loose</b> at {width}")
            page.get_by_label("Add a picture").set_input_files(picture)
            page.get_by_role("button", name="Keep the note").click()
            expect(page.locator("[data-wrong]")).to_contain_text("Type your name")
            page.get_by_test_id("name").fill("Ada")
            page.get_by_role("button", name="Keep the note").click()
            notes = page.locator("[data-list-of-notes] li")
            expect(notes).to_have_count(before + 1)
            expect(notes.last).to_contain_text(f"bolt <b>loose</b> at {width}")
            expect(notes.last).to_contain_text("Ada, 20")
            picture_shown = (
                "() => document.querySelector('[data-list-of-notes] li:last-child img')?.naturalWidth"
            )
            page.reload()
            page.locator("[data-list-of-notes] img").last.scroll_into_view_if_needed()
            expect(page.locator("[data-list-of-notes] img").last).to_have_js_property("complete", True)
            assert page.evaluate(picture_shown) == 1
            page.goto(f"{panel.url}history")
            expect(page.locator(".row-note").first).to_contain_text(f"Ada: bolt <b>loose</b> at {width}")
            assert page.evaluate("document.documentElement.scrollWidth") <= width
        with urlopen(f"{panel.url}report/run-2", timeout=PATIENCE_S) as report:
            text = report.read().decode()
        assert f"bolt &lt;b&gt;loose&lt;/b&gt; at {width}" in text and "data:image/png;base64," in text
        assert Run.open(run).seal == "whole"
        for body, status in ((5, 400), ({"by": "A", "picture": "?"}, 400), ({"by": "", "text": "x"}, 400)):
            assert post(f"{panel.url}panel/notes/run-2", body)[0] == status
        assert post(f"{panel.url}panel/notes/../secret", {"by": "A", "text": "x"})[0] in (404, 405)
        assert post(f"{panel.url}panel/notes/run-2", {"by": "A", "text": "x"}, origin="http://evil")[0] == 403
        assert len(read_notes(run)) == before + 1

    def test_a_run_that_a_crash_left_open_is_completed_by_a_button(
        self, panel: Panel, width: int, tmp_path: Path
    ) -> None:
        from playwright.sync_api import expect

        _, run = left_open(tmp_path / "lab.toml", panel.runs, f"left-{width}")
        with browser_page(width) as page:
            page.goto(f"{panel.url}history")
            row = page.locator(".run-row", has=page.get_by_label(run.name, exact=True))
            expect(row).to_contain_text("not closed")
            row.get_by_role("link", name="curves").click()
            complete = page.get_by_role("button", name="Complete the record")
            page.route("**/assets/*.js", lambda route: route.abort())
            page.reload()
            for early in (complete, page.get_by_role("button", name="Keep the note")):
                expect(early).to_be_disabled()  # what it does has not come yet: a click would be lost
            page.unroute("**/assets/*.js")
            page.reload()
            complete.click()
            expect(page.locator("[data-not-recovered]")).to_contain_text("Type your name")
            assert read_manifest(run).outcome == "running"
            assert page.evaluate("document.documentElement.scrollWidth") <= width and serious(page) == []
            page.get_by_test_id("name").fill("Ada")
            complete.click()
            expect(page.locator(".laid .outcome")).to_contain_text("aborted", timeout=1e3 * PATIENCE_S)
            expect(page.locator(".laid .why")).to_contain_text("Recovered")
            expect(complete).to_have_count(0)
        assert not verify(run, decode_run).problems
        assert [row["text"] for row in Run.open(run).events if str(row.get("text")).endswith("by Ada")]
        assert post(f"{panel.url}panel/recover/none", {"by": "Ada"})[0] == 404
        assert post(f"{panel.url}panel/recover/{run.name}", {"by": " "})[0] == 400

    def test_figures_over_time_and_two_units_beside_each_other(self, panel: Panel, width: int) -> None:
        from playwright.sync_api import expect

        with browser_page(width) as page:
            wrong: list[str] = []
            page.on("pageerror", lambda error: wrong.append(str(error)))
            page.goto(f"{panel.url}trends")
            page.get_by_role("link", name="A-1").click()
            expect(page.locator("[data-words]")).to_contain_text("A-1: 3 runs, +0.5")
            expect(page.locator("[data-words]")).to_contain_text("it moves")
            page.get_by_label("Units, by serial number").fill("A-1, B-2")
            page.get_by_test_id("show").click()
            expect(page.locator("[data-values] tbody tr")).to_have_count(5)
            expect(page.locator("[data-values]")).to_contain_text("0 … 20")
            compared = page.locator("[data-compared] tbody tr")
            expect(compared).to_have_count(1)
            expect(compared).to_contain_text("+1.1 deg/h, no interval known")
            expect(compared.locator(".differs")).to_contain_text("they differ")
            expect(page.locator("[data-trend] canvas")).to_have_count(1)
            assert serious(page) == []
            page.get_by_role("link", name="run-4").click()
            expect(page.get_by_role("heading", name="run-4", exact=True)).to_be_visible()
            page.go_back()
            page.get_by_label("Units, by serial number").fill("none <b>")
            page.get_by_test_id("show").click()
            expect(page.locator("[data-said]")).to_contain_text("There is no completed run of none <b>")
            assert page.evaluate("document.documentElement.scrollWidth") <= width
            assert wrong == []
