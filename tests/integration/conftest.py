"""A bench on an emulated lab whose emulators can be exchanged."""

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from types import SimpleNamespace

import pytest

from bench.control.procedure import Demands, Parameters, Procedure, find_procedure, parameter
from bench.control.questions import AssumeYes, EmulatedOperator
from bench.control.run_record import decode_run
from bench.control.runner import RunRequest, RunResult, run_procedure
from bench.lab.emulated import EmulatedLab, Plant
from bench.record.benchfile import BenchFile, load_bench_file
from bench.record.recording import read_manifest, verify
from tests.benches import CAN_GYRO, FOG_BENCH


class SpinParameters(Parameters):
    """A short turn in a cooling chamber."""

    hold_s: float = parameter(30.0, "time at rate", "s", ge=0)
    rate_dps: float = parameter(5.0, "table rate", "deg/s")
    cold_c: float = parameter(20.0, "set point", "degC")


def spin(bench, p):
    bench.table.device.servo_on()
    bench.chamber.go_to(p.cold_c)
    bench.chamber.start()
    bench.phase("spin")
    bench.table.spin(p.rate_dps)
    bench.wait(p.hold_s, "turning")
    bench.table.stop()


SPIN = Procedure(
    name="spin",
    title="A turn",
    source="tests",
    parameters=SpinParameters,
    run=spin,
    expected_duration_s=lambda p: p.hold_s,
    demands=lambda p: Demands(p.rate_dps, p.cold_c, 25.0, 0.0),
)


@contextmanager
def emulated_lab(file: BenchFile, plant: Plant, swap: Mapping[str, Callable] | None = None):
    """Serve a lab whose emulator on port p is `swap[p](emulator, lab, index)`."""
    with EmulatedLab(file, plant) as served:
        lab = served._lab._lab
        for index, port in enumerate(lab.ports):
            if swap and port.name in swap:
                emulator = swap[port.name](lab._emulators[index], lab, index)
                lab._emulators[index] = emulator
                lab._streams = [(i, s) for i, s in lab._streams if i != index]
                if hasattr(emulator, "stream"):
                    lab._streams.append((index, emulator))
        yield served


def drive(file, runs, procedure=SPIN, operator=None, display=None, **parameters) -> RunResult:
    """Run a procedure and return how it ended."""
    request = RunRequest(
        procedure, procedure.parse(parameters), file, runs, operator or AssumeYes(), display, "run"
    )
    return run_procedure(request)


def problems(folder: Path) -> list:
    """Return what `runs verify` finds."""

    def rebuild(run: Path, out: Path) -> None:
        decode_run(run, out)

    return [str(problem) for problem in verify(folder, rebuild).problems]


@pytest.fixture(scope="session")
def bench() -> SimpleNamespace:
    """What the tests use of this module."""
    return SimpleNamespace(lab=emulated_lab, drive=drive, problems=problems, spin=SPIN)


@pytest.fixture(scope="session")
def fog_text() -> str:
    return FOG_BENCH


@pytest.fixture(scope="session")
def both_text() -> str:
    return FOG_BENCH + CAN_GYRO


@pytest.fixture(scope="session")
def fog_file(tmp_path_factory) -> BenchFile:
    path = tmp_path_factory.mktemp("bench") / "fog.toml"
    path.write_text(FOG_BENCH)
    return load_bench_file(path)


@pytest.fixture(scope="session")
def both_file(tmp_path_factory) -> BenchFile:
    path = tmp_path_factory.mktemp("bench") / "both.toml"
    path.write_text(FOG_BENCH + CAN_GYRO)
    return load_bench_file(path)


SHORTEST = {
    "soak_min": 1,
    "hold_min": 10,
    "warm_up_min": 0,
    "east_after_min": 0,
    "east_dwell_s": 60,
    "drift_k_per_10min": 2,
}


@pytest.fixture(scope="session")
def short_run(fog_file, tmp_path_factory) -> Iterator[Path]:
    """The folder of one completed zero-bias run, the shortest that its limits allow, with the lab's truth."""
    procedure = find_procedure("zero-bias-cold-shock")
    runs = tmp_path_factory.mktemp("runs")
    with EmulatedLab(fog_file, Plant(seed=3)) as lab:

        def keep_truth(folder: Path) -> None:
            lab.perform({"act": "truth", "unit": "fog_1", "path": str(folder / "truth_fog_1.npz")})

        request = RunRequest(
            procedure,
            procedure.parse(SHORTEST),
            lab.file,
            runs,
            EmulatedOperator(lab.perform),
            run_id="short",
            emulated={"seed": 3, "model": "test"},
            before_close=keep_truth,
        )
        result = run_procedure(request)
    assert result.outcome == "completed", result.reason
    assert read_manifest(result.folder).outcome == "completed"
    return result.folder
