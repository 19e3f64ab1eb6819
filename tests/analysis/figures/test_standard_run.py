"""Figures from a run folder whose gyro is known in closed form; the plan of the procedure; the report."""

from __future__ import annotations

import json
from pathlib import Path
from unittest.mock import MagicMock

import numpy as np
import pytest

from bench.analysis.figures import Figure, StandardFigures, figures_over_runs, standard_figures
from bench.present.report import render_page, standard_test_page
from bench.record.benchfile import BenchSection
from bench.record.figure_limits import FIGURES, FURTHER, OVER_RUNS
from bench.record.recording import Manifest, write_manifest
from bench.record.recording._tables import table_writer
from drivers.base.errors import ConfigurationError
from procedures.standard_test import PROCEDURE

LATITUDE, EARTH = np.radians(39.1), 15.041067
BIAS, N, SF_PPM, ASYMMETRY_PPM = 0.05, 0.004, 10.0, 20.0
BIAS_PER_K, SF_PER_K = 1e-3, 5.0


class Script:
    """Builds a run: 1 s of truth at a time, and the intervals."""

    def __init__(self) -> None:
        self.angle: list[float] = []
        self.rate: list[float] = []
        self.temp: list[float] = []
        self.up: list[bool] = []
        self.events: list[dict] = []

    def interval(self, test: str, seconds: int, *, angle: float = 90.0, rate: float = 0.0, temp: float = 25.0,
                 up: bool = False, **fields: float) -> None:  # fmt: skip
        start = len(self.angle)
        self.angle += [angle + rate * (k + 0.5) for k in range(seconds)]
        self.rate += [rate] * seconds
        self.temp += [temp] * seconds
        self.up += [up] * seconds
        row = {
            "time_s": start + seconds,
            "kind": "interval",
            "test": test,
            "start_s": start,
            "end_s": start + seconds,
        }
        self.events.append(row | fields)

    def write(self, folder: Path, seed: int, turn_on_dph: float = 0.0) -> Path:
        folder.mkdir()
        angle, rate, temp, up = (np.array(column) for column in (self.angle, self.rate, self.temp, self.up))
        time_ns = ((np.arange(len(angle)) + 0.5) * 1e9).astype(np.int64)
        earth = EARTH * np.where(up, np.sin(LATITUDE), np.cos(LATITUDE) * np.cos(np.radians(angle)))
        sf = 1 + 1e-6 * (SF_PPM + 0.5 * ASYMMETRY_PPM * np.sign(rate) + SF_PER_K * (temp - 25.0))
        noise = N * 60.0 * np.random.default_rng(seed).standard_normal(len(angle))
        output = (3600.0 * rate * up + earth) * sf + BIAS + turn_on_dph + BIAS_PER_K * (temp - 25.0) + noise
        with table_writer(folder / "gyro_g.parquet", "gyro") as writer:
            valid = np.ones(len(angle), dtype=np.bool_)
            writer.write({"time_ns": time_ns, "valid": valid, "rate_dps": output / 3600.0, "temp_c": temp})
        with table_writer(folder / "turntable.parquet", "table") as writer:
            writer.write({"time_ns": time_ns, "angle_deg": angle % 360.0, "rate_dps": rate})
        text = "".join(json.dumps(event) + "\n" for event in self.events)
        (folder / "events.jsonl").write_text(text)
        manifest = Manifest(
            run_id=folder.name,
            procedure="standard-test",
            started_utc="2026-01-01T00:00:00.000+00:00",
            bench={"bench": {"name": "b", "latitude_deg": 39.1}},
            units={"g": "U-1"},
            outcome="completed",
        )
        write_manifest(folder, manifest)
        return folder


def plan(*, temperatures: bool = True) -> Script:
    script = Script()
    script.interval("warm_up", 1800)
    script.interval("bias", 7200, cycle=0)
    script.interval("noise", 20_000)
    horizontal = EARTH * np.cos(LATITUDE)
    for test, base in (("threshold", 90.0), ("resolution", 135.0)):
        for number, step in enumerate((0.02, 0.2, 0.4)):
            there = np.degrees(np.arcsin(np.sin(np.radians(base - 90.0)) + step / horizontal)) + 90.0
            for sense, angle in ((0, base), (1, there), (0, base)):
                script.interval(test, 900, angle=angle, step=number, input_dph=-sense * step)
    for sequence in (1, 2):
        for rate in (0.0, 10.0, 20.0, 10.0, 0.0, -10.0, -20.0, -10.0, 0.0):
            script.interval("scale_factor", 3600, rate=rate, up=True, sequence=sequence, rate_dps=rate)
    for temp in (25.0, -40.0, 60.0) if temperatures else ():
        for rate in (0.0, 20.0, -20.0):
            script.interval("temperature", 3600, rate=rate, up=True, temp=temp, rate_dps=rate, temp_c=temp)
    return script


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return plan().write(tmp_path_factory.mktemp("runs") / "one", seed=1)


