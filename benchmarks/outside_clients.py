"""Other people's clients against the emulators, call by call: `python -m benchmarks.outside_clients SOURCES`.

SOURCES has their repositories, none of which is kept here:

    git clone https://github.com/EspecNorthAmerica/ChamberConnectLibrary SOURCES/ChamberConnectLibrary
    git clone https://github.com/SiLab-Bonn/basil SOURCES/basil
    git clone https://github.com/cookednoodle/pystim300 SOURCES/pystim300
    git clone https://github.com/hipnuc/products SOURCES/products
    git clone https://github.com/ppudo/labtoys_python SOURCES/labtoys_python
    git clone https://github.com/ondrejh/VT4002 SOURCES/VT4002
    git clone https://github.com/IEAv-EFO/acutrol3000 SOURCES/acutrol3000
    git clone https://github.com/AcutronicRobotics/acutrol SOURCES/acutrol
    git clone https://github.com/actigraph/RateTableSweepGUI SOURCES/RateTableSweepGUI
    git clone https://github.com/bolderflight/hg4930 SOURCES/hg4930
    git clone https://github.com/dawonn/vectornav SOURCES/vectornav
    git clone https://github.com/Brazilian-Institute-of-Robotics/drivers-imu_kvh_1750 SOURCES/drivers-imu_kvh_1750
    git clone https://github.com/hardbyte/python-can SOURCES/python-can
    pip install --target SOURCES/minimalmodbus minimalmodbus==2.1.1
    pip install --no-deps --target SOURCES/cts-chamber cts-chamber==0.3.0

pymeasure comes with the extra `bench`; what is in C++ is compiled with g++ and left out without it. Writes the
table of docs/instruments.md between its marks. ChamberConnectLibrary and AcutronicRobotics/acutrol are Python 2:
converted copies lie in a temporary folder while this runs. Bytes go from the client's own exchange to the
emulator and back; an exchange takes 1 s of lab time, one with a table 0.1 s.
"""

from __future__ import annotations

import importlib
import math
import shutil
import sys
import tempfile
import types
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pymodbus.framer import FramerRTU

from benchmarks._marks import fill
from benchmarks._outside_can import back_to_back
from benchmarks._outside_chambers import (
    CTS_CHAMBER,
    LABTOYS,
    PYMEASURE,
    VT4002,
    cts_chamber,
    labtoys_chamber,
    pymeasure_oven,
    vt4002,
)
from benchmarks._outside_decoders import MODBUS, Decoders, minimalmodbus_client
from benchmarks._outside_load import load, to_python_3
from benchmarks._outside_tables import ACTIGRAPH, IEAV, ROBOTICS, actigraph, ieav, robotics
from simulators.emulators.cts import CtsEmulator
from simulators.emulators.espec import EspecEmulator
from simulators.emulators.thermotron import ThermotronEmulator
from simulators.emulators.watlow import F4Emulator, F4TEmulator
from simulators.emulators.weiss import WeissEmulator
from simulators.interfaces import Emulator
from simulators.plant.chamber import ChamberAir, ChamberParameters
from simulators.plant.lab_chamber import LabChamber
from simulators.plant.noise import NoiseSource

_PAGE = Path(__file__).parents[1] / "docs" / "instruments.md"
_LOOP: Sequence[tuple[str, tuple[Any, ...]]] = (
    ("get_status", ()),
    ("get_loop_sp", (1,)),
    ("get_loop_pv", (1,)),
    ("get_loop_range", (1,)),
    ("get_loop_en", (1,)),
    ("get_loop_units", (1,)),
    ("get_loop_mode", (1,)),
    ("get_loop_power", (1,)),
    ("get_alarm_status", ()),
    ("get_event", (1,)),
    ("get_datetime", ()),
    ("set_loop_sp", (1, -20.0)),
    ("const_start", ()),
    ("get_status", ()),
    ("get_loop_sp", (1,)),
    ("stop", ()),
    ("get_status", ()),
)
_P300: Sequence[tuple[str, tuple[Any, ...]]] = tuple(
    (f"read_{name}", ())
    for name in (
        *(
            "rom",
            "date_time",
            "srq",
            "mask",
            "timer_on",
            "timer_use",
            "alarm",
            "keyprotect",
            "type",
            "mode",
            "mon",
        ),
        *("temp", "humi", "set", "ref", "relay", "htr", "constant_temp", "constant_humi", "constant_ref"),
        *(
            "constant_relay",
            "constant_ptc",
            "prgm_mon",
            "prgm_set",
            "prgm_use",
            "mon_ptc",
            "temp_ptc",
            "set_ptc",
        ),
        *("ptc", "run_prgm", "run_prgm_mon", "ip_set", "timer_list_quick"),
    )
)
_BASIL: Sequence[tuple[str, tuple[Any, ...]]] = (
    ("get_info", ()),
    ("get_status", ()),
    ("set_temperature", (-20.5,)),
    ("get_temperature_setpoint", ()),
    ("start_manual_mode", ()),
    ("get_status", ()),
    ("get_temperature", ()),
    ("get_condensation_protection", ()),
    ("set_condensation_protection", (True,)),
    ("get_air_dryer", ()),
    ("stop_manual_mode", ()),
)
_REFUSALS = ("ModbusError", "EspecError", "IllegalRequestError", "RefusedError")


