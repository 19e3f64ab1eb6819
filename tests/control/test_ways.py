"""Rules on the table's angle, on the circle: what is passed on the way counts, before a command and after it."""

from __future__ import annotations

import math
from pathlib import Path
from types import SimpleNamespace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from bench.control.history import History
from bench.control.limits import LimitWatch, Reach, breaks
from bench.control.ways import require_between_stops, require_no_stops, way_to
from bench.lab.emulated import EmulatedLab, Plant
from bench.lab.testing import TestBench
from bench.record.benchfile import Band, BenchFile, ForbiddenState, LimitsSection, load_bench_file
from drivers.base.errors import ConfigurationError, LimitExceeded
from drivers.kit.config import AxisConfig
from tests.benches import FOG_BENCH
from tests.control.test_stations import Bench, Table

FREE = AxisConfig(name="inner", number=1, direction="up")
STOPPED = AxisConfig(name="tilt", number=1, direction="up", min_angle_deg=-170.0, max_angle_deg=170.0)


def zone(above: float | None, below: float | None) -> ForbiddenState:
    return ForbiddenState(name="cable", angle_deg=Band(above=above, below=below), rate_dps=Band(above=0.5))


def passes(rule: ForbiddenState, low: float, high: float) -> bool:
    return breaks(rule, Reach((5.0, 5.0), (low, high), (20.0, 20.0), (20.0, 20.0), (), False))


@pytest.mark.parametrize(
    ("above", "below", "low", "high", "passed"),
    [(170.0, 190.0, 10.0, 365.0, True), (170.0, 190.0, -10.0, 10.0, False), (-10.0, -1.0, 345.0, 353.0, True),
     (350.0, 10.0, 300.0, 355.0, True), (350.0, 10.0, 20.0, 340.0, False), (350.0, 10.0, -5.0, -5.0, True),
     (355.0, None, 340.0, 380.0, True), (355.0, None, 0.0, 354.0, False), (None, 10.0, 20.0, 359.0, False),
     (None, 10.0, 350.0, 360.5, True), (170.0, 190.0, 170.0, 170.0, False), (170.0, 190.0, 180.0, 180.0, True),
     (0.0, 360.0, 5.0, 5.0, True)],
)  # fmt: skip
def test_a_way_passes_a_zone_on_the_circle(
    above: float | None, below: float | None, low: float, high: float, passed: bool
) -> None:
    for turns in (-720.0, 0.0, 360.0):
        assert passes(zone(above, below), low + turns, high + turns) is passed


@given(
    begin=st.floats(-360.0, 360.0), width=st.floats(1.0, 300.0), low=st.floats(-720.0, 720.0),
    length=st.floats(0.0, 400.0),
)  # fmt: skip
def test_a_way_passes_a_zone_if_one_of_its_angles_is_in_it(
    begin: float, width: float, low: float, length: float
) -> None:
    ways = ((low + length * k / 4000.0 - begin) % 360.0 for k in range(4001))
    inside = any(1e-9 < way < width - 1e-9 for way in ways)
    passed = passes(zone(begin, begin + width), low, low + length)
    assert passed or not inside
    if not inside:  # but for what lies between the angles that were tried
        edges = [(low - begin) % 360.0, (low + length - begin) % 360.0]
        assert not passed or min(min(edge % 360.0, abs(edge - width), 360.0 - edge) for edge in edges) < 0.2


@pytest.mark.parametrize(
    ("axis", "now", "angle_deg", "by_deg", "way"),
    [(FREE, (350.0, 0.0), 10.0, None, (350.0, 370.0)), (FREE, (10.0, 0.0), 350.0, None, (-10.0, 10.0)),
     (FREE, (10.0, 0.0), 5.0, 355.0, (10.0, 365.0)), (FREE, (10.0, 3.0), 350.0, None, (10.0, 370.0)),
     (FREE, (10.0, 0.0), 190.0, None, (10.0, 370.0)), (FREE, None, 10.0, None, (0.0, 360.0)),
     (STOPPED, (160.0, 0.0), -160.0, None, (-160.0, 160.0)), (STOPPED, (200.0, 0.0), 0.0, None, (-160.0, 0.0)),
     (STOPPED, (100.0, 0.0), 90.0, 350.0, (100.0, 450.0))],
)  # fmt: skip
def test_the_way_to_an_angle(
    axis: AxisConfig, now: tuple[float, float] | None, angle_deg: float, by_deg: float | None,
    way: tuple[float, float],
) -> None:  # fmt: skip
    assert way_to(axis, now, angle_deg, by_deg) == pytest.approx(way)


def test_an_axis_with_stops_is_pointed_between_them_only() -> None:
    require_between_stops(STOPPED, 90.0, (-160.0, 90.0), "tilt")
    for angle_deg, way in ((171.0, (0.0, 171.0)), (90.0, (100.0, 450.0)), (90.0, (-280.0, 100.0))):
        with pytest.raises(LimitExceeded, match="beyond the stops"):
            require_between_stops(STOPPED, angle_deg, way, "tilt")
    require_between_stops(FREE, 90.0, (100.0, 450.0), "inner")
    require_no_stops(FREE, 5.0, "inner")
    with pytest.raises(LimitExceeded, match="an axis with stops cannot spin"):
        require_no_stops(STOPPED, 5.0, "tilt")


