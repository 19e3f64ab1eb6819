"""`gyrobench procedures`."""

from __future__ import annotations

from typing import Annotated

from typer import Argument, Typer

from bench.present.cli._texts import duration

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
