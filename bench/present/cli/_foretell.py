"""`gyrobench foretell`: what a test will be able to resolve, before it begins."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from typer import BadParameter, Context, Option, Typer

from bench.present.cli import _options as options
from bench.present.cli._run import PARAMETERS_TOO, Set, chosen
from bench.present.cli._texts import duration

app = Typer()


@app.command(context_settings=PARAMETERS_TOO)
def foretell(
    context: Context,
    procedure: options.ProcedureName,
    bench: options.Bench = options.DEFAULT_BENCH,
    set_: Set = None,
    noise: Annotated[
        list[str] | None,
        Option(help="a coefficient, as angle_random_walk=0.004 (deg/sqrt(h)); repeat for several"),
    ] = None,
    like: Annotated[
        Path | None, Option(help="a standard-test run of such a unit: its noise is taken")
    ] = None,
    gyro: options.GyroToFit = None,
    limits: Annotated[
        Path | None, Option(help="a TOML file with a limits table: which of them such a test can tell")
    ] = None,
    as_json: options.Json = False,
) -> None:
    """Say what a test will be able to resolve, before it begins.

    Units without any fault, with the noise that is given, go through the plan of the test and through the
    functions that make its figures. Printed is half of each 95 % interval, or what such a unit would be stated as
    "not seen above".

    Coefficients are quantisation (deg), angle_random_walk (deg/sqrt(h)), bias_instability (deg/h),
    rate_random_walk (deg/h/sqrt(h)) and rate_ramp (deg/h/h), as a data sheet or `gyrobench look` has them.

    With --limits a limit that lies within what is resolved is marked: no unit could be shown to meet it.

    The procedure's parameters are options too: --steps-h 8 is --set steps_h=8.
    """
    from bench.analysis.figures import foretell_procedure, noise_like, noise_named
    from bench.present.cli._console import Terminal
    from bench.present.cli._settings import parse_settings
    from bench.record.benchfile import load_bench_file
    from bench.record.figure_limits import load_limits

    console = Terminal(as_json=as_json)
    test, parameters = chosen(procedure, set_, context.args)
    named = parse_settings(
        noise or [], "--noise", "a coefficient that is not name=value", "angle_random_walk=0.004"
    )
    if like is not None and named:
        raise BadParameter("the noise is that of --noise or that of --like, not both", param_hint="--like")
    coefficients = noise_named(named) if like is None else noise_like(like, gyro)
    file = load_bench_file(bench)
    with console.status("drawing units"):
        found = foretell_procedure(test, parameters, coefficients, file)
    bounds = load_limits(limits).rows if limits else {}
    heads: tuple[str, ...] = ("figure", "resolved to (95 %)", "unit")
    rows: list[tuple[str, ...]] = [(each.name, each.text or each.reason, each.unit) for each in found.figures]
    told = {each.name: each.tells(bounds[each.name]) for each in found.figures if each.name in bounds}
    if limits:
        heads = (*heads, "limit")
        words = {True: "can be told", False: "cannot be told"}
        rows = [(*row, words[told[row[0]]] if row[0] in told else "") for row in rows]
    console.table(heads, rows, f"{test.name}: what it will resolve")
    for name in bounds.keys() - told.keys():
        console.say(f"{name}: no figure of this test", style="yellow")
    console.print(f"expected: {duration(found.duration_s)}, of a unit without any fault")
    console.say_json(
        "result",
        figures=[
            {
                "name": each.name,
                "unit": each.unit,
                "resolves": each.resolves,
                "reason": each.reason,
                "tells": told.get(each.name),
            }
            for each in found.figures
        ],
        duration_s=found.duration_s,
        noise=coefficients,
    )
