"""Rounded stamps of rows that a logger polls, and codes of an encoder: noise that is known, and no gap."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.fft import dct

from bench.analysis.gap._align import aligned
from bench.analysis.gap._causes import _turned, within_codes
from bench.analysis.gap._cells import BANDS, codes_dph, power_in, shared_noise
from bench.analysis.gap._data import GapRun, cut, group_runs
from bench.analysis.gap._diagnose import diagnose
from bench.analysis.gap._findings import Cause
from bench.analysis.gap._import import read_mapped_runs
from bench.analysis.gap._model_file import Model, Term
from bench.analysis.gap._noise import Noise, periodogram, power_of
from bench.analysis.gap._prepare import prepare
from bench.analysis.gap._reading import as_turned, without_reading_noise
from bench.analysis.gap._rounding_noise import RoundingNoise, rounding_noise, step_deg
from drivers.base.arrays import Array
from simulators.effects import Stimulus, Variant
from tests.analysis.gap.conftest import effect, made_run, stimulus

_DIGIT_S, _SECONDS, _PEAK_DPS, _PERIOD_S = 1e-3, 1200, 40.0, 61.3
_NOISE_DPH = 0.24
_MAPPING = """
format = 1
unit_id = "G8"
latitude_deg = 48.0
[columns]
time = { name = "t", unit = "s" }
output = { name = "rate", unit = "deg/h" }
angle = { name = "table", unit = "deg" }
"""
_RUN = '[[run]]\nfile = "{0}.csv"\nprofile = "sine"\ncondition = "40"\nelevation_deg = {1}\n'
_EARTH_UP_DPH = 15.041067 * np.sin(np.radians(48.0))


def _log(
    path: Path,
    seed: int,
    *,
    late_s: float = 0.02,
    still_s: float = 0.0,
    code: float = 0.0,
    tick_s: float = 0.0,
) -> None:
    """Rows about every second, polled up to `late_s` late: the table's angle, the mean rate since the last row.

    The table swings by a sine of 40 deg/s after `still_s` at 40 deg/s; stamps are true but for their last digit.
    With an angle cut off to whole codes a run begins at any phase. With a clock of ticks rows come at whole ones.
    """
    rng = np.random.default_rng(seed)
    taken_s = np.arange(_SECONDS + 1.0)
    taken_s[1:] += rng.uniform(0.0, late_s, _SECONDS)
    taken_s = np.rint(taken_s / tick_s) * tick_s if tick_s else taken_s
    swing = np.maximum(taken_s - still_s, 0.0) + (rng.uniform(0.0, 600.0) if code else 0.0)
    angle = _PEAK_DPS * (
        np.minimum(taken_s, still_s) + _PERIOD_S / 2 / np.pi * np.sin(2 * np.pi * swing / _PERIOD_S)
    )
    rate = np.diff(angle, prepend=angle[0]) / np.diff(taken_s, prepend=-1.0)
    output = 3600.0 * rate + _EARTH_UP_DPH + rng.normal(0.0, _NOISE_DPH, len(rate))
    angle = np.floor(angle / code) * code if code else angle
    rows = zip(np.round(taken_s, 3), output, angle, strict=True)
    lines = [f"{t:.3f},{value:.6f},{at:.9f}" for t, value, at in rows]
    path.write_text("\n".join(["t,rate,table", *lines]) + "\n", encoding="utf-8")


def _runs(folder: Path, elevation_deg: float = 90.0, count: int = 3, **log: float) -> list[GapRun]:
    text = _MAPPING
    for name in range(count):
        _log(folder / f"{name}.csv", name, **log)
        text += _RUN.format(name, elevation_deg)
    (folder / "map.toml").write_text(text, encoding="utf-8")
    return read_mapped_runs(folder / "map.toml")


def _left_dph(runs: Sequence[GapRun]) -> np.ndarray:
    return np.stack([run.output_dph - run.stimulus.input_rate_dph for run in runs])[:, 1:]


def test_the_noise_of_rounded_stamps_is_what_is_left(tmp_path: Path) -> None:
    """Closed form: two edges, each off by a uniform error of one digit's width, times the rate there."""
    runs = _runs(tmp_path)
    (group,) = group_runs(runs)
    expected = (3600.0 * _PEAK_DPS * _DIGIT_S) ** 2 / 12.0 + _NOISE_DPH**2  # mean square of a sine is a half
    assert float(np.mean(_left_dph(runs) ** 2)) == pytest.approx(expected, rel=0.1)
    told = power_in(group, Noise(_NOISE_DPH / 60.0))
    # cos^2 has its power in two thirds of the samples, and may be larger by two standard deviations of it
    assert float(told.mean()) == pytest.approx(expected * (1.0 + 2.0 * np.sqrt(2.0 / 800.0)), rel=0.03)


