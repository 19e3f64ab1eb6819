"""STIM300 in Service Mode: against the printed listings of its data sheet, and through the whole bench."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq
import pytest

from bench.control.run_record import decode_run
from bench.record.benchfile import load_bench_file
from bench.record.recording import read_manifest, verify
from drivers.base.errors import ConfigurationError, DeviceRefused, DeviceSilent, WrongDevice
from drivers.stim300 import Stim300, Stim300Config
from drivers.stim300._driver import Stim300Gyro
from drivers.stim300.commands import bits_per_s
from simulators.emulators.stim300 import Stim300Emulator
from simulators.faults import Fault
from simulators.interfaces import Emulator
from tests.drivers.frames.test_frames_bench import BENCH
from tests.drivers.frames.test_frames_bench import run as run_bench
from tests.memory_link import Fake, MemoryLink, OpenConnection, TurningPlant

# TS1524 rev. 31: figure 8-1, shortened in its middle; the dash and the degree sign as the PDF has them.
LISTING = (
    "\rSERIAL NUMBER = N25582405002002\rPRODUCT = STIM300\rPART NUMBER = 84167-4400003-321 REV K\r"
    "FW CONFIG = SWD12404 REV 0\rGYRO OUTPUT UNIT = [\u00b0/s] \u2013 ANGULAR RATE DELAYED\r"
    "SAMPLE RATE [samples/s] = 2000\rGYRO CONFIG = XYZ\rDATAGRAM = RATE, ACCELERATION, INCLINATION\r"
    "DATAGRAM TERMINATION = NONE\rBIT-RATE [bits/s] = 1843200\rLINE TERMINATION = ON\r\r>"
).encode()
PRINTED = {
    "SERVICEMODE": LISTING.decode(),
    "i s": "i s\rSERIAL NUMBER = N25582405002002\r\r>",
    "i n": "i n\rPRODUCT = STIM300\r\r>",
    "i x": "i x\rPART NUMBER = 84167-4400003-321 REV K\r\r>",
    "i p": "i p\rFW CONFIG = SWD12404 REV 0\r\r>",
    "m 2": "m 2\rSAMPLE RATE [samples/s] = 500\r\r>",
    "d 3,0": "d 3,0\rDATAGRAM = RATE, ACCELERATION, INCLINATION\rDATAGRAM TERMINATION = NONE\r\r>",
    "u g,0": "u g,0\rGYRO OUTPUT UNIT = [\u00b0/s] \u2013 ANGULAR RATE\r\r>",
    "u a,0": "u a,0\rACCELEROMETER OUTPUT UNIT = [g] \u2013 ACCELERATION\r\r>",
    "u i,0": "u i,0\rINCLINOMETER OUTPUT UNIT = [g] \u2013 ACCELERATION\r\r>",
    "x N": "x N\rSYSTEM RETURNING TO NORMAL MODE.\r",
}
DATAGRAM = bytes.fromhex(
    "AF000124FFFAD600035B00FFE7A6FFDD36081C5200FF7E70FEBA0C3FFA1D0023A023C023A0002319230A231C00239523B6239500FFEF02"
    "00E101FAC64942C6"
)
"""A real unit's (the vector of the frame description)."""


def gyro_on(
    device: Emulator, message: str = "rate_acc_incl", rate_hz: float = 500.0
) -> tuple[Stim300Gyro, MemoryLink]:
    link = MemoryLink(device)
    return Stim300Gyro(section(rate_hz=rate_hz, frame_format=message), OpenConnection(link)), link


def printed(line: bytes) -> bytes:
    return PRINTED[line.rstrip(b"\r").decode()].encode()


def emulated(**keywords: object) -> Stim300Emulator:
    return Stim300Emulator(TurningPlant("xyz"), serial_number="N1", axes="xyz", baudrate=921_600, **keywords)  # type: ignore[arg-type]  # kinds vary


def test_the_driver_reads_what_the_data_sheet_prints() -> None:
    device = Fake(lambda line: DATAGRAM + printed(line) if line == b"SERVICEMODE\r" else printed(line))
    gyro, link = gyro_on(device)
    identity = gyro.identify()
    assert (identity.maker, identity.model) == ("Sensonor", "STIM300")
    assert (identity.serial_number, identity.firmware) == ("N25582405002002", "SWD12404 REV 0")
    gyro.start()
    told = [b"SERVICEMODE\r", b"m 2\r", b"d 3,0\r", b"u g,0\r", b"u a,0\r", b"u i,0\r", b"x N\r"]
    assert device.lines[-7:] == told
    assert link.streaming
    assert b"s\r" not in device.lines  # nothing is written to the flash


