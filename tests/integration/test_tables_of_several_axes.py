"""Tests of one gyro axis on a table of several: the outer axes are brought to 0, or the table is refused."""

from __future__ import annotations

import tomllib

import numpy as np
import pyarrow.parquet as pq
import pytest

from bench.analysis.gap._recordings import load_channels
from bench.campaign import check_limits, load_campaign
from bench.control.procedure import Demands, Parameters, Procedure, find_procedure
from bench.control.questions import EmulatedOperator
from bench.control.runner import RunRequest, run_procedure
from bench.lab.emulated import EmulatedLab, Plant
from bench.record.benchfile import bench_file_from
from bench.record.recording import read_events, read_manifest
from drivers.base.errors import ConfigurationError
from tests.benches import BENCH, FOG
from tests.integration.conftest import SHORTEST

ELSEWHERE_DEG = 37.0


def _tilt(bench, p):
    bench.table.engage()
    bench.table.point(ELSEWHERE_DEG, "outer")


TILT = Procedure("tilt", "", "", Parameters, _tilt, lambda _: 0.0, lambda _: Demands(), upright=False)


def _drive(lab, runs, procedure, **parameters):
    values = procedure.parse(parameters)
    hand, emulated = EmulatedOperator(lab.perform), {"seed": 3, "model": "test"}
    return run_procedure(
        RunRequest(procedure, values, lab.file, runs, hand, run_id=procedure.name, emulated=emulated)
    )


def bench_on(outer: str, inner: str):
    axes = [
        {"name": "outer", "number": 1, "direction": outer},
        {"name": "inner", "number": 2, "direction": inner},
    ]
    data = tomllib.loads(BENCH + FOG)
    return bench_file_from({**data, "table": {**data["table"], "axes": axes}})


def test_east_is_found_on_two_axes_though_the_outer_one_was_elsewhere(tmp_path):
    procedure = find_procedure("zero-bias-cold-shock")
    with EmulatedLab(bench_on("east", "up"), Plant(seed=3, mount_azimuth_error_deg=0.4)) as lab:
        assert _drive(lab, tmp_path, TILT).outcome == "completed"
        result = _drive(lab, tmp_path, procedure, **SHORTEST)
    assert result.outcome == "completed", result.reason
    found = {row["name"]: row["value"] for row in read_manifest(result.folder).measurements}
    # 60 s a dwell of a FOG of 0.004 deg/sqrt(h), against 11.7 deg/h of Earth rate: 0.1 deg are five sigma
    assert found["azimuth_error"] == pytest.approx(0.4, abs=0.15)
    table = pq.read_table(result.folder / "turntable.parquet")
    outer = table["outer_angle_deg"].to_numpy()
    assert abs(outer[0] - ELSEWHERE_DEG) < 0.01
    (prompt,) = [row["question"] for row in read_events(result.folder).rows if row["kind"] == "prompt"]
    assert prompt.startswith("With outer at 0 deg: Mount the units")
    # from the first dwell to the end the outer axis is at 0
    assert abs((outer[60:] + 180.0) % 360.0 - 180.0).max() < 0.001


@pytest.mark.parametrize("procedure", ["standard-test", "zero-bias-cold-shock", "constant-rotation"])
def test_a_table_whose_last_axis_lies_is_refused_before_anything_is_opened(tmp_path, procedure):
    file, test = bench_on("up", "north"), find_procedure(procedure)
    with pytest.raises(ConfigurationError) as refused:
        run_procedure(RunRequest(test, test.parse({}), file, tmp_path, None))
    assert refused.value.where == "table.axes, the last one"
    assert refused.value.found == "inner points north with all axes at 0"
    assert not list(tmp_path.iterdir())


def test_a_campaign_for_another_table_is_refused_when_it_is_planned(tmp_path):
    path = tmp_path / "campaign.toml"
    path.write_text('title = "T"\n[[run]]\nname = "a"\nprocedure = "standard-test"\n')
    file = bench_on("up", "north")
    with pytest.raises(ConfigurationError, match="inner points north"):
        check_limits(load_campaign(path, file), file)


def _rest(bench, p):
    bench.table.engage()
    bench.table.point(89.12345678)
    bench.wait(200.0, "at rest")
    bench.table.point(ELSEWHERE_DEG, "outer")  # the inner axis stays where it is meanwhile
    bench.wait(200.0, "at rest")


def test_after_400_s_of_rest_the_diagnosis_sees_the_table_held_at_its_angle(tmp_path):
    rest = Procedure("rest", "", "", Parameters, _rest, lambda _: 0.0, lambda _: Demands(), upright=False)
    with EmulatedLab(bench_on("east", "up"), Plant(seed=3)) as lab:
        result = _drive(lab, tmp_path, rest)
    series, missing = load_channels(result.folder)
    assert "table_angle" not in missing
    (held,) = [channel for channel in series if channel.channel == "table_angle"]
    assert np.all(held.inputs.angle_deg == 89.12345678)
    assert 380.0 < held.inputs.time_s[-1] - held.inputs.time_s[0] < 420.0
    angle_deg = pq.read_table(result.folder / "turntable.parquet")["angle_deg"].to_numpy()[-100:]
    off_arcsec = 3600.0 * (np.mean(angle_deg) - 89.12345678)  # of the demand to its last digit
    assert held.values[-10:] == pytest.approx(off_arcsec, abs=1e-3) and abs(off_arcsec) < 3.6
