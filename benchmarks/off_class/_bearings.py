"""Bearings whose wobble is not what the whirl fit assumes, as records of an exact rotation.

Attitude is a product of rotation matrices at every sample; rates are logarithms of what lies between two samples
with the Earth turning under them. Nothing is linearised in the tilt.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.spatial.transform import Rotation

from bench.analysis.whirl._types import Complex, TurnRecord
from drivers.base.arrays import Array
from drivers.base.constants import EARTH_RATE_RAD_S

RATE_HZ = 50.0
SPEED_DPS = 6.0
LATITUDE_DEG = 40.0
_ARCSEC = np.pi / 180.0 / 3600.0
Bearing = Callable[[Array, Array, np.random.Generator], Complex]
"""Tilt in body axes, x + j y, arcsec, at times (n,) and angles (n,), turns counted."""


def turning(stretches: int, turns: float) -> tuple[Array, Array]:
    """Return time and angle of `stretches` of `turns`, in alternating senses, with smooth reversals."""
    seconds = turns * 360.0 / SPEED_DPS
    step = 1.0 / RATE_HZ
    count = round(seconds * RATE_HZ)
    sense = np.repeat([(-1.0) ** k for k in range(stretches)], count)
    ramp = round(1.0 * RATE_HZ)
    sense = np.convolve(np.pad(sense, ramp, mode="edge"), np.ones(ramp) / ramp, mode="same")[ramp:-ramp]
    speed = np.radians(SPEED_DPS) * sense
    angle = np.concatenate([[0.0], np.cumsum(speed) * step])
    return np.arange(len(angle), dtype=np.float64) * step, np.asarray(angle, dtype=np.float64)


def record(
    bearing: Bearing, seed: int, *, stretches: int = 6, turns: float = 4.0
) -> tuple[TurnRecord, Complex]:
    """Return a run and its true tilt; a seed draws noise and the phases of rollers, not the bearing."""
    rng = np.random.default_rng(seed)
    time_s, angle = turning(stretches, turns)
    tilt = bearing(time_s, angle, rng)
    vector = np.column_stack([tilt.real, tilt.imag, np.zeros(len(tilt))]) * _ARCSEC
    about = np.column_stack([np.zeros_like(angle), np.zeros_like(angle), angle])
    latitude = np.radians(LATITUDE_DEG)
    earth = EARTH_RATE_RAD_S * np.array([0.0, np.cos(latitude), np.sin(latitude)])
    attitude = (
        Rotation.from_rotvec(time_s[:, None] * earth)
        * Rotation.from_rotvec([0.002, -0.003, 0.4])
        * Rotation.from_rotvec(vector)
        * Rotation.from_rotvec(about)
    )
    turned = (attitude[:-1].inv() * attitude[1:]).as_rotvec()
    noise = np.radians(0.002) / 60.0 / np.sqrt(RATE_HZ) * rng.standard_normal(turned.shape)
    drift = np.radians(0.05 * rng.standard_normal(3)) / 3600.0 / RATE_HZ
    rates = np.degrees((turned + noise + drift) * RATE_HZ)
    seen = angle + 0.3 * _ARCSEC * rng.standard_normal(len(angle))
    whole = np.ones(len(rates), dtype=np.bool_)
    return TurnRecord(f"run-{seed}", "INS", 1.0 / RATE_HZ, time_s, rates, seen, whole, LATITUDE_DEG), tilt


def lines_of(lines: dict[float, complex]) -> Callable[[Array], Complex]:
    """Return the tilt of lines, arcsec, over the angle."""

    def tilt(angle: Array) -> Complex:
        terms = np.exp(1j * np.outer(angle, list(lines)))
        return np.asarray(terms @ np.array(list(lines.values())), dtype=np.complex128)

    return tilt


_USUAL = {1.0: 6.0 - 4.0j, 2.0: -9.0 + 8.0j, -1.0: 3.0 + 2.0j, 3.0: 1.5 + 0.5j}


def usual(time_s: Array, angle: Array, rng: np.random.Generator) -> Complex:
    """Low whole lines only: what the fit was made for."""
    return lines_of(_USUAL)(angle)


def races(time_s: Array, angle: Array, rng: np.random.Generator) -> Complex:
    """Races that are out of round: whole lines up to 20."""
    high = {-17.0: 0.5j, -12.0: 0.7, 9.0: 1.2 + 0.4j, 11.0: -0.8j, 16.0: 0.9, 20.0: 0.6 - 0.3j}
    return lines_of(_USUAL | high)(angle)


def rollers(time_s: Array, angle: Array, rng: np.random.Generator) -> Complex:
    """A cage and its rollers: lines that are no whole numbers, of another phase in every run."""
    phase = np.exp(1j * rng.uniform(0.0, 2.0 * np.pi, 2))
    return lines_of(_USUAL | {0.4186: 1.0 * phase[0], 7.31: 0.8 * phase[1]})(angle)


def played(travel_deg: float, jump: complex) -> Bearing:
    """Return a bearing with play: the shaft crosses its clearance while the table turns back by `travel_deg`."""

    def bearing(time_s: Array, angle: Array, rng: np.random.Generator) -> Complex:
        follower, at = np.empty_like(angle), angle[0]
        half = np.radians(travel_deg) / 2.0
        # The shaft is carried by the two ends of a stop.
        for k, now in enumerate(angle.tolist()):
            at = min(max(at, now - half), now + half)
            follower[k] = at
        return np.asarray(lines_of(_USUAL)(angle) + jump * (follower - angle) / (2.0 * half))

    return bearing


def sprung(time_s: Array, angle: Array, rng: np.random.Generator) -> Complex:
    """Friction that winds a shaft up: after a reversal the tilt comes over exponentially, within 4 deg."""
    wound, state = np.empty_like(angle), 0.0
    for k, step in enumerate(np.diff(angle, prepend=angle[0]).tolist()):
        state += (np.sign(step) - state) * (1.0 - np.exp(-abs(step) / np.radians(4.0)))
        wound[k] = state
    return lines_of(_USUAL)(angle) + (2.0 - 1.0j) * wound


def warming(time_s: Array, angle: Array, rng: np.random.Generator) -> Complex:
    """A bearing that warms up while it turns: its second line grows by a tenth in twenty minutes."""
    grown = 1.0 + 0.1 * (1.0 - np.exp(-time_s / 1200.0))
    second = lines_of({2.0: _USUAL[2.0]})(angle)
    return usual(time_s, angle, rng) + second * (grown - 1.0)


def overshooting(time_s: Array, angle: Array, rng: np.random.Generator) -> Complex:
    """Grease pushed over: after a reversal the tilt goes too far by a half, and creeps back within 12 deg."""
    fast, slow = np.empty_like(angle), np.empty_like(angle)
    quick = late = 0.0
    for k, step in enumerate(np.diff(angle, prepend=angle[0]).tolist()):
        quick += (np.sign(step) - quick) * (1.0 - np.exp(-abs(step) / np.radians(1.5)))
        late += (np.sign(step) - late) * (1.0 - np.exp(-abs(step) / np.radians(12.0)))
        fast[k], slow[k] = quick, late
    return lines_of(_USUAL)(angle) + (1.5 + 1.0j) * (1.5 * fast - 0.5 * slow)


def preloaded(time_s: Array, angle: Array, rng: np.random.Generator) -> Complex:
    """Angular contact: in reverse the balls run on another track, and the second line is other by a tenth."""
    reverse, state = np.empty_like(angle), 0.0
    for k, step in enumerate(np.diff(angle, prepend=angle[0]).tolist()):
        state += (float(step < 0.0) - state) * (1.0 - np.exp(-abs(step) / np.radians(0.5)))
        reverse[k] = state
    return lines_of(_USUAL)(angle) + 0.1 * reverse * lines_of({2.0: 9.0 + 8.0j})(angle)


FAMILIES: dict[str, Bearing] = {
    "usual lines (in class)": usual,
    "races, lines to 20": races,
    "rollers, no whole lines": rollers,
    "play taken up in 0.1 deg": played(0.1, 5.0 - 2.0j),
    "play taken up in 3 deg": played(3.0, 5.0 - 2.0j),
    "play taken up in 15 deg": played(15.0, 5.0 - 2.0j),
    "friction, exponential": sprung,
    "warming bearing": warming,
    "grease that overshoots": overshooting,
    "other track in reverse": preloaded,
}
