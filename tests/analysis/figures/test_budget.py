"""Budgets of the standard test against a simulated bench whose errors are known."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest

from bench.analysis.figures import Figure
from bench.analysis.figures._budget import ASSUMED, ASSUMED_ORIGIN, BenchErrors, with_budgets
from bench.analysis.figures._from_run import figures_of_record
from bench.record.events.run import Interval
from benchmarks.metrology import BENCH, GRADES, MISALIGNMENT, Faults, Unit, certificate, truth

FAULTS = Faults(sf_ppm=40.0, bias_dph=0.05, misalignment_deg=0.3, bias_dph_per_c=1e-3, sf_ppm_per_c=1.0)


class ToTheNorthEast(Unit):
    def azimuth_deg(self, interval: Interval) -> float:
        return 135.0 if interval.test == "resolution" else 45.0


def figures(unit: Unit, errors: BenchErrors) -> dict[str, Figure]:
    return {item.name: item for item in with_budgets(figures_of_record(unit)[0], unit, errors)}


@pytest.mark.parametrize(
    ("quantity", "error", "name"),
    [
        ("table_level_deg", 0.5, "bias"),
        ("azimuth_deg", 0.5, "bias"),
        ("latitude_deg", 0.5, "bias"),
        ("time_base_ppm", 200.0, "scale factor"),
        ("table_rate_ppm", -200.0, "scale factor"),
        ("fixture_deg", 0.1, MISALIGNMENT),
    ],
)
def test_an_error_on_the_certificate_is_taken_off(quantity: str, error: float, name: str) -> None:
    unit = ToTheNorthEast(GRADES[1], FAULTS, 4, {quantity: error})
    exact = [certificate(row.quantity, 1e-9, "normal") for row in BENCH if row.quantity != quantity]
    told = BenchErrors([*exact, certificate(quantity, 1e-9, "normal", error)])
    found, before = figures(unit, told)[name], figures(unit, BenchErrors(exact))[name]
    true = truth(unit, 1.0)[name]
    assert found.low is not None and found.high is not None and found.budget is not None
    off = abs(found.value - true)
    # sensitivities are those at the errors found: 0.5 deg of latitude or azimuth leaves half a percent of itself
    assert off < 2.5 * found.budget.combined + 0.005 * abs(found.value - before.value)
    assert abs(before.value - true) > 10.0 * off or abs(before.value - true) > 8.0 * found.budget.combined


def test_what_raises_the_input_axis_is_taken_off_the_bias() -> None:
    """0.3 deg lets in 15.04 sin(39.1 deg) sin(0.3 deg) = 0.0497 deg/h of the Earth's rate."""
    unit = Unit(GRADES[1], FAULTS, 4)
    (raw,) = (item for item in figures_of_record(unit)[0] if item.name == "bias")
    bias = figures(unit, BenchErrors(BENCH))["bias"]
    assert raw.value - bias.value == pytest.approx(0.0497, abs=2e-4)
    assert bias.budget is not None and bias.standard_error == pytest.approx(raw.standard_error, rel=1e-3)
    assert bias.low is not None and bias.low < FAULTS.bias_dph < (bias.high or 0.0)


def test_a_bench_without_certificates_is_assumed_and_says_so() -> None:
    unit = Unit(GRADES[1], replace(FAULTS, misalignment_deg=0.01), 5)
    found = figures(unit, BenchErrors())
    scale = found["scale factor"].budget
    assert scale is not None
    by_source = {item.source: item for item in scale.contributions}
    assert by_source["time_base_ppm"].origin == ASSUMED_ORIGIN
    assert by_source["time_base_ppm"].uncertainty == pytest.approx(1e-6 * 50.0 / math.sqrt(3.0), rel=1e-3)
    # a flat distribution alone: 95 % of its half width, not 1.96 standard uncertainties
    assert (
        scale.half_width == pytest.approx(0.95 * 50e-6, rel=0.1) and scale.expanded > 1.1 * scale.half_width
    )
    assert by_source["noise"].freedom == 45 - 2  # 45 dwells repeated once, less a line
    known = figures(unit, BenchErrors(BENCH))["scale factor"].budget
    assert known is not None and known.half_width < 0.02 * scale.half_width
    azimuth = {item.source: item for item in found["bias"].budget.contributions}["azimuth_deg"]  # type: ignore[union-attr]
    assert azimuth.standard == pytest.approx(ASSUMED["azimuth_deg"] / math.sqrt(3.0))
    by_earth = figures(unit, BenchErrors((), 0.02))["bias"].budget
    assert by_earth is not None
    (azimuth,) = (item for item in by_earth.contributions if item.source == "azimuth_deg")
    assert (azimuth.standard, azimuth.kind) == (0.02, "A")


def test_a_fixture_too_crude_for_a_misalignment_leaves_it_unseen() -> None:
    unit = Unit(GRADES[1], Faults(misalignment_deg=0.01), 6)
    name = MISALIGNMENT
    assert figures(unit, BenchErrors(BENCH))[name].seen
    assert not figures(unit, BenchErrors())[name].seen
