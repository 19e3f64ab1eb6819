"""The dwells of the standards' test plan: which there are, how long and how often, by grade and by noise."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Literal

from bench.control.procedure import Parameters, parameter
from bench.record.events.run import Interval
from procedures._by_noise import AtRest, Schedule, finest, schedules, shortest

STEPS = 5
EAST_BY_HAND = ("mems",)
"""Grades too noisy to find east by the Earth rate within the 2 deg that are accepted: it is what was mounted."""
SETTLE_S = 20.0
"""Time for what the table has moved to come to rest in the output."""
_MOVE_S = 10.0
_SHOWN = 7.2
"""Standard errors of a small input of which half is then shown in 19 of 20 tests: (1.96 + 1.645) / 0.5."""
_LARGEST = 3.0
"""Standard errors up to which the largest of some twenty residuals is usually noise."""
_SINGLE = math.sqrt(1.5)
"""The error of a difference B - (A + C) / 2 over that of one dwell."""
_RATE_DWELL_S, _LONGEST_RATE_DWELL_S = 60.0, 600.0
_SEQUENCES = range(2, 7)
_TEMPERATURE_DWELL_S = 600.0
_ROLLS_DEG = {"as_mounted": (0.0,), "reversed": (0.0, 180.0), "both": (0.0, 180.0, 90.0, 270.0)}
"""Positions about the input axis for its misalignment, right-handed from how the unit is mounted first."""


@dataclass(frozen=True)
class Grade:
    """What a class of gyro needs: times in min, h and s, the smallest input in deg/h, power cycles.

    `steps_h` is the time for threshold, and again for resolution; `rates_h` that for all rate sequences;
    `residual_ppm` the nonlinearity that should be told from noise.
    """

    warm_up_min: float
    bias_min: float
    noise_h: float
    smallest_step_dph: float
    steps_h: float
    east_dwell_s: float
    residual_ppm: float
    rates_h: float = 6.0
    power_cycles: int = 6


GRADES = {
    "fog": Grade(60.0, 60.0, 6.0, 0.01, 4.0, 900.0, 1.0),
    "rlg": Grade(60.0, 120.0, 12.0, 0.002, 8.0, 1800.0, 0.1),
    "mems": Grade(20.0, 30.0, 2.0, 0.6, 3.0, 600.0, 100.0),
}


class StandardTestParameters(Parameters):
    """What to test; what is not given follows from the grade, or from the noise that the test measures itself."""

    grade: Literal["fog", "rlg", "mems"] = parameter("fog", "class of gyro: fog, rlg or mems")
    warm_up_min: float | None = parameter(None, "warm-up (not given: by grade)", "min", ge=10, le=600)
    bias_min: float | None = parameter(None, "bias record (not given: by grade)", "min", ge=10, le=1440)
    noise_h: float | None = parameter(
        None, "record for the Allan deviation (not given: by grade)", "h", ge=0.5, le=200
    )
    smallest_step_dph: float | None = parameter(
        None,
        "smallest input of threshold and resolution, doubled four times (not given: by grade)",
        "deg/h",
        gt=0,
        le=0.6,
    )
    steps_h: float | None = parameter(
        None, "most time for threshold, and again for resolution (not given: by grade)", "h", gt=0, le=200
    )
    step_dwell_s: float | None = parameter(
        None,
        "dwell at each input, once (not given: dwell and repeats by the noise measured)",
        "s",
        ge=60,
        le=7200,
    )
    east_dwell_s: float | None = parameter(
        None, "dwell of the search for east (not given: by grade)", "s", ge=60, le=7200
    )
    power_cycles: int | None = parameter(
        None,
        "switch off and on so often, with a bias record each (not given: 6, as GJB 2426A asks)",
        ge=0,
        le=20,
    )
    off_s: float = parameter(60.0, "time without power", "s", ge=5, le=7200)
    misalignment: Literal["as_mounted", "reversed", "both"] = parameter(
        "both",
        "as_mounted: one position, the fixture's error in it; reversed: turned by 180 deg in the fixture as "
        "well, free of it; both: four positions, both components",
    )
    max_rate_dps: float = parameter(20.0, "largest rate of the scale-factor test", "deg/s", gt=0, le=1000)
    rates_per_sign: int = parameter(11, "rates of each sign", "", ge=2, le=50)
    residual_ppm: float | None = parameter(
        None, "nonlinearity to be told from noise (not given: by grade)", "ppm", gt=0, le=1e5
    )
    rates_h: float | None = parameter(
        None, "most time for the rate sequences (not given: by grade)", "h", gt=0, le=200
    )
    sequences: int | None = parameter(
        None,
        "rate sequences, for the repeatability (not given: 2, or more by the noise measured)",
        ge=1,
        le=20,
    )
    rate_dwell_s: float | None = parameter(
        None,
        "least time at a rate, rounded up to whole turns (not given: 60 s, or longer by the noise measured)",
        "s",
        ge=10,
        le=3600,
    )
    temperatures: bool = parameter(True, "test bias and scale factor at low_c and high_c too")
    low_c: float = parameter(-40.0, "cold temperature", "degC", ge=-70, le=20)
    high_c: float = parameter(60.0, "hot temperature", "degC", ge=30, le=125)
    room_c: float = parameter(25.0, "room temperature", "degC", ge=10, le=35)
    soak_min: float = parameter(150.0, "soak at each temperature", "min", ge=10, le=1440)
    ramp_k_per_min: float = parameter(2.0, "ramp between temperatures", "K/min", gt=0, le=10)
    azimuth_deg: float = parameter(
        90.0, "table angle at which the axis should point east", "deg", ge=0, lt=360
    )

    def preset(self) -> Grade:
        """Return the grade's preset with what was given in its place."""
        preset = GRADES[self.grade]
        given = {name: getattr(self, name) for name in Grade.__dataclass_fields__}
        return replace(preset, **{name: value for name, value in given.items() if value is not None})

    def rates(self) -> list[float]:
        """Return one sequence: zero, up to the largest rate and back, the same to the other side, zero."""
        # the product first: the largest rate is then the one that was asked for, to the last bit
        up = [
            self.max_rate_dps * number / self.rates_per_sign for number in range(1, self.rates_per_sign + 1)
        ]
        side = [*up, *up[-2::-1], 0.0]
        return [0.0, *side, *(-rate for rate in side)]


