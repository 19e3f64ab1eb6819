"""Answers against seals: each case marked, and how true what was stated is."""

from __future__ import annotations

import json
import math
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.gap_exam._files import Seal, gap_of, read_arrays, read_seal, sealed_step_s
from benchmarks.gap_exam._mechanisms import BESIDE, CHANGING, DISTURBANCES, NAMES
from benchmarks.gap_exam._separable import indistinct
from benchmarks.gap_exam._whitening import NoiseLevels, Part, remaining, resampled
from drivers.base.arrays import Array

_TWO_SIDED = 1.96
_LEAST_DEFLECTION = 5.0
"""Below it a run's gap is too small to say what part of it is gone."""


@dataclass(frozen=True)
class Stated:
    """A cause as stated: one name or a set of them, its probability, parameters with standard deviations."""

    members: frozenset[str]
    probability: float
    values: Mapping[str, float]
    sigmas: Mapping[str, float]


@dataclass(frozen=True)
class Answer:
    """What was answered. `unknown`: something outside the catalogue is there; `differs`: it changes with
    repeats.
    """

    causes: tuple[Stated, ...]
    noise: frozenset[str]
    unknown: bool
    differs: bool
    share: tuple[float, float, float] | None
    """Stated shrinkage on held-out runs with its interval."""
    seconds: float
    error: str

    @property
    def named(self) -> frozenset[str]:
        return frozenset().union(*(cause.members for cause in self.causes))


def read_answer(path: Path) -> Answer:
    """Return an answer as `diagnose` here wrote it, or as `gyrobench gap diagnose --json` printed it."""
    data: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
    facts: dict[str, Any] = data["units"][0] if "units" in data else data.get("facts", data)
    causes = [
        Stated(
            frozenset(cause.get("set") or [cause["name"]]),
            float(cause["set_probability"] if cause.get("set") else cause["probability"]),
            cause.get("parameters", {}),
            cause.get("sigma", {}),
        )
        for cause in facts.get("causes", ())
    ]
    noise = facts.get("stochastic", {})
    causes += [
        Stated(frozenset([name]), float(noise[name]), {}, {}) for name in noise if name in DISTURBANCES
    ]
    held = facts.get("held_out") or {}
    numbers = [held.get("share"), *held.get("interval_95", ())]
    known = len(numbers) == 3 and all(value is not None for value in numbers)
    return Answer(
        tuple(causes),
        frozenset(noise) - set(DISTURBANCES),
        float(facts.get("unknown_probability") or 0.0) > 0.5,
        any(part.get("follows") == "the repeat" for part in facts.get("unknown_parts", ())),
        (float(numbers[0]), float(numbers[1]), float(numbers[2])) if known else None,
        float(data.get("seconds", math.nan)),
        str(data.get("error", "")),
    )


@dataclass(frozen=True)
class Marked:
    """A case, opened and compared.

    `right`: of every cause stated whether it is true; `found`: of every known effect whether it is named.
    `closed` is the part of the true gap in the held-out runs that is gone, `elsewhere` the same on a profile
    never shown. `covered`: of parameters whose truth is known whether the interval holds it.
    """

    name: str
    seal: Seal
    answer: Answer
    right: tuple[bool, ...]
    found: Mapping[str, bool]
    closed: float
    elsewhere: float
    covered: tuple[bool, ...]
    twins: tuple[bool, ...] = ()
    """Of every false cause of a case with one effect: whether the runs cannot tell it from the true one."""

    @property
    def kind(self) -> str:
        """The case's kind; a case whose only effect is foreign to the catalogue is one outside, and the
        reverse.
        """
        if self.seal.kind in ("single", "outside"):
            return "single" if self.known else "outside"
        return self.seal.kind

    @property
    def known(self) -> tuple[str, ...]:
        """Its effects that the catalogue knows."""
        return tuple(name for name, _ in self.seal.effects if self.seal.names.get(name))

    @property
    def changing(self) -> bool:
        return any(name in self.seal.changing and name not in self.known for name, _ in self.seal.effects)

    @property
    def snr(self) -> float:
        """The largest ratio of its effects, 0 without one."""
        return max(self.seal.snr.values(), default=0.0)

    @property
    def exact(self) -> bool:
        """Whether all known effects are named and nothing else is."""
        return (
            all(self.found.values())
            and all(self.right)
            and not self.answer.unknown
            and not self.answer.differs
        )

    @property
    def false_cause(self) -> bool:
        return not all(self.right)

    @property
    def alarmed(self) -> bool:
        """Whether anything was named."""
        return bool(self.answer.causes or self.answer.noise or self.answer.unknown or self.answer.differs)


def marked_cases(folder: Path) -> Iterator[Marked]:
    """Yield the cases of a folder that have an answer."""
    noise = _sheet(folder)
    for path in sorted((folder / "answers").glob("*.json")):
        seal = _completed(read_seal(folder / "sealed" / path.name))
        yield _marked(folder, path.stem, seal, read_answer(path), noise)


