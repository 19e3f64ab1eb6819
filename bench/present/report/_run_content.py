"""What reports show of a run, read from its record.

A number that is not known is None or NaN and is printed as a dash; a part that is empty leaves no section. Text
may come from anywhere (a device's answer, a manifest): it is escaped when it is printed.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from bench.present.report._run_notes import Attached, attached_notes
from bench.present.sentences import safe_sentence, sentence
from bench.record.events import Event
from bench.record.events.run import Alarm, Answer, Measured, Series
from bench.record.events.safe import SafeState
from drivers.base.arrays import Array
from drivers.base.errors import RecordError

if TYPE_CHECKING:
    from bench.analysis.common.uncertainty import Budget
    from bench.record.recording import Manifest, Run

_BLOCKS_S = (100.0, 10.0)
"""Length of the means of the output; the shorter one where the table's rate changes in most of the longer."""
_TURNING_DPS = 0.05

Table = Mapping[str, Any]


@dataclass(frozen=True, eq=False)
class Trace:
    """What one gyro saw over a run. `time_s` and the temperatures have shape (n,); None where not measured.

    `output_time_s` and `output_dph`, shape (m,), are means over `output_block_s`, in deg/h, of what `output_name`
    says.
    `phases` are (start_s, name), each lasting until the next.
    """

    run_id: str
    time_s: Array
    phases: Sequence[tuple[float, str]] = ()
    air_temp_c: Array | None = None
    set_point_c: Array | None = None
    case_temp_c: Array | None = None
    gyro_temp_c: Array | None = None
    supply_a: Array | None = None
    """Current of the supply's output that feeds the unit."""
    output_time_s: Array | None = None
    output_dph: Array | None = None
    output_name: str = "Bias"
    output_block_s: float = _BLOCKS_S[0]
    gyro: str = ""


@dataclass(frozen=True, eq=False)
class RunContent:
    """A run as reports show it: its manifest, what its events add to it, and a trace for each gyro.

    `role` says what the run was used for (training, validation, held out), `checksum` is the SHA-256 that ties
    the report to the record.
    """

    manifest: Manifest
    traces: Sequence[Trace] = ()
    reasons: Sequence[str] = ()
    warnings: Sequence[str] = ()
    operator: str = ""
    checksum: str = ""
    role: str = ""
    series: Sequence[Series] = ()
    """What the procedure worked out beside single figures."""
    changed: bool = False
    """Whether the manifest was changed after it was sealed."""
    notes: Sequence[Attached] = ()
    budgets: Mapping[str, Budget] = field(default_factory=dict)
    """The uncertainty budgets of its measurements, by their names."""

    @property
    def run_id(self) -> str:
        """The run's id."""
        return self.manifest.run_id

    @property
    def valid(self) -> bool:
        """Whether the run was completed and met its own criteria."""
        return self.manifest.outcome == "completed" and not self.changed

    @property
    def emulated(self) -> str:
        """Model and seed of the emulated lab, empty for a real bench."""
        lab = self.manifest.emulated
        return "" if lab is None else f"{lab.model}, seed {lab.seed}"

    @property
    def measurements(self) -> list[Measured]:
        """What the procedure measured, judged or not."""
        return [
            Measured(
                row["name"],
                row.get("value"),
                row.get("unit", ""),
                *map(row.get, ("low", "high", "passed", "gyro")),
            )
            for row in self.manifest.measurements
        ]


