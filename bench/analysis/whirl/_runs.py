"""From a run folder to a `TurnRecord`: the gyro on a grid without holes, the table's angle at every sample."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bench.analysis.common.even_rows import row_places
from bench.analysis.common.statistics import on_grid
from bench.analysis.whirl._angle import Alignment, align_angle
from bench.analysis.whirl._base import BaseMotion, without_base
from bench.analysis.whirl._checks import alignment_findings, require_fit_for_whirl, rotation_findings
from bench.analysis.whirl._types import Finding, TurnRecord
from bench.record.recording import Run, seconds
from drivers.base.arrays import Array
from drivers.base.constants import ARCSEC_PER_RAD
from drivers.base.errors import ConfigurationError

SENSES = {"turn_forward": 1.0, "turn_reverse": -1.0}
"""Phases of the procedure and the sense of the angle in them."""
_MOVING_DPS = 0.05
_REST_S = 10.0


@dataclass(frozen=True, eq=False)
class Turns:
    """What a run folder gives: the record from first to last movement, how angle and gyro were laid on each other
    (over all of the run, rests included), and what is odd about it. `rests`: before and after, mechanism locked.
    """

    record: TurnRecord
    alignment: Alignment
    findings: tuple[Finding, ...]
    rests: tuple[TurnRecord, ...] = ()


def load_turns(
    run: Run,
    gyro: str | None = None,
    *,
    installation_arcsec: tuple[float, float] = (0.0, 0.0),
    base: BaseMotion | str | None = None,
) -> Turns:
    """Read a run with rotation; `gyro` defaults to the first with axes x, y, z.

    `installation_arcsec`: by how much the x and the y gyro lie towards z, as known; taken out of their rates.
    `base`: how the base moved meanwhile, taken out too; a name is that of a unit which stood on it in this run.

    ConfigurationError if no gyro has three axes; UnfitRotation names a recording that cannot carry a whirl fit.
    """
    name = gyro or next((unit for unit in run.gyros if _has_axes(run, unit)), None)
    if name is None or name not in run.gyros or not _has_axes(run, name):
        raise ConfigurationError(
            "no gyro with the axes x, y and z",
            where=f"run {run.manifest.run_id}",
            found=name or ", ".join(run.gyros) or "no gyros",
            expected="a three-axis unit, z along the table axis",
            remedy='name its axes in the bench file: axes = "xyz"',
        )
    if isinstance(base, str):
        base = _recorded_base(run, base, name)
    edges_s, rate_dps, usable = _on_grid(run, name)
    table = run.turntable()
    poll_s = seconds(table)
    number = np.arange(len(usable))
    for rate in rate_dps.T:
        rate[~usable] = np.interp(number[~usable], number[usable], rate[usable])
    moved: list[Finding] = []
    if base is None:
        angle_rad, alignment = align_angle(edges_s, rate_dps[:, 2], poll_s, table["angle_deg"])
    else:
        rate_dps, angle_rad, alignment, fit = without_base(
            edges_s, rate_dps, poll_s, table["angle_deg"], base
        )
        moved = fit.findings()
    read = TurnRecord(
        run_id=run.manifest.run_id,
        unit_id=run.manifest.unit(name),
        period_s=float((edges_s[-1] - edges_s[0]) / (len(edges_s) - 1)),
        time_s=edges_s,
        rate_dps=rate_dps,
        angle_rad=angle_rad,
        usable=usable,
        latitude_deg=run.manifest.latitude_deg,
    )
    require_fit_for_whirl(read)
    record = corrected(read, installation_arcsec)
    rests = at_rest(record)
    record = while_turning(record)
    announced = _announced(run)
    fastest = float(np.degrees(np.median(np.abs(np.diff(record.angle_rad)))) / record.period_s)
    findings = [*moved, *rotation_findings(record, announced)]
    findings += alignment_findings(alignment, fastest, float(edges_s[-1] - edges_s[0]))
    if missing := int((~record.usable).sum()):
        lost = f"{missing} samples missing or invalid: the blocks of 1 s they lie in were left out"
        findings.append(Finding("gaps", lost))
    return Turns(record, alignment, tuple(findings), rests)


def corrected(record: TurnRecord, installation_arcsec: tuple[float, float]) -> TurnRecord:
    """Return a record whose x and y gyros lie towards z by so much, as if they did not."""
    rate_dps = record.rate_dps.copy()
    rate_dps[:, :2] -= np.outer(rate_dps[:, 2], np.array(installation_arcsec) / ARCSEC_PER_RAD)
    return replace(record, rate_dps=rate_dps)


def while_turning(record: TurnRecord) -> TurnRecord:
    """Return the record from where the table first turns at half its largest rate to where it last does."""
    step = np.abs(np.diff(record.angle_rad))
    fast = np.flatnonzero(step > 0.5 * step.max())
    return _part(record, int(fast[0]), int(fast[-1]) + 1)


def at_rest(record: TurnRecord) -> tuple[TurnRecord, ...]:
    """Return the stretches before the table moves and after it, those of `_REST_S` and more."""
    moving = np.flatnonzero(np.abs(np.diff(record.angle_rad)) > _MOVING_DPS * record.period_s * np.pi / 180.0)
    ends = ((0, int(moving[0])), (int(moving[-1]) + 1, len(record.usable)))
    return tuple(_part(record, *each) for each in ends if (each[1] - each[0]) * record.period_s >= _REST_S)


def _part(record: TurnRecord, first: int, last: int) -> TurnRecord:
    """Return the samples `first` to before `last` of a record."""
    return replace(
        record,
        time_s=record.time_s[first : last + 1],
        angle_rad=record.angle_rad[first : last + 1],
        rate_dps=record.rate_dps[first:last],
        usable=record.usable[first:last],
    )


def _recorded_base(run: Run, name: str, turning: str) -> BaseMotion:
    """Return the rate of the base by a unit of the run that did not turn; ConfigurationError for another one."""
    if name == turning or name not in run.gyros or not _has_axes(run, name):
        raise ConfigurationError(
            "the base's rate cannot be had of this unit",
            where=f"--base, run {run.manifest.run_id}",
            found="the one whose whirl is fitted" if name == turning else name,
            expected="another unit of the run with axes x, y and z, or a log",
            remedy="--gyro names the one to fit" if name == turning else "",
        )
    edges_s, rate_dps, usable = _on_grid(run, name)
    return BaseMotion(0.5 * (edges_s[1:] + edges_s[:-1])[usable], rate_dps[usable])


def _has_axes(run: Run, name: str) -> bool:
    return _section(run, name).get("axes") == "xyz"


def _section(run: Run, name: str) -> dict[str, Any]:
    """Return the gyro's section of the bench file, empty if there is none."""
    return next((section for section in run.manifest.bench.get("gyro", ()) if section["name"] == name), {})


