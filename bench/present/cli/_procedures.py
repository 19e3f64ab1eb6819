"""`gyrobench procedures`."""

from __future__ import annotations

from typing import Annotated

import typer

from bench.present.cli._texts import duration

app = typer.Typer()


@app.command()
def procedures(name: Annotated[str | None, typer.Argument(help="show this one in full")] = None) -> None:
    """List the procedures with parameters, units, defaults and expected duration."""
    from rich.table import Table
    from rich.text import Text

    from bench.control.procedure import find_procedure, load_procedures, parameter_rows
    from bench.present.cli._console import Terminal

    console = Terminal()
    if name is None:
        table = Table("procedure", "what it does", "expected", "source")
        for procedure in load_procedures().values():
            expected = duration(procedure.expected_duration_s(procedure.parse({})))
            table.add_row(procedure.name, procedure.title, expected, procedure.source)
        console.print(table)
        console.print("`gyrobench procedures NAME` shows parameters, units, defaults and limits.")
        return
    procedure = find_procedure(name)
    console.print(Text.assemble((procedure.name, "bold"), f"  {procedure.title}\nsource: {procedure.source}"))
    console.print(f"expected with defaults: {duration(procedure.expected_duration_s(procedure.parse({})))}")
    table = Table("parameter", "default", "unit", "limits", "meaning")
    for row in parameter_rows(procedure):
        table.add_row(*row)
    console.print(table)
