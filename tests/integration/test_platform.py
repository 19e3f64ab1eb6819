"""A platform INS on the emulated bench: heading change from bytes to a log that can be fitted."""

import math
from pathlib import Path

import numpy as np
import pytest

from bench.analysis.gap._position import is_platform_run, load_platform_run
from bench.analysis.gap._run_folder import load_gap_runs
from bench.analysis.heading import load_log, site_of_run, stays
from bench.analysis.heading._modulus import modulus_test
from bench.control.procedure import find_procedure
from bench.control.questions import AssumeYes
from bench.control.runner import RunRequest, run_procedure
from bench.lab.emulated import EmulatedLab, Plant, unit_seed
from bench.present.cli.gap._diagnose import diagnose
from bench.record.benchfile import load_bench_file
from bench.record.recording import Run, read_table
from drivers.base.constants import SIDEREAL_DAY_S, UG_MPS2
from drivers.base.errors import ConfigurationError, RecordError
from simulators.config import Accelerometers
from simulators.plant.accelerometers import draw_accelerometers
from simulators.plant.space_stable import SpaceStablePlatform, draw_platform

PLATFORM_BENCH = """
[bench]
name = "platform bench"
latitude_deg = 40.0
[table]
driver = "acutrol3000"
port = "/dev/ttyS0"
[chamber]
driver = "weiss"
port = "/dev/ttyS1"
[[platform]]
name = "pins_1"
driver = "platform_ins"
unit = "PINS-001"
port = "/dev/ttyS2"
longitude_deg = 116.0
"""


@pytest.fixture(scope="module")
def platform_file(tmp_path_factory):
    path = tmp_path_factory.mktemp("bench") / "platform.toml"
    path.write_text(PLATFORM_BENCH)
    return load_bench_file(path)


@pytest.fixture(scope="module")
def heading_run(bench, platform_file, tmp_path_factory):
    """The folder of a run over two headings, too short for any fit."""
    with EmulatedLab(platform_file, Plant(seed=5)) as lab:
        procedure = find_procedure("heading-change")
        result = run_procedure(
            RunRequest(
                procedure,
                procedure.parse({"headings_deg": "0, 90", "stays_h": "2", "warm_up_h": 1}),
                lab.file,
                tmp_path_factory.mktemp("runs"),
                AssumeYes(),
                emulated={"seed": 5, "model": "platform"},
            )
        )
    assert result.outcome == "invalid" and "silent" not in result.reason
    assert "at least three are needed" in result.reason and "a sidereal day is needed" in result.reason
    return result.folder


def test_the_table_holds_what_the_unit_sent(bench, heading_run):
    run = Run.open(heading_run)
    table = read_table(heading_run / "platform_pins_1.parquet")
    assert run.manifest.units == {"pins_1": "PINS-001"}
    assert run.manifest.devices["pins_1"].serial_number == "PINS-001"
    assert run.manifest.stream["pins_1"]["lost"] == 0
    assert bench.problems(heading_run) == []
    assert np.diff(table["time_ns"]) == pytest.approx(60e9, abs=1e6)
    navigating = table["valid"]
    begun_s = table["time_ns"][np.argmax(navigating)] * 1e-9
    assert begun_s == pytest.approx(3600.0, abs=120.0)
    assert navigating[np.argmax(navigating) :].all()


def test_positions_and_temperatures_are_the_plant_s(heading_run):
    """Against the plant run at once over the whole time, on headings as the table's telemetry has them."""
    table = read_table(heading_run / "platform_pins_1.parquet")
    turned = read_table(heading_run / "turntable.parquet")
    step = np.rint(table["time_ns"] / 60e9).astype(int)
    grid_s = 60.0 * np.arange(step[-1] + 1)
    heading = np.interp(grid_s, turned["time_ns"] * 1e-9, np.unwrap(turned["angle_deg"], period=360.0))
    parameters = draw_platform(unit_seed("PINS-001"), effect_dph=1e-3, latitude_deg=40.0)
    plant = SpaceStablePlatform(parameters, 5, 60.0, angle_rad=math.radians(116.0), navigation="nonlinear")
    first = int(step[np.argmax(table["valid"])])
    before = plant.advance(heading[:first])
    plant.align()
    after = plant.advance(heading[first:])
    north, east, temp = (
        np.concatenate([getattr(before, name), getattr(after, name)])[step]
        for name in ("north_as", "east_as", "temp_c")
    )
    turning = int(np.argmax(np.abs(np.diff(heading)) > 0.1)) - int(step[0])
    level = math.cos(math.radians(40.0))
    found_north = 3600.0 * (table["latitude_deg"] - 40.0)
    found_east = 3600.0 * (table["longitude_deg"] - 116.0) * level
    # In the minute of the turn telemetry tells the heading to some degrees only; what that makes stays.
    for part, within_as, within_k in ((slice(turning), 0.02, 1e-4), (slice(turning, None), 0.5, 2e-3)):
        assert table["temp_c"][part] == pytest.approx(temp[part], abs=within_k)
        assert found_north[part] == pytest.approx(north[part], abs=within_as)
        assert found_east[part] == pytest.approx(east[part], abs=within_as)
    assert np.ptp(north[turning:]) > 5.0


