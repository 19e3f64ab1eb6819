"""Emulated Sensonor STIM300: free-running datagrams, Service Mode with the settings that a bench uses.

Source: Sensonor TS1524 rev. 31, sections 7.5, 8.7 and 9. Of Normal Mode it knows SERVICEMODE; of Service Mode i,
m, d, u, s and x. Its listing has the lines of figure 8-1 that these are about. The datagrams after power-on and
the start-up bit are left out.
"""

from __future__ import annotations

from collections.abc import Mapping

from drivers.stim300 import Stim300Config, family
from drivers.stim300.commands import DATAGRAMS, OUTPUTS, RATES, bits_per_s, datagram_words
from simulators.emulators.frames import FrameEmulator
from simulators.faults import DeviceFault, Fault, WireShape
from simulators.interfaces import GyroPlant, Installation, Reply, StreamBlock

_BITS = 10  # A byte on a line set to 8N1.
_REPLY_DELAY_S = 1e-3
_LINE_LIMIT = 80
_HOLD_S = 3.0
_UNKNOWN = "E001 UNKNOWN COMMAND"
_COUNT = "E002 INCORRECT NUMBER OF PARAMETERS"
_INVALID = "E003 INVALID PARAMETER"
_TOO_LONG = "E007 DATAGRAM WILL BE TOO LONG TO TRANSMIT"
_NOT_SAVED = "CURRENT SYSTEM PARAMETERS DO NOT MATCH FLASH CONTENT. CONFIRM EXIT"
_DELAYED = {"8": "0", "9": "1", "a": "2", "b": "3"}
"""Parameter of `u g` for an output with delay -> that without."""
_GS = {"3": "4"}
"""Integrated velocity in g s -> in m/s."""
_UNITS = {"rate": "\xb0/s", "angle": "\xb0", "velocity": "m/s", "acceleration": "g"}
_AS_DELIVERED = {"m": "0", "d": "0", "u g": "0", "u a": "0", "u i": "0"}


