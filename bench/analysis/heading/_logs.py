"""From logs and run folders on disk to the study of a heading effect."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

from bench.analysis.heading._files import Site, checksum_of_log, load_log, site_of_run
from bench.analysis.heading._frames import earth_rotation_deg
from bench.analysis.heading._lagged import Form
from bench.analysis.heading._study import HeadingStudy, study_heading
from bench.record.run_folder import url_of
from drivers.base.errors import ConfigurationError


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

    def site(path: Path) -> Site:
        return _site(path, latitude_deg, longitude_deg, epoch_s, damping)

    calibration, other_temp_c = load_log(log, site(log), columns)
    held_out = {path.stem: load_log(path, site(path), columns)[0] for path in tests}
    study = study_heading(calibration, held_out, form=form, window_s=window_s, other_temp_c=other_temp_c)
    return study, dict(checksum_of_log(path) for path in (log, *tests))


def _site(
    log: Path, latitude_deg: float | None, longitude_deg: float | None, epoch_s: float | None, damping: float
) -> Site:
    """Return where a log was made: as told, or as a run folder's manifest has it."""
    zero_deg = None if epoch_s is None else earth_rotation_deg(epoch_s)
    if latitude_deg is not None and longitude_deg is not None:
        return Site(latitude_deg, longitude_deg, zero_deg, damping)
    if not (log.is_dir() or url_of(log)):
        raise ConfigurationError(
            "where the platform stood is not known",
            where=str(log),
            expected="--latitude-deg and --longitude-deg, or a run folder, whose manifest has them",
        )
    run = site_of_run(log, damping)
    return Site(
        run.latitude_deg if latitude_deg is None else latitude_deg,
        run.longitude_deg if longitude_deg is None else longitude_deg,
        run.sidereal_zero_deg if epoch_s is None else zero_deg,
        damping,
    )