def test_the_emulator_says_what_the_data_sheet_prints() -> None:
    unit = emulated(settings={"m": "4", "d": "3", "u g": "8"})
    banner = b"".join(reply.data for reply in unit.receive(b"SERVICEMODE\r", 0.01))
    told = banner.decode("latin-1").split("\r")
    for line in (
        "PRODUCT = STIM300",
        "SAMPLE RATE [samples/s] = 2000",
        "DATAGRAM = RATE, ACCELERATION, INCLINATION",
    ):
        assert line in told
    assert banner.endswith(b"\r>")
    for command, expected in PRINTED.items():
        if command not in ("SERVICEMODE", "i s", "u g,0", "u a,0", "u i,0", "x N"):
            got = b"".join(reply.data for reply in unit.receive(command.encode() + b"\r", 1.0))
            assert got.decode("latin-1") == expected
    assert b"E001 UNKNOWN COMMAND\r" in unit.receive(b"y\r", 1.0)[0].data
    assert b"E002 INCORRECT NUMBER OF PARAMETERS\r" in unit.receive(b"d 3\r", 1.0)[0].data
    assert b"E003 INVALID PARAMETER\r" in unit.receive(b"m 9\r", 1.0)[0].data
    assert unit.receive(b"s\r", 1.0)[0].data.endswith(b"PERMANENTLY CHANGED. CONFIRM SAVE(Y/N): ")
    assert unit.receive(b"y\r", 1.0)[0].data.startswith(b"y\rSAVE COMMAND ABORTED.\r")
    assert unit.stream(2.0) is None
    assert unit.receive(b"x N\r", 2.0)[0].data == PRINTED["x N"].encode()
    assert unit.stream(3.0) is not None


def section(**keys: Any) -> Stim300Config:
    return Stim300Config(name="g", driver="stim300", unit="1", axes="xyz", axis="z", **keys)


def test_a_unit_that_streams_is_set_and_streams_what_was_asked_for() -> None:
    gyro, link = gyro_on(emulated(), "rate_temp", 2000.0)
    link.sleep(0.1)  # rates alone at 125 Hz, as delivered
    assert gyro.identify().serial_number == "N1"
    gyro.start()
    link.raw = b""
    link.sleep(0.5)
    settings = section(rate_hz=2000.0)
    batch = Stim300.decoder(settings).feed(link.raw)
    assert 990 <= len(batch) <= 1001 and batch.columns["valid"].all()
    assert (np.diff(batch.columns["counter"]) % 256 == 1).all()  # 2000 counts a second
    rates = Stim300.rates(settings, batch.columns, 2000.0)
    np.testing.assert_allclose(rates["z"], 10.0, atol=2.0**-14)
    gyro.stop()
    link.raw = b""
    link.sleep(1.0)
    assert link.raw == b""
    gyro.start()  # from Service Mode
    link.sleep(0.1)
    assert link.raw


@pytest.mark.parametrize(
    ("choice", "code"), [("average_rate", b"2"), ("incremental_angle", b"1"), ("integrated_angle", b"3")]
)
def test_every_output_of_the_unit_is_the_same_rate(choice: str, code: bytes) -> None:
    """A unit that is left in another output by its last user is set to what the bench file says."""
    chosen = {
        "gyro_output": choice,
        "accelerometer_range": "30g",
        "accelerometer_output": "incremental_velocity",
    }
    settings = section(rate_hz=500.0, settings=chosen, frame_format="rate_acc")
    link = MemoryLink(unit := emulated(settings={"u g": "9", "u a": "3"}, ordered=chosen))
    gyro = Stim300Gyro(settings, OpenConnection(link))
    gyro.start()
    link.raw = b""
    link.sleep(0.5)
    told = b"".join(reply.data for reply in unit.receive(b"SERVICEMODE\r", 1.0))
    assert b"[m/s/sample] - INCREMENTAL VELOCITY\r" in told and b"DELAYED" not in told
    batch = Stim300.decoder(settings).feed(link.raw)
    rates = Stim300.rates(settings, batch.columns, 500.0)
    np.testing.assert_allclose(rates["z"][1:], 10.0, atol=500 * 2.0**-21)
    assert batch.columns["valid"][1:].all()
    assert unit.receive(b"u g," + code + b"\r", 1.0)[0].data.count(b"OUTPUT UNIT") == 1
    assert (
        b"E003" in unit.receive(b"u g,7\r", 1.0)[0].data and b"E003" in unit.receive(b"u q,0\r", 1.0)[0].data
    )


