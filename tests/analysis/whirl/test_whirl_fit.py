"""The direct fit's statistics, the order test and the scan against theory, by Monte Carlo (checks C20, C21)."""

import dataclasses
import math

import numpy as np
import pytest

from bench.analysis.whirl._direct import fit_direct
from bench.analysis.whirl._integral import body_lines, fit_integral, match_coefficients
from bench.analysis.whirl._lines import CANDIDATES, choose_lines, scan_lines
from bench.analysis.whirl._types import TurnRecord
from benchmarks.whirl_runs import nominal_angle

ARW = 0.12  # arcsec/sqrt(s) = 0.002 deg/sqrt(h)
RATE_DPS = 6.0
LATITUDE_DEG = 40.0
TRUTH = {-2.0: 0.9 - 0.6j, -1.0: 5.0 - 3.0j, 1.0: 3.0 + 2.0j, 2.0: -9.0 + 8.0j, 3.0: 4.0 + 4.4j}
EARTH_DPH = 11.0 - 3.0j


def record(
    seed: int,
    *,
    turns: int = 10,
    hz: float = 4.0,
    lines: dict[float, complex] | None = None,
    earth: complex = 0j,
    drift: complex = 0j,
    every: int = 0,
    arw: float = ARW,
    ripple: float = 0.0,
    latitude_deg: float = 0.0,
) -> TurnRecord:
    """Rates written down from d/dt(tilt in body axes), reversed every so many turns, with white noise."""
    rng = np.random.default_rng(seed)
    period = 1.0 / hz
    t = period * np.arange(round(turns * 360.0 / RATE_DPS * hz) + 1)
    turn = t / (360.0 / RATE_DPS)
    covered = np.abs((turn + every) % (2 * every) - every) if every else turn
    psi = 2.0 * np.pi * covered
    psi = psi + ripple * np.sin(psi)
    body = sum((a * np.exp(1j * m * psi) for m, a in (lines or {}).items()), np.zeros(len(t), complex))
    middle = 0.5 * (psi[1:] + psi[:-1])
    seen = (np.diff(body) / period + earth) * np.exp(-1j * middle) + drift
    seen = seen + (rng.normal(size=len(middle)) + 1j * rng.normal(size=len(middle))) * arw / math.sqrt(period)
    z = np.degrees(np.diff(psi)) / period
    rates = np.stack([seen.real / 3600.0, seen.imag / 3600.0, z], axis=1)
    return TurnRecord(f"r{seed}", "U", period, t, rates, psi, np.ones(len(z), bool), latitude_deg)


def test_everything_is_recovered_without_noise() -> None:
    run = record(
        1, lines=TRUTH, earth=EARTH_DPH, drift=0.02 - 0.01j, every=2, arw=0.0, hz=50.0, latitude_deg=0.0
    )
    fit = fit_direct([run], tuple(TRUTH))
    for line, truth in TRUTH.items():
        # latitude 0: no vertical Earth rate in the model; what is left is the half-sample average of the rate
        assert fit.amplitude(line).value == pytest.approx(truth, abs=2e-5)
    assert fit.body_rate_dph[0].value == pytest.approx(EARTH_DPH, abs=1e-5)
    assert fit.drift_dph[0].value == pytest.approx(0.02 - 0.01j, abs=1e-5)


def test_standard_deviation_law() -> None:
    """sd = N / (|m| w sqrt T) an axis: 0.0191, 0.0095, 0.0064 arcsec for m = 1, 2, 3 at 6 deg/s over 1 h."""
    fit = fit_direct([record(3, turns=60, hz=10.0)])
    for line, expected in ((1.0, 0.0191), (-2.0, 0.00955), (3.0, 0.00637)):
        assert fit.amplitude(line).sd == pytest.approx(expected, rel=0.05)
    w, turns = math.radians(RATE_DPS), 10
    found = np.array(
        [fit_direct([record(100 + n, turns=turns)], (1.0, 2.0)).amplitudes_arcsec for n in range(500)]
    )
    for column, line in enumerate((1, 2)):
        spread = math.sqrt(0.5 * float((np.abs(found[:, column]) ** 2).mean()))
        theory = ARW / (line * w * math.sqrt(turns * 60.0))
        assert spread == pytest.approx(theory, rel=0.08)  # 1000 numbers: 2.2 % one sigma


def test_truth_lies_within_two_sigma_as_often_as_it_should() -> None:
    """93 to 97 % of the coefficients, reversals and drift included, over 200 seeds (14 numbers each)."""
    inside, count = 0, 0
    for seed in range(200):
        run = record(
            seed, turns=12, lines=TRUTH, earth=EARTH_DPH, drift=0.01 + 0.02j, every=2, latitude_deg=0.0
        )
        fit = fit_direct([run], tuple(TRUTH))
        for truth, estimate in [
            *((value, fit.amplitude(line)) for line, value in TRUTH.items()),
            (EARTH_DPH, fit.body_rate_dph[0]),
            (0.01 + 0.02j, fit.drift_dph[0]),
        ]:
            off = estimate.value - truth
            inside += int(abs(off.real) < 2.0 * estimate.sd) + int(abs(off.imag) < 2.0 * estimate.sd)
            count += 2
    assert 0.93 <= inside / count <= 0.97


