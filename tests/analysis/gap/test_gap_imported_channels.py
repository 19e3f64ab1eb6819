"""Channels of logs of other benches: what set points, demands, heaters and doors act on, by a mapping file."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from typer.testing import CliRunner

from bench.analysis.gap import diagnose, read_model, read_recordings
from bench.analysis.gap._channel_data import ChannelSeries, channels_of, step_of
from bench.analysis.gap._channel_log import LogSource, demands_of
from bench.analysis.gap._channel_source import Trace
from bench.analysis.gap._mapped import mapped_logs
from bench.present.cli._app import app
from bench.record.exchange import import_log
from drivers.base.errors import ConfigurationError

HEAD = 'format = 1\nunit_id = "u"\nlatitude_deg = 48\n[columns]\ntime = { name = "t", unit = "s" }\n'
COLUMNS = {
    "rate": 'output = { name = "rate", unit = "deg/s" }\n',
    "set": 'set_point = { name = "set", unit = "degC" }\n',
    "air": 'air = { name = "air", unit = "degC" }\n',
    "case": 't_out = { name = "case", unit = "degC" }\n',
    "inside": 't_in = { name = "inside", unit = "degC" }\n',
    "angle": 'angle = { name = "angle", unit = "deg" }\n',
    "spin": 'table_rate = { name = "spin", unit = "deg/s" }\n',
    "told_angle": 'angle_demand = { name = "told_angle", unit = "deg" }\n',
    "told_rate": 'rate_demand = { name = "told_rate", unit = "deg/s" }\n',
    "heat": 'heater = { name = "heat", unit = "0.04 W" }\n',
    "lid": 'door = { name = "lid", unit = "%" }\n',
}


def mapped(folder: Path, tables: dict[str, dict[str, Any]], more: str = "") -> Path:
    """Write logs, a CSV file each, and the mapping of their columns."""
    for name, columns in tables.items():
        pd.DataFrame(columns).to_csv(folder / f"{name}.csv", index=False)
    runs = "".join(f'[[run]]\nfile = "{name}.csv"\n{more}' for name in tables)
    known = next(iter(tables.values()))
    file = folder / "map.toml"
    file.write_text(HEAD + "".join(text for name, text in COLUMNS.items() if name in known) + runs)
    return file


def read(file: Path) -> tuple[dict[str, ChannelSeries], dict[str, str]]:
    """Return the channels of the first log of a mapping file, and the reasons for those that are missing."""
    found, missing = channels_of(LogSource(next(iter(mapped_logs(file)))))
    return {series.channel: series for series in found}, missing


def everything(row_s: float) -> dict[str, Any]:
    """Four hours: air to -20 degC at 1 K/min, a table that is held at 90 deg, then turned at 12.06 deg/s."""
    t = np.arange(0.0, 4 * 3600.0, row_s)
    ramp = 25.0 - np.clip((t - 3600.0) / 60.0, 0.0, 45.0)
    spins = t >= 7200.0
    return {
        "t": t + 500.0,
        "set": ramp,
        "air": ramp + 0.5,
        "case": ramp + 1.0,
        "inside": ramp + 2.0,
        "told_angle": np.full(len(t), 90.0),
        "told_rate": np.where(spins, 12.0, 0.0),
        "spin": np.where(spins, 12.06, 0.0),
        "angle": np.where(spins, 90.001 + 12.06 * (t - 7200.0), 90.001) % 360.0,
        "rate": np.where(spins, 12.06, 0.0) + 1e-4 * np.sin(np.arange(len(t))),
    }


@pytest.mark.parametrize("row_s", [0.5, 1.0, 10.0, 60.0])
def test_every_channel_of_a_log_is_read_at_its_own_rows(tmp_path: Path, row_s: float) -> None:
    found, missing = read(mapped(tmp_path, {"log": everything(row_s)}))
    assert set(missing) == {"time_stamps"} and "arrival times" in missing["time_stamps"]
    air = found["chamber_air"]
    assert air.inputs.period_s == max(10.0, row_s) and air.run_id == "log" and air.unit_id == "u"
    assert [(each.time_s, each.target) for each in air.inputs.demands[1:]] == [(3600.0, -20.0)]
    assert air.inputs.demands[1].ramp_per_s == pytest.approx(1.0 / 60.0, rel=1e-3)
    # a mean over rows is that of the ramp at their mean time, to half a row of a second or less
    middle = air.inputs.time_s
    ramp = 25.5 - np.clip((middle - 3600.0) / 60.0, 0.0, 45.0)
    inside = (np.abs(middle - 3600.0) > 2 * row_s + 20.0) & (np.abs(middle - 6300.0) > 2 * row_s + 20.0)
    assert np.abs(air.values - ramp)[inside & ~np.isnan(air.values)].max() < 0.6 / 60.0
    for name, above in (("case_temperature", 0.5), ("gyro_temperature", 1.0)):
        series = found[name]
        assert series.values - series.inputs.drive == pytest.approx(np.full(len(series.values), above))
    assert found["table_angle"].values == pytest.approx(
        np.full(len(found["table_angle"].values), 3.6), abs=0.1
    )
    spun = found["table_rate"]
    assert set(spun.inputs.drive.tolist()) == {12.0} and spun.values == pytest.approx(
        np.full(len(spun.values), 12.06), abs=1e-6
    )
    assert spun.inputs.time_s[0] >= 7200.0


def test_steps_follow_the_rows_and_how_short_a_recording_is() -> None:
    assert step_of(np.arange(0.0, 7200.0)) == 10.0
    assert step_of(np.arange(0.0, 7200.0, 2.5)) == 10.0
    assert step_of(np.arange(0.0, 7200.0, 3.0)) == 9.0
    assert step_of(np.arange(0.0, 7200.0, 60.0)) == 60.0
    assert step_of(np.arange(0.0, 601.0)) == 3.0
    assert step_of(np.arange(0.0, 600.1, 0.1)) == pytest.approx(3.0)


def test_a_set_points_course_is_steps_and_ramps() -> None:
    """Held, up by 10 K at once, held, down at 0.5 K/min in steps of 0.1 K, held."""
    t = np.arange(0.0, 6000.0, 4.0)
    course = np.where(t < 1000.0, 20.0, 30.0) - np.round(np.clip((t - 2000.0) / 120.0, 0.0, 10.0), 1)
    first, step, ramp = demands_of(Trace(t, course))
    assert (first.target, first.ramp_per_s, step.time_s, step.target) == (20.0, math.inf, 1000.0, 30.0)
    assert step.ramp_per_s == math.inf and ramp.target == pytest.approx(20.0)
    assert ramp.ramp_per_s == pytest.approx(0.5 / 60.0, rel=0.02) and ramp.time_s == pytest.approx(
        2000.0, abs=20.0
    )
    (held,) = demands_of(Trace(t, np.full(len(t), 7.0)))
    assert held.target == 7.0


def test_what_a_log_lacks_is_said_channel_by_channel(tmp_path: Path) -> None:
    table = everything(10.0)
    bare = {name: table[name] for name in ("t", "rate", "air", "spin")}
    found, missing = read(mapped(tmp_path, {"log": bare}))
    assert not found
    assert missing == {
        "chamber_air": "no column set_point that the air could follow",
        "case_temperature": "no column t_out",
        "gyro_temperature": "nothing that the gyro's temperature could follow: no column t_out",
        "table_angle": "no angle was demanded of the table and held for half a minute",
        "table_rate": "no rate was demanded of the table and held for half a minute",
        "time_stamps": "a log of another bench has no arrival times of bytes",
    }


def test_one_temperature_stands_for_the_cases_and_the_mapping_may_say_the_air(tmp_path: Path) -> None:
    t = np.arange(0.0, 3000.0)
    log = {"t": t, "inside": 20.0 + 0.001 * t, "heat": np.where(t < 1000.0, 0.0, 50.0), "lid": 25.0 + 0 * t}
    found, missing = read(mapped(tmp_path, {"log": log}))
    assert not found and "air_temp_c" in missing["case_temperature"]
    found, missing = read(mapped(tmp_path, {"log": log}, "air_temp_c = 21.5\n"))
    series = found["case_temperature"]
    assert set(series.inputs.drive.tolist()) == {21.5} and "one temperature" in missing["gyro_temperature"]
    middle = series.inputs.time_s
    assert series.inputs.heat_w == pytest.approx(np.where(middle < 1000.0, 0.0, 2.0))
    assert series.inputs.door == pytest.approx(np.full(len(middle), 0.25))
    # half an hour after the heater was switched on; nobody knows what was before the log
    assert series.quiet.tolist() == (middle > 2800.0).tolist()


def heated(
    t: np.ndarray, heat_w: np.ndarray, lid: np.ndarray, *, warm_j: float, opening: float, seed: int
) -> np.ndarray:
    """A body of 300 J/K, 0.6 W/K to air at 21 degC, heated through a mass at 2 W/K; Euler, 20 steps a row."""
    body = warm = 21.0
    result = np.empty(len(t))
    step_s = float(t[1] - t[0]) / 20.0
    for k in range(len(t)):
        result[k] = body
        for _ in range(20):
            if warm_j:
                over = 2.0 * (warm - body)
                warm += step_s / warm_j * (heat_w[k] - over)
            else:
                over = heat_w[k]
            body += step_s / 300.0 * (over + (0.6 + opening * lid[k]) * (21.0 - body))
    return np.round(result + np.random.default_rng(seed).normal(0.0, 0.03, len(t)), 2)


MODEL = """format = 1
[noise]
arw_deg_per_sqrt_h = 0.01
[[effect]]
name = "air_to_case_conductance"
parameters = { conductance_w_per_k = 0.6 }
sigma = { conductance_w_per_k = 0.03 }
[[effect]]
name = "case_heat_capacity"
parameters = { case_j_per_k = 300.0 }
sigma = { case_j_per_k = 15.0 }
[[effect]]
name = "fixture_heat"
parameters = { fixture_j_per_k = 1.0, fixture_w_per_k = 0.001 }
sigma = { fixture_j_per_k = 0.01, fixture_w_per_k = 0.0001 }
"""


def plant(folder: Path, days: int = 2, **changes: float) -> Path:
    """Write days of a heated body whose heater is switched and whose lid is opened, without a gyro."""
    given = {"warm_j": 0.0, "opening": 0.0} | changes
    tables = {}
    for day in range(days):
        rng = np.random.default_rng(7 + day)
        t = np.arange(0.0, 5400.0, 3.0)
        heat = 450.0 * (rng.random(len(t) // 100)[:, None] < 0.5) * np.ones(100)
        lid = 100.0 * ((t > 2000.0 + 300 * day) & (t < 2300.0 + 300 * day))
        heat = heat.ravel()[: len(t)]
        case = heated(t, 0.04 * heat, 0.01 * lid, seed=day, **given)
        tables[f"day{day}"] = {"t": t, "case": case, "heat": heat, "lid": lid, "air": np.full(len(t), 21.0)}
    (folder / "nominal.toml").write_text(MODEL)
    return mapped(folder, tables)


CASES = [
    ({"warm_j": 250.0}, "heater_heat_capacity", {"heater_j_per_k": 250.0, "heater_w_per_k": 2.0}),
    ({"opening": 6.0}, "opening_conductance", {"opening_w_per_k": 6.0}),
]


@pytest.mark.parametrize(("changes", "name", "values"), CASES, ids=[case[1] for case in CASES])
def test_a_plant_without_a_gyro_is_diagnosed_and_closed_through_the_command_line(
    tmp_path: Path, changes: dict[str, float], name: str, values: dict[str, float]
) -> None:
    file, nominal = plant(tmp_path, **changes), tmp_path / "nominal.toml"
    page = tmp_path / "gap.html"
    given = [str(file), "--model", str(nominal)]
    said = CliRunner().invoke(
        app, ["gap", "diagnose", *given, "--held-out", "day1", "--json", "--report", str(page)]
    )
    assert said.exit_code == 0, said.output
    facts = json.loads(said.output)
    assert facts["unit"] == "u" and list(facts["runs"]) == ["day0"] and facts["verdict"] == "explained"
    (case,) = [each for each in facts["channels"] if each["channel"] == "case_temperature"]
    (cause,) = case["causes"]
    assert cause["name"] == name and cause["parameters"] == pytest.approx(values, rel=0.1)
    assert case["held_out"]["share"] > 0.95
    assert {each["channel"]: each.get("reason", "") for each in facts["channels"]}["gyro_temperature"]
    assert name.replace("_", " ") in page.read_text().lower()
    told = CliRunner().invoke(app, ["gap", "diagnose", *given, "--held-out", "day1"])
    assert told.exit_code == 0 and name in told.output and "not seen" in told.output
    closed = tmp_path / "closed.toml"
    said = CliRunner().invoke(app, ["gap", "close", *given, "--out", str(closed)])
    assert said.exit_code == 0, said.output
    again = CliRunner().invoke(app, ["gap", "diagnose", str(file), "--model", str(closed), "--json"])
    assert json.loads(again.output)["verdict"] in ("no gap", "within the model's accuracy")
    (term,) = [term for term in read_model(closed).channel_terms if term.name == name]
    assert dict(zip(values, term.values, strict=True)) == pytest.approx(values, rel=0.1)


def test_an_imported_run_and_its_mapping_file_say_the_same(tmp_path: Path) -> None:
    file = plant(tmp_path, 1, opening=6.0)
    folder = import_log(tmp_path / "day0.csv", file, tmp_path / "runs")
    model = read_model(tmp_path / "nominal.toml")
    found = []
    for path in (file, folder):
        given = read_recordings([path])
        assert given.unit_id == "u" and not given.shown
        found.append(diagnose(given.runs, model, missing=given.missing))
    one, other = found
    assert [cause.name for cause in one.causes] == ["opening_conductance"]
    assert one.causes[0].term.values == other.causes[0].term.values
    assert one.of_rate is None and one.unit_id == "u"


def test_a_fit_that_does_not_hold_on_another_day_is_said(tmp_path: Path) -> None:
    """On the second day the lid is open as the log says, and lets nothing out."""
    file = plant(tmp_path, 2, opening=6.0)
    shut = pd.read_csv(tmp_path / "day1.csv")
    heat, lid = shut["heat"].to_numpy() * 0.04, shut["lid"].to_numpy() * 0.0
    shut["case"] = heated(shut["t"].to_numpy(), heat, lid, warm_j=0.0, opening=0.0, seed=5) - 0.3 * (
        shut["lid"] > 0.0
    )
    shut.to_csv(tmp_path / "day1.csv", index=False)
    said = CliRunner().invoke(
        app,
        [
            "gap",
            "diagnose",
            str(file),
            "--model",
            str(tmp_path / "nominal.toml"),
            "--held-out",
            "day1",
            "--json",
        ],
    )
    assert said.exit_code == 0, said.output
    (case,) = [each for each in json.loads(said.output)["channels"] if each["channel"] == "case_temperature"]
    assert case["held_out"]["share"] < 0.5 and "may stay on held-out runs" in case["caution"]


def test_a_log_in_which_nothing_can_be_diagnosed_is_refused(tmp_path: Path) -> None:
    t = np.arange(0.0, 300.0)
    file = mapped(tmp_path, {"log": {"t": t, "air": 20.0 + 0.0 * t}})
    with pytest.raises(ConfigurationError, match="nothing in the log can be diagnosed") as refused:
        read_recordings([file])
    assert "no column set_point" in refused.value.found


LOAD = """
import numpy as np
from simulators.effects import ChannelEffect, Parameter, Unit

