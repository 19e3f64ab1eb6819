"""Curves of a run that goes on: phases, windows and noise against closed forms; zoom, hold, cursor."""

import json
from pathlib import Path
from typing import ClassVar

import numpy as np
import pytest

from bench.analysis.common.allan import allan_deviation
from bench.present.panel._noise import Noise, noise_curve
from bench.present.panel._tails import PhaseTail, history_between
from tests.present.panel.browser import NEEDED, PHONE, Panel, browser_page, write_now


def rows(
    count: int, rate_dph: float = 0.0, sigma_dph: float = 3.6, step_s: float = 1.0, **jitter: float
) -> list[dict]:
    """Return lines of a history: means of a second, white in the rate, at instants that jitter."""
    chance = np.random.default_rng(7)
    time_s = step_s * (np.arange(count) + jitter.get("jitter", 0.0) * chance.uniform(-0.4, 0.4, count))
    means = (rate_dph + sigma_dph * chance.standard_normal(count)) / 3600.0
    return [
        {"time_s": float(t), "rate_dps": 0.0, "air_temp_c": 25.0, "gyros": {"g": [9.0, 30.0, float(mean)]}}
        for t, mean in zip(time_s, means, strict=True)
    ]


class TestNoise:
    def test_white_noise_falls_with_the_root_of_time(self) -> None:
        found = noise_curve("g", rows(3600, rate_dph=20.0))
        assert found is not None and found["tau_s"][:3] == [1.0, 2.0, 4.0] and found["record_s"] == 3599.0
        for tau_s, deviation, low, high in zip(
            *(found[k] for k in ("tau_s", "deviation", "low", "high")), strict=True
        ):
            assert low <= deviation <= high
            if tau_s <= 128.0:
                assert deviation == pytest.approx(3.6 / tau_s**0.5, rel=0.25)
        direct = allan_deviation(np.array([row["gyros"]["g"][2] for row in rows(3600, 20.0)[1:]]), 1.0)
        assert found["deviation"][:8] == pytest.approx(list(3600.0 * direct.deviation[:8]), rel=1e-4)

    def test_lines_at_uneven_times_tell_the_same_where_a_step_holds_several(self) -> None:
        found = noise_curve("g", rows(3600, jitter=1.0))
        assert found is not None
        at = next(k for k, tau_s in enumerate(found["tau_s"]) if tau_s > 12.0)
        assert found["deviation"][at] == pytest.approx(3.6 / found["tau_s"][at] ** 0.5, rel=0.3)

    def test_a_gap_a_turn_and_silence_end_the_stretch(self) -> None:
        every = rows(400)
        for row in every[:100]:
            row["rate_dps"] = 5.0
        assert noise_curve("g", every)["record_s"] == 299.0
        assert noise_curve("g", every[:150] + every[300:])["record_s"] == 99.0
        every[390]["gyros"]["g"] = [None, None, None]
        assert noise_curve("g", every) is None and noise_curve("other", every) is None
        for wrong in ({}, {"gyros": 5}, {"gyros": {"g": 1}}, {"gyros": {"g": [1, 2, "x"]}}):
            assert noise_curve("g", [{"time_s": 1.0, **wrong}] * 50) is None


class Later:
    """A clock that a test sets on."""

    now_s = 0.0

    def __call__(self) -> float:
        return self.now_s


