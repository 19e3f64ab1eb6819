"""Trouble on the ports: what is missing, busy, silent or something else is named, and nothing has moved."""

import dataclasses
import json
import os
import pty
import tty

import pytest
import serial

from bench.control.procedure import Demands, Procedure
from bench.lab.emulated import Plant
from drivers.base.errors import ConfigurationError, DeviceSilent, LimitExceeded, RunAborted, WrongDevice

SET_NUMBERS = {b"11001", b"14001", b"11068", b"11072", b"17012"}
"""SimServ numbers that change something: set point, digital output, gradients, reset."""


class Silent:
    def receive(self, data, now_s):
        return []


def silent(emulator, lab, index):
    return Silent()


def sent(folder, port):
    path = folder / "raw" / f"{port}.sent.bin"
    return path.read_bytes() if path.exists() else b""


def assert_only_questions(folder):
    table = [line for line in sent(folder, "table").splitlines() if line.strip()]
    assert all(b"?" in line for line in table), table
    chamber = [line for line in sent(folder, "chamber").split(b"\r") if line.strip()]
    assert all(line.split(b"\xb6")[0] not in SET_NUMBERS and not line.startswith(b"$01E") for line in chamber)
    return table, chamber


def assert_aborted(result, kind):
    assert result.outcome == "aborted"
    assert isinstance(result.error, kind), result.error
    manifest = json.loads((result.folder / "manifest.json").read_text())
    assert manifest["outcome"] == "aborted"
    assert manifest["reason"] == str(result.error)
    assert "\n" not in manifest["reason"]
    return str(result.error)


def demanding(tools, demands):
    """Return a procedure that must never run."""

    def run(bench, p):
        raise AssertionError("the procedure ran")

    spin = tools.spin
    return Procedure(
        "spin", spin.title, "", spin.parameters, run, spin.expected_duration_s, lambda p: demands
    )


@pytest.mark.parametrize(
    ("demands", "words"),
    [
        (Demands(max_rate_dps=20.5), ["20.5 deg/s", "at most 20 deg/s"]),
        (Demands(min_temp_c=-61.0), ["-61 .. 23 degC", "-60 .. 85"]),
        (Demands(max_temp_c=86.0), ["86 degC"]),
        (Demands(max_ramp_k_per_min=26.0), ["26 K/min", "at most 25 K/min"]),
    ],
)
def test_demands_beyond_the_bench_file_are_refused_before_anything_moves(
    bench, fog_file, tmp_path, demands, words
):
    """No port is opened and no run folder is made: the bench file's ports are there on no machine."""
    with pytest.raises(LimitExceeded) as refused:
        bench.drive(fog_file, tmp_path / "runs", demanding(bench, demands))
    assert all(word in str(refused.value) for word in words), str(refused.value)
    assert not (tmp_path / "runs").exists()


@pytest.mark.parametrize(
    ("demands", "words"),
    [
        (Demands(max_rate_dps=1000.5), ["1000.5 deg/s", "at most 1000 deg/s"]),
        (Demands(min_temp_c=-80.0), ["-80", "-72 .. 182 degC"]),
        (Demands(max_temp_c=183.0), ["183", "-72 .. 182 degC"]),
    ],
)
def test_demands_beyond_the_devices_own_limits_are_refused_before_anything_moves(
    bench, fog_file, tmp_path, demands, words
):
    wide = fog_file.limits.model_copy(
        update={"max_rate_dps": 5000.0, "min_temp_c": -150.0, "max_temp_c": 300.0}
    )
    with bench.lab(fog_file.model_copy(update={"limits": wide}), Plant()) as lab:
        result = bench.drive(lab.file, tmp_path, demanding(bench, demands))
    text = assert_aborted(result, LimitExceeded)
    assert all(word in text for word in words), text
    assert_only_questions(result.folder)


def test_a_missing_port_is_named(bench, fog_file, tmp_path):
    missing = dataclasses.replace(fog_file.table, port=str(tmp_path / "ttyNONE"))
    result = bench.drive(fog_file.model_copy(update={"table": missing}), tmp_path)
    text = assert_aborted(result, ConfigurationError)
    assert "table" in text and "ttyNONE" in text and "No such file" in text