def run_content(run: Run, role: str = "", *, with_budgets: bool = False) -> RunContent:
    """Return what reports show of a run; parts that the run does not have are left out and warned of.

    `with_budgets`: with the uncertainties of its measurements, which the report of one run shows.
    """
    missing: list[str] = []
    chamber = _table("chamber", run.chamber, missing)
    turntable = _table("turntable", run.turntable, missing)
    traces = tuple(_trace(run, name, chamber, turntable) for name in run.gyros)
    if not traces and chamber is not None:
        traces = (_trace(run, "", chamber, turntable),)
    missing += [
        f"there is no decoded table of {name}" for name in run.manifest.units if name not in run.gyros
    ]
    return RunContent(
        run.manifest,
        traces,
        budgets=_budgets(run, missing) if with_budgets else {},
        reasons=tuple(text for text in (run.manifest.reason, _left_at_rest(run)) if text),
        warnings=_warnings(run, missing),
        operator=", ".join(dict.fromkeys(answer.by for _, answer in run.of(Answer) if answer.by)),
        checksum=run.checksum,
        changed=run.seal == "broken",
        role=role,
        series=tuple(series for _, series in run.of(Series)),
        notes=attached_notes(run.place),
    )


def _budgets(run: Run, missing: list[str]) -> Mapping[str, Budget]:
    if not run.manifest.measurements:
        return {}
    try:
        from bench.analysis.figures import procedure_budgets  # scipy takes its time to import
    except ModuleNotFoundError as error:
        missing.append(
            f"uncertainties are not shown, {error.name} is missing: pip install 'gyrobench[analysis]'"
        )
        return {}
    return procedure_budgets(run)


def _left_at_rest(run: Run) -> str:
    """Return what table and chamber read back when a run that was not completed was made safe."""
    if run.manifest.outcome != "aborted":
        return ""
    last = {state.device: state for _, state in run.of(SafeState)}
    read_back = [safe_sentence(state) for state in last.values() if state.confirmed]
    return f"Read back then: {'; '.join(read_back)}." if read_back else ""


def _warnings(run: Run, missing: list[str]) -> tuple[str, ...]:
    # why it is invalid and what is not confirmed safe in the end stands in the run's reason
    told: list[Event] = [event for _, event in run.of(Alarm)]
    told += [state for _, state in run.of(SafeState) if state.state == "pending"]
    alarms = [sentence(event) for event in told]
    streams = [
        f"{name}: {text}" for name, row in run.manifest.stream.items() for text in row.get("warnings") or ()
    ]
    torn = ["the last line of the event log is incomplete"] if run.event_log.torn else []
    return tuple(dict.fromkeys([*alarms, *streams, *missing, *torn]))


def _table(name: str, read: Callable[[], Table], missing: list[str]) -> Table | None:
    try:
        return read()
    except RecordError:
        missing.append(f"there is no decoded table of the {name}")
        return None


def _trace(run: Run, gyro: str, chamber: Table | None, turntable: Table | None) -> Trace:
    output = run.gyro(gyro, ("time_ns", "rate_dps", "valid", "temp_c")) if gyro else None
    output_time_s = _seconds(output) if output is not None else np.empty(0)
    end_s = max(output_time_s[-1:], default=0.0)
    time_s = np.arange(0.0, end_s + 1.0) if chamber is None else _seconds(chamber)
    device = run.manifest.devices.get(gyro)
    trace = Trace(
        run_id=run.manifest.run_id,
        gyro=gyro,
        time_s=time_s,
        phases=tuple((phase.start_s, phase.name) for phase in run.phases()),
        air_temp_c=_column(chamber, "air_temp_c"),
        set_point_c=_column(chamber, "set_point_c"),
        case_temp_c=_case(run, None if device is None else device.case_sensor, time_s),
        supply_a=_supply(run, gyro, time_s),
    )
    return trace if output is None else _with_output(trace, output, output_time_s, turntable)


