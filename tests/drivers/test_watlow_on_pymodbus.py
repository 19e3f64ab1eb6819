"""The Watlow F4 driver on pymodbus' own simulator: a Modbus server that shares nothing with our emulator."""

import asyncio

import pytest
from pymodbus.framer import FramerRTU
from pymodbus.pdu import DecodePDU
from pymodbus.simulator import DataType, SimData, SimDevice
from pymodbus.simulator.simcore import SimCore

from drivers.base.errors import DeviceRefused
from drivers.watlow._driver import F4Chamber, F4Config
from tests.memory_link import MemoryLink, OpenConnection


class Server:
    """Registers 0 to 1299, and the answers of pymodbus to frames of Modbus RTU; there is no register beyond."""

    def __init__(self, registers: dict[int, int]) -> None:
        values = [registers.get(number, 0) for number in range(1300)]
        self._core = SimCore(SimDevice(1, simdata=[SimData(0, values=values, datatype=DataType.REGISTERS)]))
        self._framer = FramerRTU(DecodePDU(True))

    def answer(self, data: bytes, now_s: float) -> list[tuple[float, bytes]]:
        _, asked = self._framer.handleFrame(data, 0, 0)
        assert asked is not None, f"pymodbus takes {data.hex(' ')} for no request"
        answer = asyncio.run(asked.datastore_update(self._core, 1))
        return [(now_s + 0.02, self._framer.buildFrame(answer))]

    def register(self, number: int) -> int:
        (value,) = asyncio.run(self._core.async_getValues(1, 3, number, 1))
        return int(value)


def chamber(start_channel: int) -> tuple[F4Chamber, Server]:
    places = dict.fromkeys((606, 616, 626), 1)
    server = Server({100: 0x10000 - 553, 300: 250, 602: 0x10000 - 730, 603: 1900, 901: 1, **places})
    config = F4Config(driver="watlow_f4", port="memory", start_channel=start_channel)
    return F4Chamber(config, OpenConnection(MemoryLink(server.answer))), server


def test_an_f4_of_registers_is_read_and_told_a_ramp():
    device, server = chamber(1)
    assert device.identify().maker == "Watlow"
    limits = device.limits()
    assert (limits.min_temp_c, limits.max_temp_c) == (-73.0, 190.0)
    device.request_state()
    state = device.read_state()
    assert (state.air_temp_c, state.set_point_c) == (-55.3, 25.0)
    device.set_temperature(-40.0, 2.5)
    told = {number: server.register(number) for number in (300, 1100, 1101, 1102)}
    assert told == {300: 0x10000 - 400, 1100: 2, 1101: 25, 1102: 0}


def test_a_register_that_is_not_there_is_refused_in_the_drivers_words():
    device, _ = chamber(1)
    device.identify()
    with pytest.raises(DeviceRefused, match="2000"):
        device.start()
