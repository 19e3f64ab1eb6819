"""A whirl compensation: the fitted tilt, gauge and papers in one file; corrects attitude, batch or stream."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Self

import numpy as np

from bench.analysis.common.compensation import FittedCompensation, provenance
from bench.analysis.whirl._direct import DirectFit
from bench.analysis.whirl._gauge import FREE_PART, MEANING, Gauge, gauge_tilt
from bench.analysis.whirl._kinematics import body_tilt, body_to_true
from bench.analysis.whirl._residual import TRAVEL_DEG, slack
from bench.analysis.whirl._types import Complex
from drivers.base.arrays import Array
from drivers.base.constants import ARCSEC_PER_RAD


@dataclass(frozen=True, eq=False, repr=False)
class WhirlCompensation(FittedCompensation):
    """The tilt of the gyros' frame in body axes as a function of the rotation angle, arcsec, complex: x + j y.

    `lines`, `amplitudes_arcsec`, `sd_arcsec`: (l,). `gauge_arcsec` is the constant that `gauge` stands for.
    `play_arcsec` is added as the table turns back by `travel_deg`. `declared`: what the fit could not tell, in
    words.
    """

    KIND = "whirl"
    WHAT = "whirl"
    SHAPES: ClassVar = {"lines": ("l",), "amplitudes_arcsec": ("l",), "sd_arcsec": ("l",)}
    POSITIVE = ("travel_deg",)

    lines: tuple[float, ...]
    amplitudes_arcsec: Complex
    sd_arcsec: Array
    gauge: Gauge
    gauge_arcsec: complex
    play_arcsec: complex = 0j
    travel_deg: float = TRAVEL_DEG
    declared: tuple[str, ...] = ()

    @classmethod
    def from_fit(cls, fit: DirectFit, unit_id: str, runs: dict[str, str], *, gauge: Gauge) -> Self:
        """Make a compensation of a fit. The gauge has no default: what is free must be chosen (see `MEANING`)."""
        return cls(
            unit_id=unit_id,
            lines=fit.lines,
            amplitudes_arcsec=fit.amplitudes_arcsec,
            sd_arcsec=fit.sd_arcsec,
            gauge=gauge,
            gauge_arcsec=gauge_tilt(gauge, fit.lines, fit.amplitudes_arcsec),
            play_arcsec=0j if fit.play_arcsec is None else fit.play_arcsec.value,
            travel_deg=fit.travel_deg,
            declared=(FREE_PART, f"gauge {gauge}: {MEANING[gauge]}", *fit.declared),
            **provenance(runs),
        )

    def tilt_arcsec(self, angle_rad: Array, start_slack: float = 0.0) -> Complex:
        """Return the tilt in body axes at successive rotation angles, turns counted, complex (n,)."""
        tilt = body_tilt(angle_rad, self.lines, self.amplitudes_arcsec) + self.gauge_arcsec
        if self.play_arcsec:
            tilt = tilt + self.play_arcsec * slack(angle_rad, np.radians(self.travel_deg), start_slack)
        return np.asarray(tilt)

    def carrier_attitude(self, attitude: Array, angle_rad: Array) -> Array:
        """Return C_b^n = C_s'^n C_b^s', float64 (n, 3, 3), of unit attitudes C_s'^n (n, 3, 3) at angles (n,)."""
        tilt_rad = self.tilt_arcsec(angle_rad) / ARCSEC_PER_RAD
        return np.asarray(attitude @ body_to_true(angle_rad, tilt_rad))

    def stream(self) -> WhirlStream:
        """Return a corrector for attitudes that come one by one."""
        return WhirlStream(self)


class WhirlStream:
    """Corrects attitudes one by one: a unit attitude and a rotation angle in, a carrier attitude out.

    Angles may be wrapped to one turn; the sense of rotation is followed from step to step (below half a turn
    each).
    """

    def __init__(self, compensation: WhirlCompensation) -> None:
        self._compensation = compensation
        self._angle_rad: float | None = None
        self._slack = 0.0

    def push(self, attitude: Array, angle_rad: float) -> Array:
        """Return C_b^n (3, 3) for C_s'^n (3, 3) at an angle; equal to `carrier_attitude` sample by sample."""
        last = angle_rad if self._angle_rad is None else self._angle_rad
        step = (angle_rad - last + np.pi) % (2.0 * np.pi) - np.pi
        now = last + step
        self._slack = float(np.clip(self._slack - step / np.radians(self._compensation.travel_deg), 0.0, 1.0))
        self._angle_rad = now
        tilt = self._compensation.tilt_arcsec(np.array([now]), self._slack)
        return np.asarray(attitude @ body_to_true(np.array([now]), tilt / ARCSEC_PER_RAD)[0])
