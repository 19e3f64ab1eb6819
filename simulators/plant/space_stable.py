"""A space-stable platform on a table: case-borne heat, the platform's temperatures, drift and position.

The platform keeps its attitude in inertial space while case and Earth turn about it. Heat exchange between
features of the case (fixed in body axes) and elements of the platform (fixed in inertial axes) makes its
temperature a function of heading and sidereal angle; the gyros' drift is bilinear in the lagged temperature
and the direction of gravity. Parameters are drawn as in the study of the heading effect. One object serves a
lab (advanced as time goes) and a campaign (advanced once over a whole run): the samples are the same.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np

from drivers.base.arrays import Array
from drivers.base.constants import ARCSEC_RAD, EARTH_RATE_RAD_S, SIDEREAL_DAY_S, gravity_mps2
from simulators.plant.accelerometers import AccelerometerErrors
from simulators.plant.noise import follow
from simulators.plant.platform_navigation import PlatformNavigator

Navigation = Literal["linear", "nonlinear"]

SET_POINT_C = 45.0
_HOUR = 3600.0


@dataclass(frozen=True, eq=False)
class PlatformParameters:
    """A platform INS. Temperatures in K, drifts in deg/h, times in h unless said otherwise.

    Heat: `case` (m, 3) in body axes right, front, up; `element` (m, 3) in inertial axes; `linear_k`, `square_k`
    (m,). Drift: `gravity` (3, 3), `constant`, `square`, `rate` (3,) times `scale_dph`. `friction_dph`: rms of a
    drift that steps with heading and has nothing to do with temperature. `second_pole_h` and `gradient_share`
    are structure that no fitted model has: another lag in the core, and an unmeasured gradient with a geometry
    and lag of its own, whose drift is that share of the whole. `start_k`: how much warmer than in equilibrium
    the platform is when it is switched on, at the first sample.
    """

    case: Array
    element: Array
    linear_k: Array
    square_k: Array
    tau_h: float
    core_tau_h: float
    gravity: Array
    constant: Array
    square: Array
    rate: Array
    scale_dph: float = 1.0
    latitude_deg: float = 40.0
    damping: float = 0.0
    second_pole_h: float = 0.0
    gradient_share: float = 0.0
    gradient_tau_h: float = 5.0
    gradient: PlatformParameters | None = None
    friction_dph: float = 0.0
    start_k: float = 0.0
    ambient_k: float = 0.05
    ambient_h: float = 20.0
    sensor_k: float = 3e-3
    wander_dph: float = 1.5e-5
    wander_h: float = 30.0
    offset_as: float = 3.0
    white_as: float = 1.0
    slow_as: float = 2.0
    slow_h: float = 1.5
    accelerometers: AccelerometerErrors = field(default_factory=AccelerometerErrors)

    def quiet(self) -> PlatformParameters:
        """Return the same platform without noise, offsets and ambient changes."""
        return replace(
            self, ambient_k=0.0, sensor_k=0.0, wander_dph=0.0, offset_as=0.0, white_as=0.0, slow_as=0.0
        )


@dataclass(frozen=True, eq=False)
class PlatformSamples:
    """What a platform did, shape (n,) or (n, 3). Errors are computed minus true, east = cos(latitude)
    longitude.

    `temp_c` is what its sensor says, `core_c` the gyros'; `thermal_dph` the drift that temperature makes,
    `phi_as` the whole misalignment; `force_mps2` specific force by the accelerometers, in the platform's axes.
    """

    time_s: Array
    angle_rad: Array
    heading_deg: Array
    north_as: Array
    east_as: Array
    temp_c: Array
    ambient_c: Array
    core_c: Array
    thermal_dph: Array
    phi_as: Array
    force_mps2: Array


def draw_platform(
    seed: int,
    *,
    effect_dph: float = 1e-3,
    latitude_deg: float = 40.0,
    core_tau_h: float | None = None,
    second_pole_h: float = 0.0,
    gradient_share: float = 0.0,
    damping: float = 0.0,
    in_class: bool = False,
) -> PlatformParameters:
    """Draw a platform; `effect_dph` is the rms over headings of the change of mean drift from heading 0.

    `in_class` leaves out what the bilinear model does not have (quadratic and rate terms).
    """
    random = np.random.default_rng([seed, 4711])
    drawn = _draw(random, latitude_deg, core_tau_h)
    if in_class:
        drawn = replace(drawn, square=np.zeros(3), rate=np.zeros(3))
    drawn = replace(drawn, second_pole_h=second_pole_h, damping=damping)
    drawn = replace(drawn, scale_dph=effect_dph / _mean_change(drawn))
    if not gradient_share:
        return drawn
    other = _draw(random, latitude_deg, None)
    other = replace(other, scale_dph=effect_dph * gradient_share / _mean_change(other))
    return replace(
        drawn,
        scale_dph=drawn.scale_dph * (1.0 - gradient_share),
        gradient=other,
        gradient_share=gradient_share,
    )


def with_heading_effect(drawn: PlatformParameters, values: Sequence[float] | None) -> PlatformParameters:
    """Return the platform with the drift of a fitted `heading_effect` in place of its own; None: without any.

    `values`: for x, y, z the drift in deg/h for every K of the lagged temperature, its part with the cosine and
    its part with the sine of the sidereal angle; then the lag in h. Heat, noise and wander stay.
    """
    bare = replace(
        drawn,
        square=np.zeros(3),
        rate=np.zeros(3),
        scale_dph=1.0,
        second_pole_h=0.0,
        gradient_share=0.0,
        gradient=None,
        friction_dph=0.0,
    )
    if values is None:
        return replace(bare, gravity=np.zeros((3, 3)), constant=np.zeros(3))
    gains = np.array(values[:9]).reshape(3, 3)
    level = math.cos(math.radians(drawn.latitude_deg))
    gravity = np.column_stack((gains[:, 1:] / level, np.zeros(3)))
    return replace(bare, gravity=gravity, constant=gains[:, 0], core_tau_h=float(values[9]))


def _draw(random: np.random.Generator, latitude_deg: float, core_tau_h: float | None) -> PlatformParameters:
    def directions(down: float) -> Array:
        drawn = random.standard_normal((3, 3)) * np.array([1.0, 1.0, down])
        unit: Array = drawn / np.linalg.norm(drawn, axis=1, keepdims=True)
        return unit

    case, element = directions(0.5), directions(0.35)
    sign = np.where(random.random(3) < 0.5, -1.0, 1.0)
    linear, square_k = sign * random.uniform(0.5, 1.3, 3), random.normal(0.0, 0.3, 3)
    tau, core = 12.0 * (1.0 + random.uniform(-0.15, 0.15)), random.uniform(3.0, 9.0)
    gravity = random.standard_normal((3, 3)) * (random.random((3, 3)) < 0.6)
    constant = random.normal(0.0, 1.0 / 3.0, 3) * (random.random(3) < 0.7)
    return PlatformParameters(
        case=case,
        element=element,
        linear_k=linear,
        square_k=square_k,
        tau_h=tau,
        core_tau_h=core if core_tau_h is None else core_tau_h,
        gravity=gravity if gravity.any() else np.eye(3),
        constant=constant,
        square=random.normal(0.0, 0.1, 3),
        rate=random.normal(0.0, 0.1, 3),
        latitude_deg=latitude_deg,
    )


def _mean_change(parameters: PlatformParameters, headings: int = 12) -> float:
    """Return the rms over headings of the mean drift's change from heading 0, after ten days at each."""
    step_s = 900.0
    day = round(SIDEREAL_DAY_S / step_s)
    means = []
    for heading in np.arange(headings) * 360.0 / headings:
        one = SpaceStablePlatform(parameters.quiet(), 0, step_s)
        run = one.advance(np.full(10 * day, heading))
        means.append(run.thermal_dph[-day:].mean(axis=0))
    change = np.array(means[1:]) - means[0]
    return float(np.sqrt(np.mean(np.sum(change**2, axis=1))))


