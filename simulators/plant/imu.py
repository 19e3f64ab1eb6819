"""An IMU on the inner axis of a table of one to three axes: it measures what the table's axes really do.

    gyro           w~ = (I + K_g) w + eps
    accelerometer  f~ = (I + K_a) f + nabla + K_2 (f * f) + lever arms + lag (w x f)

w is the inertial rate in b (Earth's and the table's), f the specific force in b of a point that stays in place.
Accelerometer i sits at r_i: f_i += row i of ([w' x] + [w x]^2) r_i.

Every sample has the angles of the axes at its ends and in its middle (`gimbals`): the turned angle is what the
axes turned, the specific force is gravity through Simpson's rule. Noise depends on seed and sample index only.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, fields

import numpy as np

from drivers.base.arrays import Array
from drivers.base.constants import ARCSEC_RAD, UG_MPS2, gravity_mps2
from drivers.kit.config import Mounting
from simulators.interfaces import GyroSignal
from simulators.plant.gimbals import (
    NORTH_WEST_UP,
    Gimbals,
    about_up,
    earth_rate_rad_s,
    simpson,
    turned_about,
    turned_rad,
)
from simulators.plant.ground import MovingGround
from simulators.plant.mounting import Mount
from simulators.plant.noise import NoiseSource, SampleNoise, TickNoise
from simulators.plant.table import TableAxis
from simulators.plant.unit import SampleTimes, check_advanced

_PRIOR = (0.1, 1000.0, 100.0, 100.0, 100.0)
"""One sigma of a unit's errors, as after a factory calibration: deg/h, ug, ppm, arcsec, ug/g^2."""
_ARW_DEG_PER_SQRT_H, _VRW_UG_PER_SQRT_HZ, _VIBRATION_MPS = 0.001, 10.0, 1e-3
_WANDER_DPH, _WANDER_UG, _WANDER_TIME_S = 0.003, 5.0, 1000.0
_LEVER_M, _LAG_S = 0.03, 1e-3
_MOUNT_DEG = 0.05
_WHITE, _VIBRATION, _WANDER, _MOUNT = 0, 10, 20, 30
"""Noise streams of a unit; an axis adds its number."""


@dataclass(frozen=True, eq=False)
class ImuErrors:
    """Deterministic errors, SI; `kg`, `ka` (3, 3); row i of `lever_m` (3, 3) is where accelerometer i sits."""

    eps_rad_s: Array = field(default_factory=lambda: np.zeros(3))
    nabla_mps2: Array = field(default_factory=lambda: np.zeros(3))
    kg: Array = field(default_factory=lambda: np.zeros((3, 3)))
    ka: Array = field(default_factory=lambda: np.zeros((3, 3)))
    k2_s2pm: Array = field(default_factory=lambda: np.zeros(3))
    lever_m: Array = field(default_factory=lambda: np.zeros((3, 3)))
    lag_s: float = 0.0


@dataclass(frozen=True)
class ImuNoise:
    """White noise, Markov biases by their sigma and correlation time, and vibration of the table by the sigma of
    its velocity, white from sample to sample.
    """

    arw_rad_per_sqrt_s: float = 0.0
    vrw_mps_per_sqrt_s: float = 0.0
    wander_rad_s: float = 0.0
    wander_mps2: float = 0.0
    wander_time_s: float = 1000.0
    vibration_mps: float = 0.0


def imu_errors(unit_seed: int, full: bool, times: float = 1.0) -> ImuErrors:
    """Return the errors of a unit: 24 parameters drawn at prior size, K_a lower triangular; `full`: lever arms of
    accelerometers x and y and a lag, too. `times`: how many times larger the 24 are.
    """
    rng = NoiseSource(unit_seed, "imu").generator(0)
    bias, nabla, scale, angle, square = (times * size for size in _PRIOR)
    size = np.where(np.eye(3) == 1.0, scale * 1e-6, angle * ARCSEC_RAD)
    kg, ka = rng.standard_normal((3, 3)) * size, np.tril(rng.standard_normal((3, 3)) * size)
    lever = rng.standard_normal((3, 3)) * _LEVER_M
    lever[2] = 0.0
    return ImuErrors(
        eps_rad_s=rng.standard_normal(3) * bias * ARCSEC_RAD,
        nabla_mps2=rng.standard_normal(3) * nabla * UG_MPS2,
        kg=kg,
        ka=ka,
        k2_s2pm=rng.standard_normal(3) * square * 1e-6 / (UG_MPS2 * 1e6),
        lever_m=lever if full else np.zeros((3, 3)),
        lag_s=_LAG_S if full else 0.0,
    )


def imu_noise(full: bool) -> ImuNoise:
    """Return the noise of a navigation-grade unit on a table that vibrates by 1 mm/s; `full`: biases wander."""
    return ImuNoise(
        arw_rad_per_sqrt_s=math.radians(_ARW_DEG_PER_SQRT_H) / 60.0,
        vrw_mps_per_sqrt_s=_VRW_UG_PER_SQRT_HZ * UG_MPS2,
        wander_rad_s=_WANDER_DPH * ARCSEC_RAD if full else 0.0,
        wander_mps2=_WANDER_UG * UG_MPS2 if full else 0.0,
        wander_time_s=_WANDER_TIME_S,
        vibration_mps=_VIBRATION_MPS,
    )


