"""Other people's classes for chambers, each with an emulator in place of its port."""

from __future__ import annotations

import importlib
import sys
import types
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from benchmarks._outside_load import load

Ask = Callable[[bytes], bytes]
"""Bytes to a device -> the bytes of its answer, empty if there is none."""

PYMEASURE: Sequence[tuple[str, tuple[Any, ...]]] = (
    ("id", ()),
    ("mode", ()),
    ("temperature", ()),
    ("initalize_oven", ()),
    ("setpoint", (-20.0,)),
    ("setpoint", ()),
    ("run", ()),
    ("setpoint", ()),
    ("mode", ()),
    ("stop", ()),
    ("mode", ()),
)
LABTOYS: Sequence[tuple[str, tuple[Any, ...]]] = (
    ("GetMeasuredTemp", ()),
    ("SetTemp", (-20.5,)),
    ("ReadSetTemp", ()),
    ("StartChamber", ()),
    ("ReadGradientUp", ()),
    ("ReadGradientDown", ()),
    ("StopChamber", ()),
)
CTS_CHAMBER: Sequence[tuple[str, tuple[Any, ...]]] = (
    ("get_temperature", ()),
    ("get_state", ()),
    ("ramp_to_temperature", (-20.5, 2.0, 5.0)),
    ("get_temperature_ramp_information", ()),
    ("start", ()),
    ("get_state", ()),
    ("pause", ()),
    ("resume", ()),
    ("collect_errors", ()),
    ("stop", ()),
    ("set_temperature", (25.0,)),
    ("get_humidity", ()),
)

VT4002: Sequence[tuple[str, tuple[Any, ...]]] = (
    ("read_temp", ("COM1", False)),
    ("set_temp", ("COM1", -20.5, "ON", False)),
    ("read_temp", ("COM1", False)),
    ("set_temp", ("COM1", 30.0, "OFF", False)),
    ("read_temp", ("COM1", False)),
)


class Called:
    """An object whose properties are read and set by calls, as its methods are made."""

    def __init__(self, client: Any) -> None:
        self._client = client

    def __getattr__(self, name: str) -> Callable[..., Any]:
        def call(*arguments: Any) -> Any:
            if not isinstance(getattr(type(self._client), name, None), property):
                return getattr(self._client, name)(*arguments)
            if not arguments:
                return getattr(self._client, name)
            return setattr(self._client, name, *arguments)

        return call


def pymeasure_oven(ask: Ask) -> Called:
    """Return pymeasure's Thermotron3800 on a device; its pauses are left out: each exchange takes 1 s already."""
    adapters = importlib.import_module("pymeasure.adapters")
    ovens = importlib.import_module("pymeasure.instruments.thermotron.thermotron3800")
    vars(ovens)["sleep"] = lambda duration_s: None
    answers: list[str] = []

    def write(self: Any, command: str, **_: Any) -> None:
        answers.extend(ask(f"{command}\r".encode()).decode().splitlines())

    def read(self: Any, **_: Any) -> str:
        return answers.pop(0)

    line = type("OnEmulator", (adapters.ProtocolAdapter,), {"_write": write, "_read": read})
    return Called(ovens.Thermotron3800(line()))


def labtoys_chamber(source: Path, ask: Ask) -> Any:
    """Return labtoys' class for a CTS on TCP, which reads so many characters of an answer.

    The package's own beginning, which asks for Windows, is left out.
    """
    package = types.ModuleType("labtoys")
    package.__path__ = [str(source / "labtoys")]
    sys.modules["labtoys"] = package
    chamber = importlib.import_module("labtoys.CTS.ASCII_Proto_ETH").ASCII_Proto_ETH("", 1080)

    def answer(command: str, respondLength: int = 1024) -> str:  # noqa: N803 (its name)
        return ask(command.encode()).decode()[:respondLength]

    vars(chamber)["_ASCII_Proto_ETH__device"] = types.SimpleNamespace(SendCommandGetAns=answer)
    return chamber


def cts_chamber(source: Path, ask: Ask) -> Any:
    """Return cts-chamber's class for a CTS on RS-232; it asks up to three times more where nothing answers."""
    sys.path.append(str(source))
    package = importlib.import_module("cts_chamber")
    answers: list[bytes] = []

    def read() -> bytes:
        if not (answer := answers.pop(0)):
            raise TimeoutError("no answer")
        return answer

    port = types.SimpleNamespace(
        write_raw=lambda frame: answers.append(ask(bytes(frame))), read_raw=read, close=lambda: None
    )
    manager = types.SimpleNamespace(open_resource=lambda path: port)
    return package.CTSChamber(resource_path="memory", resource_manager=manager)


def vt4002(source: Path, ask: Ask) -> Any:
    """Return ondrejh's module for ASCII-2 on RS-232."""
    answers: list[bytes] = []

    def lines() -> list[bytes]:
        taken = [line for answer in answers for line in answer.splitlines(keepends=True)]
        answers.clear()
        return taken

    port = types.SimpleNamespace(write=lambda data: answers.append(ask(bytes(data))), readlines=lines)
    module = load("vt4002", source / "VT4002.py")
    vars(module)["serial"] = types.SimpleNamespace(Serial=lambda name, baud, timeout: port)
    return module
