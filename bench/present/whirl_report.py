"""From a whirl study and its runs to what the whirl report shows."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from bench.analysis.whirl import (
    FREE_PART,
    MEANING,
    Estimate,
    Judgement,
    WhirlStudy,
    integrated_residual,
    remove_slow,
    tilt_spectrum,
)
from bench.present.report import RunSummary, WhirlContent, WhirlJudgement, WhirlLine
from bench.record.recording import checksum
from drivers.base.clock import utc_now

_PLOT_STEP_S = 0.5
_SPECTRUM = np.arange(-8.0, 8.0 + 1e-9, 0.02)


def whirl_content(study: WhirlStudy, runs: Sequence[RunSummary], compensation_file: Path) -> WhirlContent:
    """Return the content of the report; `compensation_file` has been written."""
    time_s, measured, fitted = integrated_residual(study.fit)
    angle = np.linspace(0.0, 2.0 * np.pi, 361)
    orbit = study.compensation.tilt_arcsec(angle) * np.exp(-1j * angle)
    before, after = _spectra(study.judgements[0])
    gauge = study.compensation.gauge
    fit = study.fit
    return WhirlContent(
        unit_id=study.compensation.unit_id,
        created_utc=utc_now(),
        runs=runs,
        lines=[
            WhirlLine(line, value.real, value.imag, float(sd), float(evidence))
            for line, value, sd, evidence in zip(
                fit.lines, fit.amplitudes_arcsec.tolist(), fit.sd_arcsec, fit.statistic, strict=True
            )
        ],
        judgements=[_judgement(row) for row in study.judgements],
        residual_time_s=time_s,
        residual_x=measured.real,
        residual_y=measured.imag,
        residual_fit_x=fitted.real,
        residual_fit_y=fitted.imag,
        # theta_y is the tilt about x_s, theta_x about y_s
        orbit_x=orbit.imag,
        orbit_y=orbit.real,
        spectrum_lines=_SPECTRUM,
        spectrum_before=before,
        spectrum_after=after,
        free=FREE_PART,
        gauge=f"gauge {gauge}: {MEANING[gauge]}",
        declared=fit.declared,
        findings=[finding.text for finding in study.findings],
        facts=_facts(study),
        judged_on_fitted=study.judged_on_fitted,
        file_name=compensation_file.name,
        file_sha256=checksum(compensation_file).sha256,
        software=study.compensation.software,
    )


def _judgement(row: Judgement) -> WhirlJudgement:
    record = row.record
    step = max(1, round(_PLOT_STEP_S / record.period_s))
    before, where = remove_slow(row.tilt_before, record.time_s, record.angle_rad)
    after, _ = remove_slow(row.tilt_after, record.time_s, record.angle_rad)
    before, after = before[::step], after[::step]
    return WhirlJudgement(
        run_id=record.run_id,
        time_s=record.time_s[where][::step],
        before_x=before.real,
        before_y=before.imag,
        after_x=after.real,
        after_y=after.imag,
        locked_before_arcsec=row.before.locked_arcsec,
        locked_after_arcsec=row.after.locked_arcsec,
        locked_patent_arcsec=None if row.patent is None else row.patent.locked_arcsec,
        total_before_arcsec=row.before.total_arcsec,
        total_after_arcsec=row.after.total_arcsec,
    )


def _spectra(row: Judgement) -> tuple[np.ndarray[tuple[int], np.dtype[np.float64]], ...]:
    record = row.record
    step = max(1, round(_PLOT_STEP_S / record.period_s))
    parts = []
    for tilt in (row.tilt_before, row.tilt_after):
        moving, where = remove_slow(tilt, record.time_s, record.angle_rad)
        parts.append(tilt_spectrum(moving[::step], record.angle_rad[where][::step], _SPECTRUM))
    return tuple(parts)


def _facts(study: WhirlStudy) -> list[tuple[str, str]]:
    fit = study.fit
    rate = fit.body_rate_dph[0]
    facts = [
        ("Rate that stands still in the body", _with_sd(rate, "°/h")),
        ("Azimuth of y from Earth rate", f"{study.heading_deg:.3f}°"),
        ("Angle random walk an axis", f"{fit.noise_arcsec_per_sqrt_s / 60.0:.5f} °/√h"),
        ("Drift", _with_sd(fit.drift_dph[0], "°/h") if fit.drift_dph else "not separable from line +1"),
        ("Separation of drift and line +1", f"condition number {fit.separation:.3g}"),
    ]
    if fit.play_arcsec is not None:
        facts.append(("Jump of tilt with the sense of rotation", _with_sd(fit.play_arcsec, "arcsec")))
    return facts


def _with_sd(estimate: Estimate, unit: str) -> str:
    x, y = estimate.value.real, estimate.value.imag
    return f"{x:.4f} about x, {y:.4f} about y, ± {estimate.sd:.4f} {unit}"
