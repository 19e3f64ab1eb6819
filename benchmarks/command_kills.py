"""SIGKILLs at random moments of the commands that make results: what is left is whole, what is repeated works.

Run as `python -m benchmarks.command_kills [KILLS] [SEED]`; writes its section of benchmarks/reliability.md. Every
kill strikes a process of its own that runs a `gyrobench` command: fits of six kinds, `gap close`, `report`,
`runs recover`, and a campaign on emulated labs. The process is forked with everything imported: the kernel ends
it like any other, and no kill is spent on the seconds of imports, where a command has touched nothing yet. Every
other kill comes at any moment of the command, the rest from when the first file of a result appears; a fit begins
beside the complete result of other runs.

Judged afterwards: a file with a final name is that of the earlier result or the one that the undisturbed command
makes (time stamps and paths aside), never a part of it; files of two results do not lie side by side; the run
folders and logs that were read are what they were; and the same command, given again, ends well with the whole
result. A campaign is resumed: every run is then there once, whole.
"""

from __future__ import annotations

import hashlib
import os
import random
import re
import shutil
import signal
import sys
import tempfile
import zipfile
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from importlib import import_module
from pathlib import Path

import numpy as np

from bench.analysis.gap import Model, Noise, model_text
from bench.analysis.gap._exam import nominal_model
from bench.campaign import CampaignFolder
from bench.control.procedure import find_procedure
from bench.control.questions import EmulatedOperator
from bench.control.recover import recover
from bench.control.run_record import decode_run
from bench.control.runner import RunRequest, run_procedure
from bench.lab.emulated import EmulatedLab, Plant
from bench.present.cli import main as bench_main
from bench.record.benchfile import BenchFile, bench_file_from
from bench.record.recording import read_manifest, verify
from benchmarks._heading_plants import CALIBRATIONS, fly
from benchmarks._sections import write_section
from drivers.base.clock import WallClock
from drivers.base.errors import BenchError
from simulators.plant.space_stable import draw_platform

_LOOK_S = 0.002
_COMMANDS = ("campaign", "fit", "gap", "_report", "_runs")
_GYRO = {"name": "fog_1", "driver": "kvh1750", "port": "pty", "rate_hz": 10, "axis": "x", "unit": "F1"}
_FILE = {
    "bench": {"name": "kills of commands", "latitude_deg": 40.0},
    "table": {"driver": "acutrol3000", "port": "pty-table"},
    "chamber": {"driver": "weiss", "port": "pty-chamber", "auxiliary": {"1": "fog_1 case"}},
    "gyro": [_GYRO | {"case_sensor": 1}],
}
_SHOCK = {"soak_min": 20, "hold_min": 15, "east_after_min": 10, "east_dwell_s": 300, "warm_up_min": 40}
_BENCH_TOML = """
[bench]
name = "kills of commands"
latitude_deg = 40.0
[table]
driver = "acutrol3000"
port = "/nowhere/table"
[chamber]
driver = "weiss"
port = "/nowhere/chamber"
[[gyro]]
name = "fog_1"
driver = "kvh1750"
port = "/nowhere/fog"
rate_hz = 10
axis = "x"
unit = "F1"
"""
_CAMPAIGN_TOML = """
title = "Short turns"
[[unit]]
serial = "F1"
[[run]]
name = "turn"
procedure = "constant-rotation"
repeats = 3
parameters = { rate_dps = 12, turns = 2, rest_s = 10 }
"""
_RECORDINGS = """
format = 1
unit_id = "G7"
latitude_deg = 39.1
[columns]
time = { name = "t", unit = "s" }
output = { name = "rate", unit = "deg/h" }
t_in = { name = "t_in", unit = "degC" }
t_out = { name = "t_out", unit = "degC" }
"""

Result = dict[str, str]
"""Name of a file with a final name -> what identifies its content."""


@dataclass(frozen=True)
class Kind:
    """A command: its words without and with the folder (or file) of its result, for two results of it."""

    name: str
    words: tuple[tuple[str, ...], tuple[str, ...]]
    reads: Path
    out: str = "out"
    """Name of what `--out` gets in the folder of a case."""


@dataclass
class Tally:
    """What became of the killed commands."""

    kills: Counter[str] = field(default_factory=Counter)
    left: Counter[str] = field(default_factory=Counter)
    """By what lay there after the kill."""
    problems: list[str] = field(default_factory=list)


