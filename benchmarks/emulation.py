"""How fast emulated time goes: `python -m benchmarks emulation`.

Ours is the run of `end_to_end`: a gyro at 100 Hz over a pty, table and chamber, recorded and decoded. tickit is
asked for a device that wakes 100 times a second at a million times real time, without bytes, chamber or record.
lewis is asked over TCP for a value as fast as it answers, an answer standing for a second of bench time, as the
bench polls; and, alone, for cycles of 10 ms without a pause, no bytes.
"""

from __future__ import annotations

import asyncio
import socket
import threading
from collections.abc import Callable, Iterator
from importlib.metadata import version

from benchmarks._measure import Row, figure, usual
from benchmarks.end_to_end import RATE_HZ, run_once
from drivers.base.clock import WallClock, host_seconds

_TICKS = 2000
_CYCLES = 20_000
_POLLS = 200


def rows() -> Iterator[Row]:
    """Yield a row a peer that is installed."""
    ours = max(run_once().speed for _ in range(usual(2, 1)))
    title = f"emulated time, chamber, table and a gyro at {RATE_HZ} Hz"
    peers: tuple[tuple[str, str, Callable[[], float]], ...] = (
        ("tickit", f"a device alone at {RATE_HZ} Hz, asked for 1,000,000 x", tickit_speed),
        ("lewis", "a device alone, polled once a second over TCP", lewis_polled),
        ("lewis", f"a device alone at {RATE_HZ} Hz, no bytes", lewis_alone),
    )
    for name, what, speed in peers:
        try:
            peer = speed()
        except ImportError as missing:
            print(f"skipped: {name}: {missing}")
            continue
        yield figure(title, ours, peer, f"{name} {version(name)}, {what}", "x real time")


def tickit_speed() -> float:
    """Return emulated seconds a second of a device of 100 Hz under tickit's scheduler."""
    from tickit.core.components.device_component import DeviceComponent
    from tickit.core.device import Device, DeviceUpdate
    from tickit.core.management.event_router import InverseWiring
    from tickit.core.management.schedulers.master import MasterScheduler
    from tickit.core.simulation import TickitSimulation
    from tickit.core.state_interfaces.state_interface import get_interface
    from tickit.core.typedefs import ComponentID, SimTime

    marks: list[float] = []
    done = asyncio.Event()

    class Gyro(Device):  # type: ignore[misc]  # tickit has no types
        def update(self, time: int, inputs: object) -> object:
            marks.append(host_seconds())
            if len(marks) > _TICKS:
                done.set()
            return DeviceUpdate({}, SimTime(time + 1_000_000_000 // RATE_HZ))

    name = ComponentID("gyro")
    consumer, producer = get_interface("internal")
    scheduler = MasterScheduler(InverseWiring({name: {}}), consumer, producer, simulation_speed=1e6)

    async def run() -> None:
        simulation = TickitSimulation(
            "internal", scheduler, {name: DeviceComponent(name=name, device=Gyro())}
        )
        task = asyncio.create_task(simulation.run())
        await done.wait()
        task.cancel()

    asyncio.run(run())
    return (len(marks) - 1) / RATE_HZ / (marks[-1] - marks[0])


def lewis_polled() -> float:
    """Return the questions a second that lewis answers over TCP: seconds of a device asked once in each."""
    from lewis.adapters.stream import StreamAdapter, StreamInterface, Var
    from lewis.core.simulation import Simulation
    from lewis.devices import Device

    class Chamber(Device):  # type: ignore[misc]  # lewis has no types
        temp_c = 25.0

    class Interface(StreamInterface):  # type: ignore[misc]
        commands = (Var("temp_c", read_pattern="T$"),)
        in_terminator = out_terminator = "\r"

    with socket.create_server(("127.0.0.1", 0)) as free:
        port = free.getsockname()[1]
    adapter = StreamAdapter({"bind_address": "127.0.0.1", "port": port})
    device, interface = Chamber(), Interface()
    interface.device, adapter.interface = device, interface
    simulation = Simulation(device, [adapter])
    thread = threading.Thread(target=simulation.start, daemon=True)
    thread.start()
    try:
        with _connected(port) as link, link.makefile("rb") as answers:
            marks = []
            for _ in range(_POLLS):
                link.sendall(b"T\r")
                if answers.read(5) != b"25.0\r":
                    raise AssertionError("lewis answered something else")
                marks.append(host_seconds())
    finally:
        simulation.stop()
        thread.join()
        simulation._adapters.disconnect()  # noqa: SLF001  # `stop` leaves its threads running
    return (len(marks) - 1) / (marks[-1] - marks[0])


def _connected(port: int) -> socket.socket:
    """Connect as soon as lewis listens: its thread says so nowhere."""
    clock = WallClock()
    try:
        while True:
            try:
                return socket.create_connection(("127.0.0.1", port), timeout=10.0)
            except ConnectionRefusedError:
                if clock.now() > 10.0:
                    raise
                clock.sleep(0.02)
    finally:
        clock.close()


def lewis_alone() -> float:
    """Return the cycles of 10 ms that lewis does in a second with a device that does nothing, in seconds."""
    from lewis.core.simulation import Simulation
    from lewis.devices import Device

    marks: list[float] = []

    class Gyro(Device):  # type: ignore[misc]  # lewis has no types
        def process(self, dt: float = 0.0) -> None:
            marks.append(host_seconds())
            if len(marks) > _CYCLES:
                simulation.stop()

    simulation = Simulation(Gyro())
    simulation.cycle_delay = 0.0
    simulation.start()
    return (len(marks) - 1) / RATE_HZ / (marks[-1] - marks[0])


if __name__ == "__main__":
    from benchmarks.__main__ import show

    show(rows())
