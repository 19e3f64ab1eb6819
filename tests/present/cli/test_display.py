"""What the terminal shows of a run: all of it on a terminal, lines elsewhere, JSON for machines."""

import io
import json

import pytest

from bench.control.progress import GyroProgress, Progress
from bench.present.cli._console import Terminal
from bench.present.cli._display import RunDisplay

NAN = float("nan")


def progress(**changes):
    gyro = GyroProgress(1.0 / 3600.0, 0.0, 24.0, frames=1200, lost=3, rejected={"checksum": 2}, age_s=0.1)
    fields = {
        "time_s": 3600.0,
        "step": "S112 Shock",
        "doing": "soak at -45 degC",
        "phase": "soak",
        "air_temp_c": -44.5,
        "set_point_c": -45.0,
        "air_rate_k_per_min": -1.25,
        "auxiliary_c": {"1": NAN},
        "angle_deg": 89.7,
        "rate_dps": 0.0,
        "demands": {"table": {"angle_deg": 89.7}},
        "gyros": {"fog_1": gyro},
        "alarms": ({"time_s": 3500.0, "kind": "alarm", "device": "chamber", "text": "door [open]"},),
        "log": ({"time_s": 3400.0, "kind": "phase", "phase": "soak"},),
    }
    return Progress(**(fields | changes))


def shown(*, terminal=False, as_json=False, given=None):
    output = io.StringIO()
    console = Terminal(file=output, width=120, force_terminal=terminal, color_system=None, as_json=as_json)
    with RunDisplay(console, "run 7", 7200.0) as display:
        display(given or progress())
        text = output.getvalue()
    return text


EVERYTHING = [
    "S112 Shock",
    "soak at -45 degC",
    "-44.5",
    "-45.0",
    "89.7",
    "1:00:00 left",
    "3 lost",
    "2 rejected",
]


@pytest.mark.parametrize("terminal", [True, False])
def test_everything_is_shown_on_a_terminal_and_in_a_plain_line(terminal):
    text = shown(terminal=terminal)
    for word in [*EVERYTHING, "checksum", "door [open]"]:
        assert word in text, word
    if terminal:
        assert "-1.25 K/min" in text and "1,200 frames" in text and "0:56:40 phase soak" in text
    else:
        assert text.count("\n") == 1


def test_a_silent_gyro_is_said():
    silent = GyroProgress(0.0, 0.0, 24.0, age_s=42.0)
    assert "silent for 42 s" in shown(given=progress(gyros={"fog_1": silent}))


def test_json_is_one_object_a_line_without_nan():
    (line,) = shown(as_json=True).splitlines()
    row = json.loads(line, parse_constant=lambda name: pytest.fail(name))
    assert row["kind"] == "progress" and row["run"] == "run 7" and row["left_s"] == 3600.0
    assert row["auxiliary_c"] == {"1": None}
    assert row["gyros"]["fog_1"]["lost"] == 3 and row["alarms"][0]["text"] == "door [open]"


def test_an_alarm_is_said_at_once_though_the_same_goes_on():
    output = io.StringIO()
    with RunDisplay(Terminal(file=output, width=120), "run 7", 7200.0) as display:
        display(progress())
        display(progress())
        said = output.getvalue().count("\n")
        display(
            progress(
                alarms=({"time_s": 3501.0, "kind": "alarm", "device": "table", "text": "its port is gone"},)
            )
        )
    assert said == 1 and output.getvalue().count("\n") == 2 and "its port is gone" in output.getvalue()
