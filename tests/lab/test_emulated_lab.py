"""Emulated labs in the process of the bench and in one of their own: the same bytes, and how each ends."""

import json
import os
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from bench.control.procedure import find_procedure
from bench.control.questions import EmulatedOperator
from bench.control.runner import RunRequest
from bench.lab.emulated import EmulatedLab, Plant, lab_config, load_plant
from bench.lab.rehearsal import run_in_lab
from bench.lab.testing import usual_bench
from bench.record.benchfile import bench_file_from, bench_file_text, load_bench_file
from drivers.base.errors import BenchError, ConfigurationError
from drivers.base.virtual_clock import VirtualClock
from simulators.faults import Fault

pytestmark = [pytest.mark.concurrent, pytest.mark.slow]

BENCH = {
    "bench": {"name": "two ways", "latitude_deg": 39.1},
    "table": {"driver": "acutrol3000", "port": "pty-table"},
    "chamber": {"driver": "weiss", "port": "socket://127.0.0.1:1", "auxiliary": {"1": "fog_1 case"}},
    "gyro": [
        # 100 Hz: what comes in 4 s is more than a terminal holds
        {
            "name": "fog_1",
            "driver": "kvh1750",
            "port": "pty-fog",
            "rate_hz": 100,
            "axis": "x",
            "unit": "FOG-001",
        },
        {
            **{"name": "mems_1", "driver": "sbg_ellipse", "rate_hz": 10, "axes": "xyz", "axis": "z"},
            **{"interface": "gyrobench_slcan", "channel": "pty-mems", "unit": "ELL-001"},
        },
    ],
}
FAULTS = (
    Fault(port="fog_1", kind="vanish", at_s=(40.3,), duration_s=3.0),
    Fault(port="chamber", kind="flip", at_s=(31.0,)),
)
SETTINGS = {"turns": 3, "reversals": 1, "rest_s": 20}


def turned(folder: Path, *, apart: bool) -> Path:
    """Return the folder of a run on a lab with faults."""
    file = bench_file_from(BENCH)
    procedure = find_procedure("constant-rotation")
    with EmulatedLab(file, Plant(seed=7, fault=FAULTS), apart=apart) as lab:
        request = RunRequest(
            procedure, procedure.parse(SETTINGS), file, folder, EmulatedOperator(lab.perform), run_id="run"
        )
        result = run_in_lab(request, lab)
    assert result.outcome == "invalid" and "fog_1 was lost" in result.reason, result.reason
    return result.folder


def said(folder: Path) -> tuple[list[str], dict]:
    """Return events and manifest of a run, without where its ports were and when it was made."""
    manifest = json.loads((folder / "manifest.json").read_text())
    places = {device["port"] for device in (manifest["bench"]["table"], manifest["bench"]["chamber"])}
    places |= {gyro.get("port") or gyro["channel"] for gyro in manifest["bench"]["gyro"]}
    text = (folder / "events.jsonl").read_text()
    for place in places:
        text = text.replace(place, "PORT")
    kept = (
        "procedure",
        "parameters",
        "outcome",
        "reason",
        "duration_s",
        "emulated",
        "stream",
        "measurements",
    )
    return text.splitlines(), {name: manifest[name] for name in (*kept, "repeats", "written")}


def test_a_run_is_the_same_byte_for_byte_wherever_its_lab_is(tmp_path):
    here, apart = turned(tmp_path / "here", apart=False), turned(tmp_path / "apart", apart=True)
    names = sorted(path.relative_to(here).as_posix() for path in here.rglob("*") if path.is_file())
    assert names == sorted(path.relative_to(apart).as_posix() for path in apart.rglob("*") if path.is_file())
    recorded = [name for name in names if name.startswith("raw/") or name.endswith((".parquet", ".jsonl"))]
    recorded.remove("events.jsonl")
    assert {"raw/fog_1.bin", "raw/chamber.idx", "raw/table.sent.bin", "gyro_mems_1.parquet"} <= set(recorded)
    different = [name for name in recorded if (here / name).read_bytes() != (apart / name).read_bytes()]
    assert different == []
    assert said(here) == said(apart)
    for name in (name for name in names if name.endswith(".npz")):
        with np.load(here / name) as one, np.load(apart / name) as other:
            assert {key: one[key].tobytes() for key in one} == {key: other[key].tobytes() for key in other}


