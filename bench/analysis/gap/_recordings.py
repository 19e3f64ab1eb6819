"""Runs as they are given: folders and mapping files, some of them, or some of the runs in them, held out."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from bench.analysis.gap._channel_data import ChannelSeries, channels_of
from bench.analysis.gap._channel_log import LogSource
from bench.analysis.gap._channel_run import RunSource
from bench.analysis.gap._data import GapRun
from bench.analysis.gap._diagnose import Recording
from bench.analysis.gap._import import axes_of, rate_of
from bench.analysis.gap._mapped import MappedLog, imported_log, mapped_logs
from bench.analysis.gap._position import PositionRun, is_platform_run, load_platform_run
from bench.analysis.gap._run_folder import gyros_of, load_gap_runs, named_gyro
from bench.record.recording import Run
from drivers.base.errors import ConfigurationError


@dataclass(frozen=True)
class Recordings:
    """What `diagnose` takes: recordings to diagnose and to judge on; why runs lack a channel, by channel."""

    runs: tuple[Recording, ...]
    held_out: tuple[Recording, ...]
    missing: dict[str, str]

    @property
    def of_platform(self) -> bool:
        """Whether they are of a platform, which has a position and no rate."""
        return isinstance(self.runs[0], PositionRun)

    @property
    def unit_id(self) -> str:
        """The unit of the first run."""
        return self.runs[0].unit_id

    @property
    def shown(self) -> list[GapRun]:
        """The rate's runs that a report draws: held-out ones, else those diagnosed."""
        return [run for run in self.held_out or self.runs if isinstance(run, GapRun)]


def read_recordings(
    paths: Sequence[Path], held_out: Sequence[Path] = (), gyro: str | None = None
) -> Recordings:
    """Return the recordings of run folders and mapping files (.toml), all signals of them.

    A held-out run is one of those given, by its id, or a folder or mapping file of its own. ConfigurationError
    for runs of a gyro and of a platform together, and for one to hold out that is not there.
    """
    _refuse_mixture([*paths, *(path for path in held_out if path.exists())])
    given, missing = _read(paths, gyro)
    leading = {run.run_id for run in given if not isinstance(run, ChannelSeries)}
    leading = leading or {run.run_id for run in given}
    named = {str(path) for path in held_out} & leading
    files = [path for path in held_out if str(path) not in named]
    for path in files:
        if not path.exists():
            raise ConfigurationError(
                "there is no such run to hold out",
                where="--held-out",
                found=str(path),
                expected="a run folder, a mapping file, or one of the runs given: "
                + ", ".join(sorted(leading)),
            )
    if named and named == leading:
        raise ConfigurationError(
            "every run is held out", where="--held-out", expected="at least one run to diagnose"
        )
    apart, more = _read(files, gyro)
    return Recordings(
        tuple(run for run in given if run.run_id not in named),
        (*(run for run in given if run.run_id in named), *apart),
        missing | more,
    )


def read_batch(paths: Sequence[Path]) -> list[GapRun]:
    """Return the rate's runs of every gyro of run folders, and those of every axis of mapping files (.toml).

    An axis of several is a unit of its own ("SN123 y"); of mapping files that name one log its axes come once.
    ConfigurationError for what cannot be read, and for runs of a platform.
    """
    runs: dict[tuple[str, str, str], GapRun] = {}
    for path in paths:
        if path.suffix == ".toml":
            found = [run for made in mapped_logs(path) for run in _every_axis(made)]
        else:
            found = [run for gyro in gyros_of(Run.open(path)) for run in load_gap_runs(path, gyro)]
        runs |= {(run.unit_id, run.run_id, run.checksum): run for run in found}
    return list(runs.values())


def _every_axis(made: MappedLog) -> Iterator[GapRun]:
    axes = axes_of(made.mapping)
    for axis in axes:
        run = rate_of(made, axis)
        yield run if len(axes) == 1 else replace(run, unit_id=f"{made.mapping.unit_id} {axis}")


def load_channels(folder: Path, gyro: str | None = None) -> tuple[list[ChannelSeries], dict[str, str]]:
    """Return the channels of a run folder, and for those that it cannot show the reason by channel."""
    run = Run.open(folder)
    if run.manifest.imported is not None:
        return channels_of(LogSource(imported_log(run)))
    units = [unit for unit in run.manifest.units if run.manifest.device(unit).role == "gyro"]
    return channels_of(RunSource(run, gyro or next(iter(units), "")))


def _read(paths: Sequence[Path], gyro: str | None) -> tuple[list[Recording], dict[str, str]]:
    runs: list[Recording] = []
    missing: dict[str, str] = {}
    for path in paths:
        if is_platform_run(path):
            runs.append(load_platform_run(path))
        elif (logs := _logs(path, gyro)) is not None:
            for made in logs:
                series, without = channels_of(LogSource(made))
                if not series and not made.has_rate:
                    raise _nothing_in(made, without)
                runs += [rate_of(made, gyro)] if made.has_rate else []
                runs += series
                missing |= without
        else:
            runs += load_gap_runs(path, gyro)
            series, without = load_channels(path, gyro)
            runs += series
            missing |= without
    return runs, missing


def _logs(path: Path, gyro: str | None) -> Iterable[MappedLog] | None:
    """Return the logs of a mapping file, the one of an imported run, None for a run of our own."""
    if path.suffix == ".toml":
        return mapped_logs(path)
    run = Run.open(path)
    if run.manifest.imported is None:
        return None
    if gyro is not None:
        named_gyro(run, gyro)
    return [imported_log(run)]


def _nothing_in(made: MappedLog, without: Mapping[str, str]) -> ConfigurationError:
    return ConfigurationError(
        "nothing in the log can be diagnosed",
        where=made.file.name,
        found="no gyro (output); " + "; ".join(f"{name}: {reason}" for name, reason in without.items()),
        expected="a gyro's output, or a channel with what it is to follow: set_point and air, air and t_out, "
        "t_out and t_in, angle_demand and angle, rate_demand and table_rate",
        remedy="map the columns that the log has (docs/exchange.md)",
    )


def _refuse_mixture(paths: Sequence[Path]) -> None:
    platforms = [path for path in paths if is_platform_run(path)]
    if platforms and len(platforms) < len(paths):
        raise ConfigurationError(
            "runs of a platform and of a gyro under one model",
            found=", ".join(str(path) for path in paths),
            expected="runs of one unit",
            remedy="diagnose each unit by itself",
        )