@dataclass(frozen=True)
class Row:
    """One call of one client: what it returned, or how it failed."""

    client: str
    call: str
    result: str


class Line:
    """A device and the lab time: `ask` returns the bytes of its answer, empty if there is none."""

    def __init__(self, make: Callable[[LabChamber], Emulator]) -> None:
        air = ChamberAir(ChamberParameters(), 23.0, NoiseSource(1, "outside clients"))
        self._now_s = 10.0
        self._plant = LabChamber(air, self._advance, {})
        self._ticks = 0
        self._device = make(self._plant)

    def ask(self, data: bytes) -> bytes:
        """Write `data` 1 s after the exchange before."""
        self._now_s += 1.0
        return b"".join(reply.data for reply in self._device.receive(data, self._now_s))

    def _advance(self, to_s: float) -> None:
        while self._ticks < math.ceil(to_s):
            self._plant.tick()
            self._ticks += 1


def main(sources: Path) -> None:
    """Run every client that is in `sources` and write the table."""
    rows: list[Row] = []
    with tempfile.TemporaryDirectory() as folder:
        if (sources / "ChamberConnectLibrary").is_dir():
            rows += _chamber_connect(sources / "ChamberConnectLibrary", Path(folder))
        if (sources / "basil").is_dir():
            rows += _basil(sources / "basil")
        rows += _tables(sources, Path(folder))
        decoders = Decoders(sources, Path(folder))
        for client, unit in decoders.available():
            rows += _called(client, decoders, [(unit, ())])
    if (sources / "minimalmodbus").is_dir():
        rows += _minimalmodbus(sources / "minimalmodbus")
    rows += _cts_and_thermotron(sources)
    if (sources / "python-can").is_dir():
        rows += [Row("python-can back2back_test", *told) for told in back_to_back(sources / "python-can")]
    if not rows:
        raise SystemExit(f"{sources} has none of the clients; clone them first:\n{__doc__}")
    lines = [f"| {row.client} | `{row.call}` | {row.result} |\n" for row in rows]
    fill(_PAGE, "outside clients", "| client | call | result |\n|---|---|---|\n" + "".join(lines))
    refused, failed = (sum(row.result.startswith(word) for row in rows) for word in ("refused:", "fails:"))
    print(f"{len(rows)} calls, {refused} refused, {failed} fail")


def _tables(sources: Path, folder: Path) -> Iterator[Row]:
    """Yield the rows of both clients of an ACUTROL3000 and of a program for an ATL table."""
    if (sources / "acutrol3000").is_dir():
        yield from _called("IEAv-EFO/acutrol3000", ieav(sources / "acutrol3000"), IEAV)
    if (sources / "acutrol").is_dir():
        yield from _called("AcutronicRobotics/acutrol", robotics(sources / "acutrol", folder), ROBOTICS)
    if (sources / "RateTableSweepGUI").is_dir():
        table = actigraph(sources / "RateTableSweepGUI")
        yield from _called("actigraph/RateTableSweepGUI", table, ACTIGRAPH)


def _cts_and_thermotron(sources: Path) -> Iterator[Row]:
    """Yield the rows of pymeasure on a 3800 that answers no command, and of both classes for a CTS."""
    oven = Line(lambda plant: ThermotronEmulator(plant, controller="3800", acknowledges=False))
    yield from _called("pymeasure Thermotron3800", pymeasure_oven(oven.ask), PYMEASURE)
    if (sources / "VT4002").is_dir():
        weiss = Line(lambda plant: WeissEmulator(plant, auxiliary=range(1, 9), values_with_set=True))
        yield from _called("ondrejh/VT4002", vt4002(sources / "VT4002", weiss.ask), VT4002)
    if (sources / "labtoys_python").is_dir():
        bare = Line(lambda plant: CtsEmulator(plant, framed=False))
        chamber = labtoys_chamber(sources / "labtoys_python", bare.ask)
        yield from _called("labtoys ASCII_Proto_ETH", chamber, LABTOYS)
    if (sources / "cts-chamber").is_dir():
        framed = cts_chamber(sources / "cts-chamber", Line(CtsEmulator).ask)
        yield from _called("cts-chamber CTSChamber", framed, CTS_CHAMBER)


def _called(name: str, client: Any, calls: Sequence[tuple[str, tuple[Any, ...]]]) -> Iterator[Row]:
    for call, arguments in calls:
        text = f"{call}({', '.join(map(str, arguments))})"
        try:
            result = str(getattr(client, call)(*arguments))
        except Exception as error:  # whatever a client raises is its result
            refused = type(error).__name__ in _REFUSALS
            result = f"{'refused' if refused else 'fails'}: {error}"
        yield Row(name, text, result if len(result) <= 100 else result[:97] + "...")


