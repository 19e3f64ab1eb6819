"""Other people's programs for rate tables, each with an emulated table in place of its port."""

from __future__ import annotations

import json
import struct
import sys
import types
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from benchmarks._outside_load import load, to_python_3
from simulators.emulators.acutrol import AcutrolEmulator
from simulators.emulators.ideal_atl import AtlEmulator
from simulators.interfaces import Emulator
from simulators.plant.table import TableAxis, TableParameters

IEAV: Sequence[tuple[str, tuple[Any, ...]]] = (
    ("limits", ()),
    ("set_limits", (150.0, 100.0)),
    ("initialize", ()),
    ("send_position", (90.0,)),
    ("wait_stop", ()),
    ("status", ()),
    ("send_delta_position", (-45.0,)),
    ("wait_stop", ()),
    ("read_pos", ()),
    ("send_rate", (20.0,)),
    ("read_rate", ()),
    ("read_acc", ()),
    ("check_error", ()),
    ("set_oscillation", (2.0, 0.1)),
    ("send_oscillation", (5.0, 0.5)),
    ("status", ()),
    ("stop", ()),
    ("status", ()),
    ("terminate", ()),
    ("check_error", ()),
)
ROBOTICS: Sequence[tuple[str, tuple[Any, ...]]] = (
    ("startup", ()),
    ("command_rate", (0.1,)),
    ("status", ()),
    ("command_position", (1.0,)),
    ("status", ()),
    ("shutdown", ()),
)
ACTIGRAPH: Sequence[tuple[str, tuple[Any, ...]]] = (
    ("setAcceleration", (100,)),
    ("setVelocity", (50,)),
    ("setDirection", (True,)),
    ("setHomeOffset", (0.0,)),
    ("jog", (20,)),
    ("getVelocity", ()),
    ("jog", (-20,)),
    ("getStatus", ()),
    ("relationalMove", (45,)),
    ("isMoving", ()),
    ("move", (90,)),
    ("getPosition", ()),
    ("home", ()),
    ("setZero", (0,)),
    ("saveSettings", ()),
    ("sinusoid", (5.0, 0.5)),
    ("getVelocity", ()),
    ("jog", (0,)),
    ("getPosition", ()),
    ("stop", ()),
)


class TableLine:
    """An emulated table and the lab time, which the program's own pauses move on."""

    def __init__(self, make: Callable[[TableAxis], Emulator]) -> None:
        self._plant = TableAxis(TableParameters())
        self._device = make(self._plant)
        self.now_s = 10.0

    def ask(self, data: bytes) -> list[bytes]:
        """Write `data` 0.1 s after the exchange before; return the device's answers."""
        self.now_s += 0.1
        return [reply.data for reply in self._device.receive(data, self.now_s)]

    def clock(self) -> types.SimpleNamespace:
        """Return what the programs use of the module time. `sleed` is how one of them spells it."""

        def sleep(duration_s: float) -> None:
            self.now_s += duration_s

        return types.SimpleNamespace(sleep=sleep, sleed=sleep, time=lambda: self.now_s)

    def servo(self) -> None:
        """Close the servo, as the operator of a table has before a program begins."""
        self.ask(b"SRV1\r\n")


class RefusedError(Exception):
    """The controller refused a command."""


def _acl(line: TableLine, text: str) -> str:
    """Return the text of the one answer to a line of ACL; RefusedError where it is an error."""
    (answer,) = line.ask(text.encode() + b"\r\n")
    code, length = struct.unpack("<II", answer[:8])
    words = answer[8 : 8 + length].decode()
    if code:
        raise RefusedError(f"{text}: {code} {words}")
    return words


def ieav(source: Path) -> Any:
    """Return IEAv's module, its GPIB board a line: only queries are answered, each answer ends in LF."""
    line = TableLine(AcutrolEmulator)
    answers: list[str] = []

    def write(text: str) -> None:
        words = _acl(line, text)
        if "?" in text:
            answers.append(words + "\n")

    def query(text: str) -> str:
        write(text)
        return answers.pop(0)

    board = types.SimpleNamespace(write=write, read=lambda: answers.pop(0), query=query)
    manager = types.SimpleNamespace(open_resource=lambda name: board)
    visa = types.ModuleType("pyvisa")
    vars(visa)["ResourceManager"] = lambda: manager
    kept = sys.modules.get("pyvisa")
    sys.modules["pyvisa"] = visa
    try:
        module = load("ieav_acutrol", source / "python/acutrol3000.py")
    finally:
        sys.modules.pop("pyvisa")
        if kept is not None:
            sys.modules["pyvisa"] = kept
    vars(module)["time"] = line.clock()
    return module


def robotics(source: Path, folder: Path) -> Any:
    """Return AcutronicRobotics' class on TCP, converted to Python 3; its socket sends and receives text."""
    path = folder / "acutrol_robotics.py"
    path.write_text((source / "acutrol.py").read_text(encoding="utf-8"), encoding="utf-8")
    (folder / "ac117.json").write_bytes((source / "ac117.json").read_bytes())
    to_python_3(path)
    module = load("acutrol_robotics", path)
    line = TableLine(AcutrolEmulator)
    answers: list[bytes] = []
    port = types.SimpleNamespace(
        connect=lambda address: None,
        send=lambda text: answers.extend(line.ask(text.encode())),
        recv=lambda size: answers.pop(0).decode("latin-1"),
    )
    vars(module)["time"] = line.clock()
    vars(module)["socket"] = types.SimpleNamespace(socket=lambda *_: port, AF_INET=0, SOCK_STREAM=0)
    commands = json.loads((source / "ac117.json").read_text(encoding="utf-8"))
    return module.AcutrolDevice(command_dict=commands)


def actigraph(source: Path) -> Any:
    """Return actigraph's class for an ATL table of one prompt, without its window; its port reads characters."""
    text = (source / "RateSweepGUI.py").read_text(encoding="utf-8")
    begin, end = text.index("class IdealAerosmithTable"), text.index("if __name__")
    line = TableLine(lambda plant: AtlEmulator(plant, one_prompt=True))
    line.servo()
    waiting: list[str] = []

    def write(data: bytes) -> None:
        answer = b"".join(line.ask(data)).decode()
        waiting.extend(answer)
        if "?" in answer:
            raise RefusedError(f"{data.decode().strip()}: ?")

    def read(size: int) -> str:
        if not waiting:
            raise TimeoutError("no answer")
        return "".join(waiting.pop(0) for _ in range(size))

    port = types.SimpleNamespace(write=write, read=read, flush=lambda: None, close=lambda: None)
    names = {"serial": types.SimpleNamespace(Serial=lambda name: port), "sleep": line.clock().sleep}
    exec(compile(text[begin:end], "RateSweepGUI.py", "exec"), names)
    return names["IdealAerosmithTable"]("COM1")
