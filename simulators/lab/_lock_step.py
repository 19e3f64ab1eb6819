"""A lab moved by a bench's requests, one after the other."""

from __future__ import annotations

import select
from typing import Any

from drivers.base.lab_time import NOT_OPEN, Greeting, MakeRoom, Reply, Request
from simulators.lab._core import Lab


class LockStep:
    """Moves a lab as a bench asks (`drivers.base.lab_time.LabTime`)."""

    def __init__(self, lab: Lab, cpu: int | None, emulated: dict[str, Any] | None) -> None:
        self._lab = lab
        self._cpu = cpu
        self._emulated = emulated

    @property
    def greeting(self) -> Greeting:
        """What the lab says of itself now."""
        names = tuple(port.name for port in self._lab.ports)
        return Greeting(names, self._lab.now_ns, self._cpu, self._emulated)

    def step(self, request: Request, make_room: MakeRoom) -> Reply:
        """Take what the bench wrote, move time, write what the devices sent; BenchError if a device cannot."""
        at_ns, to_ns, stop_port, sent = request
        lab = self._lab
        gone = lab.settle()
        for port in lab.ports:
            port.make_room = make_room
        marks = []
        while lab.now_ns < at_ns:
            marks += lab.advance(at_ns)
        for index, (port, count) in enumerate(zip(lab.ports, sent, strict=True)):
            if index in gone:
                continue
            if count == NOT_OPEN:
                if port.is_open:
                    port.shut()
                continue
            if not port.is_open:
                lab.open(index)
            while port.received < count and port.fileno() >= 0:
                data = port.read()
                if data:
                    lab.take_input(index, data)
                elif not port.is_open:
                    break
                else:  # written, but not yet through the kernel
                    select.select([port], [], [])
        # a bench that holds a port which is gone is told before anything else happens
        if not any(sent[index] != NOT_OPEN for index in gone):
            marks += lab.advance(to_ns, stop_port)
        written = [NOT_OPEN if index in gone else port.written for index, port in enumerate(lab.ports)]
        return lab.now_ns, written, marks

    def leave(self) -> None:
        """Shut the ports: the bench that had them is gone."""
        for port in self._lab.ports:
            port.shut()
