"""A runner for tests that kill it: spins the table of an emulated lab on the wall clock until it is ended."""

import json
import sys
from pathlib import Path

from bench.control.procedure import Demands, Parameters, Procedure
from bench.control.questions import AssumeYes
from bench.control.runner import RunRequest, run_procedure
from bench.record.benchfile import bench_file_from


def turn(bench, _):
    bench.table.device.servo_on()
    bench.chamber.go_to(10.0)
    bench.chamber.start()
    bench.table.spin(10.0)
    sys.stdout.write("turning\n")
    sys.stdout.flush()
    bench.wait(3600.0, "turning")


PROCEDURE = Procedure("turn", "A turn", "", Parameters, turn, lambda _: 3600.0, lambda _: Demands(10.0, 10.0))

if __name__ == "__main__":
    file = bench_file_from(json.loads(sys.stdin.readline()))
    result = run_procedure(
        RunRequest(PROCEDURE, Parameters(), file, Path(sys.argv[1]), AssumeYes(), run_id="run")
    )
    sys.stdout.write(f"{result.outcome}\n")
