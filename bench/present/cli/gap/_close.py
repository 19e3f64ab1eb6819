"""`gyrobench gap close`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from bench.present.cli._options import DiagnosedGyro, DiagnosedRuns, NominalModel


def close(
    runs: DiagnosedRuns,
    model: NominalModel,
    gyro: DiagnosedGyro = None,
    out: Annotated[
        Path | None, typer.Option(help="file; default nominal+<effect>.toml beside the model")
    ] = None,
) -> None:
    """Write the nominal model with the missing effects in it, and what was learned for those without a name."""
    from bench.analysis import gap
    from bench.analysis.common.state_file import save_file
    from bench.present.cli._console import Terminal
    from bench.present.learned import learned_sentences

    console = Terminal()
    given = gap.read_recordings(runs, gyro=gyro)
    found = gap.diagnose(given.runs, gap.read_model(model), missing=given.missing)
    if not found.closing:
        named = "".join(f", {cause.name}" for cause in found.causes)
        text = f"{found.verdict}{named}: there is no effect to put into the model"
        console.say(text, style="yellow")
        return
    path = out or model.with_name(f"{model.stem}+{'+'.join(found.closing)}.toml")
    save_file(path, gap.model_text(gap.closed_model(found)))
    console.say(f"{path}")
    for sentence in learned_sentences(found.rate.learned) if found.position is None else ():
        console.say(sentence)