def _with_output(trace: Trace, output: Table, time_s: Array, turntable: Table | None) -> Trace:
    """Add the gyro's temperature (10 s means) and its output less the table's rate (means, deg/h).

    A block in which the table's rate changed says nothing about the gyro and is left empty.
    """
    valid = np.asarray(output["valid"], dtype=bool)
    temp_s, temp_c = block_means(time_s, np.asarray(output["temp_c"], dtype=np.float64), 10.0)
    known = np.isfinite(temp_c)
    measured_dps = np.asarray(output["rate_dps"], dtype=np.float64)
    table = None
    if turntable is not None and len(turntable["rate_dps"]):
        table = _seconds(turntable), np.asarray(turntable["rate_dps"], dtype=np.float64)
        measured_dps = np.where(_changing(time_s, *table), np.nan, measured_dps)
    for block_s in _BLOCKS_S:
        middle_s, rate_dps = block_means(time_s[valid], measured_dps[valid], block_s)
        table_dps = np.zeros_like(middle_s)
        if table is None or not len(middle_s):
            break
        table_dps = _steady_rate(*table, middle_s, block_s)
        if np.isfinite(table_dps).mean() > 0.5:
            break
    turned = bool(np.nanmax(np.abs(table_dps), initial=0.0) > _TURNING_DPS)
    gyro_temp_c = (
        np.interp(trace.time_s, temp_s[known], temp_c[known], np.nan, np.nan) if known.any() else None
    )
    return replace(
        trace,
        gyro_temp_c=gyro_temp_c,
        output_time_s=middle_s,
        output_dph=3600.0 * (rate_dps - table_dps),
        output_name="Output less table rate" if turned else "Output",
        output_block_s=block_s,
    )


def block_means(time_s: Array, values: Array, block_s: float) -> tuple[Array, Array]:
    """Return (middle, mean) of the finite values in consecutive blocks of `block_s`; NaN where there are none."""
    if not len(time_s):
        return np.empty(0), np.empty(0)
    finite = np.isfinite(values)
    block = (time_s // block_s).astype(np.int64)
    first = int(block[0])
    count = int(block.max()) - first + 1
    numbers = np.bincount(block[finite] - first, minlength=count)
    sums = np.bincount(block[finite] - first, values[finite], minlength=count)
    means = np.divide(sums, numbers, out=np.full(count, np.nan), where=numbers > 0)
    middle = (np.arange(first, first + count, dtype=np.float64) + 0.5) * block_s
    return middle, means


def _steady_rate(time_s: Array, rate_dps: Array, middle_s: Array, block_s: float) -> Array:
    """Return the table's mean rate in each block; NaN where it changed by more than the reading's own scatter."""
    edges = np.searchsorted(time_s, np.concatenate((middle_s - block_s / 2.0, middle_s[-1:] + block_s / 2.0)))
    means = np.full(len(middle_s), np.nan)
    for block, (start, stop) in enumerate(pairwise(edges)):
        part = rate_dps[start:stop]
        if len(part) and np.ptp(part) <= _TURNING_DPS + 1e-3 * np.abs(part).max():
            means[block] = part.mean()
    return means


def _changing(time_s: Array, table_s: Array, table_dps: Array) -> NDArray[np.bool_]:
    """Return which samples (n,) lie between two readings of the table of which the rates differ."""
    apart = np.abs(np.diff(table_dps)) > _TURNING_DPS + 1e-3 * np.abs(table_dps[1:])
    return np.concatenate(([False], apart, [False]))[np.searchsorted(table_s, time_s)]


def _case(run: Run, sensor: int | None, time_s: Array) -> Array | None:
    if sensor is None:
        return None
    try:
        at_s, temp_c = run.sensor(sensor)
    except RecordError:
        return None
    return np.interp(time_s, at_s, temp_c) if len(at_s) else None


def _supply(run: Run, gyro: str, time_s: Array) -> Array | None:
    supplies = run.manifest.bench.get("supply")
    for section in supplies if isinstance(supplies, list) else ():
        for output in section["outputs"]:
            if gyro in output["units"] and section["name"] in run.manifest.devices:
                try:
                    table = run.readings(section["name"])
                except RecordError:
                    return None
                return np.interp(time_s, _seconds(table), table[f"output_{output['number']}_current_a"])
    return None


def _column(table: Table | None, name: str) -> Array | None:
    if table is None or name not in table:
        return None
    return np.asarray(table[name], dtype=np.float64)


def _seconds(table: Table) -> Array:
    return np.asarray(table["time_ns"], dtype=np.float64) * 1e-9
