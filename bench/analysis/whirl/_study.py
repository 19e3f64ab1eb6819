"""A whirl study: lines chosen and fitted on some runs, judged on others, beside the patent's own fit."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from bench.analysis.common.runs import require_different
from bench.analysis.whirl._attitude import (
    Oscillation,
    carrier_tilt,
    locked_tilt,
    oscillation,
    uncompensated,
    unit_attitude,
)
from bench.analysis.whirl._base import BaseMotion
from bench.analysis.whirl._change import change_findings
from bench.analysis.whirl._checks import earth_rate_findings
from bench.analysis.whirl._compensation import WhirlCompensation
from bench.analysis.whirl._direct import DEFAULT_LINES, DirectFit, fit_memory, installation_known
from bench.analysis.whirl._gauge import Gauge
from bench.analysis.whirl._integral import body_lines, fit_integral, match_coefficients
from bench.analysis.whirl._kinematics import body_tilt
from bench.analysis.whirl._lines import CANDIDATES, choose_lines, scan_lines
from bench.analysis.whirl._residual import heading_from_body_rate
from bench.analysis.whirl._runs import Turns, load_turns
from bench.analysis.whirl._types import Complex, Finding, TurnRecord
from bench.record.recording import Run
from bench.record.shown import Shown
from drivers.base.arrays import Array
from drivers.base.errors import ConfigurationError


@dataclass(frozen=True, eq=False)
class Judgement:
    """A run before and after: tilts of the carrier, complex (n + 1,) arcsec, and how much they oscillate.

    `patent` is None where the run fitted on has holes, which the integral cannot cross. `locked`: times (n + 1,)
    and tilts, less a straight line, of the rests before and after, when the mechanism stands still.
    """

    record: TurnRecord
    tilt_before: Complex
    tilt_after: Complex
    before: Oscillation
    after: Oscillation
    patent: Oscillation | None
    locked: tuple[tuple[Array, Complex], ...] = ()

    @property
    def rests_arcsec(self) -> tuple[float, ...]:
        """Rms an axis of the tilt while the mechanism stands still: what no compensation takes away."""
        return tuple(float(np.sqrt((np.abs(tilt) ** 2).mean() / 2.0)) for _, tilt in self.locked)

    @property
    def locked_factor(self) -> float:
        """By how many times the part that is locked to the angle fell."""
        return self.before.locked_arcsec / self.after.locked_arcsec


@dataclass(frozen=True, eq=False, repr=False)
class WhirlStudy(Shown):
    """All of a whirl fit. `judged_on_fitted`: there were no other runs to judge on."""

    fit: DirectFit
    compensation: WhirlCompensation
    judgements: tuple[Judgement, ...]
    judged_on_fitted: bool
    findings: tuple[Finding, ...]
    heading_deg: float

    def shown(self) -> dict[str, object]:
        """Return the unit, the lines fitted, and by how many times the locked part fell."""
        return {
            "unit": self.compensation.unit_id,
            "lines": [f"{line:+g}" for line in self.fit.lines],
            "judged on": [row.record.run_id for row in self.judgements],
            "times less": [row.locked_factor for row in self.judgements],
        }


def study_whirl_runs(
    train: Sequence[Run],
    test: Sequence[Run] = (),
    gyro: str | None = None,
    *,
    gauge: Gauge,
    installation_arcsec: tuple[float, float] | None = None,
    bases: Sequence[Path] = (),
) -> WhirlStudy:
    """Return the study of recorded runs; `gyro`: default the first with axes x, y, z. Errors as `load_turns`.

    `installation_arcsec`: see `load_turns`; None where it is not known. `bases`: logs of a base that moved, one
    for each run, those of `test` last; or the name of the unit that stood on it in every run.
    """
    angles = installation_arcsec or (0.0, 0.0)
    runs = (*train, *test)
    recorded = len(bases) == 1 and any(str(bases[0]) in run.gyros for run in runs)
    if len(bases) == 1 and not recorded and not bases[0].exists():
        raise ConfigurationError(
            "there is no such base",
            where="--base",
            found=str(bases[0]),
            expected="a log of it, or a unit of the runs: "
            + ", ".join(sorted({name for run in runs for name in run.gyros})),
        )
    if bases and not recorded and len(bases) != len(runs):
        raise ConfigurationError(
            "the base's logs do not go with the runs",
            where="--base",
            found=f"{len(bases)} logs",
            expected=f"{len(runs)}, one for each run, those of --test last, or the name of a unit of the runs",
        )
    # a run that judges what was fitted to it would say nothing, one that is there twice too much
    require_different((run.manifest.run_id, run.checksum) for run in runs)
    moves: Sequence[BaseMotion | str | None] = [None] * len(runs)
    if bases:
        moves = [str(bases[0])] * len(runs) if recorded else [BaseMotion.load(path) for path in bases]
    turns = [
        load_turns(run, gyro, installation_arcsec=angles, base=base)
        for run, base in zip(runs, moves, strict=True)
    ]
    fitted, judging = turns[: len(train)], turns[len(train) :]
    checksums = {run.manifest.run_id: run.checksum for run in train}
    return study_whirl(
        fitted, judging, gauge=gauge, checksums=checksums, installation_arcsec=installation_arcsec
    )


def study_whirl(
    train: Sequence[Turns],
    test: Sequence[Turns],
    *,
    gauge: Gauge,
    checksums: dict[str, str] | None = None,
    installation_arcsec: tuple[float, float] | None = None,
) -> WhirlStudy:
    """Fit on `train`, judge on `test` (on `train` if there is none).

    Lines are the default -3 .. 3 and what else of -24 .. 24 is significant at 1 %; travels of play those
    that the data ask for.
    """
    records = [turns.record for turns in train]
    lines = choose_lines(records, CANDIDATES, keep=DEFAULT_LINES)
    fit = fit_memory(records, lines)
    if installation_arcsec is not None:
        fit = replace(fit, declared=installation_known(fit.declared, installation_arcsec))
    findings = [finding for turns in (*train, *test) for finding in turns.findings]
    findings += earth_rate_findings(fit, records[0])
    runs = checksums or {record.run_id: "" for record in records}
    compensation = WhirlCompensation.from_fit(fit, records[0].unit_id, runs, gauge=gauge)
    for turns in test:
        compensation.require_unit(turns.record.unit_id)
    findings += [
        Finding(
            "line",
            f"a line off those fitted, {line.line:.4f} times the table's turn, "
            f"{abs(line.amplitude_arcsec):.2f} arcsec (statistic {line.statistic:.0f}, threshold "
            f"{line.threshold:.1f}): a bearing's cage or rollers. It is not in the compensation, since its phase "
            "is not kept from run to run",
        )
        for line in scan_lines(fit)
    ]
    findings += change_findings(fit, [turns.record for turns in test])
    fourier = None
    if records[0].usable.all():
        fourier = fit_integral(records[0], 2, body_rate_dph=fit.body_rate_dph[0].value)
    return WhirlStudy(
        fit=fit,
        compensation=compensation,
        judgements=tuple(
            judge(turns.record, compensation, fit, fourier, turns.rests) for turns in (test or train)
        ),
        judged_on_fitted=not test,
        findings=tuple(findings),
        heading_deg=heading_from_body_rate(fit.body_rate_dph[0].value),
    )


def judge(
    record: TurnRecord,
    compensation: WhirlCompensation,
    fit: DirectFit,
    fourier: Array | None = None,
    rests: Sequence[TurnRecord] = (),
) -> Judgement:
    """Return a run's carrier attitude without and with a compensation; heading from the fit's Earth rate."""
    heading_deg = heading_from_body_rate(fit.body_rate_dph[0].value)
    attitude = unit_attitude(record, heading_deg)
    angle, time_s = record.angle_rad, record.time_s
    raw = uncompensated(attitude, angle)
    before = carrier_tilt(raw)
    after = carrier_tilt(compensation.carrier_attitude(attitude, angle))
    patent = None
    if fourier is not None:
        lines, amplitudes = body_lines(match_coefficients(fourier))
        patent = oscillation(before - body_tilt(angle, lines, amplitudes), time_s, angle)
    return Judgement(
        record,
        before,
        after,
        oscillation(before, time_s, angle),
        oscillation(after, time_s, angle),
        patent,
        tuple((rest.time_s, locked_tilt(rest, heading_deg)) for rest in rests),
    )


def integrated_residual(fit: DirectFit, at: int = 0) -> tuple[Array, Complex, Complex]:
    """Return time (k,), integrated body tilt and its fit, complex (k,) arcsec, of record `at`; rates taken out.

    Both start at zero: the constant is free.
    """
    blocks = fit.blocks[at]
    start = sum(len(part.first_rad) for part in fit.blocks[:at])
    residual = fit.residual_arcsec[start : start + len(blocks.first_rad)]
    model = np.zeros(len(blocks.first_rad), np.complex128)
    for line, amplitude in zip(fit.lines, fit.amplitudes_arcsec, strict=True):
        model += amplitude * blocks.column(line)
    for travel_deg, jump in zip(fit.travels_deg, fit.plays_arcsec, strict=True):
        model += jump * blocks.play(travel_deg)
    return blocks.last_s, np.cumsum(model + residual), np.cumsum(model)
