"""The lab's process: configuration on the first line of standard input, ports and clock URL (or why there is
no such lab) on the first of standard output, then the control channel until standard input ends.
"""

from __future__ import annotations

import os
import signal
import sys

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
    sys.exit(main())
