"""A campaign of realistic size and magnitude, made of plain arrays: what the report's tests render."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from bench.analysis.thermal import Scores, Study, ThermalRun
from bench.analysis.thermal._selection import ModelScore
from bench.present.report import render_page
from bench.present.report._campaign import campaign_page
from bench.present.report._certificate import CertificateContent, CertifiedFigure, UnitCertificate
from bench.present.report._page import Page
from bench.present.report._plots import Comparison
from bench.present.report._run_content import RunContent, Trace
from bench.record.figure_limits import Decision
from bench.record.recording import Manifest

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
    (-45.0, 0.1331, 81.1),
    (-55.0, 0.1487, 82.8),
    (-45.0, 0.1362, 81.4),
    (-45.0, 0.0913, 71.9),
    (-45.0, 0.1184, 77.8),
    (-45.0, 0.1221, 81.2),
    (-45.0, 0.1129, 75.8),
)
"""Lowest temperature, 1 sigma before compensation in deg/h and attainable improvement in % of each run."""
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


def comparisons_of(run_id: str, cold_c: float, seed: int) -> list[Comparison]:
    trace = trace_of(run_id, cold_c, seed)
    assert trace.gyro_temp_c is not None
    rng = np.random.default_rng(seed + 100)
    time_s = np.arange(50.0, 16000.0, 100.0)
    gyro = np.interp(time_s, trace.time_s, trace.gyro_temp_c)
    drift = np.interp(time_s, trace.time_s, drift_of(trace.gyro_temp_c))
    noise = rng.normal(0.0, FLOOR_DPH, len(time_s))
    sf, left = 5.6 * (gyro - 25.0), rng.normal(0.0, 0.9, len(time_s))
    return [
        Comparison(run_id, time_s, "°/h", drift + noise, noise, floor=FLOOR_DPH),
        Comparison(run_id, time_s, "ppm", sf + left, left),
    ]


def run_of(run_id: str, role: str, outcome: str = "completed", rate: float = 11.79) -> RunContent:
    invalid = outcome != "completed"
    reason = f"shock rate {rate:.2f} K/min between 10 and 90 %, required 10 K/min" if invalid else ""
    keys = ("role", "maker", "model", "serial_number", "firmware")
    devices = {
        "table": ("table", "Acutronic", "ACUTROL3000", "A3-0417", "5.2.1"),
        "chamber": ("chamber", "Weiss Technik", "ShockEvent T/60/V2", "58226116250010", "02.10"),
        "fog_1": ("gyro", "KVH", "DSP-1750", "170213", "1.10"),
    }
    measured = [
        ("azimuth_error", -0.31, "deg", -2.0, 2.0, True),
        ("reference_output", 1.2345, "deg/h", None, None, None),
        ("shock_rate_10_90", rate, "K/min", 10.0, None, rate >= 10.0),
        ("shock_steepest_60s", rate + 0.29, "K/min", 10.0, None, rate >= 10.0),
        ("shock_lowest_air", -45.66, "degC", None, -40.0, True),
    ]
    manifest = {
        "run_id": run_id,
        "procedure": "zero-bias-cold-shock",
        "outcome": outcome,
        "units": {"fog_1": "1750-170213"},
        "parameters": {"cold_c": -45.0, "ramp_k_per_min": 12.0, "soak_min": 75.0, "room_c": 25.0, "repeats": 1},
        "started_utc": "2026-11-20T08:14:07.123+00:00",
        "duration_s": 16012.0,
        "devices": {
            name: {"kind": "x"} | dict(zip(keys, row, strict=True))
            for name, row in devices.items()
        },
        "software": {"gyrobench": "0.1.0", "python": "3.11.9"},
        "measurements": [
            dict(zip(("name", "value", "unit", "low", "high", "passed"), row, strict=True)) for row in measured
        ],
        "stream": {
            "fog_1": {
                "frames": 1601187, "lost": 13, "rejected": {"checksum": 2},
                "sample_rate_hz": 100.0007, "clock_error_ppm": 7.1,
            }
        },
        "bench": {"bench": {"name": "thermal lab, bench 2"}},
        "bench_file_sha256": "9f" * 32,
        "mounting": "axis_horizontal",
        "emulated": {"model": "fog_mid", "seed": 1},
    }  # fmt: skip
    return RunContent(
        Manifest.model_validate(manifest),
        reasons=(reason,) if reason else (),
        warnings=("chamber: compressor 2 overload",) if invalid else (),
        operator="J. Weber",
        checksum=hashlib.sha256(run_id.encode()).hexdigest(),
        role=role,
    )


@dataclass(frozen=True)
class Campaign:
    """What the report of a campaign is made of."""

    study: Study
    runs: list[RunContent]
    comparisons: list[Comparison]
    compensation_file: Path
    title: str = "Cold-shock compensation of unit 1750-170213"

    @property
    def scores(self) -> list[tuple[str, Scores]]:
        return [(model, score) for model, scores in self.study.scores.items() for score in scores]

    def with_scores(self, model: str = "", **changed: object) -> Campaign:
        """The same with figures of the scores changed, of one model or of all."""
        scores = {
            name: tuple(replace(score, **changed) for score in of) if model in ("", name) else of
            for name, of in self.study.scores.items()
        }
        return replace(self, study=replace(self.study, scores=scores))

    def page(self) -> Page:
        return campaign_page(
            self.study,
            self.runs,
            self.comparisons,
            self.compensation_file,
            title=self.title,
            created_utc="2026-11-21T01:10:00+00:00",
        )


def run_of_study(content: RunContent) -> ThermalRun:
    none = np.empty(0)
    return ThermalRun(
        content.run_id, "1750-170213", none, none, none, none, None, (0.0, 1.0), checksum=content.checksum,
        meta={"gyro": "fog_1"},
    )  # fmt: skip


def campaign_of(folder: Path) -> Campaign:
    """A full campaign: 4 training runs, a validation run, 7 held-out runs, one of the training runs invalid."""
    held_out = [f"bias-{number:02d}" for number in range(6, 13)]
    runs = [run_of(f"bias-{number:02d}", "training") for number in range(1, 5)]
    runs[2] = run_of("bias-03", "not used", "invalid", 5.96)
    runs.append(run_of("bias-05", "validation"))
    for seed, (run_id, (cold, _, _)) in enumerate(zip(held_out, HELD_OUT, strict=True)):
        run = run_of(run_id, "held out")
        manifest = run.manifest.model_copy(update={"parameters": run.manifest.parameters | {"cold_c": cold}})
        runs.append(replace(run, manifest=manifest, traces=(trace_of(run_id, -45.0, seed),)))
    scores = {
        model: tuple(
            Scores(
                run_id,
                raw_stability_dph=raw,
                stability_dph=raw * (1.0 - percent / 100.0),
                improvement_pct=percent,
                noise_floor_dph=FLOOR_DPH,
                oracle_pct=attainable,
                true_max_dph=3.1 * raw * (1.0 - percent / 100.0),
                sf_raw_rms_ppm=121.3,
                sf_true_rms_ppm=0.012 * (100 - percent),
                sf_true_max_ppm=0.051 * (100 - percent),
            )
            for run_id, (_, raw, attainable), percent in zip(held_out, HELD_OUT, improvements, strict=True)
        )
        for model, improvements in IMPROVEMENTS.items()
    }
    inputs = {"t_in": (-46.2, 27.4), "dt_60": (-2.41, 2.55)}
    software = {"gyrobench": "0.1.0", "python": "3.11.9", "numpy": "2.4.6", "torch": "2.13.0"}
    compensation = SimpleNamespace(
        unit_id="1750-170213", software=software, limits=SimpleNamespace(inputs=inputs)
    )
    study = Study(
        train=tuple(map(run_of_study, (runs[0], runs[1], runs[3]))),
        validation=(run_of_study(runs[4]),),
        tests=tuple(map(run_of_study, runs[5:])),
        models={},
        selection=tuple(
            ModelScore(name, None, None, score=0.2 + 0.1 * n) for n, name in enumerate(IMPROVEMENTS)
        ),
        compensation=compensation,
        scores=scores,
        judged_on_chosen=False,
    )
    path = folder / "compensation-1750-170213.gbc"
    path.write_bytes(b"a model")
    return Campaign(
        study,
        runs,
        [
            comparison
            for seed, (run_id, (cold, _, _)) in enumerate(zip(held_out, HELD_OUT, strict=True))
            for comparison in comparisons_of(run_id, cold, seed)
        ],
        path,
    )


@pytest.fixture(scope="session")
def campaign(tmp_path_factory: pytest.TempPathFactory) -> Campaign:
    return campaign_of(tmp_path_factory.mktemp("campaign"))


@pytest.fixture(scope="session")
def campaign_html(campaign: Campaign) -> str:
    return render_page(campaign.page())


@pytest.fixture
def single_run() -> Callable[..., RunContent]:
    def make(outcome: str = "completed", rate: float = 11.79) -> RunContent:
        return replace(run_of("bias-01", "", outcome, rate), traces=(trace_of("bias-01"),))

    return make


@pytest.fixture
def small_certificate() -> CertificateContent:
    """A unit whose figures pass, leave it open, are not judged and were not measured."""
    rule = Decision(rule="guard band")
    figures = [
        CertifiedFigure("bias", "deg/h", {"r": 0.5}, -1.0, 1.0, {"r": (0.4, 0.6)}, decision=rule,
                        standard_uncertainties={"r": 0.05}),
        CertifiedFigure("scale-factor nonlinearity", "ppm", {"r": 12.0}, None, 13.0, {"r": (11.0, 14.0)},
                        decision=rule, standard_uncertainties={"r": 0.8}),
        CertifiedFigure("my-test.angle", "furlong", {"r": 3e-9}),
        CertifiedFigure("threshold", "deg/h", {}, None, 1.0),
    ]  # fmt: skip
    bench = {
        "bench": {"name": "b"},
        "calibration": [
            {"quantity": "time_base_ppm", "instrument": "clock 7", "certificate": "K-7", "date": "2026-01-01",
             "due": "2027-01-01", "uncertainty": 0.5}
        ],
    }  # fmt: skip
    manifest = Manifest(
        run_id="r", procedure="standard-test", outcome="completed", started_utc="2026-03-01T23:00:00.000+00:00",
        ended_utc="2026-03-02T01:00:00.000+00:00", bench=bench, units={"g": "U-1"},
        devices={"g": {"kind": "k", "role": "gyro", "maker": "M", "model": "FOG 3"}},
    )  # fmt: skip
    runs = [RunContent(manifest)]
    return CertificateContent("Test of U-1", "", [UnitCertificate("U-1", figures)], runs, decision=rule)
