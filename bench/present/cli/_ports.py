"""`gyrobench ports`: what there is to name in a bench file."""

from __future__ import annotations

from rich.table import Table
from serial.tools.list_ports import comports

from bench.control.discovery import identify_port
from bench.present.cli._console import Terminal
from drivers.base.clock import WallClock
from drivers.kit.python_can import can


def identify_command(ports: list[str]) -> None:
    """Print which known device answers on each port, all serial ports of this machine if none is named."""
    console = Terminal()
    named = ports or [port.device for port in sorted(comports())]
    if not named:
        console.print("no serial ports; name one with --port")
        return
    clock = WallClock()
    try:
        table = Table("port", "driver", "what answers")
        with console.status("") as status:
            for port in named:
                found = identify_port(port, clock, lambda text: status.update(text))
                table.add_row(found.port, found.driver or "-", found.text)
        console.print(table)
    finally:
        clock.close()


def ports_command() -> None:
    """Print serial ports and CAN channels; nothing is opened and nothing is sent."""
    console = Terminal()
    serial_ports = Table("serial port", "what it says it is", "serial number")
    for port in sorted(comports()):
        serial_ports.add_row(port.device, port.description or "-", port.serial_number or "-")
    channels = Table("python-can interface", "channel")
    for found in can.detect_available_configs("socketcan"):
        channels.add_row(str(found["interface"]), str(found["channel"]))
    for table, what in ((serial_ports, "serial ports"), (channels, "CAN channels")):
        if table.row_count:
            console.print(table)
        else:
            console.print(f"no {what}")
