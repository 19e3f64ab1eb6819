"""Every chamber driver in a run on the emulated lab: the same script, and what a chamber lacks is said first."""

import json

import pyarrow.parquet as pq
import pytest

from bench.control.procedure import Demands, Procedure, find_procedure
from bench.control.questions import EmulatedOperator
from bench.lab.emulated import Plant
from bench.record.benchfile import load_bench_file
from drivers.base.errors import LimitExceeded

KINDS = {  # driver, and what else tells it from others; of a Thermotron the controller
    "cts": "/dev/ttyUSB2",
    "cts on its own TCP port": "socket://192.168.1.20:1080",
    "espec_p300": "/dev/ttyUSB2",
    "espec_scp220": "socket://192.168.1.20:10001",
    "thermotron_8200": "socket://192.168.1.20:8888",
    "thermotron_8200 8800": "/dev/ttyUSB2",
    "thermotron_8200 3800": "/dev/ttyUSB2",
    "watlow_f4": "/dev/ttyUSB2",
    "watlow_f4t": "socket://192.168.1.20:502",
}


def bench_file(text, tmp_path, kind, extra=""):
    driver, _, controller = kind.partition(" ")
    chamber = f'driver = "{driver}"\nport = "{KINDS[kind]}"\n{extra}'
    chamber += f'controller = "{controller}"\n' if controller.isdecimal() else ""
    old = 'driver = "weiss"\nport = "/dev/ttyUSB2"\nauxiliary = { 1 = "case" }\n'
    assert old in text
    path = tmp_path / "lab.toml"
    path.write_text(text.replace(old, chamber).replace("case_sensor = 1\n", ""))
    return load_bench_file(path)


def ramp_down(bench, p):
    bench.chamber.start()
    bench.chamber.go_to(5.0, 5.0)
    bench.wait(300.0)


def short(spin, demands):
    run = ramp_down if demands is None else None
    return Procedure(
        "ramp",
        "Ramp",
        "tests",
        spin.parameters,
        run,
        lambda p: 1.0,
        lambda p: demands or Demands(0, 5, 25, 5),
    )


@pytest.mark.parametrize("kind", KINDS)
def test_the_chamber_ramps_as_told_and_is_left_safe(bench, fog_text, tmp_path, kind):
    file = bench_file(fog_text, tmp_path, kind)
    with bench.lab(file, Plant()) as lab:
        result = bench.drive(lab.file, tmp_path / "runs", short(bench.spin, None))
    assert result.outcome == "completed", result.reason
    assert bench.problems(result.folder) == []
    table = pq.read_table(result.folder / "chamber.parquet").to_pandas()
    time_s = table["time_ns"] * 1e-9
    assert len(table) > 290
    # 20 K at 5 K/min take 4 minutes: half-way after 2, and there after 4, whatever the protocol rounds
    half = table["air_temp_c"][(time_s > 118) & (time_s < 128)].mean()
    assert half == pytest.approx(15.0, abs=1.5)
    assert table["air_temp_c"].iloc[-20:].mean() == pytest.approx(5.0, abs=0.5)
    events = (result.folder / "events.jsonl").read_text()
    assert '"running": false' in events
    if kind not in ("thermotron_8200", "thermotron_8200 3800"):  # they show a set point once they run
        assert '"set_point_c": 25.0' in events
    manifest = json.loads((result.folder / "manifest.json").read_text())
    assert manifest["devices"]["chamber"]["maker"] in ("CTS", "ESPEC", "Thermotron", "Watlow")


@pytest.mark.parametrize("kind", [kind for kind in KINDS if kind.startswith(("cts", "thermotron"))])
def test_a_known_state_is_reached_whoever_makes_the_ramp(bench, fog_text, tmp_path, kind):
    file = bench_file(fog_text, tmp_path, kind)
    told = {"air_c": -15.0, "ramp_k_per_min": 5.0, "air_tolerance_k": 5.0, "drift_k_per_10min": 5.0}
    with bench.lab(file, Plant()) as lab:
        procedure = find_procedure("known-state")
        result = bench.drive(lab.file, tmp_path / "runs", procedure, EmulatedOperator(lab), **told)
    assert result.outcome == "completed", result.reason
    assert bench.problems(result.folder) == []
    table = pq.read_table(result.folder / "chamber.parquet").to_pandas()
    falls = table[(table["air_temp_c"] < 15.0) & (table["air_temp_c"] > -10.0)]
    minutes = (falls["time_ns"].iloc[-1] - falls["time_ns"].iloc[0]) / 60e9
    assert (falls["air_temp_c"].iloc[0] - falls["air_temp_c"].iloc[-1]) / minutes == pytest.approx(
        5.0, abs=0.3
    )


@pytest.mark.parametrize(
    ("kind", "extra", "demands", "words"),
    [
        ("watlow_f4", 'auxiliary = { 4 = "fog_1 case" }\n', None, ["auxiliary sensor", "4", "one of 2, 3"]),
        ("espec_p300", 'auxiliary = { 1 = "fog_1 case" }\n', None, ["auxiliary sensor", "none"]),
        ("watlow_f4", "", Demands(0, 5, 25, 0.01), ["0.01 K/min", "a ramp of 0.1 .. 3276.7 K/min"]),
        ("thermotron_8200", 'auxiliary = { 30 = "fog_1 case" }\n', None, ["sensor", "30", "one of 2, 3"]),
    ],
)
def test_what_a_chamber_cannot_do_is_said_before_anything_moves(
    bench, fog_text, tmp_path, kind, extra, demands, words
):
    file = bench_file(fog_text, tmp_path, kind, extra)
    with bench.lab(file, Plant()) as lab:
        result = bench.drive(lab.file, tmp_path / "runs", short(bench.spin, demands))
    assert isinstance(result.error, LimitExceeded)
    assert all(word in str(result.error) for word in words), result.error
    sent = (result.folder / "raw" / "chamber.sent.bin").read_bytes()
    if not kind.startswith("watlow"):
        assert all(line.endswith(b"?") for line in sent.split(b"\r") if line.strip()), sent
    else:
        assert {sent[at + 1] for at in range(0, len(sent), 8)} == {
            3
        }  # read requests of 8 bytes, nothing else
