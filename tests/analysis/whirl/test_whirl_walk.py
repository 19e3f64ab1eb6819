"""Procedure, run folder, fit command and report on an emulated bench of its own process."""

import json
import re
from pathlib import Path

import numpy as np
import pytest

from bench.analysis.whirl import WhirlCompensation, load_turns, study_whirl
from bench.analysis.whirl._study import judge
from bench.control.procedure import Parameters
from bench.control.questions import EmulatedOperator
from bench.control.runner import RunRequest, run_procedure
from bench.lab.emulated import EmulatedLab, Plant, load_plant, unit_seed
from bench.present.cli.fit._motion import REPORT_FILE, WHIRL_FILE, whirl
from bench.record.benchfile import bench_file_from
from bench.record.recording import Run
from drivers.base.errors import ConfigurationError
from procedures.constant_rotation import PROCEDURE, ConstantRotationParameters
from simulators.plant.wobble import nominal_wobble

BENCH = {
    "bench": {"name": "ins bench", "latitude_deg": 40.0},
    "table": {"driver": "acutrol3000", "port": "/dev/table"},
    "chamber": {"driver": "weiss", "port": "/dev/chamber"},
    "gyro": [
        {
            "name": "ins",
            "driver": "kvh1750",
            "unit": "INS-001",
            "axis": "z",
            "axes": "xyz",
            "port": "/dev/gyro",
            "rate_hz": 100.0,
        }
    ],
}


def rehearse(folder: Path, seed: int, plant: Plant | None = None, **values: object) -> Path:
    file = bench_file_from(BENCH)
    with EmulatedLab(file, plant or Plant(seed=seed, models={"INS-001": "ins_triad"})) as lab:
        request = RunRequest(
            PROCEDURE,
            PROCEDURE.parse(values),
            lab.file,
            folder,
            EmulatedOperator(lab.perform),
            None,
            emulated={"seed": seed, "model": "ins_triad"},
        )
        result = run_procedure(request)
    assert result.outcome == "completed"
    return result.folder


@pytest.fixture(scope="module")
def runs(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    folder = tmp_path_factory.mktemp("runs")
    first, second = (rehearse(folder, seed, turns=20.0, reversals=3) for seed in (1, 2))
    return first, second


def test_phases_turns_and_angle(runs: tuple[Path, Path]) -> None:
    run = Run.open(runs[0])
    names = [phase.name for phase in run.phases() if phase.name != "settle"]
    assert names == ["rest", "turn_forward", "turn_reverse", "turn_forward", "turn_reverse", "rest"]
    turns = load_turns(run)
    assert turns.record.turns == pytest.approx(20.0, abs=0.5)
    assert turns.findings == ()
    assert abs(turns.alignment.clock_error_ppm or 99.0) < 2.0
    assert turns.alignment.latency_s == pytest.approx(0.002, abs=0.01)
    assert np.ptp(turns.record.angle_rad) == pytest.approx(2.0 * np.pi * 5.0, rel=0.03)


def test_lines_of_the_unit_are_found_and_another_run_is_corrected(runs: tuple[Path, Path]) -> None:
    fitted, held_out = (load_turns(Run.open(folder)) for folder in runs)
    study = study_whirl([fitted], [held_out], gauge="mean")
    truth = nominal_wobble(unit_seed("INS-001")).lines_arcsec
    for line in study.fit.lines:
        estimate = study.fit.amplitude(line)
        assert abs(estimate.value - truth.get(line, 0j)) < 5.0 * estimate.sd
    (judgement,) = study.judgements
    assert judgement.before.locked_arcsec > 8.0
    assert judgement.locked_factor >= 100.0
    assert not study.judged_on_fitted
    assert study.fit.drift_dph  # separated by the reversals
    # The mechanism stands still before and after: what is left then is the walk of the gyros, no whirl.
    assert len(judgement.rests_arcsec) == 2
    assert max(judgement.rests_arcsec) < 0.1 * judgement.before.locked_arcsec
    own = judge(fitted.record, study.compensation, study.fit)
    assert own.locked_factor >= 100.0


def test_the_bearing_and_the_ripple_are_the_plant_file_s(tmp_path: Path) -> None:
    """Line 2 and play as in the file, under a rate that ripples by 5 %."""
    (tmp_path / "plant.toml").write_text(
        """
        seed = 4
        models = { INS-001 = "ins_triad" }
        [rotation]
        ripple_once_ppm = 50000
        [bearing.INS-001]
        lines_arcsec = [[2.0, -9.0, 8.0]]
        play_arcsec = [5.0, 0.0]
        """,
        encoding="utf-8",
    )
    plant = load_plant(tmp_path / "plant.toml")
    folder = rehearse(tmp_path, 4, plant, turns=16.0, reversals=3, rate_tolerance_percent=6.0)
    turns = load_turns(Run.open(folder))
    study = study_whirl([turns], [], gauge="mean")
    for line in study.fit.lines:
        estimate = study.fit.amplitude(line)
        truth = -9.0 + 8.0j if line == 2.0 else 0j
        assert abs(estimate.value - truth) < 5.0 * estimate.sd
    assert study.fit.play_arcsec is not None
    assert abs(study.fit.play_arcsec.value - 5.0) < 5.0 * study.fit.play_arcsec.sd
    forward = next(phase for phase in Run.open(folder).phases() if phase.name == "turn_forward")
    rate = Run.open(folder).turntable(("rate_dps",), forward.start_s, forward.end_s)["rate_dps"]
    assert np.ptp(rate) / np.mean(rate) == pytest.approx(0.1, rel=0.05)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (
            "[bearing.INS-001]",
            "bearing.INS-001.lines_arcsec cannot be used. Found: nothing. Expected: a value",
        ),
        ("[bearing.INS-001]\nlines_arcsec = [[2, 1]]", "lines_arcsec.0.2 cannot be used. Found: nothing"),
        (
            "[rotation]\nripple_once_ppm = -1",
            "ripple_once_ppm cannot be used. Found: -1. Expected: greater than",
        ),
    ],
)
def test_a_bearing_that_is_none_is_refused(text: str, said: str, tmp_path: Path) -> None:
    (tmp_path / "plant.toml").write_text(text, encoding="utf-8")
    with pytest.raises(ConfigurationError, match=re.escape(said)):
        load_plant(tmp_path / "plant.toml")


