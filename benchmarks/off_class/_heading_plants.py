"""Six space-stable platforms whose drift with heading has other physics than the lagged bilinear model.

Sources of heat stand on the case and shine on the faces of the platform (Lambert, clipped, so no sinusoid). The
computed position is the true direction turned by the misalignment as a whole rotation. Drift is scaled so that
the means at four headings differ by 1e-3 deg/h rms. All at a step of 300 s.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.signal import lfilter
from scipy.spatial.transform import Rotation

from bench.analysis.heading import PlatformLog
from drivers.base.arrays import Array
from drivers.base.constants import ARCSEC_RAD, EARTH_RATE_RAD_S

STEP_S = 300.0
WARM_H = 240.0
LATITUDE_DEG = 40.0
EFFECT_DPH = 1e-3
Stays = tuple[tuple[float, float], ...]
Drift = Callable[["Course", np.random.Generator], tuple[Array, Array, Array]]


@dataclass(frozen=True, eq=False)
class Course:
    """Heading and sidereal angle (n,), heat on three faces of the platform (n, 3), the direction of up (n, 3).

    `room_k` (n,): the room against its mean, with its daily swing in solar time.
    """

    time_s: Array
    angle_rad: Array
    heading_deg: Array
    heat: Array
    up: Array
    room_k: Array


@dataclass(frozen=True, eq=False)
class Flight:
    """A log from its alignment on, with a second sensor, and the warm-up's angle and temperature.

    `thermal_as` (n, 3): the misalignment that temperature alone makes.
    """

    log: PlatformLog
    warm_angle_rad: Array
    warm_temp_c: Array
    thermal_as: Array


def course_of(stays: Stays, rng: np.random.Generator) -> Course:
    """Return the course of ten warm days at heading 0 and then the stays; `rng` draws the case's sources."""
    sources, faces = rng.standard_normal((4, 3)), np.eye(3)[rng.permutation(3)]
    sources /= np.linalg.norm(sources, axis=1)[:, None]
    power = rng.uniform(0.6, 1.6, 4)
    hours = ((0.0, WARM_H), *stays)
    heading = np.concatenate([np.full(round(3600.0 * long / STEP_S), psi) for psi, long in hours])
    time_s = np.arange(len(heading), dtype=np.float64) * STEP_S
    angle: Array = EARTH_RATE_RAD_S * time_s
    level, up = np.cos(np.radians(LATITUDE_DEG)), np.sin(np.radians(LATITUDE_DEG))
    east = np.column_stack([-np.sin(angle), np.cos(angle), np.zeros_like(angle)])
    radial = np.column_stack([level * np.cos(angle), level * np.sin(angle), np.full_like(angle, up)])
    north = np.cross(radial, east)
    turn = np.radians(heading)[:, None]
    ahead, right = north * np.cos(turn) + east * np.sin(turn), east * np.cos(turn) - north * np.sin(turn)
    heat = np.zeros((len(heading), 3))
    for direction, watts in zip(sources, power, strict=True):
        seen = direction[0] * ahead + direction[1] * right + direction[2] * radial
        heat += watts * np.clip(seen @ faces.T, 0.0, None) ** 1.5
    day = 2.0 * np.pi * time_s / 86400.0
    room = 0.05 * np.sin(day + rng.uniform(0.0, 6.0)) + 0.03 * walk(len(heading), 20.0, rng)
    return Course(time_s, angle, heading, heat, radial, room)


def fly(drift: Drift, seed: int, noise_seed: int, stays: Stays, *, turned: bool = True) -> Flight:
    """Return a flight; with `turned` False its twin that stays at heading 0 with the same noise."""
    scale = _scale(drift, seed)
    own, platform = (np.random.default_rng((seed, salt)) for salt in (1, 2))
    flown = stays if turned else tuple((0.0, hours) for _, hours in stays)
    course = course_of(flown, own)
    first, second, eps = drift(course, platform)
    start = round(WARM_H * 3600.0 / STEP_S)
    return _measured(course, first, second, scale * eps, start, noise_seed)


