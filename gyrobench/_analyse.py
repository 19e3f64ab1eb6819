"""Look at logs, diagnose gaps, fit compensations, with the methods of `bench.analysis`.

A run is a run folder or, on object storage, its URL.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from bench.analysis import gap
from bench.analysis.calibration import Calibration, Noise, calibrate, load_record
from bench.analysis.common.fan_out import fan_out
from bench.analysis.common.uncertainty import Budget
from bench.analysis.figures import (
    Figure,
    Outlook,
    StandardFigures,
    figures_of_unit,
    foretell_procedure,
    noise_like,
    noise_named,
)
from bench.analysis.figures import procedure_budgets as budgets_of
from bench.analysis.heading import Form, HeadingStudy, study_heading_logs
from bench.analysis.look import Look, LookOptions
from bench.analysis.look import look as look_at
from bench.analysis.rlg import RlgStudy, study_units
from bench.analysis.thermal import Study, study_folders
from bench.analysis.whirl import Gauge, WhirlStudy, study_whirl_runs
from bench.control.procedure import Procedure, read_procedure
from bench.record.benchfile import BenchFile, load_bench_file
from bench.record.recording import Run

_WINDOW_S = 35.901708 * 3600.0


def look(log: Path | str, options: LookOptions | None = None) -> Look:
    """Look at anybody's log of gyros and accelerometers: text, Parquet, MAT, NPY, NPZ, HDF5 or MDF.

    The result has every axis at its full rate (`axes`: figures, Allan deviation, spectrum, dependence on
    temperature, values of shape (n,) in `channel.base_unit`), the clock, what was guessed (`remarks`) and what
    a log cannot tell (`questions`). `facts()` gives it as plain values. `options` says what the log does not.

    ConfigurationError if the log cannot be read or has no gyro and no accelerometer.
    """
    return look_at(Path(log), options)


def diagnose(
    runs: Iterable[Path | str],
    model: Path | str | gap.Model,
    held_out: Iterable[Path | str] = (),
    *,
    gyro: str | None = None,
) -> gap.Diagnosis:
    """Say where runs of one unit and its nominal model part, which effects explain it, and how far that closes.

    `runs`: run folders, or mapping files (.toml) of foreign recordings. `model`: nominal model file (TOML).
    `held_out`: runs that take no part in fitting and judge the closing, by the id of one given or by path.
    `gyro`: default the first of the runs. Rates are in deg/h, periods in s; see docs/gap.md for the method.

    ConfigurationError for runs of several units, or if a run is to judge that the model was fitted on.
    """
    given = gap.read_recordings(_paths(runs), _paths(held_out), gyro)
    nominal = model if isinstance(model, gap.Model) else gap.read_model(Path(model))
    return gap.diagnose(given.runs, nominal, given.held_out, given.missing)


def fit_cold_shock(
    runs: Iterable[Path | str],
    validate: Iterable[Path | str],
    test: Iterable[Path | str] = (),
    *,
    gyro: str | None = None,
    models: Iterable[str] | None = None,
    jobs: int | None = None,
) -> Study:
    """Fit bias and scale-factor models to cold shocks, choose one on `validate`, judge all on `test`.

    `models`: names of those to fit, default all. `jobs`: processes, default 1. `study.chosen` is the name
    of the chosen model, `study.scores` the figures of every model on every test run (deg/h, ppm), and
    `study.compensation.save(path)` writes the compensation file. Patent CN115855016B; docs/decisions/0006.

    ConfigurationError without a validation run, for a run that was not completed, or for runs of several units.
    """
    with fan_out(jobs) as fan:
        return study_folders(
            _paths(runs), _paths(validate), _paths(test), gyro, list(models) if models else None, fan=fan
        )


def fit_stepwise(
    runs: Iterable[Path | str], test: Iterable[Path | str] = (), *, gyros: Iterable[str] = ()
) -> dict[str, RlgStudy]:
    """Fit a ring-laser gyro's bias over temperature by stepwise regression; return each unit's study by its id.

    `runs`, `test`: `thermal-ramp` run folders. `gyros`: these only. Bias is in deg/h, temperature in degC; see
    docs/rlg.md for the equations. ConfigurationError for a training run that was not completed.
    """
    return study_units(_paths(runs), _paths(test), tuple(gyros))


def fit_standard_test(
    runs: Iterable[Path | str], *, gyro: str | None = None
) -> tuple[list[StandardFigures], list[Figure]]:
    """Return the figures of IEEE Std 952 / 647 and GJB 2426A of one unit's `standard-test` runs.

    First those of each run, then those over several runs, which are power-ons. Each figure has its value, unit
    and 95 % interval. ConfigurationError for runs of several units.
    """
    figures, over_runs = figures_of_unit(_paths(runs), gyro)
    return figures, list(over_runs)


def foretell(
    procedure: str | Procedure,
    bench: BenchFile | Path | str,
    noise: Mapping[str, float] | Path | str,
    /,
    **parameters: Any,
) -> Outlook:
    """Say what a test will be able to resolve of a unit with a given noise, before it begins.

    `noise`: coefficients by name, those left out zero: quantisation (deg), angle_random_walk (deg/sqrt(h)),
    bias_instability (deg/h), rate_random_walk (deg/h/sqrt(h)), rate_ramp (deg/h/h); or a `standard-test` run of
    such a unit. `parameters`: those of the procedure.

    The result has `duration_s` and `figures`; of each, `resolves` is half of its 95 % interval, or what a unit
    without any fault is "not seen above", the bench's budget included (IEEE Std 952; JCGM 100). None with a
    `reason` where such a test does not state it. ConfigurationError for a procedure that plans no intervals.
    """
    found = read_procedure(procedure) if isinstance(procedure, str) else procedure
    file = bench if isinstance(bench, BenchFile) else load_bench_file(Path(bench))
    coefficients = noise_named(noise) if isinstance(noise, Mapping) else noise_like(Path(noise))
    return foretell_procedure(found, found.parse(parameters), coefficients, file)


def procedure_budgets(run: Path | str) -> dict[str, Budget]:
    """Return the uncertainty budgets (JCGM 100) of what a run's procedure measured, by the measurement's name.

    Shock rates, air and unit temperatures, angles, outputs at rest: each with its inputs, `combined` standard
    uncertainty, `k`, `expanded` and `half_width` of the 95 % interval, in the measurement's unit. `value` is
    corrected by the errors that certificates of the bench tell.
    """
    return budgets_of(Run.open(run))


def fit_calibration(
    record: Path | str,
    noise: Noise,
    *,
    scheme: str | None = None,
    gyro: str | None = None,
    dwell_s: float = 180.0,
    latitude_deg: float | None = None,
    lever_arms: bool = False,
    range_dps: float | None = None,
) -> Calibration:
    """Calibrate an IMU from the record of a rotation scheme: 24 parameters with their standard deviations.

    `record`: run folder of `system-calibration`, which says scheme, dwell and latitude itself, or a CSV of
    increments. `noise`: what is assumed of the sensors. `lever_arms`: estimate these and the lag too.
    `range_dps`: the gyros' measuring range. `result.compensation()` is what a compensation file holds.

    RecordError if the record has gaps, ConfigurationError if a CSV comes without scheme and latitude.
    """
    run = load_record(Path(record), scheme=scheme, gyro=gyro, dwell_s=dwell_s, latitude_deg=latitude_deg)
    return calibrate(run, noise, lever_arms=lever_arms, range_dps=range_dps)


def fit_whirl(
    runs: Iterable[Path | str],
    test: Iterable[Path | str] = (),
    *,
    gyro: str | None = None,
    gauge: Gauge = "mean",
) -> WhirlStudy:
    """Fit the whirl of a rotating INS from gyro and rotation angle; judge it on `test`, without it on `runs`.

    `gyro`: default the first with axes x, y, z. `gauge`: how the tilt that nothing shows is fixed. Amplitudes are
    in arcsec; docs/whirl.md has the method. ConfigurationError if no gyro has three axes.
    """
    fitted, judging = ([Run.open(folder) for folder in _paths(folders)] for folders in (runs, test))
    return study_whirl_runs(fitted, judging, gyro, gauge=gauge)


def fit_heading_effect(
    log: Path | str,
    test: Iterable[Path | str] = (),
    *,
    latitude_deg: float | None = None,
    longitude_deg: float | None = None,
    epoch_s: float | None = None,
    damping: float = 0.0,
    columns: Mapping[str, str] | None = None,
    form: Form = "lag9",
    window_s: float = _WINDOW_S,
) -> HeadingStudy:
    """Calibrate the heading effect of a space-stable platform on one log, judge it on others.

    `log`, `test`: CSV, Parquet or run folders with position (deg), platform temperature (degC) and heading (deg).
    `epoch_s`: s since 1970 (UTC) at time 0; place and time that are not given are those of the run folder.
    `columns`: quantity -> column of the log. Errors are in arcsec; docs/heading.md.

    RecordError names what a log lacks; ConfigurationError if it is not known where the platform stood.
    """
    study, _ = study_heading_logs(
        Path(log),
        _paths(test),
        latitude_deg=latitude_deg,
        longitude_deg=longitude_deg,
        epoch_s=epoch_s,
        damping=damping,
        columns=columns,
        form=form,
        window_s=window_s,
    )
    return study


def _paths(places: Iterable[Path | str]) -> list[Path]:
    if isinstance(places, str | Path):
        return [Path(places)]
    return [Path(place) for place in places]