class SpaceStablePlatform:
    """A platform INS advanced sample by sample of `step_s`; `seed` fixes its noise.

    `angle_rad` is the sidereal angle of the meridian at the first sample. Navigation is off (misalignment and
    position errors zero) until `align`, which takes the drift of the last 48 h for the constant to subtract.
    """

    def __init__(
        self,
        parameters: PlatformParameters,
        seed: int,
        step_s: float = 300.0,
        *,
        angle_rad: float = 0.0,
        navigation: Navigation = "linear",
    ) -> None:
        self.parameters, self.step_s, self._seed = parameters, step_s, seed
        self._start_angle, self._count = angle_rad, 0
        self._navigation = navigation
        self._navigator: PlatformNavigator | None = None
        self._aligned = False
        self._random = [np.random.default_rng([seed, index]) for index in range(8)]
        self._lags: dict[str, Array] = {}
        self._phi, self._drift = np.zeros(3), np.zeros(3)
        self._calibrated = np.zeros(3)
        self._recent = np.zeros((0, 3))
        self._core = np.zeros(0)
        self._offsets: dict[int, Array] = {}

    def align(self) -> None:
        """End the alignment: navigate from here on, from no misalignment."""
        self._aligned = True
        if len(self._recent):
            self._calibrated = self._recent.mean(axis=0)
        self._phi = np.zeros(3)
        self._drift = self._drift - self._calibrated

    def advance(self, heading_deg: Array) -> PlatformSamples:
        """Return the next samples, one for each heading, shape (n,)."""
        p, count = self.parameters, len(heading_deg)
        number = self._count + np.arange(count)
        self._count += count
        time_s = np.asarray(self.step_s * number, dtype=np.float64)
        angle = np.asarray(self._start_angle + EARTH_RATE_RAD_S * time_s, dtype=np.float64)
        ambient = self._wander("ambient", 0, count, p.ambient_k, p.ambient_h)
        true_c = self._lag("temp", self._drive(p, angle, heading_deg) + ambient, p.tau_h)
        true_c = true_c + p.start_k * np.exp(-time_s / (p.tau_h * _HOUR))
        core = self._lag("core", true_c, p.core_tau_h)
        if p.second_pole_h:
            core = self._lag("second", core, p.second_pole_h)
        thermal = self._thermal(p, "", angle, core)
        if p.gradient is not None:
            hidden = self._lag("hidden", self._drive(p.gradient, angle, heading_deg), p.gradient_tau_h)
            thermal = thermal + self._thermal(p.gradient, "hidden ", angle, hidden)
        wander = self._wander("drift", 1, count, p.wander_dph, p.wander_h, axes=3)
        stepped = self._by_heading(heading_deg, p.friction_dph, 9)
        drift = thermal + wander + stepped
        phi = self._misalignment(drift)
        offset = self._by_heading(heading_deg, p.offset_as, 8)
        force = self._force(angle, phi, true_c, np.radians(heading_deg))
        north, east = self._position(angle, phi + offset)
        noise = p.white_as * self._random[2].standard_normal((count, 2))
        noise = noise + self._wander("position", 3, count, p.slow_as, p.slow_h, axes=2)
        sensor = p.sensor_k * self._random[4].standard_normal(count)
        return PlatformSamples(
            time_s=time_s,
            angle_rad=angle,
            heading_deg=np.asarray(heading_deg, dtype=np.float64),
            north_as=north + noise[:, 0],
            east_as=east + noise[:, 1],
            temp_c=true_c + sensor,
            ambient_c=25.0 + ambient,
            core_c=core,
            thermal_dph=thermal,
            phi_as=phi + offset,
            force_mps2=force,
        )

    def _force(self, angle: Array, phi_as: Array, true_c: Array, heading: Array) -> Array:
        """Return what the accelerometers measure, m/s2, (n, 3), on a platform turned by small angles `phi_as`."""
        errors, count = self.parameters.accelerometers, len(angle)
        vertical = _vertical(angle, self.parameters.latitude_deg)
        turned = vertical + np.cross(phi_as * ARCSEC_RAD, vertical)
        turned /= np.linalg.norm(turned, axis=1, keepdims=True)  # a turn does not change the modulus
        gravity = gravity_mps2(self.parameters.latitude_deg)
        force = errors.measured(gravity * turned, true_c - SET_POINT_C, heading)
        # the mean of a step's white noise; the density is one-sided
        white = errors.white_mps2_per_sqrt_hz / math.sqrt(2.0 * self.step_s)
        force += white * self._random[6].standard_normal((count, 3))
        wander: Array = self._wander("force", 7, count, errors.wander_mps2, errors.wander_h, axes=3)
        return force + wander

    def _drive(self, p: PlatformParameters, angle: Array, heading_deg: Array) -> Array:
        body = _body_axes(angle, np.radians(heading_deg), math.radians(p.latitude_deg))
        exposure = np.einsum("mi,nij,mj->nm", p.element, body, p.case)
        drive: Array = SET_POINT_C + exposure @ p.linear_k + (exposure**2 - 1.0 / 3.0) @ p.square_k
        return drive

    def _thermal(self, p: PlatformParameters, name: str, angle: Array, core_c: Array) -> Array:
        vertical = _vertical(angle, p.latitude_deg)
        x = (core_c - SET_POINT_C)[:, None]
        before = self._lags.get(name + "last core", core_c[:1])
        self._lags[name + "last core"] = core_c[-1:]
        change = np.diff(core_c, prepend=before)[:, None] / (self.step_s / _HOUR)
        drift: Array = x * (vertical @ p.gravity.T) + x * p.constant + x**2 * p.square + change * p.rate
        return p.scale_dph * drift

    def _lag(self, name: str, value: Array, tau_h: float) -> Array:
        """First-order lag by Tustin's rule, settled on the first sample."""
        tau_s = tau_h * _HOUR
        gain = self.step_s / (2.0 * tau_s + self.step_s)
        decay = (2.0 * tau_s - self.step_s) / (2.0 * tau_s + self.step_s)
        driven = gain * value
        driven[1:] += gain * value[:-1]
        driven[0] += self._lags.get(name, value[0] * (1.0 - gain))
        lagged = follow(driven, decay)
        self._lags[name] = gain * value[-1] + decay * lagged[-1]
        return lagged

    def _wander(self, name: str, stream: int, count: int, sigma: float, tau_h: float, axes: int = 0) -> Array:
        """Gauss-Markov noise of standard deviation `sigma`, stationary from the first sample."""
        random = self._random[stream]
        width = max(axes, 1)
        decay = math.exp(-self.step_s / (tau_h * _HOUR))
        state = self._lags.get(name)
        if state is None:
            state = decay * random.standard_normal(width)
        white = math.sqrt(1.0 - decay**2) * random.standard_normal((count, width))
        white[0] += state
        series = follow(white, decay)
        self._lags[name] = decay * series[-1]
        return sigma * (series if axes else series[:, 0])

    def _by_heading(self, heading_deg: Array, sigma: float, stream: int) -> Array:
        """A vector of its own for each heading (within 4 deg), zero at heading 0."""
        key = np.rint(np.mod(heading_deg, 360.0) / 4.0).astype(np.int64) % 90
        vectors = np.zeros((90, 3))
        if sigma:
            for sector in np.unique(key):
                if sector:
                    rng = np.random.default_rng([self._seed, stream, int(sector)])
                    vectors[sector] = rng.normal(0, sigma, 3)
        chosen: Array = vectors[key]
        return chosen

    def _misalignment(self, drift: Array) -> Array:
        if not self._aligned:
            keep = round(48.0 * _HOUR / self.step_s)
            self._recent = np.concatenate([self._recent, drift])[-keep:]
            self._drift = drift[-1]
            return np.zeros_like(drift)
        used = drift - self._calibrated
        before = np.concatenate([self._drift[None], used[:-1]])
        phi = self._phi + np.cumsum(0.5 * self.step_s * (before + used), axis=0)
        self._phi, self._drift = phi[-1], used[-1]
        return phi

    def _position(self, angle: Array, phi: Array) -> tuple[Array, Array]:
        if not self._aligned:
            return np.zeros(len(angle)), np.zeros(len(angle))
        latitude = math.radians(self.parameters.latitude_deg)
        if self._navigation == "nonlinear":
            if self._navigator is None:
                self._navigator = PlatformNavigator(
                    self.parameters.latitude_deg,
                    float(angle[0]) - EARTH_RATE_RAD_S * self.step_s,
                    self.step_s,
                    damping=self.parameters.damping,
                )
            north, east = self._navigator.advance(phi)
            return north, east * math.cos(latitude)
        # With damping the linear form is late by 2 zeta / w; not modelled here: the nonlinear form has it.
        sine, cosine = np.sin(angle), np.cos(angle)
        tilt = phi[:, 0] * cosine + phi[:, 1] * sine
        return (
            phi[:, 0] * sine - phi[:, 1] * cosine,
            phi[:, 2] * math.cos(latitude) - tilt * math.sin(latitude),
        )


def _vertical(angle: Array, latitude_deg: float) -> Array:
    """Return the direction up in inertial axes, (n, 3)."""
    latitude = math.radians(latitude_deg)
    level, up = math.cos(latitude), math.sin(latitude)
    return np.stack([level * np.cos(angle), level * np.sin(angle), np.full_like(angle, up)], axis=1)


def _body_axes(angle: Array, heading: Array, latitude: float) -> Array:
    """Return right, front and up of a level case in inertial axes, as columns: (n, 3, 3)."""
    sine, cosine, zero = np.sin(angle), np.cos(angle), np.zeros_like(angle)
    level, up = math.cos(latitude), math.sin(latitude)
    east = np.stack([-sine, cosine, zero], axis=1)
    north = np.stack([-up * cosine, -up * sine, np.full_like(angle, level)], axis=1)
    vertical = np.stack([level * cosine, level * sine, np.full_like(angle, up)], axis=1)
    turn, straight = np.sin(heading)[:, None], np.cos(heading)[:, None]
    right, front = east * straight - north * turn, east * turn + north * straight
    axes: Array = np.stack([right, front, vertical], axis=2)
    return axes