def _on_grid(run: Run, name: str) -> tuple[Array, Array, NDArray[np.bool_]]:
    """Return edges (n + 1,), rates (n, 3) and what is usable (n,), on the gyro's own grid, holes included."""
    under_test = _section(run, name)["axis"]
    # The axis under test has the short name.
    names = ["rate_dps" if axis == under_test else f"rate_{axis}_dps" for axis in "xyz"]
    table = run.gyro(name, ("time_ns", "valid", *names))
    time_s = seconds(table)
    place, period_s = row_places(time_s)
    rate_dps = on_grid(place, np.stack([table[column] for column in names], axis=1, dtype=np.float64))
    usable = np.asarray(np.isfinite(rate_dps).all(axis=1))
    usable[place] &= np.asarray(table["valid"], np.bool_)
    rate_dps[~np.isfinite(rate_dps)] = 0.0
    return time_s[0] + period_s * np.arange(-1, len(usable)), rate_dps, usable


def _announced(run: Run) -> list[tuple[float, float, float]]:
    """Return the stretches that the procedure's phases announce: start, end, signed rate in deg/s."""
    rate = abs(run.manifest.parameter("rate_dps") or 0.0)
    if not rate:
        return []
    return [
        (phase.start_s + 2.0, phase.end_s - 2.0, SENSES[phase.name] * rate)
        for phase in run.phases()
        if phase.name in SENSES
    ]
