"""The arguments of an ACUTROL3000's commands, and what refuses them."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence

from drivers.acutrol.grammar import DATA_TYPE_ERROR, PARAMETER_OUT_OF_RANGE, Refusal


class Refused(Exception):
    """A command was not carried out; its argument is the `Refusal`."""

    def __init__(self, refusal: Refusal) -> None:
        super().__init__(refusal.text)
        self.refusal = refusal


def numbers(texts: Sequence[str]) -> tuple[float, ...]:
    """Return finite numbers; Refused for any other text."""
    try:
        values = tuple(map(float, texts))
    except ValueError:
        raise Refused(DATA_TYPE_ERROR) from None
    if not all(map(math.isfinite, values)):
        raise Refused(PARAMETER_OUT_OF_RANGE)
    return values


def one_of(choices: Iterable[str], text: str) -> str:
    """Return the first choice that begins with `text`, in either case; Refused if none does."""
    for choice in choices:
        if text and choice.startswith(text.upper()):
            return choice
    raise Refused(PARAMETER_OUT_OF_RANGE)
