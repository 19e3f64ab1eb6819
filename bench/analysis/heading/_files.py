"""Logs from runs, CSV and Parquet, and the study of a heading effect made from them."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import replace
from datetime import datetime
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bench.analysis.common.runs import require_different
from bench.analysis.heading._frames import earth_rotation_deg, sidereal_rad
from bench.analysis.heading._lagged import Form
from bench.analysis.heading._log import PlatformLog, Site, WarmUp, log_from_positions, stays
from bench.analysis.heading._study import HeadingStudy, study_heading
from bench.record.benchfile import bench_file_from
from bench.record.exchange import read_table as read_log_table
from bench.record.recording import Run, checksum, read_table, table_name
from bench.record.run_folder import url_of
from drivers.base.arrays import Array
from drivers.base.constants import SIDEREAL_DAY_S
from drivers.base.errors import ConfigurationError, RecordError

_ANGLE = ("time_ns", "angle_deg")
_COLUMNS = ("time_s", "latitude_deg", "longitude_deg", "temp_c", "heading_deg")
"""What a log needs, and the columns' usual names."""
_FORCE = tuple(f"accelerometer_{axis}_mps2" for axis in "xyz")
_FURTHER = ("second_temp_c", *_FORCE)
"""What is read as well where a column has the name, or is given it."""


def study_heading_logs(
    log: Path,
    tests: Sequence[Path] = (),
    *,
    latitude_deg: float | None = None,
    longitude_deg: float | None = None,
    epoch_s: float | None = None,
    damping: float = 0.0,
    columns: Mapping[str, str] | None = None,
    form: Form = "lag9",
    window_s: float,
) -> tuple[HeadingStudy, dict[str, str]]:
    """Calibrate on `log`, judge on `tests`; return the study, and the tables' checksums by folder and file.

    `epoch_s`: s since 1970 (UTC) at time 0 of the logs; place and time that are not given are a run folder's.
    """

    zero_deg = None if epoch_s is None else earth_rotation_deg(epoch_s)
    given = {"latitude_deg": latitude_deg, "longitude_deg": longitude_deg, "sidereal_zero_deg": zero_deg}

    def site(path: Path) -> Site:
        if latitude_deg is not None and longitude_deg is not None:
            return Site(latitude_deg, longitude_deg, zero_deg, damping)
        if not (path.is_dir() or url_of(path)):
            raise ConfigurationError(
                "where the platform stood is not known",
                where=str(path),
                expected="--latitude-deg and --longitude-deg, or a run folder, whose manifest has them",
            )
        known = {name: value for name, value in given.items() if value is not None}
        return replace(site_of_run(path, damping), **known)

    sums = [checksum_of_log(path) for path in (log, *tests)]
    require_different(sums)
    calibration, other_temp_c = load_log(log, site(log), columns)
    named = Counter(path.stem for path in tests)
    held_out = {
        path.stem if named[path.stem] == 1 else str(path.with_suffix("")): load_log(
            path, site(path), columns
        )[0]
        for path in tests
    }
    study = study_heading(calibration, held_out, form=form, window_s=window_s, other_temp_c=other_temp_c)
    return study, dict(sums)


def site_of_run(place: Path, damping: float = 0.0) -> Site:
    """Return where the platform of a run stood: latitude and longitude of its bench file, time by its start.

    An emulated lab's stars stand at its longitude when its time begins, whatever the date. RecordError for a
    run that is not of one platform INS.
    """
    run = Run.open(place)
    name = platform_of(run)
    section = next(part for part in bench_file_from(run.manifest.bench).platform if part.name == name)
    started_s = datetime.fromisoformat(run.manifest.started_utc).timestamp()
    zero_deg = None if run.manifest.emulated is not None else earth_rotation_deg(started_s)
    return Site(run.manifest.latitude_deg, section.longitude_deg, zero_deg, damping)


def platform_of(run: Run) -> str:
    """Return the name of a run's platform INS; RecordError if there is none, or more than one."""
    found = run.platforms
    if len(found) != 1:
        raise RecordError(
            "a run folder with one platform INS is needed",
            where=str(run.place),
            found=", ".join(found) or "no table of a platform INS",
            expected=f"one {table_name('platform', '<name>')}",
            remedy="name the table itself instead of the run folder" if found else "",
        )
    return found[0]


def checksum_of_log(path: Path) -> tuple[str, str]:
    """Return the name of a log (of a run: of its table) and its SHA-256."""
    if not (path.is_dir() or url_of(path)):
        return f"{path.parent.name}/{path.name}", checksum(path).sha256
    run = Run.open(path)
    table = table_name("platform", platform_of(run))
    sealed = run.manifest.files.get(table) or checksum(run.file(table))
    return f"{path.name}/{table}", sealed.sha256


