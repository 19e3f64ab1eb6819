"""A perfect gyro in the logs of an old bench: text named .dat, decimal commas, stamps of a local clock, pulses.

Each habit was met in a log that somebody wrote who did not know how logs are read here.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from datetime import datetime, timedelta
from pathlib import Path

import numpy as np
import pytest

from bench.analysis.gap._data import GapRun
from bench.analysis.gap._import import read_mapped_runs

TICKS_S = 8 * 0.0549254
"""Rows are eight ticks of a PC's clock; stamps are cut to 10 ms."""
LATITUDE_DEG = -36.8
EARTH_UP_DPH = 15.041067 * np.sin(np.radians(LATITUDE_DEG))
ENCODER_DEG = 360.0 / 2**18
MAPPING = """
format = 1
unit_id = "GSD-2"
latitude_deg = {latitude}
[columns]
time = {{ name = "Hora", unit = "s" }}
output = {{ name = "Pulsos", unit = "{output}" }}
t_in = {{ name = "Termistor", unit = "0.05 degC - 60.0" }}
t_out = {{ name = "Caja", unit = "degF"{missing} }}
angle = {{ name = "Mesa", unit = "{encoder!r} deg" }}
{valid}
[[run]]
file = "ESCAL.dat"
elevation_deg = 90.0
"""
CASE_F = 70.8
Cells = dict[str, list[str]]


def _log(first: str = "16-03-2005 13:05:03", set_back_s: float = 0.0, total: bool = False) -> Cells:
    """Cells of an hour: rest, 6 deg/s, -6 deg/s, rest, in rows of eight ticks; a pulse is 1 arcsec, cut off."""
    n = round(3600.0 / TICKS_S)
    edges_s = TICKS_S * np.arange(n + 1)
    fine_s = np.arange(0.0, edges_s[-1] + 1.0, 0.01)
    rate = np.interp(fine_s, [0, 900, 903, 1800, 1806, 2700, 2703, 3600], [0, 0, 6, 6, -6, -6, 0, 0])
    table_deg = np.interp(edges_s, fine_s, np.cumsum(rate) * 0.01)
    pulses = np.floor(3600.0 * table_deg + EARTH_UP_DPH * edges_s)
    stamps = [
        datetime.strptime(first, "%d-%m-%Y %H:%M:%S") + timedelta(seconds=s) for s in edges_s[1:].tolist()
    ]
    late = n // 2
    stamps[late:] = [each - timedelta(seconds=set_back_s) for each in stamps[late:]]
    case = ["" if k % 45 else f"{CASE_F:.1f}".replace(".", ",") for k in range(n)]
    return {
        "Hora": [f"{each:%d-%m-%Y %H:%M:%S},{each.microsecond // 10_000:02d}" for each in stamps],
        "Pulsos": [f"{each:.0f}" for each in (pulses[1:] if total else np.diff(pulses))],
        "Termistor": [f"{1650 + k // 500}" for k in range(n)],
        "Caja": case,
        "Mesa": [f"{int(each) % 2**18}" for each in (table_deg[1:] / ENCODER_DEG)],
        "LZO": ["1"] * n,
    }


def _run(
    folder: Path, cells: Cells, output: str = "arcsec/sample", missing: str = "", valid: str = ""
) -> GapRun:
    rows = [";".join(row) for row in zip(*cells.values(), strict=True)]
    head = ["# GIRO-TEST v2.3   Temp. sala 19,5 °C", ";".join(cells)]
    (folder / "ESCAL.dat").write_text("\n".join([*head, *rows]) + "\n", encoding="cp850")
    text = MAPPING.format(
        latitude=LATITUDE_DEG, output=output, missing=missing, valid=valid, encoder=ENCODER_DEG
    )
    (folder / "runs.toml").write_text(text, encoding="utf-8")
    (run,) = read_mapped_runs(folder / "runs.toml")
    return run


