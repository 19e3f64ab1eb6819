"""A base that sways by a tenth of a degree, from exact rotations; its reference late, crooked and noisy."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from bench.analysis.whirl._angle import align_angle
from bench.analysis.whirl._base import BaseMotion, without_base
from bench.analysis.whirl._direct import fit_direct
from bench.analysis.whirl._runs import _on_grid, _recorded_base, load_turns
from bench.analysis.whirl._types import TurnRecord, UnfitRotation
from bench.control.procedure import find_procedure
from bench.control.questions import AssumeYes
from bench.control.runner import RunRequest, run_procedure
from bench.lab.emulated import EmulatedLab, load_plant
from bench.present.cli.fit._motion import whirl
from bench.record.benchfile import load_bench_file
from bench.record.recording import Run, seconds
from drivers.base.errors import ConfigurationError, RecordError

EXAMPLES = Path(__file__).parents[3] / "examples"
LINES = {-1: 5 - 3j, 2: -9 + 8j, 3: 2 + 1j}
ARCSEC = np.pi / 648000.0
STEP_S, DELAY_S = 0.02, 0.03


@dataclass(frozen=True, eq=False)
class Made:
    edges_s: np.ndarray
    rate_dps: np.ndarray
    poll_s: np.ndarray
    poll_deg: np.ndarray
    base: BaseMotion

    def lines(self, rate_dps: np.ndarray, angle_rad: np.ndarray) -> dict[int, float]:
        """How far each fitted line is from what was made, arcsec."""
        usable = np.ones(len(rate_dps), np.bool_)
        fit = fit_direct(
            [TurnRecord("r", "u", STEP_S, self.edges_s, rate_dps, angle_rad, usable, 45.0)], play=False
        )
        return {line: abs(fit.amplitude(line).value - made) for line, made in LINES.items()}


@pytest.fixture(scope="module")
def made() -> Made:
    """Twenty minutes at 6 deg/s in both senses; gyros and reference with 0.002 deg/sqrt(h)."""
    rng = np.random.default_rng(4)
    count = round(1200.0 / STEP_S)
    time_s = STEP_S * np.arange(count + 1)
    rate = np.radians(6.0) * np.where((time_s // 300.0) % 2 == 0, 1.0, -1.0)
    rate[(time_s < 20.0) | (time_s > time_s[-1] - 20.0)] = 0.0
    rate = np.convolve(rate, np.ones(100) / 100.0, "same")
    psi = np.concatenate([[0.0], np.cumsum(0.5 * (rate[1:] + rate[:-1]) * STEP_S)])
    tilt = sum(value * np.exp(1j * line * psi) for line, value in LINES.items()) * ARCSEC
    frequency = 0.05 * (1.0 + 0.15 * rng.standard_normal((3, 12)))
    phase = rng.uniform(0.0, 2.0 * np.pi, (3, 12))

    def attitude(at_s: np.ndarray) -> Rotation:
        turned = 2.0 * np.pi * at_s[:, None, None] * frequency + phase
        return Rotation.from_rotvec(np.radians(0.1) * np.sqrt(2.0 / 12.0) * np.cos(turned).sum(axis=2))

    earth = Rotation.from_rotvec(np.outer(time_s, 7.292115e-5 * np.sqrt(0.5) * np.array([0.0, 1.0, 1.0])))
    whirled = Rotation.from_rotvec(np.stack([tilt.real, tilt.imag, 0.0 * psi], axis=1))
    whole = earth * attitude(time_s) * whirled * Rotation.from_euler("z", psi[:, None])
    gyro = np.degrees((whole[:-1].inv() * whole[1:]).as_rotvec()) / STEP_S
    gyro += 0.002 / 60.0 / np.sqrt(STEP_S) * rng.standard_normal(gyro.shape)
    seen_s = np.arange(-1.0, time_s[-1] + 1.0, 0.05)
    there_s = seen_s - DELAY_S
    reference = np.degrees((attitude(there_s - 1e-3).inv() * attitude(there_s + 1e-3)).as_rotvec()) / 2e-3
    reference += 0.002 / 60.0 / np.sqrt(0.05) * rng.standard_normal(reference.shape)
    crooked = Rotation.from_rotvec([2e-3, -1e-3, 3e-3]).as_matrix()
    reference = 1.0005 * reference @ crooked.T + 0.01
    poll_s = np.arange(0.0, time_s[-1], 0.5)
    poll_deg = np.degrees(np.interp(poll_s, time_s, psi)) + 0.5 / 3600.0 * rng.standard_normal(len(poll_s))
    return Made(time_s, gyro, poll_s, poll_deg, BaseMotion(seen_s, reference))


def test_the_whirl_is_found_on_a_base_that_sways(made: Made) -> None:
    angle, _ = align_angle(made.edges_s, made.rate_dps[:, 2], made.poll_s, made.poll_deg)
    assert max(made.lines(made.rate_dps, angle).values()) > 3.0
    rates, angle, _, fit = without_base(made.edges_s, made.rate_dps, made.poll_s, made.poll_deg, made.base)
    found = made.lines(rates, angle)
    assert max(found.values()) < 0.15
    assert fit.delay_s == pytest.approx(DELAY_S, abs=4.0 * fit.delay_sigma_s)
    assert fit.delay_sigma_s < 5e-3
    assert fit.after_dps < 0.05 * fit.before_dps and fit.yaw_share < 0.02
    # the reference is turned by 3 mrad about z; the whirl itself leaves this to 1 mrad
    assert fit.crooked[0] == pytest.approx(-5e-4 - 3e-3j, abs=1e-3)
    (finding,) = fit.findings()
    assert "ms late" in finding.text


def test_without_its_delay_and_its_axes_the_reference_would_not_do(made: Made) -> None:
    plain = made.base.means(made.edges_s, 0.0)
    plain = plain - plain.mean(axis=0)
    rates, angle, _, _ = without_base(made.edges_s, made.rate_dps, made.poll_s, made.poll_deg, made.base)
    turn = np.exp(0.5j * (angle[1:] + angle[:-1]))
    left = made.rate_dps[:, 0] + 1j * made.rate_dps[:, 1] - (plain[:, 0] + 1j * plain[:, 1]) / turn
    crude = np.column_stack([left.real, left.imag, rates[:, 2]])
    assert max(made.lines(crude, angle).values()) > 3.0 * max(made.lines(rates, angle).values())


def test_a_base_that_yaws_fast_is_told(made: Made) -> None:
    rate = made.base.rate_dps.copy()
    added = 0.5 * np.sin(2.0 * np.pi * 0.03 * made.base.time_s)
    rate[:, 2] += added
    gyro = made.rate_dps.copy()
    middle = 0.5 * (made.edges_s[1:] + made.edges_s[:-1]) + DELAY_S
    gyro[:, 2] += np.interp(middle, made.base.time_s, added)
    fit = without_base(made.edges_s, gyro, made.poll_s, made.poll_deg, BaseMotion(made.base.time_s, rate))[3]
    assert fit.yaw_share > 0.04
    assert any("yaws by" in finding.text for finding in fit.findings())


def test_a_reference_that_the_gyros_did_not_feel_is_told(made: Made) -> None:
    """Noise alone, and the axes turned by a quarter: neither has a delay that means anything."""
    parts = (made.edges_s, made.rate_dps, made.poll_s, made.poll_deg)
    assert without_base(*parts, made.base)[3].felt == pytest.approx(1.0, abs=2e-3)
    noise = 1e-3 * np.random.default_rng(7).standard_normal(made.base.rate_dps.shape)
    x, y, z = made.base.rate_dps.T
    for rate, felt in ((noise, 0.0), (np.stack([y, -x, z], axis=1), 0.0)):
        fit = without_base(*parts, BaseMotion(made.base.time_s, rate))[3]
        assert abs(fit.felt - felt) < 0.5
        assert any("times what it shows" in finding.text for finding in fit.findings())
        assert not any("ms late" in finding.text for finding in fit.findings())


def test_logs_of_a_base_that_do_not_go_with_a_run_are_named(made: Made, tmp_path: Path) -> None:
    parts = (made.edges_s, made.rate_dps, made.poll_s, made.poll_deg)
    short = BaseMotion(made.base.time_s[:5000], made.base.rate_dps[:5000])
    with pytest.raises(RecordError, match=r"does not cover the run.*-1\.0 to 249\.0 s"):
        without_base(*parts, short)
    with pytest.raises(UnfitRotation, match="does not fit the gyros"):
        without_base(*parts, wrong(made))
    log = tmp_path / "base.csv"
    heads = "time_s,base_rate_x_dps,base_rate_y_dps,base_rate_z_dps\n"
    log.write_text(heads + "".join(f"{k / 10},{k % 7},{k % 5},0\n" for k in range(40)))
    assert BaseMotion.load(log).rate_dps[8].tolist() == [1.0, 3.0, 0.0]
    log.write_text(heads + "".join(f"{(k % 30) / 10},1,2,3\n" for k in range(40)))
    with pytest.raises((RecordError, ConfigurationError)):
        BaseMotion.load(log)
    with pytest.raises(ConfigurationError, match=r"do not go with the runs.*2 logs"):
        whirl([], test=[], base=[log, log])
    with pytest.raises(
        ConfigurationError, match=r"no such base.*referense.*a log of it, or a unit of the runs"
    ):
        whirl([], test=[], base=[Path("referense")])


def wrong(made: Made) -> BaseMotion:
    """A log whose clock is 4 s off."""
    time_s = np.concatenate([made.base.time_s - 10.0, made.base.time_s[-100:] + 10.0])
    order = np.unique(time_s)
    shifted = np.stack(
        [np.interp(order + 4.0, made.base.time_s, column) for column in made.base.rate_dps.T], axis=1
    )
    return BaseMotion(order, shifted)


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Run:
    """Twenty-four turns on the emulated bench of `examples`, its base swaying at the frequency of line 3."""
    plant = load_plant(EXAMPLES / "ins_on_a_base_plant.toml", seed=5)
    bench = load_bench_file(EXAMPLES / "ins_on_a_base.toml")
    procedure = find_procedure("constant-rotation")
    with EmulatedLab(bench, plant) as lab:
        asked = procedure.parse({"turns": 24, "reversals": 5})
        where = tmp_path_factory.mktemp("runs")
        told = plant.metadata(bench)
        result = run_procedure(RunRequest(procedure, asked, lab.file, where, AssumeYes(), emulated=told))
    assert result.outcome == "completed"
    return Run.open(result.folder)


def test_a_unit_beside_the_table_shows_how_the_base_moves(recorded: Run) -> None:
    """Against the bearing of the plant file: without the base's rate nothing is left of its lines."""
    plant = load_plant(EXAMPLES / "ins_on_a_base_plant.toml")
    made = {round(line): complex(x, y) for line, x, y in plant.bearing["INS-001"].lines_arcsec}
    worst = []
    for base in (None, "reference"):
        turns = load_turns(recorded, base=base)
        fit = fit_direct([turns.record])
        off = {line: abs(fit.amplitude(line).value - value) for line, value in made.items()}
        worst.append(max(off.values()))
        sds = dict(zip(fit.lines, fit.sd_arcsec, strict=True))
    assert worst[0] > 10.0 and worst[1] < 0.25
    # amplitudes have two parts of this deviation each
    assert max(off[line] / sds[line] for line in made) < 4.0
    (told,) = [finding.text for finding in turns.findings if finding.text.startswith("a base that moves")]
    assert "times what it shows" not in told
    with pytest.raises(ConfigurationError, match="the one whose whirl is fitted"):
        load_turns(recorded, base="ins")
    with pytest.raises(ConfigurationError, match="another unit of the run"):
        load_turns(recorded, base="nobody")


