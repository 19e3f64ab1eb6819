"""Ramp runs of three emulated ring lasers, made once a session."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from bench.analysis.rlg import RampRun
from bench.analysis.rlg._rows import ramp_run
from benchmarks._rlg_runs import ramp_profile, rlg_run

PROFILES = {
    "train": {},
    "repeat": {},
    "reverse": {"downwards": True},
    "faster": {"ramp_k_per_min": 1.0},
    "partial": {"low_c": -20.0, "high_c": 50.0},
}


def emulated(unit_seed: int, kind: str, run_seed: int) -> RampRun:
    """One run of a unit, from the first ramp on."""
    data = rlg_run(ramp_profile(**PROFILES[kind]), unit_seed=unit_seed, run_seed=run_seed)
    first = 3600
    return ramp_run(
        f"{kind}-{run_seed}",
        f"RLG-{unit_seed}",
        data.time_s[first:],
        data.case_c[first:],
        data.block_c[first:],
        data.bias_dph[first:],
        true_bias_dph=data.true_bias_dph[first:],
        checksum=f"{unit_seed}/{kind}/{run_seed}",
        kind=kind,
    )


@pytest.fixture(scope="session")
def runs() -> Callable[[int], dict[str, RampRun]]:
    """Return a function: unit seed -> its five runs by kind, each with noise and turn-on of its own."""
    made: dict[int, dict[str, RampRun]] = {}

    def of(unit_seed: int) -> dict[str, RampRun]:
        if unit_seed not in made:
            made[unit_seed] = {kind: emulated(unit_seed, kind, n) for n, kind in enumerate(PROFILES, start=1)}
        return made[unit_seed]

    return of