def _offsets_dph(run: GapRun) -> list[float]:
    """Return the mean output beside the true rate at rest, forth, back and at rest."""
    time_s = run.stimulus.time_s
    left = run.output_dph - run.stimulus.input_rate_dph
    parts = ((30.0, 890.0), (910.0, 1790.0), (1815.0, 2690.0), (2715.0, 3580.0))
    return [float(np.nanmean(left[(time_s > start) & (time_s < end)])) for start, end in parts]


def _with_9999(cells: Cells) -> Cells:
    return cells | {"Caja": [each or "9999" for each in cells["Caja"]]}


LOGS: Mapping[str, tuple[Callable[[], Cells], Mapping[str, str]]] = {
    "as it is": (_log, {}),
    "over midnight": (lambda: _log("16-03-2005 23:30:00"), {}),
    "the hour that comes twice": (lambda: _log("12-03-2005 23:29:00", set_back_s=3600.0), {}),
    "a clock set back by 40.07 s": (lambda: _log(set_back_s=40.07), {}),
    "pulses counted since power-on": (lambda: _log(total=True), {"output": "arcsec total"}),
    "9999 for a missing value": (lambda: _with_9999(_log()), {"missing": ", missing = 9999"}),
}


@pytest.mark.parametrize("kind", LOGS)
def test_a_perfect_gyro_in_an_old_log_leaves_nothing(tmp_path: Path, kind: str) -> None:
    """6 deg/s are 21600 deg/h: 10 ppm of the time between rows are 0.2 deg/h."""
    cells, words = LOGS[kind]
    run = _run(tmp_path, cells(), **words)
    assert np.isnan(run.output_dph).mean() < 0.02
    assert _offsets_dph(run) == pytest.approx([0.0] * 4, abs=0.2)
    assert run.stimulus.t_out_c == pytest.approx((CASE_F - 32.0) / 1.8)
    assert run.stimulus.t_in_c[[0, -1]] == pytest.approx([0.05 * 1650 - 60.0, 0.05 * 1666 - 60.0], abs=0.06)
    assert run.stimulus.time_s[-1] == pytest.approx(3600.0, abs=2.0)


def test_a_clock_that_was_set_back_is_said(tmp_path: Path) -> None:
    dates, said = _run(tmp_path, LOGS["the hour that comes twice"][0]()).remarks
    assert dates.startswith("dates are taken as day before month, which they do not show")
    assert said == "the clock was set back by 3600 s before row 4097, taken as going on"


def test_rows_that_are_not_valid_are_not_used(tmp_path: Path) -> None:
    cells = _log()
    for row in range(200, 300):  # the rotor runs up: pulses mean nothing, and a flag says so
        cells["Pulsos"][row] = "500"
        cells["LZO"][row] = "0" if row % 2 else ""
    run = _run(tmp_path, cells, valid='valid = { name = "LZO" }')
    missing = np.isnan(run.output_dph)
    assert missing.sum() * run.stimulus.period_s == pytest.approx(100 * TICKS_S, abs=3.0)
    assert _offsets_dph(run) == pytest.approx([0.0] * 4, abs=0.2)


def test_an_azimuth_error_turns_the_table(tmp_path: Path) -> None:
    """A table whose zero points 37.2 deg off north: level, its Earth rate is that of the angle plus this."""
    cells = {name: column[:1500] for name, column in _log().items()}
    for error_deg in (37.2, -37.2):
        run = _run(tmp_path, cells)
        text = (
            (tmp_path / "runs.toml").read_text("utf-8").replace("elevation_deg = 90.0", "elevation_deg = 0.0")
        )
        (tmp_path / "runs.toml").write_text(text + f"azimuth_error_deg = {error_deg}\n", encoding="utf-8")
        (turned,) = read_mapped_runs(tmp_path / "runs.toml")
        assert turned.stimulus.angle_deg - run.stimulus.angle_deg == pytest.approx(error_deg)
        north = 15.041067 * np.cos(np.radians(LATITUDE_DEG))
        assert turned.stimulus.input_rate_dph[10] == pytest.approx(
            north * np.cos(np.radians(error_deg)), rel=1e-4
        )
