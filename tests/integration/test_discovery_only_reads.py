"""What `ports --identify` writes sets nothing, whatever device is behind the port: all kinds ask on every one."""

from types import SimpleNamespace

import pytest

from bench.control.discovery import identify_port
from bench.lab.emulated import Plant, lab_config
from bench.record.benchfile import load_bench_file
from drivers.base.virtual_clock import VirtualClock
from simulators.lab import _build
from simulators.plant.table import TableAxis, TableParameters
from tests.memory_link import ChamberPlant

HEAD = '[bench]\nname = "b"\nlatitude_deg = 39.1\n[table]\n{table}\n[chamber]\n{chamber}\n'
GYRO = '[[gyro]]\nname = "g"\ndriver = "kvh1750"\nport = "/dev/ttyG"\nrate_hz = 10\naxis = "x"\nunit = "G"\n'
BENCHES = [
    ('driver = "acutrol3000"\nport = "/dev/ttyT"', 'driver = "weiss"\nport = "socket://10.0.0.1:2049"'),
    ('driver = "acutrol3000"\nport = "socket://10.0.0.2:1"', 'driver = "espec_p300"\nport = "/dev/ttyC"'),
    ('driver = "ideal_atl"\nport = "/dev/ttyT"', 'driver = "espec_scp220"\nport = "/dev/ttyC"'),
    (
        'driver = "ideal_atl"\nport = "/dev/ttyT"',
        'driver = "watlow_f4"\nport = "/dev/ttyC"\nbaudrate = 19200',
    ),
    ('driver = "ideal_atl"\nport = "/dev/ttyT"', 'driver = "cts"\nport = "/dev/ttyC"'),
    ('driver = "acutrol3000"\nport = "/dev/ttyT"', 'driver = "cts"\nport = "socket://10.0.0.1:1080"'),
    (
        'driver = "ideal_atl"\nport = "/dev/ttyT"',
        'driver = "thermotron_8200"\nport = "socket://10.0.0.1:8888"\ncontroller = "8800"',
    ),
    ('driver = "acutrol3000"\nport = "/dev/ttyT"', 'driver = "thermotron_8200"\nport = "/dev/ttyC"'),
    ('driver = "ideal_atl"\nport = "/dev/ttyT"', 'driver = "watlow_f4t"\nport = "socket://10.0.0.1:502"'),
    ('driver = "ideal_atl"\nport = "/dev/ttyT"', 'driver = "watlow_f4t"\nport = "/dev/ttyC"'),
]


class Spy(TableAxis):
    """An axis that notes what it is told."""

    def __init__(self):
        super().__init__(TableParameters())
        self.told = []

    def servo(self, now_s, on):
        self.told.append("servo")

    def demand_rate(self, *arguments):
        self.told.append("rate")

    def demand_angle(self, *arguments):
        self.told.append("angle")

    def demand_turn(self, *arguments):
        self.told.append("turn")


@pytest.mark.parametrize(("table", "chamber"), BENCHES, ids=[str(n) for n in range(len(BENCHES))])
def test_what_is_written_sets_nothing(bench, tmp_path, table, chamber):
    path = tmp_path / "lab.toml"
    path.write_text(HEAD.format(table=table, chamber=chamber) + GYRO)
    file = load_bench_file(path)
    heard = {"table": [], "chamber": []}

    def listening(name):
        def swap(emulator, lab, index):
            def receive(data, now_s):
                heard[name].append((now_s, data))
                return emulator.receive(data, now_s)

            return SimpleNamespace(receive=receive)

        return swap

    with bench.lab(file, Plant(delivery_s=0.5), {name: listening(name) for name in heard}) as lab:
        clock = VirtualClock(lab.file.bench.clock)
        ports = {"table": lab.file.table.port, "chamber": lab.file.chamber.port}
        found = {name: identify_port(port, clock, lambda text: None, name) for name, port in ports.items()}
        clock.close()
    assert found["table"].driver == file.table.driver, found
    assert found["chamber"].driver == file.chamber.driver, found
    config = lab_config(file, Plant())
    spy, air = Spy(), ChamberPlant()
    devices = {
        "table": _build._emulator("table", config.table.driver, config.table, {"table": spy}),
        "chamber": _build._emulator("chamber", config.chamber.driver, config.chamber, air),
    }
    spy.told.clear()
    air.demands.clear()
    for name, device in devices.items():
        assert heard[name]
        for now_s, data in heard[name]:
            device.receive(data, now_s)
    assert spy.told == [] and air.demands == []
    devices["chamber"].receive(b"MODE,CONSTANT\r\n", 1e6)  # the spies do see what sets something
    assert bool(air.demands) is ("espec" in chamber)