def test_the_run_folder_is_a_log_for_the_fit(heading_run):
    site = site_of_run(heading_run)
    assert (site.latitude_deg, site.longitude_deg, site.sidereal_zero_deg) == (40.0, 116.0, None)
    log, cabinet = load_log(heading_run, site)
    assert cabinet is not None and len(cabinet) == len(log.time_s)
    assert [stay.heading_deg for stay in stays(log)] == pytest.approx([0.0, 90.0], abs=0.01)
    aligned = np.isfinite(log.north_as)
    assert not aligned[0] and aligned[-1]
    assert log.time_s[np.argmax(aligned)] - log.time_s[0] <= SIDEREAL_DAY_S
    with pytest.raises(RecordError, match="not a run folder"):
        site_of_run(heading_run.parent)


def test_the_modulus_of_specific_force_is_tested_from_the_record(bench, tmp_path):
    """From the bench file to the test, with accelerometers that pull with heading."""
    path = tmp_path / "platform.toml"
    path.write_text(PLATFORM_BENCH + "accelerometers = true\n")
    sizes, procedure = Accelerometers(heading_ug=30.0), find_procedure("heading-change")
    with EmulatedLab(load_bench_file(path), Plant(seed=3, accelerometers={"PINS-001": sizes})) as lab:
        asked = {"headings_deg": "0, 180", "stays_h": "24", "warm_up_h": 0, "telemetry_s": 60}
        told = {"seed": 3, "model": "platform"}
        run = run_procedure(
            RunRequest(procedure, procedure.parse(asked), lab.file, tmp_path, AssumeYes(), emulated=told)
        )
    assert bench.problems(run.folder) == []
    test = modulus_test(load_log(run.folder, site_of_run(run.folder))[0])
    assert test is not None and test.changed
    # b = -2 m at 180 deg, and |f| changes by u . b: up times z, level times x and y
    pull = -2.0 * draw_accelerometers(unit_seed("PINS-001"), sizes).heading_mps2[0] / UG_MPS2
    level, up = np.cos(np.radians(40.0)), np.sin(np.radians(40.0))
    assert test.change_ug[0] == pytest.approx(pull[[2, 0, 1]] * [up, level, level], abs=6.0)


@pytest.mark.parametrize(
    ("file", "procedure", "has", "needs"),
    [
        ("platform_file", "zero-bias-cold-shock", "pins_1", "gyro"),
        ("fog_file", "heading-change", "fog_1", "platform"),
    ],
)
def test_a_procedure_for_what_the_bench_has_not_is_refused(
    request, bench, tmp_path, file, procedure, has, needs
):
    with pytest.raises(ConfigurationError) as refused:
        bench.drive(request.getfixturevalue(file), tmp_path, find_procedure(procedure))
    assert has in refused.value.found and f"[[{needs}]]" in refused.value.expected
    assert not list(tmp_path.glob("*/manifest.json"))  # nothing was begun


def test_a_gap_diagnosis_takes_a_platform_s_run_for_what_it_is(heading_run):
    assert is_platform_run(heading_run)
    loaded = load_platform_run(heading_run)
    assert loaded.unit_id == "PINS-001"
    assert len(loaded.log.time_s) > 100
    model = Path(__file__).parents[2] / "examples" / "nominal" / "heading_change.toml"
    with pytest.raises(RecordError, match="at least three are needed"):
        diagnose([heading_run], model, [], None, False)
    with pytest.raises(ConfigurationError, match="the run has no gyro"):
        load_gap_runs(heading_run)
