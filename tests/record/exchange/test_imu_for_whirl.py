"""A rotating INS that another bench logged: imported, its whirl is fitted."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from bench.analysis.whirl import study_whirl_runs
from bench.record.exchange import import_log
from bench.record.recording import Run

ARCSEC = np.pi / 180.0 / 3600.0
MAPPING = """
format = 1
unit_id = "RINS"
latitude_deg = 45.0
[columns]
time = { name = "t", unit = "s" }
angle = { name = "enc", unit = "0.001 deg" }
[columns.gyros]
x = { name = "gx", unit = "arcsec/sample" }
y = { name = "gy", unit = "arcsec/sample" }
z = { name = "gz", unit = "arcsec/sample" }
[[run]]
profile = "rotation"
"""


def log(folder: Path) -> Path:
    """10 Hz: 9 deg/s there and back, five turns each; the axis leans by 3 arcsec twice a turn, exp(2 i angle)."""
    period_s, sub = 0.1, 20
    fine_s = period_s / sub
    rate = np.radians(9.0) * np.concatenate([np.zeros(600 * sub), np.full(2000 * sub, 1.0), np.zeros(300 * sub),
                                             np.full(2000 * sub, -1.0), np.zeros(600 * sub)])  # fmt: skip
    angle = np.concatenate(([0.0], np.cumsum(rate) * fine_s))
    lean = 3.0 * ARCSEC * np.exp(2j * angle)
    # in body axes the gyros feel how the lean changes; of the turn about the leaning axis they feel z alone
    body = np.diff(lean) / fine_s * np.exp(-0.5j * (angle[1:] + angle[:-1]))
    rates = np.column_stack((body.real, body.imag, rate))
    means = rates.reshape(-1, sub, 3).mean(axis=1) / ARCSEC * period_s
    means += np.random.default_rng(1).normal(0.0, 0.002, means.shape)
    time_s = period_s * np.arange(1, len(means) + 1)
    encoder = np.round(1000.0 * np.degrees(angle[sub::sub]) % 360_000.0)
    rows = np.column_stack((time_s, encoder, means))
    np.savetxt(folder / "w.csv", rows, "%.6f", ",", header="t,enc,gx,gy,gz", comments="")
    (folder / "map.toml").write_text(MAPPING)
    return import_log(folder / "w.csv", folder / "map.toml", folder / "runs")


def test_the_whirl_of_an_imported_log_is_fitted(tmp_path: Path) -> None:
    folder = log(tmp_path)
    study = study_whirl_runs([Run.open(folder)], [], None, gauge="mean", installation_arcsec=None, bases=())
    size = dict(zip(study.fit.lines, np.abs(study.fit.amplitudes_arcsec), strict=True))
    assert size[2] == pytest.approx(3.0, abs=0.05)
    assert max(value for line, value in size.items() if line not in (1, 2)) < 0.2


def test_an_encoders_rows_are_kept(tmp_path: Path) -> None:
    run = Run.open(log(tmp_path))
    table = run.turntable()
    assert len(table["time_ns"]) == 5500
    turning = (table["time_ns"] > 65e9) & (table["time_ns"] < 255e9)
    assert np.diff(np.unwrap(table["angle_deg"][turning], period=360.0)) == pytest.approx(0.9, abs=0.002)
    assert table["rate_dps"][turning] == pytest.approx(9.0, abs=0.05)