def test_two_labs_of_one_process_are_labs_of_their_own():
    file = usual_bench(None)
    with EmulatedLab(file, Plant()) as one, EmulatedLab(file, Plant()) as two:
        assert one.clock_url != two.clock_url and not set(one.ports.values()) & set(two.ports.values())
        clock = VirtualClock(one.clock_url)
        clock.sleep(5.0)
        with pytest.raises(ConfigurationError, match="another bench"):
            VirtualClock(one.clock_url)
        other = VirtualClock(two.clock_url)
        assert (clock.now(), other.now()) == (5.0, 0.0)
        clock.close()
        VirtualClock(one.clock_url).close()  # the next bench may come
        one.perform({"act": "mount", "unit": "fog_1", "mounting": "axis_up"})
        with pytest.raises(BenchError, match="fly"):
            one.perform({"act": "fly"})
        other.close()
    with pytest.raises(ConfigurationError, match="no emulated lab answers"):
        VirtualClock(one.clock_url)
    assert not any(Path(port).exists() for port in one.ports.values())


def test_nobody_outside_of_the_process_reaches_its_lab():
    with EmulatedLab(usual_bench(None), Plant()) as lab:
        code = f"from drivers.base.virtual_clock import VirtualClock; VirtualClock({lab.clock_url!r})"
        found = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert found.returncode == 1 and "no emulated lab answers at the clock URL" in found.stderr


def test_a_lab_of_its_own_ends_with_its_control_channel_and_says_so_when_it_was_killed():
    file = usual_bench(None)
    with EmulatedLab(file, Plant(), apart=True) as lab:
        process = os.pidfd_open(lab._lab._popen.pid)
    assert lab._lab._popen.returncode == 0
    os.close(process)
    left = EmulatedLab(file, Plant(), apart=True)
    left._lab.kill()
    with pytest.raises(BenchError, match="ended before"):
        left.perform({"act": "mount", "unit": "fog_1", "mounting": "axis_up"})
    left.close()


@pytest.mark.parametrize("apart", [False, True])
def test_a_lab_that_cannot_be_says_why(apart):
    file = usual_bench(None)
    plant = Plant(models={gyro.unit: "no such gyro" for gyro in file.gyro})
    with pytest.raises(ConfigurationError, match="no such gyro") as refused:
        EmulatedLab(file, plant, apart=apart)
    assert refused.value.expected


def test_a_plant_file_says_how_a_unit_lies_at_first(tmp_path):
    (tmp_path / "plant.toml").write_text('mounting = { fog_1 = "axis_up" }\n')
    config = lab_config(usual_bench(None), load_plant(tmp_path / "plant.toml"))
    assert {gyro.config.name: gyro.mounting for gyro in config.gyros} == {"fog_1": "axis_up", "mems_1": None}
    (tmp_path / "plant.toml").write_text('mounting = { fog_1 = "upside_down" }\n')
    with pytest.raises(ConfigurationError, match="axis_up"):
        load_plant(tmp_path / "plant.toml")


def test_a_lab_in_the_background_of_a_shell_ends_on_sigterm(tmp_path):
    """Such a shell starts it with SIGINT ignored; POSIX, Shell Command Language 2.11."""
    path = tmp_path / "lab.toml"
    path.write_text(bench_file_text(usual_bench(None)), encoding="utf-8")
    code = "from signal import *; from bench.present.cli import main; signal(SIGINT, SIG_IGN); main()"
    command = [sys.executable, "-c", code, "lab", "--bench", str(path)]
    with subprocess.Popen(command, stdout=subprocess.PIPE) as lab:
        assert lab.stdout is not None
        assert any(b"Ctrl-C" in line for line in lab.stdout)
        lab.send_signal(signal.SIGTERM)
        assert b"lab closed" in lab.stdout.read()
    assert lab.returncode == 0


@pytest.mark.parametrize(
    "plant",
    [
        Plant(on_ground=("refernce",)),
        Plant(mounting={"refernce": "axis_up"}),
        Plant(lean_deg={"refernce": (0.1, 0.0)}),
        Plant(clock_error_ppm={"refernce": 50.0}),
    ],
    ids=lambda plant: next(iter(plant.model_fields_set)),
)
def test_what_a_plant_says_of_a_gyro_that_the_bench_lacks_is_refused(plant: Plant) -> None:
    file = load_bench_file(Path("examples/ins_on_a_base.toml"))
    key = next(iter(plant.model_fields_set))
    with pytest.raises(
        ConfigurationError, match=rf"{key}: the bench has no such gyro.*refernce.*did you mean 'reference'"
    ):
        lab_config(file, plant)


def test_a_unit_that_a_plant_puts_on_the_ground_stands_there() -> None:
    file = load_bench_file(Path("examples/ins_on_a_base.toml"))
    standing = lab_config(file, Plant(on_ground=("reference",))).gyros
    assert {gyro.config.name: gyro.on_ground for gyro in standing} == {"ins": False, "reference": True}
