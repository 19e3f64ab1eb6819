"""One fit from log to judgement: both models on the calibration, errors before and after on every log."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from bench.analysis.heading._calibration import swings
from bench.analysis.heading._checks import Finding, check_log, check_phase, refuse_unsound, short_stays
from bench.analysis.heading._compensator import HeadingCompensator, PositionCorrector
from bench.analysis.heading._lagged import Form, LaggedModel, choose_input, fit_lagged
from bench.analysis.heading._log import PlatformLog, Stay, settled, stays
from bench.analysis.heading._modulus import ModulusTest, modulus_test
from bench.analysis.heading._nine import NineCoefficients, compensate_nine, fit_nine, integrate
from bench.analysis.heading._second import SecondChoice
from bench.analysis.heading._settling import Settling, TimeConstant, settling
from bench.analysis.heading._window import DEFAULT_WINDOW_S, extract
from bench.record.shown import Shown
from drivers.base.arrays import Array
from drivers.base.constants import SIDEREAL_DAY_S
from drivers.base.errors import RecordError


@dataclass(frozen=True, eq=False)
class Judgement:
    """A log before and after compensation, arcsec, shape (n,), with what the first stay foretells taken off.

    `reduction_percent` = 1 - rms after / rms before, over the time after the first turn. `method` as in the
    report.
    """

    name: str
    method: str
    held_out: bool
    time_s: Array
    north_before_as: Array
    east_before_as: Array
    north_after_as: Array
    east_after_as: Array
    rms_before_as: float
    rms_after_as: float
    outside_share: float

    @property
    def reduction_percent(self) -> float:
        """Reduction of the heading sensitivity of the position error."""
        return 100.0 * (1.0 - self.rms_after_as / self.rms_before_as) if self.rms_before_as else 0.0


@dataclass(frozen=True, eq=False)
class DriftCourse:
    """Drift over a moving window, (n, 3), against the mean temperature change of the last sidereal day, (n,).

    `settled`: no turn for the window and twice the core's time constant; before that drift and temperature of
    two headings are mixed.
    """

    time_s: Array
    drift_dph: Array
    change_k: Array
    settled: NDArray[np.bool_]


@dataclass(frozen=True, eq=False, repr=False)
class HeadingStudy(Shown):
    """`nine` is None where the stays are too short for the window form; `nine_refused` says why.

    Nothing is judged where temperature is not the cause. `second`, `modulus`: of a second temperature and of the
    accelerometers, None where the log has none.
    """

    model: LaggedModel
    nine: NineCoefficients | None
    nine_refused: str
    findings: tuple[Finding, ...]
    judgements: tuple[Judgement, ...]
    course: DriftCourse
    settling: Settling
    second: SecondChoice | None
    modulus: ModulusTest | None

    def shown(self) -> dict[str, object]:
        """Return what drives the drift, and by how much the errors of each log fall."""
        return {
            "cause": self.model.evidence.cause,
            "logs": [row.name for row in self.judgements],
            "reduction, %": [row.reduction_percent for row in self.judgements],
        }


def study_heading(
    calibration: PlatformLog,
    tests: Mapping[str, PlatformLog],
    *,
    form: Form = "lag9",
    window_s: float = DEFAULT_WINDOW_S,
    other_temp_c: Array | None = None,
) -> HeadingStudy:
    """Check and fit `calibration`, then judge both models on it and on the `tests` they never saw.

    Raises RecordError where a log cannot be used, naming everything that forbids it.
    """
    findings = check_log(calibration, other_temp_c=other_temp_c)
    refuse_unsound(findings, "calibration log")
    choice = choose_input(calibration, form)
    model = fit_lagged(calibration, form, second=choice.kind if choice else None)
    times = settling(calibration, TimeConstant(model.tau_s, model.tau_sigma_s, 0.0))
    modulus = modulus_test(calibration)
    findings += [*short_stays(calibration, times.slowest_s + window_s), *times.findings()]
    findings += modulus.findings() if modulus else []
    nine, refused = None, ""
    try:
        nine = fit_nine(calibration, window_s=window_s)
    except RecordError as error:
        refused = str(error)
    judged: list[Judgement] = []
    for name, log in {"calibration": calibration, **tests}.items():
        judged += judge(name, log, model, nine, held_out=log is not calibration)
    course = _course(calibration, model, window_s)
    return HeadingStudy(model, nine, refused, tuple(findings), tuple(judged), course, times, choice, modulus)


def judge(
    name: str, log: PlatformLog, model: LaggedModel, nine: NineCoefficients | None, *, held_out: bool
) -> Sequence[Judgement]:
    """Return the log before and after each model; nothing where temperature is not the cause.

    A held-out log must begin with at least a sidereal day at the reference heading: from it come the start
    misalignment and drift that have nothing to do with heading, and the check of the clock. The periodic
    drift of the reference heading is the calibration's.
    """
    if model.evidence.cause != "temperature":
        return []
    first = stays(log)[0]
    if held_out:
        rows = slice(first.start, first.stop)
        check_phase(model.reference, log.sidereal_rad[rows], log.temp_c[rows])
    swung = integrate(log.time_s, swings(log.sidereal_rad) @ model.swing.T)
    done = HeadingCompensator(model, log.latitude_deg).feed(
        log.time_s, log.sidereal_rad, log.temp_c, log.second_c
    )
    made: list[tuple[str, Array, float]] = [(model.form, done.phi_as, float(done.outside.mean()))]
    if nine is not None:
        made.append(("nine coefficients", compensate_nine(nine, log), 0.0))
    before = without_start(name, log, first, swung)
    judged = []
    for method, phi, outside in made:
        after = without_start(name, log, first, swung + phi)
        judged.append(
            Judgement(
                name=name,
                method=method,
                held_out=held_out,
                time_s=log.time_s,
                north_before_as=before.north_as,
                east_before_as=before.east_as,
                north_after_as=after.north_as,
                east_after_as=after.east_as,
                rms_before_as=_rms(before, first.stop),
                rms_after_as=_rms(after, first.stop),
                outside_share=outside,
            )
        )
    return judged


def without_start(name: str, log: PlatformLog, first: Stay, phi_as: Array) -> PlatformLog:
    """Return the log less the errors of misalignments `phi_as` and less what its first stay then foretells."""
    left = _corrected(log, phi_as)
    span_s = min(first.duration_s, 2.0 * SIDEREAL_DAY_S)
    begun = extract(
        left.part(first.start, first.stop),
        window_s=max(span_s, SIDEREAL_DAY_S),
        periodic=span_s >= DEFAULT_WINDOW_S,
    )
    if begun is None or not begun.published:
        raise RecordError(
            "the log does not begin with a sidereal day at the reference heading",
            where=name,
            found=f"{first.duration_s / 3600.0:.1f} h at {first.heading_deg:.0f} deg",
            expected=f"{SIDEREAL_DAY_S / 3600.0:.1f} h",
            remedy="without it start misalignment and drift cannot be told from the heading's",
        )
    return _corrected(left, begun.phi_as + np.outer(log.time_s - begun.time_s, begun.eps_dph))


def _corrected(log: PlatformLog, phi_as: Array) -> PlatformLog:
    corrector = PositionCorrector(log.latitude_deg, log.delay_s)
    north, east = corrector.correction(log.time_s, log.sidereal_rad, phi_as)
    return replace(log, north_as=log.north_as - north, east_as=log.east_as - east)


def _course(log: PlatformLog, model: LaggedModel, window_s: float) -> DriftCourse:
    """Slide the window over the log, an estimate an hour."""
    step_s = float(np.median(np.diff(log.time_s)))
    change = log.temp_c - model.reference.at(log.sidereal_rad)
    hops = np.searchsorted(log.time_s, np.arange(log.time_s[0], log.time_s[-1] + 1.0, 3600.0))
    calm = settled(log, window_s + 2.0 * model.tau_s)
    rows = []
    for stop in (*hops[1:], len(log.time_s)):
        end_s = log.time_s[stop - 1]
        if end_s - log.time_s[0] < 0.98 * window_s:
            continue
        part = log.part(int(np.searchsorted(log.time_s, end_s - window_s)), stop)
        estimate = extract(part, window_s=window_s, sample_s=step_s)
        if estimate is not None and estimate.published:
            lately = (log.time_s <= end_s) & (log.time_s > end_s - SIDEREAL_DAY_S)
            rows.append((end_s, *estimate.eps_dph, float(np.nanmean(change[lately])), calm[stop - 1]))
    table = np.array(rows, dtype=np.float64).reshape(-1, 6)
    return DriftCourse(table[:, 0], table[:, 1:4], table[:, 4], table[:, 5] > 0.0)


def _rms(log: PlatformLog, start: int) -> float:
    square = log.north_as[start:] ** 2 + log.east_as[start:] ** 2
    return float(np.sqrt(np.nanmean(square))) if np.isfinite(square).any() else 0.0
