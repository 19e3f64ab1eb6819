"""`gyrobench gap effects`: what a diagnosis knows, and how a model file names it."""

from __future__ import annotations

import json
from collections.abc import Sequence
from typing import TYPE_CHECKING, Annotated, Any

from typer import Argument

from bench.present.cli._console import Terminal
from bench.present.cli._options import Json, OwnEffects

if TYPE_CHECKING:
    from collections.abc import Mapping


def effects(
    name: Annotated[str | None, Argument(help="show this one in full")] = None,
    as_json: Json = False,
    own: OwnEffects = None,
) -> None:
    """List the effects that a diagnosis knows; show one's parameters.

    With a NAME: what it follows, its source, parameters, units and limits, and how a model file has it.
    """
    from bench.analysis import gap

    for file in own or ():
        gap.take_own(file)
    console, found = Terminal(), gap.effect_facts(name)
    if as_json:
        console.print_json(json.dumps({"effects": found}))
    elif name is None:
        rows = [(each["name"], each["channel"].replace("_", " "), each["meaning"]) for each in found]
        console.table(("effect", "in", "what it does"), rows)
        console.print("`gyrobench gap effects NAME` shows parameters, units and limits.")
    else:
        _print_one(console, found[0])


def _print_one(console: Terminal, effect: Mapping[str, Any]) -> None:
    console.parts((effect["name"], "bold"), f"  {effect['meaning']}")
    if effect["follows"]:
        console.print(f"follows: {effect['follows']}")
    console.print(f"source: {effect['source']}")
    heads = ("parameter", "unit", "from", "to")
    console.table(
        heads,
        [
            (each["name"], each["unit"] or "-", f"{each['low']:g}", f"{each['high']:g}")
            for each in effect["parameters"]
        ],
    )
    for key, tried in effect["shape"].items():
        console.print(f"{key}, tried: {_in_words(tried)}")
    names = [each["name"] for each in effect["parameters"]]
    if effect["kind"] == "record":
        console.print("The record shows it; a model file does not have it.")
    elif effect["kind"] == "noise":
        _print_lines(console, "[noise]", *(f"{key} = ..." for key in names))
    else:
        tables = {"parameters": names, "sigma": names, "shape": effect["shape"]}
        inline = [
            f"{key} = {{ {', '.join(f'{each} = ...' for each in own)} }}"
            for key, own in tables.items()
            if own
        ]
        _print_lines(console, "[[effect]]", f'name = "{effect["name"]}"', *inline)


def _print_lines(console: Terminal, *lines: str) -> None:
    console.print("\nIn a model file:\n")
    console.say_all(lines, soft_wrap=True)


def _in_words(tried: Sequence[float]) -> str:
    """Return the values of a shape that a diagnosis tries."""
    if len(tried) > 8:
        return f"{len(tried)} values from {tried[0]:g} to {tried[-1]:g}"
    return ", ".join(f"{each:g}" for each in tried)
