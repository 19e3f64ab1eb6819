"""From a log on disk to compensation and report: `fit heading-effect` on CSV and Parquet."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from bench.analysis.compensations import load_compensation
from bench.analysis.heading import (
    HeadingCompensation,
    HeadingCompensator,
    PlatformLog,
    load_log,
    study_heading,
)
from bench.analysis.heading._log import Site
from bench.present.cli.fit._motion import heading_effect
from drivers.base.clock import host_seconds
from drivers.base.errors import ConfigurationError, RecordError
from simulators.plant.space_stable import SpaceStablePlatform, draw_platform

Fly = Callable[..., tuple[PlatformLog, PlatformLog, SpaceStablePlatform]]
TEST = ((0.0, 48.0), (33.0, 41.0), (222.0, 35.0), (131.0, 30.0))
# At the equator the effective latitude is the geodetic one; cos(latitude) = 1.
LATITUDE, LONGITUDE = 0.0, 100.0


def write(path: Path, log: PlatformLog) -> Path:
    columns = {
        "time_s": log.time_s,
        "latitude_deg": LATITUDE + log.north_as / 3600.0,
        "longitude_deg": LONGITUDE + log.east_as / 3600.0,
        "coil_c": log.temp_c,
        "heading_deg": log.heading_deg,
    }
    if path.suffix == ".parquet":
        arrays = [pa.array(column.tolist(), pa.float64()) for column in columns.values()]
        pq.write_table(pa.table(arrays, names=list(columns)), path)
        return path
    rows = zip(*columns.values(), strict=True)
    lines = [",".join(columns), *(",".join(f"{value:.12g}" for value in row) for row in rows)]
    path.write_text("\n".join(lines) + "\n")
    return path


@pytest.fixture(scope="module")
def logs(fly: Fly, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    folder = tmp_path_factory.mktemp("logs")
    parameters = draw_platform(11, latitude_deg=0.0)
    six = tuple((60.0 * k, 48.0) for k in range(6))
    return (
        write(folder / "calibration.csv", fly(parameters, 1, six)[1]),
        write(folder / "sea_trial.parquet", fly(parameters, 2, TEST)[1]),
    )


def test_fit_judge_and_report(logs: tuple[Path, Path], tmp_path: Path) -> None:
    out = tmp_path / "fit"
    heading_effect(logs[0], LATITUDE, LONGITUDE, [logs[1]], out, ["temp_c=coil_c"])
    compensation = load_compensation(out / "heading.gyrocomp")
    assert isinstance(compensation, HeadingCompensation)
    assert list(compensation.runs) == [f"{logs[0].parent.name}/{logs[0].name}"]
    model = compensation.model
    assert model.headings == 5
    page = (out / "report.html").read_text(encoding="utf-8")
    assert "Position before and after" in page and "sea_trial" in page and "Nine coefficients" in page
    assert page.count("<svg") == 2 + 3
    # What was saved compensates as what was fitted.
    study = study_heading(load_log(logs[0], Site(LATITUDE, LONGITUDE), {"temp_c": "coil_c"})[0], {})
    log = load_log(logs[1], Site(LATITUDE, LONGITUDE), {"temp_c": "coil_c"})[0]
    saved, fitted = (
        HeadingCompensator(each).feed(log.time_s, log.sidereal_rad, log.temp_c)
        for each in (model, study.model)
    )
    np.testing.assert_array_equal(saved.phi_as, fitted.phi_as)


def test_held_out_reduction(logs: tuple[Path, Path]) -> None:
    site, names = Site(LATITUDE, LONGITUDE), {"temp_c": "coil_c"}
    study = study_heading(load_log(logs[0], site, names)[0], {"trial": load_log(logs[1], site, names)[0]})
    held = {row.method: row for row in study.judgements if row.held_out}
    # Without a twin that stayed put, the drift's own wander over 100 h counts as heading sensitivity too.
    assert held["lag9"].reduction_percent > 75.0
    assert held["nine coefficients"].reduction_percent > 40.0
    # The course of drift over the window reaches what the calibration's headings make: some 1e-3 deg/h.
    settled_h = (study.course.time_s[study.course.settled] - 240 * 3600.0) / 3600.0
    assert (settled_h < 48.5).all()  # 48 h stays are shorter than 36 h and twice the time constant
    assert 3e-4 < np.ptp(study.course.drift_dph, axis=0).max() < 1e-2


def test_no_compensation_where_friction_rules(fly: Fly, tmp_path: Path) -> None:
    parameters = replace(draw_platform(5, effect_dph=1e-7, latitude_deg=0.0), friction_dph=6e-4)
    six = tuple((60.0 * k, 48.0) for k in range(6))
    path = write(tmp_path / "log.csv", fly(parameters, 1, six)[1])
    out = tmp_path / "fit"
    with pytest.raises(SystemExit) as ended:
        heading_effect(path, LATITUDE, LONGITUDE, [], out, ["temp_c=coil_c"])
    assert ended.value.code == 4
    assert not (out / "heading.gyrocomp").exists()
    assert "Not driven by temperature" in (out / "report.html").read_text(encoding="utf-8")


def test_wrong_files_are_named(logs: tuple[Path, Path], tmp_path: Path) -> None:
    site = Site(LATITUDE, LONGITUDE)
    with pytest.raises(RecordError, match=r"lacks columns.*temp_c.*--column"):
        load_log(logs[0], site)
    with pytest.raises(RecordError, match="no such log"):
        load_log(tmp_path / "none.csv", site)
    with pytest.raises(RecordError, match=r"no such quantity.*depth"):
        load_log(logs[0], site, {"depth": "z"})
    short = tmp_path / "short.csv"
    short.write_text("time_s,latitude_deg\n1,2\n3\n" + 10 * "4,5\n")
    with pytest.raises(RecordError, match=r"not all alike.*1 rows with another number of cells.*'3'"):
        load_log(short, site)
    short.write_text("time_s\n")
    with pytest.raises(ConfigurationError, match="no rows of numbers"):
        load_log(short, site)
    with pytest.raises(RecordError, match="not a readable compensation"):
        HeadingCompensation.load(short)
    with pytest.raises(ConfigurationError, match="quantity=column"):
        heading_effect(logs[0], 0.0, 0.0, column=["coil_c"])
    with pytest.raises(ConfigurationError, match="no model 'lag8'"):
        heading_effect(logs[0], 0.0, 0.0, form="lag8")


def test_a_held_out_log_with_a_wrong_clock_is_refused(logs: tuple[Path, Path]) -> None:
    names = {"temp_c": "coil_c"}
    calibration = load_log(logs[0], Site(LATITUDE, LONGITUDE), names)[0]
    late = load_log(logs[1], Site(LATITUDE, LONGITUDE, sidereal_zero_deg=50.0), names)[0]
    with pytest.raises(RecordError, match=r"as if the clock were \+\d+ min wrong"):
        study_heading(calibration, {"late": late})


def test_two_hundred_hours_at_one_a_minute(fly: Fly) -> None:
    """Fitted and compensated; the time is printed by benchmarks.heading, here it only has to be done."""
    platform = SpaceStablePlatform(draw_platform(3), 5, 60.0)
    platform.advance(np.zeros(240 * 60))
    platform.align()
    heading = np.concatenate([np.full(60 * 50, 90.0 * k) for k in range(4)])
    samples = platform.advance(heading)
    log = PlatformLog(
        samples.time_s,
        samples.angle_rad,
        samples.north_as,
        samples.east_as,
        samples.temp_c,
        heading,
        40.0,
    )
    begin = host_seconds()
    study = study_heading(log, {})
    assert host_seconds() > begin
    assert study.judgements[0].reduction_percent > 80.0


def test_heading_comes_from_the_table_beside_the_log(logs: tuple[Path, Path], tmp_path: Path) -> None:
    whole = pq.read_table(logs[1])
    time_ns = pa.array([round(value * 1e9) for value in whole["time_s"].to_pylist()], pa.int64())
    columns = ["latitude_deg", "longitude_deg", "coil_c"]
    log = pa.table([time_ns, *(whole[name] for name in columns)], names=["time_ns", *columns])
    pq.write_table(log, tmp_path / "platform_ins.parquet")
    pq.write_table(
        pa.table([time_ns, whole["heading_deg"]], names=["time_ns", "angle_deg"]),
        tmp_path / "turntable.parquet",
    )
    site, names = Site(LATITUDE, LONGITUDE), {"temp_c": "coil_c"}
    ours, theirs = (
        load_log(tmp_path / "platform_ins.parquet", site, names)[0],
        load_log(logs[1], site, names)[0],
    )
    np.testing.assert_allclose(ours.time_s, theirs.time_s)
    np.testing.assert_array_equal(ours.heading_deg, theirs.heading_deg)
