"""A unit unplugged and put back within a run: its record goes on behind a marked gap."""

import json
import os
import threading
import tty

import numpy as np
import pyarrow.parquet as pq
import pytest

from bench.control.stream_stations import GyroStation, StreamTap
from bench.control.stream_watchdog import Reconnect
from bench.lab.emulated import Plant
from bench.record.benchfile import load_bench_file
from bench.record.recording import read_manifest
from drivers.base.clock import WallClock
from drivers.base.errors import LinkLost
from drivers.kit.kinds import Connection
from drivers.kvh import Kvh1750, encode_frames
from simulators.faults import Fault
from tests.benches import BENCH, FOG


def vanishing(port, at_s, duration_s):
    return Plant(
        seed=5,
        delivery_s=0.5,
        fault=(Fault(port=port, kind="vanish", at_s=(at_s,), duration_s=duration_s),),
    )


def events(folder, kind):
    rows = [json.loads(line) for line in (folder / "events.jsonl").read_text().splitlines()]
    return [row for row in rows if row["kind"] == kind]


def check_gap(folder, name, rate_hz, gone_s, back_s):
    """The table goes on behind a gap that lies where the port was away and counts what did not come."""
    table = pq.read_table(folder / f"gyro_{name}.parquet")
    time_s = table["time_ns"].to_numpy() * 1e-9
    lost = table["lost_before"].to_numpy()
    (at,) = np.flatnonzero(lost > 0.5 * rate_hz)
    assert gone_s - 1.1 < time_s[at - 1] <= gone_s + 0.01  # a delivery that was on its way is lost, too
    assert back_s <= time_s[at] < back_s + 2.1  # it is looked for with every poll
    assert lost[at] == round((time_s[at] - time_s[at - 1]) * rate_hz) - 1
    steps_s = np.delete(np.diff(time_s), at - 1)
    np.testing.assert_allclose(steps_s, 1 / rate_hz, rtol=2e-2)
    assert time_s[-1] > back_s + 20.0


@pytest.mark.parametrize("name", ["fog_1", "can_1"])
def test_a_gyro_unplugged_for_four_seconds(bench, both_file, tmp_path, name):
    with bench.lab(both_file, vanishing(name, 25.2, 4.0)) as lab:
        result = bench.drive(lab.file, tmp_path, hold_s=60.0)
    assert result.outcome == "invalid" and result.reason.startswith(f"{name} was lost at 25.")
    lost, back = [row for row in events(result.folder, "alarm") if row["device"] == name]
    assert (lost["code"], back["code"]) == ("unit_lost", "unit_back")
    assert 29.2 <= back["time_s"] < 31.5
    check_gap(result.folder, name, 100.0, 25.2, 29.2)
    stream = read_manifest(result.folder).stream[name]
    assert 350 < stream["lost"] < 700
    assert bench.problems(result.folder) == []


def test_the_only_gyro_unplugged_and_back_and_a_gyro_behind_a_device_server(bench, tmp_path):
    path = tmp_path / "tcp.toml"
    path.write_text(BENCH + FOG.replace("/dev/ttyUSB1", "socket://127.0.0.1:4001"))
    with bench.lab(load_bench_file(path), vanishing("fog_1", 25.2, 20.0)) as lab:
        result = bench.drive(lab.file, tmp_path, hold_s=60.0)
    assert result.outcome == "invalid"
    check_gap(result.folder, "fog_1", 100.0, 25.2, 45.2)


def test_a_unit_that_lost_its_power_with_its_port_is_told_to_stream_again(bench, fog_file, tmp_path):
    """Quiet when its port is back, as a gyro left in configuration mode."""

    def quiet_when_back(emulator, lab, index):
        class Quiet:
            wire, faults = emulator.wire, emulator.faults

            def receive(self, data, now_s):
                return emulator.receive(data, now_s)

            def stream(self, until_s):
                if 26.0 < until_s < 26.6:
                    emulator.receive(b"=CONFIG,1\r\n", until_s)
                return emulator.stream(until_s)

        return Quiet()

    with bench.lab(fog_file, vanishing("fog_1", 25.2, 4.0), {"fog_1": quiet_when_back}) as lab:
        result = bench.drive(lab.file, tmp_path, hold_s=60.0)
    assert "fog_1 was told to stream again" in [row["text"] for row in events(result.folder, "note")]
    time_s = pq.read_table(result.folder / "gyro_fog_1.parquet")["time_ns"].to_numpy() * 1e-9
    assert time_s[-1] > 60.0 and not np.any((time_s > 26.0) & (time_s < 32.0))


