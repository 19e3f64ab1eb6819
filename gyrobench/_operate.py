"""Run procedures, on an emulated lab or on the devices of a bench file, and open campaigns. Needs POSIX."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

from bench.campaign import CampaignFolder
from bench.control.live import Live
from bench.control.procedure import Procedure, read_procedure
from bench.control.progress import Progress
from bench.control.questions import AssumeYes, Console
from bench.control.runner import RunRequest, RunResult, run_procedure
from bench.lab.emulated import Plant, load_plant
from bench.lab.rehearsal import rehearse_procedure
from bench.record.benchfile import BenchFile, load_bench_file


def open_campaign(folder: Path | str) -> CampaignFolder:
    """Return a campaign that was begun: its file, its bench, its runs and how far each of them is.

    `campaign.states()` gives the state of every run, `open_run(state.folder)` the record of one. RecordError or
    ConfigurationError if the folder is no campaign.
    """
    return CampaignFolder(Path(folder))


def rehearse(
    procedure: str | Procedure,
    bench: BenchFile | Path | str,
    /,
    runs: Path | str = "runs",
    *,
    plant: Plant | Path | str | None = None,
    seed: int | None = None,
    show: Callable[[Progress], None] | None = None,
    **parameters: Any,
) -> RunResult:
    """Run a procedure on an emulated lab that matches a bench file, in virtual time; return how it ended.

    `procedure`: its name, a Python file (`./mine.py`) or the object. `runs`: folder that gets the run folder.
    `plant`: the physics behind the emulated devices, or its file. `seed`: in place of the plant's. `show` is
    called with the progress.
    `parameters`: as `gyrobench procedures NAME` lists them, with their units in their names.

    `result.outcome` is completed, invalid or aborted; `open_run(result.folder)` reads the record.
    ConfigurationError for what cannot be asked for, before anything is written.
    """
    found = _procedure(procedure)
    values = found.parse(parameters)
    return rehearse_procedure(found, values, _bench(bench), _physics(plant, seed), Path(runs), show)


def write_unit_fmu(
    bench: BenchFile | Path | str,
    file: Path | str,
    /,
    gyro: str | None = None,
    *,
    plant: Plant | Path | str | None = None,
    seed: int | None = None,
) -> Path:
    """Write a gyro of an emulated lab that matches a bench file as an FMU for co-simulation; return its file.

    `gyro`: its name, the first one without. `plant`: the physics behind it, or its file. `seed`: in place of the
    plant's. Inputs are the true rate along each axis in inertial space, deg/s, and the air about the unit, degC;
    outputs the rate as measured, deg/s, and readings of temperature, degC (docs/gap.md). Where the FMU runs,
    gyrobench must be importable. ConfigurationError for a gyro that there is not, an IMU, a model with effects of
    angle or attitude, and without the extra `fmu`.
    """
    from bench.lab.unit_fmu import write_unit_fmu as write

    write(Path(file), _bench(bench), _physics(plant, seed), gyro)
    return Path(file)


def run(
    procedure: str | Procedure,
    bench: BenchFile | Path | str,
    /,
    runs: Path | str = "runs",
    *,
    yes: bool = False,
    show: Callable[[Progress], None] | None = None,
    **parameters: Any,
) -> RunResult:
    """Run a procedure on the devices of a bench file; return how it ended, with the bench in its safe state.

    As `rehearse`, on real devices: the operator is asked at the terminal. `yes` answers every question
    beforehand, for a bench that is prepared. Limits are checked before anything moves.

    BenchInUse if somebody else has the bench, ConfigurationError for what cannot be asked for. What aborts the
    run is not raised: it is `result.error`.
    """
    found = _procedure(procedure)
    values = found.parse(parameters)
    operator = AssumeYes() if yes else Console(lambda text: input(f"{text} [yes/no] "))
    with Live() as live:
        who = operator if yes else live.beside(operator)
        return run_procedure(RunRequest(found, values, _bench(bench), Path(runs), who, show, live=live))


def _procedure(procedure: str | Procedure) -> Procedure:
    return procedure if isinstance(procedure, Procedure) else read_procedure(procedure)


def _physics(plant: Plant | Path | str | None, seed: int | None) -> Plant:
    physics = plant if isinstance(plant, Plant) else load_plant(None if plant is None else Path(plant))
    return physics if seed is None else physics.model_copy(update={"seed": seed})


def _bench(bench: BenchFile | Path | str) -> BenchFile:
    return bench if isinstance(bench, BenchFile) else load_bench_file(bench)
