"""Rules of the bench file on a running bench: a forbidden command is not sent, a forbidden state ends the run."""

import json

import pytest

from bench.control.procedure import Demands, Procedure
from bench.lab.emulated import EmulatedLab, Plant
from bench.record.benchfile import bench_file_from
from drivers.base.errors import ConfigurationError, LimitExceeded

DOOR = {"name": "spin with the door open", "rate_dps": {"above": 0.1}, "door": "open"}
COLD = {"name": "spin in the cold", "rate_dps": {"above": 4.0}, "air_temp_c": {"below": 10.0}}


def limited(file, **limits):
    data = file.model_dump(mode="json")
    data["limits"] |= limits
    data["chamber"]["door_message"] = "door open"
    return bench_file_from(data)


def acting(tools, run):
    spin = tools.spin
    return Procedure(
        "act", "", "", spin.parameters, run, lambda p: 1.0, lambda p: Demands(5.0, 0.0, 25.0, 0.0)
    )


def sent(result, port):
    return (result.folder / "raw" / f"{port}.sent.bin").read_bytes()


def events(result, kind):
    rows = [json.loads(line) for line in (result.folder / "events.jsonl").read_text().splitlines()]
    return [row for row in rows if row["kind"] == kind]


def test_an_open_door_forbids_to_spin_and_to_point_and_not_to_rest(bench, fog_file, tmp_path):
    with EmulatedLab(limited(fog_file, forbid=[DOOR]), Plant()) as lab:

        def run(work, p):
            work.table.device.servo_on()
            work.table.spin(5.0)
            work.table.stop()
            lab.perform({"act": "door", "open": True})
            work.wait(70.0)  # an open door is no alarm while the table rests
            work.table.stop()
            with pytest.raises(LimitExceeded, match="spin with the door open"):
                work.table.point(90.0)
            work.table.spin(3.0)

        result = bench.drive(lab.file, tmp_path, acting(bench, run))
    assert isinstance(result.error, LimitExceeded) and "spin at 3 deg/s" in result.reason
    table = sent(result, "table")
    assert b":demand:rate 1,5.0" in table
    assert b":demand:rate 1,3.0" not in table and b":demand:position" not in table
    assert bench.problems(result.folder) == []


def test_a_door_that_opens_on_a_spinning_table_ends_the_run_at_the_next_poll(bench, fog_file, tmp_path):
    with EmulatedLab(limited(fog_file, forbid=[DOOR]), Plant()) as lab:
        opened_s = []

        def run(work, p):
            work.table.device.servo_on()
            work.table.spin(5.0)
            opened_s.append(work.now_s)
            lab.perform({"act": "door", "open": True})
            work.wait(1000.0)

        result = bench.drive(lab.file, tmp_path, acting(bench, run))
    assert isinstance(result.error, LimitExceeded) and "spin with the door open" in result.reason
    safe = next(iter(events(result, "safe_state")))
    assert safe["time_s"] - opened_s[0] < 10.0
    assert any(
        row["device"] == "table" and row["state"] == "confirmed" for row in events(result, "safe_state")
    )


def test_air_on_its_way_to_where_spinning_is_forbidden_forbids_it_now(bench, fog_file, tmp_path):
    with EmulatedLab(limited(fog_file, forbid=[COLD]), Plant()) as lab:

        def run(work, p):
            work.table.device.servo_on()
            work.table.spin(5.0)
            with pytest.raises(LimitExceeded, match="spin in the cold"):
                work.chamber.go_to(0.0)
            work.table.spin(3.0)
            work.chamber.go_to(0.0)
            work.chamber.start()
            work.table.spin(5.0)

        result = bench.drive(lab.file, tmp_path, acting(bench, run))
    assert isinstance(result.error, LimitExceeded) and "spin at 5 deg/s" in result.reason
    assert sent(result, "chamber").count(b"11001\xb61\xb61\xb60.0") == 1


def test_air_that_changes_too_fast_ends_the_run(bench, fog_file, tmp_path):
    with EmulatedLab(limited(fog_file, max_ramp_k_per_min=1.0), Plant()) as lab:

        def run(work, p):
            work.chamber.go_to(0.0)  # as fast as the chamber can, which is faster than this bench allows
            work.chamber.start()
            work.wait(600.0)

        result = bench.drive(lab.file, tmp_path, acting(bench, run))
    assert isinstance(result.error, LimitExceeded) and "changes faster" in result.reason


def test_a_run_with_an_overdue_calibration_says_so_or_is_refused(bench, fog_file, tmp_path):
    facts = {"instrument": "clock 1", "certificate": "K-9", "date": "2019-01-01", "uncertainty": 1.0}
    late = facts | {"quantity": "time_base_ppm", "due": "2020-01-01"}
    held = facts | {"quantity": "table_level_deg", "due": "2999-01-01"}
    data = fog_file.model_dump(mode="json") | {"calibration": [late, held]}
    with EmulatedLab(bench_file_from(data), Plant()) as lab:
        result = bench.drive(lab.file, tmp_path, hold_s=1.0)
        assert result.outcome == "completed"
        (alarm,) = events(result, "alarm")
        assert alarm["facts"] == {"quantity": "time_base_ppm", "certificate": "K-9", "due": "2020-01-01"}
        data["limits"]["overdue"] = "refuse"
        strict = bench_file_from(data | {"bench": lab.file.bench.model_dump(mode="json")})
        with pytest.raises(ConfigurationError, match=r"K-9, due 2020-01-01\. "):
            bench.drive(strict, tmp_path / "none")
    assert not (tmp_path / "none").exists()
    manifest = json.loads((result.folder / "manifest.json").read_text())
    assert [row["certificate"] for row in manifest["bench"]["calibration"]] == ["K-9", "K-9"]
