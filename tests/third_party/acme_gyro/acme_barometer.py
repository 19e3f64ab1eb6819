"""A role of somebody else's, with one driver: `[[barometer]]`, ACME B1 tells the pressure of the air in hPa."""

from drivers.kit.config import InstrumentConfig, key
from drivers.kit.instruments import Identity, Meter
from drivers.kit.kinds import MeterKind
from drivers.kit.matching import transcript
from drivers.kit.polled import PolledInstrument
from drivers.kit.scpi import query_exchanges
from simulators.interfaces import Reply

COLUMNS = ("pressure_hpa",)


class BarometerConfig(InstrumentConfig):
    height_m: float = key(default=0.0, ge=-500, le=9000, description="height above the sea, m, -500 to 9000")


class Barometer(PolledInstrument, Meter):
    columns = COLUMNS
    prepare = make_safe = _send_stop = lambda self: None

    def __init__(self, config, connection):
        super().__init__(connection.link(config.port, config.baudrate))

    def _introduction(self):
        return Identity("ACME", "B1")

    def alarms(self):
        return []

    def read_rest(self):
        raise AssertionError("it has no safe state")

    def request_readings(self):
        self.link.write(b"P?\n")

    def read(self):
        return {"pressure_hpa": float(self.link.read_until(b"\n", 1.0))}


def decode(exchanges, config):
    rows = [
        (at_ns, {"pressure_hpa": float(reply)}) for at_ns, _, reply in query_exchanges(exchanges) if reply
    ]
    return transcript(rows, COLUMNS, len(rows))


class Emulator:
    def __init__(self, config):
        self.pressure = 1013.25 * (1.0 - config.height_m / 44330.0) ** 5.255

    def receive(self, data, now_s):
        return [Reply(now_s + 0.01, b"%.2f\n" % self.pressure)] if b"P?" in data else []


def emulator(config, plant, installed):
    return Emulator(config)


AcmeB1 = MeterKind(Barometer, decode, BarometerConfig)
