"""A run folder as a thermal run: what was measured and the truth beside it, second by second."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from bench.analysis.thermal._dataset import load_thermal_runs
from bench.record.recording import DeviceEntry, Manifest, write_manifest
from bench.record.recording._tables import table_writer

END_S = 1200
BIAS_DPH_PER_S = 2e-3


def folder(path: Path, events: list[dict[str, object]]) -> Path:
    """A run of 20 min at 10 Hz whose bias grows and whose temperatures fall evenly; a truth beside it.

    The axis stands 90 deg off east, where it sees no Earth rate.
    """
    path.mkdir()
    end_s = 0.1 * np.arange(1.0, 10.0 * END_S + 1.0)
    middle_s = end_s - 0.05
    gyro = {
        "time_ns": np.rint(end_s * 1e9).astype(np.int64),
        "valid": np.ones(len(end_s), np.bool_),
        "rate_dps": BIAS_DPH_PER_S * middle_s / 3600.0,
        "temp_c": 25.0 - middle_s / 100.0,
        "lost_before": np.zeros(len(end_s), np.int64),
    }
    poll_s = np.arange(0.0, END_S + 1.0)
    poll_ns = (poll_s * 1e9).astype(np.int64)
    chamber = {"time_ns": poll_ns, "aux_1_temp_c": 25.0 - poll_s / 50.0}
    table = {"time_ns": poll_ns, "angle_deg": np.full(len(poll_s), 90.0), "rate_dps": np.zeros(len(poll_s))}
    for name, content in (("gyro_g", gyro), ("chamber", chamber), ("turntable", table)):
        with table_writer(path / f"{name}.parquet", name) as writer:
            writer.write(content)
    outcome = {"time_s": float(END_S), "kind": "outcome", "outcome": "completed"}
    rows = [*events, outcome]
    (path / "events.jsonl").write_text("".join(json.dumps(event) + "\n" for event in rows))
    ticks_s = np.arange(END_S + 1.0)
    np.savez(path / "truth_g.npz", bias_dph=BIAS_DPH_PER_S * ticks_s, sf_error_ppm=np.zeros(END_S + 1))
    manifest = Manifest(
        run_id=path.name,
        procedure="zero-bias-cold-shock",
        started_utc="2026-01-01T00:00:00.000+00:00",
        bench={"bench": {"name": "b", "latitude_deg": 39.1}},
        units={"g": "U-1"},
        devices={"g": DeviceEntry(kind="x", role="gyro", axis="x", case_sensor=1)},
        outcome="completed",
    )
    write_manifest(path, manifest)
    return path


def phase(time_s: float, name: str) -> dict[str, object]:
    return {"time_s": time_s, "kind": "phase", "phase": name}


def test_truth_and_measurement_are_means_over_the_same_second(tmp_path: Path) -> None:
    """A row at t is of (t - 1, t]: of what grows evenly it is the value at t - 0.5."""
    events = [phase(0.0, "warm_up"), phase(100.0, "equilibrium"), phase(400.0, "reference")]
    (run,) = load_thermal_runs(
        folder(tmp_path / "run", [*events, phase(600.0, "shock"), phase(1100.0, "close")])
    )
    assert run.time_s.tolist() == list(range(101, 1101))
    middle_s = run.time_s - 0.5
    assert run.bias_dph == pytest.approx(BIAS_DPH_PER_S * middle_s, abs=1e-6)
    assert run.true_bias_dph == pytest.approx(BIAS_DPH_PER_S * middle_s, rel=1e-12)
    assert run.gyro_temp_c == pytest.approx(25.0 - middle_s / 100.0, abs=1e-6)
    assert run.case_temp_c == pytest.approx(25.0 - middle_s / 50.0, abs=1e-9)
    assert run.reference == (400.0, 600.0) and run.unit_id == "U-1"


def test_without_a_truth_or_with_one_that_ends_early_there_is_none(tmp_path: Path) -> None:
    events = [phase(100.0, "equilibrium"), phase(400.0, "reference"), phase(600.0, "shock")]
    path = folder(tmp_path / "run", [*events, phase(1100.0, "close")])
    with np.load(path / "truth_g.npz") as truth:
        short = {name: truth[name][:1100] for name in truth.files}
    np.savez(path / "truth_g.npz", **short)
    assert load_thermal_runs(path)[0].true_bias_dph is None
    (path / "truth_g.npz").unlink()
    assert load_thermal_runs(path)[0].true_bias_dph is None


def test_a_run_with_sections_is_one_run_of_the_scale_factor(tmp_path: Path) -> None:
    """Three sections of 400 s, turning at 10, -10 and 0 deg/s, each with its own reference and shock.

    In each the scale factor falls by 100 ppm when the shock begins: of its mean in the reference.
    """
    events: list[dict[str, object]] = []
    for start, rate in ((0.0, 10.0), (400.0, -10.0), (800.0, 0.0)):
        events += [{"time_s": start, "kind": "section", "group": 1, "rate_dps": rate}]
        events += [phase(start, "reference"), phase(start + 100.0, "shock")]
    path = folder(tmp_path / "run", [*events, phase(1200.0, "close")])
    end_s = 0.1 * np.arange(1.0, 10.0 * END_S + 1.0)
    section = np.minimum(np.ceil(end_s / 400.0 - 1e-9) - 1.0, 2.0).astype(int)
    shocked = end_s - 400.0 * section > 100.0 + 1e-9
    gyro = {
        "time_ns": np.rint(end_s * 1e9).astype(np.int64),
        "valid": np.ones(len(end_s), np.bool_),
        "rate_dps": np.array([10.0, -10.0, 0.0])[section] * np.where(shocked, 1.0 - 1e-4, 1.0),
        "temp_c": 25.0 - (end_s - 400.0 * section) / 100.0,
        "lost_before": np.zeros(len(end_s), np.int64),
    }
    chamber = {"time_ns": (np.arange(END_S + 1.0) * 1e9).astype(np.int64)}
    chamber["aux_1_temp_c"] = 25.0 - (np.arange(END_S + 1.0) % 400.0) / 50.0
    for name, content in (("gyro_g", gyro), ("chamber", chamber)):
        with table_writer(path / f"{name}.parquet", name) as writer:
            writer.write(content)
    (run,) = load_thermal_runs(path)
    assert run.bias_dph is None and run.sf_error_ppm is not None
    assert run.reference == (0.0, 100.0)
    assert list(run.phases)[:2] == [(0.0, "reference"), (100.0, "shock")]
    calm, late = run.time_s <= 99.0, run.time_s > 101.0
    assert run.sf_error_ppm[calm] == pytest.approx(np.zeros(calm.sum()), abs=2.0)
    assert run.sf_error_ppm[late] == pytest.approx(np.full(late.sum(), -100.0), abs=2.0)
