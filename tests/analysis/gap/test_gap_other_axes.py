"""All axes of an IMU's log: attitude, specific force and rates of the other axes, moves, tilts."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from bench.analysis.gap import diagnose, diagnose_batch, parse_model, read_batch, read_recordings
from bench.analysis.gap._import import read_mapped_runs
from bench.analysis.gap._other_axes import _rests
from bench.analysis.gap._prepare import with_unknown_rate
from drivers.base.constants import EARTH_RATE_DPH
from drivers.base.errors import ConfigurationError

RATE_HZ, REST_S, MOVE_S, LATITUDE_DEG = 50.0, 60.0, 4.0, 50.0
ARW, FORCE_MG = 0.3, 0.5
UP = np.array(
    [[0, 0, 1], [0, 0, -1], [0, 1, 0], [0, -1, 0], [1, 0, 0], [-1, 0, 0], [0.6, 0, 0.8], [0, 0.6, -0.8]],
    float,
)
"""Where up is in the unit's axes, a rest each."""


def columns(ups: np.ndarray, bias_dph, seed: int = 1) -> dict[str, np.ndarray]:
    """Rows of an IMU that lies still in each attitude and is turned by hand between rests."""
    rng = np.random.default_rng(seed)
    found: dict[str, list[np.ndarray]] = {name: [] for name in ("gx", "gy", "gz", "ax", "ay", "az")}
    rows, moving = round(REST_S * RATE_HZ), round(MOVE_S * RATE_HZ)
    for number, up in enumerate(ups):
        somewhere = rng.standard_normal(3)
        north = somewhere - (somewhere @ up) * up / (up @ up)  # nobody knows where it points
        north *= EARTH_RATE_DPH * math.cos(math.radians(LATITUDE_DEG)) / np.linalg.norm(north)
        earth = EARTH_RATE_DPH * math.sin(math.radians(LATITUDE_DEG)) * up + north
        for axis, name in enumerate("xyz"):
            sigma = 60.0 * ARW * math.sqrt(RATE_HZ)
            rest = earth[axis] + bias_dph(axis, up) + sigma * rng.standard_normal(rows)
            force = 9.80665 * (up[axis] + 1e-3 * FORCE_MG * math.sqrt(RATE_HZ) * rng.standard_normal(rows))
            found[f"g{name}"].append(rest / 3600.0)
            found[f"a{name}"].append(force)
            if number + 1 < len(ups):
                swing = 40.0 * np.sin(np.pi * np.arange(moving) / moving) * (1.0 + 0.3 * axis)
                between = np.linspace(up[axis], ups[number + 1][axis], moving)
                found[f"g{name}"].append(swing)
                found[f"a{name}"].append(9.80665 * between + rng.standard_normal(moving))
    return {name: np.concatenate(parts) for name, parts in found.items()}


def mapping(folder: Path, table: dict[str, np.ndarray], more: str = "") -> Path:
    names = ",".join(["t", *table])
    time_s = np.arange(len(table["gx"])) / RATE_HZ
    np.savetxt(
        folder / "log.csv", np.column_stack([time_s, *table.values()]), "%.9g", ",", header=names, comments=""
    )
    axes = "\n".join(f'gyros.{a} = {{ name = "g{a}", unit = "deg/s" }}' for a in "xyz")
    axes += "\n" + "\n".join(f'accelerometers.{a} = {{ name = "a{a}", unit = "m/s^2" }}' for a in "xyz")
    file = folder / "map.toml"
    file.write_text(
        f'format = 1\nunit_id = "imu"\nlatitude_deg = {LATITUDE_DEG}\n[columns]\n'
        f'time = {{ name = "t", unit = "s" }}\n{axes}\n[[run]]\nfile = "log.csv"\n{more}'
    )
    return file


MODEL = parse_model(f"format = 1\n[noise]\narw_deg_per_sqrt_h = {ARW}\nbias_instability_dph = 0.5\n", "test")


