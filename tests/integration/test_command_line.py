"""The command line from outside: error texts, exit codes, what `runs verify` finds, what start-up loads."""

import json
import shutil
import subprocess
import sys

import pytest

from bench.control.live import read_now
from bench.present.cli import main

BRISK = ("soak_min=1", "hold_min=10", "warm_up_min=0", "east_after_min=0", "east_dwell_s=60")


@pytest.fixture
def cli(monkeypatch, capsys):
    def call(*arguments):
        """Return (exit code, what was printed on both streams with line breaks as spaces)."""
        monkeypatch.setattr(sys, "argv", ["gyrobench", *map(str, arguments)])
        monkeypatch.setenv("COLUMNS", "200")
        with pytest.raises(SystemExit) as ended:
            main()
        said = capsys.readouterr()
        return ended.value.code, " ".join((said.out + said.err).split())

    return call


@pytest.fixture
def bench_path(fog_text, tmp_path):
    path = tmp_path / "bench.toml"
    path.write_text(fog_text)
    return path


def settings(*pairs):
    return [word for pair in pairs for word in ("--set", pair)]


@pytest.mark.parametrize("command", ["run", "rehearse"])
@pytest.mark.parametrize(
    ("procedure", "pairs", "words"),
    [
        ("zero-bias-cold-shok", [], ["no procedure 'zero-bias-cold-shok'", "mean 'zero-bias-cold-shock'"]),
        (
            "zero-bias-cold-shock",
            ["soak_mn=60"],
            ["soak_mn is not a parameter", "did you mean 'soak_min'", "repeats"],
        ),
        ("zero-bias-cold-shock", ["cold_c=-80"], ["cold_c = '-80'", "greater than or equal to -70"]),
        ("zero-bias-cold-shock", ["soak_min=long"], ["soak_min = 'long'", "valid number"]),
        ("zero-bias-cold-shock", ["soak_min=nan"], ["soak_min"]),
        ("zero-bias-cold-shock", ["soak_min"], ["--set", "not name=value", "soak_min"]),
        (
            "zero-bias-cold-shock",
            ["repeats=0", "hold_min=5"],
            ["repeats = '0'", "hold_min = '5'"],
        ),
    ],
)
def test_mistakes_in_the_request_are_one_paragraph_and_exit_code_2(
    cli, bench_path, tmp_path, command, procedure, pairs, words
):
    runs = tmp_path / "runs"
    code, said = cli(command, procedure, "--bench", bench_path, "--runs", runs, *settings(*pairs))
    assert code == 2, said
    assert said.startswith("error: ") and all(word in said for word in words), said
    assert not runs.exists()


def test_a_missing_or_wrong_bench_file_is_exit_code_2(cli, tmp_path, fog_text):
    code, said = cli("run", "zero-bias-cold-shock", "--bench", tmp_path / "none.toml")
    assert code == 2 and "none.toml" in said
    path = tmp_path / "wrong.toml"
    path.write_text(fog_text.replace("latitude_deg = 39.10", "latitude_deg = 139.10"))
    code, said = cli("rehearse", "zero-bias-cold-shock", "--bench", path)
    assert code == 2 and "latitude_deg" in said and "139.1" in said


def test_an_unknown_plant_key_and_chamber_are_exit_code_2(cli, bench_path, tmp_path):
    plant = tmp_path / "plant.toml"
    plant.write_text("sed = 3\n")
    arguments = ("rehearse", "zero-bias-cold-shock", "--bench", bench_path, "--runs", tmp_path / "runs")
    code, said = cli(*arguments, "--plant", plant)
    assert code == 2 and "plant.toml" in said and "sed" in said
    plant.write_text('chamber = "tropical"\n')
    code, said = cli(*arguments, "--plant", plant)
    assert code == 2


def test_a_run_whose_port_is_missing_is_exit_code_3_and_leaves_a_folder(cli, bench_path, tmp_path):
    runs = tmp_path / "runs"
    bench_path.write_text(bench_path.read_text().replace("/dev/ttyUSB0", str(tmp_path / "nothing")))
    code, said = cli("run", "zero-bias-cold-shock", "--bench", bench_path, "--runs", runs, "--yes")
    assert code == 3
    assert "aborted" in said and "cannot be opened" in said and "Traceback" not in said
    (folder,) = runs.iterdir()
    assert json.loads((folder / "manifest.json").read_text())["outcome"] == "aborted"
    assert cli("runs", "verify", folder)[0] == 0


