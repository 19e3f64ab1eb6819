"""What a report shows, independent of where it comes from: plain frozen values, units in the names.

A number that is not known is None or NaN and is printed as a dash; a part that is empty leaves no section.
Text may come from anywhere (a device's answer, a manifest): it is escaped when it is printed.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from drivers.base.arrays import Array


@dataclass(frozen=True)
class Device:
    """An instrument or unit that took part; `name` as in the bench file."""

    name: str
    maker: str = ""
    model: str = ""
    serial_number: str = ""
    firmware: str = ""
    role: str = ""


@dataclass(frozen=True)
class Measurement:
    """A measured value against optional limits; `passed` None when nothing was judged."""

    name: str
    value: float | None
    unit: str = ""
    low: float | None = None
    high: float | None = None
    passed: bool | None = None


@dataclass(frozen=True)
class StreamStatistics:
    """What came of a gyro's stream. `clock_error_ppm`: its clock against the bench's; `off`: frames that were not
    sent while the procedure had the unit switched off.
    """

    gyro: str
    frames: int | None = None
    lost: int | None = None
    rejected: int | None = None
    sample_rate_hz: float | None = None
    clock_error_ppm: float | None = None
    off: int = 0


@dataclass(frozen=True)
class RunSummary:
    """One run. `outcome` is the manifest's: completed, invalid, aborted or running.

    `role` says what the run was used for (training, validation, held out), `checksum` is the SHA-256 that ties
    the report to the record, `units` are the ids of the units under test by gyro name.
    """

    run_id: str
    procedure: str
    outcome: str
    units: Mapping[str, str] = field(default_factory=dict)
    parameters: Mapping[str, Any] = field(default_factory=dict)
    reasons: Sequence[str] = ()
    started_utc: str = ""
    duration_s: float | None = None
    devices: Sequence[Device] = ()
    software: Mapping[str, str] = field(default_factory=dict)
    measurements: Sequence[Measurement] = ()
    streams: Sequence[StreamStatistics] = ()
    warnings: Sequence[str] = ()
    role: str = ""
    checksum: str = ""
    bench_name: str = ""
    bench_file_sha256: str = ""
    mounting: str = ""
    operator: str = ""
    emulated: str = ""

    @property
    def valid(self) -> bool:
        """Whether the run was completed and met its own criteria."""
        return self.outcome == "completed"


@dataclass(frozen=True, eq=False)
class Trace:
    """What one gyro saw over a run. `time_s` and the temperatures have shape (n,); None where not measured.

    `output_time_s` and `output_dph`, shape (m,), are 100 s means in deg/h of what `output_name` says.
    `phases` are (start_s, name), each lasting until the next.
    """

    run_id: str
    time_s: Array
    phases: Sequence[tuple[float, str]] = ()
    air_temp_c: Array | None = None
    set_point_c: Array | None = None
    case_temp_c: Array | None = None
    gyro_temp_c: Array | None = None
    output_time_s: Array | None = None
    output_dph: Array | None = None
    output_name: str = "Bias"
    gyro: str = ""


@dataclass(frozen=True)
class ModelScore:
    """A model judged on one run that it was not fitted on; `kind` describes that run ('slow ramp').

    Stability is the sample standard deviation of non-overlapping 100 s means over the whole run, deg/h.
    `attainable_percent` is the improvement that subtracting the true drift would give, None when the truth is
    unknown. Bias figures are None on a scale-factor group and scale-factor figures None on a bias run.
    """

    model: str
    run_id: str
    kind: str = ""
    stability_raw_dph: float | None = None
    stability_comp_dph: float | None = None
    improvement_percent: float | None = None
    attainable_percent: float | None = None
    peak_dph: float | None = None
    sf_rms_ppm: float | None = None
    sf_max_ppm: float | None = None
    sf_raw_rms_ppm: float | None = None
    sf_raw_max_ppm: float | None = None


@dataclass(frozen=True, eq=False)
class Comparison:
    """A held-out run before and after the chosen model, 100 s means, shape (n,); either pair may be None."""

    run_id: str
    time_s: Array
    kind: str = ""
    bias_before_dph: Array | None = None
    bias_after_dph: Array | None = None
    sf_before_ppm: Array | None = None
    sf_after_ppm: Array | None = None
    floor_dph: float | None = None


@dataclass(frozen=True)
class ValidRange:
    """The range of an input inside which a compensation may be used."""

    name: str
    low: float | None
    high: float | None
    unit: str = ""


@dataclass(frozen=True)
class CompensationSummary:
    """The model that was chosen, why, and what it was made from; runs by id with their checksums."""

    unit_id: str
    model: str
    reason: str = ""
    training_runs: Mapping[str, str] = field(default_factory=dict)
    validation_runs: Mapping[str, str] = field(default_factory=dict)
    valid_ranges: Sequence[ValidRange] = ()
    file_name: str = ""
    file_sha256: str = ""


@dataclass(frozen=True)
class CampaignContent:
    """Everything a campaign report shows. `noise_floor_dph` is the 1 sigma floor of 100 s means."""

    title: str
    bench_name: str
    created_utc: str
    runs: Sequence[RunSummary] = ()
    traces: Sequence[Trace] = ()
    scores: Sequence[ModelScore] = ()
    comparisons: Sequence[Comparison] = ()
    compensation: CompensationSummary | None = None
    software: Mapping[str, str] = field(default_factory=dict)
    warnings: Sequence[str] = ()
    noise_floor_dph: float | None = None
    bench_file_sha256: str = ""
    operator: str = ""
    subject: str = ""


@dataclass(frozen=True)
class RunContent:
    """Everything the report of a single run shows; a trace for each gyro."""

    summary: RunSummary
    traces: Sequence[Trace] = ()
    created_utc: str = ""