def test_moves_are_left_out_and_each_rest_has_its_attitude(tmp_path):
    (run,) = read_mapped_runs(mapping(tmp_path, columns(UP, lambda *_: 0.0)), "z")
    assert run.unit_id == "imu z"
    starts = (REST_S + MOVE_S) * np.arange(len(UP))
    for start_s, up in zip(starts, UP, strict=True):
        inside = slice(round(start_s) + 3, round(start_s + REST_S) - 3)
        assert not run.missing[inside].any()
        assert run.stimulus.elevation_deg[inside] == pytest.approx(math.degrees(math.asin(up[2])), abs=0.1)
        ahead = up[[2, 0, 1]]
        assert run.stimulus.force_g[:, inside].mean(axis=1) == pytest.approx(ahead, abs=2e-3)
        # nobody knows where it points in the level: of Earth's rate its vertical part is foretold
        vertical = EARTH_RATE_DPH * math.sin(math.radians(LATITUDE_DEG)) * up[2]
        assert run.stimulus.input_rate_dph[inside] == pytest.approx(vertical, abs=0.05)
        if start_s:
            assert run.missing[round(start_s - MOVE_S) : round(start_s)].all()
    assert run.missing.mean() < 0.15
    assert run.stimulus.cross_rate_dph is None  # a hand that turns other axes turns this one, too
    level = math.sqrt(0.5 * np.mean(1.0 - UP[:, 2] ** 2))
    north = EARTH_RATE_DPH * math.cos(math.radians(LATITUDE_DEG))
    assert run.unknown_dph == pytest.approx(1.4 * north * level, rel=0.01)
    assert run.unknown_time_s == pytest.approx(REST_S, abs=3.0)
    noise = with_unknown_rate(MODEL, [run]).noise
    assert (noise.correlated_dph, noise.correlation_time_s) == (run.unknown_dph, 0.5 * run.unknown_time_s)
    assert with_unknown_rate(MODEL, [replace(run, unknown_dph=0.0)]) is MODEL
    assert any(f"moved {len(UP) - 1} times" in remark for remark in run.remarks)


def test_g_sensitivity_is_found_through_the_accelerometers(tmp_path):
    ups = np.concatenate((UP, UP))
    # x: 30 deg/h for 1 g along it; y: -40 deg/h for 1 g along z; of Earth's rate about 9 deg/h are not known
    effect = {0: lambda up: 30.0 * up[0], 1: lambda up: -40.0 * up[2], 2: lambda up: 0.0}
    file = mapping(tmp_path, columns(ups, lambda axis, up: effect[axis](up)))
    causes = {}
    for axis in "xyz":
        given = read_recordings([file], gyro=axis)
        causes[axis] = diagnose(given.runs, MODEL).rate.causes
    (along,) = causes["x"]
    assert "acceleration_sensitivity" in along.one_of or along.name == "acceleration_sensitivity"
    (across,) = causes["y"]
    assert across.name == "cross_acceleration_sensitivity"
    # z is the axis after y
    assert across.term.values == pytest.approx((-40.0, 0.0), abs=4.0 * across.term.sigmas[0])
    assert across.term.sigmas[0] < 4.0
    assert not causes["z"]


def test_an_imu_s_axes_are_a_batch_and_what_each_has_is_its_own(tmp_path):
    ups = np.concatenate((UP, UP))
    file = mapping(tmp_path, columns(ups, lambda axis, up: 30.0 * up[axis] if axis == 1 else 0.0))
    runs = read_batch([file])
    assert [run.unit_id for run in runs] == ["imu x", "imu y", "imu z"]
    # a mapping a gyro, as `look --write` makes them, names the same axes again
    other = tmp_path / "map_y.toml"
    other.write_text(file.read_text().replace("format = 1", 'format = 1\naxis = "y"'))
    assert sorted(run.unit_id for run in read_batch([file, other])) == ["imu x", "imu y", "imu z"]
    batch = diagnose_batch(runs, MODEL)
    assert set(batch.units) == {"imu x", "imu y", "imu z"}
    assert not batch.units["imu x"].causes and not batch.units["imu z"].causes
    (cause,) = batch.units["imu y"].rate.causes
    assert cause.term.values[0] == pytest.approx(30.0, abs=4.0 * cause.term.sigmas[0])


def test_a_lean_towards_another_axis_shows_by_that_axis_rate(tmp_path):
    seconds, rng = 900, np.random.default_rng(3)
    rows = round(seconds * RATE_HZ)
    time_s = np.arange(rows) / RATE_HZ
    table_dps = np.where((time_s % 300.0) < 150.0, 12.0, -12.0) * (time_s > 60.0)
    noise = 60.0 * ARW * math.sqrt(RATE_HZ) * rng.standard_normal((3, rows)) / 3600.0
    still = np.tile([[0.0], [0.0], [9.80665]], rows)
    table = {
        "gx": noise[0] + math.radians(0.05) * table_dps, "gy": noise[1], "gz": noise[2] + table_dps,
        "ax": still[0], "ay": still[1], "az": still[2],
    }  # fmt: skip
    file = mapping(tmp_path, table, "angle_deg = 0.0\nprofile = 'turned'\n")
    given = read_recordings([file], gyro="x")
    assert not given.runs[0].missing.any()  # a table's angle is told: nothing is taken for a move
    (cause,) = diagnose(given.runs, MODEL).rate.causes
    assert cause.name == "cross_axis_sensitivity"
    # z is the second axis after x
    assert cause.term.values[1] == pytest.approx(0.05, abs=4.0 * cause.term.sigmas[1])
    assert cause.term.sigmas[1] < 0.01


