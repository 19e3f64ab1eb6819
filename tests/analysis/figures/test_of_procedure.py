"""Budgets of what procedures measure: against sensors, clocks and units whose errors are drawn, and by hand."""

from __future__ import annotations

import datetime
import math
from collections.abc import Sequence
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from bench.analysis.figures import procedure_budgets
from bench.record.events.run import Basis, Measured
from bench.record.recording import Phase, Run
from drivers.base.errors import RecordError
from procedures._cold_shock import shock_rate_k_per_min

TIME_S = np.arange(0.0, 1800.0)
AIR_C = 25.0 - 70.0 * np.clip((TIME_S - 100.0) / 360.0, 0.0, 1.0)
"""11.67 K/min from 25 to -45 degC, then a soak."""


def calibration(quantity: str, uncertainty: float, error: float = 0.0) -> dict[str, Any]:
    return {
        "quantity": quantity, "instrument": "Pt100 4711", "certificate": "C-1",
        "date": datetime.date(2026, 5, 4), "due": datetime.date(2027, 5, 4),
        "error": error, "uncertainty": uncertainty,
    }  # fmt: skip


class Recorded:
    """A run as far as budgets read it: `measured` are (time, name, value, unit[, limits])."""

    def __init__(
        self,
        measured: Sequence[tuple[float, Measured]],
        *,
        air_c: Any = AIR_C,
        rate_dps: Any = None,
        calibrations: Sequence[dict[str, Any]] = (),
        doubt_deg: float | None = None,
        latitude_deg: float = 45.0,
    ) -> None:
        values = {item.name: item.value for _, item in measured}
        if doubt_deg is not None:
            values["azimuth_error_2_sigma"] = doubt_deg
        self.manifest = SimpleNamespace(
            measured=values.get, bench={"calibration": list(calibrations)}, latitude_deg=latitude_deg
        )
        self._measured, self._air_c, self._rate_dps = measured, air_c, rate_dps
        self.gyros = () if rate_dps is None else ("fog",)

    def of(self, kind: type) -> list[tuple[float, Measured]]:
        return list(self._measured)

    def phases(self) -> tuple[Phase, ...]:
        return (Phase("reference", 0.0, 100.0), Phase("shock", 100.0, 460.0), Phase("soak", 460.0, 1800.0))

    def chamber(self, columns: Sequence[str], start_s: float, end_s: float) -> dict[str, Any]:
        if self._air_c is None:
            raise RecordError("no table of the chamber")
        return {"air_temp_c": self._air_c[(start_s <= TIME_S) & (end_s > TIME_S)]}

    def gyro(self, name: str, columns: Sequence[str], start_s: float, end_s: float) -> dict[str, Any]:
        keep = (start_s <= TIME_S) & (end_s > TIME_S)
        return {
            "time_ns": np.rint(TIME_S[keep] * 1e9).astype(np.int64),
            "rate_dps": self._rate_dps[keep],
            "valid": np.ones(int(keep.sum()), np.bool_),
        }


FALL = Basis("air_rate", since_s=100.0, change_k=0.8 * 70.0)
MINUTE = Basis("air_rate", since_s=100.0, change_k=70.0 / 6.0)
AIR = Basis("air_temperature", since_s=100.0)
OUTPUT = Basis("gyro_output", since_s=0.0)


def budget(
    at_s: float, basis: Basis | None, value: float, unit: str, gyro: str | None = None, **run: Any
) -> Any:
    item = Measured.against("mine", value, unit, None, None, gyro, basis)
    return procedure_budgets(cast(Run, Recorded([(at_s, item)], **run))).get("mine")


@pytest.mark.parametrize("steepest", [False, True])
def test_shock_rates_scatter_as_their_budgets_say(steepest: bool) -> None:
    """A sensor whose errors at both ends of the fall are drawn, linear between, rounded to 0.1 K; a clock off."""
    rng, rates = np.random.default_rng(3), []
    certificates = [calibration("air_temp_c", 0.6), calibration("time_base_ppm", 400.0)]
    for _ in range(4000):
        warm, cold = rng.normal(0.0, 0.3, 2)
        shown = AIR_C + np.interp(AIR_C, (-45.0, 25.0), (cold, warm))
        clock = 1.0 + rng.normal(0.0, 200e-6)
        found = shock_rate_k_per_min(TIME_S[100:] * clock, np.round(shown[100:], 1))
        rates.append(found[steepest])
    basis = MINUTE if steepest else FALL
    told = budget(1000.0, basis, 70.0 / 6.0, "K/min", air_c=np.round(AIR_C, 1), calibrations=certificates)
    share = {item.source: told.share(item) for item in told.contributions}
    assert set(share) == {"air_temp_c", "air_reading_step_c", "time_base_ppm"}
    # rounding: the crossings are readings themselves, so a tenth of a kelvin is a good part of it
    assert np.std(rates) == pytest.approx(told.combined, rel=0.25 if steepest else 0.15)


