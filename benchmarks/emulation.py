"""How fast emulated time goes: `python -m benchmarks emulation`.

Ours is the run of `end_to_end`: a gyro at 100 Hz over a pty, table and chamber, recorded and decoded. tickit is
asked for a device that wakes 100 times a second at a million times real time, without bytes, chamber or record.
"""

from __future__ import annotations

import asyncio
from importlib.metadata import version

from benchmarks._measure import Row
from benchmarks.end_to_end import RATE_HZ, run_once
from drivers.clock import host_seconds

_TICKS = 2000


def rows() -> list[Row]:
    """Return the row; nothing where tickit is not installed."""
    try:
        peer = tickit_speed()
    except ImportError as missing:
        print(f"skipped: {missing}")
        return []
    ours = run_once().speed
    return [
        {
            "benchmark": f"emulated time, a device at {RATE_HZ} Hz",
            "ours": ours,
            "yardstick": peer,
            "yardstick_name": f"tickit {version('tickit')}, a device alone, asked for 1,000,000 x",
            "unit": "x real time",
            "ratio": ours / peer,
            "kept": False,
        }
    ]


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


if __name__ == "__main__":
    from benchmarks.__main__ import show

    show(rows())
