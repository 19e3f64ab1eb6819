"""The figures of a recorded run by unit: what its procedure measured, and those of the test standards."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

from bench.record.recording import Manifest, Run
from drivers.base.errors import BenchError

STANDARD_TEST = "standard-test"


def run_figures(folder: Path) -> list[dict[str, Any]]:
    """Return the figures of a run, a row for each unit and figure; none of a run that is not completed.

    A row is {"unit", "figure", "of", "value", "low", "high", "least", "most"}: serial number, name, unit of the
    value, the ends of its 95 % interval (None where the procedure gives none), and the limits it was judged by.
    A measurement of a gyro, or one whose name begins with a gyro's, is that gyro's; others are of every unit.
    """
    run = Run.open(folder)
    if run.manifest.outcome != "completed" or run.seal == "broken":
        return []
    rows = list(_measured(run.manifest))
    if run.manifest.procedure == STANDARD_TEST:
        for gyro in run.manifest.units:
            rows += _standard(folder, gyro)
    return rows


def _measured(manifest: Manifest) -> list[dict[str, Any]]:
    rows = []
    for row in manifest.measurements:
        name, value = row["name"], row.get("value")
        if value is None or not math.isfinite(value):
            continue
        asked = row.get("gyro")
        own = [gyro for gyro in manifest.units if (gyro == asked if asked else name.startswith(f"{gyro}_"))]
        for gyro in own or manifest.units:
            words = name.removeprefix(f"{gyro}_") if own else name
            rows.append(
                {
                    "unit": manifest.units[gyro],
                    "figure": f"{manifest.procedure}: {words.replace('_', ' ')}",
                    "of": row.get("unit", ""),
                    "value": value,
                    "low": None,
                    "high": None,
                    "least": row.get("low"),
                    "most": row.get("high"),
                }
            )
    return rows


def _standard(folder: Path, gyro: str) -> list[dict[str, Any]]:
    from bench.analysis.figures import standard_figures  # scipy behind it is slow to import

    try:
        found = standard_figures(folder, gyro)
    except BenchError:
        return []
    return [
        {
            "unit": found.unit_id,
            "figure": figure.name,
            "of": figure.unit,
            "value": figure.value,
            "low": _finite(figure.low),
            "high": _finite(figure.high),
            "least": None,
            "most": None,
        }
        for figure in found.figures
        if math.isfinite(figure.value)
    ]


def _finite(value: float | None) -> float | None:
    return value if value is not None and math.isfinite(value) else None
