"""The lab's process: configuration on the first line of standard input, ports and clock URL (or why there is
no such lab) on the first of standard output, then the control channel until standard input ends.

With `--prefork N` it forks such labs instead: every message on the Unix socket that is descriptor N carries a new
lab's standard input and output, and is answered with its process id (int32, big-endian). A configuration on its
own standard input says what these labs will be like, so that it loads what they need once.
"""

from __future__ import annotations

import os
import signal
import socket
import struct
import sys
from contextlib import suppress

from drivers.base.errors import BenchError
from simulators.config import LabConfig
from simulators.lab._build import build_lab
from simulators.lab._control_channel import ControlChannel
from simulators.lab._service import VirtualService, run_on_wall_clock


def main() -> int:
    """Run a lab until its control channel closes; 2 for a configuration it cannot emulate."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # whoever started the lab closes its control channel
    config = LabConfig.from_line(_first_line())
    try:
        lab, acts = build_lab(config)
    except BenchError as error:
        ControlChannel({}).say({"refused": vars(error)})
        return 2
    channel = ControlChannel(acts)
    ports = {port.name: port.url for port in lab.ports}
    virtual = config.clock == "virtual"
    service = VirtualService(lab, channel, config.cpu, config.emulated) if virtual else None
    channel.say({"ports": ports, "clock": service.url if service else None})
    if service:
        service.run()
    else:
        run_on_wall_clock(lab, channel)
    for port in lab.ports:
        port.close()
    return 0


def serve_forks(descriptor: int) -> int:
    """Fork a lab for every pair of descriptors that arrives, until the socket is closed."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGCHLD, signal.SIG_IGN)  # the kernel buries the labs
    if like := _first_line():
        with suppress(BenchError):  # a lab that cannot be is told by the lab itself
            for port in build_lab(LabConfig.from_line(like))[0].ports:
                port.close()
    with socket.socket(fileno=descriptor) as door:
        while True:
            message, descriptors, _, _ = socket.recv_fds(door, 1, 2)
            if not message:
                return 0
            pid = os.fork()
            if pid == 0:
                signal.signal(signal.SIGCHLD, signal.SIG_DFL)
                door.close()
                for place, given in enumerate(descriptors):
                    os.dup2(given, place)
                    os.close(given)
                code = main()
                sys.stdout.flush()
                os._exit(
                    code
                )  # an interpreter that takes itself apart takes longer than the lab took to start
            for given in descriptors:
                os.close(given)
            door.sendall(struct.pack("!i", pid))


def _first_line() -> bytes:
    """Read one line without buffering beyond it: the control channel reads the rest from the same descriptor."""
    line = b""
    while not line.endswith(b"\n"):
        byte = os.read(0, 1)
        if not byte:
            break
        line += byte
    return line


if __name__ == "__main__":
    sys.exit(serve_forks(int(sys.argv[2])) if sys.argv[1:2] == ["--prefork"] else main())
