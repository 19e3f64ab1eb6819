"""Small made-up runs for tests of single parts, and one examined case shared by several tests."""

from __future__ import annotations

import numpy as np
import pytest

from bench.analysis.gap import Model, Noise, Term
from bench.analysis.gap._data import GapRun
from bench.analysis.gap._exam import nominal_model
from simulators.effects import Effect, Stimulus, Variant, catalogue


def effect(name: str) -> Effect:
    found = catalogue()[name]
    assert isinstance(found, Effect)
    return found


def stimulus(
    n: int = 4000, *, rate_dps: float = 0.0, elevation_deg: float = 90.0, cold: bool = True
) -> Stimulus:
    time_s = np.arange(1.0, n + 1.0)
    profile = np.interp(time_s, [0, n // 4, n // 3, 2 * n // 3, 3 * n // 4], [25.0, 25.0, -40.0, -40.0, 25.0])
    t_out = profile if cold else np.full(n, 25.0)
    base = Stimulus(time_s, t_out, t_out, np.zeros(n + 1), np.zeros(n), 39.1)
    t_in = base.lagged(base.lagged(t_out, 150.0), 80.0)
    angle = 10.0 + rate_dps * np.arange(n + 1.0)
    return Stimulus(time_s, t_in, t_out, angle, np.full(n, elevation_deg), 39.1)


def made_run(
    name: str,
    s: Stimulus,
    rng: np.random.Generator,
    extra: np.ndarray | None = None,
    *,
    profile: str = "shock",
    condition: str = "0",
) -> GapRun:
    """White noise of 0.004 deg/sqrt(h) and a turn-on bias on the true input rate."""
    output = s.input_rate_dph + rng.normal(0.0, 0.24, len(s)) + rng.normal(0.0, 0.1)
    if extra is not None:
        output = output + extra
    phase = np.where(np.arange(len(s)) < len(s) // 4, "room", "shock")
    return GapRun(name, "unit 1", profile, condition, s, output, phase, checksum=f"sum of {name}")


@pytest.fixture
def nominal() -> Model:
    whole = nominal_model()
    return Model("nominal", whole.terms, Noise(0.004))


@pytest.fixture
def term() -> Term:
    return Term(Variant(effect("shupe"), {"lag_s": 180.0}), (0.1234567890123, -0.25), (0.01, 0.02))
