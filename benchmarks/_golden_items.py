"""What a capture runs, in order: every item one command line, short parameters, fixed seeds.

Paths are relative to the capture's work folder: `examples` is a copy of the checkout's, `inputs` is derived from
them, `runs/<item>` is a run folder, `out` what the other commands write.
"""

from __future__ import annotations

import hashlib
import json
import re
import shutil
import tomllib
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

After = Callable[[Path], None]


@dataclass(frozen=True)
class Item:
    """A command: its line, the paths it makes, what is done to the work folder before and after.

    `run` is the name that the one run folder it records is given; `lab` the line of an emulated lab that serves
    meanwhile, which has begun when the file that --write names is there.
    """

    name: str
    line: str
    makes: tuple[str, ...] = ()
    run: str = ""
    before: After | None = None
    after: After | None = None
    lab: str = ""


_QUICK = {"soak_min": 5, "hold_min": 10, "warm_up_min": 0, "drift_k_per_10min": 2}
_EAST = {"east_after_min": 0, "east_dwell_s": 60}
_CAMPAIGN_RUNS = ("train-1", "train-sf-1", "choose", "choose-sf", "judge-deeper")
_EXAM_CASES = 40
_CASES_KEPT = 2


def derive_inputs(work: Path) -> None:
    """Write the files that the commands read, made from the examples alone."""
    examples, inputs = work / "examples", work / "inputs"
    inputs.mkdir(exist_ok=True)
    demo = (examples / "demo.toml").read_text(encoding="utf-8")
    one_gyro = "[[gyro]]".join(demo.split("[[gyro]]")[:2]).replace(', 2 = "ellipse_1 case"', "")
    (inputs / "fog.toml").write_text(one_gyro, encoding="utf-8")
    whole = tomllib.loads((examples / "cold_shock_campaign.toml").read_text(encoding="utf-8"))
    (inputs / "campaign.toml").write_text(_campaign(_shortened(whole)), encoding="utf-8")
    states = [
        {"name": f"at-{angle}", "procedure": "known-state", "parameters": {"angle_deg": angle}}
        for angle in (0, 90)
    ]
    (inputs / "states.toml").write_text(_campaign({"title": "Two states", "run": states}), encoding="utf-8")
    (inputs / "limits.toml").write_text('[limits."bias"]\nunit = "deg/h"\nlow = -1.0\nhigh = 1.0\n', "utf-8")
    (inputs / "log.csv").write_text(_log(), encoding="utf-8")
    (inputs / "map.toml").write_text(_MAPPING, encoding="utf-8")
    (inputs / "cycle.csv").write_text(_cycle(), encoding="utf-8")


def _shortened(campaign: Mapping[str, Any]) -> dict[str, Any]:
    """Return the example campaign with one run of each kind, as short as the procedures allow."""
    runs = [dict(run) for run in campaign["run"] if run["name"] in _CAMPAIGN_RUNS]
    for run in runs:
        own = run["parameters"] | _QUICK
        run["parameters"] = own | (_EAST if run["procedure"] == "zero-bias-cold-shock" else {})
    return {**campaign, "run": runs}


def _campaign(campaign: Mapping[str, Any]) -> str:
    """Return a campaign as TOML; its scalars look in TOML as in JSON."""
    lines = [f"{key} = {json.dumps(value)}" for key, value in campaign.items() if key != "run"]
    for run in campaign["run"]:
        lines += ["", "[[run]]"]
        for key, value in run.items():
            pairs = value.items() if isinstance(value, dict) else ()
            inline = ", ".join(f"{name} = {json.dumps(one)}" for name, one in pairs)
            lines.append(f"{key} = {{ {inline} }}" if inline else f"{key} = {json.dumps(value)}")
    return "\n".join(lines) + "\n"


_MAPPING = """format = 1
unit_id = "SN123"
latitude_deg = 48.0
[columns]
time = { name = "t", unit = "s" }
output = { name = "rate", unit = "deg/h" }
t_in = { name = "temp", unit = "degC" }
t_out = { name = "case", unit = "degC" }
[[run]]
file = "log.csv"
profile = "cold-shock"
elevation_deg = 0
angle_deg = 90
azimuth_error_deg = 0
started_utc = "2026-10-05T08:00:00+00:00"
phases = [{ name = "equilibrium", start_s = 0 }, { name = "reference", start_s = 600 }]
"""


