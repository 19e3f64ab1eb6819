"""A user's own simulation as the nominal: what is diagnosed and closed is what it lacks."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from typer.testing import CliRunner

from bench.analysis.gap import take_own
from bench.present.cli._app import app
from drivers.base.errors import ConfigurationError

PERIOD, STEPS = 1.0, 4000
SLOPE_DPH_PER_K, SCALE = 0.8, 1.002
"""What the gyro has: a bias over temperature that no simulation knows; a scale factor that each knows."""


@pytest.fixture
def campaign(tmp_path: Path) -> Path:
    """A folder with two recordings through one temperature, at +20 and -20 deg/s, twice, and their mapping."""
    rng = np.random.default_rng(11)
    time = PERIOD * np.arange(1, STEPS + 1)
    warm = 20.0 * np.sin(2 * np.pi * time / STEPS) ** 3 + 25.0
    runs = []
    for number, rate in enumerate((20.0, -20.0, 20.0, -20.0)):
        angle = rate * time
        noise = 0.02 * 60.0 * rng.standard_normal(STEPS) / 3600.0
        true = rate + 15.041067 / 3600.0 * np.sin(np.radians(48.0))
        output = SCALE * true + SLOPE_DPH_PER_K / 3600.0 * (warm - 25.0) + noise
        table = {"t": time, "rate": output, "temp": warm, "angle": angle, "sim": np.full(STEPS, SCALE * true)}
        pd.DataFrame(table).to_csv(tmp_path / f"run{number}.csv", index=False)
        pd.DataFrame({"s": time, "dph": 3600.0 * table["sim"]}).to_parquet(
            tmp_path / f"sim_run{number}.parquet"
        )
        runs.append(
            f'[[run]]\nfile = "run{number}.csv"\nprofile = "warm"\ncondition = "{rate:+g}"\nelevation_deg = 90\n'
        )
    mapping(tmp_path, "map.toml", runs)
    mapping(tmp_path, "with_sim.toml", runs, 'foretold = { name = "sim", unit = "deg/s" }\n')
    (tmp_path / "mine.py").write_text("def foretell(inputs):\n    return 1.002 * inputs['rate_dps']\n")
    return tmp_path


def mapping(folder: Path, name: str, runs: list[str], more: str = "") -> None:
    (folder / name).write_text(
        'format = 1\nunit_id = "u"\nlatitude_deg = 48\n[columns]\ntime = { name = "t", unit = "s" }\n'
        'output = { name = "rate", unit = "deg/s" }\nt_in = { name = "temp", unit = "degC" }\n'
        f'angle = {{ name = "angle", unit = "deg" }}\n{more}' + "".join(runs)
    )


def nominal(folder: Path, simulation: str) -> Path:
    file = folder / "nominal.toml"
    file.write_text(f"format = 1\n[noise]\narw_deg_per_sqrt_h = 0.02\n{simulation}")
    return file


KINDS = {
    "columns of each run": '[simulation]\ncolumns = "sim_{run}.parquet"\ntime = { name = "s", unit = "s" }\n'
    'output = { name = "dph", unit = "deg/h" }\n',
    "function of a file": '[simulation]\nfunction = "foretell"\n',
    "column of the log": "",
}


@pytest.mark.parametrize("kind", KINDS)
def test_what_a_simulation_lacks_is_named_and_closed(campaign: Path, kind: str) -> None:
    model = nominal(campaign, KINDS[kind])
    runs = campaign / ("map.toml" if KINDS[kind] else "with_sim.toml")
    take_own(campaign / "mine.py")
    check_closed(campaign, runs, model)


def check_closed(campaign: Path, runs: Path, model: Path) -> None:
    """The bias over temperature is named, with its size; closing says so in columns and as a term."""
    said = CliRunner().invoke(app, ["gap", "diagnose", str(runs), "--model", str(model), "--json"])
    assert said.exit_code == 0, said.output
    cause = json.loads(said.output)["causes"]
    assert [one["name"] for one in cause] == ["bias_linear"]
    out = campaign / "closed" / "closed.toml"
    out.parent.mkdir()
    close = CliRunner().invoke(
        app, ["gap", "close", str(runs), "--model", str(model), "--out", str(out), "--json"]
    )
    assert close.exit_code == 0, close.output
    table = pd.read_csv(out.with_name("closed_run1.csv"))
    truth = SLOPE_DPH_PER_K * 20.0 * np.sin(2 * np.pi * table["time_s"] / STEPS) ** 3
    missing = table["missing_dph"] - table["missing_dph"].mean()
    assert np.abs(missing - (truth - truth.mean())).max() < 0.3
    assert np.std(table["left_dph"] - table["missing_dph"]) == pytest.approx(0.02 * 60.0, rel=0.1)
    again = CliRunner().invoke(app, ["gap", "diagnose", str(runs), "--model", str(out), "--json"])
    assert json.loads(again.output)["verdict"] == "no gap"


def test_an_fmu_of_a_makers_tool(campaign: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Built by PythonFMU, which knows nothing of this project; run by FMPy on the recorded rate."""
    pytest.importorskip("fmpy", reason="an FMU needs the extra fmu, which is not installed here")
    builder = pytest.importorskip(
        "pythonfmu.builder", reason="PythonFMU, which makes the FMU, is not installed here"
    )
    (campaign / "slave.py").write_text(
        "from pythonfmu import Fmi2Causality, Fmi2Slave, Real\n\n\nclass Gyro(Fmi2Slave):\n"
        "    def __init__(self, **kwargs):\n        super().__init__(**kwargs)\n"
        "        self.rate, self.output = 0.0, 0.0\n"
        "        self.register_variable(Real('rate', causality=Fmi2Causality.input))\n"
        "        self.register_variable(Real('output', causality=Fmi2Causality.output))\n\n"
        "    def do_step(self, current_time, step_size):\n        self.output = 1.002 * self.rate\n"
        "        return True\n"
    )
    builder.FmuBuilder.build_FMU(campaign / "slave.py", dest=campaign)
    model = nominal(
        campaign,
        '[simulation]\nfmu = "Gyro.fmu"\noutput = { name = "output", unit = "deg/s" }\n'
        'inputs = { rate = "rate_dps" }\n',
    )
    check_closed(campaign, campaign / "map.toml", model)


