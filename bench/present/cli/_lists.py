"""`gyrobench procedures` and `ports`: what there is to run, and to name in a bench file."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

from typer import Argument, Option, Typer

from bench.present.cli._options import Json
from bench.present.cli._texts import duration

if TYPE_CHECKING:
    from bench.control.procedure import Procedure
    from bench.present.cli._console import Terminal

app = Typer()


@app.command()
def procedures(
    name: Annotated[str | None, Argument(help="show this one in full; also a file, ./mine.py")] = None,
    as_json: Json = False,
) -> None:
    """List procedures and their duration; show one's parameters.

    With a NAME or a file: parameters, units, defaults, limits and expected duration.
    """
    from bench.control.procedure import load_procedures, parameter_rows, read_procedure
    from bench.present.cli._console import Terminal

    console = Terminal(as_json=as_json)

    def facts(shown: Procedure) -> dict[str, object]:
        expected_s = shown.expected_duration_s(shown.parse({}))
        return {"name": shown.name, "title": shown.title, "source": shown.source, "expected_s": expected_s}

    if name is None:
        every = load_procedures().values()
        console.say_json("result", procedures=[facts(procedure) for procedure in every])
        rows = []
        for procedure in every:
            expected = duration(procedure.expected_duration_s(procedure.parse({})))
            rows.append((procedure.name, procedure.title, expected, procedure.source))
        console.table(("procedure", "what it does", "expected", "source"), rows)
        console.print("`gyrobench procedures NAME` shows parameters, units, defaults and limits.")
        return
    procedure = read_procedure(name)
    console.parts((procedure.name, "bold"), f"  {procedure.title}\nsource: {procedure.source}")
    console.print(f"expected with defaults: {duration(procedure.expected_duration_s(procedure.parse({})))}")
    heads = ("parameter", "default", "unit", "limits", "meaning")
    console.table(heads, parameter_rows(procedure))
    parameters = [dict(zip(heads, row, strict=True)) for row in parameter_rows(procedure)]
    console.say_json("result", **facts(procedure), parameters=parameters)


@app.command()
def ports(
    identify: Annotated[
        bool, Option("--identify", help="say which known device answers, by queries that only read")
    ] = False,
    thorough: Annotated[
        bool,
        Option("--thorough", help="as --identify, at other baud rates and bus addresses too: takes minutes"),
    ] = False,
    port: Annotated[
        list[str] | None,
        Option(help="with --identify: this port, also socket://host:port; repeat for several"),
    ] = None,
    as_json: Json = False,
) -> None:
    """List serial ports and CAN channels of this machine."""
    from serial.tools.list_ports import comports

    from bench.present.cli._console import Terminal
    from drivers.kit.python_can import can

    console, serial_ports = Terminal(as_json=as_json), sorted(comports())
    if identify or thorough or port:
        _print_what_answers(console, port or [place.device for place in serial_ports], thorough)
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
    heads = ("port", "text", "serial_number")
    console.say_json("result", serial=[dict(zip(heads, row, strict=True)) for row in rows], can=channels)


def _print_what_answers(console: Terminal, ports: list[str], thorough: bool) -> None:
    """Print which known device answers on each port."""
    from bench.control.discovery import identify_port
    from drivers.base.clock import WallClock

    if not ports:
        console.print("no serial ports; name one with --port")
        console.say_json("result", answers=[])
        return
    clock, rows = WallClock(), []
    try:
        with console.status("") as status:
            for port in ports:
                answer = identify_port(port, clock, lambda text: status.update(text), thorough=thorough)
                rows.append((answer.port, answer.driver or "-", answer.text))
        console.table(("port", "driver", "what answers"), rows)
        answers = [dict(zip(("port", "driver", "text"), row, strict=True)) for row in rows]
        console.say_json("result", answers=answers)
    finally:
        clock.close()