class _Command:
    """A `gyrobench` command in a process of its own that begins with everything imported.

    A new interpreter imports for most of its life, where a kill finds nothing to break.
    """

    def __init__(self, words: Sequence[str], said: Path) -> None:
        self.returncode: int | None = None
        self.pid = os.fork()
        if self.pid == 0:
            self._work(words, said)

    @staticmethod
    def _work(words: Sequence[str], said: Path) -> None:
        code = 99
        try:
            output = os.open(said, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o644)
            os.dup2(os.open(os.devnull, os.O_RDONLY), 0)
            os.dup2(output, 1)
            os.dup2(output, 2)
            sys.argv = ["gyrobench", *words]
            bench_main()
            code = 0
        except SystemExit as ended:
            code = ended.code if isinstance(ended.code, int) else int(ended.code is not None)
        finally:
            sys.stdout.flush()
            os._exit(code)

    def poll(self) -> int | None:
        """Return the exit code once there is one."""
        if self.returncode is None:
            pid, status = os.waitpid(self.pid, os.WNOHANG)
            self.returncode = os.waitstatus_to_exitcode(status) if pid else None
        return self.returncode

    def wait(self) -> int:
        """Wait for the end; return the exit code."""
        if self.returncode is None:
            self.returncode = os.waitstatus_to_exitcode(os.waitpid(self.pid, 0)[1])
        return self.returncode

    def kill(self) -> None:
        """Send SIGKILL, if it has not ended."""
        if self.poll() is None:
            os.kill(self.pid, signal.SIGKILL)


def _start(words: Sequence[str], said: Path) -> _Command:
    return _Command(words, said)


def _identify(path: Path) -> str:
    """Return what identifies a file's content, times and places aside; it must be whole to have one."""
    content = path.read_bytes()
    if zipfile.is_zipfile(path):
        with zipfile.ZipFile(path) as archive:
            content = b"".join(name.encode() + archive.read(name) for name in sorted(archive.namelist()))
    elif path.suffix == ".html" and not content.rstrip().endswith(b"</html>"):
        return "torn"
    content = re.sub(rb"\d{4}-\d\d-\d\d[T ]\d\d:\d\d(:[\d.]+)?(Z|\+00:00| UTC)?", b"TIME", content)
    content = re.sub(
        rb"[0-9a-f]{64}", b"SHA", content
    )  # a file that has a time in it has another one each time
    return hashlib.sha256(content).hexdigest()


def _result(out: Path) -> Result:
    files = [out] if out.is_file() else sorted(out.rglob("*")) if out.is_dir() else []
    return {
        path.name: _identify(path)
        for path in files
        if path.is_file() and not any(part.endswith(".part") for part in path.parts)
    }


def _tree(folder: Path) -> dict[str, str]:
    return {
        str(path.relative_to(folder)): hashlib.sha256(path.read_bytes()).hexdigest()
        for path in sorted(folder.rglob("*"))
        if path.is_file()
    }


