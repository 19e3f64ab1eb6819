"""Whose figure a measurement is: the gyro's that the procedure names, or every unit's of the run."""

from __future__ import annotations

from types import SimpleNamespace

from bench.present.panel._run_figures import _measured


def test_a_figure_of_one_gyro_is_no_figure_of_the_others() -> None:
    measured = [
        {"name": "bias", "value": 0.4, "unit": "deg/h", "gyro": "mems"},
        {"name": "fog_temperature", "value": 21.0, "unit": "degC"},
        {"name": "air", "value": 20.0, "unit": "degC", "gyro": None},
    ]
    manifest = SimpleNamespace(procedure="mine", measurements=measured, units={"fog": "F-1", "mems": "M-7"})
    rows = [(row["unit"], row["figure"], row["value"]) for row in _measured(manifest)]  # type: ignore[arg-type]
    assert rows == [
        ("M-7", "mine: bias", 0.4),
        ("F-1", "mine: temperature", 21.0),
        ("F-1", "mine: air", 20.0),
        ("M-7", "mine: air", 20.0),
    ]
