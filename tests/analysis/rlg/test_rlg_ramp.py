"""The ramp procedure on a chamber that obeys or stalls, and its run folder read back."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from bench.analysis.rlg import load_ramp_runs
from bench.control.history import History
from bench.record.recording import DeviceEntry, Manifest, read_manifest, write_manifest
from bench.record.recording._tables import table_writer
from drivers.base.errors import ConfigurationError
from procedures.thermal_ramp import PROCEDURE, go_to_end

EARTH = 15.041067 * np.cos(np.radians(39.1))


class FakeBench:
    """A bench whose air follows every ramp exactly, or stops at `stuck_c`."""

    def __init__(self, stuck_c: float | None = None) -> None:
        self.now_s, self.invalid, self.air, self.stuck_c = 0.0, [], 20.0, stuck_c
        self.target, self.ramp = 20.0, 0.0
        self.history = History(("air_temp_c",))
        self.history.append(0.0, 20.0)
        self.chamber = SimpleNamespace(history=self.history, go_to=self.go_to)

    def go_to(self, target: float, ramp: float) -> None:
        self.target, self.ramp = target, ramp

    def invalidate(self, text: str, code: str, **facts: object) -> None:
        self.invalid.append(text)

    def wait_until(self, reached: Callable[[], bool], *, timeout_s: float, what: str, every_s: float) -> bool:
        end = self.now_s + timeout_s
        while self.now_s < end:
            self.now_s += every_s
            step = np.clip(self.target - self.air, -self.ramp * every_s / 60, self.ramp * every_s / 60)
            if self.stuck_c is None or self.air < self.stuck_c:
                self.air += step
            self.history.append(self.now_s, self.air)
            if reached():
                return True
        return False


def test_a_ramp_that_is_followed_ends_when_the_air_is_there() -> None:
    bench = FakeBench()
    go_to_end(bench, 65.0, 1.0 / 3.0)
    assert bench.invalid == []
    assert bench.now_s == pytest.approx(44 * 180, abs=11)  # within a degree of 45 K at 1 K in 3 min


def test_a_ramp_that_stalls_makes_the_run_invalid_once_and_says_where() -> None:
    bench = FakeBench(stuck_c=40.0)
    go_to_end(bench, 65.0, 1.0 / 3.0)
    assert len(bench.invalid) == 1 and "stalled at 40.0 degC" in bench.invalid[0]
    assert bench.now_s == pytest.approx(2 * 45 * 180 + 3600)


def test_the_profile_and_what_it_demands() -> None:
    p = PROCEDURE.parse({})
    assert p.ends() == (-40.0, 65.0) and PROCEDURE.parse({"downwards": "true"}).ends() == (65.0, -40.0)
    assert p.ramp_s() == pytest.approx(105 * 180)
    demands = PROCEDURE.demands(p)
    assert (demands.min_temp_c, demands.max_temp_c) == (-40.0, 65.0)
    expected = 3600 + 4 * 480 + 200 + 2 * 65 / 3 * 60 + 2 * 105 * 180 + 3 * 3600
    assert PROCEDURE.expected_duration_s(p) == pytest.approx(expected)


def folder(
    path: Path, *, in_frame: bool, phases: tuple[str, ...] = ("soak", "ramp_1", "dwell_1", "close")
) -> Path:
    """A run of 4000 s, phases 1000 s each: T1 = t/100, T2 = t/200, bias 1e-4 t at 2 deg of azimuth error."""
    path.mkdir()
    time_s = np.arange(4000) + 0.5
    time_ns = (time_s * 1e9).astype(np.int64)
    rate = (1e-4 * time_s + EARTH * np.cos(np.radians(92.0))) / 3600.0
    columns = {"time_ns": time_ns, "valid": np.ones(4000, np.bool_), "rate_dps": rate, "temp_c": time_s / 200}
    columns["lost_before"] = np.zeros(4000, np.int64)
    if in_frame:
        columns["case_temp_c"] = time_s / 100
    chamber = {"time_ns": time_ns, "aux_1_temp_c": time_s / 100}
    table = {"time_ns": time_ns, "angle_deg": np.full(4000, 90.0), "rate_dps": np.zeros(4000)}
    for name, content in (("gyro_g", columns), ("chamber", chamber), ("turntable", table)):
        with table_writer(path / f"{name}.parquet", name) as writer:
            writer.write(content)
    events = [{"time_s": 1000.0 * n, "kind": "phase", "phase": name} for n, name in enumerate(phases)]
    events.append({"time_s": 4000.0, "kind": "outcome", "outcome": "completed", "reason": ""})
    (path / "events.jsonl").write_text("".join(json.dumps(event) + "\n" for event in events))
    gyro = DeviceEntry(kind="x", role="gyro", axis="x", case_sensor=None if in_frame else 1)
    manifest = Manifest(
        run_id=path.name,
        procedure="thermal-ramp",
        started_utc="2026-01-01T00:00:00.000+00:00",
        bench={"bench": {"name": "b", "latitude_deg": 39.1}},
        units={"g": "U-1"},
        devices={"g": gyro},
        outcome="completed",
        measurements=({"name": "azimuth_error", "value": 2.0},),
    )
    write_manifest(path, manifest)
    return path


@pytest.mark.parametrize("in_frame", [True, False])
def test_rows_come_from_ramps_and_dwells_with_either_case_sensor(tmp_path: Path, in_frame: bool) -> None:
    (run,) = load_ramp_runs(folder(tmp_path / "run", in_frame=in_frame))
    assert run.unit_id == "U-1" and len(run.time_s) == 20
    assert run.time_s[0] == pytest.approx(1050.5) and run.time_s[-1] == pytest.approx(2950.5)
    assert np.allclose(run.case_rate, 0.6) and np.allclose(run.block_rate, 0.3)
    assert np.allclose(run.case_c, (run.time_s - 0.5) / 100, atol=1e-9)
    assert np.allclose(run.bias_dph, 1e-4 * (run.time_s - 0.5), atol=1e-6)
    assert run.true_bias_dph is None


def test_the_truth_is_its_mean_over_the_seconds_of_the_rows(tmp_path: Path) -> None:
    """The plant's bias grows by 1e-4 deg/h a second, told at whole seconds: as the measured one does."""
    path = folder(tmp_path / "run", in_frame=True)
    np.savez(path / "truth_g.npz", bias_dph=1e-4 * np.arange(4001.0))
    (run,) = load_ramp_runs(path)
    assert run.true_bias_dph is not None
    assert np.allclose(run.true_bias_dph, 1e-4 * (run.time_s - 0.5), atol=1e-12)
    assert np.allclose(run.true_bias_dph, run.bias_dph, atol=1e-6)