class Commands:
    """Kills commands of the kinds in `root` and judges what they left."""

    def __init__(self, root: Path, seed: int) -> None:
        self._root, self._moments = root, random.Random(seed)
        self._clock = WallClock()
        self._number = 0
        self.tally = Tally()
        self._known: dict[tuple[str, int], tuple[Result, float, float]] = {}

    def _undisturbed(self, kind: Kind, which: int) -> tuple[Result, float, float]:
        """Return what the command makes, how long it takes, and how long from the first sign of a result, s."""
        if (kind.name, which) not in self._known:
            folder = self._folder()
            begin_s = self._clock.now()
            process = _start([*kind.words[which], "--out", str(folder / kind.out)], folder / "said.txt")
            seen_s = self._await_result(process, folder)
            process.wait()
            end_s = self._clock.now()
            if process.returncode != 0:
                raise RuntimeError(f"{kind.name}: {(folder / 'said.txt').read_text()}")
            known = (_result(folder / kind.out), end_s - begin_s, end_s - seen_s)
            self._known[kind.name, which] = known
        return self._known[kind.name, which]

    def _folder(self) -> Path:
        self._number += 1
        folder = self._root / f"case-{self._number}"
        folder.mkdir()
        return folder

    def _await_result(self, process: _Command, folder: Path) -> float:
        """Wait until anything in the case's folder changes but what the command says; return the time."""
        before = _names(folder)
        while process.poll() is None and _names(folder) == before:
            self._clock.sleep(_LOOK_S)
        return self._clock.now()

    def kill(self, kind: Kind, late: bool) -> None:
        """Kill one process of the kind and judge."""
        old, new = self._undisturbed(kind, 0), self._undisturbed(kind, 1)
        folder = self._folder()
        earlier = self._root / f"earlier-{kind.name.replace(' ', '-')}"
        if not earlier.exists():
            earlier.mkdir()
            _start([*kind.words[0], "--out", str(earlier / kind.out)], folder / "said.txt").wait()
        shutil.rmtree(folder)
        shutil.copytree(earlier, folder)
        reads = _tree(kind.reads)
        words = [*kind.words[1], "--out", str(folder / kind.out)]
        process = _start(words, folder / "said.txt")
        if late:
            self._await_result(process, folder)
        self._clock.sleep(self._moments.uniform(0.0, new[2] if late else new[1]))
        process.kill()
        process.wait()
        ended = process.returncode == 0
        self.tally.kills[kind.name] += 1
        found = _result(folder / kind.out)
        wrong = {name for name, text in found.items() if text not in (old[0].get(name), new[0].get(name))}
        of_old = {name for name, text in found.items() if text != new[0].get(name)}
        of_new = {name for name, text in found.items() if text != old[0].get(name)}
        if wrong:
            self._problem(kind, f"torn: {sorted(wrong)}")
        elif of_old and of_new:
            self._problem(kind, f"of two results: {sorted(of_old)}, {sorted(of_new)}")
        if of_new and not of_old:
            whole = found == new[0]
            self.tally.left["the new result" if whole else "part of the files of the new result"] += 1
        else:
            whole = found == old[0]
            self.tally.left["the earlier result" if whole else "part of the files of the earlier result"] += 1
        again = _start(words, folder / "said.txt")
        if again.wait() != 0 or _result(folder / kind.out) != new[0]:
            self._problem(kind, f"again: code {again.returncode}, {(folder / 'said.txt').read_text()[-300:]}")
        if any(path.name.endswith(".part") for path in folder.rglob("*")):
            self._problem(kind, "remains after the command was given again")
        if _tree(kind.reads) != reads:
            self._problem(kind, f"changed what it reads{' (ended)' if ended else ''}")
        shutil.rmtree(folder)

    def kill_recover(self, torn: Path, late: bool) -> None:
        """Kill `runs recover` of a run that was never closed; recovering again completes it."""
        folder = self._folder()
        shutil.copytree(torn, folder / "run")
        raw = _tree(folder / "run" / "raw")
        begin_s = self._clock.now()
        if "recover" not in {name for name, _ in self._known}:
            process = _start(["runs", "recover", str(folder / "run")], folder / "said.txt")
            seen_s = self._await_result(process, folder)
            process.wait()
            end_s = self._clock.now()
            self._known["recover", 0] = ({}, end_s - begin_s, end_s - seen_s)
            shutil.rmtree(folder)
            shutil.copytree(torn, folder / "run")
        _, whole_s, tail_s = self._known["recover", 0]
        process = _start(["runs", "recover", str(folder / "run")], folder / "said.txt")
        if late:
            self._await_result(process, folder)
        self._clock.sleep(self._moments.uniform(0.0, tail_s if late else whole_s))
        process.kill()
        process.wait()
        self.tally.kills["runs recover"] += 1
        try:
            before = read_manifest(folder / "run")
            if before.complete and verify(folder / "run", decode_run).problems:
                raise BenchError("reads complete and is not", where=str(folder))
            self.tally.left["a sealed run" if before.complete else "a run still to be recovered"] += 1
            manifest = recover(folder / "run")
            problems = verify(folder / "run", decode_run).problems
            if manifest.outcome != "aborted" or problems:
                raise BenchError(str(problems), where=str(folder))
        except BenchError as error:
            self.tally.problems.append(f"runs recover: {error}")
        if _tree(folder / "run" / "raw") != raw:
            self.tally.problems.append("runs recover: the raw bytes are not what they were")
        shutil.rmtree(folder)

    def kill_campaign(self, campaign: Path, bench: Path) -> None:
        """Kill `campaign run`, and the first `resume` too; the second completes it."""
        folder = self._folder()
        out, said = folder / "out", folder / "said.txt"
        first = ["campaign", "run", str(campaign), "--bench", str(bench), "--out", str(out), "--emulated"]
        first += ["--yes"]
        if "campaign" not in {name for name, _ in self._known}:
            begin_s = self._clock.now()
            if _start(first, said).wait() != 0:
                raise RuntimeError(said.read_text())
            self._known["campaign", 0] = ({}, self._clock.now() - begin_s, 0.0)
            shutil.rmtree(folder)
            folder.mkdir()
        whole_s = self._known["campaign", 0][1]
        for words in (first, ["campaign", "resume", str(out)]):
            process = _start(words, said)
            self._clock.sleep(self._moments.uniform(0.0, whole_s))
            process.kill()
            process.wait()
            self.tally.kills["campaign run" if words is first else "campaign resume"] += 1
            for manifest in out.glob("runs/*/manifest.json"):
                if read_manifest(manifest.parent).complete:
                    problems = verify(manifest.parent, decode_run).problems
                    self.tally.problems += [
                        f"campaign: {problem.path}: {problem.text}" for problem in problems
                    ]
        if not (out / "campaign.toml").exists():  # killed before it had begun: begun again
            self.tally.left["no campaign yet"] += 1
            shutil.rmtree(out, ignore_errors=True)
            last = _start(first, said)
        else:
            self.tally.left["a campaign to resume, or a complete one"] += 1
            last = _start(["campaign", "resume", str(out)], said)
        text = f"code {last.wait()}: {said.read_text()[-300:]}"
        states = [state.state for state in CampaignFolder(out).states(thorough=True)] if out.exists() else []
        if last.returncode != 0 or states != ["done"] * 3:
            self.tally.problems.append(f"campaign: {states}, {text}")
        shutil.rmtree(folder)

    def _problem(self, kind: Kind, text: str) -> None:
        self.tally.problems.append(f"{kind.name}: {text}")


