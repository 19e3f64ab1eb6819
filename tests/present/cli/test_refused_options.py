"""Options that would be left aside are refused: what moves or is calibrated must be what was asked for."""

from __future__ import annotations

from pathlib import Path

import pytest
from typer.testing import CliRunner

from bench.present.cli._app import app

ROOT = Path(__file__).parents[3]


def said(*words: object) -> tuple[int, str]:
    done = CliRunner().invoke(app, [str(word) for word in words])
    return done.exit_code, f"{done.output}{done.exception or ''}"


@pytest.mark.parametrize(
    ("options", "named"),
    [(["--after", "x.gyrocomp"], "--after"), (["--latitude-deg", "89"], "--latitude-deg"),
     (["--scheme", "s", "--as-told"], "--as-told"), (["--lever-arms"], "--lever-arms")],
)  # fmt: skip
def test_a_calibration_by_hand_takes_its_own_options_only(
    tmp_path: Path, options: list[str], named: str
) -> None:
    code, text = said("fit", "calibration", tmp_path / "map.toml", "--by-hand", *options)
    assert code == 2 and named in text and "by-hand" in text


@pytest.mark.parametrize(
    "options", [["--seed", "5"], ["--run", "--bench", "b.toml", "--seed", "5"],
                ["--run", "--bench", "b.toml", "--plant", "p.toml"]]
)  # fmt: skip
def test_an_emulated_lab_is_asked_for_before_a_bench_is_driven(options: list[str]) -> None:
    code, text = said("gap", "diagnose", "runs", "--model", "nominal.toml", *options)
    assert code == 2 and ("--emulated" in text or "--run" in text), text