def unit_of_log(path: Path) -> str:
    """Return the unit that a run's platform is; empty for a log of other software, which does not say."""
    if not (path.is_dir() or url_of(path)):
        return ""
    run = Run.open(path)
    return run.manifest.unit(platform_of(run))


def load_log(
    path: Path, site: Site, columns: Mapping[str, str] | None = None
) -> tuple[PlatformLog, Array | None]:
    """Return (log, other temperature or None) of a log of any format that imports read, or of a run folder.

    `columns` names columns that are not called as in `_COLUMNS` and `_FURTHER`; a `time_ns` column serves as
    time. Empty cells are missing values, and so is a position that the unit itself called not valid (a column
    `valid`; it was still aligning). Raises RecordError for a file or column that is not there, or text where a
    number belongs.
    """
    wanted = {**{name: name for name in _COLUMNS}, **(columns or {})}
    if unknown := set(wanted) - {*_COLUMNS, "other_temp_c", *_FURTHER}:
        raise RecordError(
            "a log has no such quantity",
            found=", ".join(sorted(unknown)),
            expected=", ".join([*_COLUMNS, "other_temp_c", *_FURTHER]),
        )
    table: Mapping[str, NDArray[Any]]
    if path.is_dir() or url_of(path):
        run = Run.open(path)
        table = run.platform(platform_of(run))
        wanted = {"other_temp_c": "cabinet_temp_c", **wanted}
        turned = run.turntable(_ANGLE) if "turntable" in run.tables else None
    elif path.exists():
        table = _table(path)
        beside = path.with_name("turntable.parquet")
        turned = read_table(beside, _ANGLE) if beside.exists() else None
    else:
        raise RecordError("there is no such log", where=str(path), expected="a file, or a run")
    if "time_ns" in table and wanted["time_s"] not in table:
        table = {**table, wanted["time_s"]: table["time_ns"] * 1e-9}
    if wanted["heading_deg"] not in table and "time_ns" in table and turned:
        # The table's angle at the last telemetry before each row.
        row = np.searchsorted(turned["time_ns"], table["time_ns"], side="right") - 1
        table = {**table, wanted["heading_deg"]: turned["angle_deg"][np.clip(row, 0, None)]}
    wanted = {**{name: name for name in _FURTHER if name in table}, **wanted}
    if (force := [name for name in _FORCE if name in wanted]) and len(force) < len(_FORCE):
        wanted |= {name: name for name in _FORCE if name not in wanted}
    if missing := [name for name in wanted.values() if name not in table]:
        raise RecordError(
            "the log lacks columns",
            where=str(path),
            found=", ".join(table),
            expected=", ".join(missing),
            remedy="name them, e.g. --column temp_c=platform_temperature",
        )
    values = {name: np.asarray(table[column], dtype=np.float64) for name, column in wanted.items()}
    other = values.pop("other_temp_c", None)
    whole = values
    if "valid" in table:
        values = _navigating(values, table["valid"] != 0.0)
        other = None if other is None else other[-len(values["time_s"]) :]
    second = values.pop("second_temp_c", None)
    axes = [values.pop(name) for name in force]
    log = replace(
        log_from_positions(**values, site=site),
        second_c=second,
        force_mps2=np.stack(axes, axis=1) if axes else None,
    )
    return replace(log, warm_up=_warm_up(whole, log, site)), other


def _warm_up(whole: Mapping[str, Array], log: PlatformLog, site: Site) -> WarmUp | None:
    """Return the record from its beginning to the first turn, if it is longer than the log."""
    if len(whole["time_s"]) == len(log.time_s):
        return None
    first = stays(log)
    stop = len(whole["time_s"]) - len(log.time_s) + (first[0].stop if first else 0)
    time_s = whole["time_s"][:stop]
    zero_deg = (site.sidereal_zero_deg or 0.0) + site.longitude_deg
    return WarmUp(time_s, sidereal_rad(time_s, zero_deg), whole["temp_c"][:stop])


def _navigating(values: Mapping[str, Array], valid: NDArray[np.bool_]) -> dict[str, Array]:
    """Return the rows from a sidereal day before the first valid position on, positions valid or NaN.

    The day before, the last of the alignment, has the reference temperature; what was earlier was warm-up.
    """
    kept = {
        name: np.where(valid, column, np.nan) if name in ("latitude_deg", "longitude_deg") else column
        for name, column in values.items()
    }
    if valid.any():
        begin_s = values["time_s"][np.argmax(valid)] - SIDEREAL_DAY_S
        start = int(np.searchsorted(values["time_s"], begin_s))
        kept = {name: column[start:] for name, column in kept.items()}
    return kept


def _table(path: Path) -> dict[str, Array]:
    """Return the columns of numbers of a log; a column with words in it is none of ours."""
    log = read_log_table(path)
    if odd := log.words.pop("", ""):
        raise RecordError("the log's rows are not all alike", where=str(path), found=odd)
    return {name: column for name, column in log.columns.items() if name not in log.words}