def test_lost_samples_are_named(tmp_path: Path) -> None:
    path = folder(tmp_path / "run", in_frame=True)
    manifest = read_manifest(path)
    # 1 Hz is there, 2 Hz were sent
    write_manifest(path, manifest.model_copy(update={"stream": {"g": {"sample_rate_hz": 2.0}}}))
    (run,) = load_ramp_runs(path)
    assert run.remarks == ("2000 of 4000 samples are missing or not valid: the means are noisier than usual",)
    write_manifest(path, manifest.model_copy(update={"stream": {"g": {"sample_rate_hz": 1.0}}}))
    assert load_ramp_runs(path)[0].remarks == ()


def test_a_run_without_a_ramp_or_gyro_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ConfigurationError, match="no ramp"):
        load_ramp_runs(folder(tmp_path / "a", in_frame=True, phases=("warm_up", "soak")))
    with pytest.raises(ConfigurationError, match="no such gyro"):
        load_ramp_runs(folder(tmp_path / "b", in_frame=True), ("h",))


@pytest.mark.parametrize(
    ("parameters", "kind"),
    [
        ({"low_c": -40.0, "high_c": 65.0}, "-40 to 65 °C, up first"),
        ({"low_c": -40.0, "high_c": 65.0, "downwards": True}, "-40 to 65 °C, down first"),
        ({"low_c": -20.5, "high_c": 50.0, "downwards": False}, "-20.5 to 50 °C, up first"),
    ],
)
def test_a_ramp_run_says_its_range_and_which_way_it_began(tmp_path: Path, parameters, kind: str) -> None:
    path = folder(tmp_path / "run", in_frame=True)
    write_manifest(path, read_manifest(path).model_copy(update={"parameters": parameters}))
    assert load_ramp_runs(path)[0].kind == kind