def _log() -> str:
    """Return a log of another bench: a temperature that falls, a rate that follows it."""
    rows = ["t,rate,temp,case"]
    for k in range(3600):
        noise = (k * 7919 % 1009) / 1009 - 0.5
        temp = 25.0 - max(0, k - 1200) * 0.02
        rows.append(f"{k},{11.6 + 0.01 * (temp - 25.0) + 0.2 * noise:.6f},{temp:.3f},{temp - 0.3:.3f}")
    return "\n".join(rows) + "\n"


def _cycle() -> str:
    """Return a chamber cycle of three axes: down, up and down again."""
    rows = ["imu.gyro.x\timu.gyro.y\timu.gyro.z\timu.temperature"]
    for k in range(9000):
        leg, step = divmod(k, 3000)
        temp = 60.0 - step * 0.03 if leg % 2 == 0 else -30.0 + step * 0.03
        noise = (k * 7919 % 1009) / 1009 - 0.5
        rates = (0.01 * temp + noise, 0.002 * temp**2 / 60 + noise, 0.3 + noise)
        rows.append("\t".join(f"{value:.6f}" for value in (*rates, temp)))
    return "\n".join(rows) + "\n"


def _set(values: Mapping[str, object]) -> str:
    return " ".join(f"--set {name}={value}" for name, value in values.items())


def _rehearsal(name: str, what: str, seed: int, parameters: Mapping[str, object], more: str = "") -> Item:
    """Return the item of a rehearsed run; `what` is its procedure and its bench."""
    procedure, bench = what.split()
    line = f"rehearse {procedure} --bench {bench} --seed {seed} --runs runs/{name}.new --json"
    return Item(f"rehearse-{name}", f"{line} {_set(parameters)} {more}", (f"runs/{name}",), run=name)


def _thin_exam(work: Path) -> None:
    """Put checksums in place of the recordings of most cases: they are 3 MB each."""
    for case in sorted((work / "out/exam/cases").iterdir())[_CASES_KEPT:]:
        tables = sorted(case.glob("*.parquet"))
        sums = {path.name: hashlib.sha256(path.read_bytes()).hexdigest() for path in tables}
        (case / "sums.json").write_text(json.dumps(sums, indent=1), encoding="utf-8")
        for path in tables:
            path.unlink()


def _lose_last_run(work: Path) -> None:
    """Leave the campaign as a bench does that lost its last record: `resume` has to make it again."""
    shutil.rmtree(work / "out/states/runs/at-90")


def _crashed_copy(work: Path) -> None:
    """Copy a run and take from it what its end had written."""
    copy = work / "runs/crashed"
    shutil.copytree(work / "runs/rotation-2", copy)
    for path in [*copy.glob("*.parquet"), *copy.glob("*.html"), *copy.glob("*.npz")]:
        path.unlink()
    text = re.sub(r"127\.0\.0\.1:\d+", "127.0.0.1:9", (copy / "manifest.json").read_text(encoding="utf-8"))
    for number, port in enumerate(dict.fromkeys(re.findall(r"/dev/pts/\d+\b", text))):
        text = re.sub(rf"{port}\b", f"/dev/golden{number}", text)
    manifest = json.loads(text)  # its ports are those of no emulated lab that runs on this machine
    manifest |= {"outcome": "running", "ended_utc": None, "duration_s": None, "files": {}}
    (copy / "manifest.json").write_text(json.dumps(manifest, indent=2), encoding="utf-8")
    events = (copy / "events.jsonl").read_text(encoding="utf-8").splitlines(keepends=True)
    (copy / "events.jsonl").write_text("".join(events[:-1]), encoding="utf-8")


_TURN = {"turns": 8, "reversals": 2}
_PLANT = "--plant examples/ins_plant.toml"
_RAMP = {"dwell_min": 10, "warm_up_min": 10, "east_dwell_s": 60}
_HEADINGS = {"headings_deg": "0,90,180,270", "stays_h": "50,24,24,24", "warm_up_h": 20, "telemetry_s": 60}
_STANDARD = {
    "warm_up_min": 10, "bias_min": 10, "noise_h": 0.5, "step_dwell_s": 60, "power_cycles": 1,
    "east_dwell_s": 60, "off_s": 5,
    "rates_per_sign": 2, "sequences": 1, "rate_dwell_s": 10, "temperatures": "false",
}  # fmt: skip
_SHOCKS = "out/campaign/runs"


