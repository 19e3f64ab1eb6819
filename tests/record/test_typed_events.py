"""Typed events: a line says what the event said; lines of older run folders say the same as those of today."""

import dataclasses
import json
import math
from typing import Any, Literal, get_args, get_origin, get_type_hints

import pytest

from bench.record.events import EVENTS, Other, read_event
from bench.record.events.run import (
    AirDemand,
    AngleDemand,
    ConditioningDemand,
    HomeDemand,
    Invalid,
    NavigationDemand,
    Note,
    RateDemand,
    Series,
)
from bench.record.events.safe import LastSeen, SafeState, Takeover, TakeoverEnded

VALUES: dict[Any, Any] = {str: "a text", float: 89.12345678, int: 7, bool: True}


def test_a_series_has_columns_of_one_length_and_not_too_many_numbers() -> None:
    series = Series("t", {"a [s]": [1, 2.5], "b": [math.nan, None]})  # type: ignore[list-item]
    assert series.row(3.0)["columns"] == {"a [s]": [1.0, 2.5], "b": [None, None]}
    assert read_event(json.loads(json.dumps(series.row(3.0))))[1] == series
    for columns in ({}, {"a": [1.0], "b": []}, {"a": [0.0] * 2001}):
        with pytest.raises(ValueError, match="columns of one length"):
            Series("t", columns)
    with pytest.raises(ValueError, match="one length"):
        read_event(series.row(3.0) | {"columns": {"a": [1.0], "b": []}})


def sample(hint: Any) -> Any:
    """Return a value of a field's type; of an optional one a value that is not None."""
    if hint in VALUES:
        return VALUES[hint]
    if dataclasses.is_dataclass(hint):
        return hint(**{name: sample(each) for name, each in get_type_hints(hint).items()})
    origin, arguments = get_origin(hint), get_args(hint)
    if origin is Literal:
        return arguments[-1]
    if origin is list:
        return [sample(arguments[0])]
    if origin is dict:
        return {"outer": 1.5 if arguments[1] is Any else sample(arguments[1])}
    return sample(arguments[0])


@pytest.mark.parametrize("kind", EVENTS.values(), ids=lambda kind: kind.kind)
def test_an_event_is_read_as_it_was_written(kind):
    hints = get_type_hints(kind)
    event = kind(**{field.name: sample(hints[field.name]) for field in dataclasses.fields(kind)})
    line = json.loads(json.dumps(event.row(12.5)))
    assert (line["time_s"], line["kind"]) == (12.5, kind.kind)
    assert read_event(line) == (12.5, event)


def test_what_is_not_said_is_not_written_and_no_number_is_null():
    assert RateDemand("table", "table", 1.0).row(0.0) == {
        "time_s": 0.0, "kind": "demand_rate", "device": "table", "axis": "table", "rate_dps": 1.0,
    }  # fmt: skip
    assert SafeState("x", "confirmed", "trouble", rates_dps={"x": math.nan}).fields()["rates_dps"] == {
        "x": None
    }


@pytest.mark.parametrize(
    ("row", "named"),
    [
        ({"kind": "demand_angle", "device": "table", "axis": "inner", "angle_deg": "90"}, "angle_deg"),
        ({"kind": "demand_angle", "device": "table", "axis": "inner", "angle_deg": True}, "angle_deg"),
        ({"kind": "demand_angle", "device": "table", "axis": "inner"}, "angle_deg"),
        ({"kind": "demand_air", "device": "chamber", "set_point_c": 10**400}, "set_point_c"),
        ({"kind": "demand_conditioning", "device": "chamber", "on": 1}, "on"),
        ({"kind": "interval", "test": "bias", "start_s": 0.0, "end_s": 1e9}, "end_s"),
        ({"kind": "safe_state", "device": "table", "state": "perhaps", "cause": "trouble"}, "state"),
        ({"kind": "section", "group": 1.5, "rate_dps": 1.0}, "group"),
        ({"kind": "command", "device": "table", "text": "point to nowhere deg"}, "command"),
    ],
)
def test_a_field_of_another_type_is_named(row, named):
    with pytest.raises(ValueError, match=named):
        read_event({"time_s": 1.0, **row})


