"""One run from request to closed folder: open, identify, check limits, drive, make safe, decode, seal."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from contextlib import ExitStack, suppress
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from shlex import quote
from typing import Any, cast

from bench.control.devices import open_chamber, open_clock, open_instrument, open_table
from bench.control.instrument_station import InstrumentStation, SupplyStation
from bench.control.lease import Lease, take_lease
from bench.control.live import Live
from bench.control.operators import Signature
from bench.control.procedure import Parameters, Procedure, beyond_limits, require_none_beyond
from bench.control.progress import Progress
from bench.control.questions import Operator
from bench.control.run_record import RunRecord
from bench.control.safe_state import bring_to_rest
from bench.control.session import Bench
from bench.control.signals import asking, held
from bench.control.stream_stations import GyroStation, PlatformStation, StreamStation, StreamTap
from bench.control.watchdog import Watchdog
from bench.record.benchfile import BenchFile, Calibration, overdue
from bench.record.events.campaign import Started
from bench.record.events.run import Alarm
from bench.record.events.safe import SafeState
from bench.record.shown import Shown
from drivers.base.clock import Clock, WallClock, utc_now
from drivers.base.errors import (
    BenchError,
    ConfigurationError,
    DeviceRefused,
    DeviceSilent,
    ProtocolError,
    RecordError,
    RunUnsealed,
    WrongDevice,
)
from drivers.base.virtual_clock import VirtualClock
from drivers.base.windows import HOLDS_PROCESSES
from drivers.kit.config import SupplyConfig, UnderTestConfig
from drivers.kit.instruments import Gyro, Supply
from drivers.kit.kinds import Connection
from drivers.kit.registry import load_kind


@dataclass(frozen=True)
class RunRequest:
    """What to run, on what, and where the record goes.

    `emulated` is written to the manifest of a run on an emulated lab (plant settings); None: what the lab or the
    bench file says, and nothing on real devices.
    `lease`: of a caller who keeps the bench for more than this run; None has the run take one for itself.
    `live`: where others see and steer the run; None keeps it to itself.
    `started_by`: who, for the record; None says nothing of it.
    """

    procedure: Procedure
    parameters: Parameters
    file: BenchFile
    runs_folder: Path
    operator: Operator
    display: Callable[[Progress], None] | None = None
    run_id: str | None = None
    emulated: dict[str, Any] | None = None
    before_close: Callable[[Path], None] | None = None
    lease: Lease | None = None
    live: Live | None = None
    started_by: Signature | None = None


@dataclass(repr=False)
class RunResult(Shown):
    """How a run ended; `error` is what aborted it."""

    folder: Path
    outcome: str
    reason: str
    duration_s: float
    error: BaseException | None = None
    warnings: list[str] = field(default_factory=list)
    safe: tuple[SafeState, ...] = ()
    """What became of table and chamber when they were made safe; empty if nothing was opened yet."""

    def shown(self) -> dict[str, object]:
        """Return how the run ended and where it is."""
        return {
            "outcome": self.outcome,
            **({"reason": self.reason} if self.reason else {}),
            "folder": self.folder,
            "bench time, s": self.duration_s,
        }


def run_procedure(request: RunRequest) -> RunResult:
    """Run a procedure and return how it ended; the folder is complete whatever happened.

    Raises only what prevents a record from being made at all: BenchInUse, RecordError, ConfigurationError, and
    LimitExceeded for parameters that demand what the bench file forbids; and
    RunUnsealed, with what became of the bench, if the folder of a run that was driven cannot be closed.
    """
    procedure, file = request.procedure, request.file
    procedure.check_bench(file)
    beyond = list(beyond_limits(procedure.demands(request.parameters), file))
    require_none_beyond(beyond, file, "the run", procedure.name)
    if late := overdue(file.calibration, utc_now()):
        _refuse_overdue(late, file)
    if file.safe.watchdog and not file.bench.clock and not (hasattr(os, "pidfd_open") or HOLDS_PROCESSES):
        raise ConfigurationError(
            "this system has no watchdog: nobody would stop the bench if this process died",
            where=file.bench.name,
            expected="Linux, or Windows (untried)",
            remedy="`watchdog = false` in [safe], and somebody who stays with the bench",
        )
    if request.lease is None:
        with take_lease(request.file, f"run {request.run_id or request.procedure.name}") as lease:
            return _run(replace(request, lease=lease))
    return _run(request)


def _run(request: RunRequest) -> RunResult:
    record = RunRecord.create(
        request.runs_folder,
        request.run_id,
        request.procedure.name,
        request.parameters.model_dump(),
        request.file,
        request.emulated or (by_file.model_dump() if (by_file := request.file.bench.emulated) else None),
    )
    if request.procedure.text:
        record.keep_procedure(request.procedure.text)
    if (starter := request.started_by) is not None:
        record.event(0.0, Started(starter.name, role=starter.role))
    for late in overdue(request.file.calibration, record.started_utc):
        text = (
            f"the calibration of {late.quantity} ({late.instrument}, {late.certificate}) was due {late.due}"
        )
        facts = {"quantity": late.quantity, "certificate": late.certificate, "due": str(late.due)}
        record.event(0.0, Alarm("calibration", text, "calibration_overdue", facts))
    if request.live is not None:
        request.live.begin_run(
            record.folder,
            run_id=record.folder.name,
            procedure=request.procedure.name,
            expected_s=request.procedure.expected_duration_s(request.parameters),
            started_utc=record.started_utc,
            units={gyro.name: gyro.unit for gyro in request.file.gyro},
            bench=request.file.bench.name,
            auxiliary={str(number): name for number, name in request.file.chamber.auxiliary.items()},
            emulated=bool(request.emulated or request.file.bench.emulated or request.file.bench.clock),
        )
    outcome, reason, duration_s = "aborted", "", 0.0
    error: BaseException | None = None
    safe: list[SafeState] = []
    try:
        with ExitStack() as stack:
            clock = open_clock(request.file.bench.clock)
            stack.callback(clock.close)
            if request.emulated is None and isinstance(clock, VirtualClock) and clock.emulated:
                record.emulated(clock.emulated)
            stack.enter_context(asking(clock))
            if request.live is not None:
                paced = request.file.bench.clock is not None
                stack.enter_context(request.live.steering(clock.interrupt, paced=paced))
            try:
                bench = _drive(request, record, clock, stack, safe)
            finally:
                duration_s = clock.now()
        outcome = "invalid" if bench.invalid_reasons else "completed"
        reason = "; ".join(invalid.text for invalid in bench.invalid_reasons)
        if request.before_close is not None:
            request.before_close(record.folder)
    except BenchError as problem:
        outcome, error, reason = "aborted", problem, str(problem)
        if request.before_close is not None:
            with suppress(BenchError, OSError):  # what it asks may be what is gone
                request.before_close(record.folder)
    except MemoryError as problem:
        outcome, error, reason = "aborted", problem, "the computer has no memory left"
    except KeyboardInterrupt as problem:  # before or after the time in which Ctrl-C asks the bench to stop
        outcome, error, reason = "aborted", problem, "stopped by Ctrl-C"
        raise
    except BaseException as problem:
        outcome, error, reason = "aborted", problem, f"{type(problem).__name__}: {problem}"
        raise
    finally:
        if unsafe := [str(state) for state in safe if not state.confirmed]:
            outcome = "aborted"
            reason = f"{reason} NOT CONFIRMED SAFE, go and look: {'; '.join(unsafe)}".strip()
        with held("the record is being closed"):
            try:
                sealed, warnings = record.close(outcome, reason, duration_s, error)
            except RecordError as problem:
                if request.live is not None:
                    request.live.end("aborted", f"{reason} {problem}".strip(), safe=safe)
                raise _unsealed(record.folder, problem, outcome, reason, safe) from problem
            if request.live is not None:
                request.live.end(sealed.outcome, sealed.reason, warnings, error=error, safe=safe)
    return RunResult(record.folder, sealed.outcome, sealed.reason, duration_s, error, warnings, tuple(safe))


def _refuse_overdue(late: Sequence[Calibration], file: BenchFile) -> None:
    if file.limits.overdue == "refuse":
        raise ConfigurationError(
            "a calibration is overdue, and the bench file refuses such a run",
            where="calibration",
            found="; ".join(f"{item.quantity}, {item.certificate}, due {item.due}" for item in late),
            expected="calibrations that hold today ([limits] overdue)",
            remedy="calibrate and enter the new certificate, or set overdue to 'say'",
        )


def _unsealed(
    folder: Path, problem: RecordError, outcome: str, reason: str, safe: Sequence[SafeState]
) -> RunUnsealed:
    """Say what became of the bench first, then of the record: nothing but this text tells the operator."""
    bench = "; ".join(map(str, safe)) or "nothing was told to move or to heat"
    ended = f"the run ended as {outcome}" + (f": {reason}" if reason else "")
    return RunUnsealed(
        f"the run folder could not be closed. Bench: {bench}",
        where=str(folder),
        found=f"{problem.found}; {ended}",
        expected=problem.expected,
        remedy=f"what is on the disk can be read: with the folder back and room on its disk, "
        f"`gyrobench runs recover {quote(str(folder))}` completes it",
    )


def _drive(
    request: RunRequest, record: RunRecord, clock: Clock, stack: ExitStack, safe: list[SafeState]
) -> Bench:
    """Run the procedure; `safe` takes what became of table and chamber afterwards."""
    file = request.file
    tests = request.procedure.tests
    displays = [display for display in (request.display, request.live) if display is not None]
    bench = Bench(file, clock, record, request.operator, displays, request.live, tests)
    watchdog = None
    if isinstance(clock, WallClock) and file.safe.watchdog and request.lease is not None:
        # makes the bench safe if this process dies
        watchdog = Watchdog(file, record.folder, request.lease, bench.alert, clock.interrupt.request)
        stack.callback(watchdog.dismiss)
        clock.pulse = watchdog.beat
    table = open_table(file, clock, record.tap("table"))
    stack.callback(table.link.close)
    chamber = open_chamber(file, clock, record.tap("chamber"))
    stack.callback(chamber.link.close)
    bench.install(table, chamber, tuple(file.chamber.auxiliary))
    record.identify("table", "table", file.table.driver, table.identify())
    record.identify("chamber", "chamber", file.chamber.driver, chamber.identify())
    for name in file.all_instruments:
        _open_instrument(bench, record, clock, name, stack)
    demands = request.procedure.demands(request.parameters)
    bench.table.check(demands.max_rate_dps)
    bench.chamber.check_sensors()
    bench.chamber.check(demands.min_temp_c, demands.max_temp_c, demands.max_ramp_k_per_min)
    for gyro in file.gyro:
        bench.gyros[gyro.name] = GyroStation(load_kind("gyro", gyro.driver), gyro)
        bench.gyros[gyro.name].heed = partial(_heed, bench)
    for platform in file.platform:
        bench.platforms[platform.name] = PlatformStation(load_kind("platform", platform.driver), platform)
    streams = _power_and_open(bench, record, clock, stack)
    if watchdog is not None:
        stack.callback(watchdog.dismiss)  # before the ports are closed, which may take its time
    stack.callback(lambda: safe.extend(bench.safe))
    try:
        for device, station in streams:
            device.start()
            record.stream_starts(station.name, device.link.bytes_received)
            bench.listen(device, station)
        if watchdog is not None:
            watchdog.arm()
        bench.table.confine()
        bench.poll()
        request.procedure.run(bench, request.parameters)
    except BaseException as problem:
        bench.make_safe(str(problem) if isinstance(problem, BenchError) else type(problem).__name__)
        raise
    bench.make_safe("end of the run", "end_of_run")
    for device, station in streams:
        if station.gone:
            continue
        try:
            device.stop()
        except (DeviceRefused, DeviceSilent, ProtocolError, WrongDevice) as problem:
            # a unit that no longer listens changes nothing of what was measured
            bench.note(f"{station.name} was not stopped: {problem}")
    return bench


def _heed(bench: Bench, gyro: str, start_s: float, end_s: float, mean_dps: float) -> None:
    """Declare the run invalid if the table turned and what a procedure evaluates hardly felt it."""
    if reason := bench.table.mountings.not_felt(gyro, start_s, end_s, mean_dps):
        bench.alert(reason)


def _power_and_open(
    bench: Bench, record: RunRecord, clock: Clock, stack: ExitStack
) -> list[tuple[Gyro, StreamStation]]:
    """Give the units power where a supply feeds them, and open them; supplies are made safe if that fails."""
    units = zip((*bench.file.gyro, *bench.file.platform), bench.units, strict=True)
    try:
        for supply in bench.instruments.supplies:
            supply.device.prepare()
        if waits_s := [supply.start_s for supply in bench.instruments.supplies if supply.turn_on()]:
            clock.sleep(max(waits_s))  # units that were without power begin to speak
        return [_open_unit(record, clock, unit, station, stack) for unit, station in units]
    except BaseException:
        bring_to_rest({supply.name: supply.device for supply in bench.instruments.supplies}, clock)
        raise


def _open_instrument(bench: Bench, record: RunRecord, clock: Clock, name: str, stack: ExitStack) -> None:
    """Open an instrument beside table and chamber and put it in place; a supply switches nothing yet."""
    role, section = bench.file.all_instruments[name]
    device = open_instrument(bench.file, name, clock, record.tap(name))
    stack.callback(device.link.close)
    record.identify(name, role, section.driver, device.identify())
    if isinstance(section, SupplyConfig):
        bench.instruments.add(SupplyStation(section, cast(Supply, device), bench))
    else:
        device.prepare()
        made_safe = load_kind(role, section.driver).made_safe
        bench.instruments.add(InstrumentStation(section, device, bench, made_safe=made_safe))


def _open_unit(
    record: RunRecord, clock: Clock, config: UnderTestConfig, station: StreamStation, stack: ExitStack
) -> tuple[Gyro, StreamStation]:
    """Open a unit under test whose bytes go to the record and its station; return device and station."""
    tap = StreamTap(record.tap(config.name), station.take)
    device = load_kind(station.role, config.driver).open(config, Connection(config.name, clock, tap))
    stack.callback(device.close)
    record.identify(config.name, station.role, config.driver, device.identify(), config)
    if isinstance(station, PlatformStation):
        station.device = device
    return device, station
