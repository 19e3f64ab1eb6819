"""A bench of two gyros and a campaign of short runs."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from bench.record.benchfile import load_bench_file

BENCH = """
[bench]
name = "campaign bench"
latitude_deg = 39.10
[table]
driver = "acutrol3000"
port = "/dev/ttyUSB0"
[chamber]
driver = "weiss"
port = "/dev/ttyUSB2"
auxiliary = { 1 = "fog_1 case" }
[limits]
max_rate_dps = 20
min_temp_c = -50
[[gyro]]
name = "fog_1"
driver = "kvh1750"
port = "/dev/ttyUSB1"
rate_hz = 10
axis = "x"
unit = "FOG-001"
case_sensor = 1
[[gyro]]
name = "fog_2"
driver = "kvh1750"
port = "/dev/ttyUSB3"
rate_hz = 10
axis = "x"
unit = "FOG-002"
"""
CAMPAIGN = """
title = "Short turns"
[[unit]]
serial = "FOG-002"
[[unit]]
serial = "FOG-007"
gyro = "fog_1"
port = "/dev/ttyUSB9"
[[run]]
name = "turn"
procedure = "constant-rotation"
repeats = 2
parameters = { rate_dps = 12, turns = 2, rest_s = 10 }
[[run]]
name = "last"
procedure = "constant-rotation"
parameters = { rate_dps = -12, turns = 1, rest_s = 10 }
"""


@pytest.fixture(scope="session")
def texts():
    """The bench file and the campaign file."""
    return BENCH, CAMPAIGN


@pytest.fixture
def bench_path(tmp_path):
    path = tmp_path / "bench.toml"
    path.write_text(BENCH)
    return path


@pytest.fixture
def bench_file(bench_path):
    return load_bench_file(bench_path)


@pytest.fixture
def campaign_path(tmp_path):
    path = tmp_path / "campaign.toml"
    path.write_text(CAMPAIGN)
    return path


class Started(subprocess.Popen):
    """A process whose output goes to a file, so that nobody has to read while it works."""

    def __init__(self, path, words):
        self.path = path
        code = "import sys; from bench.present.cli import main; sys.argv[0] = 'gyrobench'; main()"
        with path.open("wb") as output:
            super().__init__(
                [sys.executable, "-c", code, *map(str, words)],
                stdin=subprocess.DEVNULL,
                stdout=output,
                stderr=subprocess.STDOUT,
                env={**os.environ, "COLUMNS": "300"},
                cwd=Path(__file__).parents[2],
            )

    def ended(self):
        """Wait for its end and return what it said."""
        self.wait()
        return self.path.read_text()


@pytest.fixture
def gyrobench(tmp_path):
    """Start the command line in a process of its own; killed with its test."""
    started = []

    def start(*words):
        started.append(Started(tmp_path / f"output-{len(started)}.txt", words))
        return started[-1]

    yield start
    for process in started:
        process.kill()
        process.wait()
