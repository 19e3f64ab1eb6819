"""A runner for tests that kill it: spins the table of an emulated lab on the wall clock until it is ended."""

import json
import sys
from pathlib import Path

from bench.control.live import Live
from bench.control.procedure import Demands, Parameters, Procedure
from bench.control.questions import AssumeYes
from bench.control.runner import RunRequest, run_procedure
from bench.present.cli._console import Terminal
from bench.present.cli._display import RunDisplay
from bench.record.benchfile import bench_file_from
from drivers.base.clock import host_seconds


def turn(bench, _):
    bench.table.device.servo_on()
    bench.chamber.go_to(10.0)
    bench.chamber.start()
    bench.table.spin(10.0)
    if "no-other-watchdog" in sys.argv:
        sys.executable = "/bin/false"
    bench.note(f"{host_seconds()}")
    sys.stdout.write("turning\n")
    sys.stdout.flush()
    bench.wait(3600.0, "turning")


PROCEDURE = Procedure("turn", "A turn", "", Parameters, turn, lambda _: 3600.0, lambda _: Demands(10.0, 10.0))

if __name__ == "__main__":
    file = bench_file_from(json.loads(sys.stdin.readline()))
    with Live() as live, RunDisplay(Terminal(stderr=True, width=300), "turn", 3600.0) as display:
        request = RunRequest(
            PROCEDURE, Parameters(), file, Path(sys.argv[1]), AssumeYes(), display, "run", live=live
        )
        result = run_procedure(request)
    sys.stdout.write(f"{result.outcome}\n")