def bench_with(rule: ForbiddenState) -> Bench:
    bench = Bench(Table())
    bench.file.limits = LimitsSection(max_rate_dps=50.0, forbid=(rule,))
    chamber = SimpleNamespace(
        history=History(("air_temp_c", "set_point_c")), auxiliary_c=(), set_point_c=20.0
    )
    chamber.history.append(0.0, 20.0, 20.0)
    bench.limits = LimitWatch(bench.file.limits, bench, bench.station, chamber, {})  # type: ignore[arg-type]
    bench.now = lambda: bench.time_s
    bench.station.history.append(0.0, 10.0, 0.0)
    return bench


@pytest.mark.parametrize(
    ("order", "refused"),
    [(lambda table: table.point(5.0, sense="positive"), True), (lambda table: table.spin(5.0), True),
     (lambda table: table.point(350.0), False), (lambda table: table.point(169.0), False),
     (lambda table: table.point(5.0, sense="negative"), False), (lambda table: table.point(171.0), True)],
)  # fmt: skip
def test_a_command_that_passes_a_zone_is_not_sent(order: object, refused: bool) -> None:
    bench = bench_with(zone(170.0, 190.0))
    table = bench.station.device
    table.point = lambda angle_deg, axis="": table.told.append(("point", angle_deg))
    table.turn = lambda by_deg, axis="": table.told.append(("turn", by_deg))
    bench.poll = lambda: None
    bench.wait_until = lambda *_, **__: True
    if refused:
        with pytest.raises(LimitExceeded, match="cable"):
            order(bench.station)  # type: ignore[operator]
    else:
        order(bench.station)  # type: ignore[operator]
    assert bool(table.told) is not refused


def test_what_is_demanded_already_counts_before_telemetry_shows_it() -> None:
    """Told to spin at 15 deg/s, and 0.2 s later to cool: the table still turns slowly, and will not."""
    rule = ForbiddenState(name="cold", rate_dps=Band(above=10.0), air_temp_c=Band(below=-20.0))
    bench = bench_with(rule)
    bench.limits.allow("go to -30 degC", set_point_c=-30.0)
    bench.station.spin(15.0, settle=False)
    with pytest.raises(LimitExceeded, match="cold"):
        bench.limits.allow("go to -30 degC", set_point_c=-30.0)
    bench.station.spin(0.0, settle=False)
    bench.limits.allow("go to -30 degC", set_point_c=-30.0)
    bench.station.point(90.0, settle=False)  # at the rate of turns, until it is there
    with pytest.raises(LimitExceeded, match="cold"):
        bench.limits.allow("go to -30 degC", set_point_c=-30.0)


def test_between_two_polls_the_way_counts() -> None:
    """At 50 deg/s a zone of 20 deg lies between two polls."""
    bench = bench_with(zone(170.0, 190.0))
    for time_s, angle_deg in ((1.0, 100.0), (2.0, 144.0)):
        bench.station.history.append(time_s, angle_deg, 44.0)
        bench.limits.look()
    bench.station.history.append(3.0, 194.0, 44.0)
    with pytest.raises(LimitExceeded, match="cable"):
        bench.limits.look()


def test_a_table_of_an_emulated_lab_goes_round_a_zone(tmp_path: Path) -> None:
    text = FOG_BENCH + (
        '\n[[limits.forbid]]\nname = "cable"\nangle_deg = { above = 350, below = 10 }\nrate_dps = { above = 1 }\n'
    )
    (tmp_path / "bench.toml").write_text(text)
    seen: list[float] = []

    def drive(bench: object) -> None:
        table = bench.table  # type: ignore[attr-defined]
        table.engage()
        seen.append(table.angle_deg())
        with pytest.raises(LimitExceeded, match="cable"):
            table.spin(5.0, across=True)

    with EmulatedLab(load_bench_file(tmp_path / "bench.toml"), Plant(seed=5)) as lab:
        result = TestBench(lab.file, tmp_path / "runs", lambda *_: None, lab=lab).drive(drive, judge=False)
    assert result.outcome == "completed" and len(seen) == 1


def loaded(tmp_path: Path, rule: str) -> BenchFile:
    (tmp_path / "bench.toml").write_text(f"{FOG_BENCH}\n[[limits.forbid]]\nname = 'r'\n{rule}\n")
    return load_bench_file(tmp_path / "bench.toml")


@pytest.mark.parametrize(
    ("rule", "words"),
    [("rate_dps = { below = -5 }", "never below 0"), ("air_temp_c = { above = 20, below = 20 }", "never be true"),
     ("angle_deg = { below = -0.5 }", "from 0 to 360"), ("angle_deg = { above = 400 }", "from 0 to 360")],
)  # fmt: skip
def test_a_condition_that_can_never_hold_is_refused(tmp_path: Path, rule: str, words: str) -> None:
    with pytest.raises(ConfigurationError, match=r"limits\.forbid") as refused:
        loaded(tmp_path, rule)
    assert words in str(refused.value)


def test_a_rule_on_sensors_needs_one(tmp_path: Path) -> None:
    for rule in ("angle_deg = { above = 350, below = 10 }", "angle_deg = { above = -10, below = 10 }"):
        band = loaded(tmp_path, rule).limits.forbid[0].angle_deg
        assert band is not None and math.isclose(band.arc_deg[1], 20.0)
    bare = "\n".join(
        line for line in FOG_BENCH.splitlines() if not line.startswith(("auxiliary", "case_sensor"))
    )
    (tmp_path / "bare.toml").write_text(
        f"{bare}\n[[limits.forbid]]\nname = 'r'\naux_temp_c = {{ above = 60 }}\n"
    )
    with pytest.raises(ConfigurationError, match="aux_temp_c"):
        load_bench_file(tmp_path / "bare.toml")
