"""Some cases of the blind exam; the long form is `gyrobench gap exam`."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path

import numpy as np
import pytest

from bench.analysis.gap import Marked, model_text
from bench.analysis.gap._case_folder import write_case
from bench.analysis.gap._exam import close, examined, make_case, nominal_model
from bench.analysis.gap._import import read_mapped_runs
from bench.analysis.gap._signature import signature_norm
from bench.present.cli.gap._exam import exam
from drivers.base.errors import ConfigurationError
from simulators.exam import KNOWN, draw_case, simulate_campaign

NOMINAL = model_text(nominal_model())


def _mark(seed: int, kind: str) -> Marked:
    sealed, given, kept, clean = make_case(seed, kind)
    answer = examined(given, NOMINAL)
    return Marked.of(sealed, answer, close(answer, kept, clean), 0.0)


def _seeds(kind: str, low: float, count: int) -> list[int]:
    """First seeds of a kind whose signal-to-noise ratio is at least `low`, by the drawing alone."""
    return [seed for seed in range(5000, 6000) if draw_case(seed, kind).snr >= low][:count]


def test_null_cases_raise_no_alarm() -> None:
    marked = [_mark(seed, "null") for seed in range(5100, 5102)]
    assert not any(each.named or each.called_unknown or each.stochastic_named for each in marked)


def test_strong_single_effects_are_named_and_close_the_gap() -> None:
    marked = [_mark(seed, "single") for seed in _seeds("single", 3.0, 3)]
    assert sum(each.first for each in marked) >= 2
    assert all(each.in_set for each in marked)
    closed = [each.true_share for each in marked if np.isfinite(each.stated_share[0])]
    assert np.median(closed) > 0.95


def test_effects_outside_the_catalogue_are_called_unknown() -> None:
    marked = [_mark(seed, "unknown") for seed in _seeds("unknown", 10.0, 2)]
    assert all(each.called_unknown for each in marked)


def test_stochastic_effects_are_named() -> None:
    marked = [_mark(seed, "stochastic") for seed in range(5201, 5203)]
    assert all(each.stochastic_named == (each.stochastic,) for each in marked)


def test_a_seal_changes_with_its_answer() -> None:
    first, *_ = make_case(5300, "single")
    again, *_ = make_case(5300, "single")
    other, *_ = make_case(5301, "single")
    assert first.sha256 == again.sha256 != other.sha256


def test_amplitudes_give_the_signal_to_noise_ratio_asked_for() -> None:
    seed = next(seed for seed in range(5400, 5500) if "shupe" in draw_case(seed, "single").effects)
    sealed, given, _, _ = make_case(seed, "single")
    truths = [run for run in simulate_campaign(seed, 3) if run.repeat < 2]
    amplitude = sealed.amplitudes["shupe"]
    runs = [
        type(run)(
            run.run_id, "u", run.profile, run.condition, run.stimulus, amplitude * truth.shupe_dph, run.phase
        )
        for run, truth in zip(given, truths, strict=True)
    ]
    assert signature_norm(runs, nominal_model()) == pytest.approx(10.0 * sealed.case.snr, rel=1e-3)


def test_the_exams_shupe_effect_vanishes_for_uniform_warming() -> None:
    """Mohr's integral weighs layers and pigtail to zero: what is left follows differences of rates."""
    run = next(run for run in simulate_campaign(1, 1) if run.profile == "quiet")
    late = run.shupe_dph[-1000:]
    assert np.abs(late).max() < 0.02
    assert "shupe" in KNOWN


def test_the_exam_by_command_seals_first_and_prints_the_table(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The short form of the exam: a plant process, folders on disk, seals whose hashes are those announced."""
    exam(77, 2, tmp_path / "exam", 1)
    printed = capsys.readouterr().out
    results = [json.loads(line) for line in (tmp_path / "exam" / "results.jsonl").read_text().splitlines()]
    assert len(results) == 2
    for number, result in enumerate(results):
        sealed = (tmp_path / "exam" / "sealed" / f"case_{number:04d}.json").read_bytes()
        assert hashlib.sha256(sealed).hexdigest() == result["sha256"]
        announced = printed.index(f"{number:4d} {result['sha256'][:16]} sealed")
        assert announced < printed.index(f"{number:4d} {result['sha256'][:16]} SNR")
        given = {path.name for path in (tmp_path / "exam" / "cases" / f"case_{number:04d}").iterdir()}
        assert given == {"runs.toml", *(f"run_{k:02d}.parquet" for k in range(1, 17))}
    assert "Reliability" in printed
    with pytest.raises(ConfigurationError, match="holds an exam already"):
        exam(77, 2, tmp_path / "exam", 1)
    # the same table from the folder; a part of it if the exam was cut short
    exam(held=tmp_path / "exam")
    assert capsys.readouterr().out == printed[printed.index("`gyrobench gap exam") :]
    lines = (tmp_path / "exam" / "results.jsonl").read_text().splitlines()
    (tmp_path / "exam" / "results.jsonl").write_text(lines[0] + "\n")
    exam(held=tmp_path / "exam", table=tmp_path / "table.md", note="commit abc")
    text = (tmp_path / "table.md").read_text()
    assert "--cases 2 --seed 77`, commit abc." in text
    assert "Partial: 1 of 2 cases" in text
    with pytest.raises(ConfigurationError, match="no exam's results"):
        exam(held=tmp_path)


def test_a_case_read_back_from_its_folder_is_what_was_written(tmp_path: Path) -> None:
    _, given, _, _ = make_case(5301, "single")
    read = read_mapped_runs(write_case(tmp_path, given))
    for run, again in zip(given, read, strict=True):
        assert (again.run_id, again.profile, again.condition) == (run.run_id, run.profile, run.condition)
        np.testing.assert_allclose(again.stimulus.time_s, run.stimulus.time_s, rtol=1e-6)
        # beside a change of attitude rows are left out
        jumps = np.flatnonzero(np.diff(run.stimulus.elevation_deg))
        apart = np.full(len(run.stimulus), True)
        for jump in jumps.tolist():
            apart[jump - 1 : jump + 4] = False
        raised, was = again.stimulus.elevation_deg, run.stimulus.elevation_deg
        np.testing.assert_allclose(again.output_dph[apart], run.output_dph[apart], rtol=1e-6, atol=1e-12)
        np.testing.assert_allclose(raised[apart], was[apart], rtol=1e-6, atol=1e-12)
        assert np.isnan(again.output_dph[~apart]).all()
        turned = np.diff(again.stimulus.angle_deg)
        np.testing.assert_allclose(turned, np.diff(run.stimulus.angle_deg), rtol=1e-6, atol=1e-6)
        assert list(again.phase) == list(run.phase)