@pytest.mark.parametrize(
    ("basis", "over_c"),
    [(FALL, 0.8 * 70.0), (MINUTE, 70.0 / 6.0), (Basis("air_rate", since_s=100.0), 70.0)],
)
def test_a_shock_rates_inputs_by_hand(basis: Basis, over_c: float) -> None:
    """70 K at 11.67 K/min read in steps of 0.1 K; each of two readings is off by 0.1 K / sqrt(12)."""
    rate = 70.0 / 6.0
    told = budget(
        1000.0, basis, rate, "K/min", air_c=np.round(AIR_C, 1), calibrations=[calibration("air_temp_c", 0.6)]
    )
    parts = {item.source: item.uncertainty for item in told.contributions}
    # the difference of two readings over the time between them, which is over_c / rate
    assert parts["air_reading_step_c"] == pytest.approx(math.sqrt(2.0 / 12.0) * 0.1 * rate / over_c, rel=1e-3)
    assert parts["air_temp_c"] == pytest.approx(math.sqrt(2.0) * 0.3 * rate / 70.0, rel=1e-3)
    assert parts["time_base_ppm"] == pytest.approx(rate * 50e-6 / math.sqrt(3.0))


def test_the_lowest_air_is_the_reading_less_its_sensors_error() -> None:
    certificates = [calibration("air_temp_c", 0.5, error=0.3)]
    told = budget(1000.0, AIR, -45.0, "degC", calibrations=certificates, air_c=np.round(AIR_C, 1))
    assert told.value == pytest.approx(-45.3)
    assert told.combined == pytest.approx(math.hypot(0.25, 0.1 / math.sqrt(12.0)), rel=1e-6)


def test_a_bench_without_a_certificate_has_a_resistor_of_class_b() -> None:
    """IEC 60751: 0.3 degC + 0.005 |t|, 0.5 degC at -40 degC, taken as the half width of a flat distribution."""
    told = budget(1000.0, AIR, -45.0, "degC")
    assert told.contributions[0].standard == pytest.approx((0.3 + 0.005 * 40.0) / math.sqrt(3.0))
    assert told.contributions[0].origin == "assumed" and told.contributions[0].unit == "degC"


def test_a_number_is_of_its_stretch_or_else_of_the_phase_it_is_written_down_in() -> None:
    """The soak alone falls by nothing; with the shock it is 70 K."""
    told = budget(1000.0, FALL, 11.667, "K/min", calibrations=[calibration("air_temp_c", 0.6)])
    assert told.contributions[0].sensitivity == pytest.approx(11.667 / 70.0, rel=1e-3)
    assert budget(1000.0, Basis("air_rate"), 11.667, "K/min") is None
    half = budget(280.0, Basis("air_rate"), 11.667, "K/min")  # in the middle of the fall
    assert half.contributions[0].sensitivity == pytest.approx(11.667 / 35.0, rel=0.01)


def test_a_procedure_of_ones_own_says_its_inputs() -> None:
    """A scale factor by the clock and the table, 3 ppm of scatter: 50 and 10 ppm are half widths."""
    own = Basis(standard_error=3.0, inputs={"time_base_ppm": -1.0, "table_rate_ppm": 1.0})
    told = budget(50.0, own, 120.0, "ppm")
    parts = {item.source: item for item in told.contributions}
    assert told.combined == pytest.approx(math.hypot(3.0, 50.0 / math.sqrt(3.0), 10.0 / math.sqrt(3.0)))
    assert (parts["noise"].kind, parts["noise"].unit) == ("A", "ppm")
    known = budget(50.0, own, 120.0, "ppm", calibrations=[calibration("time_base_ppm", 2.0, error=20.0)])
    assert known.value == pytest.approx(100.0)  # a clock that is fast: more output a second than there is
    both = budget(50.0, Basis("unit_temperature", inputs={"air_temp_c": 0.5}), 25.0, "degC")
    assert {item.source for item in both.contributions} == {"unit_temp_c", "air_temp_c"}