def _names(folder: Path) -> set[tuple[str, int, int]]:
    found = set()
    for place, _, names in os.walk(folder):
        for name in names:
            if name != "said.txt":
                try:
                    about = (Path(place) / name).stat()
                except FileNotFoundError:
                    continue
                found.add((f"{place}/{name}", about.st_mtime_ns, about.st_size))
    return found


def _run(file: BenchFile, runs: Path, procedure: str, plant: Plant, **values: float) -> Path:
    found = find_procedure(procedure)
    with EmulatedLab(file, plant) as lab:
        parameters = found.parse(values)
        request = RunRequest(
            found,
            parameters,
            lab.file,
            runs,
            EmulatedOperator(lab.perform),
            run_id=f"{procedure}-{plant.seed}",
        )
        result = run_procedure(request)
    if result.outcome != "completed":
        raise RuntimeError(result.reason)
    return result.folder


def prepare(root: Path) -> list[Kind]:
    """Make the runs and logs that the commands read; return the kinds."""
    reads = root / "reads"
    reads.mkdir()
    makers = (_cold_shock, _stepwise, _standard_test, _whirl, _cycle, _heading, _gap, _report)
    kinds = []
    for make in makers:
        kinds.append(make(reads))
        print(f"inputs of {kinds[-1].name} are made", flush=True)
    return kinds


def _cold_shock(reads: Path) -> Kind:
    file = bench_file_from(_FILE)
    plants = [Plant(seed=seed) for seed in (1, 2, 3)]
    runs = [str(_run(file, reads / "shocks", "zero-bias-cold-shock", plant, **_SHOCK)) for plant in plants]

    def words(a: str, b: str, c: str) -> tuple[str, ...]:
        names = "poly3,lag_ridge"
        return ("fit", "cold-shock", a, "--validate", b, "--test", c, "--models", names, "--jobs", "1")

    return Kind("fit cold-shock", (words(*runs), words(runs[1], runs[2], runs[0])), reads / "shocks")


