"""`gyrobench gap check`: what runs can show, before they are diagnosed."""

from __future__ import annotations

import json

from bench.present.cli._console import Terminal
from bench.present.cli._options import DiagnosedGyro, DiagnosedRuns, Json, NominalModel, OwnEffects


def check(
    runs: DiagnosedRuns,
    model: NominalModel,
    gyro: DiagnosedGyro = None,
    as_json: Json = False,
    effects: OwnEffects = None,
) -> None:
    """Say which effects these runs can show, and how small.

    It also says which effects look the same in them.
    """
    from bench.analysis import gap

    for file in effects or ():
        gap.take_own(file)
    console = Terminal()
    with console.status("checking"):
        given = gap.read_recordings(runs, (), gyro)
        found = gap.identifiable(given.runs, gap.read_model(model))
    if as_json:
        console.print_json(json.dumps(gap.identifiable_facts(found)))
        return
    rows = []
    for effect in found:
        sizes = ", ".join(f"{name} {size:.2g}" for name, size in effect.least.items())
        if not effect.reason:
            rows.append((effect.effect, sizes, ", ".join(effect.alike) or "nothing"))
    console.table(("effect", "found from about", "looks the same in these runs"), rows)
    for effect in found:
        if effect.reason:
            console.say(f"  {effect.effect} cannot be seen: {effect.reason}", style="dim")
