"""Budgets of what procedures measure: which readings and samples count, and what has no budget, by hand."""

from __future__ import annotations

import math

import numpy as np
import pytest

from bench.analysis.figures import procedure_budgets
from bench.record.events.run import Basis, Measured
from bench.record.recording import Phase
from tests.analysis.figures.test_of_procedure import TIME_S, Recorded, calibration

STEP = 0.1 / math.sqrt(12.0)


AIR, AIR_RATE = Basis("air_temperature"), Basis("air_rate", since_s=100.0)
OUTPUT = Basis("gyro_output")


def measured(at_s, basis, value, name="mine"):
    return at_s, Measured.against(name, value, "", None, None, "fog", basis)


def budget(at_s, basis, value, **run):
    return procedure_budgets(Recorded([measured(at_s, basis, value)], **run)).get("mine")


def parts(found):
    return {item.source: item for item in found.contributions}


def coarse(**odd):
    """Air of 25 degC that goes up and down by 0.1, but for the seconds named: there by as much."""
    air = 25.0 + 0.1 * (np.arange(len(TIME_S)) % 2)
    for second, value in odd.items():
        air[int(second[1:])] = value
    return air


@pytest.mark.parametrize(("odd_s", "step_c"), [(500, 0.03), (501, 0.1), (99, 0.1), (100, 0.1), (460, 0.03)])
def test_readings_of_the_phase_up_to_the_measurement_tell_the_step(odd_s, step_c):
    """Measured at 500 s, in the soak that began at 460 s: a finer step shown before or after says nothing."""
    found = parts(budget(500.0, AIR, 25.0, air_c=coarse(**{f"s{odd_s}": 25.03})))["air_reading_step_c"]
    assert found.standard == pytest.approx(step_c / math.sqrt(12.0), rel=1e-6)
    assert (found.sensitivity, found.distribution, found.unit) == (1.0, "rectangular", "degC")
    assert found.origin == "telemetry"


def test_a_phase_that_begins_with_a_measurement_is_not_yet_its_own():
    """At 460 s, when the soak begins, the shock from 100 s on is what was measured."""
    assert (
        parts(budget(460.0, AIR, 25.0, air_c=coarse(s200=25.03)))["air_reading_step_c"].standard < 0.5 * STEP
    )
    late = budget(460.5, AIR, 25.0, air_c=coarse(s200=25.03))
    assert parts(late).keys() == {"air_temp_c"}, "one reading shows no step"
    # before any phase the record begins at zero
    run = Recorded([measured(3.5, AIR, 25.0)], air_c=coarse(s0=25.04))
    run.phases = lambda: (Phase("soak", 4.0, 10.0),)
    step = parts(procedure_budgets(run)["mine"])["air_reading_step_c"]
    assert step.standard == pytest.approx(0.04 / math.sqrt(12.0))


def test_a_shock_is_measured_from_its_own_beginning_whenever_it_is_written_down():
    """Two shocks: the second one's fall of 30 K is what its rate is of, not the first one's of 60."""
    air = np.full(len(TIME_S), 25.0)
    air[110:400], air[600:] = -35.0, -5.0
    second = Basis("air_rate", since_s=500.0, change_k=24.0)
    found = parts(budget(900.0, second, 6.0, air_c=air))
    assert found["air_temp_c"].sensitivity == pytest.approx(6.0 / 30.0)
    # two readings, off by a step of 30 K over sqrt(12) each; they are 24 K apart
    step = found["air_reading_step_c"]
    assert step.standard == pytest.approx(30.0 * math.sqrt(2.0 / 12.0))
    assert step.sensitivity == pytest.approx(6.0 / 24.0)


def test_what_did_not_fall_has_no_rate():
    rising = 25.0 + 0.01 * TIME_S
    assert budget(1000.0, AIR_RATE, 10.0, air_c=rising) is None
    falling = 25.0 - 0.01 * TIME_S
    assert budget(1000.0, AIR_RATE, -1.0, air_c=falling) is None
    assert budget(1000.0, AIR_RATE, 0.0, air_c=falling) is None
    found = parts(budget(1000.0, AIR_RATE, 0.5, air_c=falling))
    # from 100 s on, the shock: 9 K up to 1000 s
    assert found["air_temp_c"].sensitivity == pytest.approx(0.5 / 9.0)
    assert found["time_base_ppm"].sensitivity == pytest.approx(0.5e-6)