def test_a_tilt_in_a_rest_changes_the_elevation_and_is_said(tmp_path):
    table = columns(UP[:1], lambda *_: 0.0)
    many = {
        name: np.concatenate([columns(UP[:1], lambda *_: 0.0, seed)[name] for seed in range(2, 12)])
        for name in table
    }
    half = len(many["ax"]) // 2
    many["ax"][half:] += 9.80665 * math.sin(math.radians(0.4))
    (run,) = read_mapped_runs(mapping(tmp_path, many), "x")
    assert not run.missing.any()
    elevation = run.stimulus.elevation_deg
    assert elevation[-200:] - elevation[:200] == pytest.approx(0.4, abs=0.02)
    (remark,) = run.remarks
    assert "tilted by 0.4 deg" in remark and f"step at {half / RATE_HZ:.0f} s" in remark


def test_an_axis_that_the_mapping_does_not_name_is_refused(tmp_path):
    file = mapping(tmp_path, columns(UP[:5], lambda *_: 0.0))
    with pytest.raises(ConfigurationError, match="no such gyro"):
        read_mapped_runs(file, "fog_1")
    named = file.read_text().replace("format = 1", 'format = 1\ngyro = "fog_1"')
    file.write_text(named)  # the name that the gyro has in runs beside it
    (run,) = read_mapped_runs(file, "fog_1")
    assert run.unit_id == "imu"


def test_forces_that_are_not_gravity_tell_no_attitude(tmp_path):
    table = columns(UP[:5], lambda *_: 0.0)
    for axis in "xyz":
        table[f"a{axis}"] *= 0.5
    (run,) = read_mapped_runs(mapping(tmp_path, table))
    assert not run.missing.any() and not run.stimulus.elevation_deg.any()
    assert any("not gravity" in remark for remark in run.remarks)


def test_so_few_attitudes_tell_nothing_of_attitude(tmp_path):
    ups = np.concatenate([np.repeat(UP[k : k + 1], 2, axis=0) for k in range(2)])  # up, up, down, down
    file = mapping(tmp_path, columns(ups, lambda axis, up: 300.0 * up[2]))
    (run,) = read_mapped_runs(file, "z")
    assert any("too few to tell" in remark for remark in run.remarks)
    rests = [run.output_dph[6:100], run.output_dph[-100:-6]]
    assert np.nanmean(rests[0]) == pytest.approx(np.nanmean(rests[1]), abs=10.0)  # of 600
    assert run.stimulus.force_g is None and not np.ptp(run.stimulus.elevation_deg)
    assert not diagnose(read_recordings([file], gyro="z").runs, MODEL).rate.causes


def gyro_alone(folder: Path, rate_dps: np.ndarray) -> Path:
    time_s = np.arange(len(rate_dps)) / RATE_HZ
    np.savetxt(folder / "g.csv", np.column_stack([time_s, rate_dps]), "%.9g", ",", header="t,g", comments="")
    file = folder / "g.toml"
    file.write_text(
        f'format = 1\nunit_id = "u"\nlatitude_deg = {LATITUDE_DEG}\n[columns]\n'
        'time = { name = "t", unit = "s" }\noutput = { name = "g", unit = "deg/s" }\n[[run]]\nfile = "g.csv"\n'
    )
    return file


def test_turns_that_a_gyro_alone_sees_are_left_out_and_each_rest_has_its_bias(tmp_path):
    table = columns(UP[:5], lambda axis, up: 400.0 * up[2])
    (run,) = read_mapped_runs(gyro_alone(tmp_path, table["gz"]))
    assert any("turned 4 times, as its gyros say" in remark for remark in run.remarks)
    for number in range(5):
        start = round(number * (REST_S + MOVE_S))
        inside = slice(start + 3, start + round(REST_S) - 3)
        assert not run.missing[inside].any()
        assert np.nanmean(run.output_dph[inside]) == pytest.approx(np.nanmean(run.output_dph), abs=3.0)
        if number:
            assert run.missing[start - round(MOVE_S) + 1 : start - 1].all()


def test_a_gyro_that_turns_most_of_the_time_is_left_as_it_is_and_that_is_said(tmp_path):
    time_s = np.arange(round(300 * RATE_HZ)) / RATE_HZ
    swinging = np.where(time_s < 60.0, 0.0, 30.0 * np.sin(2.0 * np.pi * time_s / 7.0))
    noise = 0.01 * np.random.default_rng(2).standard_normal(len(time_s))
    (run,) = read_mapped_runs(gyro_alone(tmp_path, swinging + noise))
    assert not run.missing.any() and any("most of the time" in remark for remark in run.remarks)


def test_a_step_beside_a_move_is_no_rest():
    """Steps of ten rows; rows 26 to 33 move: the steps that hold them, and one on either side, are left out."""
    rest = np.ones(100, bool)
    rest[26:34] = False
    steps = SimpleNamespace(count=10, owner=np.arange(100) // 10)
    rests = _rests(SimpleNamespace(rest=rest), np.arange(100), steps)
    assert np.flatnonzero(~rests).tolist() == [1, 2, 3, 4]
