"""A few simulated standard tests: perfect units show nothing, the others' intervals hold."""

from __future__ import annotations

import pytest
from scipy.stats import binom

from benchmarks.metrology import ACROSS, GRADES, MISALIGNMENT, STABILITIES, ZERO_WHEN_PERFECT, Grade, tallies
from benchmarks.metrology_shares import shares

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


def test_an_input_scatters_a_figure_as_its_budget_says() -> None:
    """Chi-squared of the other units: fifteen are good to a factor of 1.6 (five sigma)."""
    inputs = {name: (name,) for name in ("time_base_ppm", "table_rate_ppm", "fixture_seat_deg")}
    found = {(each.figure, each.source): each for each in shares(GRADES[1], 15, inputs)}
    assert found.keys() == {
        ("scale factor", "time_base_ppm"), ("scale factor", "table_rate_ppm"),
        (MISALIGNMENT, "fixture_seat_deg"), (ACROSS, "fixture_seat_deg"),
    }  # fmt: skip
    for each in found.values():
        assert each.units == 15 and each.share > 0.01
        assert each.told / 1.6 < each.found < 1.6 * each.told, each
