"""A few simulated standard tests: perfect units show nothing, the others' intervals hold."""

from __future__ import annotations

import pytest
from scipy.stats import binom

from benchmarks.metrology import GRADES, STABILITIES, ZERO_WHEN_PERFECT, Grade, tallies

UNITS = 6


@pytest.mark.parametrize("grade", GRADES[:2], ids=lambda grade: grade.name)
def test_perfect_units_are_certified_with_nothing_and_intervals_hold(grade: Grade) -> None:
    good, bad = (tallies(grade, UNITS, perfect) for perfect in (True, False))
    stated = sum(good[name].stated for name in ZERO_WHEN_PERFECT)
    seen = sum(good[name].seen for name in ZERO_WHEN_PERFECT)
    assert stated >= 9 * UNITS and seen <= binom.ppf(1.0 - 1e-4, stated, 0.025)
    of_bad = [tally for name, tally in bad.items() if name not in STABILITIES]
    stated = sum(tally.stated for tally in of_bad)
    assert sum(tally.held for tally in of_bad) >= binom.ppf(1e-4, stated, 0.94)
    # Imperfect units do show: a scale factor's temperature coefficient in every one.
    assert bad["scale-factor temperature sensitivity"].seen == UNITS
