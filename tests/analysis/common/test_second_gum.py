"""Budgets against a second implementation of the GUM: `uncertainties`, which differentiates by itself."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st
from uncertainties import UFloat, ufloat, umath

from bench.analysis.common.bench_errors import BenchErrors
from bench.analysis.common.uncertainty import Budget, Contribution
from bench.analysis.figures import Figure
from bench.analysis.figures._budget import with_budgets
from bench.analysis.figures._from_run import figures_of_record
from benchmarks.metrology import (
    ACROSS,
    BENCH,
    ELEVATION,
    FULL_SCALE_DPS,
    GRADES,
    LATITUDE_DEG,
    MISALIGNMENT,
    Faults,
    Unit,
)  # fmt: skip
from drivers.base.constants import EARTH_RATE_DPH

SIZES = st.floats(1e-6, 1e6)


@given(st.lists(st.tuples(SIZES, st.floats(-1e3, 1e3), st.floats(-1e6, 1e6)), min_size=1, max_size=12))
def test_sums_are_those_of_a_second_library(rows: list[tuple[float, float, float]]) -> None:
    inputs = [Contribution(str(k), u, c, estimate=x) for k, (u, c, x) in enumerate(rows)]
    budget = Budget(3.0, tuple(inputs))
    second = 3.0 + sum(c * ufloat(x, u) for u, c, x in rows)
    assert budget.combined == pytest.approx(second.std_dev, rel=1e-9, abs=1e-150)
    assert budget.value == pytest.approx(second.nominal_value, rel=1e-9, abs=1e-6)


@pytest.fixture(scope="module")
def figures() -> dict[str, Figure]:
    faults = Faults(sf_ppm=40.0, bias_dph=0.05, misalignment_deg=0.3, across_deg=-0.1)
    unit = Unit(GRADES[1], faults, 4)
    return {item.name: item for item in with_budgets(figures_of_record(unit)[0], unit, BenchErrors(BENCH))}


def inputs_of(figure: Figure) -> dict[str, UFloat]:
    """Return the error of each input, about zero, by its name."""
    assert figure.budget is not None
    return {item.source: ufloat(0.0, item.standard) for item in figure.budget.contributions}


def combined(figure: Figure, *left_out: str) -> float:
    assert figure.budget is not None
    parts = [item.uncertainty for item in figure.budget.contributions if item.source not in left_out]
    return math.hypot(*parts)


def test_a_bias_is_as_uncertain_as_its_formula(figures: dict[str, Figure]) -> None:
    """B = output - W cos(lat) cos(az) cos(el) - W sin(lat) sin(el), the axis east and raised by 0.3 deg."""
    bias, raised_deg = figures["bias"], figures[ELEVATION].value
    by = inputs_of(bias)

    def rad(name: str, at_deg: float) -> UFloat:
        return (at_deg + by[name]) * math.pi / 180.0

    latitude, azimuth = rad("latitude_deg", LATITUDE_DEG), rad("azimuth_deg", 90.0)
    elevation = rad("input_axis_deg", raised_deg) + rad("table_level_deg", 0.0)
    level = umath.cos(latitude) * umath.cos(azimuth) * umath.cos(elevation)
    found = by["noise"] - EARTH_RATE_DPH * (level + umath.sin(latitude) * umath.sin(elevation))
    # terms of the elevation beside the first order: 1 - cos(0.3 deg)
    assert combined(bias, "unit_temp_c") == pytest.approx(found.std_dev, rel=1e-4)


def test_a_scale_factor_is_as_uncertain_as_its_formula(figures: dict[str, Figure]) -> None:
    """K = output over the angle turned, whose encoder and clock are off by ppm, over the cosine."""
    scale = figures["scale factor"]
    by = inputs_of(scale)
    assert scale.budget is not None
    angle, time_s = 1e6 * (1.0 - by["table_rate_ppm"] / 1e6), 1.0 - by["time_base_ppm"] / 1e6
    output = (scale.budget.stated + by["noise"]) * 1e6
    found = output / (angle / time_s) * (1.0 + by["axis_cosine_ppm"] / 1e6)
    assert combined(scale, "unit_temp_c") == pytest.approx(found.std_dev, rel=1e-4)


@pytest.mark.parametrize("name", [MISALIGNMENT, ACROSS])
def test_a_misalignment_is_as_uncertain_as_its_formula(name: str, figures: dict[str, Figure]) -> None:
    """Half the difference of two elevations, each arc sine of output over rate, each seat with its error."""
    figure = figures[name]
    by = inputs_of(figure)
    assert figure.budget is not None
    (seat,) = (item for item in figure.budget.contributions if item.source == "fixture_seat_deg")
    one_seat_deg = seat.standard / math.sqrt(2.0)
    angle_deg = figure.value

    def elevation(sense: float) -> UFloat:
        rate_dps = FULL_SCALE_DPS * (1.0 + by["table_rate_ppm"] / 1e6) / (1.0 + by["time_base_ppm"] / 1e6)
        output_dps = FULL_SCALE_DPS * math.sin(math.radians(sense * angle_deg))
        return umath.degrees(umath.asin(output_dps / rate_dps)) + ufloat(0.0, one_seat_deg)

    found = 0.5 * (elevation(1.0) - elevation(-1.0)) + by["noise"]
    assert combined(figure) == pytest.approx(found.std_dev, rel=1e-6)
