"""What the plan of a run expects: its procedure and parameters rehearsed on an emulated bench like its own."""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Any

from bench.control.procedure import find_procedure
from bench.present.panel._run_curves import run_curves
from bench.record.benchfile import bench_file_from
from bench.record.recording import read_manifest

SHOWN = ("air", "table")


def run_expected(folder: Path) -> dict[str, Any]:
    """Return phases and curves of the air and the table as `run_curves` has them, of a rehearsal of a run's plan.

    Raises BenchError for a run whose procedure or bench file this version does not know.
    """
    from bench.lab.emulated import Plant
    from bench.lab.rehearsal import rehearse_procedure

    manifest = read_manifest(folder)
    procedure = find_procedure(manifest.procedure)
    parameters = procedure.parse(manifest.parameters)
    with tempfile.TemporaryDirectory(prefix="gyrobench-expected-") as scratch:
        file = bench_file_from(manifest.bench)
        result = rehearse_procedure(procedure, parameters, file, Plant(), Path(scratch))
        found = run_curves(result.folder)
    return found | {"curves": [curve for curve in found["curves"] if curve["key"] in SHOWN]}