def _chamber_connect(source: Path, folder: Path) -> Iterator[Row]:
    """Yield the rows of ESPEC's library: both Watlow controllers, the P-300 by its lines and by its verbs."""
    package = folder / "chamberconnectlibrary"
    shutil.copytree(source / "chamberconnectlibrary", package)
    for path in package.glob("*.py"):
        path.write_text(path.read_text(encoding="utf-8-sig"), encoding="utf-8")
    to_python_3(package)
    _bytes_are_numbers(package / "modbus.py")
    sys.path.insert(0, str(folder))
    modbus = importlib.import_module("chamberconnectlibrary.modbus")
    interact = importlib.import_module("chamberconnectlibrary.especinteract")

    def over_modbus(line: Line) -> Any:
        client = modbus.Modbus(1)

        def exchange(packet: bytes) -> bytes:
            answer = line.ask(packet + FramerRTU.compute_CRC(packet).to_bytes(2, "big"))
            if not answer:
                raise modbus.ModbusError("no answer")
            return answer[:-2]

        client.interact, client.close = exchange, lambda: None
        return client

    def ask(line: Line, message: Any) -> Any:
        if isinstance(message, list):
            return [ask(line, text) for text in message]
        answer = line.ask(f"{message}\r\n".encode()).decode().removesuffix("\r\n")
        if answer.startswith("NA:"):
            raise interact.EspecError(answer)
        return answer

    watlow_f4 = importlib.import_module("chamberconnectlibrary.watlowf4").WatlowF4(
        cond_event=1, interface="RTU"
    )
    watlow_f4.client = over_modbus(Line(F4Emulator))
    yield from _called("ChamberConnectLibrary WatlowF4", watlow_f4, _LOOP)
    watlow_f4t = importlib.import_module("chamberconnectlibrary.watlowf4t").WatlowF4T(
        interface="RTU", profiles=True
    )
    watlow_f4t.client = over_modbus(Line(lambda plant: F4TEmulator(plant, framing="rtu")))
    yield from _called("ChamberConnectLibrary WatlowF4T", watlow_f4t, _LOOP)
    p300 = object.__new__(importlib.import_module("chamberconnectlibrary.p300").P300)
    line = Line(EspecEmulator)
    p300.ctlr = types.SimpleNamespace(interact=lambda message: ask(line, message), close=lambda: None)
    p300.ramprgms, p300.reflookup = 40, {"REF9": {"mode": "auto", "setpoint": 0}}
    yield from _called("ChamberConnectLibrary P300", p300, _P300)
    espec = importlib.import_module("chamberconnectlibrary.espec").Espec(interface="TCP")
    espec.client = p300
    yield from _called("ChamberConnectLibrary Espec", espec, _LOOP)


def _bytes_are_numbers(path: Path) -> None:
    """What the conversion to Python 3 leaves: bytes indexed, and integers divided."""
    text = path.read_text(encoding="utf-8").replace("collections.Iterable", "collections.abc.Iterable")
    text = text.replace("import collections\n", "import collections.abc\n")
    for number in range(3):
        text = text.replace(f'struct.unpack(">B", packet[{number}])[0]/2', f"packet[{number}]//2")
        text = text.replace(f'struct.unpack(">B", packet[{number}])[0]', f"packet[{number}]")
    path.write_text(text, encoding="utf-8")


def _basil(source: Path) -> Iterator[Row]:
    """Yield the rows of basil's SimServ client, loaded without the rest of basil."""
    base = types.ModuleType("basil.HL.RegisterHardwareLayer")
    vars(base)["HardwareLayer"] = object
    for name in ("basil", "basil.HL"):
        sys.modules[name] = types.ModuleType(name)
    sys.modules[base.__name__] = base
    module = load("weiss_labevent", source / "basil/HL/weiss_labevent.py")
    client = object.__new__(module.weissLabEvent)
    line = Line(WeissEmulator)

    def query(command: bytes, buffer_size: int) -> list[bytes]:
        return [line.ask(command + b"\r").removesuffix(b"\r\n")]

    client._intf = types.SimpleNamespace(query=query)
    yield from _called("basil weiss_labevent", client, _BASIL)


def _minimalmodbus(source: Path) -> Iterator[Row]:
    """Yield the rows of minimalmodbus on both Watlow controllers."""
    sys.path.append(str(source))
    clients = {
        "F4": minimalmodbus_client(Line(F4Emulator).ask),
        "F4T": minimalmodbus_client(Line(lambda plant: F4TEmulator(plant, framing="rtu")).ask),
    }
    for controller, call, arguments in MODBUS:
        name = f"minimalmodbus Watlow {controller}"
        yield from _called(name, clients[controller], [(call, arguments)])


if __name__ == "__main__":
    if len(sys.argv) != 2:
        raise SystemExit(__doc__)
    main(Path(sys.argv[1]))
