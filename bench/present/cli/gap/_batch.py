"""`gyrobench gap batch`: several units of a type, what all of them lack and what is one unit's own."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING

from bench.present.cli._console import Terminal
from bench.present.cli._options import DiagnosedRuns, Json, NominalModel, OwnEffects

if TYPE_CHECKING:
    from bench.analysis.gap import BatchEffect

_DIFFERENT = 0.01
"""Probability of so large a scatter between units below which a value is called different."""


def batch(
    runs: DiagnosedRuns, model: NominalModel, as_json: Json = False, effects: OwnEffects = None
) -> None:
    """Say which missing effects all units have, which one unit alone.

    Every gyro of the runs is a unit, told apart by its serial number.
    """
    from bench.analysis import gap

    for file in effects or ():
        gap.take_own(file)
    console = Terminal()
    with console.status("diagnosing every unit"):
        found = gap.diagnose_batch(gap.read_batch(runs), gap.read_model(model))
    if as_json:
        console.print_json(json.dumps(gap.batch_facts(found)))
        return
    for unit, diagnosis in found.units.items():
        causes = ", ".join(" or ".join(cause.one_of or (cause.name,)) for cause in diagnosis.rate.causes)
        lines = (
            "; ".join(line.sentence for line in diagnosis.fast.lines) if diagnosis.fast is not None else ""
        )
        console.say(
            f"unit {unit}: {diagnosis.verdict}{causes and ': '}{causes}{lines and '; above 0.5 Hz '}{lines}"
        )
    for effect in found.effects:
        console.say(_whose(effect), style="bold")
        coarseness = next(iter(found.units.values())).model.noise.coarseness
        for unit, probability in effect.by_unit.items():
            term = effect.terms.get(unit)
            fitted = f": {term.fitted(coarseness, '+-')}" if term is not None else ""
            unseen = f"; its runs cannot show it: {effect.unseen[unit]}" if unit in effect.unseen else ""
            console.say(f"  unit {unit} ({100 * probability:.0f} %){fitted}{unseen}")
        for name, probability in effect.one_value.items():
            alike = "one value for all" if probability > _DIFFERENT else "differs from unit to unit"
            console.say(f"  {name}: {alike} (chi squared: {100 * probability:.2g} %)")
    if not found.effects:
        console.say("no effect is seen in any unit")


def _whose(effect: BatchEffect) -> str:
    name = " or ".join(effect.one_of)
    if effect.kind == "common":
        return f"{name}: common to all units ({100 * effect.in_all:.0f} %)"
    of = f"of {', '.join(effect.units)}"
    if effect.kind == "own":
        return f"{name}: {of}, and of no other unit"
    return f"{name}: {of}; of the others that is not decided"
