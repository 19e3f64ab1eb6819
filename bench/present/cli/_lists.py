"""`gyrobench procedures` and `ports`: what there is to run, and to name in a bench file."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

from typer import Argument, Option, Typer

from bench.present.cli._texts import duration

if TYPE_CHECKING:
    from bench.present.cli._console import Terminal

app = Typer()


@app.command()
def procedures(name: Annotated[str | None, Argument(help="show this one in full")] = None) -> None:
    """List the procedures with parameters, units, defaults and expected duration."""
    from bench.control.procedure import find_procedure, load_procedures, parameter_rows
    from bench.present.cli._console import Terminal

    console = Terminal()
    if name is None:
        rows = []
        for procedure in load_procedures().values():
            expected = duration(procedure.expected_duration_s(procedure.parse({})))
            rows.append((procedure.name, procedure.title, expected, procedure.source))
        console.table(("procedure", "what it does", "expected", "source"), rows)
        console.print("`gyrobench procedures NAME` shows parameters, units, defaults and limits.")
        return
    procedure = find_procedure(name)
    console.parts((procedure.name, "bold"), f"  {procedure.title}\nsource: {procedure.source}")
    console.print(f"expected with defaults: {duration(procedure.expected_duration_s(procedure.parse({})))}")
    console.table(("parameter", "default", "unit", "limits", "meaning"), parameter_rows(procedure))


@app.command()
def ports(
    identify: Annotated[
        bool, Option("--identify", help="say which known device answers, by queries that only read")
    ] = False,
    port: Annotated[
        list[str] | None,
        Option(help="with --identify: this port, also socket://host:port; repeat for several"),
    ] = None,
) -> None:
    """List serial ports and CAN channels of this machine."""
    from serial.tools.list_ports import comports

    from bench.present.cli._console import Terminal
    from drivers.kit.python_can import can

    console, serial_ports = Terminal(), sorted(comports())
    if identify or port:
        _print_what_answers(console, port or [place.device for place in serial_ports])
        return
    rows = [(place.device, place.description or "-", place.serial_number or "-") for place in serial_ports]
    if rows:
        console.table(("serial port", "what it says it is", "serial number"), rows)
    else:
        console.print("no serial ports")
    channels = can.detect_available_configs("socketcan")
    if channels:
        names = [(str(channel["interface"]), str(channel["channel"])) for channel in channels]
        console.table(("python-can interface", "channel"), names)
    else:
        console.print("no CAN channels")


def _print_what_answers(console: Terminal, ports: list[str]) -> None:
    """Print which known device answers on each port."""
    from bench.control.discovery import identify_port
    from drivers.base.clock import WallClock

    if not ports:
        console.print("no serial ports; name one with --port")
        return
    clock, rows = WallClock(), []
    try:
        with console.status("") as status:
            for port in ports:
                answer = identify_port(port, clock, lambda text: status.update(text))
                rows.append((answer.port, answer.driver or "-", answer.text))
        console.table(("port", "driver", "what answers"), rows)
    finally:
        clock.close()