def test_an_output_is_judged_by_whole_blocks_of_valid_samples():
    """From 100 s to 137 s there are three blocks; the seven seconds behind them do not count."""
    rate_dps = np.zeros(len(TIME_S))
    rate_dps[100:110], rate_dps[110:120], rate_dps[120:130], rate_dps[130:] = 1e-3, 2e-3, 4e-3, 99.0
    found = budget(137.0, OUTPUT, 8.4, rate_dps=rate_dps)
    (noise,) = found.contributions
    assert noise.standard == pytest.approx(3.6 * np.std([1.0, 2.0, 4.0], ddof=1) / math.sqrt(3.0))
    assert (noise.freedom, noise.kind, noise.unit, noise.sensitivity) == (2, "A", "deg/h", 1.0)
    assert noise.origin == "10 s means" and found.value == 8.4
    assert budget(129.9, OUTPUT, 5.4, rate_dps=rate_dps) is None, "two blocks and almost a third"

    class Holes(Recorded):
        def gyro(self, name, columns, start_s, end_s):
            table = super().gyro(name, columns, start_s, end_s)
            at = TIME_S[(start_s <= TIME_S) & (end_s > TIME_S)]
            table["valid"] = ~(((at >= 110.0) & (at < 120.0)) | ((at >= 121.0) & (at < 130.0)))
            table["rate_dps"] = np.where(table["valid"], table["rate_dps"], 55.0)
            return table

    # of the second ten seconds nothing is valid, of the third one sample
    rate_dps[130:140] = 6e-3
    run = Holes([measured(140.0, OUTPUT, 13.2)], rate_dps=rate_dps)
    (noise,) = procedure_budgets(run)["mine"].contributions
    assert noise.standard == pytest.approx(3.6 * np.std([1.0, 4.0, 6.0], ddof=1) / math.sqrt(3.0))


def test_of_several_gyros_the_one_whose_mean_was_measured_tells_the_scatter():
    class Three(Recorded):
        def __init__(self, items):
            super().__init__(items, rate_dps=np.zeros(len(TIME_S)))
            self.gyros = ("one", "two", "none")

        def gyro(self, name, columns, start_s, end_s):
            table = super().gyro(name, columns, start_s, end_s)
            wave = np.where(np.arange(len(table["rate_dps"])) // 10 % 2 == 0, 1.0, -1.0)
            level, size = {"one": (5.0, 0.3), "two": (-5.0, 0.7), "none": (0.0, 0.0)}[name]
            table["rate_dps"] = (level + size * wave) / 3600.0
            if name == "none":
                table = {key: column[:0] for key, column in table.items()}
            return table

    for name, size in (("one", 0.3), ("two", 0.7)):
        run = Three([(100.0, Measured.against("mine", 4.0, "deg/h", None, None, name, OUTPUT))])
        (noise,) = procedure_budgets(run)["mine"].contributions
        assert noise.standard == pytest.approx(size * math.sqrt(10.0 / 9.0) / math.sqrt(10.0)), name
    empty = Three([(100.0, Measured.against("mine", 4.0, "deg/h", None, None, "none", OUTPUT))])
    assert procedure_budgets(empty) == {}


def test_an_azimuth_error_has_a_budget_where_its_doubt_was_measured():
    items = [
        measured(50.0, Basis("axis_azimuth"), 0.5, "azimuth_error"),
        measured(60.0, Basis("east_angle"), 89.5, "east_table_angle"),
    ]
    assert procedure_budgets(Recorded(items)).keys() == {"east_table_angle"}, "taken as set by hand"
    told = procedure_budgets(Recorded(items, doubt_deg=0.8))
    found = parts(told["azimuth_error"])
    assert found.keys() == {"noise", "latitude_deg", "table_angle_deg"}
    assert (found["noise"].standard, found["noise"].kind, found["noise"].origin) == (0.4, "A", "Earth rate")
    assert (found["noise"].sensitivity, found["table_angle_deg"].sensitivity) == (1.0, -1.0)
    by_hand = parts(told["east_table_angle"])
    assert by_hand.keys() == {"azimuth_deg", "table_angle_deg"}
    assert by_hand["azimuth_deg"].sensitivity == by_hand["table_angle_deg"].sensitivity == -1.0
    assert by_hand["azimuth_deg"].origin == "assumed"
    # without an error measured before it, the angle is as sure as the doubt
    alone = procedure_budgets(Recorded(items[1:], doubt_deg=0.8))
    assert parts(alone["east_table_angle"])["noise"].standard == 0.4


@pytest.mark.parametrize(
    ("of", "sensitivities"),
    [
        ("air_temperature", {"air_temp_c": -1.0}),
        ("unit_temperature", {"unit_temp_c": -1.0}),
        ("table_angle", {"table_angle_deg": -1.0}),
        ("heading", {"table_angle_deg": -1.0, "azimuth_deg": -1.0}),
        ("table_rate", {"table_rate_ppm": -3e-6}),
        (None, {}),
    ],
)
def test_a_reading_is_what_is_shown_less_the_instruments_error(of, sensitivities):
    run = {"air_c": np.full(len(TIME_S), 3.0)}
    told = budget(50.0, Basis(of), 3.0, **run)
    found = {item.source: item.sensitivity for item in told.contributions} if told else {}
    assert found == pytest.approx(sensitivities)
    if told:
        quantity = next(iter(sensitivities))
        told = budget(50.0, Basis(of), 3.0, calibrations=[calibration(quantity, 0.2, error=0.5)], **run)
        assert told.value == pytest.approx(3.0 + sensitivities[quantity] * 0.5)
