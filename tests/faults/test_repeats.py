"""One damaged, cut, lost or late answer costs a repeat, not the run; what stays dead is known within seconds."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from typing import Any

import pytest

from drivers.acutrol._driver import AcutrolTable
from drivers.base.errors import BenchError, DeviceRefused, DeviceSilent, ProtocolError
from drivers.cts import Cts, CtsConfig
from drivers.espec import EspecConfig, EspecP300
from drivers.ideal_atl._driver import AtlConfig, AtlTable
from drivers.kit.config import TableConfig
from drivers.kit.instruments import Chamber
from drivers.kit.modbus import ModbusMaster
from drivers.thermotron import Thermotron8200, ThermotronConfig
from drivers.watlow import F4Config, F4TConfig, WatlowF4, WatlowF4T
from drivers.weiss import Weiss, WeissConfig
from simulators.emulators.acutrol import AcutrolEmulator
from simulators.emulators.cts import CtsEmulator
from simulators.emulators.espec import EspecEmulator
from simulators.emulators.ideal_atl import AtlEmulator
from simulators.emulators.thermotron import ThermotronEmulator
from simulators.emulators.watlow import F4Emulator, F4TEmulator
from simulators.emulators.weiss import WeissEmulator
from simulators.plant.table import TableAxis, TableParameters
from tests.memory_link import ChamberPlant, MemoryLink, OpenConnection, scripted

Damage = Callable[[float, bytes], list[tuple[float, bytes]]]
"""(time in s, reply) -> what comes of it."""

DAMAGES: dict[str, Damage] = {
    "lost": lambda at_s, data: [],
    "cut": lambda at_s, data: [(at_s, data[: len(data) // 2])],
    "last byte lost": lambda at_s, data: [(at_s, data[:-1])],
    "high bit flipped": lambda at_s, data: [(at_s, bytes([data[0] ^ 0x80]) + data[1:])],
    "noise before": lambda at_s, data: [(at_s, b"\x9c\x81" + data)],
    "twice": lambda at_s, data: [(at_s, data + data)],
    "late by 1.3 s": lambda at_s, data: [(at_s + 1.3, data)],
    "late by 2.4 s": lambda at_s, data: [(at_s + 2.4, data)],
    "late by 3.4 s": lambda at_s, data: [(at_s + 3.4, data)],
}


def weiss(link: MemoryLink, simserv: bool = True) -> Chamber:
    config = WeissConfig(driver="weiss", port="memory", auxiliary={2: ""}, simserv=simserv)
    return Weiss.open(config, OpenConnection(link))


def ascii2(link: MemoryLink) -> Chamber:
    return weiss(link, simserv=False)


def p300(link: MemoryLink) -> Chamber:
    return EspecP300.open(EspecConfig(driver="espec_p300", port="memory"), OpenConnection(link))


def f4(link: MemoryLink) -> Chamber:
    config = F4Config(driver="watlow_f4", port="memory", auxiliary={2: ""})
    return WatlowF4.open(config, OpenConnection(link))


def f4t(link: MemoryLink) -> Chamber:
    return WatlowF4T.open(F4TConfig(driver="watlow_f4t", port="socket://memory"), OpenConnection(link))


def thermotron(link: MemoryLink, controller: Any = "8800") -> Chamber:
    sensors = {} if controller == "3800" else {2: ""}
    keys: Any = {
        "driver": "thermotron_8200",
        "port": "memory",
        "controller": controller,
        "auxiliary": sensors,
    }
    return Thermotron8200.open(ThermotronConfig(**keys), OpenConnection(link))


def cts(link: MemoryLink, framed: bool = True) -> Chamber:
    config = CtsConfig(driver="cts", port="memory", auxiliary={2: ""}, framed=framed)
    return Cts.open(config, OpenConnection(link))


def acutrol(link: MemoryLink) -> AcutrolTable:
    return AcutrolTable(TableConfig(driver="acutrol3000", port="memory"), OpenConnection(link))


def atl(link: MemoryLink) -> AtlTable:
    return AtlTable(AtlConfig(driver="ideal_atl", port="memory"), OpenConnection(link))


CHAMBERS: dict[str, tuple[Callable[[ChamberPlant], Any], Callable[[MemoryLink], Any]]] = {
    "weiss": (lambda plant: WeissEmulator(plant, auxiliary=(2,)), weiss),
    "weiss ascii-2": (lambda plant: WeissEmulator(plant, auxiliary=(2,)), ascii2),
    "cts": (CtsEmulator, cts),
    "cts bare": (lambda plant: CtsEmulator(plant, framed=False), lambda link: cts(link, framed=False)),
    "espec": (EspecEmulator, p300),
    "thermotron 8800": (ThermotronEmulator, thermotron),
    "thermotron 8200": (
        lambda plant: ThermotronEmulator(plant, controller="8200"),
        lambda link: thermotron(link, "8200"),
    ),
    "thermotron 3800": (
        lambda plant: ThermotronEmulator(plant, controller="3800"),
        lambda link: thermotron(link, "3800"),
    ),
    "watlow f4": (F4Emulator, f4),
    "watlow f4t": (lambda plant: F4TEmulator(plant, framing="tcp"), f4t),
}
NO_SENSORS = ("espec", "thermotron 3800", "watlow f4t")
NO_RAMP = ("thermotron 3800",)
TABLES: dict[str, tuple[Callable[[Any], Any], Callable[[MemoryLink], Any]]] = {
    "acutrol": (AcutrolEmulator, acutrol),
    "atl": (AtlEmulator, atl),
}


def damaged(kinds: Iterable[str]) -> list[Any]:
    """Return (kind, damage) of all; a Modbus answer 3.4 s late is no late one, it is none."""
    return [
        pytest.param(kind, damage, id=f"{kind}-{name}")
        for kind in kinds
        for name, damage in DAMAGES.items()
        if not (kind.startswith("watlow") and "3.4" in name)
    ]


class Damaged:
    """A device whose `at`-th reply, counted from when `armed`, meets some damage; if it `lasts`, all after it."""

    def __init__(self, device: Any, damage: Damage, *, at: int = 0, lasts: bool = False) -> None:
        self.device, self.damage, self.left, self.lasts = device, damage, at, lasts
        self.armed = self.struck = False
        self._late_s = 0.0

    def __call__(self, data: bytes, now_s: float) -> list[tuple[float, bytes]]:
        found: list[tuple[float, bytes]] = []
        for reply in self.device.receive(data, now_s):
            strike = self.armed and (self.left == 0 or (self.left < 0 and self.lasts))
            self.left -= self.armed
            self.struck |= strike
            at_s = max(reply.at_s, self._late_s)  # nothing overtakes
            found += self.damage(at_s, reply.data) if strike else [(at_s, reply.data)]
            self._late_s = max([self._late_s, *(at_s for at_s, _ in found)])
        return found


def chamber_with(kind: str, damage: Damage, **options: Any) -> tuple[Any, ChamberPlant, Damaged, list[str]]:
    make, driver = CHAMBERS[kind]
    plant = ChamberPlant()
    device = Damaged(make(plant), damage, **options)
    link = MemoryLink(device)
    told: list[str] = []
    link.on_retry = lambda error: told.append(str(error))
    chamber = driver(link)
    chamber.identify()
    device.armed = True
    return chamber, plant, device, told


def table_with(kind: str, damage: Damage, **options: Any) -> tuple[Any, TableAxis, Damaged, list[str]]:
    make, driver = TABLES[kind]
    plant = TableAxis(TableParameters())
    device = Damaged(make(plant), damage, **options)
    link = MemoryLink(device)
    told: list[str] = []
    link.on_retry = lambda error: told.append(str(error))
    table = driver(link)
    table.servo_on()
    device.armed = True
    return table, plant, device, told


@pytest.mark.parametrize("at", range(3))
@pytest.mark.parametrize(("kind", "damage"), damaged(CHAMBERS))
def test_a_poll_of_a_chamber_is_asked_again(kind: str, damage: Damage, at: int) -> None:
    chamber, plant, device, told = chamber_with(kind, damage, at=at)
    plant.air = -41.3
    sensors = {2: pytest.approx(20.1234, abs=0.06)} if kind not in NO_SENSORS else {}
    for _ in range(4):
        state = chamber.state()
        assert state.air_temp_c == pytest.approx(-41.3, abs=0.06)
        assert state.set_point_c == 23.0
        assert state.auxiliary_c == sensors
    assert chamber.alarms() == []
    assert device.struck and len(told) <= 2
    if damage in (DAMAGES["lost"], DAMAGES["cut"]):
        assert len(told) == 1  # what was received stands there
        assert ("nothing" in told[0]) is (damage is DAMAGES["lost"])


@pytest.mark.parametrize("at", range(4))
@pytest.mark.parametrize(("kind", "damage"), damaged(CHAMBERS))
def test_a_command_to_a_chamber_is_read_back(kind: str, damage: Damage, at: int) -> None:
    chamber, plant, _, _ = chamber_with(kind, damage, at=at)
    plant.air = 20.0
    chamber.set_temperature(-40.0, None if kind in NO_RAMP else 5.0)
    chamber.start()
    assert plant.demands[-1][0] == -40.0 and plant.demands[-1][3] is True
    assert chamber.state().air_temp_c == -40.0
    chamber.stop()
    assert plant.demands[-1][3] is False


@pytest.mark.parametrize("at", range(3))
@pytest.mark.parametrize(("kind", "damage"), damaged(TABLES))
def test_a_table_turns_by_what_was_demanded_and_never_twice(kind: str, damage: Damage, at: int) -> None:
    table, plant, device, _ = table_with(kind, damage, at=at)
    before_deg = plant.total_angle_deg(table.link.now())
    table.turn(30.0)
    table.link.sleep(40.0)
    assert plant.total_angle_deg(table.link.now()) - before_deg == pytest.approx(30.0, abs=1e-2)
    device.left, device.struck = at, False
    table.spin(5.0)
    table.link.sleep(20.0)
    assert table.state().rate_dps == pytest.approx(5.0, abs=1e-2)
    device.left = at
    states = [table.state() for _ in range(3)]
    assert all(state.rate_dps == pytest.approx(5.0, abs=1e-2) for state in states)
    device.left = at
    table.spin(0.0)
    table.link.sleep(20.0)
    device.left = at
    table.point(90.0)
    table.link.sleep(60.0)
    angle_deg = table.state().angle_deg
    assert math.remainder(angle_deg - 90.0, 360.0) == pytest.approx(0.0, abs=1e-2)


@pytest.mark.parametrize("kind", [*CHAMBERS, *TABLES])
def test_what_stays_dead_or_damaged_is_known_soon(kind: str) -> None:
    for damage in (DAMAGES["lost"], DAMAGES["cut"]):
        make = table_with if kind in TABLES else chamber_with
        device, _, _, told = make(kind, damage, lasts=True)
        begun_s = device.link.now()
        with pytest.raises((DeviceSilent, ProtocolError)):
            device.state()
        assert 1 <= len(told) <= 2
        assert device.link.now() - begun_s < 7.0


def test_a_refusal_of_a_command_is_final_and_of_a_question_is_not() -> None:
    """Bytes of the documents: a question that met a flipped bit is refused with CMD ERR."""
    link = scripted(b"NA:CMD ERR\r\n", b"26.4,0.0,140.0,-50.0\r\n")
    link.retries = 2
    told: list[BenchError] = []
    link.on_retry = told.append
    assert p300(link).state().air_temp_c == 26.4
    assert "CMD ERR (the command is not known)" in str(told[0])
    link = scripted(b"STANDBY\r\n", b"NA:DATA OUT OF RANGE\r\n", b"OK:TEMP,S25.0\r\n")
    link.retries = 2
    with pytest.raises(DeviceRefused, match="outside its range"):
        p300(link).set_temperature(25.0)
    assert link.sent.count(b"TEMP, S25.0") == 1


def test_the_captured_watlow_reply_with_each_bit_flipped_is_asked_again() -> None:
    good = bytes.fromhex("01 03 02 00 FA 38 07")
    for bit in range(8 * len(good)):
        bad = bytearray(good)
        bad[bit // 8] ^= 1 << bit % 8
        link = scripted(bytes(bad), good)
        link.retries = 2
        assert ModbusMaster(link, "rtu", 1).read(100, 1) == (250,)
        assert link.sent.count(bytes.fromhex("01 03 00 64 00 01 C5 D5")) == 2


def test_an_echo_that_is_not_the_command_is_not_taken_for_it() -> None:
    """25.0 reached the chamber as 35.0: it says so, and is told again."""
    kind, state = b"T,S2,160.0\r\n", b"26.4,35.0,140.0,-50.0\r\n"
    link = scripted(b"STANDBY\r\n", b"OK:TEMP,S35.0\r\n", kind, state, b"OK:TEMP,S25.0\r\n")
    link.retries = 2
    p300(link).set_temperature(25.0)
    assert link.sent.split(b"\r\n") == [b"MODE?", b"TEMP, S25.0", b"TYPE?", b"TEMP?", b"TEMP, S25.0", b""]


def test_a_late_answer_is_never_taken_for_that_to_the_next_question() -> None:
    """Rate and angle of an ATL table look alike: a late rate must not be taken for an angle."""
    answers = {b"PVE": b"5.0000\r\n>\r\n", b"PPO": b"123.4000\r\n>\r\n"}
    late_s = iter([2.5])
    free_s = 0.0

    def answer(data: bytes, now_s: float) -> list[tuple[float, bytes]]:
        nonlocal free_s
        free_s = max(free_s, now_s + next(late_s, 0.02))
        return [(free_s, answers[data.strip()])]

    link = MemoryLink(answer)
    told: list[BenchError] = []
    link.on_retry = told.append
    table = atl(link)
    for _ in range(3):
        state = table.state()
        assert (state.rate_dps, state.angle_deg) == (5.0, 123.4)
    assert len(told) == 1


class Held:
    """A device server that, from when it is `armed`, gives out each answer when the next question comes."""

    def __init__(self, device: Any) -> None:
        self.device, self.armed, self.kept = device, False, []  # type: ignore[var-annotated]

    def __call__(self, data: bytes, now_s: float) -> list[tuple[float, bytes]]:
        fresh = [reply.data for reply in self.device.receive(data, now_s)]
        if not self.armed:
            out, self.kept = self.kept + fresh, []
        else:
            out, self.kept = self.kept, fresh
        return [(now_s + 0.05 * place, answer) for place, answer in enumerate(out, 1)]


def held(kind: str) -> tuple[Any, Held, list[str]]:
    make, driver = (CHAMBERS | TABLES)[kind]
    server = Held(make(TableAxis(TableParameters()) if kind in TABLES else ChamberPlant()))
    link = MemoryLink(server)
    told: list[str] = []
    link.on_retry = lambda error: told.append(str(error))
    device = driver(link)
    device.identify()
    return device, server, told


def first_question(device: Any) -> bytes:
    """Return what a poll begins with."""
    before = len(device.link.sent)
    device.request_state()
    question = bytes(device.link.sent[before:])
    device.link.sleep(1.0)
    device.read_state()
    return question


NOT_ATL = [kind for kind in (*CHAMBERS, *TABLES) if kind != "atl"]
"""ATL's queries have numbers for answers, all alike: it cannot be asked whether it is in step."""