def _offset(heading_deg: float, seed: int) -> Array:
    """Return the misalignment in rad that a heading brings whatever the temperature, 3 arcsec an axis."""
    return 3.0 * ARCSEC_RAD * np.random.default_rng((seed, 4, round(10.0 * heading_deg))).standard_normal(3)


def _measured(course: Course, first: Array, second: Array, eps: Array, start: int, seed: int) -> Flight:
    rng = np.random.default_rng((seed, 3))
    count = len(course.time_s)
    thermal = eps[start:] - eps[start - 576 : start].mean(axis=0)
    eps = eps + 1.5e-5 * np.column_stack([walk(count, 30.0, rng) for _ in range(3)])
    rad_per_step = np.radians(eps[start:]) / 3600.0 * STEP_S
    # Steady drift is calibrated on the last two days before the alignment, as in the field.
    rad_per_step -= np.radians(eps[start - 576 : start].mean(axis=0)) / 3600.0 * STEP_S
    phi = np.cumsum(rad_per_step, axis=0)
    # The offset of a heading must not depend on which others there are: a twin has the same noise.
    offsets = {psi: _offset(psi, seed) for psi in dict.fromkeys(course.heading_deg[start:].tolist())}
    phi += np.array([offsets[psi] for psi in course.heading_deg[start:].tolist()])
    x, y, z = Rotation.from_rotvec(phi).apply(course.up[start:]).T
    angle, latitude = course.angle_rad[start:], np.radians(LATITUDE_DEG)
    longitude = (np.arctan2(y, x) - angle + np.pi) % (2.0 * np.pi) - np.pi
    north = (np.arctan2(z, np.hypot(x, y)) - latitude) / ARCSEC_RAD
    east = np.cos(latitude) * longitude / ARCSEC_RAD
    noise = [rng.standard_normal(len(angle)) + 2.0 * walk(len(angle), 1.5, rng) for _ in range(2)]
    temps = [values + 0.003 * rng.standard_normal(count) for values in (first, second)]
    log = PlatformLog(
        course.time_s[start:] - course.time_s[start],
        angle,
        north + noise[0],
        east + noise[1],
        temps[0][start:],
        course.heading_deg[start:],
        LATITUDE_DEG,
        second_c=temps[1][start:],
    )
    return Flight(
        log,
        course.angle_rad[:start],
        temps[0][:start],
        np.cumsum(thermal, axis=0) * STEP_S,
    )


def _scale(drift: Drift, seed: int) -> float:
    own, platform = (np.random.default_rng((seed, salt)) for salt in (1, 2))
    course = course_of(((0.0, 48.0), (90.0, 48.0), (180.0, 48.0), (270.0, 48.0)), own)
    eps, last = drift(course, platform)[2], round(24.0 * 3600.0 / STEP_S)
    day = [slice(len(eps) - 576 * k - last, len(eps) - 576 * k) for k in range(4)]
    means = np.array([eps[part].mean(axis=0) for part in day])
    changes = means[:3] - means[3]
    return EFFECT_DPH / float(np.sqrt(np.mean(np.sum(changes**2, axis=1))))


def walk(count: int, hours: float, rng: np.random.Generator) -> Array:
    """Return a stationary first-order Markov series of sd 1."""
    keep = np.exp(-STEP_S / 3600.0 / hours)
    drive = rng.standard_normal(count) * np.sqrt(1.0 - keep**2)
    drive[0] /= np.sqrt(1.0 - keep**2)
    return np.asarray(lfilter([1.0], [1.0, -keep], drive))


def lag(values: Array, hours: float) -> Array:
    """Return values after a first-order lag, settled on the first."""
    gain = 1.0 - np.exp(-STEP_S / 3600.0 / hours)
    return np.asarray(lfilter([gain], [1.0, gain - 1.0], values, axis=0, zi=(1.0 - gain) * values[:1])[0])


def _unbalance(course: Course, rng: np.random.Generator) -> Array:
    """Return the direction in which each axis is out of balance, along gravity, (n, 3)."""
    return np.asarray(course.up @ rng.standard_normal((3, 3)).T + 0.3 * rng.standard_normal(3))


