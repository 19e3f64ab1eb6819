"""Driver of a platform INS on the line that `_codec` defines."""

from __future__ import annotations

from drivers.base.errors import DeviceRefused, DeviceSilent, WrongDevice
from drivers.kit.config import PlatformConfig, key
from drivers.kit.conversation import StreamingGyro
from drivers.kit.instruments import Identity
from drivers.kit.kinds import Connection
from drivers.platform.codec import LONGEST, parse, sentence

_REPLY_S = 2.0
BAUDRATE = 38400


class PinsConfig(PlatformConfig):
    """`[[platform]]` with `driver = "platform_ins"`."""

    accelerometers: bool = key(
        default=False,
        description="whether the unit sends its three accelerometers beside position and temperature",
    )


class PlatformIns(StreamingGyro):
    """A platform INS that streams position and temperatures every `period_s` whole seconds, 1 .. 60."""

    def __init__(self, config: PinsConfig, connection: Connection) -> None:
        super().__init__(connection.link(config.port, config.baudrate))
        self.period_s, self._accelerometers = config.period_s, config.accelerometers

    def identify(self) -> Identity:
        """Stop the stream and ask who it is; DeviceSilent, WrongDevice or DeviceRefused."""
        self._ask("STOP")
        maker, model, serial_number, firmware = (self._ask("ID") + [""] * 4)[:4]
        if not serial_number:
            raise WrongDevice(
                "the serial number is empty",
                where=self.link.where,
                found="$PINSA,ID without a serial number",
                expected="maker, model, serial number, firmware",
                remedy="check that the bench file names the right port",
            )
        return Identity(maker, model, serial_number, firmware)

    def start(self) -> None:
        """Set the period, ask for the accelerometers if the bench file has them, and start the stream."""
        self._ask("PERIOD", str(self.period_s))
        if self._accelerometers:
            self._ask("FORCE", "1")
        self._ask("START")
        super().start()

    def navigate(self) -> None:
        """End the alignment: the position runs free from here on.

        While streaming the answer goes into the stream, where the decoder passes it over, and the status bit
        says that it was done.
        """
        if self.link.streaming:
            self.link.write(sentence("PINSQ", "NAVIGATE"))
        else:
            self._ask("NAVIGATE")

    def stop(self) -> None:
        """Stop the stream."""
        self._ask("STOP")

    def _ask(self, *command: str) -> list[str]:
        """Send a command; return the fields after the echo of its name."""
        self.link.streaming = False
        self.link.discard()
        self.link.write(sentence("PINSQ", *command))
        deadline_s = self.link.clock.now() + _REPLY_S
        heard = b""
        while (remaining_s := deadline_s - self.link.clock.now()) > 0.0:
            heard = (heard + self.link.read_some(remaining_s))[-4 * LONGEST :]
            for line in heard.split(b"\n")[:-1]:
                fields = parse(line[max(0, line.rfind(b"$")) :].rstrip(b"\r"))
                if fields is not None and fields[0] == "PINSE":
                    raise self._refused(command, fields[1:])
                if fields is not None and fields[:2] == ["PINSA", command[0]]:
                    return fields[2:]
        raise self._unanswered(command, heard)

    def _refused(self, command: tuple[str, ...], reason: list[str]) -> DeviceRefused:
        return DeviceRefused(
            f"the platform INS refused {','.join(command)}",
            where=self.link.where,
            found=",".join(reason) or "no reason",
            expected="$PINSA," + command[0],
            remedy="take `accelerometers` out of the bench file if the unit has none"
            if command[0] == "FORCE"
            else "check the unit's state and the period asked for",
        )

    def _unanswered(self, command: tuple[str, ...], heard: bytes) -> DeviceSilent | WrongDevice:
        asked = f"no answer to {','.join(command)} within {_REPLY_S:g} s"
        if not heard or b"$PINS" in heard:
            return DeviceSilent(
                asked,
                where=self.link.where,
                found="position sentences only" if heard else "nothing on the line",
                expected="a platform INS",
                remedy="check power, cable and the line from the bench to the unit",
            )
        return WrongDevice(
            f"something talks on the port, but {asked}",
            where=self.link.where,
            found=repr(heard[-60:]),
            expected="sentences that begin with $PINS",
            remedy=f"check the port in the bench file{self.link.set_alike}",
        )