def _sheet(folder: Path) -> NoiseLevels:
    names = (
        "arw_deg_per_sqrt_h",
        "bias_instability_dph",
        "rate_random_walk_dph_per_sqrt_h",
        "quantum_arcsec",
    )
    table = tomllib.loads((folder / "nominal.toml").read_text(encoding="utf-8"))["noise"]
    return NoiseLevels(*(float(table.get(name, 0.0)) for name in names))


def _completed(seal: Seal) -> Seal:
    """Return a seal with what the catalogue calls its effects, where it does not say so itself."""
    if seal.names or not seal.effects:
        return seal
    effects = [name for name, _ in seal.effects]
    return Seal(
        seal.kind,
        seal.effects,
        {name: ratio for name, ratio in seal.snr.items() if seal.kind != "noise"},
        seal.held_out,
        {name: NAMES.get(name, ()) for name in effects},
        {name: BESIDE.get(name, ()) for name in effects},
        seal.parameters,
        tuple(name for name in effects if name in CHANGING),
    )


def _marked(folder: Path, name: str, seal: Seal, answer: Answer, noise: NoiseLevels) -> Marked:
    effects = [effect for effect, _ in seal.effects]
    names = {effect: set(seal.names.get(effect, ())) for effect in effects}
    allowed = set().union(*names.values(), *(seal.beside.get(effect, ()) for effect in effects))
    right, covered = [], []
    for cause in answer.causes:
        meant = [effect for effect in effects if cause.members & names[effect]]
        strangers = cause.members - allowed
        apart = bool(meant and strangers) and not indistinct(
            folder, name, {effect: names[effect] for effect in meant}, strangers, noise
        )
        right.append(bool(cause.members & allowed) and not apart)
        for effect in meant:
            truth = seal.parameters.get(effect, {})
            covered += [
                abs(cause.values[key] - truth[key]) <= _TWO_SIDED * cause.sigmas[key]
                for key in truth
                if key in cause.values and cause.sigmas.get(key)
            ]
    named = frozenset().union(
        *(cause.members for cause, true in zip(answer.causes, right, strict=True) if true)
    )
    found = {effect: bool(named & own) for effect, own in names.items() if own and seal.kind != "noise"}
    shares = _true_shares(folder, name, seal, noise)
    twins = [
        indistinct(folder, name, names, cause.members, noise)
        for cause, true in zip(answer.causes, right, strict=True)
        if not true and len(effects) == len(seal.snr) == 1
    ]
    return Marked(name, seal, answer, tuple(right), found, *shares, tuple(covered), tuple(twins))


def _true_shares(folder: Path, name: str, seal: Seal, noise: NoiseLevels) -> tuple[float, float]:
    """Return the part of the true gap that is gone on held-out runs, and on a profile never shown; NaN
    without one.

    Disturbances, which no column predicts, do not count. Energies are whitened by the data sheet's noise,
    with what the nominal model re-calibrates projected out.
    """
    made = folder / "answers" / f"{name}.npz"
    if not seal.effects or seal.kind == "noise" or not made.exists():
        return math.nan, math.nan
    closing, truth = read_arrays(made), read_arrays(folder / "sealed" / f"{name}.npz")
    keys = [key.partition("|")[2] for key in closing if key.startswith("closed|")]
    effects = [effect for effect, _ in seal.effects if not set(seal.names[effect]) & set(DISTURBANCES)]
    if not effects:
        return math.nan, math.nan

    def share(among: Sequence[str]) -> float:
        return _share([_part(gap_of(truth, effects, key), closing, key) for key in among], noise)

    return share(keys), share([key for key in keys if key in seal.left_out])


def _share(parts: Sequence[Part], noise: NoiseLevels) -> float:
    """Return the part of the energy of the first signal that is gone when the second is taken off."""
    if not parts:
        return math.nan
    gram = remaining(parts, noise)
    before = float(gram[0, 0])
    if before < _LEAST_DEFLECTION**2:
        return math.nan
    return 1.0 - float(gram[0, 0] - 2.0 * gram[0, 1] + gram[1, 1]) / before


def _part(gap: Array, answered: Mapping[str, Array], key: str) -> Part:
    """Return gap and what closes it in a run, on the coarser of their periods."""
    closing, nominal, seen = (answered[f"{what}|{key}"] for what in ("closed", "nominal", "seen"))
    period_s = float(answered[f"period|{key}"][0])
    apart_s = sealed_step_s(gap, len(closing) * period_s)
    coarse = max(apart_s, period_s)
    gap = resampled(gap[None], apart_s, coarse)
    closing = resampled(closing[None], period_s, coarse)
    nominal = resampled(nominal, period_s, coarse)
    known = resampled(seen[None], period_s, coarse)
    n = min(gap.shape[1], closing.shape[1])
    rows = np.concatenate((gap[:, :n], closing[:, :n]))
    return Part(rows, nominal[:, :n], known[0, :n] > 0.5, coarse)
