"""A bench as ophyd-async devices, for plans of bluesky. It comes with the extra `bluesky`.

    from bluesky import RunEngine, plans
    from gyrobench.bluesky import BenchDevices

    engine = RunEngine()
    with BenchDevices("examples/demo.toml", emulated=True) as bench:
        engine(plans.list_scan([bench.table.angle_deg], bench.table.rate_dps, [0.0, 5.0, -5.0]))

While it is open, one run of the procedure `bluesky` has the bench: lease, limits, watchdog, record and safe state
are those of every run. What the limits forbid is not sent, and fails the plan; trouble of the bench ends the run
and fails every move that is under way. On an emulated bench time goes on only while something moves: setting
`bench.time_s` waits.
"""

from __future__ import annotations

import asyncio
import math
import queue
import threading
from collections.abc import Awaitable, Callable
from concurrent.futures import Future
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, Self

from bluesky.protocols import Movable, Reading, Stoppable
from ophyd_async.core import (
    AsyncStatus,
    StandardReadable,
    StandardReadableFormat,
    soft_signal_r_and_setter,
)

from bench.control.by_hand import Bounds, Order, obey
from bench.control.procedure import find_procedure
from bench.control.runner import RunResult
from bench.control.session import Bench
from bench.record.benchfile import BenchFile
from drivers.base.errors import RunAborted
from gyrobench._operate import rehearse, run

_LOOK_S = 0.2
_ROWS = 3
"""So many rows of telemetry, one after the other, have to be near what was ordered."""


class _Move:
    """An order, when it counts as carried out, and who waits for it; without an order it is only waited for."""

    def __init__(self, order: Order | None, near: Callable[[Bench], bool], rows: int) -> None:
        self.order, self.done = order, Future[None]()
        self._near, self._rows, self._count, self._row_s = near, rows, 0, -math.inf

    def finished(self, bench: Bench) -> bool:
        """Look at the newest telemetry; tell who waits once it was near often enough."""
        row_s = bench.chamber.history.last["time_s"] if self._rows > 1 else bench.now_s
        if row_s > self._row_s:
            self._row_s = row_s
            self._count = self._count + 1 if self._near(bench) else 0
        if self._count >= self._rows:
            self.done.set_result(None)
        return self.done.done()


class BenchDevices:
    """A bench, open for plans: `table.angle_deg`, `table.rate_dps`, `chamber.air_temp_c` are read and set.

    `bench`: a bench file. `emulated`: an emulated lab that matches it, in virtual time. `runs`: folder for the
    run's record. `within_c`: how near the air has to come to its set point, K. `bounds`: parameters of the
    procedure `manual` (max_rate_dps, low_c, high_c, ramp_k_per_min). Setting `time_s` waits for that bench time.

    Opening raises BenchInUse if somebody else has the bench, ConfigurationError for what cannot be used.
    """

    def __init__(
        self,
        bench: BenchFile | Path | str,
        *,
        emulated: bool = False,
        runs: Path | str = "runs",
        within_c: float = 0.5,
        **bounds: float,
    ) -> None:
        manual = find_procedure("manual")
        procedure = replace(manual, name="bluesky", title="Driven by plans of bluesky", run=self._serve)
        open_bench: Callable[..., RunResult] = rehearse if emulated else partial(run, yes=True)
        self._run = partial(open_bench, procedure, bench, runs, **{"idle_min": 1440.0, **bounds})
        self._stands_still = emulated
        self._moves: queue.SimpleQueue[_Move | None] = queue.SimpleQueue()
        self._opened: Future[Bench] = Future()
        self._thread = threading.Thread(target=self._hold, name="gyrobench bluesky", daemon=True)
        self.result: RunResult | None = None
        """How the run ended, once the bench is closed; its `folder` has the record."""
        self.table, self.chamber = Table(self), AirChamber(self, within_c)
        self.time_s = Demand("time_s", "s", lambda bench: bench.now_s, self._until, lambda: None)

    def __enter__(self) -> Self:
        self._thread.start()
        bench = self._opened.result()
        for demand in (self.table.angle_deg, self.table.rate_dps, self.chamber.air_temp_c, self.time_s):
            demand.bench = bench
        return self

    def __exit__(self, *_: object) -> None:
        self._moves.put(None)
        self._thread.join()

    async def move(self, order: Order | None, near: Callable[[Bench], bool], rows: int = _ROWS) -> None:
        """Give an order and wait until telemetry is near it; LimitExceeded where the limits forbid it."""
        move = _Move(order, near, rows)
        if self._thread.is_alive():
            self._moves.put(move)
        else:
            move.done.set_exception(RunAborted("the bench is closed"))
        await asyncio.wrap_future(move.done)

    def send(self, order: Order) -> None:
        """Give an order that nobody waits for."""
        self._moves.put(_Move(order, lambda _: True, 1))

    async def _until(self, time_s: float) -> None:
        await self.move(None, lambda bench: bench.now_s >= time_s, 1)

    def _hold(self) -> None:
        try:
            self.result = self._run()
        except BaseException as error:
            if self._opened.done():
                raise
            self._opened.set_exception(error)
        else:
            if not self._opened.done():
                self._opened.set_exception(self.result.error or RunAborted(self.result.reason))

    def _serve(self, bench: Bench, p: Any) -> None:
        """Do what plans order until the bench is closed; runs in the thread that has the bench."""
        bounds = Bounds(p.max_rate_dps, p.low_c, p.high_c, p.ramp_k_per_min)
        pending: list[_Move] = []
        try:
            with bench.step("B1", "Driven by plans of bluesky"):
                bench.phase("bluesky")
                bench.table.engage()
                if len(bench.table.axes) == 1:
                    bench.table.confine(p.max_rate_dps)
                bench.wait(1.0, "the first telemetry")
                self._opened.set_result(bench)
                while self._begun(bench, bounds, pending):
                    if pending or not self._stands_still:
                        bench.wait(_LOOK_S, "driven by plans")
                    pending[:] = [move for move in pending if not move.finished(bench)]
        except BaseException as error:
            for move in pending:
                move.done.set_exception(error)
            raise

    def _begun(self, bench: Bench, bounds: Bounds, pending: list[_Move]) -> bool:
        """Begin the next move, if there is one; return False when the bench is to be closed."""
        try:
            move = self._moves.get(block=self._stands_still and not pending)
        except queue.Empty:
            return True
        if move is None:
            return False
        pending.append(move)
        refused = None if move.order is None else obey(bench, move.order, bounds)
        if refused is not None:
            move.done.set_exception(refused)
            pending.remove(move)
        return True


