"""Budgets of the standard test against a simulated bench whose errors are known."""

from __future__ import annotations

import math
import re
from dataclasses import replace
from pathlib import Path

import pytest

from bench.analysis.common.bench_errors import ASSUMED, ASSUMED_ORIGIN, BenchErrors
from bench.analysis.figures import Figure
from bench.analysis.figures._budget import with_budgets
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
    unit = ToTheNorthEast(GRADES[1], FAULTS, 4, {quantity: error}, misalignment="as_mounted")
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
    assert bias.low is not None and bias.low < truth(unit, 1.0)["bias"] < (bias.high or 0.0)


def test_the_bias_is_corrected_by_the_axis_as_it_lay_not_by_what_is_the_units_own() -> None:
    """0.3 deg of the unit and 0.2 deg of its fixture let in 15.04 sin(39.1 deg) sin(0.5 deg) = 0.0828 deg/h."""
    unit = Unit(GRADES[1], FAULTS, 4, {"fixture_deg": 0.2})
    (raw,) = (item for item in figures_of_record(unit)[0] if item.name == "bias")
    found = figures(unit, BenchErrors(BENCH))
    assert raw.value - found["bias"].value == pytest.approx(0.0828, abs=3e-4)
    assert found[MISALIGNMENT].value == pytest.approx(0.3, abs=2e-3)


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
    unit = Unit(GRADES[1], Faults(misalignment_deg=0.015), 6, misalignment="as_mounted")
    name = MISALIGNMENT
    assert figures(unit, BenchErrors(BENCH))[name].seen
    assert not figures(unit, BenchErrors())[name].seen
    turned = Unit(GRADES[1], Faults(misalignment_deg=0.015), 6, {"fixture_deg": 0.3})
    found = figures(turned, BenchErrors())[name]  # turned over in it, the fixture counts no more
    assert found.seen and found.value == pytest.approx(0.015, abs=0.006)


def test_what_a_bench_without_certificates_is_taken_to_have() -> None:
    """The half widths that docs/uncertainty.md states, each as a standard uncertainty of a flat distribution."""
    page = Path(__file__).parents[3] / "docs" / "uncertainty.md"
    rows = re.findall(r"^\| `(\w+)` \| ([0-9.]+)[^|]*\|", page.read_text(encoding="utf-8"), re.MULTILINE)
    stated = {name: float(half) for name, half in rows}
    found = {name: BenchErrors().of(name, 1.0).standard for name in ASSUMED}
    assert found == pytest.approx({name: half / math.sqrt(3.0) for name, half in stated.items()})


def test_noise_counts_with_the_freedom_of_what_showed_it() -> None:
    """JCGM 100, G.3: a relative error of 10 % of a standard uncertainty is 50 degrees of freedom."""
    walk = Figure("angle random walk", 0.01, "deg/sqrt(h)", "", 0.01 - 1.96e-3, 0.01 + 1.96e-3)
    steady = Figure("scale factor", 1.0, "", "", 0.9, 1.1)
    repeated = Figure("scale factor", 1.0, "", "", 0.9, 1.1, freedom=9.0)
    unit = Unit(GRADES[1], FAULTS, 4)

    def freedom(*shown: Figure) -> float:
        budget = with_budgets(shown, unit, BenchErrors(BENCH))[-1].budget
        assert budget is not None
        return budget.contributions[0].freedom

    assert freedom(walk, steady) == pytest.approx(50.0, rel=1e-4)
    assert freedom(walk, repeated) == 9.0
    assert math.isinf(freedom(steady))
    exact = Figure("angle random walk", 0.01, "deg/sqrt(h)", "", 0.01, 0.01)
    assert math.isinf(freedom(exact, steady))


@pytest.mark.parametrize(
    ("name", "power"),
    [("angle random walk", 0.5), ("quantisation", 1.0), ("rate random walk", -0.5), ("rate ramp", -1.0)],
)
def test_a_clock_that_is_fast_scales_a_coefficient_by_its_power_of_time(name: str, power: float) -> None:
    """Of a clock 1,000 ppm fast; the Allan deviation is the same, the averaging time is not (IEEE Std 952)."""
    told = BenchErrors([certificate("time_base_ppm", 1e-9, "normal", 1000.0)])
    (found,) = with_budgets([Figure(name, 2.0, "", "", 1.99, 2.01)], Unit(GRADES[1], FAULTS, 4), told)
    assert found.value == pytest.approx(2.0 * 1.001**-power, rel=1e-5)


class Warm(Unit):
    def intervals(self, test: str) -> list[Interval]:
        return [Interval(test, 0.0, 1.0)] * 3 if test == "temperature" else super().intervals(test)

    def temp_c(self, interval: Interval) -> float:
        self.asked = getattr(self, "asked", -1) + 1
        return (20.0, 21.5, 60.0)[self.asked % 3]


def test_a_sensitivity_rests_on_the_nearest_temperature_that_counts() -> None:
    """Points at 21.5 and 60 degC about 20: the sensor's error counts over 1.5 K, of two readings; U has k = 2."""
    figure = Figure("bias temperature sensitivity", 0.3, "deg/h/degC", "", 0.29, 0.31)
    told = BenchErrors([certificate("unit_temp_c", 0.1, "normal")])
    (found,) = with_budgets([figure], Warm(GRADES[1], FAULTS, 4), told)
    assert found.budget is not None
    assert found.budget.contributions[1].uncertainty == pytest.approx(0.3 / 1.5 * 0.05 * math.sqrt(2.0))
