"""How sure a cause may be is learned from claims whose truth was drawn with odds that are known."""

from __future__ import annotations

import math

import numpy as np
import pytest

from benchmarks.gap_exam._claims import Claim, _claim, claims_table, foretold, log_odds

ODDS = np.array([1.5, 2.0, -1.0, -1.0])


def drawn(family: str, count: int, seed: int) -> list[Claim]:
    rng = np.random.default_rng(seed)
    claims = []
    for _ in range(count):
        sigmas, left, unknown = (
            3.0 * (20.0 / 3.0) ** rng.random(),
            10.0 ** rng.uniform(-3, -0.5),
            rng.random() < 0.3,
        )
        logit = ODDS @ [1.0, math.log(sigmas / 10.0), math.log10(left / 0.01), float(unknown)]
        true = rng.random() < 0.9 / (1.0 + math.exp(-logit))
        claims.append(Claim(family, sigmas, left, unknown, 0.9, 0.95, true))
    return claims


def test_the_odds_that_claims_were_drawn_with_are_found() -> None:
    assert log_odds(drawn("a", 6000, 1)) == pytest.approx(ODDS, abs=0.2)


def test_a_family_is_judged_by_the_others_alone() -> None:
    """A family in which nothing is true is foretold as the others are; its own claims do not count."""
    others = [claim for number in range(3) for claim in drawn(f"f{number}", 800, number)]
    false = [Claim("false", 20.0, 1e-3, False, 1.0, 0.95, False)] * 200
    sure = foretold([*others, *false])
    assert (sure[-200:] > 0.9).all()
    at = (sure[:-200] > 0.6) & (sure[:-200] < 0.8)
    true = np.array([claim.true for claim in others])[at]
    assert true.mean() == pytest.approx(float(sure[:-200][at].mean()), abs=3.0 * 0.5 / math.sqrt(at.sum()))


def test_the_table_counts_what_was_stated() -> None:
    lines = claims_table([*drawn("a", 300, 4), *drawn("b", 300, 5)])
    count = sum(claim.true for claim in (*drawn("a", 300, 4), *drawn("b", 300, 5)))
    assert lines[0].startswith("600 claims, 2 families.")
    assert any(line.startswith(f"| 0.94 to 1.00 | {count}/600 ") for line in lines)


def test_a_claim_is_read_from_an_answer() -> None:
    cause = {
        "name": "shupe", "set": ["shupe", "gradient"], "probability": 0.5, "set_probability": 0.8,
        "parameters": {"a": -6.0, "b": 1.0}, "sigma": {"a": 0.5, "b": 0.2}, "explained_where_it_acts": 0.75,
    }  # fmt: skip
    sets = {"gradient + warm_up": 0.3, "shupe": 0.4, "warm_up": 0.3}
    claim = _claim("f", cause, sets, True, true=False)
    assert claim == Claim("f", 12.0, 0.25, True, pytest.approx(0.7), 0.8, False)
    assert _claim("f", {**cause, "set": ["shupe"]}, sets, True, true=False).stated == 0.5