class ImuUnit:
    """A powered IMU (`simulators.interfaces.GyroPlant` with accelerometers), at the temperature of its air.

    `axes` of the table: (direction, axis), outermost first. It is mounted a little askew, by its seed. `axis`:
    the one under test, which a mounting by name speaks of.
    """

    axes = "xyz"

    def __init__(
        self,
        errors: ImuErrors,
        noise: ImuNoise,
        table: Sequence[tuple[str, TableAxis]],
        latitude_deg: float,
        source: NoiseSource,
        *,
        axis: str = "x",
        azimuth_error_deg: float = 0.0,
        ground: MovingGround | None = None,
    ) -> None:
        self.errors, self.noise = errors, noise
        self._gimbals = Gimbals(table)
        self._moving = ground if ground is not None and ground.parameters.moves else None
        self._rocking = ground if ground is not None and ground.parameters.rocks else None
        self._axis = axis
        self._earth = earth_rate_rad_s(latitude_deg)
        self._gravity = np.array([0.0, 0.0, gravity_mps2(latitude_deg)])
        askew = source.substream(_MOUNT).generator(0).standard_normal(3) * math.radians(_MOUNT_DEG)
        size = float(np.linalg.norm(askew))
        self._askew = about_up(azimuth_error_deg) @ turned_about(askew / size, np.array([size]))[0]
        self._mounts: list[tuple[float, Array]] = [(0.0, self._askew)]
        self._white = [SampleNoise(source.substream(_WHITE + at), "normal") for at in range(6)]
        self._shaken = [SampleNoise(source.substream(_VIBRATION + at), "normal") for at in range(3)]
        sizes = [noise.wander_rad_s] * 3 + [noise.wander_mps2] * 3
        self._wander = [
            TickNoise(source.substream(_WANDER + at), (noise.wander_time_s,), size)
            for at, size in enumerate(sizes)
            if any(sizes)
        ]
        self._wandered: list[list[float]] = []
        self._temps_c: list[float] = []
        self._samples = SampleTimes()

    def start(self, temp_c: float) -> None:
        """Take the room's temperature at tick 0."""
        self.tick(temp_c)

    def tick(self, air_temp_c: float) -> None:
        """Advance by 1 s in air of the given temperature."""
        self._temps_c.append(air_temp_c)
        self._wandered.append([process.value(len(self._wandered)) for process in self._wander])

    def mount_at(self, now_s: float, attitude: Array) -> None:
        """Mount it so that with all axes at 0 its attitude C (3, 3) is the given one, as well as hands can."""
        self._mounts.append((now_s, self._askew @ np.asarray(attitude, dtype=np.float64)))

    def mount(self, now_s: float, mounting: Mounting, roll_deg: float = 0.0) -> None:
        """Mount it as a test of one axis asks for, told with all axes at 0."""
        mount = Mount(mounting, axis=self._axis, roll_deg=roll_deg)
        self.mount_at(now_s, NORTH_WEST_UP @ mount.axes_in_table().T)

    def case_reading_c(self, now_s: float) -> float:
        """Return the temperature of its case, held from the last tick."""
        return self._temps_c[min(int(now_s), len(self._temps_c) - 1)]

    def truth(self) -> dict[str, Array]:
        """Return its errors, SI: what a calibration should find."""
        return {error.name: np.asarray(getattr(self.errors, error.name)) for error in fields(ImuErrors)}

    def measure(self, start_s: float, count: int, period_s: float) -> GyroSignal:
        """Return `count` samples (see `GyroPlant`); ConfigurationError beyond the last tick."""
        if count == 0:
            return GyroSignal(self.axes, np.empty((0, 3)), np.empty(0), np.empty((0, 3)))
        index = self._samples.take(start_s, count, period_s)
        halves = np.arange(2 * count + 3, dtype=np.float64) - 1.0
        times_s = self._samples.time_s(index + halves / 2.0)
        check_advanced("imu plant", float(times_s[-2]), len(self._temps_c))
        angle, velocity = self._exact(np.maximum(times_s, 0.0), count, period_s)
        self._add_noise(angle, velocity, index, count, times_s[1:-1:2][:count], period_s)
        if self._moving is not None:
            velocity += self._pushed(self._moving, np.maximum(times_s[1:-1], 0.0))
        held = np.minimum((times_s[3::2][:count] + 1e-9).astype(np.int64), len(self._temps_c) - 1)
        return GyroSignal(self.axes, angle, np.array(self._temps_c)[held], velocity)

    def _exact(self, times_s: Array, count: int, period_s: float) -> tuple[Array, Array]:
        """Return increments without noise, (count, 3) each; `times_s`: half samples, one before and one after."""
        mount = next(matrix for since_s, matrix in reversed(self._mounts) if since_s <= times_s[1])
        angles = self._gimbals.angles_rad(times_s)
        if len(angles[0]) == 1 and self._rocking is not None:
            angles = [np.repeat(angle, len(times_s)) for angle in angles]
        if len(angles[0]) == 1:  # all axes stand still
            rate, force = self._at(angles, mount, times_s[:1])
            none = np.zeros((1, 3))
            w, f = with_errors(rate, force, none, none, self.errors)
            return np.repeat(w * period_s, count, axis=0), np.repeat(f * period_s, count, axis=0)
        inside = [angle[1:-1] for angle in angles]
        rate, force = self._at(inside, mount, times_s[1:-1])
        half = period_s / 2.0
        spin, speeding = np.zeros((2, 2 * count + 1, 3))
        turned = np.zeros((count, 3))
        for u, angle in zip(self._gimbals.lines(inside, mount), angles, strict=True):
            spin += u * ((angle[2:] - angle[:-2]) / period_s)[:, None]
            speeding += u * ((angle[2:] - 2.0 * angle[1:-1] + angle[:-2]) / half**2)[:, None]
            # exact for one axis at a time, whose direction in b stands; the middle's direction for more
            turned += u[1::2] * np.diff(angle[1:-1:2])[:, None]
        if self._rocking is not None:
            turned += self._rocked(self._rocking, inside, mount, times_s[1:-1], period_s)
        _, measured = with_errors(rate, force, spin, speeding, self.errors)
        still, _ = with_errors(simpson(rate), simpson(force), turned * 0.0, turned * 0.0, self.errors)
        angle = still * period_s + turned @ (np.eye(3) + self.errors.kg).T
        return angle, simpson(measured) * period_s

    def _at(self, angles: Sequence[Array], mount: Array, times_s: Array) -> tuple[Array, Array]:
        """Return Earth rate and specific force in b, (n, 3), at the axes' angles (n,)."""
        c = self._gimbals.attitude(angles, mount)
        if self._rocking is not None:
            c = self._rocking.attitude(times_s) @ c
        return np.einsum("nij,i->nj", c, self._earth), np.einsum("nij,i->nj", c, self._gravity)

    def _rocked(
        self, ground: MovingGround, angles: Sequence[Array], mount: Array, times_s: Array, period_s: float
    ) -> Array:
        """Return what b turns through with the ground, rad, (count, 3); too slowly for lever arms and lag.

        `times_s` and `angles` are at ends and middles.
        """
        edges = ground.attitude(times_s[::2]).transpose(0, 2, 1)
        turned = turned_rad(edges, np.zeros(3), period_s).T
        c = self._gimbals.attitude([angle[1::2] for angle in angles], mount)
        return np.asarray(np.einsum("nij,ni->nj", c, turned))

    def _pushed(self, ground: MovingGround, times_s: Array) -> Array:
        """Return what accelerometers gain in samples whose ends and middles are `times_s`, (count, 3), as the
        ground moves; their own errors are left out of so small a change.
        """
        mount = next(matrix for since_s, matrix in reversed(self._mounts) if since_s <= times_s[0])
        attitude = self._gimbals.attitude(self._gimbals.angles_rad(times_s[1::2]), mount)
        gained = np.diff(ground.velocity_mps(times_s[::2]), axis=0)
        return np.asarray(np.einsum("nij,ni->nj", np.broadcast_to(attitude, (len(gained), 3, 3)), gained))

    def _add_noise(
        self, angle: Array, velocity: Array, index: int, count: int, starts_s: Array, period_s: float
    ) -> None:
        noise = self.noise
        white = np.stack([source.values(index, count) for source in self._white], axis=1)
        angle += white[:, :3] * (noise.arw_rad_per_sqrt_s * math.sqrt(period_s))
        velocity += white[:, 3:] * (noise.vrw_mps_per_sqrt_s * math.sqrt(period_s))
        if noise.vibration_mps:
            shaken = np.stack([source.values(index, count + 1) for source in self._shaken], axis=1)
            velocity += np.diff(shaken * noise.vibration_mps, axis=0)
        if self._wander:
            ticks = np.minimum(starts_s.astype(np.int64), len(self._wandered) - 1)
            wander = np.array(self._wandered[int(ticks[0]) : int(ticks[-1]) + 1])[ticks - ticks[0]]
            angle += wander[:, :3] * period_s
            velocity += wander[:, 3:] * period_s


def with_errors(
    rate: Array, force: Array, spin: Array, speeding: Array, errors: ImuErrors
) -> tuple[Array, Array]:
    """Return what is measured, rates and specific forces (n, 3), of true ones; `spin` and `speeding` are rate and
    acceleration of b against the Earth, (n, 3), rad/s and rad/s2.
    """
    w = rate + rate @ errors.kg.T + errors.eps_rad_s
    f = force + force @ errors.ka.T + errors.nabla_mps2 + errors.k2_s2pm * force**2
    for i in range(3):
        r = errors.lever_m[i]
        f[:, i] += (np.cross(speeding, r) + np.cross(spin, np.cross(spin, r)))[:, i]
    return w, f + errors.lag_s * np.cross(spin, force)
