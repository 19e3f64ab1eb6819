"""A recording that is named twice is no further observation: fits, figures and certificates refuse it."""

from __future__ import annotations

import math
from types import SimpleNamespace

import pytest

from bench.analysis.common.runs import require_different, require_separate
from bench.analysis.gap._findings import refuse_judges
from bench.record.events.run import Measured, labels
from drivers.base.errors import ConfigurationError
from procedures.standard_test import turned_for


def run(name: str, checksum: str) -> SimpleNamespace:
    return SimpleNamespace(run_id=name, unit_id="U", checksum=checksum)


def test_a_recording_twice_is_refused_whatever_it_is_called() -> None:
    require_different([("a", "1"), ("b", "2"), ("c", ""), ("d", "")])
    with pytest.raises(ConfigurationError, match="named twice") as refused:
        require_different([("a", "1"), ("b", "2"), ("copy", "1")])
    assert refused.value.found == "a and copy"
    for training, judging in (
        ([run("a", "1"), run("a", "1")], []), ([run("a", "1")], [run("b", "2"), run("c", "2")])
    ):  # fmt: skip
        with pytest.raises(ConfigurationError, match="named twice"):
            require_separate(training, judging)
    require_separate([run("a", "1"), run("b", "2")], [run("c", "3")])


@pytest.mark.parametrize(
    ("judge", "refused"),
    [(("a", "1"), True), (("copy", "1"), True), (("a", "9"), False), (("a", ""), True), (("b", "2"), False),
     (("old", "9"), True), (("old", ""), True)],
)  # fmt: skip
def test_who_judges_a_model_is_told_by_the_recording_and_not_by_its_name(
    judge: tuple[str, str], refused: bool
) -> None:
    """`old` is of a file without checksums: only its name is known."""
    used = [("a", "1"), ("old", "")]
    if refused:
        with pytest.raises(ConfigurationError, match="cannot judge"):
            refuse_judges([judge], used)
    else:
        refuse_judges([judge], used)


def test_measurements_of_several_gyros_are_told_apart() -> None:
    def item(name: str, gyro: str | None) -> Measured:
        return Measured.against(name, 1.0, "deg/h", None, None, gyro)

    assert labels([item("rest", "a"), item("rest", "b"), item("air", None), item("east", "a")]) == [
        "rest of a", "rest of b", "air", "east"
    ]  # fmt: skip


@pytest.mark.parametrize("latitude_deg", [0.0, 39.1, 52.0, 66.0, 75.0, 85.0])
@pytest.mark.parametrize("from_east_deg", [0.0, 45.0])
@pytest.mark.parametrize("wanted_dph", [-0.05, -2.4, -9.6])
def test_what_is_put_in_is_what_the_axis_feels(
    latitude_deg: float, from_east_deg: float, wanted_dph: float
) -> None:
    """The Earth's rate on an axis that points so far past east, before the turn and after it."""
    north = 15.041 * math.cos(math.radians(latitude_deg))
    start = math.radians(from_east_deg)
    turn, input_dph = turned_for(wanted_dph, start, north)
    felt = north * (math.cos(math.pi / 2.0 + start + turn) - math.cos(math.pi / 2.0 + start))
    assert input_dph == pytest.approx(felt, abs=1e-9)
    most = north * (1.0 + math.sin(start))
    assert abs(input_dph) == pytest.approx(min(abs(wanted_dph), most), rel=1e-9)
    if abs(wanted_dph) <= north * (1.0 - math.sin(start)):
        assert input_dph == pytest.approx(wanted_dph)