@pytest.mark.concurrent
@pytest.mark.slow
def test_a_port_that_another_program_has_open_is_refused(bench, fog_file, tmp_path):
    master, slave = pty.openpty()
    tty.setraw(slave)
    try:
        with serial.Serial(os.ttyname(slave), exclusive=True):
            busy = dataclasses.replace(fog_file.table, port=os.ttyname(slave))
            result = bench.drive(fog_file.model_copy(update={"table": busy}), tmp_path)
        text = assert_aborted(result, ConfigurationError)
        assert os.ttyname(slave) in text and "exclusively lock" in text
        os.set_blocking(master, False)
        with pytest.raises(BlockingIOError):
            os.read(master, 100)
    finally:
        os.close(master)
        os.close(slave)


@pytest.mark.parametrize("port", ["table", "chamber", "fog_1", "can_1"])
def test_a_silent_device_is_named_after_its_deadline(bench, both_file, tmp_path, port):
    with bench.lab(both_file, Plant(), {port: silent}) as lab:
        result = bench.drive(lab.file, tmp_path)
    text = assert_aborted(result, DeviceSilent)
    assert text.startswith(f"{port} ("), text
    assert "nothing" in text and "power" in text
    assert result.duration_s < 30.0
    assert_only_questions(result.folder)
    assert bench.problems(result.folder) == []


def other(name):
    """Return a swap that puts the emulator of port `name` there."""

    def swap(emulator, lab, index):
        return next(e for e, port in zip(lab._emulators, lab.ports, strict=True) if port.name == name)

    return swap


@pytest.mark.parametrize(
    ("port", "behind"),
    [
        ("chamber", "table"),
        ("table", "chamber"),
        ("fog_1", "table"),
        ("table", "can_1"),
        ("can_1", "table"),
    ],
)
def test_a_wrong_device_behind_a_port_is_recognised(bench, both_file, tmp_path, port, behind):
    with bench.lab(both_file, Plant(), {port: other(behind)}) as lab:
        result = bench.drive(lab.file, tmp_path)
    text = assert_aborted(result, (WrongDevice, DeviceSilent))
    assert text.startswith(f"{port} ("), text
    if behind == "table" and port == "chamber":
        assert isinstance(result.error, WrongDevice)
    assert_only_questions(result.folder)


@pytest.mark.parametrize(("rate_dps", "latest_s"), [(5.0, 25.0), (0.0, 90.0)])
def test_a_table_that_trips_ends_the_run_with_its_own_words(bench, fog_file, tmp_path, rate_dps, latest_s):
    """The servo trips at 20 s; what is left is to notice it, stop, and read back that all rests."""
    tripped = []

    def swap(emulator, lab, index):
        class Tripping:
            def receive(self, data, now_s):
                if now_s > 20.0 and not tripped:
                    tripped.append(now_s)
                    emulator.trip("position tracking error", now_s)
                return emulator.receive(data, now_s)

        return Tripping()

    with bench.lab(fog_file, Plant(), {"table": swap}) as lab:
        result = bench.drive(lab.file, tmp_path, hold_s=300.0, rate_dps=rate_dps)
    text = assert_aborted(result, RunAborted)
    assert text.startswith("table: ") and "position tracking error" in text, text
    assert 20.0 < result.duration_s < latest_s


def test_a_chamber_alarm_ends_the_run_with_its_own_words(bench, fog_file, tmp_path):
    alarms = []

    def swap(emulator, lab, index):
        class Alarming:
            def receive(self, data, now_s):
                if now_s > 20.0 and not alarms:
                    alarms.append(now_s)
                    emulator.raise_alarm("Temperature limiter", now_s)
                return emulator.receive(data, now_s)

        return Alarming()

    with bench.lab(fog_file, Plant(), {"chamber": swap}) as lab:
        result = bench.drive(lab.file, tmp_path, hold_s=300.0)
    text = assert_aborted(result, RunAborted)
    assert "chamber" in text and "Temperature limiter" in text
    assert result.duration_s < 90.0
    events = [json.loads(line) for line in (result.folder / "events.jsonl").read_text().splitlines()]
    assert [e["text"] for e in events if e["kind"] == "alarm"] == ["alarm: Temperature limiter"]
