"""A whirl compensation: the fitted tilt, gauge and papers in one file; corrects attitude, batch or stream."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, ClassVar, Self

import numpy as np

from bench.analysis.common.compensation import FittedCompensation, provenance
from bench.analysis.whirl._direct import DirectFit
from bench.analysis.whirl._gauge import FREE_PART, MEANING, Gauge, gauge_tilt
from bench.analysis.whirl._kinematics import body_tilt, body_to_true
from bench.analysis.whirl._residual import slack
from bench.analysis.whirl._types import Complex
from drivers.base.arrays import Array
from drivers.base.constants import ARCSEC_PER_RAD


@dataclass(frozen=True, eq=False, repr=False)
class WhirlCompensation(FittedCompensation):
    """The tilt of the gyros' frame in body axes as a function of the rotation angle, arcsec, complex: x + j y.

    `lines`, `amplitudes_arcsec`, `sd_arcsec`: (l,). `gauge_arcsec` is the constant that `gauge` stands for.
    `plays_arcsec` (p,) are added as the table turns back by `travels_deg` (p,), each over its own. `declared`:
    what the fit could not tell, in words.
    """

    KIND = "whirl"
    WHAT = "whirl"
    SHAPES: ClassVar = {
        "lines": ("l",),
        "amplitudes_arcsec": ("l",),
        "sd_arcsec": ("l",),
        "travels_deg": ("p",),
        "plays_arcsec": ("p",),
    }

    lines: tuple[float, ...]
    amplitudes_arcsec: Complex
    sd_arcsec: Array
    gauge: Gauge
    gauge_arcsec: complex
    travels_deg: tuple[float, ...] = ()
    plays_arcsec: Complex = field(default_factory=lambda: np.zeros(0, np.complex128))
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
            travels_deg=fit.travels_deg,
            plays_arcsec=fit.plays_arcsec,
            declared=(FREE_PART, f"gauge {gauge}: {MEANING[gauge]}", *fit.declared),
            **provenance(runs),
        )

    @classmethod
    def _restored(cls, state: dict[str, Any], metadata: dict[str, Any]) -> Self:
        """Read what was written; files of before had one play."""
        if "travel_deg" in state:
            state = {**state, "travels_deg": [state["travel_deg"]], "plays_arcsec": [state["play_arcsec"]]}
        if not all(travel > 0.0 for travel in state["travels_deg"]):
            raise ValueError("a travel that is not above zero")
        return super()._restored(state, metadata)

    def tilt_arcsec(self, angle_rad: Array) -> Complex:
        """Return the tilt in body axes at successive rotation angles, turns counted, complex (n,)."""
        tilt = body_tilt(angle_rad, self.lines, self.amplitudes_arcsec) + self.gauge_arcsec
        for travel_deg, jump in zip(self.travels_deg, self.plays_arcsec, strict=True):
            tilt = tilt + jump * slack(angle_rad, np.radians(travel_deg))
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
        self._travels_rad = np.radians(compensation.travels_deg)
        self._slack = np.zeros(len(compensation.travels_deg))

    def push(self, attitude: Array, angle_rad: float) -> Array:
        """Return C_b^n (3, 3) for C_s'^n (3, 3) at an angle; equal to `carrier_attitude` sample by sample."""
        last = angle_rad if self._angle_rad is None else self._angle_rad
        step = (angle_rad - last + np.pi) % (2.0 * np.pi) - np.pi
        now = last + step
        self._slack = np.clip(self._slack - step / self._travels_rad, 0.0, 1.0)
        self._angle_rad = now
        made = self._compensation
        tilt = body_tilt(np.array([now]), made.lines, made.amplitudes_arcsec) + made.gauge_arcsec
        tilt = tilt + made.plays_arcsec @ self._slack
        return np.asarray(attitude @ body_to_true(np.array([now]), tilt / ARCSEC_PER_RAD)[0])
