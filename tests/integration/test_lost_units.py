"""A unit that dies during a run: what the others send is whole, and the record says who died and when."""

import json

import pytest

from bench.control.procedure import Demands, Parameters, Procedure, find_procedure
from bench.control.questions import EmulatedOperator
from bench.lab.emulated import EmulatedLab, Plant
from bench.record.recording import read_exchanges, read_manifest
from drivers.base.errors import DeviceSilent, LinkLost
from procedures.standard_test import power_cycle
from procedures.zero_bias_cold_shock import ZeroBiasParameters, find_east
from simulators.faults import Fault


def plant(port, kind, at_s, duration_s):
    fault = Fault(port=port, kind=kind, at_s=(at_s,), duration_s=duration_s)
    return Plant(seed=5, delivery_s=1.0, fault=(fault,))


def alarms(folder):
    rows = [json.loads(line) for line in (folder / "events.jsonl").read_text().splitlines()]
    return [(row["device"], row["code"], row["time_s"]) for row in rows if row["kind"] == "alarm"]


@pytest.mark.parametrize(("dead", "other"), [("can_1", "fog_1"), ("fog_1", "can_1")])
def test_of_two_gyros_one_dies_and_the_record_of_the_other_is_whole(bench, both_file, tmp_path, dead, other):
    with bench.lab(both_file, Plant(seed=5, delivery_s=1.0)) as lab:
        well = bench.drive(lab.file, tmp_path / "well", hold_s=40.0)
    assert well.outcome == "completed"
    with bench.lab(both_file, plant(dead, "vanish", 25.5, 1e6)) as lab:
        result = bench.drive(lab.file, tmp_path / "ill", hold_s=40.0)
    assert result.outcome == "invalid" and dead in result.reason and "the port is gone" in result.reason
    (row,) = [row for row in alarms(result.folder) if row[0] == dead]
    assert row[1] == "unit_lost" and 25.5 <= row[2] < 27.0
    raw = [(folder / "raw" / f"{other}.bin").read_bytes() for folder in (well.folder, result.folder)]
    assert raw[0] == raw[1] and len(raw[0]) > 10_000
    before = (well.folder / "raw" / f"{dead}.bin").read_bytes()
    cut = (result.folder / "raw" / f"{dead}.bin").read_bytes()
    assert before.startswith(cut) and len(cut) < len(before)
    stream = read_manifest(result.folder).stream
    assert stream[dead]["frames"] >= 2400 - 400  # what the lab had sent by then, short of what was on its way
    assert bench.problems(result.folder) == []


def test_the_last_gyro_that_dies_ends_the_run_a_minute_later(bench, fog_file, tmp_path):
    with bench.lab(fog_file, plant("fog_1", "vanish", 25.5, 1e6)) as lab:
        result = bench.drive(lab.file, tmp_path, hold_s=600.0)
    assert result.outcome == "aborted" and isinstance(result.error, LinkLost)
    assert "NOT CONFIRMED" not in result.reason
    assert bench.problems(result.folder) == []


def test_a_bench_file_may_want_the_end_as_soon_as_the_last_gyro_dies(bench, fog_file, tmp_path):
    hasty = fog_file.model_copy(update={"safe": fog_file.safe.model_copy(update={"last_unit_s": 0.0})})
    with bench.lab(hasty, plant("fog_1", "vanish", 25.5, 1e6)) as lab:
        result = bench.drive(lab.file, tmp_path, hold_s=600.0)
    assert result.outcome == "aborted" and "no gyro is left to test" in result.reason
    assert "NOT CONFIRMED" not in result.reason and result.duration_s < 30.0
    (lost,) = (row[2] for row in alarms(result.folder) if row[1] == "unit_lost")
    told = min(
        t / 1e9
        for t, way, data in read_exchanges(result.folder, "table")
        if way == "sent" and data == b":mode:off 1\r\n" and t / 1e9 > 20.0
    )
    assert 0.0 <= told - lost < 0.05


