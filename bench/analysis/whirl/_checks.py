"""What can be wrong with a recording: named, with what follows from it for the whirl."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from bench.analysis.common.statistics import stretches
from bench.analysis.whirl._angle import Alignment
from bench.analysis.whirl._direct import DirectFit
from bench.analysis.whirl._types import Finding, TurnRecord, UnfitRotation
from drivers.base.constants import earth_rate_north_dph

FULL_SCALE_DPS = 490.0
"""Full scale of fibre-optic gyros of this class, by their data sheets."""
_STUCK_S = 1.0
_CLOCK_PPM = 20.0
_RATE_TOLERANCE = 0.3
_SLOWEST = 0.05
_EARTH_TOLERANCE = 0.2


def require_fit_for_whirl(record: TurnRecord, full_scale_dps: float = FULL_SCALE_DPS) -> None:
    """Raise UnfitRotation for less than one full turn, a saturated or stuck gyro."""
    covered = float(np.ptp(record.angle_rad)) / (2.0 * np.pi)
    if covered < 1.0:
        raise UnfitRotation(
            "less than one full turn",
            where=f"run {record.run_id}",
            found=f"{covered:.2f} turns",
            expected="at least one full turn, better ten",
            remedy="turn further; lines of a part of a turn cannot be told from each other, from drift "
            "and from Earth rate, and a compensation made of them would be arbitrary",
        )
    for axis, rate in zip("xyz", record.rate_dps.T, strict=True):
        known = rate[record.usable]
        railed = int((np.abs(known) >= 0.999 * full_scale_dps).sum())
        if railed:
            raise _saturated(record, f"{railed} samples of {axis} at {full_scale_dps:g} deg/s")
    moving = np.abs(np.diff(record.angle_rad)) > _SLOWEST * np.abs(np.diff(record.angle_rad)).max()
    for axis, rate in zip("xy", record.rate_dps.T[:2], strict=True):
        stuck = stretches((np.diff(rate) == 0.0) & moving[1:] & record.usable[1:])
        longest = float(np.diff(stuck).max(initial=0)) * record.period_s
        if longest > _STUCK_S:
            raise _saturated(record, f"{axis} does not change for {longest:.1f} s while the table turns")


def rotation_findings(
    record: TurnRecord, announced: Sequence[tuple[float, float, float]]
) -> Iterator[Finding]:
    """Yield where the table did not turn as announced.

    `announced`: (start_s, end_s, rate_dps) of the stretches, signed rate. Rates are looked at over 1 s.
    """
    size = max(1, round(1.0 / record.period_s))
    rate = np.degrees(np.diff(record.angle_rad[::size])) / (size * record.period_s)
    time_s = 0.5 * (record.time_s[::size][1:] + record.time_s[::size][:-1])
    for start_s, end_s, rate_dps in announced:
        part = (time_s > start_s) & (time_s < end_s)
        share = rate[part] / rate_dps
        for what, odd in (
            ("turned backwards", share < -_RATE_TOLERANCE),
            ("stopped or slowed down", (share >= -_RATE_TOLERANCE) & (share < 1.0 - _RATE_TOLERANCE)),
            ("turned too fast", share > 1.0 + _RATE_TOLERANCE),
        ):
            if odd.any():
                at = float(time_s[part][int(np.argmax(odd))])
                yield Finding(
                    "rotation",
                    f"the table {what} unannounced at {at:.0f} s, for {int(odd.sum())} s in all: the "
                    "direct fit follows the measured angle and stays right, with fewer turns than "
                    "planned; a fit at the nominal angle, and a plot against it, would be wrong from "
                    "there on",
                )


def alignment_findings(alignment: Alignment, rate_dps: float, duration_s: float) -> Iterator[Finding]:
    """Yield what the z gyro laid on the encoder shows: clocks that run apart, stamps that are late."""
    clock = alignment.clock_error_ppm
    if clock is not None and abs(clock) > _CLOCK_PPM:
        off_deg = abs(clock) * 1e-6 * duration_s * rate_dps
        yield Finding(
            "clock_drift",
            f"the clocks of table and gyro run apart by {clock:+.1f} ppm: at the end the angle would be "
            f"{off_deg:.3f} deg off, and of a tilt of 10 arcsec on line 1 "
            f"{10.0 * np.radians(off_deg):.3f} arcsec would stay; it was estimated and taken out",
        )
    if clock is None:
        yield Finding(
            "clock_unknown",
            "whether the clocks of table and gyro run apart does not show in this rotation (it looks "
            "like a scale factor); 100 ppm would turn a line m by m times 2.2 deg in an hour at 6 deg/s: "
            "begin and end at rest",
        )
    if alignment.latency_s is None:
        yield Finding(
            "latency_unknown",
            "how late the table's angles are stamped does not show in this rotation; it turns every line m by m "
            "w times the delay, alike in every run of the same rate and sense: begin and end at rest",
        )


def earth_rate_findings(fit: DirectFit, record: TurnRecord) -> Iterator[Finding]:
    """Check the body rate of a fit against Earth rate; UnfitRotation if it turns up as a line instead.

    A horizontal gyro with the wrong sign reflects the rate vector, so that Earth rate, constant in body axes,
    is found on line 2: 11.7 deg/h at 6 deg/s looks like 55 arcsec of whirl.
    """
    expected, rate = earth_rate_north_dph(record.latitude_deg), fit.body_rate_dph[0]
    off = abs(abs(rate.value) - expected)
    if off <= _EARTH_TOLERANCE * expected + 5.0 * rate.sd:
        return
    if 2.0 in fit.lines and abs(rate.value) < 0.5 * expected:
        speed = float(np.median(np.abs(np.diff(record.angle_rad)))) / record.period_s
        as_line = expected / (2.0 * speed) if speed else float("inf")
        if abs(abs(fit.amplitude(2.0).value) - as_line) < 0.5 * as_line:
            raise UnfitRotation(
                "one of the horizontal gyros has the wrong sign",
                where=f"run {record.run_id}",
                found=f"no Earth rate in the body ({abs(rate.value):.2f} deg/h), and {as_line:.0f} arcsec "
                "of it on line 2",
                expected=f"{expected:.2f} deg/h that stands still in the body",
                remedy="correct the sign of x or y; compensated with it, the attitude would get worse",
            )
    yield Finding(
        "level",
        f"the rate that stands still in the body is {abs(rate.value):.3f} deg/h, horizontal Earth rate "
        f"is {expected:.3f} deg/h: check latitude, level and the signs of the axes",
    )


def _saturated(record: TurnRecord, found: str) -> UnfitRotation:
    return UnfitRotation(
        "a gyro is saturated or stuck",
        where=f"run {record.run_id}",
        found=found,
        expected="rates inside the measuring range that change from sample to sample",
        remedy="turn more slowly, or repair the axis; the missing rate would look like whirl",
    )
