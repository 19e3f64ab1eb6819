"""The ratios of the main paths, kept in ratios.json: what loses more than a quarter of one is reported."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

FILE = Path(__file__).with_name("ratios.json")
ALLOWED = 0.75


def lost(
    module: str, rows: Iterable[Mapping[str, object]], kept: Mapping[str, Mapping[str, float]] | None = None
) -> list[str]:
    """Return a sentence for each kept ratio of `module` that is lower by more than a quarter, or not there."""
    expected = (json.loads(FILE.read_text(encoding="utf-8")) if kept is None else kept).get(module, {})
    found = ratios(rows)
    texts = []
    for name, ratio in expected.items():
        if name not in found:
            texts.append(f"{module}: {name}: not measured, kept {ratio:.3g}")
        elif found[name] < ALLOWED * ratio:
            texts.append(f"{module}: {name}: {found[name]:.3g}, kept {ratio:.3g}")
    return texts


def better(
    rows: Sequence[Mapping[str, object]], again: Sequence[Mapping[str, object]]
) -> list[Mapping[str, object]]:
    """Return of two measurements of the same rows, row by row, the one with the higher ratio."""
    chosen = []
    for first, second in zip(rows, again, strict=True):
        one, other = first["ratio"], second["ratio"]
        higher = isinstance(one, float) and isinstance(other, float) and other > one
        chosen.append(second if higher else first)
    return chosen


def keep(module: str, rows: Iterable[Mapping[str, object]], file: Path | None = None) -> None:
    """Write the ratios of `module` into the file in place of those kept; nothing if it has none."""
    file = file or FILE
    if not (found := ratios(rows)):
        return
    kept = json.loads(file.read_text(encoding="utf-8")) if file.exists() else {}
    kept[module] = {name: float(f"{ratio:.3g}") for name, ratio in found.items()}
    file.write_text(json.dumps(kept, indent=2, sort_keys=True) + "\n", encoding="utf-8")


def ratios(rows: Iterable[Mapping[str, object]]) -> dict[str, float]:
    """Return the ratios by benchmark and what it is measured against, less its version.

    Rows without `kept` are left out: what the disk, the network or the hour decides says nothing of a change.
    """
    return {
        f"{row['benchmark']} / {' '.join(w for w in str(row['yardstick_name']).split() if w[0].isalpha())}": ratio
        for row in rows
        if isinstance(ratio := row["ratio"], float) and row.get("kept")
    }