def test_a_bit_that_flips_costs_a_second_question_only() -> None:
    asked: list[bytes] = []

    def once_damaged(line: bytes) -> bytes:
        asked.append(line)
        answer = printed(line)
        return answer.replace(b"STIM", b"STYM") if asked.count(line) == 1 and line == b"i n\r" else answer

    gyro, _ = gyro_on(Fake(once_damaged))
    with pytest.raises(WrongDevice, match="STYM300"):
        gyro.identify()  # what still reads as an answer is taken at its word
    asked.clear()

    def word_damaged(line: bytes) -> bytes:
        asked.append(line)
        return (
            printed(line).replace(b"PRODUCT", b"PROD\x55CT".lower())
            if asked.count(line) == 1
            else printed(line)
        )

    gyro, _ = gyro_on(Fake(word_damaged))
    assert gyro.identify().model == "STIM300"
    assert asked.count(b"i n\r") == 2


def test_refusals_silence_and_other_devices_are_told_apart() -> None:
    unit = emulated()
    unit.faults["refuse"](Fault("gyro", "refuse", at_s=(0.0,), count=9, text="E005 ERROR DURING SAVE"), 0.0)
    gyro, _ = gyro_on(unit)
    with pytest.raises(DeviceRefused, match="E005"):
        gyro.identify()
    gyro, _ = gyro_on(Fake(lambda line: b""))
    with pytest.raises(DeviceSilent, match="both RS-422 pairs"):
        gyro.identify()
    gyro, _ = gyro_on(Fake(lambda line: DATAGRAM * 3))
    with pytest.raises(DeviceSilent, match="streams but does not answer"):
        gyro.identify()
    gyro, _ = gyro_on(Fake(lambda line: b"?\r\n"))
    with pytest.raises(WrongDevice, match="not as a STIM300"):
        gyro.identify()


def test_what_no_line_carries_is_refused_before_the_first_byte() -> None:
    with pytest.raises(ConfigurationError, match="1298000 Bd or more"):  # 1.1 x 10 bits x 59 bytes x 2000
        gyro_on(Fake(printed), "all", 2000.0)
    assert bits_per_s(59, 2000.0) == pytest.approx(1_298_000.0)


def test_a_bench_file_names_what_a_stim300_cannot_do(tmp_path: Path) -> None:
    section = '[[gyro]]\nname = "stim"\ndriver = "stim300"\nport = "/dev/ttyUSB1"\naxis = "z"\nunit = "N1"\n'
    (tmp_path / "lab.toml").write_text(BENCH + section + 'axes = "xyz"\nframe_format = "B"\n')
    with pytest.raises(ConfigurationError) as refused:
        load_bench_file(tmp_path / "lab.toml")
    assert "gyro[0].rate_hz" in str(refused.value) and "one of 125, 250" in str(refused.value)
    assert "frame_format" in str(refused.value) and "rate_acc_temp" in str(refused.value)


def test_a_run_with_a_stim300(tmp_path: Path) -> None:
    text = """
[[gyro]]
name = "stim"
driver = "stim300"
frame_format = "rate_acc_temp"
port = "/dev/ttyUSB1"
rate_hz = 250
axes = "xyz"
axis = "z"
unit = "N25582405002002"
"""
    (tmp_path / "lab.toml").write_text(BENCH + text)
    result = run_bench(load_bench_file(tmp_path / "lab.toml"), tmp_path / "runs")
    assert result.outcome == "completed", result.reason
    table = pq.read_table(result.folder / "gyro_stim.parquet").to_pandas()
    assert table["lost_before"].sum() == 0 and table["valid"].all()
    assert np.median(np.diff(table["time_ns"])) == pytest.approx(4e6, abs=100)
    manifest = read_manifest(result.folder)
    assert manifest.devices["stim"].serial_number == "N25582405002002"
    assert {"gyro_temp_z_c", "acc_temp_x_c", "accelerometer_z_mps2"} <= set(table.columns)
    assert [str(problem) for problem in verify(result.folder, decode_run).problems] == []