def test_command_writes_compensation_and_report(
    runs: tuple[Path, Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    whirl([runs[0]], [runs[1]], out=tmp_path)
    said = re.sub(r"\s+", " ", capsys.readouterr().out)
    assert "free: the constant tilt a_0 of the spin axis in body axes" in said
    assert "gauge mean: mean spin axis" in said
    compensation = WhirlCompensation.load(tmp_path / WHIRL_FILE)
    assert compensation.unit_id == "INS-001"
    assert list(compensation.runs) == [runs[0].name]
    page = (tmp_path / REPORT_FILE).read_text(encoding="utf-8")
    for section in (
        "Attitude before and after",
        "Integrated residual and its fit",
        "Orbit",
        "Spectrum of the remainder",
        "What is free, and what could not be told",
    ):
        assert section in page
    assert page.count("<svg") == 4
    assert "http" not in page.replace("http-equiv", "")
    assert "Whirl removed" in page
    assert json.loads((runs[0] / "manifest.json").read_text())["procedure"] == "constant-rotation"
    with pytest.raises(ConfigurationError, match="no such gauge"):
        whirl([runs[0]], out=tmp_path, gauge="external")


def test_a_gyro_without_three_axes_is_refused(runs: tuple[Path, Path]) -> None:
    with pytest.raises(ConfigurationError, match="axes x, y and z"):
        load_turns(Run.open(runs[0]), "other")


@pytest.mark.parametrize(
    ("values", "complaint"),
    [
        ({"rate_dps": "0"}, "0.1 deg/s"),
        ({"turns": "0.5"}, "turns"),
        ({"rate": "6"}, "did you mean 'rate_dps'"),
    ],
)
def test_parameters_that_make_no_sense(values: dict[str, str], complaint: str) -> None:
    with pytest.raises(ConfigurationError, match=complaint):
        PROCEDURE.parse(values)


def test_expected_duration_and_demands() -> None:
    parameters: Parameters = ConstantRotationParameters(rate_dps=-10.0, turns=36.0, reversals=1)
    assert PROCEDURE.demands(parameters).max_rate_dps == 10.0
    assert PROCEDURE.expected_duration_s(parameters) == pytest.approx(36 * 36.0 + 120.0, rel=0.1)
