"""Above the rate of the means: lines, bands and noise of the rows against what was put in."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.signal import butter, freqz, lfilter, welch

from bench.analysis.common.spectrum import freedom_of, power_density
from bench.analysis.gap import Model, Noise, closed_model, diagnose, parse_model, read_recordings
from bench.analysis.gap._fast_data import FastRows
from bench.analysis.gap._fast_floor import FastFloor, density_of, fast_floor
from bench.analysis.gap._fast_lines import FastPool, _joined, _line
from bench.present.report import gap_page
from simulators.effects import Stimulus

RATE_HZ, DURATION_S, ARW = 200.0, 480.0, 0.02
TIME_S = np.arange(int(RATE_HZ * DURATION_S)) / RATE_HZ
SIGMA_DPH = 60.0 * ARW * math.sqrt(RATE_HZ)  # of a row: an angle of ARW sqrt(t) over t


def noise(seed: int) -> np.ndarray:
    return SIGMA_DPH * np.random.default_rng(seed).standard_normal(len(TIME_S))


def model(text: str = "") -> Model:
    return parse_model(f"format = 1\n[noise]\narw_deg_per_sqrt_h = {ARW}\n{text}", "test")


def log(folder: Path, name: str, rate_dph: np.ndarray, phases: str = "") -> Path:
    table = np.column_stack([TIME_S, (rate_dph + 5.0) / 3600.0])
    np.savetxt(folder / f"{name}.csv", table, "%.9g", ",", header="t,rate", comments="")
    file = folder / f"{name}.toml"
    file.write_text(
        'format = 1\nunit_id = "u"\nlatitude_deg = 0\n[columns]\ntime = { name = "t", unit = "s" }\n'
        f'output = {{ name = "rate", unit = "deg/s" }}\n[[run]]\nfile = "{name}.csv"\n{phases}'
    )
    return file


def found(file: Path, nominal: Model | None = None, held_out: Path | None = None):
    given = read_recordings([file], [] if held_out is None else [held_out])
    result = diagnose(given.runs, nominal or model(), given.held_out)
    assert result.fast is not None
    return result


def test_noise_as_the_model_has_it_shows_nothing(tmp_path):
    for seed in range(12):
        fast = found(log(tmp_path, f"n{seed}", noise(seed))).fast
        assert fast.verdict == "no gap" and not fast.lines
        assert fast.floor.arw_deg_per_sqrt_h == pytest.approx(ARW, rel=0.03)
        assert not fast.floor.order and not fast.floor.angle_arcsec


def test_lines_have_the_frequency_and_amplitude_put_in_by_phase(tmp_path):
    rate = noise(1) + 14.0 * np.sin(2 * np.pi * 71.3 * TIME_S + 0.4)
    rate += 12.0 * np.sin(2 * np.pi * 18.25 * TIME_S) * (TIME_S >= 240.0)
    phases = 'phases = [{ name = "rest", start_s = 0 }, { name = "pump", start_s = 240 }]\n'
    result = found(log(tmp_path, "a", rate, phases))
    fast = result.fast
    assert result.rate.verdict == "nothing to identify" and fast.verdict == "explained"
    pump, always = fast.lines
    assert pump.frequency_hz == pytest.approx(18.25, abs=0.03) and not pump.everywhere
    assert pump.amplitudes_dph["a: pump"] == pytest.approx(12.0, rel=0.05)
    assert pump.amplitudes_dph["a: rest"] < 2.0
    assert always.frequency_hz == pytest.approx(71.3, abs=0.03) and always.everywhere
    assert always.amplitude_dph == pytest.approx(14.0, rel=0.05)
    where = {(place.part, place.band) for place in fast.places if place.clear}
    assert where == {("pump", "16..32 Hz"), ("rest", "64..100 Hz"), ("pump", "64..100 Hz")}
    strongest = next(place for place in fast.places if place.part == "pump" and place.band == "16..32 Hz")
    assert strongest.rms == pytest.approx(12.0 / math.sqrt(2.0), rel=0.05)
    assert not any(place.clear for place in fast.left)


def test_the_closed_model_has_the_line_and_shows_no_gap_on_another_day(tmp_path):
    line = [9.0 * np.sin(2 * np.pi * 71.3 * TIME_S + phase) for phase in (0.4, 2.0)]
    first, second = (log(tmp_path, f"d{k}", noise(k) + line[k]) for k in (0, 1))
    result = found(first, held_out=second)
    (held,) = result.fast.held_out
    assert held.share > 0.9 and held.rms_before == pytest.approx(9.0 / math.sqrt(2.0), rel=0.08)
    closed = closed_model(result)
    (term,) = closed.disturbances
    amplitude, frequency = term.values
    # a row is the mean over its step of what the unit does: what that takes away is made good
    assert amplitude == pytest.approx(9.0 / np.sinc(71.3 / RATE_HZ), rel=0.08)
    assert frequency == pytest.approx(71.3, abs=0.03)
    again = found(second, closed.__class__(**{**vars(closed), "fitted_on": {}}))
    assert again.fast.verdict == "no gap" and not again.fast.lines


def test_a_line_of_the_model_with_another_amplitude_is_a_gap(tmp_path):
    rate = noise(3) + 9.0 * np.sin(2 * np.pi * 71.3 * TIME_S)
    text = (
        '[[effect]]\nname = "vibration_or_mains_line"\n'
        "parameters = {{ amplitude_dph = {}, frequency_hz = 71.3 }}\n"
        "sigma = {{ amplitude_dph = 0.1, frequency_hz = 0.01 }}\n"
    )
    file = log(tmp_path, "a", rate)
    seen = np.sinc(71.3 / RATE_HZ)
    assert found(file, model(text.format(9.0 / seen))).fast.verdict == "no gap"
    assert [line.frequency_hz for line in found(file, model(text.format(3.0))).fast.lines] == [
        pytest.approx(71.3, abs=0.03)
    ]


def test_a_band_without_a_name_stays_unknown(tmp_path):
    shaped = lfilter(*butter(2, [0.4, 0.46], "band"), np.random.default_rng(5).standard_normal(len(TIME_S)))
    fast = found(log(tmp_path, "a", noise(5) + 60.0 * shaped)).fast
    assert fast.verdict == "unknown" and not fast.closing
    (band,) = fast.lines
    assert band.broad and 38.0 < band.frequency_hz < 48.0 and 2.0 < band.width_hz < 10.0
    left = [place for place in fast.left if place.clear]
    assert [place.band for place in left] == ["32..64 Hz"]
    assert left[0].rms == pytest.approx(float((60.0 * shaped).std()), rel=0.1)


@pytest.mark.parametrize(("order", "corner_hz"), [(2, 20.0), (4, 45.0)])
def test_a_low_pass_is_the_noise_s_form_and_no_gap(tmp_path, order, corner_hz):
    rate = lfilter(*butter(order, corner_hz / (0.5 * RATE_HZ)), noise(7))
    fast = found(log(tmp_path, "a", rate)).fast
    assert fast.verdict == "no gap"
    assert fast.floor.arw_deg_per_sqrt_h == pytest.approx(ARW, rel=0.05)
    assert fast.floor.corner_hz == pytest.approx(corner_hz, rel=0.05)
    assert fast.floor.order == pytest.approx(order, rel=0.1)
    assert (
        f"falls beyond {corner_hz:.3g} Hz" in fast.floor.sentence or "it falls beyond" in fast.floor.sentence
    )


def test_noise_of_the_angle_between_rows_is_told_from_white_noise_of_the_rate(tmp_path):
    angle_arcsec = 0.05 * np.random.default_rng(88).standard_normal(len(TIME_S) + 1)
    fast = found(log(tmp_path, "a", noise(8) + np.diff(angle_arcsec) * RATE_HZ)).fast  # 1 arcsec/s is 1 deg/h
    assert fast.floor.angle_arcsec == pytest.approx(0.05, rel=0.05)
    assert fast.floor.arw_deg_per_sqrt_h == pytest.approx(ARW, rel=0.1)


@settings(max_examples=25)
@given(damping=st.floats(0.3, 0.9), corner_hz=st.floats(3.0, 30.0), seed=st.integers(0, 99))
def test_an_output_stage_of_second_order_is_the_noise_s_form(damping, corner_hz, seed):
    natural = 2.0 * math.pi * corner_hz / RATE_HZ
    radius, turn = math.exp(-damping * natural), natural * math.sqrt(1.0 - damping**2)
    recursion = [1.0, -2.0 * radius * math.cos(turn), radius**2]
    rows = lfilter([sum(recursion)], recursion, noise(seed))
    segments = np.stack([rows[k : k + 4096] for k in range(0, len(rows) - 4096, 2048)])
    frequency, density = power_density(segments, RATE_HZ)
    inside = slice(int(np.searchsorted(frequency, 0.5)), -1)
    floor = fast_floor(
        frequency[inside], density.mean(axis=0)[inside], freedom_of(len(segments)), 1.0 / RATE_HZ, ARW
    )
    # where it is overdamped or high a low pass may describe it as well: the density is what counts
    expected = np.abs(np.array(freqz([sum(recursion)], recursion, frequency[inside], fs=RATE_HZ)[1])) ** 2
    expected *= 7200.0 * ARW**2
    ratio = floor.density(frequency[inside], 1.0 / RATE_HZ) / expected
    weighty = expected > 1e-2 * expected.max()
    assert np.abs(np.log(ratio[weighty])).max() < 0.25
    if damping < 0.5 and corner_hz < 20.0:
        assert floor.damping == pytest.approx(damping, abs=0.06)
        assert floor.corner_hz == pytest.approx(corner_hz, rel=0.06)
        assert floor.arw_deg_per_sqrt_h == pytest.approx(ARW, rel=0.06)


def test_a_knock_is_left_out_and_said(tmp_path):
    rate = noise(9)
    rate[20_000:20_050] += 2000.0
    fast = found(log(tmp_path, "a", rate)).fast
    assert fast.verdict == "no gap" and "many times as strong" in fast.notes[0]


@given(
    arw=st.floats(1e-4, 10.0),
    angle=st.floats(0.0, 10.0),
    row_s=st.floats(5e-4, 0.4),
    share=st.floats(0.01, 1.0),
)
def test_the_floor_s_density_is_the_closed_form(arw, angle, row_s, share):
    at = np.array([share * 0.5 / row_s])
    floor = FastFloor(arw, 1.0, angle_arcsec=angle)
    # IEEE Std 952: N^2 of the rate, one-sided and per Hz; white noise of the angle differenced over a row
    expected = (
        2.0 * 3600.0 * arw**2 + 2.0 * row_s * (2.0 * angle * math.sin(math.pi * at[0] * row_s) / row_s) ** 2
    )
    assert floor.density(at, row_s)[0] == pytest.approx(expected, rel=1e-9)


def test_the_density_of_white_rows_is_scipy_s(tmp_path):
    rows = noise(11)
    frequency, density = welch(rows, RATE_HZ, nperseg=4096)
    mean = density[(frequency > 1.0) & (frequency < 99.0)].mean()
    assert density_of(Noise(ARW), np.array([30.0]), 1.0 / RATE_HZ)[0] == pytest.approx(mean, rel=0.02)
    stimulus = Stimulus(
        np.arange(1.0, DURATION_S + 1.0), *(np.full(int(DURATION_S), 25.0) for _ in range(2)),
        np.zeros(int(DURATION_S) + 1), np.zeros(int(DURATION_S)), 0.0,
    )  # fmt: skip
    phase = np.full(int(DURATION_S), "run")
    owner = np.floor(TIME_S).astype(np.int64)
    (own,) = FastRows(rows / 3600.0, 1.0 / RATE_HZ, owner, stimulus, phase).spectra
    inside = (own.frequency_hz > 1.0) & (own.frequency_hz < 99.0)
    assert own.density[inside].mean() == pytest.approx(mean, rel=0.02)
    fitted = fast_floor(own.frequency_hz, own.density, 2.0 * own.averages, own.row_s, ARW)
    assert fitted.arw_deg_per_sqrt_h == pytest.approx(ARW, rel=0.03)


def test_stretches_in_which_the_table_changes_its_rate_tell_nothing():
    count = int(DURATION_S)
    rate = np.where(np.arange(count) < 240, 0.0, 20.0)
    rate[240:300] = np.linspace(0.0, 20.0, 60)
    angle = np.concatenate(([0.0], np.cumsum(rate)))
    still = np.full(count, 25.0)
    stimulus = Stimulus(np.arange(1.0, count + 1.0), still, still, angle, np.full(count, 90.0), 0.0)
    phase = np.where(np.arange(count) < 240, "rest", np.where(np.arange(count) < 300, "ramp", "spin"))
    owner = np.floor(TIME_S).astype(np.int64)
    spectra = FastRows(noise(2) / 3600.0, 1.0 / RATE_HZ, owner, stimulus, phase).spectra
    assert [own.phase for own in spectra] == ["rest", "spin"]
    assert spectra[1].turns_hz == pytest.approx(20.0 / 360.0) and spectra[1].start_s == 300.0
    slow = FastRows(noise(2)[:: int(RATE_HZ)], 1.0, np.arange(count), stimulus, phase)
    assert slow.spectra == () and not slow.alias_dph.any()


@pytest.mark.parametrize("at_hz", [71.3, 72.0 - 1 / 300.0])
def test_means_have_no_alias_of_a_line_and_keep_the_rest(at_hz):
    count, owner = int(DURATION_S), np.floor(TIME_S).astype(np.int64)
    still = np.full(count, 25.0)
    stimulus = Stimulus(np.arange(1.0, count + 1.0), still, still, np.zeros(count + 1), np.zeros(count), 0.0)
    phase = np.where(np.arange(count) < 200, "rest", "soak")
    slow = 3.0 * np.sin(2 * np.pi * TIME_S / 40.0)
    line = 200.0 * np.sin(2 * np.pi * at_hz * TIME_S + 1e-6 * TIME_S**2)
    without, rows = noise(4) + slow, noise(4) + slow + line
    rows[500:520] = np.nan
    alias = FastRows(rows / 3600.0, 1.0 / RATE_HZ, owner, stimulus, phase).alias_dph
    known = ~np.isnan(rows)
    means, expected = (
        np.bincount(owner[known], values[known], count) / np.bincount(owner[known], minlength=count)
        for values in (np.nan_to_num(rows), without)
    )
    assert np.abs(means - expected).max() > 0.3
    assert np.abs(means - alias - expected).max() < 0.05


def pool(phase: str, peak: float, *, freedom: float = 40.0, turns_hz: float = 0.0) -> FastPool:
    """A flat density of 1 with one bin of a line at 10 Hz; bins are 0.05 Hz wide."""
    frequency = 0.05 * np.arange(1, 2001)
    density = np.ones(2000)
    density[199] += peak
    return FastPool("p", phase, 0.0, 0.005, frequency, density, freedom, turns_hz, 1)


def test_a_weak_line_is_everywhere_if_noise_may_hide_it_in_a_phase():
    strong, weak = pool("a", 40.0), pool("b", 9.2)  # less than a quarter of the power, but for noise
    power, sigma = weak.power(10.0, 0.0)
    assert power == pytest.approx((9.2 + 7 * (1.0 - weak.level[0])) * 0.05, rel=1e-6)
    assert sigma == pytest.approx(0.05 * weak.level[0] * math.sqrt(2.0 * 7 / (2 / 3) / 40.0), rel=1e-6)
    assert _line([strong, weak], 10.0, 0.0).everywhere
    sure = [pool(name, peak, freedom=4000.0) for name, peak in (("a", 40.0), ("b", 9.2))]
    assert not _line(sure, 10.0, 0.0).everywhere


@pytest.mark.parametrize(("turns_hz", "order"), [(2.5, 4), (2.48, 0), (0.1, 0), (0.0, 0)])
def test_a_multiple_of_the_table_s_turn_is_told_where_bins_tell_them_apart(turns_hz, order):
    (line,) = [_line([pool("a", 40.0, turns_hz=turns_hz)], 10.0, 0.0)]
    assert line.turning is (turns_hz > 0.0)
    assert not _line([pool("a", 40.0, turns_hz=turns_hz), pool("b", 39.0)], 10.0, 0.0).turning
    assert line.order == order and (f"{order} times a turn" in line.sentence) is bool(order)


def test_how_far_a_line_holds_differs_from_phase_to_phase_of_a_held_out_run(tmp_path):
    phases = 'phases = [{ name = "rest", start_s = 0 }, { name = "soak", start_s = 240 }]\n'
    line = np.sin(2 * np.pi * 71.3 * TIME_S)
    first = log(tmp_path, "d0", noise(21) + 20.0 * line, phases)
    second = log(tmp_path, "d1", noise(22) + np.where(TIME_S < 240.0, 20.0, 26.0) * line, phases)
    (held,) = found(first, held_out=second).fast.held_out
    # powers 200 and 338 of which 200 each are foretold
    parts = (1.0, 200.0 / 338.0)
    assert held.share == pytest.approx(400.0 / 538.0, abs=0.05)
    spread = 1.96 * abs(parts[0] - parts[1]) / 2.0
    assert held.low == pytest.approx(held.share - spread, abs=0.1) and held.high <= 1.0


def test_few_segments_have_their_median_below_their_mean():
    frequency = np.arange(1, 4001) * 0.02
    drawn = np.random.default_rng(5).chisquare(2.0, 4000) / 2.0 * 7200.0 * ARW**2
    floor = fast_floor(frequency, drawn, 2.0, 0.005, ARW)
    assert floor.arw_deg_per_sqrt_h == pytest.approx(ARW, rel=0.03)


def test_a_slow_line_beside_one_that_the_model_has_is_named(tmp_path):
    rate = noise(31) + 6.0 * np.sin(2 * np.pi * 0.37 * TIME_S)
    text = (
        '[[effect]]\nname = "vibration_or_mains_line"\n'
        "parameters = { amplitude_dph = 6.0, frequency_hz = 0.11 }\n"
        "sigma = { amplitude_dph = 0.1, frequency_hz = 0.01 }\n"
    )
    long = np.tile(rate, 2)
    time_s = np.arange(len(long)) / RATE_HZ
    table = np.column_stack([time_s, long / 3600.0])
    np.savetxt(tmp_path / "s.csv", table, "%.9g", ",", header="t,rate", comments="")
    file = tmp_path / "s.toml"
    file.write_text(
        'format = 1\nunit_id = "u"\nlatitude_deg = 0\n[columns]\ntime = { name = "t", unit = "s" }\n'
        'output = { name = "rate", unit = "deg/s" }\n[[run]]\nfile = "s.csv"\n'
    )
    given = read_recordings([file])
    assert "vibration_or_mains_line" in diagnose(given.runs, model(text)).rate.stochastic
    assert not diagnose(given.runs, model(text.replace("= 0.11", "= 0.37"))).rate.stochastic


def test_rows_of_several_rates_each_show_what_they_can(tmp_path):
    """A line at 71.3 Hz in rows at 200 Hz, and rows at 50 Hz of another run beside them."""
    line = 14.0 * np.sin(2 * np.pi * 71.3 * TIME_S)
    fine = log(tmp_path, "fine", noise(41) + line, 'profile = "day"\n')
    coarse = log(tmp_path, "coarse", noise(42), 'profile = "day"\n')
    rows = np.loadtxt(tmp_path / "coarse.csv", delimiter=",", skiprows=1)
    rate_dps = rows[:, 1].reshape(-1, 4).mean(axis=1)
    table = np.column_stack([np.arange(len(rate_dps)) * 0.02, rate_dps])
    np.savetxt(tmp_path / "coarse.csv", table, "%.9g", ",", header="t,rate", comments="")
    for order in ([fine, coarse], [coarse, fine]):
        fast = diagnose(read_recordings(order).runs, model()).fast
        (found_line,) = fast.lines
        assert found_line.frequency_hz == pytest.approx(71.3, abs=0.03) and found_line.everywhere
        assert dict(found_line.amplitudes_dph) == {"day: run, rows at 200 Hz": pytest.approx(14.0, rel=0.05)}
        assert {place.part for place in fast.places} == {"run, rows at 200 Hz", "run, rows at 50 Hz"}
    apart = read_recordings([fine], [coarse])
    assert not diagnose(apart.runs, model(), apart.held_out).fast.held_out  # its rows cannot show the line


def test_the_report_says_what_is_above_half_a_hertz(tmp_path):
    result = found(log(tmp_path, "a", noise(1) + 14.0 * np.sin(2 * np.pi * 71.3 * TIME_S)))
    page = gap_page(result, [], created_utc="2026-01-01T00:00:00+00:00", model_file="nominal.toml")
    assert page.verdict.tone == "doubt"
    assert any("a line at 71.3" in sentence for sentence in page.verdict.sentences)
    quiet = gap_page(
        found(log(tmp_path, "b", noise(2))),
        [],
        created_utc="2026-01-01T00:00:00+00:00",
        model_file="nominal.toml",
    )
    assert not any("0.5 Hz" in sentence for sentence in quiet.verdict.sentences)


@pytest.mark.parametrize("off_bins", [0.0, 0.4, -0.3])
def test_a_line_s_wave_is_followed_also_where_its_frequency_is_known_by_a_part_of_a_bin(off_bins):
    count = int(DURATION_S)
    still = np.full(count, 25.0)
    stimulus = Stimulus(np.arange(1.0, count + 1.0), still, still, np.zeros(count + 1), np.zeros(count), 0.0)
    wave = 0.01 * np.sin(2 * np.pi * 71.3 * TIME_S + 0.7)
    owner = np.floor(TIME_S).astype(np.int64)
    rows = FastRows(wave + 5.0, 1.0 / RATE_HZ, owner, stimulus, np.full(count, "run"))
    bin_hz = RATE_HZ / rows._size
    followed = rows._wave(71.3 + off_bins * bin_hz, rows._segments["run"].tolist())
    inside = slice(rows._size, -rows._size)
    np.testing.assert_allclose(followed[inside], wave[inside], atol=1e-5)


def test_bands_of_several_phases_that_touch_are_one():
    assert _joined([(5.0, 6.0), (1.5, 3.0), (1.0, 2.0), (2.9, 2.95), (6.0, 7.0)]) == [(1.0, 3.0), (5.0, 7.0)]


def test_a_line_is_the_model_s_only_at_its_frequency_and_as_large_in_every_phase(tmp_path):
    text = (
        '[[effect]]\nname = "vibration_or_mains_line"\n'
        "parameters = {{ amplitude_dph = {}, frequency_hz = {} }}\n"
        "sigma = {{ amplitude_dph = 0.1, frequency_hz = 0.01 }}\n"
    )
    phases = 'phases = [{ name = "rest", start_s = 0 }, { name = "pump", start_s = 240 }]\n'
    line = np.sin(2 * np.pi * 71.3 * TIME_S)
    whole = 9.0 / np.sinc(71.3 / RATE_HZ)
    even = log(tmp_path, "even", noise(51) + 9.0 * line, phases)
    assert not found(even, model(text.format(whole, 71.3))).fast.lines
    assert len(found(even, model(text.format(9.0 / np.sinc(0.15), 30.0))).fast.lines) == 1
    louder = log(tmp_path, "louder", noise(52) + np.where(TIME_S < 240.0, 9.0, 15.0) * line, phases)
    assert len(found(louder, model(text.format(whole, 71.3))).fast.lines) == 1
