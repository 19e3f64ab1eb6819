"""Progress of a run on the terminal: a live view, a plain line now and then when it is no terminal, or JSON."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import asdict
from typing import Any

from rich.live import Live
from rich.table import Table
from rich.text import Text

from bench.control.instrument_station import column_words
from bench.control.progress import GyroProgress, Progress
from bench.present.cli._console import Terminal
from bench.present.cli._texts import duration
from bench.present.sentences import demands_words, event_of, sentence
from drivers.base.clock import host_seconds

_PLAIN_EVERY_S = 5.0
_PLAIN_AGAIN_S = 30.0
"""Between plain lines that say that the same goes on."""
_JSON_EVERY_S = 1.0
_LOG_LINES = 4


class RunDisplay:
    """Shows `Progress`; call it with each one. Use as a context manager around the run.

    On a console for machines it is a line of JSON a second.
    """

    def __init__(self, console: Terminal, title: str, expected_s: float) -> None:
        self._console = console
        self._title = title
        self._expected_s = expected_s
        living = console.is_terminal and not console.as_json
        self._live = Live(console=console, auto_refresh=False, transient=True) if living else None
        self._every_s = _JSON_EVERY_S if console.as_json else _PLAIN_EVERY_S
        self._said_at = -self._every_s
        self._said = ""
        self._alarm: tuple[Any, ...] = ()
        self._started = host_seconds()

    def __enter__(self) -> RunDisplay:
        if self._live is not None:
            self._live.start()
        return self

    def __exit__(self, *_: object) -> None:
        if self._live is not None:
            self._live.stop()

    def __call__(self, progress: Progress) -> None:
        """Show where the run is."""
        if self._live is not None:
            self._live.update(self._view(progress), refresh=True)
        elif progress.alarms[-1:] != self._alarm or host_seconds() - self._said_at >= self._wait_s(progress):
            self._alarm = progress.alarms[-1:]
            self._said_at, self._said = host_seconds(), progress.step + progress.doing
            left_s = self._left_s(progress)
            self._console.say_json("progress", run=self._title, left_s=left_s, **asdict(progress))
            self._console.say(self._line(progress), soft_wrap=True)

    def _wait_s(self, progress: Progress) -> float:
        same = not self._console.as_json and progress.step + progress.doing == self._said
        return _PLAIN_AGAIN_S if same else self._every_s

    def _left_s(self, progress: Progress) -> float:
        return progress.left_s(self._expected_s)

    def _left(self, progress: Progress) -> str:
        left = self._left_s(progress)
        speed = progress.time_s / max(1e-9, host_seconds() - self._started)
        wall = f" ({duration(left / speed)} at {speed:,.0f} x)" if speed > 5.0 else ""
        return f"about {duration(left)} left{wall}"

    def _line(self, progress: Progress) -> str:
        trouble = "".join(
            f"  {name}: {_trouble(gyro)}" for name, gyro in progress.gyros.items() if _trouble(gyro)
        )
        alarms = f"  ALARM {_alarm(progress.alarms[-1])}" if progress.alarms else ""
        return (
            f"{duration(progress.time_s)}  {progress.step}: {progress.doing}  "
            f"air {progress.air_temp_c:.1f} / {progress.set_point_c:.1f} degC  "
            f"table {progress.angle_deg:.2f} deg {progress.rate_dps:+.3f} deg/s  "
            f"{self._left(progress)}{trouble}{alarms}"
        )

    def _view(self, progress: Progress) -> Table:
        view = Table(title=self._title, show_header=False, min_width=78)
        view.add_column(style="bold", no_wrap=True)
        view.add_column()
        for name, text, style in _rows(progress, self._left(progress)):
            view.add_row(name, Text(text, style=style))
        return view


def _rows(progress: Progress, left: str) -> Iterable[tuple[str, str, str]]:
    """Yield (name, text, style) of everything that is shown of a run, top to bottom."""
    yield "bench time", f"{duration(progress.time_s)}, {left}", ""
    yield "step", progress.step, ""
    yield "doing", progress.doing, "yellow" if progress.paused else ""
    yield "phase", progress.phase, ""
    rate = progress.air_rate_k_per_min
    moving = "" if math.isnan(rate) else f", {rate:+.2f} K/min"
    air = f"{progress.air_temp_c:7.2f} degC, set point {progress.set_point_c:.2f} degC{moving}"
    yield "chamber", air, ""
    table = f"{progress.angle_deg:8.3f} deg, {progress.rate_dps:+.4f} deg/s"
    yield "table", f"{table}, demand {demands_words(progress.demands)}", ""
    for name, row in progress.readings.items():
        values = (f"{words} {value:.4g} {unit}".rstrip() for (words, unit), value in _in_words(row))
        yield name, ", ".join(values), ""
    for name, gyro in progress.gyros.items():
        text = f"{gyro.rate_dps * 3600.0:+12.3f} deg/h (last minute), {gyro.temp_c:.2f} degC"
        counts = f"{gyro.frames:,} frames, {_trouble(gyro) or 'none lost or rejected'}"
        yield name, f"{text}\n{counts}", "red" if gyro.age_s > 5.0 else ""
    for alarm in progress.alarms[-3:]:
        yield "ALARM", _alarm(alarm), "bold red"
    for row in progress.log[-_LOG_LINES:]:
        yield "", f"{duration(float(row['time_s']))} {sentence(event_of(row))}", "dim"


def _in_words(row: Mapping[str, float]) -> Iterable[tuple[tuple[str, str], float]]:
    return ((column_words(column), value) for column, value in row.items())


def _trouble(gyro: GyroProgress) -> str:
    parts = [f"{gyro.lost} lost"] if gyro.lost else []
    parts += [f"{count} rejected ({why})" for why, count in gyro.rejected.items() if count]
    if gyro.age_s > 5.0:
        parts.append(f"silent for {gyro.age_s:.0f} s")
    return ", ".join(parts)


def _alarm(alarm: Any) -> str:
    return f"{duration(float(alarm['time_s']))} {sentence(event_of(alarm))}"