@pytest.mark.parametrize("late_s", [0.02, 0.2])
def test_it_is_there_at_every_time_scale_as_told(tmp_path: Path, late_s: float) -> None:
    """In the long run errors cancel but for rates and lengths that differ from row to row, and the ends."""
    runs = _runs(tmp_path, count=12, late_s=late_s)
    (group,) = group_runs(runs)
    found = (dct(_left_dph(runs), norm="ortho")[:, 1:] ** 2).mean(axis=0)
    told = power_in(group, Noise(_NOISE_DPH / 60.0))[: len(found)]
    for low, high in ((0, 60), (60, 200), (200, 600), (600, 1190)):
        assert float((found[low:high] / told[low:high]).mean()) == pytest.approx(1.0, abs=0.25)


def test_the_noise_of_codes_is_what_is_left_at_every_time_scale(tmp_path: Path) -> None:
    """18 bits, stamps that are even: the angle is off by a uniform error of one code at each edge."""
    code = 360.0 / 2**18
    runs = _runs(tmp_path, count=12, late_s=0.0, code=code)
    (group,) = group_runs(runs)
    assert group.known_noise.quantum_arcsec == pytest.approx(3600.0 * code, rel=0.06)
    found = (dct(_left_dph(runs), norm="ortho")[:, 1:] ** 2).mean(axis=0)
    told = power_in(group, Noise(_NOISE_DPH / 60.0))[: len(found)]
    for low, high in ((0, 60), (60, 200), (200, 600), (600, 1190)):
        assert float((found[low:high] / told[low:high]).mean()) == pytest.approx(1.0, abs=0.25)


@pytest.mark.parametrize(
    ("digits", "code", "found"),
    [(9, 360.0 / 2**18, 360.0 / 2**18), (4, 360.0 / 2**18, 360.0 / 2**18), (3, 0.0, 1e-3), (12, 0.0, 0.0)],
)
def test_the_step_of_an_angle_is_its_codes_or_its_last_digits(digits: int, code: float, found: float) -> None:
    angle = 200.0 + 390.0 * np.sin(np.arange(4000) / 61.0) + np.random.default_rng(1).uniform(0.0, 1.0, 4000)
    angle = np.floor(angle / code) * code if code else angle
    angle[::50] = np.nan
    assert step_deg(np.round(angle, digits)) == pytest.approx(found, rel=1e-9)
    assert step_deg(np.full(1000, 37.2)) is None
    assert step_deg(np.tile(np.arange(0.0, 360.0, 15.0), 20)) is None  # commanded headings


def test_a_table_at_rest_has_no_noise_of_codes(tmp_path: Path) -> None:
    """It swings for ten minutes after ten at rest."""
    path = tmp_path / "0.csv"
    at = 12.345 + 40.0 * np.sin(np.maximum(np.arange(1200.0) - 600.0, 0.0) / 9.7)
    rows = [f"{t}.000,{_EARTH_UP_DPH},{angle:.3f}" for t, angle in enumerate(at.tolist())]
    path.write_text("\n".join(["t,rate,table", *rows]) + "\n", encoding="utf-8")
    (tmp_path / "map.toml").write_text(_MAPPING + _RUN.format(0, 90.0), encoding="utf-8")
    (run,) = read_mapped_runs(tmp_path / "map.toml")
    assert run.rounding_noise is not None
    sigma_deg = run.rounding_noise.sigma_deg
    assert (sigma_deg[:598] == 0.0).all() and sigma_deg[605:] == pytest.approx(1e-3 / np.sqrt(12.0))