def test_a_mean_output_has_the_standard_error_of_its_ten_second_means() -> None:
    """White noise of s per sample: s / sqrt(n) of the mean of n, with nine degrees of freedom of ten blocks."""
    rng, off, told = np.random.default_rng(5), [], None
    for _ in range(300):
        rate_dps = rng.normal(0.01, 1e-3, len(TIME_S))
        mean = 3600.0 * float(rate_dps[:100].mean())
        told = budget(100.0, OUTPUT, mean, "deg/h", "fog", rate_dps=rate_dps)
        off.append((mean - 36.0) / told.combined)
    assert told is not None and told.contributions[0].freedom == 9
    # Student's t of nine degrees of freedom has the standard deviation sqrt(9 / 7)
    assert np.std(off) == pytest.approx(math.sqrt(9.0 / 7.0), rel=0.12)


def test_a_mean_output_of_two_blocks_has_no_budget() -> None:
    rate_dps = np.full(len(TIME_S), 0.01)
    assert budget(25.0, OUTPUT, 36.0, "deg/h", "fog", rate_dps=rate_dps) is None
    assert budget(35.0, OUTPUT, 36.0, "deg/h", "fog", rate_dps=rate_dps) is not None
    # nor has one of a gyro that nobody named, or that has no table
    assert budget(35.0, OUTPUT, 36.0, "deg/h", rate_dps=rate_dps) is None
    assert budget(35.0, OUTPUT, 36.0, "deg/h", "other", rate_dps=rate_dps) is None


@pytest.mark.parametrize(("limit", "sigma_deg"), [(2.0, 0.4), (None, 2.0 / math.sqrt(3.0))])
def test_east_is_as_sure_as_what_it_rests_on(limit: float | None, sigma_deg: float) -> None:
    """An azimuth error that was judged was taken off; with one too doubtful the axis is where hands set it."""
    error = Measured.against(
        "azimuth_error", 0.5, "deg", limit and -limit, limit, None, Basis("axis_azimuth")
    )
    east = Measured.against("east_table_angle", 89.5, "deg", None, None, None, Basis("east_angle"))
    run = Recorded([(50.0, error), (60.0, east)], doubt_deg=0.8, latitude_deg=60.0)
    told = procedure_budgets(cast(Run, run))
    assert told["east_table_angle"].combined == pytest.approx(sigma_deg, rel=0.01)
    of_latitude = {item.source: item for item in told["azimuth_error"].contributions}["latitude_deg"]
    # sin(error) = difference / (2 W cos(latitude)): d error / d latitude = tan(error) tan(latitude)
    step, sine = 1e-4, math.sin(math.radians(0.5)) * math.cos(math.radians(60.0))
    moved = math.degrees(math.asin(sine / math.cos(math.radians(60.0 + step))))
    assert of_latitude.sensitivity == pytest.approx((moved - 0.5) / step, rel=1e-3)


def test_angles_rates_and_temperatures_have_their_instruments() -> None:
    items = [
        ("heading_1", 90.0, "deg", Basis("heading")), ("found_angle", 3.0, "deg", Basis("table_angle")),
        ("found_rate", 2.0, "deg/s", Basis("table_rate")),
        ("fog_temperature", 25.0, "degC", Basis("unit_temperature")),
        ("air", 25.0, "degC", Basis("air_temperature")), ("azimuth_error_2_sigma", 0.1, "deg", None),
    ]  # fmt: skip
    run = Recorded([(50.0, Measured.against(*item, None, None, None, basis)) for *item, basis in items])
    told = procedure_budgets(cast(Run, run))
    assert {name: {part.source for part in found.contributions} for name, found in told.items()} == {
        "heading_1": {"table_angle_deg", "azimuth_deg"},
        "found_angle": {"table_angle_deg"},
        "found_rate": {"table_rate_ppm"},
        "fog_temperature": {"unit_temp_c"},
        "air": {"air_temp_c"},
    }
    assert told["found_rate"].combined == pytest.approx(2.0 * 10e-6 / math.sqrt(3.0))


def test_what_is_not_known_has_no_budget() -> None:
    assert budget(50.0, AIR, math.nan, "degC") is None
    assert budget(1000.0, AIR, -45.0, "degC", air_c=None) is None
    assert budget(1000.0, FALL, 0.0, "K/min") is None
    assert budget(50.0, None, 25.0, "degC") is None and budget(50.0, Basis(), 25.0, "degC") is None