class Demand(StandardReadable, Movable, Stoppable):  # type: ignore[misc]
    """A quantity of the bench: read from its telemetry, and set, which ends when telemetry shows it reached."""

    bench: Bench

    def __init__(
        self,
        name: str,
        unit: str,
        read: Callable[[Bench], float],
        move: Callable[[float], Awaitable[None]],
        stop: Callable[[], None],
    ) -> None:
        self._newest, self._move, self._stop = read, move, stop
        with self.add_children_as_readables(StandardReadableFormat.HINTED_SIGNAL):
            self.readback, self._put = soft_signal_r_and_setter(float, units=unit, precision=4)
        super().__init__(name)
        self.readback.set_name(name)

    async def read(self) -> dict[str, Reading[Any]]:
        """Return the newest telemetry, under the quantity's name."""
        self._put(self._newest(self.bench))
        reading: dict[str, Reading[Any]] = await super().read()
        return reading

    @AsyncStatus.wrap  # type: ignore[untyped-decorator]
    async def set(self, value: float) -> None:
        """Go to a value within the limits, and be done when telemetry shows it."""
        await self._move(value)

    async def stop(self, success: bool = True) -> None:
        """Come to rest; bluesky calls it when a plan fails or is stopped."""
        self._stop()


class Table:
    """The rate table: `angle_deg` and `rate_dps` of the axis that carries the unit."""

    def __init__(self, devices: BenchDevices) -> None:
        def angle_deg(bench: Bench) -> float:
            return bench.table.angle_deg()

        def rate_dps(bench: Bench) -> float:
            return bench.table.history.last["rate_dps"]

        async def point(value: float) -> None:
            def near(bench: Bench) -> bool:
                off_deg = (angle_deg(bench) - value + 180.0) % 360.0 - 180.0
                return abs(off_deg) < 0.01 and abs(rate_dps(bench)) < 0.01

            await devices.move(Order("point", value), near)

        async def spin(value: float) -> None:
            tolerance_dps = 1e-3 * abs(value) + 0.005
            await devices.move(
                Order("spin", value), lambda bench: abs(rate_dps(bench) - value) < tolerance_dps
            )

        def stop() -> None:
            devices.send(Order("stop"))

        self.angle_deg = Demand("table_angle_deg", "deg", angle_deg, point, stop)
        self.rate_dps = Demand("table_rate_dps", "deg/s", rate_dps, spin, stop)


class AirChamber:
    """The thermal chamber: `air_temp_c`. Stopped, it holds the set point that it has."""

    def __init__(self, devices: BenchDevices, within_c: float) -> None:
        def air_temp_c(bench: Bench) -> float:
            return bench.chamber.history.last["air_temp_c"]

        async def go_to(value: float) -> None:
            await devices.move(Order("air", value), lambda bench: abs(air_temp_c(bench) - value) < within_c)

        self.air_temp_c = Demand("chamber_air_temp_c", "degC", air_temp_c, go_to, lambda: None)
