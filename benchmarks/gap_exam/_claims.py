"""How sure a cause may be: claims of answered cases against their truth, each family judged by the others.

A logistic regression (Cox, J. Roy. Stat. Soc. B 20, 1958) of what turned out true on a claim's size, on what is
left where it acts, and on whether something unknown stands beside it.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize
from scipy.special import expit

from bench.analysis.gap._causes import evidence
from benchmarks.gap_exam._score import marked_cases
from drivers.base.arrays import Array

_RIDGE = 0.5
"""Weight of the squares of the three slopes: a prior of standard deviation 1."""
_EDGES = (0.0, 0.5, 0.8, 0.9, 0.94, 1.0)


@dataclass(frozen=True)
class Claim:
    """A cause as stated: its standard deviations, the part `left` where it acts, and what it turned out to be.

    `acts` is the probability that the runs give it, or one of its set, `stated` what was told.
    """

    family: str
    sigmas: float
    left: float
    unknown: bool
    acts: float
    stated: float
    true: bool


def claims_of(folders: Sequence[Path]) -> Iterator[Claim]:
    """Yield the claims of answered folders; a folder is a family."""
    for folder in folders:
        for case in marked_cases(folder):
            path = folder / "answers" / f"{case.name}.json"
            facts: dict[str, Any] = json.loads(path.read_text(encoding="utf-8")).get("facts", {})
            for cause, true in zip(facts.get("causes", ()), case.right, strict=False):
                yield _claim(folder.resolve().name, cause, facts["sets"], case.answer.unknown, true=true)


def _claim(
    family: str, cause: Mapping[str, Any], sets: Mapping[str, float], unknown: bool, *, true: bool
) -> Claim:
    members = set(cause["set"] or [cause["name"]])
    return Claim(
        family,
        max(abs(cause["parameters"][key]) / max(sigma, 1e-300) for key, sigma in cause["sigma"].items()),
        1.0 - cause["explained_where_it_acts"],
        unknown,
        min(sum(part for names, part in sets.items() if members & set(names.split(" + "))), 1.0),
        cause["set_probability"] if len(members) > 1 else cause["probability"],
        true,
    )


def log_odds(claims: Sequence[Claim]) -> Array:
    """Return the log odds that best foretell which claims are true: constant and three slopes, (4,)."""
    columns, acts, true = _columns(claims), np.array([each.acts for each in claims]), _true(claims)

    def cost(slopes: Array) -> float:
        sure = np.clip(acts * expit(columns @ slopes), 1e-9, 1.0 - 1e-9)
        fit = np.where(true, np.log(sure), np.log1p(-sure)).sum()
        return float(_RIDGE * (slopes[1:] ** 2).sum() - fit)

    return np.asarray(minimize(cost, np.zeros(4)).x)


def foretold(claims: Sequence[Claim]) -> Array:
    """Return how probable each claim is by what the other families' claims say, (claims,)."""
    family = np.array([each.family for each in claims])
    result = np.zeros(len(claims))
    for name in np.unique(family):
        others = [each for each in claims if each.family != name]
        own = [each for each in claims if each.family == name]
        acts = np.array([each.acts for each in own])
        result[family == name] = acts * expit(_columns(own) @ log_odds(others))
    return result


def claims_table(claims: Sequence[Claim]) -> list[str]:
    """Return the fit to all claims, and how many are true by what was stated and by what others foretell."""
    fit = ", ".join(f"{value:.2f}" for value in log_odds(claims))
    lines = [f"{len(claims)} claims, {len({each.family for each in claims})} families. Log odds: {fit}", ""]
    lines += ["| probability | as stated: true | by the other families: true |", "|---|---|---|"]
    true, stated, left_out = _true(claims), np.array([each.stated for each in claims]), foretold(claims)
    for low, high in pairwise(_EDGES):
        cells = []
        for sure in (stated, left_out):
            at = (sure > low) & (sure <= high)
            cells.append(f"{true[at].sum()}/{at.sum()}" + (f" = {true[at].mean():.2f}" if at.any() else ""))
        lines.append(f"| {low:.2f} to {high:.2f} | {' | '.join(cells)} |")
    return [*lines, f"| log loss | {_loss(stated, true):.3f} | {_loss(left_out, true):.3f} |"]


def _columns(claims: Sequence[Claim]) -> Array:
    """Return what the diagnosis takes the log odds of each claim to be linear in, (claims, 4)."""
    rows = [evidence(each.sigmas, each.left, unknown=each.unknown) for each in claims]
    return np.array(rows).reshape(-1, 4)


def _true(claims: Sequence[Claim]) -> NDArray[np.bool_]:
    return np.array([each.true for each in claims], dtype=bool)


def _loss(sure: Array, true: NDArray[np.bool_]) -> float:
    return -float(np.where(true, np.log(np.maximum(sure, 1e-9)), np.log(np.maximum(1.0 - sure, 1e-9))).mean())