def items() -> tuple[Item, ...]:
    """Return everything that is captured, what others read first."""
    return (*_texts(), *_recordings(), *_looks(), *_campaigns(), *_fits(), *_schemes(), *_gaps())


def _texts() -> tuple[Item, ...]:
    """Commands that read no run."""
    procedures = (
        "zero-bias-cold-shock", "scale-factor-cold-shock", "thermal-ramp", "standard-test",
        "constant-rotation", "heading-change", "system-calibration", "known-state",
    )  # fmt: skip
    return (
        Item("procedures", "procedures"),
        *(Item(f"procedures-{name}", f"procedures {name}") for name in procedures),
        Item("frames-list", "frames list"),
        Item("frames-check", "frames check examples/imu_increments.toml"),
        Item("can-list", "can list"),
        Item("can-check", "can check xsens_mti"),
    )


def _recordings() -> tuple[Item, ...]:
    """A run of every example bench, an imported one, and one by `run` on a served lab."""
    rotation, ramp = "constant-rotation examples/ins.toml", "thermal-ramp examples/rlg.toml"
    steeper = _RAMP | {"ramp_k_per_min": 4, "downwards": "true"}
    calibration = {"dwell_s": 20, "warm_up_min": 0}
    return (
        _rehearsal("shock", "zero-bias-cold-shock inputs/fog.toml", 1, _QUICK | _EAST),
        _rehearsal("standard", "standard-test inputs/fog.toml", 1, _STANDARD),
        _rehearsal("state", "known-state examples/lab.toml", 1, {}),
        _rehearsal("rotation-1", rotation, 1, _TURN, _PLANT),
        _rehearsal("rotation-2", rotation, 2, _TURN, _PLANT),
        _rehearsal("turning-fog", "constant-rotation inputs/fog.toml", 3, {"turns": 4, "reversals": 1}),
        _rehearsal("ramp-1", ramp, 1, _RAMP | {"ramp_k_per_min": 2}),
        _rehearsal("ramp-2", ramp, 2, steeper),
        _rehearsal("heading", "heading-change examples/platform.toml", 1, _HEADINGS),
        _rehearsal("calibration", "system-calibration examples/two_axis.toml", 1, calibration),
        Item(
            "run-on-lab",
            "run constant-rotation --bench out/served.toml --runs runs/served.new --yes --json "
            + _set({"turns": 1, "rest_s": 20}),
            ("runs/served", "out/served.toml"),
            run="served",
            lab="lab --bench inputs/fog.toml --seed 4 --virtual --write out/served.toml",
        ),
        Item(
            "import",
            "import inputs/log.csv --mapping inputs/map.toml --out runs/imported.new",
            ("runs/imported",),
            run="imported",
        ),
    )


def _looks() -> tuple[Item, ...]:
    """Everything that reads runs, tells of them or writes them for others."""
    return (
        Item("runs-list", "runs list runs --json", ("runs/.catalogue",)),
        Item("runs-list-some", "runs list runs --procedure thermal-ramp --json"),
        Item("runs-show", "runs show runs/shock"),
        Item("runs-show-heading", "runs show runs/heading"),
        Item("runs-verify", "runs verify runs/shock runs/rotation-1 runs/heading runs/calibration"),
        Item("runs-recover", "runs recover runs/crashed", ("runs/crashed",), before=_crashed_copy),
        _export("csv", "rotation-1", "csv"),
        _export("parquet", "rotation-1", "parquet"),
        _export("mdf4", "rotation-1", "mdf4.mf4"),
        _export("blf", "state", "blf.blf"),
        Item("report", "report runs/shock --out out/report.html", ("out/report.html",)),
        Item(
            "report-certificate",
            "report runs/standard --limits inputs/limits.toml --out out/certificate.html",
            ("out/certificate.html",),
        ),
        Item(
            "frames-check-capture",
            "frames check examples/imu_increments.toml runs/calibration/raw/imu_1.bin --out out/frames --parquet",
            ("out/frames",),
        ),
        Item(
            "can-check-capture",
            "can check sbg_ellipse runs/state/raw/ellipse_1.bin --out out/can --parquet",
            ("out/can",),
        ),
    )


def _export(form: str, run: str, name: str) -> Item:
    out = f"out/export-{name}"
    return Item(f"runs-export-{form}", f"runs export runs/{run} --format {form} --out {out}", (out,))