def _stepwise(reads: Path) -> Kind:
    gyro = {"name": "rlg_1", "driver": "rlg2t", "port": "pty", "rate_hz": 10, "axes": "x", "axis": "x"}
    chamber = {"driver": "weiss", "port": "pty-chamber", "simserv": True}
    file = bench_file_from({**_FILE, "chamber": chamber, "gyro": [gyro | {"unit": "R1"}]})
    values = {"low_c": 0.0, "high_c": 30.0, "ramp_k_per_min": 2.0, "dwell_min": 5.0, "warm_up_min": 0.0}
    runs = [
        str(_run(file, reads / "ramps", "thermal-ramp", Plant(seed=seed), **values, search_east=False))
        for seed in (1, 2)
    ]
    a, b = (("fit", "stepwise", first, "--test", second) for first, second in (runs, runs[::-1]))
    return Kind("fit stepwise", (a, b), reads / "ramps")


def _standard_test(reads: Path) -> Kind:
    file = bench_file_from(_FILE)
    values = {
        "warm_up_min": 10.0,
        "bias_min": 10.0,
        "noise_h": 0.5,
        "step_dwell_s": 60.0,
        "east_dwell_s": 60.0,
        "power_cycles": 0,
    }
    values |= {"rates_per_sign": 2, "sequences": 1, "rate_dwell_s": 10.0, "temperatures": False}
    runs = [
        str(_run(file, reads / "standard", "standard-test", Plant(seed=seed), **values)) for seed in (1, 2)
    ]
    words = tuple(("fit", "standard-test", run) for run in runs)
    return Kind("fit standard-test", (words[0], words[1]), reads / "standard", "standard-test.html")


def _whirl(reads: Path) -> Kind:
    gyro = {**_GYRO, "axis": "z", "axes": "xyz", "rate_hz": 100}
    file = bench_file_from({**_FILE, "gyro": [gyro]})
    values = {"turns": 12.0, "reversals": 3}
    plants = [Plant(seed=seed, models={"F1": "ins_triad"}) for seed in (1, 2)]
    runs = [str(_run(file, reads / "turns", "constant-rotation", plant, **values)) for plant in plants]
    a, b = (("fit", "whirl", first, "--test", second) for first, second in (runs, runs[::-1]))
    return Kind("fit whirl", (a, b), reads / "turns")


def _cycle(reads: Path) -> Kind:
    folder, words = reads / "cycles", []
    folder.mkdir()
    for seed in (1, 2):
        rng = np.random.default_rng(seed)
        temp = np.concatenate([np.linspace(50, -20, 3000), np.linspace(-20, 48, 3000)])
        rates = [k * 1e-4 * temp + rng.normal(0.0, 1e-4, 6000) for k in (1, 2, 3)]
        heads = "imu.temperature\timu.gyro.x\timu.gyro.y\timu.gyro.z"
        log = folder / f"cycle-{seed}.csv"
        np.savetxt(log, np.column_stack([temp, *rates]), delimiter="\t", header=heads, comments="")
        words.append(("fit", "chamber-cycle", str(log)))
    return Kind("fit chamber-cycle", (words[0], words[1]), folder, "cycle.html")


def _heading(reads: Path) -> Kind:
    folder, words = reads / "headings", []
    folder.mkdir()
    for seed in (1, 2):
        log = fly(draw_platform(11, latitude_deg=0.0), seed, CALIBRATIONS["5+1"]).log
        columns = {
            "time_s": log.time_s,
            "latitude_deg": log.north_as / 3600.0,
            "longitude_deg": 100.0 + log.east_as / 3600.0,
            "temp_c": log.temp_c,
            "heading_deg": log.heading_deg,
        }
        path = folder / f"log-{seed}.csv"
        table = np.column_stack([np.asarray(column) for column in columns.values()])
        np.savetxt(path, table, delimiter=",", header=",".join(columns), comments="", fmt="%.12g")
        place = ("--latitude-deg", "0", "--longitude-deg", "100")
        words.append(("fit", "heading-effect", str(path), *place))
    return Kind("fit heading-effect", (words[0], words[1]), folder)