def _size(eps: Array) -> float:
    """Return the rms of a drift over the warm days, which all flights of a platform share."""
    return float(np.std(eps[: round(WARM_H * 3600.0 / STEP_S)]))


def seen(course: Course, rng: np.random.Generator) -> tuple[Array, Array, Array]:
    """The temperature that is measured drives all: clipped heat, a float whose viscosity is exponential."""
    temp = lag(course.heat.sum(axis=1) + course.room_k, 11.0)
    core = lag(temp, rng.uniform(3.0, 8.0))
    soft = np.expm1(0.12 * (core - core[0]))
    return temp, course.heat[:, 0], soft[:, None] * _unbalance(course, rng)


def hidden_gradient(course: Course, rng: np.random.Generator) -> tuple[Array, Array, Array]:
    """A third of the drift comes from a gradient over the platform with a lag of its own."""
    temp = lag(course.heat.sum(axis=1) + course.room_k, 11.0)
    across = lag(course.heat[:, 0] - course.heat[:, 1], 6.0)
    core, tilted = lag(temp, rng.uniform(3.0, 8.0)), lag(across, rng.uniform(1.0, 3.0))
    main = (core - core[0])[:, None] * _unbalance(course, rng)
    other = (tilted - tilted[0])[:, None] * _unbalance(course, rng)
    return temp, across, main + 0.55 * _size(main) / _size(other) * other


def diffusion(course: Course, rng: np.random.Generator) -> tuple[Array, Array, Array]:
    """Heat diffuses into a thick wall (five lags in a row), the room comes in by another way."""
    temp = lag(course.heat.sum(axis=1) + course.room_k, 11.0)
    deep = temp
    for _ in range(5):
        deep = lag(deep, rng.uniform(0.8, 1.6))
    mixed = 0.7 * deep + 0.3 * lag(temp, 14.0) + 1.5 * course.room_k
    return temp, course.heat[:, 1], (mixed - mixed[0])[:, None] * _unbalance(course, rng)


def friction(course: Course, rng: np.random.Generator) -> tuple[Array, Array, Array]:
    """As much again as temperature makes comes from gimbal friction and a magnet: constant at each heading."""
    temp, second, eps = seen(course, rng)
    turn = np.radians(course.heading_deg)[:, None]
    push = rng.standard_normal((2, 3))
    fixed = (np.cos(turn) - 1.0) * push[0] + np.sin(turn) * push[1]
    return temp, second, eps / _size(eps) + 1.2 * fixed / float(np.std(push))


def convection(course: Course, rng: np.random.Generator) -> tuple[Array, Array, Array]:
    """Air in the case rises: exchange grows with the difference, so that the lag depends on the temperature."""
    total = course.heat.sum(axis=1) + course.room_k
    temp, core = np.empty_like(total), np.empty_like(total)
    now, inner, slow = total[0], total[0], rng.uniform(4.0, 7.0)
    for k, heat in enumerate(total):
        now += STEP_S / 3600.0 / 11.0 * (heat - now) * (0.4 + 1.5 * abs(heat - now) ** 0.5)
        inner += STEP_S / 3600.0 / slow * (now - inner) * (0.4 + 1.5 * abs(now - inner) ** 0.5)
        temp[k], core[k] = now, inner
    return temp, course.heat[:, 0], (core - core[0])[:, None] * _unbalance(course, rng)


def elsewhere(course: Course, rng: np.random.Generator) -> tuple[Array, Array, Array]:
    """The sensor sits at a face whose temperature has little to do with the one that drives the drift."""
    other = lag(course.heat[:, 1] - 0.6 * course.heat[:, 0], 8.0)
    temp = lag(course.heat[:, 2] + 0.2 * course.heat[:, 1] + course.room_k, 11.0)
    core = lag(other, rng.uniform(2.0, 5.0))
    return temp, other, (core - core[0])[:, None] * _unbalance(course, rng)


FAMILIES: dict[str, Drift] = {
    "seen, exponential": seen,
    "hidden gradient": hidden_gradient,
    "diffusion and room": diffusion,
    "friction and magnet": friction,
    "convection": convection,
    "sensor elsewhere": elsewhere,
}