@dataclass(frozen=True)
class Dwell:
    """An interval of measurement to come: how long, and what passes before it, s; `fields` as in its event."""

    test: str
    length_s: float
    before_s: float = 0.0
    fields: dict[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class SmallInput:
    """An input of threshold and resolution, and how it is put in."""

    number: int
    input_dph: float
    schedule: Schedule

    @property
    def shown(self) -> bool:
        """Whether half of it would be shown."""
        return _SHOWN * self.schedule.error_dph <= self.input_dph


@dataclass(frozen=True)
class Plan:
    """All dwells of a test, part by part.

    `too_noisy`: units that no input would show in the time, beside others that one would: they had no say.
    """

    p: StandardTestParameters
    grade: Grade
    inputs: tuple[SmallInput, ...]
    rate_dwell_s: float
    sequences: int
    too_noisy: tuple[str, ...] = ()

    @classmethod
    def of(cls, p: StandardTestParameters) -> Plan:
        """Return the plan before anything is measured."""
        grade, gap_s = p.preset(), SETTLE_S + _MOVE_S
        dwell_s = p.step_dwell_s or max(60.0, 3600.0 * grade.steps_h / (3 * STEPS) - gap_s)
        inputs = tuple(
            SmallInput(number, grade.smallest_step_dph * 2.0**number, Schedule(dwell_s, 1, math.nan, gap_s))
            for number in range(STEPS)
        )
        return cls(p, grade, inputs, p.rate_dwell_s or _RATE_DWELL_S, p.sequences or _SEQUENCES[0])

    def after(self, records: Mapping[str, AtRest]) -> Plan:
        """Return the plan that the noise asks for which the units have shown.

        The noisiest of those counts that can be shown the largest input in `steps_h`; where none can, the
        quietest.
        """
        known = {name: schedules([record], SETTLE_S + _MOVE_S) for name, record in records.items()}
        known = {name: found for name, found in known.items() if found}
        if not known:
            return self
        able = [name for name, found in known.items() if _inputs(found, self.grade)[-1].shown]
        if not able:
            able = [min(known, key=lambda name: known[name][0].error_dph)]
        among = schedules([records[name] for name in able], SETTLE_S + _MOVE_S)
        inputs = self.inputs
        if self.p.step_dwell_s is None:
            inputs = _inputs(among, self.grade)
        else:
            single = [each for each in among if each.repeats == 1]
            near = min(single, key=lambda each: abs(math.log(each.dwell_s / inputs[0].schedule.dwell_s)))
            inputs = tuple(
                replace(each, schedule=replace(each.schedule, error_dph=near.error_dph)) for each in inputs
            )
        rate_dwell_s, sequences = self._rates(among)
        return replace(
            self,
            inputs=inputs,
            rate_dwell_s=rate_dwell_s,
            sequences=sequences,
            too_noisy=tuple(name for name in known if name not in able),
        )

    @property
    def by_noise(self) -> bool:
        """Whether a record at rest settled what was not given."""
        return math.isfinite(self.inputs[0].schedule.error_dph)

    @property
    def shown_dph(self) -> float | None:
        """The smallest input that should be shown; None where none should, or nothing is known."""
        return min((each.input_dph for each in self.inputs if each.shown), default=None)

    def _rates(self, among: Sequence[Schedule]) -> tuple[float, int]:
        """Return dwell and number of sequences that tell a nonlinearity of `residual_ppm` soonest."""
        p, wanted_dph = self.p, 1e-6 * self.grade.residual_ppm * 3600.0 * self.p.max_rate_dps
        dwells = {each.dwell_s: each.error_dph for each in among if each.repeats == 1}
        if p.rate_dwell_s is not None:
            near = min(dwells, key=lambda dwell_s: abs(math.log(dwell_s / self.rate_dwell_s)))
            dwells = {p.rate_dwell_s: dwells[near]}
        numbers = _SEQUENCES if p.sequences is None else (p.sequences,)
        found = []
        for dwell_s, error_dph in dwells.items():
            for number in numbers if dwell_s <= _LONGEST_RATE_DWELL_S or p.rate_dwell_s else ():
                # each rate is dwelt at twice a sequence
                residual_dph = _LARGEST * error_dph / _SINGLE / math.sqrt(2.0 * number)
                hours = number * self._sequence_s(dwell_s) / 3600.0
                found.append((residual_dph, hours, dwell_s, number))
        within = [each for each in found if each[1] <= self.grade.rates_h]
        if good := [each for each in within if each[0] <= wanted_dph]:
            _, _, dwell_s, number = min(good, key=lambda each: each[1])
        else:
            _, _, dwell_s, number = min(within or [min(found, key=lambda each: each[1])])
        return dwell_s, number

    def at_rate_s(self, rate_dps: float, least_s: float | None = None) -> float:
        """Return the time at a rate: whole turns, so that errors that turn with the table cancel."""
        least_s = least_s or self.rate_dwell_s
        if rate_dps == 0.0:
            return least_s
        turn_s = 360.0 / abs(rate_dps)
        return turn_s * math.ceil(least_s / turn_s)

    def _sequence_s(self, dwell_s: float) -> float:
        return sum(self.at_rate_s(rate, dwell_s) + SETTLE_S + _MOVE_S for rate in self.p.rates())

    # The parts, in the order of the test

    @property
    def warm_up(self) -> Dwell:
        """The record from switch-on."""
        return Dwell("warm_up", 60.0 * self.grade.warm_up_min)

    @property
    def noise(self) -> Dwell:
        """The record for the Allan deviation."""
        return Dwell("noise", 3600.0 * self.grade.noise_h)

    def bias(self) -> Iterator[Dwell]:
        """The bias record after the warm-up, and after each power cycle."""
        again_s = self.p.off_s + 60.0 * self.grade.warm_up_min
        for cycle in range(self.grade.power_cycles + 1):
            yield Dwell("bias", 60.0 * self.grade.bias_min, again_s if cycle else 0.0, {"cycle": cycle})

    def small_inputs(self, test: str) -> Iterator[Dwell]:
        """Each input between two dwells without it."""
        for each in self.inputs:
            for place in range(2 * each.schedule.repeats + 1):
                fields = {"step": each.number, "input_dph": -each.input_dph if place % 2 else 0.0}
                yield Dwell(test, each.schedule.dwell_s, SETTLE_S + _MOVE_S, fields)

    def misalignment(self) -> Iterator[Dwell]:
        """Both senses of rotation in every position."""
        for roll_deg in _ROLLS_DEG[self.p.misalignment]:
            for rate in (self.p.max_rate_dps, -self.p.max_rate_dps):
                yield self._at_rate("misalignment", rate, roll_deg=roll_deg)

    def scale_factor(self) -> Iterator[Dwell]:
        """The rate sequences."""
        for sequence in range(1, self.sequences + 1):
            for rate in self.p.rates():
                yield self._at_rate("scale_factor", rate, sequence=sequence)

    def temperature(self) -> Iterator[Dwell]:
        """At rest and at the largest rate of both signs, at each temperature."""
        p, last_c = self.p, self.p.room_c
        for temp_c in (p.room_c, p.low_c, p.high_c) if p.temperatures else ():
            soak_s = 60.0 * (p.soak_min + abs(temp_c - last_c) / p.ramp_k_per_min)
            last_c = temp_c
            for rate in (0.0, p.max_rate_dps, -p.max_rate_dps):
                dwell = self._at_rate("temperature", rate, _TEMPERATURE_DWELL_S, temp_c=temp_c)
                yield replace(dwell, before_s=dwell.before_s + (0.0 if rate else soak_s))

    def _at_rate(self, test: str, rate_dps: float, least_s: float | None = None, **fields: float) -> Dwell:
        length_s = self.at_rate_s(rate_dps, max(least_s or 0.0, self.rate_dwell_s))
        return Dwell(test, length_s, SETTLE_S + _MOVE_S, {"rate_dps": rate_dps, **fields})

    def dwells(self) -> Iterator[Dwell]:
        """All of them."""
        yield self.warm_up
        if self.p.grade not in EAST_BY_HAND:
            yield from [Dwell("axis_east", self.grade.east_dwell_s, _MOVE_S)] * 4
        yield from self.bias()
        yield self.noise
        yield from self.small_inputs("threshold")
        yield from self.small_inputs("resolution")
        yield from self.misalignment()
        yield from self.scale_factor()
        yield from self.temperature()

    def intervals(self) -> list[Interval]:
        """Return the intervals that the record will have, and the search for east, from switch-on."""
        found, now_s = [], 0.0
        for dwell in self.dwells():
            start_s = now_s + dwell.before_s
            now_s = start_s + dwell.length_s
            found.append(Interval(dwell.test, start_s, now_s, **dwell.fields))
        return found

    @property
    def needed_dph(self) -> float:
        """The smallest input that the schedule of the largest one would show."""
        return _SHOWN * self.inputs[-1].schedule.error_dph

    def duration_s(self) -> float:
        """Return the time of all, the return to room temperature included."""
        p = self.p
        back_s = 60.0 * (p.high_c - p.room_c) / p.ramp_k_per_min if p.temperatures else 0.0
        return self.intervals()[-1].end_s + back_s


def _inputs(among: Sequence[Schedule], grade: Grade) -> tuple[SmallInput, ...]:
    """Return the inputs that can be shown in `steps_h`, the largest first of all; where none can, the largest."""
    left_s, found = 3600.0 * grade.steps_h, []
    for number in reversed(range(STEPS)):
        input_dph = grade.smallest_step_dph * 2.0**number
        schedule = shortest(among, input_dph / _SHOWN)
        if schedule is None or schedule.duration_s > left_s:
            break
        left_s -= schedule.duration_s
        found.append(SmallInput(number, input_dph, schedule))
    if not found:
        fine = finest(among, left_s) or min(among, key=lambda each: each.duration_s)
        found.append(SmallInput(STEPS - 1, grade.smallest_step_dph * 2.0 ** (STEPS - 1), fine))
    return tuple(reversed(found))