def _gap(reads: Path) -> Kind:
    folder, words = reads / "gaps", []
    folder.mkdir()
    nominal = nominal_model()
    (folder / "nominal.toml").write_text(
        model_text(Model("nominal", nominal.terms, Noise(0.004))), encoding="utf-8"
    )
    time_s = np.arange(1.0, 4001.0)
    temp_c = np.interp(time_s, [0, 1000, 1333, 2666, 3000], [25.0, 25.0, -40.0, -40.0, 25.0])
    for seed, cubic_dph in ((1, 0.5), (2, 0.8)):
        rng = np.random.default_rng(seed)
        text = _RECORDINGS
        for name in "ab":
            rate = 9.4860 + cubic_dph * ((temp_c - 25.0) / 50.0) ** 3 + rng.normal(0.0, 0.24, 4000)
            rows = np.column_stack((time_s, rate, temp_c, temp_c))
            path = folder / f"{name}{seed}.csv"
            np.savetxt(path, rows, delimiter=",", header="t,rate,t_in,t_out", comments="", fmt="%.5f")
            text += f'[[run]]\nfile = "{path.name}"\nprofile = "shock"\nelevation_deg = 90.0\n'
        (folder / f"runs-{seed}.toml").write_text(text, encoding="utf-8")
        words.append(
            ("gap", "close", str(folder / f"runs-{seed}.toml"), "--model", str(folder / "nominal.toml"))
        )
    return Kind("gap close", (words[0], words[1]), folder, "closed.toml")


def _report(reads: Path) -> Kind:
    runs = sorted(str(path.parent) for path in reads.glob("turns/*/manifest.json"))
    return Kind("report", (("report", runs[0]), ("report", runs[1])), reads / "turns", "report.html")


def _torn(root: Path, reads: Path) -> Path:
    """Return a run as a killed controller leaves it, from a sealed one."""
    torn = root / "torn"
    shutil.copytree(next(reads.glob("shocks/*-1")), torn)
    manifest = read_manifest(torn)
    for path in torn.glob("*.parquet"):
        path.unlink()
    left = manifest.model_copy(update={"outcome": "running", "files": {}, "ended_utc": "", "reason": ""})
    (torn / "manifest.json").write_text(left.model_dump_json(), encoding="utf-8")
    events = (torn / "events.jsonl").read_text(encoding="utf-8").splitlines(keepends=True)
    (torn / "events.jsonl").write_text("".join(events[:-1]), encoding="utf-8")
    return torn


def command_kills(root: Path, kills: int, seed: int) -> Iterator[Tally]:
    """Kill `kills` processes in turn over the kinds; yield the tally after each round."""
    kinds = prepare(root)
    torn = _torn(root, root / "reads")
    (root / "bench.toml").write_text(_BENCH_TOML, encoding="utf-8")
    (root / "campaign.toml").write_text(_CAMPAIGN_TOML, encoding="utf-8")
    for name in _COMMANDS:
        import_module(f"bench.present.cli.{name}")
    commands, number = Commands(root, seed), 0
    while commands.tally.kills.total() < kills:
        for kind in kinds:
            commands.kill(kind, late=number % 2 == 1)
        commands.kill_recover(torn, late=number % 2 == 1)
        if number % 4 == 0:
            commands.kill_campaign(root / "campaign.toml", root / "bench.toml")
        number += 1
        yield commands.tally


def main() -> int:
    """Kill, judge and write the section; 1 if a promise was broken."""
    kills = int(sys.argv[1]) if len(sys.argv) > 1 else 120
    seed = int(sys.argv[2]) if len(sys.argv) > 2 else 1
    tally = Tally()
    with tempfile.TemporaryDirectory() as root:
        os.environ["XDG_STATE_HOME"] = str(Path(root) / "state")
        for tally in command_kills(Path(root), kills, seed):
            print(f"{tally.kills.total()} of {kills}: {tally.problems}", flush=True)
    lines = [
        "Each in a process forked with everything imported: nothing can break among the imports.",
        "",
        "| | |",
        "|---|---|",
        f"| SIGKILLs of commands | {tally.kills.total()} |",
        *(f"| of these `{name}` | {count} |" for name, count in sorted(tally.kills.items())),
        *(f"| left behind: {what} | {count} |" for what, count in sorted(tally.left.items())),
        f"| files torn, results mixed, folders changed, repetitions failed | {len(tally.problems)} |",
        "",
        *(f"- {problem}" for problem in tally.problems[:10]),
    ]
    print(write_section("Kills of commands", f"python -m benchmarks.command_kills {kills} {seed}", lines))
    return 1 if tally.problems else 0


if __name__ == "__main__":
    sys.exit(main())
