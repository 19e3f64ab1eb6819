"""A driver as the bench finds it by its kind: its configuration, how it is opened, how its record is decoded."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any, Generic, Literal, TypeVar

from numpy.typing import NDArray

from drivers.base.clock import Clock
from drivers.kit.config import ChamberConfig, GyroConfig, InstrumentConfig, PlatformConfig, TableConfig
from drivers.kit.instruments import Chamber, Gyro, Meter, Platform, StreamDecoder, Turntable
from drivers.kit.link import Link, Tap

Columns = Mapping[str, NDArray[Any]]
"""Decoded values by name, shape (n,) each."""
Exchange = tuple[int, Literal["sent", "received"], bytes]
"""(bench time in ns, "sent" or "received", bytes) of a polled instrument, in time order."""
Transcript = tuple[dict[str, NDArray[Any]], dict[str, int]]
"""Telemetry columns of shape (n,), and counts of what was dropped."""


@dataclass(frozen=True)
class Connection:
    """What a driver opens its port with: the port's name on the bench, the clock, the recorder of its bytes.

    `tap` None: nobody records. `safe_set_point_c`: where a chamber is left when something goes wrong.
    """

    name: str
    clock: Clock
    tap: Tap | None
    safe_set_point_c: float = 25.0

    def link(self, port: str | None, baudrate: int, **serial: Any) -> Link:
        """Open a serial port or socket; `serial`: further arguments of `Link`."""
        assert port is not None, "the bench file's checks give every serial unit a port"
        return Link(port, self.clock, name=self.name, tap=self.tap, baudrate=baudrate, **serial)


@dataclass(frozen=True)
class Probe:
    """How `gyrobench ports` finds a driver's device on a port.

    A polled instrument is asked at `baudrate` who it is, by a driver with the configuration `keys`; its
    `identify` must only read. A stream is decoded with `keys`. Of all drivers' probes those of lower `rank` come
    first: text before binary protocols, whose frames would lie in a text device's input. `ends_line`: an end of
    line is sent before, so that what another probe left there is no part of the question. `name`: what of `keys`
    tells this device from the driver's others, for people.
    """

    rank: int
    keys: Mapping[str, Any] = field(default_factory=dict)
    baudrate: int = 9600
    ends_line: bool = True
    name: str = ""


def _no_probes() -> Iterable[Probe]:
    return ()


T = TypeVar("T", bound=TableConfig)
C = TypeVar("C", bound=ChamberConfig)
G = TypeVar("G", bound=GyroConfig)
P = TypeVar("P", bound=PlatformConfig)
M = TypeVar("M", bound=InstrumentConfig)


@dataclass(frozen=True)
class TableKind(Generic[T]):
    """A table driver.

    `decode_transcript` rebuilds telemetry from recorded bytes: `time_ns`, `angle_deg`, `rate_dps` of the axis
    that carries the unit, and `<name>_angle_deg`, `<name>_rate_dps` of those outside of it.
    """

    open: Callable[[T, Connection], Turntable]
    decode_transcript: Callable[[Iterable[Exchange], T], Transcript]
    config: type[T]
    probes: Callable[[], Iterable[Probe]] = _no_probes


@dataclass(frozen=True)
class ChamberKind(Generic[C]):
    """A chamber driver; `decode_transcript` gives columns as `drivers.kit.instruments.ChamberState`."""

    open: Callable[[C, Connection], Chamber]
    decode_transcript: Callable[[Iterable[Exchange]], Transcript]
    config: type[C]
    probes: Callable[[], Iterable[Probe]] = _no_probes


@dataclass(frozen=True)
class GyroKind(Generic[G]):
    """A gyro driver.

    `decoder` needs no open port, so that a record can be decoded anywhere. `rates` turns decoded columns into
    rates in deg/s by axis, given the true sample rate in Hz; `accelerations` likewise into specific force in
    m/s2 by axis, None for a kind that has no accelerometers; `temperatures` into those in degC that the unit
    sends besides its own, by column name: `case_temp_c`, `<sensor>_temp_c`.
    """

    open: Callable[[G, Connection], Gyro]
    decoder: Callable[[G], StreamDecoder]
    rates: Callable[[G, Columns, float], dict[str, NDArray[Any]]]
    config: type[G]
    accelerations: Callable[[G, Columns, float], dict[str, NDArray[Any]]] | None = None
    temperatures: Callable[[G, Columns, float], dict[str, NDArray[Any]]] | None = None
    probes: Callable[[], Iterable[Probe]] = _no_probes


@dataclass(frozen=True)
class PlatformKind(Generic[P]):
    """A platform INS driver; see `GyroKind`.

    `columns`: what the decoder gives beside `counter`, `status` and `valid`, in the order of the table; it
    leaves out those that a unit does not send by its configuration.
    """

    open: Callable[[P, Connection], Platform]
    decoder: Callable[[P], StreamDecoder]
    columns: tuple[str, ...]
    config: type[P]


@dataclass(frozen=True)
class MeterKind(Generic[M]):
    """A driver of a supply, a logger or an instrument of another role.

    `decode_transcript` gives `time_ns` and the device's columns. `made_safe`: whether it has a safe state
    (`Instrument.make_safe`); one that only reads has none.
    """

    open: Callable[[M, Connection], Meter]
    decode_transcript: Callable[[Iterable[Exchange], M], Transcript]
    config: type[M]
    probes: Callable[[], Iterable[Probe]] = _no_probes
    made_safe: bool = False
