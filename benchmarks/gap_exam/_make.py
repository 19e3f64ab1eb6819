"""Makes blind cases of a family: a unit, its campaign, effects of the size that their ratio asks for, logs
and seal.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from benchmarks.gap_exam._family import Effect, Family, Unit
from benchmarks.gap_exam._files import FOLDERS, SEALED_S, Logged, Seal, write_case, write_seal
from benchmarks.gap_exam._geometry import sensed_dph
from benchmarks.gap_exam._signals import drawn
from benchmarks.gap_exam._stage import Stage
from benchmarks.gap_exam._whitening import NoiseLevels, Part, deflection
from drivers.base.arrays import Array

KINDS = ("null", "single", "pair", "outside", "mixed", "noise")
_TWELVE = (
    "null",
    "single",
    "pair",
    "single",
    "outside",
    "null",
    "single",
    "mixed",
    "null",
    "single",
    "pair",
    "noise",
)
"""The kinds of twelve cases, again and again."""
_DRAWS = ("a", "b", "c", "form", "lean", "tilt", "order", "phase", "c1", "c2", "g1")
_HALVINGS = 14
_PER_RATIO = 10.0
"""Deflection of a signal-to-noise ratio of 1."""


@dataclass(frozen=True)
class Plan:
    """A case before it is made: effects with the ratio wanted; of a noise case the factor of the noise."""

    name: str
    kind: str
    seed: int
    effects: tuple[tuple[str, float], ...]


def plan(family: Family, seed: int, cases: int, only: str = "") -> list[Plan]:
    """Return what the cases of a seed hold; `only` one kind if it is given."""
    rng = drawn(seed, "plan", family.name)
    turns = {"known": _endless(family.known, rng), "foreign": _endless(family.foreign, rng)}
    noisy = _endless(tuple(family.noisy), rng)

    def some(group: str, most: float, least: float = family.weakest_ratio) -> tuple[str, float]:
        return next(turns[group]), math.exp(rng.uniform(math.log(least), math.log(most)))

    result, kinds = [], kinds_of(cases, only)
    for number in range(cases):
        kind = kinds[number]
        effects: list[tuple[str, float]] = []
        if kind == "single":
            effects = [some("known", 30.0)]
        elif kind == "pair":
            effects = [some("known", 20.0), some("known", 20.0)]
        elif kind == "outside":
            effects = [some("foreign", 30.0)]
        elif kind == "mixed":
            effects = [some("known", 20.0), some("foreign", 20.0, 2.0)]
        elif kind == "noise":
            name = next(noisy)
            low, high, _ = family.noisy[name]
            effects = [(name, math.exp(rng.uniform(math.log(low), math.log(high))))]
        result.append(Plan(f"{kind}_{seed}_{number}", kind, 10_000 * seed + number, tuple(effects)))
    return result


def kinds_of(cases: int, only: str = "") -> list[str]:
    """Return the kinds of so many cases: nulls, singles, pairs and others in turn, or one kind only."""
    return [only or _TWELVE[number % len(_TWELVE)] for number in range(cases)]


def _endless(names: Sequence[str], rng: np.random.Generator) -> Iterator[str]:
    """Yield all names in random order, then again in another."""
    while True:
        yield from rng.permutation(np.array(names)).tolist()


def draw_unit(family: Family, seed: int, inside: Mapping[str, float]) -> Unit:
    """Draw a unit within its data sheet."""
    rng = drawn(seed, "unit", family.name)
    draw = {name: float(rng.uniform()) for name in _DRAWS}
    sheet = family.sheet
    sf_ppm, slope_dph = rng.normal(0.0, (0.7 * sheet.sf_sigma_ppm, 0.7 * sheet.slope_sigma_dph))
    return Unit(seed, draw, float(sf_ppm), float(slope_dph), sheet, inside)


def make_case(family: Family, folder: Path, what: Plan) -> str:
    """Make a case, write it into cases/ and sealed/; return its name."""
    inside = dict(what.effects) if what.kind == "noise" else {}
    acting = () if what.kind == "noise" else what.effects
    unit = draw_unit(family, what.seed, inside)
    stages = family.campaign(unit)
    true = [sensed_dph(stage, family.latitude_deg) for stage in stages]
    signs = drawn(what.seed, "sign")
    sizes = {
        name: _size(family, unit, stages, true, name, snr)
        * (signs.choice((-1.0, 1.0)) if family.effects[name].signed else 1.0)
        for name, snr in acting
    }
    signals = {
        name: [family.effects[name].signal(unit, stage, size) for stage in stages]
        for name, size in sizes.items()
    }
    logs = []
    for k, stage in enumerate(stages):
        rng = drawn(unit.seed, "log", stage.key)
        gap = sum((own[k] for own in signals.values()), np.zeros(stage.steps))
        rate = _without_noise(unit, stage, true[k], rng) + gap
        output = family.rows(unit, stage, stage.in_rows(rate), rng)
        logs.append(Logged(stage, output, *family.read(unit, stage, rng)))
    write_case(folder / "cases" / what.name, family, logs)
    parts = {
        f"{name}|{stage.key}": stage.in_seconds(own[k], SEALED_S)
        for name, own in signals.items()
        for k, stage in enumerate(stages)
    }
    write_seal(folder / "sealed", what.name, _seal(family, unit, what, sizes, stages, signals, true), parts)
    return what.name


def _without_noise(unit: Unit, stage: Stage, true_dph: Array, rng: np.random.Generator) -> Array:
    """Return what the nominal model describes: scale factor, slope of bias, the bias of this turn-on."""
    bias = unit.slope_dph * (stage.t_in_c - 25.0) / 50.0 + rng.normal(0.0, unit.sheet.turn_on_sigma_dph)
    return np.asarray(true_dph * (1.0 + 1e-6 * unit.sf_ppm) + bias)


def _seal(
    family: Family,
    unit: Unit,
    what: Plan,
    sizes: Mapping[str, float],
    stages: Sequence[Stage],
    signals: Mapping[str, Sequence[Array]],
    true: Sequence[Array],
) -> Seal:
    acting: dict[str, Effect] = {name: family.effects[name] for name in sizes}
    noisy = {name: (family.noisy[name][2],) for name, _ in what.effects if name in family.noisy}
    return Seal(
        what.kind,
        tuple((name, sizes.get(name, size)) for name, size in what.effects),
        {name: _deflection(family, stages, true, own) / _PER_RATIO for name, own in signals.items()},
        tuple(stage.run_id for stage in stages if stage.held_out),
        {name: effect.names for name, effect in acting.items()} | noisy,
        {name: effect.beside for name, effect in acting.items()},
        {name: effect.truth(unit, sizes[name]) for name, effect in acting.items() if effect.truth},
        tuple(name for name, effect in acting.items() if effect.changing),
        tuple(stage.key for stage in stages if stage.held_out and stage.repeat == 0),
    )


def _size(
    family: Family, unit: Unit, stages: Sequence[Stage], true: Sequence[Array], name: str, snr: float
) -> float:
    """Return the size at which an effect has a signal-to-noise ratio."""
    effect = family.effects[name]

    def ratio(size: float) -> float:
        own = [effect.signal(unit, stage, size) for stage in stages]
        return _deflection(family, stages, true, own) / _PER_RATIO

    if not effect.curved:
        return snr / max(ratio(1.0), 1e-12)
    low, high = effect.sizes
    for _ in range(_HALVINGS):
        middle = math.sqrt(low * high)
        low, high = (middle, high) if ratio(middle) < snr else (low, middle)
    return math.sqrt(low * high)


def _deflection(
    family: Family, stages: Sequence[Stage], true: Sequence[Array], signals: Sequence[Array]
) -> float:
    """Return the deflection of a signal in the runs that are diagnosed."""
    parts = []
    for stage, rate, signal in zip(stages, true, signals, strict=True):
        if stage.held_out:
            continue
        nominal = np.stack((stage.in_seconds(rate), stage.in_seconds(stage.t_in_c) - 25.0))
        parts.append(Part(stage.in_seconds(signal)[None], nominal, stage.seen()))
    sheet = family.sheet
    noise = NoiseLevels(
        sheet.arw_deg_per_sqrt_h,
        sheet.bias_instability_dph,
        sheet.rate_random_walk_dph_per_sqrt_h,
        sheet.quantum_arcsec,
    )
    return deflection(parts, noise)


def prepare_folder(family: Family, folder: Path) -> None:
    """Make the folders of an exam and write the nominal model."""
    for name in FOLDERS:
        (folder / name).mkdir(parents=True, exist_ok=True)
    (folder / "nominal.toml").write_text(family.nominal_text, encoding="utf-8")