class Stim300Emulator:
    """One unit on its port (`simulators.interfaces.StreamingEmulator`).

    The sensor clock is fast by `clock_error_ppm`: sample k of a stream begun at t0 is complete at
    t0 + (k + 1) / rate / (1 + clock_error_ppm * 1e-6), and its datagram is out one transmission time later. It is
    switched on at time 0 with `settings` in its flash, default as delivered: 125 Hz, rates only. `ordered`:
    settings of the description that no command changes.
    """

    def __init__(
        self,
        plant: GyroPlant,
        *,
        serial_number: str,
        axes: str,
        baudrate: int,
        clock_error_ppm: float = 0.0,
        settings: Mapping[str, str] | None = None,
        ordered: Mapping[str, str] | None = None,
        pulse_interval_s: float = 1.0,
    ) -> None:
        """Raise ConfigurationError for axes that the plant does not have."""
        self._plant = plant
        self._serial_number = serial_number
        self._axes = axes
        self._baudrate = baudrate
        self._clock_error_ppm = clock_error_ppm
        self._pulse_interval_s = pulse_interval_s
        self._flash = _AS_DELIVERED | dict(settings or {})
        self._ordered = {name: words for name, words in (ordered or {}).items() if name not in OUTPUTS}
        self._settings = dict(self._flash)
        self._saves = 0
        self._service = False
        self._awaiting = ""  # The command that waits for a Y.
        self._line = b""
        self._free_s = 0.0  # When the last reply is out.
        self._refusals, self._refusal = 0, ""
        self._begin(0.0)

    @property
    def settings(self) -> dict[str, str]:
        """What the unit keeps when it is switched off."""
        return dict(self._flash)

    @property
    def wire(self) -> WireShape:
        """A datagram of the format in force ends in its CRC-32."""
        return self._stream.wire

    @property
    def faults(self) -> Mapping[str, DeviceFault]:
        """`refuse`: the next `count` commands of Service Mode are answered with `text`, default E005."""
        return {"refuse": self._refuse}

    def receive(self, data: bytes, now_s: float) -> list[Reply]:
        """Take command bytes (lines end in CR) and return the replies they cause."""
        *lines, self._line = (self._line + data).split(b"\r")
        self._line = self._line[-_LINE_LIMIT:]
        replies: list[Reply] = []
        for line in lines:
            if self._service:
                replies += self._command(line.decode("latin-1"), now_s)
            elif line.endswith(b"SERVICEMODE"):
                replies += self._enter(now_s)
        return replies

    def stream(self, until_s: float) -> StreamBlock | None:
        """Return the datagrams whose last byte is out by `until_s`; None if there are none."""
        return None if self._service else self._stream.stream(until_s)

    def _begin(self, at_s: float) -> None:
        """Normal Mode from `at_s` on, as the settings say."""
        self._service = False
        self._stream = FrameEmulator(
            self._plant,
            family(self._ordered | self._outputs()),
            axes=self._axes,
            rate_hz=self._rate_hz(),
            baudrate=self._baudrate,
            message=self._message(),
            clock_error_ppm=self._clock_error_ppm,
            start_s=at_s,
            pulse_interval_s=self._pulse_interval_s,
        )

    def _enter(self, now_s: float) -> list[Reply]:
        """Finish the datagram that is on its way, then list what the unit is."""
        tail = self._stream.stream(now_s + self._stream.send_s)
        self._service = True
        replies = []
        if tail is not None:
            self._free_s = int(tail.marks[-1, 1]) * 1e-9
            replies.append(Reply(self._free_s, tail.data))
        return [*replies, self._reply(self._listing() + "\r\r>", now_s)]

    def _command(self, line: str, now_s: float) -> list[Reply]:
        if self._awaiting:
            return self._confirmed(line, now_s)
        name, _, rest = line.partition(" ")
        values = rest.split(",") if rest else []
        if self._refusals and line:
            self._refusals -= 1
            return [self._answered(line, self._refusal, now_s)]
        if name == "x" and values in (["N"], ["n"]):
            changed = self._settings != self._flash
            if values == ["n"] and changed:
                return [self._question(line, _NOT_SAVED, now_s)]
            return [self._exit(line + "\r", _HOLD_S if values == ["n"] else 0.0, now_s)]
        if line == "s":
            return [
                self._question(line, "SYSTEM PARAMETERS WILL BE PERMANENTLY CHANGED. CONFIRM SAVE", now_s)
            ]
        return [self._answered(line, self._answer(name, values) if line else "", now_s)]

    def _answer(self, name: str, values: list[str]) -> str:
        listed: dict[str, dict[str, str]] = {
            "m": {code: str(rate) for rate, code in RATES.items()},
            "d": {code: message for message, code in DATAGRAMS.items()},
        }
        if name == "i" and len(values) < 2:
            return self._told().get(values[0], _INVALID) if values else self._listing()
        counts = {"m": 1, "d": 2, "u": 2}
        if name not in counts:
            return _UNKNOWN
        if len(values) != counts[name]:
            return _COUNT
        if name == "u":
            if f"u {values[0]}" not in self._settings:
                return _INVALID
            was, self._settings[f"u {values[0]}"] = self._settings[f"u {values[0]}"], values[1]
            if len(self._outputs()) < len(OUTPUTS):
                self._settings[f"u {values[0]}"] = was
                return _INVALID
            return self._told()[f"u {values[0]}"]
        if values[0] not in listed[name] or (name == "d" and values[1] != "0"):
            return _INVALID
        before = dict(self._settings)
        self._settings[name] = values[0]
        length = family().form(self._message()).shortest
        if bits_per_s(length, self._rate_hz()) > self._baudrate:
            self._settings = before
            return _TOO_LONG
        return self._told()[name]

    def _confirmed(self, line: str, now_s: float) -> list[Reply]:
        asked, self._awaiting = self._awaiting, ""
        if asked != "s":
            return [
                self._exit(line + "\r", _HOLD_S, now_s) if line == "Y" else self._answered(line, "", now_s)
            ]
        if line != "Y":
            return [self._answered(line, "SAVE COMMAND ABORTED.", now_s)]
        self._flash = dict(self._settings)
        self._saves += 1
        text = f"SYSTEM PARAMETERS SUCCESSFULLY STORED IN FLASH.\rNUMBER OF SAVES = {self._saves}"
        return [self._answered(line, text, now_s)]

    def _question(self, line: str, text: str, now_s: float) -> Reply:
        self._awaiting = line
        return self._reply(f"{line}\r{text}(Y/N): ", now_s)

    def _exit(self, echo: str, hold_s: float, now_s: float) -> Reply:
        reply = self._reply(f"{echo}SYSTEM RETURNING TO NORMAL MODE.\r", now_s)
        self._begin(self._free_s + hold_s)
        return reply

    def _answered(self, line: str, answer: str, now_s: float) -> Reply:
        return self._reply(f"{line}\r{answer}{chr(13) if answer else ''}\r>", now_s)

    def _reply(self, text: str, now_s: float) -> Reply:
        data = text.encode("latin-1")
        self._free_s = max(now_s + _REPLY_DELAY_S, self._free_s) + len(data) * _BITS / self._baudrate
        return Reply(self._free_s, data)

    def _refuse(self, fault: Fault, now_s: float) -> None:
        self._refusals, self._refusal = fault.count, fault.text or "E005 ERROR DURING SAVE"

    def _rate_hz(self) -> int:
        return next(rate for rate, code in RATES.items() if code == self._settings["m"])

    def _message(self) -> str:
        return next(message for message, code in DATAGRAMS.items() if code == self._settings["d"])

    def _outputs(self) -> dict[str, str]:
        """Return what is set, by setting of the description; a code that there is not is left out."""
        found: dict[str, str] = {}
        for name, (sensor, _, units) in OUTPUTS.items():
            code = self._settings[f"u {sensor}"]
            code = _DELAYED.get(code, code) if sensor == "g" else _GS.get(code, code)
            for words, (known, _) in units.items():
                if known == code:
                    found[name] = words
        return found

    def _told(self) -> dict[str, str]:
        outputs = {}
        for name, choice in self._outputs().items():
            sensor, title, units = OUTPUTS[name]
            unit = _UNITS[choice.rpartition("_")[2]] + ("/sample" if choice.startswith("incremental") else "")
            late = " DELAYED" if sensor == "g" and self._settings["u g"] in _DELAYED else ""
            outputs[f"u {sensor}"] = f"{title} OUTPUT UNIT = [{unit}] - {units[choice][1]}{late}"
        return {
            "s": f"SERIAL NUMBER = {self._serial_number}",
            "n": "PRODUCT = STIM300",
            "x": "PART NUMBER = 84167-4400003-321 REV K",
            "p": "FW CONFIG = SWD12404 REV 0",
            **outputs,
            "m": f"SAMPLE RATE [samples/s] = {self._rate_hz()}",
            "d": f"DATAGRAM = {datagram_words(self._message())}\rDATAGRAM TERMINATION = NONE",
            "t": f"BIT-RATE [bits/s] = {self._baudrate}\rDATA LENGTH = 8\rSTOP BITS = 1\rPARITY = NONE",
        }

    def _listing(self) -> str:
        return "\r".join(self._told().values())


def emulator(config: Stim300Config, plant: GyroPlant, installed: Installation) -> Stim300Emulator:
    """Make the emulator of a bench file's gyro, with what it had saved before it was switched off."""
    before = installed.before
    return Stim300Emulator(
        plant,
        serial_number=config.unit,
        axes=config.axes,
        baudrate=config.baudrate,
        clock_error_ppm=installed.clock_error_ppm,
        settings=before.settings if isinstance(before, Stim300Emulator) else None,
        ordered=config.settings,
        pulse_interval_s=config.pulse_interval_s,
    )