def test_a_weak_chamber_gives_an_invalid_run_with_the_figure_and_exit_code_4(cli, bench_path, tmp_path):
    plant = tmp_path / "plant.toml"
    plant.write_text('chamber = "weak"\nseed = 4\n')
    pairs = settings(*BRISK, "drift_k_per_10min=2", "equilibrium_timeout_min=1")
    code, said = cli(
        *("rehearse", "zero-bias-cold-shock", "--bench", bench_path, "--runs", tmp_path / "runs"),
        *("--plant", plant, *pairs),
    )
    assert code == 4, said
    (folder,) = (tmp_path / "runs").iterdir()
    manifest = json.loads((folder / "manifest.json").read_text())
    assert manifest["outcome"] == "invalid"
    shown = read_now(folder)  # a panel sees rehearsals
    assert shown["state"] == "ended" and shown["outcome"] == "invalid" and shown["run"]["emulated"]
    rate = next(row for row in manifest["measurements"] if row["name"] == "shock_rate_10_90")
    assert not rate["passed"] and 0.0 < rate["value"] < 10.0
    assert f"shock rate {rate['value']:.2f} K/min" in manifest["reason"]
    assert "required 10 K/min" in manifest["reason"] and f"{rate['value']:.2f}" in said


def test_verify_passes_a_sound_run_and_finds_one_flipped_byte(cli, short_run, tmp_path):
    copy = tmp_path / "copy"
    shutil.copytree(short_run, copy)
    code, said = cli("runs", "verify", copy)
    assert code == 0 and "3 tables rebuilt" in said, said
    path = copy / "raw" / "fog_1.bin"
    data = bytearray(path.read_bytes())
    data[len(data) // 2] ^= 0x01
    path.write_bytes(data)
    code, said = cli("runs", "verify", copy)
    assert code == 1
    assert "raw/fog_1.bin: differs from the manifest" in said
    assert "gyro_fog_1.parquet: has" in said or "gyro_fog_1.parquet: rate_dps differs" in said


def test_runs_are_listed_and_shown(cli, short_run):
    code, said = cli("runs", "list", short_run.parent)
    assert code == 0 and "short" in said and "completed" in said and "FOG-001" in said
    code, said = cli("runs", "show", short_run)
    assert code == 0 and "reference_output" in said and "Acutrol3000" in said


HELP = """
import bench.present.cli
sys.argv = ["gyrobench", "--help"]
try:
    bench.present.cli.main()
except SystemExit:
    pass
"""
LOADED = """
import sys
{code}
print(sorted(set(sys.modules) & {{"torch", "pandas", "scipy", "matplotlib", "pyarrow", "cantools"}}))
"""


@pytest.mark.parametrize(
    "code",
    [
        "import bench",
        HELP,
    ],
)
def test_start_up_loads_nothing_heavy(code):
    said = subprocess.run(
        [sys.executable, "-c", LOADED.format(code=code)], capture_output=True, text=True, check=True
    )
    assert said.stdout.splitlines()[-1] == "[]"
    assert said.stderr == ""


def test_a_run_loads_neither_torch_nor_pandas():
    modules = (
        "bench.control.runner",
        "bench.lab.emulated",
        "procedures.zero_bias_cold_shock",
        "bench.present.cli._shown_run",
    )
    code = f"import {', '.join(modules)}"
    said = subprocess.run(
        [sys.executable, "-c", LOADED.format(code=code)], capture_output=True, text=True, check=True
    )
    loaded = said.stdout.splitlines()[-1]
    assert "torch" not in loaded and "pandas" not in loaded


@pytest.mark.parametrize("command", ["run", "rehearse"])
def test_a_parameter_beyond_a_limit_is_refused_and_leaves_no_run_folder(cli, bench_path, tmp_path, command):
    """Beyond the parameter's own limit, and beyond what the bench file allows (20 deg/s)."""
    for value, words in (("1001", "less than or equal to 1000"), ("30", "at most 20 deg/s")):
        runs = tmp_path / "runs"
        asked = ["constant-rotation", "--bench", bench_path, "--runs", runs, "--rate-dps", value]
        code, text = cli(command, *asked)
        assert code == 2 and words in text, text
        assert not runs.exists()


def test_runs_are_listed_in_the_folder_that_is_named(cli, monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "runs").mkdir()
    (tmp_path / "others").mkdir()
    assert cli("runs", "list") == (0, "no runs in runs")
    assert cli("runs", "list", "others") == (0, "no runs in others")
