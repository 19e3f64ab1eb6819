"""`gyrobench ports`: what there is to name in a bench file."""

from __future__ import annotations

import can
from rich.console import Console
from rich.table import Table
from serial.tools.list_ports import comports


def ports_command() -> None:
    """Print serial ports and CAN channels; nothing is opened and nothing is sent."""
    console = Console()
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