def test_noise_of_a_growing_run_is_that_of_its_last_hour(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Only what has come is read, and what comes out is what the whole hour gives; another run begins anew."""
    clock = Later()
    monkeypatch.setattr("bench.present.panel._noise.host_seconds", clock)
    every = rows(5400)
    noise = Noise(tmp_path)
    for last in (40, 900, 901, 3000, 5399):
        write_history(tmp_path, every[: last + 1])
        clock.now_s += 10.0
        noise.update(float(last))
        assert noise.curves == [noise_curve("g", every[max(0, last - 3600) : last + 1])]
    clock.now_s += 9.0
    write_history(tmp_path, every[:100])
    noise.update(99.0)
    assert noise.curves[0]["record_s"] == 3600.0  # not due
    clock.now_s += 1.0
    noise.update(99.0)
    assert noise.curves == [noise_curve("g", every[:100])]


def write_history(run: Path, lines: list[dict]) -> None:
    (run / "live").mkdir(parents=True, exist_ok=True)
    (run / "live" / "history.jsonl").write_text("".join(json.dumps(line) + "\n" for line in lines))


def test_a_window_is_found_by_halving_and_is_whole(tmp_path: Path) -> None:
    write_history(tmp_path, rows(20_000))
    found = history_between(tmp_path, 4999.5, 5100.0)
    assert [row["time_s"] for row in found] == [float(k) for k in range(5000, 5101)]
    assert [row["time_s"] for row in history_between(tmp_path, -5.0, 2.0)] == [0.0, 1.0, 2.0]
    assert [row["time_s"] for row in history_between(tmp_path, 19_998.0, 1e9)] == [19_998.0, 19_999.0]
    assert (
        len(history_between(tmp_path, 0.0, 1e9)) > 1000 and history_between(tmp_path / "none", 0.0, 1.0) == []
    )
    with (tmp_path / "live" / "history.jsonl").open("a") as file:
        file.write('{"time_s": "x"}\n[]\n{"time_s": 20')
    assert [row["time_s"] for row in history_between(tmp_path, 19_998.5, 1e9)] == [19_999.0]


def test_phases_are_read_as_they_come_and_malformed_ones_are_none(tmp_path: Path) -> None:
    events = tmp_path / "events.jsonl"
    wrong = [
        {"kind": "phase"},
        {"kind": "phase", "phase": 5, "time_s": 1},
        {"kind": "phase", "phase": "x", "time_s": 1e99},
    ]
    good = {"kind": "phase", "phase": "warm_up", "time_s": 3}
    events.write_text(
        "".join(json.dumps(row) + "\n" for row in [*wrong, good, {"kind": "note", "time_s": 4}])
    )
    tail = PhaseTail(tmp_path)
    tail.update()
    assert tail.phases == [("warm_up", 3.0)]
    with events.open("a") as file:
        file.write(json.dumps(good | {"phase": "soak", "time_s": 9}) + "\n")
    tail.update()
    assert tail.phases == [("warm_up", 3.0), ("soak", 9.0)]


@PHONE
class TestInABrowser:
    pytestmark: ClassVar = [*NEEDED, pytest.mark.concurrent]

    def test_curves_are_held_zoomed_shown_by_phase_and_read_off(self, tmp_path: Path, width: int) -> None:
        from playwright.sync_api import expect

        runs = tmp_path / "runs"
        run = runs / "day"
        lines = rows(7200)
        for second, line in enumerate(lines):
            line |= {"set_point_c": 25.0, "air_temp_c": 70.0 if second == 5000 else 25.0}
            line["gyros"] |= {"mems": [200.0, 31.0, 10.0 * line["gyros"]["g"][2]]}
        write_history(run, lines)
        phases = [
            {"kind": "phase", "phase": name, "time_s": t}
            for name, t in (("warm_up", 0.0), ("soak_<i>", 4900.0))
        ]
        (run / "events.jsonl").write_text("".join(json.dumps(row) + "\n" for row in phases))

        def now(time_s: float) -> None:
            gyros = {
                name: {"latest_dps": rate, "rate_dps": rate, "temp_c": 30.0, "age_s": 0.1, "stale": False}
                for name, rate in (("g", 0.001), ("mems", 200.0))
            }
            about = {"folder": str(run.resolve()), "run_id": "day", "units": {"g": "A", "mems": "B"}}
            chamber = {"air_temp_c": 25.0, "set_point_c": 25.0, "age_s": 0.1, "stale": False}
            write_now(
                run,
                "day",
                run=about,
                time_s=time_s,
                gyros=gyros,
                chamber=chamber,
                table={"rate_dps": 0.0, "stale": False},
            )

        now(7200.0)
        panel = Panel(runs)
        try:
            with browser_page(width) as page:
                wrong: list[str] = []
                page.on("pageerror", lambda error: wrong.append(str(error)))
                page.goto(panel.url)
                page.wait_for_function(
                    "window.gyrobench?.rows() > 20 && document.querySelector('[data-lanes] canvas')"
                )
                titles = "window.gyrobench.chart().data.lanes.map(lane => lane.title)"
                assert page.evaluate(titles) == ["Temperature", "g", "mems", "Table rate"]

                # by phase, in finer steps than the day's: the spike of one second is read off where it was
                page.get_by_label("Show a phase").select_option(label="soak <i>")
                page.wait_for_function("window.gyrobench.held()?.[0] === 4900")
                finer = "window.gyrobench.chart().data.lanes[0].series[0]"
                page.wait_for_function(f"{finer}.t.filter(t => t > 4900).length > 700")
                spike = page.evaluate(f"{finer}.t[{finer}.high.findIndex(y => y === 70)]")
                assert spike == pytest.approx(5000.0, abs=3.0)
                page.evaluate(f"window.gyrobench.chart().point({spike})")
                expect(page.locator(".reading")).to_contain_text("70 °C")
                expect(page.locator(".reading")).to_contain_text("1:23:2")
                expect(page.locator(".reading")).to_contain_text("mems 200 °/s")

                # held: the run goes on, the curves stand, and the page says so; then they follow again
                now(7300.0)
                expect(page.locator("[data-held]")).to_contain_text("the run is at 2:01:40")
                assert page.evaluate("window.gyrobench.held()[0]") == 4900
                page.get_by_role("button", name="Follow the run").click()
                page.wait_for_function(
                    "window.gyrobench.held() === null && window.gyrobench.chart().data.to >= 7300"
                )
                page.get_by_role("button", name="Hold the curves").click()
                page.get_by_role("button", name="Zoom in").click()
                page.wait_for_function(
                    "(([low, high]) => high - low < 3700 && high - low > 3600)(window.gyrobench.held())"
                )

                # noise of each gyro, in its own table row
                expect(page.locator("[data-noise-words] tbody tr")).to_have_count(2)
                first = page.locator("[data-noise-words] tbody tr").first
                expect(first).to_contain_text("g")
                expect(first).to_contain_text("°/h")
                assert page.evaluate("window.gyrobenchNoise.curves()[0].deviation[0]") == pytest.approx(
                    3.6, rel=0.1
                )
                assert page.evaluate("document.documentElement.scrollWidth") <= width
                assert wrong == []
        finally:
            panel.kill()
