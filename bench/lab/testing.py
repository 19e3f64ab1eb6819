"""What a test drives: a bench, emulated or real, whose measurements end up in the test report."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from bench.control.procedure import Demands, Parameters, Procedure, find_procedure
from bench.control.questions import AssumeYes, EmulatedOperator, Operator, Question, Reply
from bench.control.runner import RunRequest
from bench.control.session import Bench
from bench.lab.emulated import EmulatedLab
from bench.lab.rehearsal import run_in_lab
from bench.record.benchfile import BenchFile, load_bench_file
from bench.record.events.run import Measured
from bench.record.recording import Run
from drivers.base.errors import BenchError, RunAborted


@dataclass(frozen=True)
class TestRun:
    """A run that a test has made. `record` reads its folder."""

    __test__ = False
    folder: Path
    outcome: str
    reason: str
    measurements: tuple[Measured, ...]

    @property
    def record(self) -> Run:
        """The recorded run: tables, events, manifest."""
        return Run.open(self.folder)

    def value(self, name: str) -> float:
        """Return a measured value, the last one of that name; KeyError with the names there are."""
        values = {measurement.name: _number(measurement.value) for measurement in self.measurements}
        if name not in values:
            raise KeyError(f"{name} was not measured; measured were {', '.join(values) or 'none'}")
        return values[name]


class TestBench:
    """Runs procedures for a test and writes what they measure to its report.

    `report(name, value)` is pytest's `record_property`; `lab` is the emulated lab, None for devices.
    """

    __test__ = False

    def __init__(
        self,
        file: BenchFile,
        runs: Path,
        report: Callable[[str, object], None],
        *,
        lab: EmulatedLab | None = None,
        yes: bool = False,
    ) -> None:
        self.file = file
        self.runs = runs
        self._report = report
        self._lab = lab
        self._yes = yes
        self._used = False

    @property
    def emulated(self) -> bool:
        """Whether there are no devices behind it."""
        return self._lab is not None

    def run(self, procedure: str, /, *, judge: bool = True, **parameters: Any) -> TestRun:
        """Run an installed procedure. See `drive` for what `judge` does."""
        chosen = find_procedure(procedure)
        return self._run(chosen, chosen.parse(parameters), judge)

    def drive(
        self, function: Callable[[Bench], None], /, *, judge: bool = True, demands: Demands | None = None
    ) -> TestRun:
        """Run `function(bench)` as a procedure: recorded, limits checked, made safe at the end.

        With `judge`, AssertionError if a measurement is outside its limits or the run is invalid; an aborted run
        always is one. `demands` are what is checked against the limits before anything moves.
        """
        name = getattr(function, "__name__", "function").replace("_", "-").strip("-<>") or "function"
        procedure = Procedure(
            name=name,
            title=(function.__doc__ or name).strip().splitlines()[0],
            source="a test",
            parameters=Parameters,
            run=lambda bench, _: function(bench),
            expected_duration_s=lambda _: 0.0,
            demands=lambda _: demands or Demands(),
            upright=False,
        )
        return self._run(procedure, Parameters(), judge)

    def measure(
        self, name: str, value: float, unit: str, *, low: float | None = None, high: float | None = None
    ) -> float:
        """Put a value that the test computed into the report; AssertionError if it is outside its limits."""
        measured = Measured.against(name, float(value), unit, low, high)
        self._tell(measured)
        assert measured.passed is not False, _text(measured)
        return float(value)

    def _run(self, procedure: Procedure, parameters: Parameters, judge: bool) -> TestRun:
        if self._used and self._lab is not None:
            raise BenchError(
                "an emulated bench is good for one run",
                remedy="use one test a run, or measure both in one procedure: its clock does not start anew",
            )
        self._used = True
        request = RunRequest(procedure, parameters, self.file, self.runs, self._operator())
        result = run_in_lab(request, self._lab)
        measurements = tuple(event for _, event in Run.open(result.folder).of(Measured))
        self._report("run_folder", str(result.folder))
        self._report("run_outcome", result.outcome)
        for measurement in measurements:
            self._tell(measurement)
        if isinstance(result.error, BenchError):
            raise result.error
        assert result.outcome != "aborted", result.reason
        run = TestRun(result.folder, result.outcome, result.reason, measurements)
        if judge:
            failed = [_text(measurement) for measurement in measurements if measurement.passed is False]
            assert not failed, "outside its limits: " + "; ".join(failed)
            assert result.outcome == "completed", f"{result.outcome}: {result.reason}"
        return run

    def _operator(self) -> Operator:
        if self._lab is not None:
            return EmulatedOperator(self._lab.perform)
        return AssumeYes() if self._yes else _Nobody()

    def _tell(self, measured: Measured) -> None:
        self._report(measured.name, measured.value)
        self._report(f"{measured.name}.unit", measured.unit)
        for side in ("low", "high"):
            if (limit := getattr(measured, side)) is not None:
                self._report(f"{measured.name}.{side}", limit)
        if measured.passed is not None:
            self._report(f"{measured.name}.passed", measured.passed)


class _Nobody:
    """Stands where an operator would on a real bench that nobody prepared."""

    def ask(self, question: Question) -> Callable[[], Reply | None]:
        """Abort: a test run has no one to answer."""
        raise RunAborted(
            "a question to the operator, and nobody is there",
            found=question.text,
            remedy="prepare the bench and say so with --bench-yes",
        )


def usual_bench(path: Path | None) -> BenchFile:
    """Return the bench that emulated benches are like: that file's, or one with a FOG and a MEMS unit."""
    return load_bench_file(Path(__file__).with_name("usual_bench.toml") if path is None else path)


def _text(measured: Measured) -> str:
    low = "" if measured.low is None else f"{measured.low:g} <= "
    high = "" if measured.high is None else f" <= {measured.high:g}"
    return f"{measured.name}: {low}{measured.value:.6g}{high} {measured.unit}".rstrip()


def _number(value: float | None) -> float:
    return float("nan") if value is None else float(value)
