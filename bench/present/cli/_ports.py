"""`gyrobench ports`: what there is to name in a bench file."""

from __future__ import annotations

from typing import Annotated

import typer

app = typer.Typer()


@app.command()
def ports(
    identify: Annotated[
        bool, typer.Option("--identify", help="say which known device answers, by queries that only read")
    ] = False,
    port: Annotated[
        list[str] | None,
        typer.Option(
            "--port", help="with --identify: this port, also socket://host:port; repeat for several"
        ),
    ] = None,
) -> None:
    """List serial ports and CAN channels of this machine."""
    if identify or port:
        _print_what_answers(port or [])
    else:
        _print_ports()


def _print_what_answers(ports: list[str]) -> None:
    """Print which known device answers on each port, all serial ports of this machine if none is named."""
    from rich.table import Table
    from serial.tools.list_ports import comports

    from bench.control.discovery import identify_port
    from bench.present.cli._console import Terminal
    from drivers.base.clock import WallClock

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
                answer = identify_port(port, clock, lambda text: status.update(text))
                table.add_row(answer.port, answer.driver or "-", answer.text)
        console.print(table)
    finally:
        clock.close()


def _print_ports() -> None:
    """Print serial ports and CAN channels; nothing is opened and nothing is sent."""
    from rich.table import Table
    from serial.tools.list_ports import comports

    from bench.present.cli._console import Terminal
    from drivers.kit.python_can import can

    console = Terminal()
    serial_ports = Table("serial port", "what it says it is", "serial number")
    for port in sorted(comports()):
        serial_ports.add_row(port.device, port.description or "-", port.serial_number or "-")
    channels = Table("python-can interface", "channel")
    for channel in can.detect_available_configs("socketcan"):
        channels.add_row(str(channel["interface"]), str(channel["channel"]))
    for table, what in ((serial_ports, "serial ports"), (channels, "CAN channels")):
        if table.row_count:
            console.print(table)
        else:
            console.print(f"no {what}")
