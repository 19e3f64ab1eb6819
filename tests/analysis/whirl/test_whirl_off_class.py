"""Bearings that the fit was not made for: lines up to 20, play that is taken up over many degrees."""

from __future__ import annotations

import numpy as np
import pytest

from bench.analysis.whirl._direct import fit_direct, fit_travel
from bench.analysis.whirl._lines import choose_lines
from benchmarks.off_class._bearings import FAMILIES, played, record


def test_lines_up_to_twenty_are_chosen_by_the_data() -> None:
    run, _ = record(FAMILIES["races, lines to 20"], 3, stretches=2)
    assert {-17.0, -12.0, 9.0, 11.0, 16.0, 20.0} <= set(choose_lines([run]))


@pytest.mark.parametrize("travel_deg", [6.0, 12.0])
def test_the_travel_of_play_is_found_with_its_size(travel_deg: float) -> None:
    run, _ = record(played(travel_deg, 5.0 - 2.0j), 4, stretches=4, turns=2.0)
    lines = (-1.0, 1.0, 2.0, 3.0)
    fit = fit_travel([run], lines)
    assert fit.travel_deg == pytest.approx(travel_deg, rel=0.1)
    assert fit.play_arcsec is not None and fit.play_arcsec.value == pytest.approx(5.0 - 2.0j, abs=0.35)
    usual = fit_direct([run], lines)
    assert np.mean(np.abs(fit.residual_arcsec) ** 2) < np.mean(np.abs(usual.residual_arcsec) ** 2)


def test_without_play_the_travel_stays_as_it_was() -> None:
    run, _ = record(FAMILIES["usual lines (in class)"], 5, stretches=4, turns=2.0)
    assert fit_travel([run], (-1.0, 1.0, 2.0, 3.0)).travel_deg == 0.5
