"""Driver of a Weiss or Vötsch chamber: what its two protocols share, its description of itself above all."""

from __future__ import annotations

from abc import abstractmethod

from drivers.kit.chamber import PolledChamber
from drivers.kit.config import ChamberConfig, key
from drivers.kit.instruments import Identity
from drivers.kit.kinds import Connection
from drivers.kit.retry import query_with_retry
from drivers.weiss.ascii2 import encode_configuration_query
from drivers.weiss.configuration import Configuration, decode_configuration

REPLY_TIMEOUT_S = 2.0
"""Public drivers wait 1 to 2 s for a reply."""

QUIET_S = 0.5
"""The answer to `$dd?` has many lines and no end mark: it is over when nothing came for this long."""


class WeissConfig(ChamberConfig):
    """`[chamber]` of a Weiss or Vötsch chamber; `auxiliary` are numbers of its measured values (MVnn).

    `start_channel` is a SimServ index, 1 on most controllers, 2 on some. Without `simserv` temperatures have a
    resolution of 0.1 degC, and alarms are known only as far as the chamber names a digital output for them.
    """

    address: int | None = key(
        default=None, ge=0, le=31, description="the address of a Weiss chamber, 0 to 31; left out: 1"
    )
    simserv: bool = key(default=True, description="true if the chamber's port also answers SimServ")
    start_channel: int = key(
        default=1, ge=1, le=32, description="the number of the digital output that starts the chamber"
    )

    @property
    def bus_address(self) -> int:
        """The address in every message."""
        return 1 if self.address is None else self.address


class WeissChamber(PolledChamber):
    """One chamber at a serial port or TCP port 2049."""

    _product = "a Weiss or Vötsch chamber"
    _check = "check which device the bench file names for this port, its address and `simserv`"
    _switched_by = "check door, alarms and start_channel (1 on most controllers, 2 on some)"

    def __init__(self, config: WeissConfig, connection: Connection) -> None:
        super().__init__(connection.link(config.port, config.baudrate), connection.safe_set_point_c)
        self.address = config.bus_address
        self.auxiliary = tuple(config.auxiliary)
        self._start_channel = config.start_channel
        self._configuration: Configuration | None = None

    @abstractmethod
    def _model(self) -> tuple[str, str, dict[str, str]]:
        """Return model, serial number and details, as far as the protocol tells."""

    def _introduction(self) -> Identity:
        """Ask for model and serial number (SimServ) and the configuration (`$dd?`)."""
        model, serial_number, details = self._model()
        self._configuration = None
        configuration = self.configuration()
        details["set values"] = " ".join(configuration.set_fields)
        details["read values"] = " ".join(configuration.read_fields)
        details["digital outputs"] = ", ".join(
            f"DO{index:02d} {name}" for index, name in configuration.digital_names.items()
        )
        return Identity("Weiss Technik", model, serial_number, "", details)

    def configuration(self) -> Configuration:
        """Return what the chamber answers to `$dd?`, asked once; raises ProtocolError if it makes no sense."""
        if self._configuration is None:
            self._configuration = query_with_retry(self.link, self._ask_configuration)
        return self._configuration

    def _ask_configuration(self) -> Configuration:
        self._settle_input()
        self.link.write(encode_configuration_query(self.address))
        answer = self.link.read_until(b"\r", REPLY_TIMEOUT_S)
        while more := self.link.read_some(QUIET_S):
            answer += more
        return decode_configuration(answer.decode("latin-1"))
