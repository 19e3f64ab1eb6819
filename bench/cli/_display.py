"""Progress of a run on the terminal: a live panel, or a plain line now and then when it is no terminal."""

from __future__ import annotations

from types import TracebackType

from rich.console import Console
from rich.live import Live
from rich.table import Table

from bench.progress import Progress
from drivers.clock import host_seconds

_PLAIN_EVERY_S = 5.0


class RunDisplay:
    """Shows `Progress`; call it with each one. Use as a context manager around the run."""

    def __init__(self, console: Console, title: str, expected_s: float) -> None:
        self._console = console
        self._title = title
        self._expected_s = expected_s
        self._live = (
            Live(console=console, auto_refresh=False, transient=True) if console.is_terminal else None
        )
        self._said_at = -_PLAIN_EVERY_S
        self._started = host_seconds()

    def __enter__(self) -> RunDisplay:
        if self._live is not None:
            self._live.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._live is not None:
            self._live.stop()

    def __call__(self, progress: Progress) -> None:
        """Show where the run is."""
        if self._live is not None:
            self._live.update(self._panel(progress), refresh=True)
        elif host_seconds() - self._said_at >= _PLAIN_EVERY_S:
            self._said_at = host_seconds()
            self._console.print(self._line(progress), highlight=False)

    def _left(self, progress: Progress) -> str:
        left = max(0.0, self._expected_s - progress.time_s)
        speed = progress.time_s / max(1e-9, host_seconds() - self._started)
        wall = f" ({duration(left / speed)} at {speed:,.0f} x)" if speed > 5.0 else ""
        return f"about {duration(left)} left{wall}"

    def _line(self, progress: Progress) -> str:
        return (
            f"{duration(progress.time_s)}  {progress.step}: {progress.doing}  "
            f"air {progress.air_temp_c:.1f} / {progress.set_point_c:.1f} degC  "
            f"table {progress.angle_deg:.2f} deg {progress.rate_dps:+.3f} deg/s  "
            f"{self._left(progress)}"
        )

    def _panel(self, progress: Progress) -> Table:
        panel = Table(title=self._title, show_header=False, min_width=78)
        panel.add_column(style="bold", no_wrap=True)
        panel.add_column()
        panel.add_row("bench time", f"{duration(progress.time_s)}, {self._left(progress)}")
        panel.add_row("step", progress.step)
        panel.add_row("doing", progress.doing)
        panel.add_row("phase", progress.phase)
        panel.add_row(
            "chamber", f"{progress.air_temp_c:7.2f} degC, set point {progress.set_point_c:.2f} degC"
        )
        panel.add_row(
            "table",
            f"{progress.angle_deg:8.3f} deg, {progress.rate_dps:+.4f} deg/s, demand {progress.demand}",
        )
        for name, gyro in progress.gyros.items():
            panel.add_row(
                name, f"{gyro.rate_dps * 3600.0:+12.3f} deg/h (last minute), {gyro.temp_c:.2f} degC"
            )
        return panel


def duration(seconds: float) -> str:
    """Return a duration as h:mm:ss."""
    whole = round(seconds)
    return f"{whole // 3600}:{whole // 60 % 60:02d}:{whole % 60:02d}"


def size(count: float) -> str:
    """Return a number of bytes for reading."""
    for unit in ("B", "kB", "MB", "GB"):
        if count < 1000.0 or unit == "GB":
            return f"{count:.0f} {unit}" if unit == "B" else f"{count:.1f} {unit}"
        count /= 1000.0
    raise AssertionError("unreachable")