def test_every_figure_is_that_of_the_gyro(folder: Path) -> None:
    figures = standard_figures(folder)
    white = N * 60.0
    assert figures.value("bias") == pytest.approx(BIAS, abs=4 * white / 7200**0.5)
    assert figures.value("bias stability, 10 s averages") == pytest.approx(18.97 * N, rel=0.1)
    assert figures.value("bias stability, 100 s averages") == pytest.approx(6.0 * N, rel=0.25)
    assert figures.value("scale factor") == pytest.approx(1 + SF_PPM * 1e-6, abs=1e-6)
    assert figures.value("scale-factor asymmetry") == pytest.approx(ASYMMETRY_PPM, abs=1.0)
    assert figures.value("scale-factor repeatability") < 0.3
    # At 65 K from the reference the biases differ by 0.065 deg/h, the scale factors by 325 ppm.
    assert figures.value("bias temperature sensitivity") == pytest.approx(BIAS_PER_K, rel=0.2)
    assert figures.value("scale-factor temperature sensitivity") == pytest.approx(SF_PER_K, rel=0.02)
    assert figures.value("threshold") in (0.02, 0.2) and figures.value("resolution") in (0.02, 0.2)
    for figure in figures.figures:
        if figure.name in ("threshold", "resolution"):
            assert figure.source.endswith("no smaller one was put in") == (figure.value == 0.02)
    arw = next(figure for figure in figures.figures if figure.name == "angle random walk")
    assert arw.low is not None and arw.high is not None
    assert arw.low < arw.value < arw.high and arw.value == pytest.approx(N, rel=0.05)
    assert [what for what, _ in figures.missing] == ["misalignment"]


def test_what_was_not_measured_is_missing_with_a_reason(tmp_path: Path) -> None:
    figures = standard_figures(plan(temperatures=False).write(tmp_path / "short", seed=2))
    reasons = dict(figures.missing)
    assert set(reasons) == {"misalignment", "temperature sensitivity"}
    assert "no interval of temperature" in reasons["temperature sensitivity"]
    page = render_page(standard_test_page([figures], created_utc="2026-01-02T03:04:05.000+00:00"))
    assert "Incomplete" in page and "no interval of temperature" in page and "<svg" in page
    assert "angle random walk" in page and "GJB 2426A" in page
    # a time base of 50 ppm allows no digit more
    assert "1.00001" in page and f"{figures.value('scale factor'):.7f}" not in page
    assert "time base ppm" in page and "Satterthwaite" in page
    with pytest.raises(ConfigurationError, match="no standard test"):
        standard_figures(tmp_path / "short", "other")


def test_repeatability_over_power_ons(tmp_path: Path, folder: Path) -> None:
    other = plan(temperatures=False).write(tmp_path / "two", seed=3, turn_on_dph=0.2)
    results = [standard_figures(folder), standard_figures(other)]
    found = {figure.name: figure for figure in figures_over_runs(results)}
    assert found["bias repeatability"].value == pytest.approx(0.2 / np.sqrt(2), rel=0.1)
    assert found["scale-factor repeatability between runs"].value < 1.0


def test_what_a_run_says_it_measures_is_what_its_figures_are(tmp_path: Path, folder: Path) -> None:
    """Else `campaign plan` warns of limits without reason, or keeps silent where a unit can never pass."""
    known = {**FIGURES, **FURTHER}
    for temperatures in (True, False):
        run = folder if temperatures else plan(temperatures=False).write(tmp_path / "short", seed=4)
        values = PROCEDURE.parse({"temperatures": temperatures, "power_cycles": 0})
        measured = {figure.name for figure in standard_figures(run).figures}
        # this script turns neither for the misalignment nor long enough for a warm-up of its own
        extra = {name for name in known if name.startswith("input-axis")} | {"warm-up time to 3 s_100"}
        assert set(PROCEDURE.figures(values)) - extra == measured - extra and measured <= known.keys()
    assert set(PROCEDURE.figures(PROCEDURE.parse({}))) | set(OVER_RUNS) == known.keys()
    assert {figure.name for figure in figures_over_runs([standard_figures(run)] * 2)} == set(OVER_RUNS)


@pytest.mark.parametrize(("grade", "searched"), [("fog", 1), ("mems", 0)])
def test_a_noisy_grade_takes_east_as_mounted(
    grade: str, searched: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    bench, found = MagicMock(), MagicMock()
    bench.file.bench = BenchSection(name="b", latitude_deg=39.1)
    found.return_value = 91.0
    monkeypatch.setattr("procedures.standard_test.find_east", found)
    settings = {"grade": grade, "power_cycles": "0", "temperatures": "false", "azimuth_deg": "80"}
    PROCEDURE.run(bench, PROCEDURE.parse(settings))
    assert found.call_count == searched
    pointed = [call.args[0] for call in bench.table.point.call_args_list]
    assert pointed[0] == 80.0 and pointed[1] == (91.0 if searched else 80.0)


def test_a_run_without_a_figure_takes_no_part_in_its_repeatability() -> None:
    def result(**values: float) -> StandardFigures:
        figures = tuple(Figure(name.replace("_", " "), value, "", "") for name, value in values.items())
        return StandardFigures("r", "u", "g", figures, (), None, None)

    runs = [result(bias=1.0, other=9.0), result(other=9.0), result(bias=1.4), result(scale_factor=1.0)]
    (figure,) = figures_over_runs(runs)
    assert (figure.name, figure.unit) == ("bias repeatability", "deg/h")
    assert figure.value == pytest.approx(0.4 / np.sqrt(2.0))  # the standard deviation of two
    ppm = figures_over_runs([result(scale_factor=2.0), result(scale_factor=2.0 + 4e-5)])[0]
    assert ppm.value == pytest.approx(20.0 / np.sqrt(2.0), rel=1e-4)
