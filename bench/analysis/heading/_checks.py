"""What is wrong with a log before it is fitted: named, with what would come of it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bench.analysis.heading._log import PlatformLog, Stay, stays
from bench.analysis.heading._temperature import ReferenceTemperature, fit_reference, fourier_terms
from drivers.base.arrays import Array
from drivers.base.constants import SIDEREAL_DAY_S
from drivers.base.errors import RecordError

STUCK_S = 3.0 * 3600.0
JUMP_AS = 20.0
PHASE_DEG = 3.0
_JUMP_SIGMA = 12.0
_STUCK_SHARE = 0.1
_LEAST_COVERAGE = 0.75
_CLOSURE_K = 0.03
_RESPONSE = 3.0
_CORRELATED_S = 8.0 * 3600.0
_STEADY_S = 2.0 * 3600.0


@dataclass(frozen=True)
class Finding:
    """Something found in a log; `refuse` when a fit must not be made from it."""

    what: str
    consequence: str
    refuse: bool


def check_log(log: PlatformLog, *, other_temp_c: Array | None = None) -> list[Finding]:
    """Return what is wrong with a calibration log, the worst first; nothing when it is sound.

    `other_temp_c`, (n,): another temperature of the record (cabinet, room), to find out whether the two are
    swapped.
    """
    every = stays(log)
    found = [
        *_headings(every),
        *_stuck(log),
        *_jumps(log),
        *_coverage(log),
        *_temperature(log, every, other_temp_c),
    ]
    return sorted(found, key=lambda finding: not finding.refuse)


def short_stays(log: PlatformLog, least_s: float) -> list[Finding]:
    """Return a finding if stays are shorter than `least_s`, the core's time constant and the window."""
    short = [stay for stay in stays(log) if _STEADY_S <= stay.duration_s < least_s - _STEADY_S]
    if not short:
        return []
    shortest = min(short, key=lambda stay: stay.duration_s)
    return [
        Finding(
            f"{len(short)} stays are shorter than time constant and window, {least_s / 3600.0:.1f} h (the "
            f"shortest {shortest.duration_s / 3600.0:.1f} h at {shortest.heading_deg:.0f} deg)",
            "the nine coefficients mix the drift of two headings there; the lagged model needs no steady state",
            False,
        )
    ]


def refuse_unsound(findings: list[Finding], where: str = "") -> None:
    """Raise RecordError naming every finding that forbids a fit."""
    fatal = [finding for finding in findings if finding.refuse]
    if fatal:
        raise RecordError(
            "this log cannot be fitted",
            where=where,
            found="; ".join(finding.what for finding in fatal),
            expected="; ".join(finding.consequence for finding in fatal),
            remedy="correct the record's columns or repeat the run",
        )


def phase_offset_deg(
    reference: ReferenceTemperature, sidereal_rad: Array, temp_c: Array
) -> tuple[float, float]:
    """Return (offset, sigma), deg, of the sidereal angle against the one the reference was counted in.

    From a stay at the reference heading, arrays (n,): the angle at which T_ref fits the temperature best.
    Positive when the angle given runs ahead. sigma is infinite when the temperature has no daily swing.
    """
    good = np.isfinite(temp_c)
    angle, temperature = sidereal_rad[good], temp_c[good]
    steps = np.radians(np.arange(-180.0, 180.0, 2.0))

    def left(shift: float) -> float:
        return float(np.var(temperature - reference.at(angle - shift)))

    best = min(steps, key=left)
    finer = best + np.radians(np.arange(-2.0, 2.0, 0.02))
    offset = float(min(finer, key=left))
    slope = np.gradient(reference.at(angle - offset), angle)
    # The room moves slowly and through the platform's own lag: an independent sample every eight hours.
    span_s = float(angle[-1] - angle[0]) / (2.0 * np.pi) * SIDEREAL_DAY_S
    independent = max(1.0, span_s / _CORRELATED_S)
    swing = float(np.std(slope))
    sigma = np.sqrt(left(offset) / independent) / swing if swing > 0.0 else np.inf
    return float(np.degrees(offset)), float(np.degrees(sigma))


def check_phase(reference: ReferenceTemperature, sidereal_rad: Array, temp_c: Array) -> float:
    """Return the offset in deg; RecordError when the sidereal angle is not the calibration's."""
    offset, sigma = phase_offset_deg(reference, sidereal_rad, temp_c)
    allowed = max(PHASE_DEG, 4.0 * sigma)
    if abs(offset) > allowed:
        minutes = offset / 360.0 * SIDEREAL_DAY_S / 60.0
        left = 200.0 * np.sin(np.radians(min(abs(offset), 180.0)) / 2.0)
        raise RecordError(
            "the sidereal angle is not the one the compensation was calibrated in",
            found=f"the temperature at the reference heading runs {offset:+.1f} +- {sigma:.1f} deg off, "
            f"as if the clock were {minutes:+.0f} min wrong",
            expected=f"within {allowed:.1f} deg",
            remedy="correct the clock's zero or the longitude: as it is the correction would point "
            f"{abs(offset):.0f} deg beside the error and leave {left:.0f} % of it",
        )
    return offset


def _headings(every: list[Stay]) -> Iterator[Finding]:
    steady = [stay for stay in every if stay.duration_s >= _STEADY_S]
    first = every[0].heading_deg if every else 0.0
    others = {round(stay.heading_deg / 4.0) % 90 for stay in steady[1:]} - {round(first / 4.0) % 90}
    if len(others) < 3:
        yield Finding(
            f"{len(others)} steady headings beside the reference",
            "at least three are needed: the reference heading has no temperature change and gives no "
            "equation, so that nine coefficients stay undetermined",
            True,
        )


