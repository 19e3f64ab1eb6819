"""Instruments beside table and chamber, for procedures: their readings, and supplies that switch units."""

from __future__ import annotations

import math
from collections.abc import Iterable

from bench.control.history import History
from bench.control.station import Session, Station
from bench.record.events.run import Alarm, PowerDemand
from bench.record.events.safe import LastSeen
from drivers.kit.config import InstrumentConfig, OutputConfig, SupplyConfig
from drivers.kit.instruments import Meter, Supply

_SOON_S = 1e-6
"""Polls come a little early or late: what is due so soon is due."""


class InstrumentStation(Station):
    """A logger, a supply or an instrument of another role; `history` has its columns.

    `made_safe`: whether it has a safe state of its own.
    """

    def __init__(
        self, config: InstrumentConfig, device: Meter, session: Session, *, made_safe: bool = False
    ) -> None:
        super().__init__(session, History(device.columns))
        self.name, self.device, self.made_safe = config.name, device, made_safe
        self._period_s = config.period_s
        self._due_s = -math.inf
        self._asked = False
        self._blind: set[str] = set()

    def request(self) -> None:
        """Ask for readings if they are due."""
        self._asked = self._session.now_s >= self._due_s - _SOON_S
        if self._asked:
            self._due_s = self._session.now_s + self._period_s
            self.device.request_readings()

    def collect(self) -> None:
        """Take the readings that were asked for; a sensor that stops reading is an alarm, once."""
        if not self._asked:
            return
        row = self.device.read()
        self.history.append(self._session.now_s, *(row[column] for column in self.device.columns))
        blind = {column for column in self.device.columns if math.isnan(row[column])}
        for column in sorted(blind - self._blind):
            text = f"no reading of {column_words(column)[0]}: the sensor is open or not connected"
            self._session.event(Alarm(self.name, text, "no_reading", {"column": column}))
        self._blind = blind

    @property
    def readings(self) -> dict[str, float]:
        """The newest readings by column; empty before the first."""
        return {name: value for name, value in self.history.last.items() if name != "time_s"}

    def _seen(self, row: dict[str, float], ago_s: float) -> LastSeen:
        return LastSeen(ago_s)


class SupplyStation(InstrumentStation):
    """A power supply: its outputs are on while a run goes on, but where a procedure switches units off."""

    device: Supply

    def __init__(self, config: SupplyConfig, device: Supply, session: Session) -> None:
        super().__init__(config, device, session, made_safe=True)
        self.outputs = config.outputs
        self.start_s = config.start_s

    def turn_on(self) -> bool:
        """Switch on what is off; return whether anything was."""
        off = [output for output in self.outputs if not self.device.is_on(output.number)]
        for output in off:
            self.switch(output, True)
        for output in self.outputs:
            if output not in off:
                self.device.switch(output.number, True)  # it is; from here on the bench answers for it
        return bool(off)

    def switch(self, output: OutputConfig, on: bool) -> None:
        """Switch an output on or off, and write that down."""
        self._session.event(PowerDemand(self.name, output.number, on, list(output.units)))
        self.device.switch(output.number, on)


class Instruments(dict[str, InstrumentStation]):
    """Supplies, loggers and instruments of other roles, by name."""

    def add(self, station: InstrumentStation) -> None:
        """Put one in place."""
        station.device.link.on_retry = station.repeats
        self[station.name] = station

    def request(self) -> None:
        """Ask all for readings that are due."""
        for station in self.values():
            station.request()

    def collect(self) -> None:
        """Take the readings that were asked for."""
        for station in self.values():
            station.collect()

    def alarms(self) -> dict[str, list[str]]:
        """Return the alarms in force, by name."""
        return {name: station.device.alarms() for name, station in self.items()}

    @property
    def supplies(self) -> list[SupplyStation]:
        """The power supplies."""
        return [station for station in self.values() if isinstance(station, SupplyStation)]


def fed_units(supplies: Iterable[SupplyStation]) -> set[str]:
    """Return the names of the units that a supply feeds: no hand is needed to switch them off and on."""
    return {unit for supply in supplies for output in supply.outputs for unit in output.units}


def switch_units(supplies: Iterable[SupplyStation], on: bool) -> None:
    """Switch every output that feeds a unit on or off."""
    for supply in supplies:
        for output in supply.outputs:
            if output.units:
                supply.switch(output, on)


def column_words(column: str) -> tuple[str, str]:
    """Return the name and the unit of a reading's column for people: "output 1 current", "A"."""
    for end, unit in (("_temp_c", "°C"), ("_voltage_v", "V"), ("_current_a", "A")):
        if column.endswith(end):
            name = column.removesuffix(end if unit == "°C" else end[-2:])
            return name.replace("aux_", "sensor ").replace("_", " "), unit
    return column.replace("_", " "), ""