@pytest.mark.parametrize("kind", NOT_ATL)
def test_a_line_that_is_one_question_late_is_found_and_brought_in_step(kind: str) -> None:
    device, server, _ = held(kind)
    assert device.in_step() is True
    server.kept = [reply.data for reply in server.device.receive(first_question(device), 0.0)]
    numbered = kind == "watlow f4t"  # Modbus TCP passes over numbers that it did not ask
    assert device.in_step() is numbered
    assert device.in_step() is True
    device.state()


@pytest.mark.parametrize("kind", NOT_ATL)
def test_a_line_that_stays_one_question_late_is_no_telemetry(kind: str) -> None:
    device, server, told = held(kind)
    device.state()
    server.armed = True
    with pytest.raises((DeviceSilent, ProtocolError)):
        for _ in range(3):
            device.state()
    assert told


def test_an_acutrol_poll_is_never_answered_by_the_poll_before() -> None:
    """An answer too many is given out when the next one is due: no time-out, and the right kind of numbers."""
    table, server, told = held("acutrol")
    table.servo_on()
    table.spin(5.0)
    table.link.sleep(10.0)
    question = first_question(table)
    server.kept = [reply.data for reply in server.device.receive(question, table.link.now())]
    table.link.sleep(5.0)
    before_deg = table.state().angle_deg
    assert len(told) == 1
    table.link.sleep(5.0)
    assert math.remainder(table.state().angle_deg - before_deg - 25.0, 360.0) == pytest.approx(0.0, abs=1.0)
    assert len(told) == 1