def test_a_kind_that_nobody_knows_is_kept_as_it_is():
    row = {"time_s": 1.0, "kind": "coffee", "cups": 2}
    time_s, event = read_event(row)
    assert event == Other("coffee", {"cups": 2}) and event.row(time_s) == row


GONE = "its port is gone (1 s ago it turned at 7.000 deg/s)"
PENDING = f"{GONE}: STOP IT BY HAND. Being made safe: the port is gone."


@pytest.mark.parametrize(
    ("row", "event"),
    [
        (("command", "table", "point to 89.1235 deg"), AngleDemand("table", "table", 89.1235)),
        (
            ("command", "table, inner axis", "point to 90.0000 deg, negative sense"),
            AngleDemand("table", "inner", 90.0, "negative"),
        ),
        (("command", "table", "spin at -10 deg/s"), RateDemand("table", "table", -10.0)),
        (
            ("command", "table, outer axis", "spin at 10 deg/s within 5 deg/s2"),
            RateDemand("table", "outer", 10.0, 5.0),
        ),
        (("command", "table, outer axis", "go home"), HomeDemand("table", "outer")),
        (("command", "chamber", "go to -45 degC at 12 K/min"), AirDemand("chamber", -45.0, 12.0)),
        (("command", "chamber", "go to 25 degC as fast as possible"), AirDemand("chamber", 25.0)),
        (("command", "chamber", "start"), ConditioningDemand("chamber", True)),
        (("command", "chamber", "stop"), ConditioningDemand("chamber", False)),
        (("command", "ins", "navigate"), NavigationDemand("ins")),
        (("alarm", "procedure", "run invalid: too slow"), Invalid("", "too slow", {})),
        (
            ("alarm", "bench", "not confirmed safe: chamber: it is silent."),
            SafeState("chamber", "not_confirmed", "trouble", error="it is silent."),
        ),
        (
            ("alarm", "table", f"not confirmed safe: {PENDING}"),
            SafeState(
                "table",
                "pending",
                "trouble",
                "the port is gone.",
                error=GONE,
            ),
        ),
        (
            ("note", None, "table at rest: outer 0.0012 deg/s, inner -0.0001 deg/s"),
            SafeState("table", "confirmed", "trouble", rates_dps={"outer": 0.0012, "inner": -0.0001}),
        ),
        (
            ("note", None, "chamber at rest: stopped, set point 23.5 degC"),
            SafeState("chamber", "confirmed", "trouble", running=False, set_point_c=23.5),
        ),
        (("note", None, "heading 60 deg for 48 h"), Note("heading 60 deg for 48 h")),
    ],
)
def test_a_line_of_an_older_run_folder_says_what_one_of_today_says(row, event):
    kind, device, text = row
    line = {"time_s": 3.0, "kind": kind, "text": text} | ({} if device is None else {"device": device})
    assert read_event(line) == (3.0, event)


def test_an_older_watchdogs_lines_say_what_those_of_today_say():
    row = {"time_s": 0.0, "kind": "takeover", "cause": "no sign of life for 2.1 s", "utc": "u", "runner": 7}
    assert read_event(row)[1] == Takeover("runner_silent", "u", 7, 2.1)
    row["cause"] = "the runner's process has ended"
    assert read_event(row)[1] == Takeover("runner_ended", "u", 7)
    for outcome, confirmed in (("made safe", True), ("not confirmed safe", False)):
        row = {"time_s": 0.0, "kind": "outcome", "outcome": outcome, "reason": "r"}
        assert read_event(row)[1] == TakeoverEnded(confirmed)


def test_a_safe_state_says_itself():
    seen = LastSeen(21.3, {"outer": 7.0, "inner": 0.5})
    gone = SafeState("table", "not_confirmed", "trouble", code="port_gone", error="long", last_seen=seen)
    assert str(gone) == (
        "table: its port is gone and has not come back (21 s ago it turned at 7.000 deg/s, 0.500 deg/s)"
    )
    air = LastSeen(2.0, air_temp_c=-44.96, set_point_c=-45.0)
    deaf = SafeState(
        "chamber", "not_confirmed", "trouble", code="silent", error="it is silent.", last_seen=air
    )
    assert str(deaf) == "chamber: it is silent (2 s ago its air was at -45.0 degC, the set point -45.0 degC)"
