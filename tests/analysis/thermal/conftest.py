"""The campaign all models are judged on: cold shocks of one emulated unit, made once a session."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest

from bench.analysis.thermal import ThermalRun
from bench.analysis.thermal._scale_factor import RateRun, scale_factor_group
from benchmarks._thermal_runs import ThermalRunData, cold_shock

RATE_DPS = 20.0
UNIT_ID = "fog-mid-0"


@dataclass(frozen=True)
class Campaign:
    """Runs of one unit: 4 bias runs and 3 scale-factor groups to train on, one of each to choose by, and tests.

    Tests, by run_id: bias runs nominal, deeper, faster, short_soak, cool_room, slow, double; scale-factor groups
    nominal_sf, deeper_sf, faster_sf, cool_room_sf, slow_sf. Every run has noise of its own and carries its truth.
    """

    train: list[ThermalRun]
    validation: list[ThermalRun]
    tests: list[ThermalRun]


TRAIN = {
    "train_1": {"cold_c": -41.0, "ramp_k_per_min": 11.0, "soak_min": 60.0, "room_c": 25.0},
    "train_2": {"cold_c": -45.0, "ramp_k_per_min": 12.0, "soak_min": 90.0, "room_c": 23.0},
    "train_3": {"cold_c": -50.0, "ramp_k_per_min": 13.0, "soak_min": 60.0, "room_c": 25.0},
    "train_4": {"cold_c": -42.0, "ramp_k_per_min": 15.0, "soak_min": 45.0, "room_c": 27.0},
}
TRAIN_SF = ("train_1", "train_2", "train_3")
VALIDATION = {"validation": {"cold_c": -46.0, "ramp_k_per_min": 12.0, "soak_min": 75.0, "room_c": 25.0}}
TESTS: dict[str, dict[str, Any]] = {
    "nominal": {},
    "deeper": {"cold_c": -55.0},
    "faster": {"ramp_k_per_min": 18.0},
    "short_soak": {"soak_min": 20.0},
    "cool_room": {"soak_min": 150.0, "room_c": 18.0},
    "slow": {"ramp_k_per_min": 3.0},
    "double": {"soak_min": 45.0},
}
TESTS_SF = ("nominal", "deeper", "faster", "cool_room", "slow")


@pytest.fixture(scope="session")
def campaign() -> Campaign:
    """Return the campaign, about 40 simulated runs."""
    seeds = iter(range(1, 1000))
    return Campaign(
        train=[_bias_run(name, TRAIN[name], seeds) for name in TRAIN]
        + [_scale_factor_run(name, TRAIN[name], seeds) for name in TRAIN_SF],
        validation=[_bias_run(name, VALIDATION[name], seeds) for name in VALIDATION]
        + [_scale_factor_run(name, VALIDATION[name], seeds) for name in VALIDATION],
        tests=[_bias_run(name, TESTS[name], seeds) for name in TESTS]
        + [_scale_factor_run(name, TESTS[name], seeds) for name in TESTS_SF],
    )


def _simulate(name: str, profile: dict[str, Any], seeds: Any, **setup: Any) -> ThermalRunData:
    return cold_shock(**profile, run_seed=next(seeds), shocks=2 if name == "double" else 1, **setup)


def _bias_run(name: str, profile: dict[str, Any], seeds: Any) -> ThermalRun:
    data = _simulate(name, profile, seeds)
    return ThermalRun(
        run_id=name,
        unit_id=UNIT_ID,
        time_s=data.time_s,
        gyro_temp_c=data.t_in_c,
        case_temp_c=data.t_out_c,
        bias_dph=data.bias_dph,
        sf_error_ppm=None,
        reference=data.reference_s,
        phases=_phases(data),
        true_bias_dph=data.true_bias_dph,
    )


def _scale_factor_run(name: str, profile: dict[str, Any], seeds: Any) -> ThermalRun:
    runs = []
    for rate_dps in (RATE_DPS, -RATE_DPS, 0.0):
        data = _simulate(name, profile, seeds, rate_dps=rate_dps, mounting="axis_up")
        runs.append(
            RateRun(
                run_id=f"{name}_sf",
                unit_id=UNIT_ID,
                rate_dps=rate_dps,
                time_s=data.time_s,
                gyro_temp_c=data.t_in_c,
                case_temp_c=data.t_out_c,
                output_dps=data.rate_dps,
                reference=data.reference_s,
                phases=_phases(data),
                true_sf_error_ppm=data.true_sf_error_ppm,
            )
        )
    group = scale_factor_group(runs)
    return ThermalRun(**{**vars(group), "run_id": f"{name}_sf"})


def _phases(data: ThermalRunData) -> list[tuple[float, str]]:
    starts = np.flatnonzero(np.concatenate(([True], data.phase[1:] != data.phase[:-1])))
    return [(float(data.time_s[k]) - 1.0, str(data.phase[k])) for k in starts]
