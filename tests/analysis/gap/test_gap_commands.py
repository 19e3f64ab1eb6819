"""The commands on recordings written here: what they print and the model file that they write."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from bench.analysis.gap import Model, model_text, read_model
from bench.present.cli.gap._batch import batch
from bench.present.cli.gap._diagnose import close, diagnose
from drivers.base.errors import ConfigurationError
from tests.analysis.gap.conftest import stimulus

HEAD = """
format = 1
unit_id = "G7"
latitude_deg = 39.1
[columns]
time = { name = "t", unit = "s" }
output = { name = "rate", unit = "deg/h" }
t_in = { name = "t_in", unit = "degC" }
t_out = { name = "t_out", unit = "degC" }
"""


def recordings(folder: Path, cubic_dph: float, names: str = "abc", seed: int = 8, unit: str = "G7") -> Path:
    """Runs of 4000 s, axis up at 39.1 deg: Earth rate, white noise, bias with the cube of temperature."""
    rng = np.random.default_rng(seed)
    text = HEAD.replace("G7", unit)
    folder.mkdir(exist_ok=True)
    for name in names:
        s = stimulus(4000)
        rate = 9.4860 + cubic_dph * ((s.t_in_c - 25.0) / 50.0) ** 3 + rng.normal(0.0, 0.24, 4000)
        rows = np.stack((np.arange(1.0, 4001.0), rate, s.t_in_c, s.t_out_c))
        lines = ["t,rate,t_in,t_out", *(",".join(f"{value:.5f}" for value in row) for row in rows.T)]
        (folder / f"{name}.csv").write_text("\n".join(lines), encoding="utf-8")
        text += f'[[run]]\nfile = "{name}.csv"\nprofile = "shock"\nelevation_deg = 90.0\n'
    (folder / "runs.toml").write_text(text, encoding="utf-8")
    return folder / "runs.toml"


def test_one_of_the_runs_is_held_out_by_its_id(
    tmp_path: Path, nominal: Model, capsys: pytest.CaptureFixture[str]
) -> None:
    runs, model = recordings(tmp_path, 0.5), tmp_path / "nominal.toml"
    model.write_text(model_text(nominal), encoding="utf-8")
    diagnose([runs], model, [Path("c")], None, True)
    facts = json.loads(capsys.readouterr().out)
    assert set(facts["runs"]) == {"a", "b"}
    assert facts["held_out"]["share"] > 0.97
    with pytest.raises(ConfigurationError, match="no such run to hold out") as unknown:
        diagnose([runs], model, [Path("d")], None, True)
    assert "a, b, c" in unknown.value.expected
    with pytest.raises(ConfigurationError, match="every run is held out"):
        diagnose([runs], model, [Path(name) for name in "abc"], None, True)


def test_a_batch_of_mapped_recordings_says_whose_the_effect_is(
    tmp_path: Path, nominal: Model, capsys: pytest.CaptureFixture[str]
) -> None:
    model = tmp_path / "nominal.toml"
    model.write_text(model_text(nominal), encoding="utf-8")
    runs = [recordings(tmp_path / unit, size, unit=unit) for unit, size in (("G7", 0.5), ("G8", 0.0))]
    batch(runs, model)
    shown = " ".join(capsys.readouterr().out.split())
    assert "unit G7: explained: bias_cubic unit G8: no gap" in shown
    assert "bias_cubic: of G7, and of no other unit" in shown
    batch(runs, model, True)
    facts = json.loads(capsys.readouterr().out)
    assert facts["units"]["G8"]["verdict"] == "no gap"
    ((parameter, value),) = facts["effects"][0]["terms"]["G7"]["parameters"].items()
    assert parameter == "bias_dph_per_50k3" and value == pytest.approx(0.5, abs=0.05)


def test_diagnose_prints_facts_and_close_writes_the_model(
    tmp_path: Path, nominal: Model, capsys: pytest.CaptureFixture[str]
) -> None:
    runs, model = recordings(tmp_path, 0.5), tmp_path / "nominal.toml"
    model.write_text(model_text(nominal), encoding="utf-8")
    diagnose([runs], model, [], None, True, tmp_path / "gap.html")
    facts = json.loads(capsys.readouterr().out)
    page = (tmp_path / "gap.html").read_text(encoding="utf-8")
    assert "Gap explained" in page
    assert "bias cubic" in page
    assert page.count("<svg") >= 3  # maps by runs, phase, regime, and the curves
    assert "No run was held out" in page
    assert facts["verdict"] == "explained"
    assert [cause["name"] for cause in facts["causes"]] == ["bias_cubic"]
    close([runs], model, None, None)
    closed = read_model(tmp_path / "nominal+bias_cubic.toml")
    (term,) = [term for term in closed.terms if term.name == "bias_cubic"]
    assert term.values[0] == pytest.approx(0.5, abs=max(4.0 * term.sigmas[0], 0.03))
    assert set(closed.fitted_on) == {"a", "b", "c"}


def test_no_gap_writes_no_model(tmp_path: Path, nominal: Model, capsys: pytest.CaptureFixture[str]) -> None:
    runs, model = recordings(tmp_path, 0.0), tmp_path / "nominal.toml"
    model.write_text(model_text(nominal), encoding="utf-8")
    close([runs], model, None, None)
    assert "no gap" in capsys.readouterr().out
    assert not list(tmp_path.glob("nominal+*"))
    diagnose([runs], model, [], None, False)
    assert "no gap" in capsys.readouterr().out


@pytest.mark.parametrize(
    "name", ["fog_cold_shock", "rlg_ramp", "rotation_with_whirl", "multi_position", "heading_change"]
)
def test_every_system_has_a_nominal_model(name: str) -> None:
    model = read_model(Path(__file__).parents[3] / "examples" / "nominal" / f"{name}.toml")
    assert model.noise.arw_deg_per_sqrt_h > 0.0
    assert np.isfinite(model.predict(stimulus(300))).all()
