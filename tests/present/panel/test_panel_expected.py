"""The plan's curve beside the measured one: a rehearsal of the run's parameters, put where its phases began."""

from pathlib import Path

import pytest

from bench.control.procedure import find_procedure
from bench.control.questions import EmulatedOperator
from bench.control.runner import RunRequest, run_procedure
from bench.lab.emulated import EmulatedLab, Plant
from bench.record.benchfile import load_bench_file
from tests.benches import FOG_BENCH
from tests.present.panel.browser import DESK, NEEDED, Panel, browser_page

pytestmark = [*NEEDED, pytest.mark.concurrent]
MOVED = """() => {
    const plan = new window.gyrobenchExpected.Expected(document.createElement("div"), () => "a", () => {});
    const values = [0, 0, 0, 5, 5];
    plan.plan = {
        end_s: 30, phases: [["rest", 0, 10], ["turn", 10, 30]],
        curves: [{ key: "table", name: "table", t: [0, 5, 9, 12, 20], low: values, high: values }],
    };
    const lanes = [{ title: "Table rate", series: [] }];
    plan.add(lanes, [["rest", 2], ["turn", 8]]);
    return [lanes[0].series[0].t, lanes[0].series[0].low, plan.end([["rest", 2], ["turn", 8]])];
}"""


@DESK
def test_the_plan_lies_beside_what_was_measured(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, width: int
) -> None:
    from playwright.sync_api import expect

    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    (tmp_path / "bench.toml").write_text(FOG_BENCH)
    file, procedure = load_bench_file(tmp_path / "bench.toml"), find_procedure("constant-rotation")
    with EmulatedLab(file, Plant(seed=5)) as lab:
        parameters = procedure.parse({"turns": 2.0, "rate_dps": 12.0, "rest_s": 20.0})
        operator = EmulatedOperator(lab.perform)
        run_procedure(RunRequest(procedure, parameters, lab.file, tmp_path / "runs", operator, run_id="one"))
    panel = Panel(tmp_path / "runs")
    try:
        with browser_page(width) as page:
            page.goto(f"{panel.url}curves?run=one")
            expect(page.get_by_test_id("lanes")).to_have_attribute("data-loaded", "true")
            page.get_by_role("button", name="Show the plan").click()
            expect(page.get_by_role("button", name="Hide the plan")).to_be_visible()
            lane = "window.gyrobenchCurves.chart.data.lanes.find((one) => one.title === 'Table rate').series"
            measured, planned = page.evaluate(f"{lane}.map((one) => [one.id, one.t, one.high])")
            assert (measured[0], planned[0]) == ("one table", "plan table")
            # both stand still, then turn at 12 deg/s, from the same second on and for as long
            began, ended = [], []
            for _, t, high in (measured, planned):
                turning = [
                    time for time, rate in zip(t, high, strict=True) if rate is not None and rate > 11.9
                ]
                began.append(turning[0])
                ended.append(turning[-1])
            assert began[0] == pytest.approx(began[1], abs=2.5) and ended[0] == pytest.approx(
                ended[1], abs=2.5
            )
            assert ended[0] - began[0] == pytest.approx(60.0, abs=5.0)
            assert page.evaluate(MOVED) == [[2, 7, 10, 10, 18], [0, 0, None, 5, 5], 28]
            page.get_by_role("button", name="Hide the plan").click()
            assert page.evaluate(f"{lane}.length") == 1
            assert page.evaluate("document.documentElement.scrollWidth") <= width
    finally:
        panel.kill()