PUT_IN_S = 1500.0

def put_in(inputs, signal, values):
    \"\"\"A load at the temperature of the air is put in: it takes up heat until it is as warm as the case.\"\"\"
    dip_k, lag_s = values
    since_s = np.maximum(inputs.time_s - PUT_IN_S, 0.0)
    return signal - dip_k * (since_s / lag_s) * np.exp(1.0 - since_s / lag_s)

LOAD = ChannelEffect(
    "cold_load", "case_temperature",
    (Parameter("dip_k", -50.0, 50.0, Unit("K")), Parameter("lag_s", 10.0, 1e4, Unit("s"))),
    (0.0, 300.0), "time since the load was put in", "own", "A cold load was put in.", put_in,
    starts=((1.0, 300.0),),
)
"""
FLAP = """
import numpy as np
from simulators.effects import ChannelEffect, Parameter, Unit

def leak(inputs, signal, values):
    \"\"\"The room's air comes in while the flap is open: the air falls behind at once, and comes back.\"\"\"
    return signal + values[0] * ((inputs.time_s > 4000.0) & (inputs.time_s < 4600.0))

FLAP = ChannelEffect(
    "open_flap", "chamber_air", (Parameter("leak_k", -50.0, 50.0, Unit("K")),), (0.0,), "the flap", "own",
    "A flap lets the room's air in.", leak,
)
"""


@pytest.mark.parametrize("kind", ["a load put in", "a flap of the chamber"])
def test_an_effect_of_ones_own_for_a_channel_in_one_short_file_is_fitted_and_named(
    tmp_path: Path, kind: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("simulators.effects._catalogue._FROM_FILES", {})
    own, rng = tmp_path / "mine.py", np.random.default_rng(3)
    if kind == "a load put in":
        own.write_text(LOAD)
        file, name, channel, values = plant(tmp_path), "cold_load", "case_temperature", (4.0, 500.0)
        for log in tmp_path.glob("day*.csv"):
            table = pd.read_csv(log)
            since_s = np.maximum(table["t"] - 1500.0, 0.0)
            table["case"] -= 4.0 * (since_s / 500.0) * np.exp(1.0 - since_s / 500.0)
            table.to_csv(log, index=False)
    else:
        own.write_text(FLAP)
        (tmp_path / "nominal.toml").write_text(MODEL)
        t = np.arange(0.0, 9000.0)
        flap = 3.0 * ((t > 4000.0) & (t < 4600.0))
        course = 25.0 - np.clip((t - 1000.0) / 60.0, 0.0, 40.0)
        tables = {
            f"day{day}": {
                "t": t,
                "set": course,
                "air": np.round(course + flap + rng.normal(0, 0.02, len(t)), 2),
            }
            for day in range(2)
        }
        file, name, channel, values = mapped(tmp_path, tables), "open_flap", "chamber_air", (3.0,)
    given = ["gap", "diagnose", str(file), "--model", str(tmp_path / "nominal.toml"), "--effects", str(own)]
    said = CliRunner().invoke(app, [*given, "--held-out", "day1", "--json"])
    assert said.exit_code == 0, said.output
    (found,) = [each for each in json.loads(said.output)["channels"] if each["channel"] == channel]
    assert [cause["name"] for cause in found["causes"]] == [name]
    assert tuple(found["causes"][0]["parameters"].values()) == pytest.approx(values, rel=0.05)
    assert found["held_out"]["share"] > 0.95


CHAMBER = """format = 1
[noise]
arw_deg_per_sqrt_h = 0.01
[[effect]]
name = "chamber_response"
parameters = { lag_s = 60.0 }
sigma = { lag_s = 3.0 }
"""


@pytest.mark.parametrize(("off_k", "named"), [(0.045, []), (0.15, ["chamber_offset"])])
def test_nothing_below_half_of_a_thermometers_last_digit_is_a_gap(
    tmp_path: Path, off_k: float, named: list[str]
) -> None:
    """Air at three set points, in steps of 0.1 K and with noise of half of one: means tell 0.01 K."""
    tables = {}
    for day in range(6):
        t = np.arange(0.0, 27000.0, 5.0)
        demand = np.where(t < 9000.0, 25.0, np.where(t < 18000.0, 40.0, 10.0))
        since = t - np.floor(t / 9000.0) * 9000.0
        before = np.where(t < 9000.0, 25.0, np.where(t < 18000.0, 25.0, 40.0))
        air = demand + (before - demand) * np.exp(-since / 60.0) + off_k
        air += np.random.default_rng(day).normal(0.0, 0.05, len(t))
        tables[f"day{day}"] = {"t": t, "air": np.round(air, 1), "set": demand}
    (tmp_path / "nominal.toml").write_text(CHAMBER)
    series = [
        one for made in mapped_logs(mapped(tmp_path, tables)) for one in channels_of(LogSource(made))[0]
    ]
    found = diagnose(series, read_model(tmp_path / "nominal.toml")).findings
    (air,) = (each for each in found if each.signal == "chamber_air")
    assert [cause.name for cause in air.causes] == named
