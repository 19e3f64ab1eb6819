"""What the catalogue knows of an effect, as JSON values."""

from __future__ import annotations

import difflib
from typing import Any

from bench.analysis.gap._noise import NAMES
from drivers.base.errors import ConfigurationError
from simulators.effects import AnyEffect, Effect, NoiseEffect, Parameter, catalogue


def effect_facts(name: str | None = None) -> list[dict[str, Any]]:
    """Return every effect of the catalogue, or one: name, channel, kind, meaning, what it follows, source.

    Beside these `parameters`, each with name, unit, low, high and optional, and `shape`, the values of each
    non-linear parameter that a diagnosis tries. `kind` says where a model file has it: "effect", an `[[effect]]`;
    "noise", its `[noise]`; "record", nowhere. ConfigurationError for a name that is not in the catalogue.
    """
    known = catalogue()
    if name is not None and name not in known:
        near = difflib.get_close_matches(name, known, n=1)
        raise ConfigurationError(
            "there is no such effect",
            where="catalogue",
            found=repr(name),
            expected="one of " + ", ".join(known),
            remedy=f"did you mean {near[0]!r}?" if near else "`gyrobench gap effects` says what each does",
        )
    return [_facts(effect) for effect in ([known[name]] if name is not None else known.values())]


def _facts(effect: AnyEffect) -> dict[str, Any]:
    if isinstance(effect, NoiseEffect):
        parameters: tuple[Parameter, ...] = (effect.parameter,)
        kind = "noise" if effect.parameter.name in NAMES else "record"
    else:
        parameters, kind = effect.parameters, "effect"
    return {
        "name": effect.name,
        "channel": effect.channel,
        "kind": kind,
        "meaning": effect.meaning,
        "follows": getattr(effect, "follows", ""),
        "source": effect.source,
        "parameters": [
            {
                "name": parameter.name,
                "unit": parameter.unit.symbol,
                "low": parameter.low,
                "high": parameter.high,
                "optional": parameter.optional,
            }
            for parameter in parameters
        ],
        "shape": effect.grids if isinstance(effect, Effect) else {},
    }
