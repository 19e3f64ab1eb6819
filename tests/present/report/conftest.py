"""A campaign of realistic size and magnitude, made of plain arrays: what the report's tests render."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from bench.present.report import render_page
from bench.present.report._campaign import campaign_page
from bench.present.report._content import (
    CampaignContent,
    Comparison,
    CompensationSummary,
    Device,
    Measurement,
    ModelScore,
    RunContent,
    RunSummary,
    StreamStatistics,
    Trace,
    ValidRange,
)

FLOOR_DPH = 0.0241
PHASES = (
    (0.0, "warm_up"),
    (1500.0, "axis_east"),
    (3420.0, "equilibrium"),
    (4100.0, "reference"),
    (5900.0, "shock"),
    (6262.0, "soak"),
    (10762.0, "return"),
    (11400.0, "final_equilibrium"),
)
HELD_OUT = (
    ("nominal", -45.0, 0.1331, 81.1),
    ("deeper, −55 °C", -55.0, 0.1487, 82.8),
    ("faster, 18 K/min", -45.0, 0.1362, 81.4),
    ("short soak", -45.0, 0.0913, 71.9),
    ("cool room, 18 °C", -45.0, 0.1184, 77.8),
    ("slow ramp, 3 K/min", -45.0, 0.1221, 81.2),
    ("double shock", -45.0, 0.1129, 75.8),
)
IMPROVEMENTS = {
    "grey_box": (81.2, 81.1, 80.7, 72.7, 76.3, 80.7, 75.2),
    "hybrid": (80.9, 81.4, 79.8, 70.4, 74.8, 81.0, 73.9),
    "lag_ridge": (80.6, 79.7, 78.1, 68.7, 73.6, 79.2, 72.6),
    "lstm": (80.1, 73.0, 76.3, 66.3, 50.2, 70.0, 70.1),
    "poly3": (56.8, 52.6, 54.5, 46.1, 44.6, 61.9, 51.7),
    "lag_ridge_other_unit": (12.0, -48.3, 31.0, 5.0, -237.4, 22.0, 8.0),
}


def lagged(values: np.ndarray, tau_s: float, step_s: float) -> np.ndarray:
    """First-order lag of a curve on a uniform grid."""
    out = np.empty_like(values)
    state, gain = values[0], 1.0 - np.exp(-step_s / tau_s)
    for at, value in enumerate(values):
        state += gain * (value - state)
        out[at] = state
    return out


def trace_of(run_id: str, cold_c: float = -45.0, seed: int = 0) -> Trace:
    """A cold shock as chamber and gyro see it, 1 s telemetry, 100 s means of the output."""
    time_s = np.arange(0.0, 16000.0)
    room = 25.0
    set_point = np.interp(
        time_s, [0, 5900, 6260, 10760, 11120, 16000], [room, room, cold_c, cold_c, room, room]
    )
    rng = np.random.default_rng(seed)
    air = lagged(set_point, 40.0, 1.0) + rng.normal(0.0, 0.05, len(time_s))
    case = lagged(air, 420.0, 1.0)
    gyro = lagged(case, 500.0, 1.0)
    drift = drift_of(gyro)
    blocks = drift[: len(drift) // 100 * 100].reshape(-1, 100).mean(axis=1)
    return Trace(
        run_id=run_id,
        gyro="fog_1",
        time_s=time_s,
        phases=PHASES,
        air_temp_c=air,
        set_point_c=set_point,
        case_temp_c=case,
        gyro_temp_c=gyro,
        output_time_s=np.arange(50.0, 100.0 * len(blocks), 100.0),
        output_dph=blocks + rng.normal(0.0, FLOOR_DPH, len(blocks)),
        output_name="Output",
    )


def drift_of(gyro_c: np.ndarray) -> np.ndarray:
    """Bias drift in deg/h, peak to peak about 0.47: a static part and one that goes with the slope."""
    slope = np.gradient(gyro_c) * 60.0
    u = (gyro_c - 25.0) / 50.0
    drift: np.ndarray = 0.09 * u - 0.05 * u**2 - 0.06 * slope
    return drift


def comparison_of(run_id: str, kind: str, cold_c: float, seed: int) -> Comparison:
    trace = trace_of(run_id, cold_c, seed)
    assert trace.gyro_temp_c is not None
    rng = np.random.default_rng(seed + 100)
    time_s = np.arange(50.0, 16000.0, 100.0)
    gyro = np.interp(time_s, trace.time_s, trace.gyro_temp_c)
    drift = np.interp(time_s, trace.time_s, drift_of(trace.gyro_temp_c))
    noise = rng.normal(0.0, FLOOR_DPH, len(time_s))
    sf = 5.6 * (gyro - 25.0)
    return Comparison(
        run_id=run_id,
        kind=kind,
        time_s=time_s,
        bias_before_dph=drift + noise,
        bias_after_dph=noise,
        sf_before_ppm=sf + rng.normal(0.0, 0.4, len(time_s)),
        sf_after_ppm=rng.normal(0.0, 0.9, len(time_s)),
        floor_dph=FLOOR_DPH,
    )


def summary_of(run_id: str, role: str, outcome: str = "completed", rate: float = 11.79) -> RunSummary:
    reasons = (
        ()
        if outcome == "completed"
        else (
            f"shock rate {rate:.2f} K/min between 10 and 90 % (steepest 60 s 6.41 K/min), required 10 K/min",
        )
    )
    return RunSummary(
        run_id=run_id,
        procedure="zero-bias-cold-shock",
        outcome=outcome,
        units={"fog_1": "1750-170213"},
        parameters={"cold_c": -45.0, "ramp_k_per_min": 12.0, "soak_min": 75.0, "room_c": 25.0, "repeats": 1},
        reasons=reasons,
        started_utc="2026-11-20T08:14:07.123+00:00",
        duration_s=16012.0,
        devices=(
            Device("table", "Acutronic", "ACUTROL3000", "A3-0417", "5.2.1", "table"),
            Device("chamber", "Weiss Technik", "ShockEvent T/60/V2", "58226116250010", "02.10", "chamber"),
            Device("fog_1", "KVH", "DSP-1750", "170213", "1.10", "gyro"),
        ),
        software={"gyrobench": "0.1.0", "python": "3.11.9"},
        measurements=(
            Measurement("azimuth_error", -0.31, "deg", -2.0, 2.0, True),
            Measurement("reference_output", 1.2345, "deg/h"),
            Measurement("shock_rate_10_90", rate, "K/min", 10.0, None, rate >= 10.0),
            Measurement("shock_steepest_60s", rate + 0.29, "K/min", 10.0, None, rate >= 10.0),
            Measurement("shock_lowest_air", -45.66, "degC", None, -40.0, True),
        ),
        streams=(StreamStatistics("fog_1", 1601187, 13, 2, 100.0007, 7.1),),
        warnings=() if outcome == "completed" else ("chamber: compressor 2 overload",),
        role=role,
        checksum=hashlib.sha256(run_id.encode()).hexdigest(),
        bench_name="thermal lab, bench 2",
        bench_file_sha256="9f" * 32,
        mounting="axis_horizontal",
        operator="J. Weber",
        emulated="fog_mid, seed 1",
    )


def campaign_content() -> CampaignContent:
    """A full campaign: 4 training runs, a validation run, 7 held-out runs, one of the training runs invalid."""
    held_out = [f"bias-{number:02d}" for number in range(6, 13)]
    runs = [summary_of(f"bias-{number:02d}", "training") for number in range(1, 5)]
    runs[2] = summary_of("bias-03", "not used", "invalid", 5.96)
    runs.append(summary_of("bias-05", "validation"))
    runs += [
        replace(summary_of(run_id, "held out"), parameters={**runs[0].parameters, "cold_c": cold})
        for run_id, (_, cold, _, _) in zip(held_out, HELD_OUT, strict=True)
    ]
    scores = []
    for model, improvements in IMPROVEMENTS.items():
        for run_id, (kind, _, raw, attainable), percent in zip(held_out, HELD_OUT, improvements, strict=True):
            after = raw * (1.0 - percent / 100.0)
            scores.append(
                ModelScore(
                    model,
                    run_id,
                    kind,
                    raw,
                    after,
                    percent,
                    attainable,
                    3.1 * after,
                    0.012 * (100 - percent),
                    0.051 * (100 - percent),
                    121.3,
                    391.0,
                )
            )
    return CampaignContent(
        title="Cold-shock compensation of unit 1750-170213",
        bench_name="thermal lab, bench 2",
        created_utc="2026-11-21T01:10:00+00:00",
        runs=runs,
        traces=[trace_of(run.run_id, -45.0, at) for at, run in enumerate(runs[:6])],
        scores=scores,
        comparisons=[
            comparison_of(run_id, kind, cold, seed)
            for seed, (run_id, (kind, cold, _, _)) in enumerate(zip(held_out, HELD_OUT, strict=True))
        ],
        compensation=CompensationSummary(
            unit_id="1750-170213",
            model="grey_box",
            reason="best on the validation run bias-05: 0.0262 °/h left of 0.1340 °/h",
            training_runs={run.run_id: run.checksum for run in runs[:4] if run.valid},
            validation_runs={"bias-05": "5" * 64},
            valid_ranges=(
                ValidRange("gyro temperature", -46.2, 27.4, "degC"),
                ValidRange("temperature change", -2.41, 2.55, "degC/min"),
            ),
            file_name="compensation-1750-170213.gbc",
            file_sha256="c0ffee00" * 8,
        ),
        software={"gyrobench": "0.1.0", "python": "3.11.9", "numpy": "2.4.6", "torch": "2.13.0"},
        warnings=("bias-03 is invalid and was not used for fitting",),
        noise_floor_dph=FLOOR_DPH,
        bench_file_sha256="9f" * 32,
    )


@pytest.fixture(scope="session")
def campaign() -> CampaignContent:
    return campaign_content()


@pytest.fixture(scope="session")
def campaign_html(campaign: CampaignContent) -> str:
    return render_page(campaign_page(campaign))


@pytest.fixture
def single_run() -> Callable[..., RunContent]:
    def make(outcome: str = "completed", rate: float = 11.79) -> RunContent:
        return RunContent(
            summary_of("bias-01", "", outcome, rate), (trace_of("bias-01"),), "2026-11-21T01:10:00+00:00"
        )

    return make
