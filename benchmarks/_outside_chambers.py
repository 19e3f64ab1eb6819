"""Other people's classes for chambers, each with an emulator in place of its port."""

from __future__ import annotations

import importlib
from collections.abc import Callable, Sequence
from typing import Any

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