@pytest.mark.parametrize("name", ["table", "chamber"])
def test_table_or_chamber_vanishes_while_it_works_and_is_made_safe_when_it_is_back(
    bench, fog_file, tmp_path, name
):
    with bench.lab(fog_file, vanishing(name, 25.2, 6.0)) as lab:
        result = bench.drive(lab.file, tmp_path, hold_s=60.0)
    assert result.outcome == "aborted" and isinstance(result.error, LinkLost)
    assert "NOT CONFIRMED" not in result.reason and len(result.safe) == 2
    others = [row["time_s"] for row in events(result.folder, "safe_state") if row["state"] == "confirmed"]
    assert len(others) == 2 and 31.0 < result.duration_s < 45.0
    assert bench.problems(result.folder) == []


def test_one_that_is_back_and_loses_its_first_answers_is_told_on(bench, fog_file, tmp_path):
    """Found by the soak test: it was asked once, and left turning with its port open."""
    plant = vanishing("table", 25.2, 6.0)
    deaf = Fault(port="table", kind="lose", at_s=(31.0,), count=3)
    plant = plant.model_copy(update={"fault": (*plant.fault, deaf)})
    with bench.lab(fog_file, plant) as lab:
        result = bench.drive(lab.file, tmp_path, hold_s=60.0)
    assert result.outcome == "aborted" and "NOT CONFIRMED" not in result.reason
    assert len(result.safe) == 2 and result.duration_s > 31.0


def test_one_that_stays_away_is_said_to_be_not_confirmed(bench, fog_file, tmp_path):
    with bench.lab(fog_file, vanishing("chamber", 25.2, 1e6)) as lab:
        result = bench.drive(lab.file, tmp_path, hold_s=60.0)
    assert result.outcome == "aborted" and "NOT CONFIRMED SAFE" in result.reason
    assert [(state.device, state.confirmed) for state in result.safe] == [
        ("table", True),
        ("chamber", False),
    ] and result.duration_s < 60.0


@pytest.mark.concurrent
def test_on_the_wall_clock_and_a_real_terminal(tmp_path):
    name, clock = tmp_path / "ttyGYRO", WallClock()
    far, near = os.openpty()
    tty.setraw(near)
    name.symlink_to(os.ttyname(near))
    section = Kvh1750.config(name="fog_1", driver="kvh1750", unit="F", axis="x", port=str(name))
    station = GyroStation(Kvh1750, section)
    seen = threading.Event()
    told, raw = [], bytearray()

    class Keeps:
        def received(self, data, arrival_s):
            raw.extend(data)
            seen.set()

        def sent(self, data, time_s):
            pass

    gyro = Kvh1750.open(section, Connection("fog_1", clock, StreamTap(Keeps(), station.take)))
    gyro.link.streaming = True
    reconnect = Reconnect(
        clock,
        lambda unit, error: told.append((unit.name, type(error))),
        lambda unit: told.append((unit.name, "back")),
        told.append,
    )

    def send(first):
        seen.clear()
        before = len(raw)
        os.write(
            far, encode_frames("A", np.full((20, 3), 1e-4), counter=np.arange(first, first + 20), temp_c=20.0)
        )
        while len(raw) < before + 20 * 36:
            assert seen.wait(10.0)
            seen.clear()

    try:
        station.listen(clock.now())
        reconnect.watch(gyro, station)
        send(0)
        name.unlink()
        os.close(near)
        os.close(far)
        while not told:  # the reader's thread tells whoever waits
            clock.sleep(0.05)
        reconnect.look()  # it is not there
        assert told == [("fog_1", LinkLost)]
        far, near = os.openpty()
        tty.setraw(near)
        name.symlink_to(os.ttyname(near))
        reconnect.look()
        assert told[1:] == [("fog_1", "back")]
        send(40)
        station.update()
        assert station.frames == 40
    finally:
        gyro.close()
        os.close(near)
        os.close(far)
        clock.close()
