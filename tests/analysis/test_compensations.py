"""One reader for every kind of compensation file."""

import numpy as np
import pytest

from bench.analysis.calibration import ImuCompensation
from bench.analysis.common.state_file import write_state
from bench.analysis.compensations import load_compensation
from bench.analysis.rlg import RlgCompensation
from bench.analysis.thermal import Compensation
from bench.analysis.whirl import WhirlCompensation
from drivers.base.errors import RecordError


def imu() -> ImuCompensation:
    return ImuCompensation(
        "IMU-7", np.arange(24.0), np.ones(24), np.eye(24), np.zeros((2, 3)), 0.0, "t22", 1.0
    )


def whirl() -> WhirlCompensation:
    return WhirlCompensation("INS-1", (1,), np.array([1.0 + 2.0j]), np.ones(1), "mean", 0j, 0j, 10.0)


def ring_laser() -> RlgCompensation:
    return RlgCompensation("RLG-3", ("T",), (0.5,), 0.1, (0.0, 40.0), (-1.0, 1.0), {"run": "ab"})


@pytest.mark.parametrize("made", [imu, whirl, ring_laser])
def test_the_file_says_what_it_is(made, tmp_path):
    saved = made()
    saved.save(tmp_path / "any.name")
    found = load_compensation(tmp_path / "any.name")
    assert type(found) is type(saved)
    assert found.unit_id == saved.unit_id


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"no zip", "not a readable compensation file"),
        (b'{"format": "recipe-1"}', "not a readable compensation file"),
        (b"PK\x03\x04 cut short", "not a readable compensation file"),
    ],
)
def test_a_file_that_is_none_is_refused(content, words, tmp_path):
    path = tmp_path / "x.gyrocomp"
    path.write_bytes(content)
    with pytest.raises(RecordError, match=words):
        load_compensation(path)


def test_a_kind_of_a_later_version_is_refused(tmp_path):
    write_state(tmp_path / "x", {"kind": "odometer", "format": 1})
    with pytest.raises(RecordError, match="kind odometer"):
        load_compensation(tmp_path / "x")


def test_the_loader_of_one_kind_names_the_other(tmp_path):
    imu().save(tmp_path / "x")
    with pytest.raises(RecordError, match=r"imu-calibration.*load_compensation"):
        Compensation.load(tmp_path / "x")
