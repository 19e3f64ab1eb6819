"""What drivers of power supplies do alike: outputs as the bench file has them, switched with a read-back."""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any

from drivers.base.errors import DeviceRefused
from drivers.kit.config import OutputConfig, SupplyConfig
from drivers.kit.instruments import Rest, Supply
from drivers.kit.link import Link
from drivers.kit.scpi import ScpiMeter

_SET_V, _SET_A = 0.011, 0.0051
"""A setting that reads back so near is the one that was told: supplies resolve 10 mV and 5 mA, or less."""
ANY_OUTPUT: Mapping[str, Any] = {
    "name": "supply",
    "outputs": (OutputConfig(number=1, voltage_v=1.0, current_limit_a=1.0),),
}
"""Keys of a supply that is only asked who it is."""
_LIMITING = 0.97
"""An output whose voltage is below this share of its setting, at its current limit, holds the current."""


@dataclass(frozen=True)
class Setting:
    """What an output is set to."""

    voltage_v: float
    current_limit_a: float

    def __str__(self) -> str:
        return f"{self.voltage_v:g} V, at most {self.current_limit_a:g} A"

    def is_near(self, other: Setting) -> bool:
        """Return whether both are the same but for what a supply resolves."""
        same_voltage = math.isclose(self.voltage_v, other.voltage_v, rel_tol=1e-3, abs_tol=_SET_V)
        return same_voltage and math.isclose(
            self.current_limit_a, other.current_limit_a, rel_tol=1e-3, abs_tol=_SET_A
        )


def columns_of(config: SupplyConfig) -> tuple[str, ...]:
    """Return the names of a supply's readings: voltage and current of every output."""
    return tuple(
        f"output_{output.number}_{what}" for output in config.outputs for what in ("voltage_v", "current_a")
    )


class ScpiSupply(ScpiMeter, Supply):
    """The part of a supply that is the same for every maker.

    An output that is on with another voltage or limit than the bench file's is refused before it is changed: what
    hangs on it now may not bear it. The safe state is that of `safe` of each output; the others stay as they are.
    """

    def __init__(self, link: Link, config: SupplyConfig) -> None:
        super().__init__(link)
        self.outputs: Mapping[int, OutputConfig] = {output.number: output for output in config.outputs}
        self.columns = columns_of(config)
        self._wanted_on: dict[int, bool] = {}

    @abstractmethod
    def _setting(self, output: int) -> Setting:
        """Read what an output is set to."""

    @abstractmethod
    def _set(self, output: int, setting: Setting) -> str:
        """Return the commands that set an output, one a line."""

    @abstractmethod
    def _switching(self, output: int, on: bool) -> str:
        """Return the commands that switch an output, one a line."""

    @abstractmethod
    def _tripped(self, output: int) -> str:
        """Return which protection has switched an output off, in words; empty if none has."""

    def prepare(self) -> None:
        """Set voltages and current limits; DeviceRefused for an output that is on with others."""
        self._clear_errors()
        for number, output in self.outputs.items():
            wanted = Setting(output.voltage_v, output.current_limit_a)
            read_back = self._setting(number)
            if read_back.is_near(wanted):
                continue
            if self.is_on(number):
                raise DeviceRefused(
                    f"output {number} is on with another setting than the bench file's",
                    where=self._where,
                    found=str(read_back),
                    expected=f"{wanted}, or it is off",
                    remedy="switch it off at the supply if it feeds the bench file's unit, or correct the file",
                )
            self._tell(
                self._set(number, wanted),
                lambda n=number, w=wanted: self._setting(n).is_near(w),  # type: ignore[misc]
            )
            if not (read_back := self._setting(number)).is_near(wanted):
                raise DeviceRefused(
                    f"output {number} did not take its setting",
                    where=self._where,
                    found=str(read_back),
                    expected=str(wanted),
                    remedy="check that the supply's ranges and its panel allow it",
                )

    def switch(self, output: int, on: bool) -> None:
        """Switch an output and read back that it is; DeviceRefused if it is not."""
        self._tell(self._switching(output, on), lambda: self.is_on(output) is on)
        self._wanted_on[output] = on
        if self.is_on(output) is not on:
            raise DeviceRefused(
                f"output {output} took the command and did not switch",
                where=self._where,
                found=self._tripped(output) or f"an output that is {'off' if on else 'on'}",
                expected=f"an output that is {'on' if on else 'off'}",
                remedy="look at the supply's panel: protection, interlock, lock",
            )

    def alarms(self) -> list[str]:
        """Return outputs that a protection or other hands have switched off, or that limit the current."""
        alarms = []
        for number, output in self.outputs.items():
            if tripped := self._tripped(number):
                alarms.append(f"output {number}: {tripped}")
            elif self._wanted_on.get(number) and not self.is_on(number):
                alarms.append(f"output {number} is off, and not by the bench")
            elif self._wanted_on.get(number):
                volts, amperes = self._measured(number)
                if volts < _LIMITING * output.voltage_v and amperes > _LIMITING * output.current_limit_a:
                    alarms.append(
                        f"output {number} holds its current limit: {amperes:.3g} A at {volts:.3g} V "
                        f"instead of {output.voltage_v:g} V"
                    )
        return alarms

    def _measured(self, output: int) -> tuple[float, float]:
        self.request_readings()
        row = self.read()
        return row[f"output_{output}_voltage_v"], row[f"output_{output}_current_a"]

    def make_safe(self) -> None:
        """Switch off the outputs that are to be off; the others are not touched."""
        self._once_halted()
        self._carry_out_all(partial(self.switch, number, False) for number in self._to_be_off())

    def read_rest(self) -> Rest:
        """Read which outputs are on: at rest if those that are to be off are."""
        on = {number: self.is_on(number) for number in self.outputs}
        return Rest(
            not any(on[number] for number in self._to_be_off()),
            outputs={str(number): state for number, state in on.items()},
        )

    def _send_stop(self) -> None:
        self._write("", *(self._switching(number, False) for number in self._to_be_off()))

    def _to_be_off(self) -> list[int]:
        return [number for number, output in self.outputs.items() if output.safe == "off"]
