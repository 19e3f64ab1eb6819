"""The catalogue: every effect of this package, and those that other packages add by entry point."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from drivers.base.arrays import Array
from drivers.base.errors import ConfigurationError
from drivers.base.plugins import entry_points_of
from simulators.effects._channel import Channel, ChannelEffect, ChannelInputs, Values, applied
from simulators.effects._disturbance import Disturbance
from simulators.effects._effect import Effect, NoiseEffect, Shape
from simulators.effects._impulses import IMPULSES
from simulators.effects._learned import learned_effect
from simulators.effects._limits import LIMIT_EFFECTS
from simulators.effects._mode_hop import MODE_HOP
from simulators.effects._motion import ACCELERATION_EFFECTS, ALIGNMENT_EFFECTS, TABLE_ANGLE_EFFECTS
from simulators.effects._noise_effects import NOISE_EFFECTS
from simulators.effects._platform_effects import PLATFORM_EFFECTS
from simulators.effects._sample_times import SAMPLE_CLOCK_SKEW, SAMPLE_TIME_EFFECTS, time_stamps
from simulators.effects._scale_factor import SCALE_FACTOR_OVER_RATE, SCALE_FACTOR_OVER_TEMPERATURE
from simulators.effects._steady_line import STEADY_LINE
from simulators.effects._thermal import BIAS_RAMP, MEMORY_EFFECTS, POLYNOMIAL_EFFECTS, SHUPE_EFFECTS, WARM_UP
from simulators.effects.chamber import CHAMBER_EFFECTS, chamber_air
from simulators.effects.heat import (
    CASE_HEAT,
    COMMANDED_HEAT,
    GYRO_HEAT,
    TEMPERATURE_SENSOR,
    case_temperature,
    gyro_temperature,
)
from simulators.effects.table import TABLE_EFFECTS, table_angle, table_rate

GROUP = "gyrobench.effects"
AnyEffect = Effect | NoiseEffect | Disturbance | ChannelEffect
CATALOGUE: tuple[AnyEffect, ...] = (
    *POLYNOMIAL_EFFECTS,
    *SHUPE_EFFECTS,
    *MEMORY_EFFECTS,
    MODE_HOP,
    WARM_UP,
    *SCALE_FACTOR_OVER_TEMPERATURE,
    *SCALE_FACTOR_OVER_RATE,
    *ALIGNMENT_EFFECTS,
    *TABLE_ANGLE_EFFECTS,
    *SAMPLE_TIME_EFFECTS,
    *ACCELERATION_EFFECTS,
    BIAS_RAMP,
    *LIMIT_EFFECTS,
    *NOISE_EFFECTS,
    IMPULSES,
    STEADY_LINE,
    *CHAMBER_EFFECTS,
    *CASE_HEAT,
    *COMMANDED_HEAT,
    *GYRO_HEAT,
    *TEMPERATURE_SENSOR,
    *TABLE_EFFECTS,
    SAMPLE_CLOCK_SKEW,
    *PLATFORM_EFFECTS,
)


def add_effects(values: Iterable[object], file: Path) -> list[str]:
    """Add those of a file's values that are effects to the catalogue of this process, and return their names.

    What the file imports from the catalogue is not its own. ConfigurationError for a name that is there already.
    """
    known = catalogue()
    own = [value for value in values if isinstance(value, (Effect, Disturbance, ChannelEffect))]
    own = [value for value in own if known.get(value.name) is not value]
    for effect in own:
        if effect.name not in _FROM_FILES or _FROM_FILES[effect.name][1] != file.resolve():
            _check(effect, str(file), known)
        _FROM_FILES[effect.name] = (effect, file.resolve())
    return [effect.name for effect in own]


_FROM_FILES: dict[str, tuple[AnyEffect, Path]] = {}


def catalogue() -> dict[str, AnyEffect]:
    """Return the effects by name: this package's, those of the entry point group `gyrobench.effects`, then those
    that `add_effects` added.

    An entry point names an `Effect`, a `Disturbance`, a `ChannelEffect` or a sequence of them.
    ConfigurationError for a name that is there twice or an entry point that is something else.
    """
    found: dict[str, AnyEffect] = {effect.name: effect for effect in CATALOGUE}
    for point in entry_points_of(GROUP):
        loaded = point.load()
        for effect in loaded if isinstance(loaded, (tuple, list)) else (loaded,):
            _check(effect, point.value, found)
            found[effect.name] = effect
    return found | {name: effect for name, (effect, _) in _FROM_FILES.items()}


def effect_named(name: str, shape: Shape) -> AnyEffect | None:
    """Return the effect of a model's term: the catalogue's, or a learned form at its shape; None if unknown."""
    return learned_effect(name, shape) or catalogue().get(name)


def own_file(name: str) -> Path | None:
    """Return the file by which `add_effects` was given an effect, None for one of a package."""
    return _FROM_FILES[name][1] if name in _FROM_FILES else None


def _check(effect: object, where: str, found: dict[str, AnyEffect]) -> None:
    if not isinstance(effect, (Effect, Disturbance, ChannelEffect)):
        raise ConfigurationError(
            "what was to be an effect is none",
            where=where,
            found=type(effect).__name__,
            expected="Effect, Disturbance, ChannelEffect or a sequence of them",
            remedy="noise has the four coefficients of the model file's [noise]",
        )
    if isinstance(effect, ChannelEffect) and effect.apply is None:
        raise ConfigurationError(
            "an effect of a channel says nothing about the signal",
            where=where,
            found=f"{effect.name} without apply",
            expected="apply(inputs, signal, values) that returns the changed signal",
        )
    if effect.name in found:
        raise ConfigurationError("two effects of one name", where=where, found=effect.name)


def simulate(
    channel: Channel, inputs: ChannelInputs, values: Values, effects: Iterable[ChannelEffect]
) -> Array:
    """Return what a channel should have shown, (n,): its simulator, then every effect with an `apply`, in order.

    `effects` are the channel's; one that `values` lacks is at its neutral values.
    """
    return applied(channel, inputs, _SIMULATORS[channel](inputs, values), values, effects)


_SIMULATORS = {
    "chamber_air": chamber_air,
    "case_temperature": case_temperature,
    "gyro_temperature": gyro_temperature,
    "table_angle": table_angle,
    "table_rate": table_rate,
    "time_stamps": time_stamps,
}