def test_silence_of_one_is_told_and_of_all_ends_the_run(bench, both_file, fog_file, tmp_path):
    with bench.lab(both_file, plant("can_1", "silence", 20.5, 30.0)) as lab:
        result = bench.drive(lab.file, tmp_path / "one", hold_s=60.0)
    assert result.outcome == "invalid" and "can_1 fell silent at 20." in result.reason
    silent, again = (row for row in alarms(result.folder) if row[0] == "can_1")
    assert silent[1] == "unit_silent" and 30.0 < silent[2] < 33.0
    assert again[1] == "unit_speaks" and 50.5 < again[2] < 53.0
    with bench.lab(fog_file, plant("fog_1", "silence", 20.5, 1e6)) as lab:
        result = bench.drive(lab.file, tmp_path / "all", hold_s=600.0)
    assert result.outcome == "aborted" and isinstance(result.error, DeviceSilent)
    assert 80.0 < result.duration_s < 85.0


def test_a_unit_that_is_silent_to_the_end_and_does_not_obey_the_stop_ends_no_run_as_aborted(
    bench, both_file, tmp_path
):
    """Its answer to the stop at the end was missed, and the other unit's run counted as aborted."""
    with bench.lab(both_file, plant("fog_1", "silence", 20.5, 1e6)) as lab:
        result = bench.drive(lab.file, tmp_path, hold_s=60.0)
    assert result.outcome == "invalid" and "fog_1 fell silent at 20." in result.reason
    log = (result.folder / "events.jsonl").read_text()
    assert "fog_1 was not stopped: " in log and "can_1 was not stopped" not in log
    assert bench.problems(result.folder) == []


def test_east_is_judged_by_the_other_gyro_when_the_first_is_unplugged_meanwhile(bench, both_file, tmp_path):
    """It used to turn 90 deg off east, and then to wait for an equilibrium that nobody could see."""

    def east(bench, _):
        bench.ask(f"Is {bench.judge.name} mounted?", act="mount", mounting="axis_horizontal")
        bench.table.device.servo_on()
        find_east(bench, ZeroBiasParameters(east_dwell_s=60))

    procedure = Procedure("east", "", "", Parameters, east, lambda _: 0.0, lambda _: Demands())
    with EmulatedLab(both_file, plant("fog_1", "vanish", 90.5, 1e6)) as lab:
        result = bench.drive(lab.file, tmp_path, procedure, EmulatedOperator(lab.perform))
    assert result.outcome == "invalid" and result.reason.startswith("fog_1 was lost at ")
    took_over = ("can_1", "judge_changed")
    assert took_over in [row[:2] for row in alarms(result.folder)]
    measured = {row["name"]: row["value"] for row in read_manifest(result.folder).measurements}
    assert abs(measured["azimuth_error"]) < 45.0


@pytest.mark.parametrize("at_s", [10.0, 900.0])
def test_a_cold_shock_ends_safe_when_its_only_gyro_is_unplugged_and_stays_away(
    bench, fog_file, tmp_path, at_s
):
    procedure = find_procedure("zero-bias-cold-shock")
    with EmulatedLab(fog_file, plant("fog_1", "vanish", at_s, 1e6)) as lab:
        result = bench.drive(lab.file, tmp_path, procedure, EmulatedOperator(lab.perform))
    assert result.outcome == "aborted" and "NOT CONFIRMED" not in result.reason
    assert "no gyro is left to test" in result.reason and "start the run again" in result.reason
    assert at_s + 60.0 <= result.duration_s < at_s + 80.0
    assert bench.problems(result.folder) == []


def test_units_switched_off_by_the_test_plan_are_not_taken_for_dead(bench, fog_file, tmp_path):
    def cycle(bench, _):
        power_cycle(bench, "cycle 1 of 1", 60.0)
        bench.wait(20.0, "on again")

    procedure = Procedure("cycle", "", "", Parameters, cycle, lambda _: 0.0, lambda _: Demands())
    with EmulatedLab(fog_file, Plant(seed=5, delivery_s=1.0)) as lab:
        result = bench.drive(lab.file, tmp_path, procedure, EmulatedOperator(lab.perform))
    assert (result.outcome, result.reason) == ("completed", "")
    assert alarms(result.folder) == []
