"""From run folders to thermal runs: 1 s means of the gyro's output and of the two temperatures."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from bench.analysis.common.runs import case_temp_c, gyros_of
from bench.analysis.common.seconds import gyro_seconds
from bench.analysis.thermal._scale_factor import RateRun, scale_factor_group
from bench.analysis.thermal._types import ThermalRun
from bench.record.events.run import Section
from bench.record.recording import Phase, Run
from drivers.base.arrays import Array
from drivers.base.constants import DPH_PER_DPS
from drivers.base.errors import ConfigurationError


def load_thermal_runs(folder: Path, gyro: str | None = None) -> list[ThermalRun]:
    """Return what a cold-shock run folder gives for fitting: a bias run, or one run per scale-factor group.

    `gyro` defaults to the first of the bench file. Rows cover whole seconds, (t - 1, t]; NaN where a second has
    no valid sample. A bias run starts with the phase `equilibrium`, a section of a scale-factor group with its
    `reference`. ConfigurationError names what a folder lacks.
    """
    run = Run.open(folder)
    name = gyros_of(run, (gyro,) if gyro else ())[0]
    sections = run.of(Section)
    if not sections:
        return [_bias_run(run, name)]
    ends = [start_s for start_s, _ in sections[1:]] + [_end_s(run.phases())]
    groups: dict[int, list[RateRun]] = {}
    for (start_s, section), end_s in zip(sections, ends, strict=True):
        rate_run = _rate_run(run, name, section.rate_dps, start_s, end_s)
        groups.setdefault(section.group, []).append(rate_run)
    thermal_runs = []
    for number, rows in groups.items():
        # Under the name and checksum of the folder that the sections share.
        run_id = run.manifest.run_id if len(groups) == 1 else f"{run.manifest.run_id} group {number}"
        group = replace(scale_factor_group(rows), run_id=run_id, checksum=run.checksum, meta={"gyro": name})
        thermal_runs.append(group)
    return thermal_runs


def _bias_run(run: Run, gyro: str) -> ThermalRun:
    phases = run.phases()
    reference = _phase(run, phases, "reference")
    start = math.floor(_phase(run, phases, "equilibrium").start_s)
    end = math.floor(_end_s(phases))
    rate_dps, measured = _measured(run, gyro, start, end)
    return ThermalRun(
        time_s=np.arange(start + 1.0, end + 1.0),
        bias_dph=DPH_PER_DPS * rate_dps - run.earth_rate_dph(np.arange(start + 0.5, end)),
        sf_error_ppm=None,
        reference=(reference.start_s, reference.end_s),
        phases=[(phase.start_s, phase.name) for phase in phases if phase.end_s > start],
        true_bias_dph=run.true_means(gyro, "bias_dph", start, end),
        **measured,
    )


def _measured(run: Run, gyro: str, start: int, end: int) -> tuple[Array, dict[str, Any]]:
    """Return the gyro's 1 s means in deg/s, and what thermal runs of any kind have of these seconds."""
    means = gyro_seconds(run, gyro, start, end)
    return means.rate_dps, {
        "run_id": run.manifest.run_id,
        "unit_id": run.manifest.unit(gyro),
        "gyro_temp_c": means.temp_c,
        "case_temp_c": case_temp_c(run, gyro, start, end),
        "checksum": run.checksum,
        "remarks": means.remarks,
        "meta": {"gyro": gyro},
    }


def _rate_run(run: Run, gyro: str, rate_dps: float, start_s: float, end_s: float) -> RateRun:
    phases = [phase for phase in run.phases() if start_s <= phase.start_s < end_s]
    reference = _phase(run, phases, "reference")
    start, end = math.floor(reference.start_s), math.floor(end_s)
    output_dps, measured = _measured(run, gyro, start, end)
    return RateRun(
        rate_dps=rate_dps,
        time_s=np.arange(1.0, end - start + 1.0),
        output_dps=output_dps,
        reference=(0.0, reference.end_s - start),
        phases=[(phase.start_s - start, phase.name) for phase in phases if phase.end_s > start],
        true_sf_error_ppm=run.true_means(gyro, "sf_error_ppm", start, end),
        **measured,
    )


def _end_s(phases: Sequence[Phase]) -> float:
    """Return where the test ends: after it, table and chamber are brought to rest."""
    return next((phase.start_s for phase in phases if phase.name == "close"), phases[-1].end_s)


def _phase(run: Run, phases: tuple[Phase, ...] | list[Phase], name: str) -> Phase:
    for phase in phases:
        if phase.name == name:
            return phase
    raise ConfigurationError(
        f"the run has no phase {name!r}: it cannot be fitted",
        where=str(run.place),
        found=", ".join(phase.name for phase in phases) or "no phases",
        expected="a cold-shock run that got beyond its reference window",
        remedy=f"the run is marked {run.manifest.outcome}: {run.manifest.reason or 'no reason given'}",
    )
