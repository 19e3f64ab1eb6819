"""One diagnosis of all signals: the closed model has every signal's terms, JSON has no NaN."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from bench.analysis.gap import (
    LogGap,
    LogGaps,
    closed_model,
    diagnose,
    diagnosis_facts,
    log_gap_facts,
    model_text,
    parse_model,
    read_model,
    suggest,
)
from bench.analysis.gap._channel_data import ChannelSeries
from simulators.plant.fog_parameters import FogThermal
from tests.analysis.gap.channel_lab import recorded
from tests.analysis.gap.conftest import made_run, stimulus

NOMINAL = Path(__file__).parents[3] / "examples" / "nominal" / "fog_cold_shock.toml"


def _sensor(seed: int) -> list[ChannelSeries]:
    lagged = recorded(seed, thermal=FogThermal(spool_sensor_lag_s=90.0))
    return [each for each in lagged if each.channel == "gyro_temperature"]


def test_the_closed_model_has_the_causes_of_rate_and_channels_and_keeps_accuracies() -> None:
    fitted = closed_model(diagnose(recorded(1), replace(read_model(NOMINAL), terms=())))
    terms = [
        replace(term, sigmas=tuple(max(0.05 * abs(value), 1e-3) for value in term.values))
        for term in fitted.channel_terms
    ]
    nominal = replace(fitted, channel_terms=tuple(terms))
    rng, s = np.random.default_rng(21), stimulus(4000)
    runs = [made_run(name, s, rng, 0.5 * (s.warm_k / 50.0) ** 3) for name in "ab"]
    found = diagnose([*runs, *_sensor(11)], nominal, _sensor(12))
    assert "temperature_sensor_lag" in {cause.name for each in found.channels for cause in each.causes}
    assert [cause.name for cause in found.rate.causes] == ["bias_cubic"]
    closed = parse_model(model_text(closed_model(found)), "closed")
    assert [term.name for term in closed.terms] == ["bias_cubic"]
    before, after = ({term.name: term for term in model.channel_terms} for model in (nominal, closed))
    assert set(after) == {*before, "temperature_sensor_lag"}
    assert after["temperature_sensor_lag"].values[0] == pytest.approx(90.0, rel=0.2)
    # heat into the gyro was fitted again, heat into the case was in no run
    assert after["gyro_core_heat"].values != before["gyro_core_heat"].values
    assert after["fixture_heat"].values == before["fixture_heat"].values
    assert closed.accuracy == nominal.accuracy
    assert set(closed.fitted_on) == {"a", "b", "run 1"}, "of the model that was closed, too"
    facts = json.loads(json.dumps(diagnosis_facts(found, suggest(found)), allow_nan=False))
    by_channel = {each["channel"]: each for each in facts["channels"]}
    assert by_channel["gyro_temperature"]["held_out"]["share"] > 0.9
    assert by_channel["chamber_air"]["reason"] == "not in these runs"


def test_a_share_that_does_not_exist_is_null() -> None:
    gaps = LogGaps(rate=(LogGap("all", "deg/h", 0.1, 0.1, 0.2, math.nan),))
    facts = json.loads(json.dumps(log_gap_facts(gaps), allow_nan=False))
    assert facts["gaps"] == [
        {
            "part": "all",
            "unit": "deg/h",
            "rms_nominal": 0.1,
            "rms_closed": 0.1,
            "rms_floor": 0.2,
            "share": None,
        }
    ]