def _stuck(log: PlatformLog) -> Iterator[Finding]:
    share = float((~np.isfinite(log.temp_c)).mean())
    if share > 1.0 - _LEAST_COVERAGE:
        text = f"{100 * share:.0f} % of the temperatures are missing"
        yield Finding(text, "the lagged temperature would be interpolation for the most part", True)
    starts = np.flatnonzero(np.concatenate([[True], log.temp_c[1:] != log.temp_c[:-1]]))
    ends = np.append(starts[1:], len(log.temp_c)) - 1
    lengths_s = np.where(_within_a_digit(log.temp_c, starts), 0.0, log.time_s[ends] - log.time_s[starts])
    longest = int(np.argmax(lengths_s))
    if lengths_s[longest] >= STUCK_S:
        whole = float(lengths_s[lengths_s >= STUCK_S].sum()) / (log.time_s[-1] - log.time_s[0])
        yield Finding(
            f"the temperature sensor is stuck: exactly {log.temp_c[starts[longest]]:g} degC for "
            f"{lengths_s[longest] / 3600.0:.1f} h from {log.time_s[starts[longest]] / 3600.0:.1f} h on",
            "drift at those headings would be put down to no temperature change, or to another cause",
            bool(whole > _STUCK_SHARE),
        )


def _within_a_digit(temp_c: Array, starts: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Return which stretches of equal values begin and end with a step of the last digit: a slow temperature."""
    steps = np.abs(np.diff(temp_c[starts]))
    known = steps[np.isfinite(steps) & (steps > 0.0)]
    digit = float(known.min()) if len(known) else 0.0
    small = np.isfinite(steps) & (steps < 1.5 * digit)
    return (
        np.concatenate(([False], small[:-1] & small[1:], [False]))
        if len(small) > 1
        else np.zeros(len(starts), bool)
    )


def _jumps(log: PlatformLog) -> Iterator[Finding]:
    for name, error in (("latitude", log.north_as), ("longitude", log.east_as)):
        good = np.flatnonzero(np.isfinite(error))
        if len(good) < 3:
            continue
        step = np.diff(error[good])
        # Across a gap the error may have grown by itself: only steps between neighbours are judged.
        near: NDArray[np.bool_] = np.diff(log.time_s[good]) <= 3.0 * np.median(np.diff(log.time_s))
        spread = 1.4826 * float(np.median(np.abs(step - np.median(step))))
        large = near & (np.abs(step - np.median(step)) > max(JUMP_AS, _JUMP_SIGMA * spread))
        if large.any():
            worst = int(np.argmax(np.where(large, np.abs(step), 0.0)))
            hours = (log.time_s[good[worst + 1]] - log.time_s[0]) / 3600.0
            yield Finding(
                f"{name} jumps {int(large.sum())} times, by {step[worst]:+.0f} arcsec at {hours:.2f} h "
                "(a reset or an update from outside?)",
                "a jump is taken for drift: the record must be cut there, or the resets taken out of it",
                True,
            )


def _coverage(log: PlatformLog) -> Iterator[Finding]:
    step_s = float(np.median(np.diff(log.time_s)))
    expected = (log.time_s[-1] - log.time_s[0]) / step_s + 1.0
    share = np.count_nonzero(np.isfinite(log.north_as) & np.isfinite(log.east_as)) / expected
    if share < _LEAST_COVERAGE:
        yield Finding(
            f"positions cover {100 * share:.0f} % of the run",
            "windows with less than 75 % give no drift; gaps at a window's edge make it up to five "
            "times as uncertain",
            False,
        )


def _temperature(log: PlatformLog, every: list[Stay], other_temp_c: Array | None) -> Iterator[Finding]:
    if not every or not np.isfinite(log.temp_c).any():
        return
    try:
        response_k, known = _response(log, every, log.temp_c)
        other_k = 0.0 if other_temp_c is None else _response(log, every, other_temp_c)[0]
    except RecordError as error:
        yield Finding(error.what + f" ({error.found})", "no reference to count changes from", True)
        return
    if other_k > _RESPONSE * response_k:
        yield Finding(
            f"the temperature columns look swapped: the platform's changes by {response_k:.3f} K with "
            f"heading, the other by {other_k:.3f} K",
            "a temperature that does not follow the heading cannot carry its effect: the gains "
            "would be noise",
            True,
        )
    elif response_k < _RESPONSE * known.residual_k:
        yield Finding(
            f"the temperature does not change with heading: {response_k:.4f} K, noise {known.residual_k:.4f} K "
            "(sensor stuck, swapped, or in the wrong place?)",
            "there is nothing to count a heading effect by",
            True,
        )
    if abs(known.closure_k) > _CLOSURE_K:
        yield Finding(
            f"the reference temperature still moved by {known.closure_k:+.3f} K a day (warm-up, or the room)",
            "what is left of the warm-up counts as heading effect at every later heading: wait longer, "
            "88 h after a start 15 K away",
            False,
        )


def _response(log: PlatformLog, every: list[Stay], temp_c: Array) -> tuple[float, ReferenceTemperature]:
    """Return the largest change of the Fourier terms over stays, K, and the reference it counts from."""
    first = every[0]
    known = fit_reference(log.sidereal_rad[: first.stop], temp_c[: first.stop])
    change = temp_c - known.at(log.sidereal_rad)
    ends = np.array([stay.stop - 1 for stay in every[1:]], dtype=np.int64)
    terms = fourier_terms(log.sidereal_rad, change)
    size = np.abs(np.nan_to_num(terms[ends])).max(initial=0.0)
    return float(size), known