def test_a_simulated_table_at_a_few_rates_is_read_exactly() -> None:
    """20, -7.5 and 0.1 deg/s in rows of exactly a second: all multiples of 0.1 deg, and no code."""
    rates_dps = np.repeat((0.0, 20.0, -7.5, 0.1), 300)
    assert step_deg(np.cumsum(rates_dps)) is None


def test_a_turned_axis_and_a_stretch_on_its_line_have_less_of_it(tmp_path: Path) -> None:
    upright, level = (group_runs(_runs(tmp_path, at))[0].known_noise.quantum_arcsec for at in (90.0, 30.0))
    assert level == pytest.approx(0.5 * upright, rel=1e-6)
    steady, (said,) = without_reading_noise(_runs(tmp_path, still_s=600.0))
    assert "that the gyro does not follow" in said
    for run in steady:
        assert run.rounding_noise is not None
        even = run.rounding_noise.even
        assert even[5:590].all() and not even[605:612].any()
        first = cut(run, 500).rounding_noise
        assert first is not None and (len(first.even), len(first.span_s)) == (501, 500)


def test_stamps_beside_an_even_turn_are_off_by_the_change_of_rate() -> None:
    """20, -3 for one sample, -20 deg/s: stamps of 0.1 ms at its edges move it by 23 and 17 deg/s times that."""
    rate_dps = np.array([20.0] * 500 + [-3.0] + [-20.0] * 499)
    still = np.full(1000, 25.0)
    angle = np.concatenate(([0.0], np.cumsum(rate_dps)))
    s = Stimulus(np.arange(1.0, 1001.0), still, still, angle, np.full(1000, 90.0), 48.0)
    noise = RoundingNoise(np.full(1001, 1e-4), np.zeros(1001), np.ones(1000), np.zeros(1001, np.bool_))
    line = noise.on_a_line(slice(0, 501)).on_a_line(slice(501, 1001))
    found = line.of_stamps(s, np.zeros(1000, bool))
    rng, total = np.random.default_rng(4), 0.0
    for _ in range(2000):  # a logger that reads truly and stamps late
        read = np.diff(angle) / np.diff(np.arange(1001.0) + rng.normal(0.0, 1e-4, 1001))
        grid = np.concatenate(([0.0], np.cumsum(read)))
        first = np.polyval(np.polyfit(np.arange(501), grid[:501], 1), 500)
        last = np.polyval(np.polyfit(np.arange(500), grid[501:], 1), 0)
        total += (last - first + 3.0) ** 2
    assert found.quantum_arcsec == 0.0
    # the deviation of two edges' squares, 2 sqrt(2 (23^4 + 17^4)) / (23^2 + 17^2), is added
    most = 1.0 + 2.0 * np.sqrt(2.0 * (23.0**4 + 17.0**4)) / (23.0**2 + 17.0**2)
    told = found.arw_deg_per_sqrt_h**2 * 3600.0 * 1000.0 / most
    assert told == pytest.approx(3600.0**2 * total / 2000.0, rel=0.1)
    masked = line.of_stamps(s, rate_dps == -3.0)
    assert masked.arw_deg_per_sqrt_h == 0.0