def test_a_sway_at_a_line_and_an_engine_do_not_spoil_the_delay(recorded: Run) -> None:
    """Both units are stamped by the same bench; the reference's stamps are then made 40 ms later."""
    edges_s, rate_dps, usable = _on_grid(recorded, "ins")
    table = recorded.turntable()
    rate_dps[~usable] = rate_dps[usable][0]  # the samples of power-on
    base = _recorded_base(recorded, "reference", "ins")
    parts = (seconds(table), table["angle_deg"])
    fit = without_base(edges_s, rate_dps, *parts, base)[3]
    late = BaseMotion(base.time_s + 0.04, base.rate_dps)
    later = without_base(edges_s, rate_dps, *parts, late)[3]
    assert abs(fit.delay_s) < 2e-3
    assert later.delay_s - fit.delay_s == pytest.approx(0.04, abs=1e-4)
    assert fit.felt == pytest.approx(1.0, abs=2e-3)


def test_the_command_takes_the_name_of_a_unit(recorded: Run, tmp_path: Path) -> None:
    folder = Path(str(recorded.place))
    whirl([folder], base=[Path("reference")], out=tmp_path / "fit")
    assert "a base that moves" in (tmp_path / "fit" / "report.html").read_text(encoding="utf-8")
    with pytest.raises(
        ConfigurationError, match=r"no such base.*nobody.*or a unit of the runs: ins, reference"
    ):
        whirl([folder, folder], base=[Path("nobody")], out=tmp_path / "no")