def test_false_alarms_and_power_of_the_order_test() -> None:
    alarms = sum(bool(choose_lines([record(seed, turns=8, hz=1.0)], false_alarm=0.05)) for seed in range(400))
    assert abs(alarms - 20) < 3.0 * math.sqrt(400 * 0.05 * 0.95) + 1.0
    weak = {5.0: 0.04 + 0.02j, -4.0: -0.03 + 0.04j}
    assert all(
        set(choose_lines([record(seed, turns=60, hz=1.0, lines=weak)])) == {-4.0, 5.0} for seed in range(10)
    )
    assert len(CANDIDATES) == 48


def test_drift_and_constant_tilt_one_way_are_declared_inseparable() -> None:
    run = record(5, lines=TRUTH, drift=0.05)
    fit = fit_direct([run], tuple(TRUTH))
    assert fit.drift_dph == ()
    assert "one and the same in rotation one way" in fit.declared[0]
    # the drift of 0.05 deg/h is then in line +1 as eps / (j w): 0.48 arcsec
    shift = fit.amplitude(1.0).value - TRUTH[1.0]
    assert shift == pytest.approx(0.05 / (1j * math.radians(RATE_DPS)), abs=5 * fit.amplitude(1.0).sd)


def test_a_reversal_separates_drift_and_constant_tilt() -> None:
    run = record(6, turns=40, lines=TRUTH, drift=0.05, every=4)
    fit = fit_direct([run], tuple(TRUTH))
    assert fit.separation < 1.2
    assert fit.drift_dph[0].value == pytest.approx(0.05, abs=4 * fit.drift_dph[0].sd)
    assert fit.amplitude(1.0).value == pytest.approx(TRUTH[1.0], abs=4 * fit.amplitude(1.0).sd)
    two_ways = [record(7, lines=TRUTH, drift=0.05), _backwards(record(8, lines=TRUTH, drift=0.05))]
    assert fit_direct(two_ways[:1]).separation > 1e6
    # a drift of its own in either run leaves the two as inseparable as before
    assert fit_direct(two_ways).drift_dph == ()


def _backwards(run: TurnRecord) -> TurnRecord:
    """The same bearing turned the other way: angle and rates by construction, not by mirroring."""
    period = run.period_s
    psi = -run.angle_rad
    body = sum(a * np.exp(1j * m * psi) for m, a in TRUTH.items())
    seen = np.diff(body) / period * np.exp(-0.5j * (psi[1:] + psi[:-1])) + 0.05
    rates = np.stack([seen.real / 3600.0, seen.imag / 3600.0, -run.rate_dps[:, 2]], axis=1)
    return dataclasses.replace(run, angle_rad=psi, rate_dps=rates)


def test_lines_off_the_whole_numbers_are_found() -> None:
    cage = {0.4287: 1.2 + 0.9j}
    fit = fit_direct([record(9, turns=60, hz=2.0, lines={**TRUTH, **cage})])
    (line,) = scan_lines(fit)
    assert line.line == pytest.approx(0.4287, abs=1e-3)
    assert abs(line.amplitude_arcsec) == pytest.approx(1.5, abs=0.15)
    assert line.statistic > 10.0 * line.threshold
    assert scan_lines(fit_direct([record(10, turns=60, hz=2.0, lines=TRUTH)])) == ()


def test_ripple_spoils_a_fit_at_the_nominal_angle_only() -> None:
    run = record(11, lines=TRUTH, ripple=0.05, arw=0.0, hz=20.0)
    direct = fit_direct([run], tuple(TRUTH))
    assert abs(direct.amplitude(2.0).value - TRUTH[2.0]) < 2e-3
    class_only = {line: TRUTH[line] for line in (-1.0, 2.0, 3.0)}
    patent = record(12, lines=class_only, ripple=0.05, arw=0.0, hz=20.0)
    measured = fit_integral(patent, 2)
    nominal = fit_integral(patent, 2, angle_rad=nominal_angle(patent))

    def misfit(fit: np.ndarray) -> float:
        lines, amplitudes = body_lines(match_coefficients(fit))
        return max(abs(a - TRUTH.get(line, 0.0)) for line, a in zip(lines, amplitudes, strict=True))

    assert misfit(nominal) > 20.0 * misfit(measured)


def test_holes_are_left_out() -> None:
    run = record(13, lines=TRUTH, arw=0.0, hz=20.0)
    usable = run.usable.copy()
    usable[500:540] = False
    rates = run.rate_dps.copy()
    rates[500:540] = 77.0
    damaged = dataclasses.replace(run, usable=usable, rate_dps=rates)
    assert np.allclose(fit_direct([damaged], tuple(TRUTH)).amplitudes_arcsec, list(TRUTH.values()), atol=2e-3)