def test_noise_of_a_few_samples_may_be_larger_than_its_mean() -> None:
    """Eight samples at one rate: seven edges that two share, and two; as of 16^2 / 30 samples."""
    rate_dps = np.where(np.arange(1000) // 8 == 50, 20.0, 0.0)
    still = np.full(1000, 25.0)
    angle = np.concatenate(([0.0], np.cumsum(rate_dps)))
    s = Stimulus(np.arange(1.0, 1001.0), still, still, angle, np.full(1000, 90.0), 48.0)
    noise = RoundingNoise(np.full(1001, 1e-4), np.zeros(1001), np.ones(1000), np.zeros(1001, np.bool_))
    found = noise.of_stamps(s, np.zeros(1000, bool))
    most = 1.0 + 2.0 * np.sqrt(2.0 * 30.0 / 16.0**2)
    # two edges stand alone, seven are an angle's
    white, angle_arcsec2 = (
        2.0 * (3600.0 * 20.0 * 1e-4) ** 2 / 1000.0,
        12.0 * 7.0 * (72000.0 * 1e-4) ** 2 / 1000.0,
    )
    assert found.arw_deg_per_sqrt_h**2 * 3600.0 == pytest.approx(most * white)
    assert found.quantum_arcsec**2 == pytest.approx(most * angle_arcsec2)
    masked = noise.of_stamps(s, rate_dps > 0.0)
    assert masked.arw_deg_per_sqrt_h == masked.quantum_arcsec == 0.0


def test_the_scatter_moves_with_the_angle(tmp_path: Path) -> None:
    run = _runs(tmp_path)[0]
    late = replace(run, output_dph=np.roll(run.output_dph, 2))
    (moved,), said = aligned([late])
    assert said and moved.rounding_noise is not None and run.rounding_noise is not None
    assert moved.rounding_noise.sigma_s[2:].tolist() == run.rounding_noise.sigma_s[:-2].tolist()


def test_what_is_known_beside_the_noise_is_not_raised_noise() -> None:
    known, rng = Noise(0.003, quantum_arcsec=3.0), np.random.default_rng(1)
    part = periodogram(rng.normal(size=(2, 64)), 1.0, beside=known)
    alone = periodogram(rng.normal(size=(2, 64)), 1.0)
    assert part.power(Noise(0.004, 0.1)) == pytest.approx(alone.power(Noise(0.005, 0.1, 0.0, 3.0)))


@pytest.mark.parametrize("log", [{"late_s": 0.003}, {"late_s": 0.2}, {"late_s": 0.0, "code": 360.0 / 2**18}])
def test_a_perfect_gyro_with_rounded_stamps_or_codes_has_no_gap(
    tmp_path: Path, nominal: Model, log: dict[str, float]
) -> None:
    found = diagnose(_runs(tmp_path, **log), nominal).rate
    assert found.verdict == "no gap" and not found.causes and not found.stochastic
    assert found.noise.noise.quantum_arcsec < 1.0  # 144 arcsec a digit at 40 deg/s


def test_stamps_that_say_less_than_they_know_make_no_noise(tmp_path: Path, nominal: Model) -> None:
    """Ticks of 12 ms in digits of 1 ms are true: 144 arcsec a digit at 40 deg/s would hide all that is there."""
    runs = _runs(tmp_path, late_s=0.1, tick_s=0.012)
    assert group_runs(runs)[0].known_noise.quantum_arcsec > 30.0
    (group,) = group_runs(as_turned(runs)[0])
    assert group.known_noise.quantum_arcsec < 3.0
    late = [replace(run, output_dph=run.output_dph + _late_dph(run.stimulus, 1e-5)) for run in runs]
    found = diagnose(late, nominal).rate
    assert [cause.name for cause in found.causes] == ["time_offset"]


def _late_dph(s: Stimulus, by_s: float) -> np.ndarray:
    return np.asarray(by_s * np.gradient(s.input_rate_dph, s.time_s))


def test_codes_that_repeats_share_are_no_gap(tmp_path: Path, nominal: Model) -> None:
    """A table that goes through the very same angles in every repeat: the mean of three has as much as one."""
    code, taken_s, text = 360.0 / 2**16, np.arange(_SECONDS + 1.0), _MAPPING
    angle = _PEAK_DPS * _PERIOD_S / 2 / np.pi * np.sin(2 * np.pi * taken_s / _PERIOD_S)
    rng = np.random.default_rng(3)
    for name in range(3):
        rate = 3600.0 * np.diff(angle, prepend=angle[0]) + _EARTH_UP_DPH + rng.normal(0.0, 3.0, len(angle))
        rows = zip(taken_s, rate, np.floor(angle / code) * code, strict=True)
        lines = [f"{t:.3f},{value:.6f},{at:.9f}" for t, value, at in rows]
        (tmp_path / f"{name}.csv").write_text("\n".join(["t,rate,table", *lines]) + "\n", encoding="utf-8")
        text += _RUN.format(name, 90.0)
    (tmp_path / "map.toml").write_text(text, encoding="utf-8")
    runs = read_mapped_runs(tmp_path / "map.toml")
    noise = Noise(3.0 / 60.0)
    prepared = prepare(runs, Model("nominal", nominal.terms, noise), ())
    (group,) = prepared.groups
    assert group.shared == pytest.approx(1.0, abs=0.05)
    mean, differences = shared_noise(group, noise)
    alone = power_of(noise, _SECONDS, 1.0) / power_in(group, noise)
    # below 5 s most of the noise is the codes'
    assert mean[-1] == pytest.approx(1.0 + 2.0 * group.shared * (1.0 - alone[480:].mean()), rel=0.03)
    assert differences[-1] == pytest.approx(1.0 - group.shared * (1.0 - alone[480:].mean()), abs=0.03)
    found = diagnose(runs, Model("nominal", nominal.terms, noise)).rate
    assert found.verdict == "no gap" and not found.stochastic


def test_codes_of_repeats_that_begin_anywhere_are_not_shared(tmp_path: Path, nominal: Model) -> None:
    runs = _runs(tmp_path, late_s=0.0, code=360.0 / 2**16)
    (group,) = prepare(runs, nominal, ()).groups
    assert group.shared < 0.2


def _headings(number: int, late_s: float, step: float) -> GapRun:
    """A table that goes on by 45 deg eight times, at 20 deg/s; a gyro that is late; angles in codes of a step."""
    at_s = np.arange(721.0)
    knots_s, knots_deg = [0.0], [0.0]
    for place in range(8):
        knots_s += [80.0 * place + 40.3, 80.0 * place + 42.55]
        knots_deg += [45.0 * place, 45.0 * (place + 1)]
    true, then = (np.interp(times, [*knots_s, 720.0], [*knots_deg, 360.0]) for times in (at_s, at_s - late_s))
    rng, still = np.random.default_rng(number), np.full(720, 25.0)
    noise = rounding_noise(true, step, 0.0, np.ones(720))
    s = Stimulus(at_s[1:], still, still, np.floor(true / step) * step, np.full(720, 90.0), 48.0)
    output = 3600.0 * np.diff(then) + _EARTH_UP_DPH + rng.normal(0.0, 0.06, 720)
    phase = np.full(720, "run")
    return GapRun(f"{number}", "G8", "headings", "", s, output, phase, "sum", rounding_noise=noise)


@pytest.mark.parametrize(("codes", "named"), [(0.3, False), (8.0, True)])
def test_what_turns_the_output_by_less_than_a_code_is_no_cause(
    nominal: Model, codes: float, named: bool
) -> None:
    step = 0.005
    runs = [_headings(number, codes * step / 20.0, step) for number in range(3)]
    found = diagnose(runs, Model("nominal", nominal.terms, Noise(0.001))).rate
    assert [cause.name for cause in found.causes] == (["time_offset"] if named else [])
    assert found.verdict == ("explained" if named else "no gap")
    if not named:
        assert found.null_probability > 0.5
        assert any("less than 18 arcsec, the step" in each for each in found.warnings)


@pytest.mark.parametrize(("name", "seen"), [("table_wobble_once", True), ("time_offset", False)])
def test_a_wave_over_the_tables_angle_that_three_motions_show_is_none_of_its_codes(
    name: str, seen: bool
) -> None:
    """A third of a code: of two motions it may be their codes', as a late gyro may be of any number."""
    runs = [replace(_headings(number, 0.0, 0.25), condition=f"{number}") for number in range(3)]
    (variant, *_) = effect(name).variants()
    values = np.zeros(len(variant.effect.parameters))
    values[0] = 1.0
    cause = _cause(variant, values)
    cause = _cause(variant, values * 300.0 / max(_turned(cause, run, at_rest=False) for run in runs))
    assert within_codes([cause], runs) == (() if seen else (cause,))
    assert within_codes([cause], runs[:2]) == (cause,)
    # a table that rests shows nothing of it
    s = runs[2].stimulus
    resting = replace(runs[2], stimulus=replace(s, angle_deg=np.full(len(s) + 1, 10.0)))
    assert within_codes([cause], [*runs[:2], resting]) == (cause,)
    # repeats are one motion
    assert within_codes([cause], [replace(run, condition="") for run in runs]) == (cause,)


def _cause(variant: Variant, values: Array) -> Cause[Term]:
    term = Term(variant, tuple(values.tolist()), tuple(np.ones(len(values)).tolist()))
    return Cause(variant.effect.name, "", 0.9, term, {}, {}, 0.9)


def test_what_a_resting_table_shows_is_named_however_coarse_its_codes_are(nominal: Model) -> None:
    """0.4 deg/h in the cold are 400 arcsec in a run; the table's codes, of 900, are read in other runs."""
    rng = np.random.default_rng(8)
    cold = [
        replace(made_run(name, s, rng, 0.4 * (s.warm_k / 50.0) ** 3), unit_id="G8")
        for name in ("a", "b")
        for s in [replace(stimulus(4000), latitude_deg=48.0)]
    ]
    turning = [_headings(number, 0.0, 0.25) for number in range(2)]
    assert max(run.code_arcsec for run in turning) == pytest.approx(900.0)
    found = diagnose([*cold, *turning], nominal).rate
    assert [cause.name for cause in found.causes] == ["bias_cubic"]


@pytest.mark.parametrize("coded", [True, False])
def test_codes_are_as_large_as_a_run_shows_them(coded: bool) -> None:
    """A swing in codes of 36 arcsec shows them; an exact one that is taken for coded shows its noise alone."""
    step, still = 0.01, np.full(1000, 25.0)
    true = _PEAK_DPS * _PERIOD_S / 2 / np.pi * np.sin(2 * np.pi * np.arange(1001.0) / _PERIOD_S)
    angle = np.floor(true / step) * step if coded else true
    s = Stimulus(np.arange(1.0, 1001.0), still, still, angle, np.full(1000, 90.0), 48.0)
    noise = rounding_noise(angle, step, 0.0, np.ones(1000))
    left = 3600.0 * (np.diff(true) - np.diff(angle)) + np.random.default_rng(2).normal(0.0, 0.1, 1000)
    shown = noise.as_shown(s, left, np.zeros(1000, bool)).sigma_deg.max() / noise.sigma_deg.max()
    assert shown == 1.0 if coded else shown < 0.02


def test_a_log_of_few_angles_has_the_codes_of_the_others() -> None:
    """Commanded headings are on any grid; that of a swing has codes of 16 bits, and they are of one encoder."""
    few, code = _headings(1, 0.0, 0.005), 360.0 / 2**16
    assert few.rounding_noise is not None
    unsure = replace(few, rounding_noise=rounding_noise(few.stimulus.angle_deg, None, 0.0, np.ones(720)))
    sure = replace(
        few, run_id="2", rounding_noise=rounding_noise(few.stimulus.angle_deg, code, 0.0, np.ones(720))
    )
    (alike, same), _ = as_turned([unsure, sure])
    assert same.code_arcsec == pytest.approx(3600.0 * code)
    assert alike.code_arcsec == pytest.approx(3600.0 * code)
    (alone,), _ = as_turned([unsure])
    assert alone.code_arcsec == 0.0


def test_codes_can_do_a_sawtooths_first_sine_in_every_band() -> None:
    """A table with codes of 10 arcsec: a sine of 10 / pi arcsec, at 10 s of 2 deg/h, which is 1.41 rms."""
    angle = np.cumsum(np.full(4001, 1.0)) + np.tile([0.0, 1e-4, 2e-4], 1334)[:4001]
    still = np.full(4000, 25.0)
    s = Stimulus(np.arange(1.0, 4001.0), still, still, angle, np.full(4000, 90.0), 48.0)
    noise = rounding_noise(angle, 10.0 / 3600.0, 0.0, np.ones(4000))
    run = GapRun("1", "G8", "turn", "", s, s.input_rate_dph, np.full(4000, "run"), "", rounding_noise=noise)
    (group,) = group_runs([run])
    amplitude_dph = 2.0 * np.pi / 10.0 * 10.0 / np.pi
    assert codes_dph(group, BANDS.index("10..20 s")) == pytest.approx(amplitude_dph / np.sqrt(2.0), rel=1e-6)
    level = replace(run, stimulus=replace(s, elevation_deg=np.full(4000, 30.0)))
    (group,) = group_runs([level])
    assert codes_dph(group, BANDS.index("10..20 s")) == pytest.approx(amplitude_dph / np.sqrt(8.0), rel=1e-6)
