"""A Weiss or Vötsch chamber by ASCII-2 strings alone, for controllers without SimServ."""

from __future__ import annotations

from collections.abc import Callable, Iterable

from drivers.base.errors import DeviceRefused, ProtocolError
from drivers.kit.instruments import ChamberCapabilities, ChamberLimits, ChamberState, require_ramp
from drivers.kit.kinds import Connection
from drivers.kit.retry import command_with_retry, pass_over, query_with_retry
from drivers.weiss._driver import QUIET_S, REPLY_TIMEOUT_S, WeissChamber, WeissConfig
from drivers.weiss.ascii2 import (
    CR,
    Values,
    decode_values,
    encode_configuration_query,
    encode_gradient,
    encode_read,
    encode_set,
)

_RESOLUTION_C = 0.11
"""Values are rounded to 0.1 degC."""
_ALARM_WORDS = ("alarm", "error", "fault", "warning")


class Ascii2Chamber(WeissChamber):
    """Demands and telemetry in the layout of the chamber's own `$dd?` text; a state is one exchange."""

    _known_by = "ASCII-2 replies"

    def __init__(self, config: WeissConfig, connection: Connection) -> None:
        super().__init__(config, connection)
        self._target_c: float | None = None

    def _model(self) -> tuple[str, str, dict[str, str]]:
        return "chamber without SimServ", "", {}

    def capabilities(self) -> ChamberCapabilities:
        """Return tenths of a degree and the measured values that the configuration names."""
        return ChamberCapabilities(0.1, (0.1, 9999.9), self.configuration().measured_values())

    def limits(self) -> ChamberLimits:
        """Return the limits of the temperature set point that the configuration names."""
        self._settle_input()
        temperature = self.configuration().settings["CV01"]
        return ChamberLimits(temperature.minimum, temperature.maximum)

    def set_temperature(self, set_point_c: float, ramp_k_per_min: float | None = None) -> None:
        """Demand a set point and a gradient in its direction; None: as fast as possible, both ways."""
        require_ramp(self.capabilities(), set_point_c, ramp_k_per_min, self._where)
        ramp = 0.0 if ramp_k_per_min is None else ramp_k_per_min
        values = self._values()
        upwards = set_point_c >= self._nominal_c(values)
        up, down = (ramp, 0.0) if upwards else (0.0, ramp)
        self._tell(encode_gradient(self.address, up, down))
        self._target_c = set_point_c
        self._set(values, set_point_c, running=self._start_bit_set(values))

    def request_state(self) -> None:
        """Ask for all values without waiting; `read_state` must follow before anything else."""
        self._settle_input()
        self._request_values()
        self._state_asked = True

    def read_state(self) -> ChamberState:
        """Take the answer to `request_state`, resolution 0.1 degC."""
        return self._collected(self._request_values, self._take_state)

    def alarms(self) -> list[str]:
        """Return the names of digital outputs that are set and called alarm, error, fault or warning."""
        digital = self._values().digital
        return [
            name
            for index, name in self.configuration().digital_names.items()
            if digital[index : index + 1] == "1" and any(word in name.lower() for word in _ALARM_WORDS)
        ]

    def in_step(self) -> bool:
        """Ask for the configuration, whose text begins with the name of the protocol."""

        def is_text(timeout_s: float) -> bool:
            if b"PROTOCOL" not in self.link.read_until(CR, timeout_s):
                return False
            while self.link.read_some(QUIET_S):
                pass
            self.link.discard()
            return True

        self._settle_input()
        self.link.write(encode_configuration_query(self.address))
        return pass_over(self.link, REPLY_TIMEOUT_S, is_text)

    def _send_stop(self) -> None:
        """Write a line end: a stop is part of a telegram for which values must be read first."""
        self.link.write(b"\r")

    def _way_to_rest(self) -> Iterable[Callable[[], None]]:
        return (self._rest,)

    def _rest(self) -> None:
        """Stop conditioning at the safe set point, then take gradients away."""
        self.link.read_some(QUIET_S)
        self._target_c = self.safe_set_point_c
        self._set(self._values(), self.safe_set_point_c, running=False)
        self._tell(encode_gradient(self.address, 0.0, 0.0))

    def _switch(self, on: bool) -> None:
        """Set or clear the start bit; everything else stays as it is."""
        values = self._values()
        target_c = self._nominal_c(values) if self._target_c is None else self._target_c
        self._set(values, target_c, running=on)

    def _is_running(self) -> bool:
        return self._start_bit_set(self._values())

    def _demanded_c(self) -> float:
        return self._nominal_c(self._values())

    def _request_values(self) -> None:
        """Ask for all values; the configuration is asked before if it is not known yet."""
        self.configuration()
        self.link.discard()
        self.link.write(encode_read(self.address))

    def _take_state(self) -> ChamberState:
        values, place = self._take_values(), self.configuration().actual_index
        auxiliary_c = {number: values.numbers[place(f"MV{number:02d}")] for number in self.auxiliary}
        return ChamberState(values.numbers[place("CV01")], self._nominal_c(values), auxiliary_c)

    def _values(self) -> Values:
        def ask() -> Values:
            self._request_values()
            return self._take_values()

        self._settle_input()
        return query_with_retry(self.link, ask)

    def _take_values(self) -> Values:
        values = decode_values(self.link.read_until(CR, REPLY_TIMEOUT_S))
        fields = self.configuration().read_fields
        if len(values.numbers) != len(fields):
            raise ProtocolError(
                "the chamber does not send what its configuration says",
                where=self._where,
                found=f"{len(values.numbers)} numbers",
                expected=f"{len(fields)}: {' '.join(fields)}",
                remedy="check the ASCII-2 configuration on the chamber's panel",
            )
        return values

    def _nominal_c(self, values: Values) -> float:
        return values.numbers[self.configuration().read_fields.index("CV01")]

    def _start_bit_set(self, values: Values) -> bool:
        bit = self.configuration().start_bit
        return values.digital[bit : bit + 1] == "1"

    def _set(self, values: Values, set_point_c: float, *, running: bool) -> None:
        """Send `$ddE`: every value as it stands (nominal values come first), but for CV01 and the start bit."""
        configuration = self.configuration()
        fields = configuration.read_fields
        nominal = [
            values.numbers[fields.index(field)]
            if field in fields and (not field.startswith("MV") or fields.count(field) == 2)
            else 0.0
            for field in configuration.set_fields
        ]
        nominal[configuration.set_fields.index("CV01")] = set_point_c
        bits = list(values.digital.ljust(configuration.digital_count, "0")[: configuration.digital_count])
        bits[configuration.start_bit] = "1" if running else "0"

        def in_force() -> bool:
            values = self._values()
            same = abs(self._nominal_c(values) - set_point_c) < _RESOLUTION_C
            return same and self._start_bit_set(values) is running

        self._tell(encode_set(self.address, nominal, "".join(bits)), in_force)

    def _tell(self, request: bytes, in_force: Callable[[], bool] | None = None) -> None:
        command_with_retry(self.link, lambda: self._confirmed(request), in_force, doubt_refusal=True)

    def _confirmed(self, request: bytes) -> None:
        self.link.discard()
        self.link.write(request)
        answer = self.link.read_until(CR, REPLY_TIMEOUT_S).strip()
        if answer == b"0":
            return
        if not (answer.isascii() and answer.decode("ascii").isprintable()):
            raise ProtocolError(
                "the chamber's answer is no text",
                where=self._where,
                found=repr(answer),
                expected="'0'",
                remedy="check baud rate and wiring",
            )
        raise DeviceRefused(
            f"the chamber refused {request.decode('ascii').strip()!r}",
            where=self._where,
            found=repr(answer.decode("latin-1")) if answer else "an empty line",
            expected="'0'",
            remedy="check the demand against the chamber's limits and that its panel allows external control",
        )
