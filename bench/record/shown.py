"""Results that show themselves: a line in a terminal, a table of facts in a notebook."""

from __future__ import annotations

from collections.abc import Mapping
from html import escape


class Shown:
    """Base of a result that says in `shown` what it is; a dataclass derived from it has `repr=False`."""

    def shown(self) -> Mapping[str, object]:
        """Return what identifies the result and how it came out: a few short facts by name."""
        raise NotImplementedError

    def __repr__(self) -> str:
        facts = ", ".join(f"{name} {_text(value)}" for name, value in self.shown().items())
        return f"<{type(self).__name__}: {facts}>"

    def _repr_html_(self) -> str:
        rows = "".join(
            f"<tr><th style='text-align:left'>{escape(name)}</th>"
            f"<td style='text-align:left'>{escape(_text(value))}</td></tr>"
            for name, value in self.shown().items()
        )
        return f"<table><caption>{escape(type(self).__name__)}</caption>{rows}</table>"


def _text(value: object) -> str:
    if isinstance(value, float):
        return f"{value:.6g}"
    if isinstance(value, tuple | list):
        return ", ".join(map(_text, value)) or "none"
    return str(value)