def test_what_a_simulation_lacks_as_an_fmu(campaign: Path) -> None:
    """Run by FMPy on a recorded temperature, it gives the column of what is missing."""
    fmpy = pytest.importorskip("fmpy", reason="an FMU needs the extra fmu, which is not installed here")
    pytest.importorskip("pythonfmu", reason="writing an FMU needs the extra fmu, which is not installed here")
    model, file = nominal(campaign, KINDS["columns of each run"]), campaign / "missing.fmu"
    command = [
        "gap",
        "close",
        str(campaign / "map.toml"),
        "--model",
        str(model),
        "--fmu",
        str(file),
        "--json",
    ]
    said = CliRunner().invoke(app, command)
    assert said.exit_code == 0, said.output
    assert json.loads(said.output)["fmu"] == str(file)
    log, table = pd.read_csv(campaign / "run0.csv"), pd.read_csv(json.loads(said.output)["tables"][0])
    signals = np.zeros(STEPS, dtype=[("time", np.float64), ("t_in_c", np.float64)])
    signals["time"], signals["t_in_c"] = log["t"] - PERIOD, log["temp"]
    made = fmpy.simulate_fmu(str(file), stop_time=STEPS * PERIOD, output_interval=PERIOD, input=signals)
    found = np.asarray(made["missing_dph"][1:])
    assert found == pytest.approx(SLOPE_DPH_PER_K * (log["temp"].to_numpy() - 25.0), abs=0.2)
    # the first row of a log begins its first step
    assert found[1:] == pytest.approx(table["missing_dph"].to_numpy(), abs=0.2)


def test_an_fmu_that_cannot_be_is_refused_before_anything_is_diagnosed(campaign: Path) -> None:
    model = nominal(campaign, KINDS["columns of each run"])
    command = ["gap", "close", "not there", "--model", str(model), "--fmu", "missing.zip"]
    said = CliRunner().invoke(app, command)
    assert said.exit_code != 0
    assert "ends in .fmu" in str(said.exception)


@pytest.mark.parametrize(
    ("simulation", "told"),
    [
        ('[simulation]\nfunction = "other"\n', "no such simulation"),
        ('[simulation]\nfunction = "nobody"\n', "gyrobench.simulations"),
        ('[simulation]\nfunction = "foretell"\nfmu = "x.fmu"\n', "[simulation] cannot be used"),
        ('[simulation]\ncolumns = "none.csv"\n', "does not say its column"),
        (KINDS["columns of each run"].replace("sim_{run}", "none"), "no such file"),
        (KINDS["columns of each run"].replace("deg/h", "degC"), "unit is not known"),
    ],
)
def test_what_cannot_be_used_is_said(campaign: Path, simulation: str, told: str) -> None:
    model = nominal(campaign, simulation)
    said = CliRunner().invoke(app, ["gap", "diagnose", str(campaign / "map.toml"), "--model", str(model)])
    assert said.exit_code != 0
    assert told in " ".join(f"{said.output} {said.exception}".split())


OWN = """
import numpy as np
from simulators.effects import DPH, Effect, Input, Parameter

def kink(s, shape):
    return np.maximum(s.warm_k - 5.0, 0.0)

MINE = Effect("my_kink", (Parameter("kink_dph_per_k", -100.0, 100.0, DPH.per("K")),), kink, Input.T_IN, "T_in",
              "own", "Bias grows above 30 degC.")
"""


def test_an_effect_of_ones_own_in_a_file_beside_the_runs(
    campaign: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("simulators.effects._catalogue._FROM_FILES", {})
    own = campaign / "effects.py"
    own.write_text(OWN)
    for file in campaign.glob("run*.csv"):
        table = pd.read_csv(file)
        bias = 1.5 * np.maximum(table["temp"] - 30.0, 0.0) - SLOPE_DPH_PER_K * (table["temp"] - 25.0)
        table["rate"] += bias / 3600.0
        table.to_csv(file, index=False)
    model = nominal(campaign, KINDS["function of a file"])
    arguments = ["gap", "diagnose", str(campaign / "map.toml"), "--model", str(model), "--json"]
    for _ in range(2):  # a file may be given again in one process
        said = CliRunner().invoke(
            app, [*arguments, "--effects", str(own), "--effects", str(campaign / "mine.py")]
        )
        assert said.exit_code == 0, said.output
    cause = json.loads(said.output)["causes"]
    assert [one["name"] for one in cause] == ["my_kink"]
    assert cause[0]["parameters"]["kink_dph_per_k"] == pytest.approx(1.5, rel=0.02)


def test_a_file_without_effects_or_with_a_name_that_is_taken(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("simulators.effects._catalogue._FROM_FILES", {})
    file = tmp_path / "mine.py"
    file.write_text("from simulators.effects import CATALOGUE\nx = CATALOGUE[0]\n")
    with pytest.raises(ConfigurationError, match="defines no effect"):
        take_own(file)
    file.write_text(OWN.replace("my_kink", "warm_up"))
    with pytest.raises(ConfigurationError, match="two effects of one name"):
        take_own(file)
    file.write_text("1 / 0")
    with pytest.raises(ConfigurationError, match="ZeroDivisionError"):
        take_own(file)
