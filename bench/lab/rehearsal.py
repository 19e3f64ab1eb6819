"""A procedure on an emulated lab, in virtual time."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from bench.control.live import Live
from bench.control.procedure import Parameters, Procedure
from bench.control.progress import Progress
from bench.control.questions import EmulatedOperator
from bench.control.runner import RunRequest, RunResult, run_procedure
from bench.lab.emulated import EmulatedLab, Plant
from bench.record.benchfile import BenchFile


def rehearse_procedure(
    procedure: Procedure,
    parameters: Parameters,
    file: BenchFile,
    plant: Plant,
    runs: Path,
    display: Callable[[Progress], None] | None = None,
    *,
    run_id: str | None = None,
    lane: int | None = None,
) -> RunResult:
    """Run a procedure on a fresh emulated lab that matches a bench file; the lab does what an operator is asked.

    `display` is told how the run goes; `lane`: the processor that the lab keeps to.
    """
    with EmulatedLab(file, plant, lane=lane) as lab, Live() as live:
        request = RunRequest(
            procedure,
            parameters,
            lab.file,
            runs,
            EmulatedOperator(lab.perform),
            display,
            run_id=run_id,
            emulated=lab.emulated,
            before_close=lab.save_truth,
            live=live,
        )
        return run_procedure(request)
