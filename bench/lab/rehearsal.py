"""A procedure on an emulated lab, in virtual time."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

from bench.control.live import Live
from bench.control.procedure import Parameters, Procedure
from bench.control.progress import Progress
from bench.control.questions import EmulatedOperator
from bench.control.runner import RunRequest, RunResult, run_procedure
from bench.lab.emulated import EmulatedLab, Plant
from bench.record.benchfile import BenchFile


def run_in_lab(request: RunRequest, lab: EmulatedLab | None) -> RunResult:
    """Run a procedure on a lab's ports, with the truth beside the run; without a lab, on the request's bench."""
    if lab is not None:
        request = replace(request, file=lab.file, emulated=lab.emulated, before_close=lab.save_truth)
    return run_procedure(request)


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
        operator = EmulatedOperator(lab.perform)
        request = RunRequest(procedure, parameters, file, runs, operator, display, run_id, live=live)
        return run_in_lab(request, lab)
