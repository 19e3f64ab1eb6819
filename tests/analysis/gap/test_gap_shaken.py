"""Quantisation and a shaken base have one spectrum: the steps in the log tell them apart."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from bench.analysis.gap import diagnose, read_model, read_recordings

RATE, QUANTUM = 10.0, 30.0
"""Samples a second, arcsec."""


@pytest.mark.parametrize("quantised", [True, False])
def test_noise_of_the_angle_is_quantisation_only_if_the_log_has_its_steps(
    tmp_path: Path, quantised: bool
) -> None:
    rng = np.random.default_rng(3)
    rows = 20_000
    angle = 3600.0 * np.cumsum(317.3 / 3600.0 / RATE + 4e-4 * rng.standard_normal(rows))  # arcsec
    shaken = angle + QUANTUM / np.sqrt(12) * rng.standard_normal(rows)
    read = QUANTUM * np.floor(angle / QUANTUM) if quantised else shaken
    rate_dps = np.diff(read, prepend=0.0) * RATE / 3600.0
    table = np.column_stack([np.arange(rows) / RATE, rate_dps])
    np.savetxt(tmp_path / "log.csv", table, "%.9g", ",", header="t,rate", comments="")
    (tmp_path / "map.toml").write_text(
        'format = 1\nunit_id = "u"\nlatitude_deg = 0\n[columns]\ntime = { name = "t", unit = "s" }\n'
        'output = { name = "rate", unit = "deg/s" }\n[[run]]\nfile = "log.csv"\n'
    )
    (tmp_path / "nominal.toml").write_text("format = 1\n[noise]\narw_deg_per_sqrt_h = 0.0759\n")
    found = diagnose(
        read_recordings([tmp_path / "map.toml"]).runs, read_model(tmp_path / "nominal.toml")
    ).rate
    told = " ".join(part.sentence for part in found.unknown_parts)
    if quantised:
        assert set(found.stochastic) == {"quantisation"} and "shakes" not in told
    else:
        assert "quantisation" not in found.stochastic and found.verdict == "unknown" and "shakes" in told