def _campaigns() -> tuple[Item, ...]:
    """The example campaign shortened, rehearsed and fitted; a small one run, and resumed after a loss."""
    demo, fog = "--bench examples/demo.toml", "--bench inputs/fog.toml"
    return (
        Item("campaign-plan-quick", f"campaign plan examples/cold_shock_campaign.toml {demo} --quick --json"),
        Item("campaign-plan", f"campaign plan inputs/states.toml {fog} --seed 1 --json"),
        Item(
            "campaign-rehearse",
            f"campaign rehearse inputs/campaign.toml {demo} --seed 1 --jobs 1 --out out/campaign --json",
            ("out/campaign",),
        ),
        Item(
            "campaign-run",
            f"campaign run inputs/states.toml {fog} --seed 1 --emulated --yes --out out/states --json",
            ("out/states",),
        ),
        Item("campaign-status", "campaign status out/states --json"),
        Item("campaign-resume", "campaign resume out/states --yes --json", before=_lose_last_run),
        Item("campaign-status-resumed", "campaign status out/states --json"),
    )


def _fits() -> tuple[Item, ...]:
    shocks = (
        f"{_SHOCKS}/train-1 {_SHOCKS}/train-sf-1 --validate {_SHOCKS}/choose --validate {_SHOCKS}/choose-sf "
        f"--test {_SHOCKS}/judge-deeper --models grey_box,lag_ridge,multilinear,stepwise"
    )
    return (
        _fit("cold-shock", shocks),
        _fit("stepwise", "runs/ramp-1 --test runs/ramp-2"),
        _fit("chamber-cycle", "inputs/cycle.csv", ".html"),
        _fit("standard-test", "runs/standard", ".html"),
        _fit("whirl", "runs/rotation-1 --test runs/rotation-2"),
        _fit("heading-effect", "runs/heading"),
        _fit("calibration", "runs/calibration"),
    )


def _fit(kind: str, runs: str, ending: str = "") -> Item:
    out = f"out/fit-{kind}{ending}"
    return Item(f"fit-{kind}", f"fit {kind} {runs} --out {out}", (out,))


def _schemes() -> tuple[Item, ...]:
    return (
        Item("scheme-evaluate", "scheme evaluate 23-position --json"),
        Item("scheme-evaluate-bench", "scheme evaluate 19-position --bench examples/two_axis.toml --json"),
        Item(
            "scheme-search",
            "scheme search 8 --seed 1 --dwell-s 60 --out out/scheme.toml",
            ("out/scheme.toml",),
        ),
    )


def _gaps() -> tuple[Item, ...]:
    models = "examples/nominal"
    fog = f"{models}/fog_cold_shock.toml"
    return (
        Item(
            "gap-exam",
            f"gap exam --cases {_EXAM_CASES} --seed 7 --out out/exam",
            ("out/exam",),
            after=_thin_exam,
        ),
        Item("gap-exam-table", "gap exam --from out/exam"),
        _diagnosis("exam", "out/exam/cases/case_0001/runs.toml", "out/exam/nominal.toml"),
        _diagnosis("shocks", f"{_SHOCKS}/train-1 runs/shock --held-out {_SHOCKS}/choose", fog),
        _diagnosis("ramp", "runs/ramp-1 runs/ramp-2", f"{models}/rlg_ramp.toml"),
        _diagnosis("rotation", "runs/rotation-1", f"{models}/rotation_with_whirl.toml"),
        _diagnosis("calibration", "runs/calibration", f"{models}/multi_position.toml"),
        _diagnosis("heading", "runs/heading", f"{models}/heading_change.toml"),
        Item(
            "gap-close",
            f"gap close {_SHOCKS}/train-1 runs/shock --model {fog} --out out/closed.toml",
            ("out/closed.toml",),
        ),
        Item(
            "gap-rehearse",
            f"gap rehearse runs/turning-fog --model {fog} --closed out/closed.toml --seed 1 --runs out/gap-runs "
            "--json --report out/gap-rehearse.html",
            ("out/gap-runs", "out/gap-rehearse.html"),
        ),
    )


def _diagnosis(name: str, runs: str, model: str) -> Item:
    page = f"out/gap-{name}.html"
    return Item(
        f"gap-diagnose-{name}", f"gap diagnose {runs} --model {model} --json --report {page}", (page,)
    )
