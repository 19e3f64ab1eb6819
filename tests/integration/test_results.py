"""What a run gives afterwards: the same bytes for the same seed, and data that a fit can use."""

import gc
import hashlib
import math

import numpy as np
import pytest

from bench.analysis.thermal._dataset import load_thermal_runs
from bench.lab.emulated import Plant
from bench.record.recording import Run, read_table
from simulators.plant.fog_parameters import FOG_MID


def raw_files(folder):
    return {
        path.name: hashlib.sha256(path.read_bytes()).hexdigest()
        for path in sorted((folder / "raw").iterdir())
    }


def test_a_run_lets_go_of_its_can_bus(bench, both_file, tmp_path, caplog):
    with bench.lab(both_file, Plant()) as lab:
        assert bench.drive(lab.file, tmp_path, hold_s=1.0).outcome == "completed"
    gc.collect()
    assert "not properly shut down" not in caplog.text


def test_same_seed_gives_the_same_bytes_and_tables_and_another_seed_does_not(bench, both_file, tmp_path):
    folders = []
    for name, seed in (("first", 11), ("second", 11), ("other", 12)):
        with bench.lab(both_file, Plant(seed=seed)) as lab:
            result = bench.drive(lab.file, tmp_path / name, hold_s=20.0, cold_c=0.0)
        assert result.outcome == "completed", result.reason
        folders.append(result.folder)
    first, second, other = map(raw_files, folders)
    assert len(first) == 16  # four ports, both directions, bytes and marks
    assert first == second
    assert first["fog_1.bin"] != other["fog_1.bin"] and first["can_1.bin"] != other["can_1.bin"]
    names = sorted(path.name for path in folders[0].glob("*.parquet"))
    assert names == ["chamber.parquet", "gyro_can_1.parquet", "gyro_fog_1.parquet", "turntable.parquet"]
    for name in names:
        left, right = read_table(folders[0] / name), read_table(folders[1] / name)
        assert left.keys() == right.keys()
        assert all(left[key].tobytes() == right[key].tobytes() for key in left), name
    assert (folders[0] / "events.jsonl").read_bytes() == (folders[1] / "events.jsonl").read_bytes()


def test_a_completed_run_is_whole(short_run):
    run = Run.open(short_run)
    names = [phase.name for phase in run.phases()]
    assert names == [
        *("warm_up", "axis_east", "equilibrium", "reference", "shock"),
        *("soak", "return", "final_equilibrium", "close"),
    ]
    assert run.manifest.mounting == "axis_horizontal"
    assert run.manifest.devices["fog_1"].serial_number == "FOG-001"
    stream = run.manifest.stream["fog_1"]
    assert stream["lost"] == stream["duplicates"] == 0 and stream["rejected"] == {}
    assert stream["sample_rate_hz"] == pytest.approx(100.0, rel=1e-7)
    gyro = run.gyro("fog_1", ("time_ns", "counter"))
    assert set(np.diff(gyro["counter"]).tolist()) == {1}
    assert np.ptp(np.diff(gyro["time_ns"])) <= 1
    # Every poll of a second is in the tables, and the shock is where the events say it is.
    shock = next(phase for phase in run.phases() if phase.name == "shock")
    air = run.chamber(start_s=shock.start_s, end_s=shock.end_s)
    fall = (air["air_temp_c"][0] - air["air_temp_c"][-1]) / (shock.end_s - shock.start_s) * 60.0
    assert len(air["time_ns"]) == pytest.approx(shock.end_s - shock.start_s, abs=2)
    assert air["air_temp_c"][-1] <= -43.9 and fall > 10.0


def test_the_azimuth_found_is_the_one_the_plant_has(short_run):
    """The lab mounts its units 0.3 deg off; noise of 240 s of angle random walk is what may be left."""
    rows = {row["name"]: row["value"] for row in Run.open(short_run).manifest.measurements}
    horizontal_dph = 15.041067 * math.cos(math.radians(39.10))
    noise_dph = FOG_MID.noise.arw_deg_per_sqrt_h / math.sqrt(240.0 / 3600.0)
    allowed_deg = math.degrees(5.0 * noise_dph / horizontal_dph)
    assert allowed_deg < 2.0
    assert rows["azimuth_error"] == pytest.approx(0.3, abs=allowed_deg)


def test_a_short_run_is_loaded_for_fitting_with_its_earth_rate_taken_off(short_run):
    (run,) = load_thermal_runs(short_run, "fog_1")
    phases = {phase.name: phase for phase in Run.open(short_run).phases()}
    count = len(run.time_s)
    assert run.unit_id == "FOG-001" and run.sf_error_ppm is None
    assert all(len(column) == count for column in (run.gyro_temp_c, run.case_temp_c, run.bias_dph))
    assert np.array_equal(np.diff(run.time_s), np.ones(count - 1))
    assert run.reference == (phases["reference"].start_s, phases["reference"].end_s)
    assert run.reference[1] - run.reference[0] == pytest.approx(600.0, abs=1.0)
    truth = np.load(short_run / "truth_fog_1.npz")
    true_dph = (truth["bias_dph"] + truth["flicker_dph"])[run.time_s.astype(int)]
    known = np.isfinite(run.bias_dph)
    assert known.mean() > 0.999
    hours = known.sum() / 3600.0
    white_dph = FOG_MID.noise.arw_deg_per_sqrt_h / math.sqrt(hours)
    # The axis stands off east by the noise of the search (240 s), which stays in the output as a constant.
    east_dph = FOG_MID.noise.arw_deg_per_sqrt_h / math.sqrt(240.0 / 3600.0)
    difference = (run.bias_dph - true_dph)[known]
    assert abs(difference.mean()) < 5.0 * math.hypot(white_dph, east_dph)
    assert difference.std() == pytest.approx(60.0 * FOG_MID.noise.arw_deg_per_sqrt_h, rel=0.1)
    # The reading of a tick holds for the second after it, but for that second's last sample.
    held = truth["sensor_temp_c"][run.time_s.astype(int) - 1]
    assert np.nanmax(np.abs(run.gyro_temp_c - held)) < 0.002
