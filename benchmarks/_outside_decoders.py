"""Other people's decoders on the bytes of emulated units, and minimalmodbus on emulated Watlow controllers."""

from __future__ import annotations

import importlib
import math
import shutil
import sys
import tempfile
import types
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

from bench.record.benchfile import load_bench_file
from benchmarks._outside_native import Message, NativeDecoders
from drivers.base.constants import STANDARD_GRAVITY_MPS2
from drivers.kit.registry import EMULATORS, registered
from simulators.interfaces import Installation, StreamingEmulator
from simulators.plant import LabPlant, PlantConfig, UnitConfig

_SECONDS = 10
_RATE_HZ = 100
_BENCH = """
[bench]
name = "bench"
latitude_deg = 39.10
[table]
driver = "acutrol3000"
port = "/dev/ttyUSB0"
[chamber]
driver = "weiss"
port = "/dev/ttyUSB2"
[[gyro]]
name = "g"
unit = "1"
axis = "z"
axes = "xyz"
driver = "frames"
port = "/dev/ttyUSB1"
"""
_NATIVE: Sequence[tuple[str, str, Sequence[str]]] = (
    ("hg4930", "bolderflight/hg4930", ("hg4930_control", "hg4930_inertial")),
    ("vectornav", "VectorNav vnproglib", ("vectornav",)),
    ("drivers-imu_kvh_1750", "drivers-imu_kvh_1750", ("kvh_format_a",)),
)
"""Folder, client and calls."""
MODBUS: tuple[tuple[str, str, tuple[Any, ...]], ...] = (
    ("F4", "read_register", (100, 1, 3, True)),
    ("F4", "read_register", (100, 1, 4, True)),
    ("F4", "read_register", (300, 1, 3, True)),
    ("F4", "write_register", (300, -20.0, 1, 6, True)),
    ("F4", "read_register", (300, 1, 3, True)),
    ("F4", "write_register", (300, -30.0, 1, 16, True)),
    ("F4", "read_register", (300, 1, 3, True)),
    ("F4", "read_registers", (606, 1)),
    ("F4", "read_register", (60000,)),
    ("F4T", "read_float", (2820, 3, 2, 3)),
    ("F4T", "write_float", (2782, -20.0, 2, 3)),
    ("F4T", "read_float", (2782, 3, 2, 3)),
    ("F4T", "read_float", (2782, 4, 2, 3)),
    ("F4T", "read_register", (2730,)),
)
"""Controller, call, arguments; 3 as the last of a float is its BYTEORDER_LITTLE_SWAP: low word first."""


class SerialLine:
    """What minimalmodbus uses of pyserial's port, with a device behind it."""

    port, baudrate, timeout, is_open = "emulated", 19200, 0.05, True

    def __init__(self, ask: Callable[[bytes], bytes]) -> None:
        self._ask, self._answer = ask, b""

    def write(self, data: bytes) -> int:
        """Give the device a request."""
        self._answer = self._ask(data)
        return len(data)

    def read(self, count: int) -> bytes:
        """Return at most `count` bytes of its answer."""
        data, self._answer = self._answer[:count], self._answer[count:]
        return data

    def reset_input_buffer(self) -> None:
        """Drop what was not read."""
        self._answer = b""

    def reset_output_buffer(self) -> None:
        """Nothing waits to be sent."""

    def flush(self) -> None:
        """Nothing waits to be sent."""

    def open(self) -> None:
        """It is open."""

    def close(self) -> None:
        """It stays open."""


def minimalmodbus_client(ask: Callable[[bytes], bytes]) -> Any:
    """Return minimalmodbus' instrument of device 1 behind `ask`."""
    return importlib.import_module("minimalmodbus").Instrument(SerialLine(ask), 1)


