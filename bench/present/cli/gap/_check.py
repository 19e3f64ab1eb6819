"""`gyrobench gap check`: what runs can show, before they are diagnosed."""

from __future__ import annotations

import json

from rich.table import Table

from bench.present.cli._options import DiagnosedGyro, DiagnosedRuns, Json, NominalModel


def check(
    runs: DiagnosedRuns, model: NominalModel, gyro: DiagnosedGyro = None, as_json: Json = False
) -> None:
    """Say what these runs can show of every effect: the smallest size, and which effects look the same."""
    from bench.analysis import gap
    from bench.present.cli._console import Terminal

    console = Terminal()
    with console.status("checking"):
        given = gap.read_recordings(runs, (), gyro)
        found = gap.identifiable(given.runs, gap.read_model(model))
    if as_json:
        console.print_json(json.dumps(gap.identifiable_facts(found)))
        return
    table = Table("effect", "found from about", "looks the same in these runs")
    for effect in found:
        if not effect.reason:
            sizes = ", ".join(f"{name} {size:.2g}" for name, size in effect.least.items())
            table.add_row(effect.effect, sizes, ", ".join(effect.alike) or "nothing")
    console.print(table)
    for effect in found:
        if effect.reason:
            console.say(f"  {effect.effect} cannot be seen: {effect.reason}", style="dim")
