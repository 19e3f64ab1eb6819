"""`gyrobench gap foretell`: which run of a bench makes parameters known best, hour for hour."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from typer import Argument, Option

from bench.present.cli import _options as options
from bench.present.cli._console import Terminal

_SHOWN = 8


def foretell(
    effects: Annotated[
        str, Option("--of", help="effects whose parameters should be known better, separated by commas")
    ],
    model: options.NominalModel,
    runs: Annotated[
        list[Path] | None, Argument(help="run folders or mapping files that the model was not fitted to")
    ] = None,
    bench: options.Bench = options.DEFAULT_BENCH,
    gyro: options.DiagnosedGyro = None,
    as_json: options.Json = False,
) -> None:
    """Say which run makes the parameters of effects known best.

    An effect of the model is known as well as the model says; of another nothing is known.
    """
    from bench.analysis import gap
    from bench.record.benchfile import load_bench_file

    file = load_bench_file(bench)
    nominal = gap.read_model(model)
    console = Terminal()
    with console.status("foretelling runs"):
        recorded = gap.read_recordings(runs, (), gyro).shown if runs else []
        axis = file.gyro_named(gyro).axis
        names = [name.strip() for name in effects.split(",") if name.strip()]
        now, *after = gap.foretell(nominal, names, recorded, gap.designs_for(file, axis))
    if as_json:
        console.print_json(data=gap.foretold_facts([now, *after]))
        return
    heads = ("run", "hours", "hours as good", *(f"{key}, {unit}" for key, unit in now.units.items()))
    rows = [("now", "", "", *(f"{sigma:.2g}" for sigma in now.sigmas.values()))]
    for each in after[:_SHOWN]:
        assert each.design is not None
        text = f"{each.design.procedure}: {each.design.text}"
        sigmas = [f"{sigma:.2g}" for sigma in each.sigmas.values()]
        rows.append((text, f"{each.design.hours:.2f}", f"{each.hours:.3g}", *sigmas))
    console.table(heads, rows, "1 sigma of each parameter, now and after one run more")
    if len(after) > _SHOWN:
        console.say(f"{len(after) - _SHOWN} more runs take longer", style="dim")
    console.say(
        "hours as good: of so many repeats as know the parameters as well as the best single run does"
    )
