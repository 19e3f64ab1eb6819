"""Chamber control by ASCII-2 strings alone, for controllers without SimServ."""

from __future__ import annotations

from collections.abc import Callable

from drivers.base.errors import DeviceRefused, ProtocolError
from drivers.kit.instruments import ChamberState
from drivers.kit.link import Link
from drivers.kit.retry import command_with_retry, query_with_retry
from drivers.weiss.ascii2 import CR, Values, decode_values, encode_gradient, encode_read, encode_set
from drivers.weiss.configuration import Configuration

_TIMEOUT_S = 2.0
_RESOLUTION_C = 0.11
"""Values are rounded to 0.1 degC."""
_ALARM_WORDS = ("alarm", "error", "fault", "warning")


class Ascii2Control:
    """Demands and telemetry in the layout of the chamber's own `$dd?` text, which `configuration` returns."""

    def __init__(
        self, link: Link, address: int, auxiliary: tuple[int, ...], configuration: Callable[[], Configuration]
    ) -> None:
        self._link = link
        self._address = address
        self._auxiliary = auxiliary
        self._configuration = configuration
        self._target_c: float | None = None

    def request_values(self) -> None:
        """Ask for all values; the configuration is asked before if it is not known yet."""
        self._configuration()
        self._link.discard()
        self._link.write(encode_read(self._address))

    def read_state(self, timeout_s: float = _TIMEOUT_S) -> ChamberState:
        """Take the answer to `request_values`, resolution 0.1 degC."""
        values, configuration = self._read_values(timeout_s), self._configuration()
        return ChamberState(
            values.numbers[configuration.actual_index("CV01")],
            self._nominal_c(values),
            {
                number: values.numbers[configuration.actual_index(f"MV{number:02d}")]
                for number in self._auxiliary
            },
        )

    def set_temperature(self, set_point_c: float, ramp_k_per_min: float) -> None:
        """Demand a set point and a gradient in its direction (0 = as fast as possible)."""
        values = self._values()
        upwards = set_point_c >= self._nominal_c(values)
        up, down = (ramp_k_per_min, 0.0) if upwards else (0.0, ramp_k_per_min)
        self._tell(encode_gradient(self._address, up, down))
        self._target_c = set_point_c
        self._set(values, set_point_c, running=self._start_bit_set(values))

    def switch(self, on: bool) -> None:
        """Set or clear the start bit; everything else stays as it is."""
        values = self._values()
        target_c = self._nominal_c(values) if self._target_c is None else self._target_c
        self._set(values, target_c, running=on)

    def is_running(self) -> bool:
        """Return whether the start bit is set."""
        return self._start_bit_set(self._values())

    def rest_at(self, set_point_c: float) -> None:
        """Stop conditioning at a set point, then take gradients away."""
        self._target_c = set_point_c
        self._set(self._values(), set_point_c, running=False)
        self._tell(encode_gradient(self._address, 0.0, 0.0))

    def demanded_c(self) -> float:
        """Return the set point in force."""
        return self._nominal_c(self._values())

    def alarms(self) -> list[str]:
        """Return the names of digital outputs that are set and called alarm, error, fault or warning."""
        digital = self._values().digital
        return [
            name
            for index, name in self._configuration().digital_names.items()
            if digital[index : index + 1] == "1" and any(word in name.lower() for word in _ALARM_WORDS)
        ]

    def _values(self) -> Values:
        def ask() -> Values:
            self.request_values()
            return self._read_values(_TIMEOUT_S)

        return query_with_retry(self._link, ask)

    def _read_values(self, timeout_s: float) -> Values:
        values = decode_values(self._link.read_until(CR, timeout_s))
        fields = self._configuration().read_fields
        if len(values.numbers) != len(fields):
            raise ProtocolError(
                "the chamber does not send what its configuration says",
                where=self._link.where,
                found=f"{len(values.numbers)} numbers",
                expected=f"{len(fields)}: {' '.join(fields)}",
                remedy="check the ASCII-2 configuration on the chamber's panel",
            )
        return values

    def _nominal_c(self, values: Values) -> float:
        return values.numbers[self._configuration().read_fields.index("CV01")]

    def _start_bit_set(self, values: Values) -> bool:
        bit = self._configuration().start_bit
        return values.digital[bit : bit + 1] == "1"

    def _set(self, values: Values, set_point_c: float, *, running: bool) -> None:
        """Send `$ddE`: every value as it stands (nominal values come first), but for CV01 and the start bit."""
        configuration = self._configuration()
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

        self._tell(encode_set(self._address, nominal, "".join(bits)), in_force)

    def _tell(self, request: bytes, in_force: Callable[[], bool] | None = None) -> None:
        command_with_retry(self._link, lambda: self._confirmed(request), in_force, doubt_refusal=True)

    def _confirmed(self, request: bytes) -> None:
        self._link.discard()
        self._link.write(request)
        answer = self._link.read_until(CR, _TIMEOUT_S).strip()
        if answer == b"0":
            return
        if not (answer.isascii() and answer.decode("ascii").isprintable()):
            raise ProtocolError(
                "the chamber's answer is no text",
                where=self._link.where,
                found=repr(answer),
                expected="'0'",
                remedy="check baud rate and wiring",
            )
        raise DeviceRefused(
            f"the chamber refused {request.decode('ascii').strip()!r}",
            where=self._link.where,
            found=repr(answer.decode("latin-1")) if answer else "an empty line",
            expected="'0'",
            remedy="check the demand against the chamber's limits and that its panel allows external control",
        )