class Decoders:
    """The decoders that are in `sources`; each call returns what it made of 10 s of a unit at rest, in words.

    Those in C++ are built in `folder`.
    """

    def __init__(self, sources: Path, folder: Path) -> None:
        self._sources, self._native = sources, NativeDecoders(sources, folder)

    def available(self) -> Iterator[tuple[str, str]]:
        """Yield client and call of each."""
        if (self._sources / "pystim300").is_dir():
            yield "pystim300", "stim300"
        if (self._sources / "products").is_dir():
            yield "hipnuc/products", "hipnuc"
        for room, client, units in _NATIVE:
            if shutil.which("g++") and (self._sources / room).is_dir():
                yield from ((client, unit) for unit in units)

    def hg4930_control(self) -> str:
        """Feed Hg4930::Parse with control messages."""
        return _of_native(self._native.hg4930(_bytes("hg4930", "control", _RATE_HZ)))

    def hg4930_inertial(self) -> str:
        """Feed Hg4930::Parse with inertial messages."""
        return _of_native(self._native.hg4930(_bytes("hg4930", "inertial", _RATE_HZ)))

    def vectornav(self) -> str:
        """Feed PacketFinder with binary messages of rate and acceleration, which have no temperature."""
        return _of_native(self._native.vectornav(_bytes("vectornav", "rate_accel", _RATE_HZ)))

    def kvh_format_a(self) -> str:
        """Feed Driver::read with messages in Format A."""
        return _of_native(self._native.kvh(_bytes("kvh", "a", _RATE_HZ)))

    def stim300(self) -> str:
        """Feed NormalStreamParser with datagrams of rate, acceleration and temperature."""
        sys.path.insert(0, str(self._sources / "pystim300"))
        told = {"datagram_id": 0xA5, "crlf_termination": False, "gyro_output_unit": 0, "accel_output_unit": 0}
        ranges = {
            "gyro_range_dps": (400,) * 3,
            "accel_range_g": (10,) * 3,
            "incl_output_unit": 0,
            "pps_output_unit": 0,
        }
        configuration = types.SimpleNamespace(**told, **ranges)
        parser = importlib.import_module("pystim300.normal").NormalStreamParser(configuration)
        records = list(parser.feed(_bytes("stim300", "rate_acc_temp", 125)))
        return _words(
            records,
            125,
            lambda record: record.accel,
            lambda record: record.gyro,
            lambda record: record.gyro_temp[2],
        )

    def hipnuc(self) -> str:
        """Feed hipnuc_parser with HI91 packets."""
        sys.path.insert(0, str(self._sources / "products/examples/python"))
        parser = importlib.import_module("parsers.hipnuc_serial_parser").hipnuc_parser()
        records = list(parser.parse(_bytes("hipnuc", "hi91", _RATE_HZ)))
        return _words(
            records,
            _RATE_HZ,
            lambda record: [value / STANDARD_GRAVITY_MPS2 for value in record["acc"]],
            lambda record: record["gyr"],
            lambda record: record["temperature"],
        )


def _bytes(description: str, message: str, rate_hz: int) -> bytes:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "bench.toml"
        keys = f'description = "{description}"\nframe_format = "{message}"\nrate_hz = {rate_hz}\n'
        path.write_text(_BENCH + keys, encoding="utf-8")
        config = load_bench_file(path).gyro[0]
    unit = UnitConfig("g", "imu", axis="z", mounting="z_up")
    plant = LabPlant(PlantConfig(latitude_deg=39.1, units=(unit,)))
    plant.advance(_SECONDS + 1.0)
    emulator: StreamingEmulator = registered(EMULATORS, "gyro")[config.driver].load()(
        config, plant.unit("g"), Installation()
    )
    block = emulator.stream(float(_SECONDS))
    return b"" if block is None else block.data


def _of_native(messages: list[Message]) -> str:
    return _words(messages, _RATE_HZ, lambda one: one[0], lambda one: one[1], lambda one: one[2])


def _words(records: list[Any], rate_hz: int, force: Any, rate: Any, temp: Any) -> str:
    """Say how many of the messages came, and their means: size of the force in g, z rate in deg/s, degC."""
    if not records:
        return "fails: no message"
    force_g, rate_dps, temp_c = (
        sum(values) / len(records)
        for values in (
            [math.hypot(*force(record)) for record in records],
            [rate(record)[2] for record in records],
            [temp(record) for record in records],
        )
    )
    complete = "" if len(records) >= _SECONDS * rate_hz - 1 else "fails: "  # the last may be on the line yet
    warmth = "no temperature" if math.isnan(temp_c) else f"{temp_c:.1f} degC"
    counted = f"{len(records)} of {_SECONDS * rate_hz} messages"
    return f"{complete}{counted}, force {force_g:.4f} g, z {rate_dps:+.4f} deg/s, {warmth}"
