"""A run on an emulated lab in a process of its own: asks, turns, waits to be stopped.

Usage: python session.py RUNS_FOLDER [RUN_ID]. Prints the run's folder and its outcome.
"""

import sys
import tempfile
from pathlib import Path

from bench.control.live import Live
from bench.control.procedure import Demands, Parameters, Procedure, parameter
from bench.control.runner import RunRequest, run_procedure
from bench.lab.emulated import EmulatedLab, Plant
from bench.record.benchfile import load_bench_file

sys.path.insert(0, str(Path(__file__).parents[3]))  # also started as a script
from tests.benches import FOG_BENCH


class TurnParameters(Parameters):
    """A turn in a cooling chamber that lasts until somebody ends it."""

    hold_s: float = parameter(90 * 86_400.0, "time at rate", "s", ge=0)
    ask: bool = parameter(True, "wait for an operator first")
    picture: str = parameter("", "file of a picture to the question")


def turn(bench, p):
    with bench.step("1", "Prepare"):
        bench.phase("warm_up")
        bench.table.device.servo_on()
        bench.wait(30.0, "warming up")
        if p.ask:
            picture = Path(p.picture) if p.picture else None
            bench.ask("Mount the unit with its axis up and close the door. Ready?", picture=picture)
    with bench.step("2", "Turn"):
        bench.phase("turning")
        bench.chamber.go_to(-40.0, 2.0)
        bench.chamber.start()
        bench.table.spin(5.0)
        bench.wait(p.hold_s, "turning at 5 deg/s while the chamber cools")
        bench.table.stop()


TURN = Procedure(
    name="turn-until-stopped",
    title="A turn",
    source="tests",
    parameters=TurnParameters,
    run=turn,
    expected_duration_s=lambda p: p.hold_s,
    demands=lambda p: Demands(5.0, -40.0, 25.0, 2.0),
)


def main(runs: Path, run_id: str, **parameters) -> None:
    with tempfile.NamedTemporaryFile("w", suffix=".toml") as file:
        file.write(FOG_BENCH)
        file.flush()
        bench = load_bench_file(Path(file.name))
    with EmulatedLab(bench, Plant(seed=5)) as lab, Live() as live:
        request = RunRequest(
            TURN,
            TURN.parse(parameters),
            lab.file,
            runs,
            live,
            run_id=run_id,
            emulated={"seed": 5, "model": "test"},
            live=live,
        )
        result = run_procedure(request)
    sys.stdout.write(f"{result.folder} {result.outcome}\n")


if __name__ == "__main__":
    main(Path(sys.argv[1]), *sys.argv[2:3] or ["turn"], **dict(word.split("=", 1) for word in sys.argv[3:]))
