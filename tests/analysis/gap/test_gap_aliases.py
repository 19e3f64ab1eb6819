"""A line faster than the means: it is named where the log has it, its alias is not stated as a fact."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from bench.analysis.gap import diagnose, read_model, read_recordings

RATE, ROWS = 50.0, 60_000


@pytest.mark.parametrize("at_hz", [9.185, 0.185])
def test_a_line_is_told_where_the_rows_have_it(tmp_path: Path, at_hz: float) -> None:
    time = np.arange(ROWS) / RATE
    size_dph = 3600.0 / abs(np.sinc(at_hz))  # what 1 s means leave of it is the same for both
    noise = 36.0 * np.random.default_rng(9).standard_normal(ROWS)
    rate = (size_dph * np.sin(2 * np.pi * at_hz * time) + noise) / 3600.0
    np.savetxt(tmp_path / "log.csv", np.column_stack([time, rate]), "%.9g", ",", header="t,rate", comments="")
    (tmp_path / "map.toml").write_text(
        'format = 1\nunit_id = "u"\nlatitude_deg = 0\n[columns]\ntime = { name = "t", unit = "s" }\n'
        'output = { name = "rate", unit = "deg/s" }\n[[run]]\nfile = "log.csv"\n'
    )
    (tmp_path / "nominal.toml").write_text("format = 1\n[noise]\narw_deg_per_sqrt_h = 0.085\n")
    found = diagnose(read_recordings([tmp_path / "map.toml"]).runs, read_model(tmp_path / "nominal.toml"))
    assert found.fast is not None
    if at_hz > 0.5:
        assert [line.frequency_hz for line in found.fast.lines] == [pytest.approx(at_hz, abs=0.03)]
        assert not found.rate.stochastic and not any("Hz" in warning for warning in found.rate.warnings)
    else:
        assert not found.fast.lines and set(found.rate.stochastic) == {"vibration_or_mains_line"}
        assert any("is at 0.185 Hz" in warning for warning in found.rate.warnings), found.rate.warnings
