"""Constants set on some families and judged on the one left out, in turn.

A case is prepared and searched once; then its sets are weighed again with one constant after the other changed.
What the first look drops stays dropped: for constants that act in both looks, this is the second one's part only.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from importlib import import_module
from pathlib import Path

from threadpoolctl import threadpool_limits

from bench.analysis.gap import Diagnosis, diagnosis_facts, read_model, read_recordings
from bench.analysis.gap._data import GapRun
from bench.analysis.gap._disturbed import lines_hz
from bench.analysis.gap._rate import RateSignal
from bench.analysis.gap._which import judged_sets, second_look
from benchmarks.gap_exam._answer import open_cases
from benchmarks.gap_exam._files import held_out_ids
from benchmarks.gap_exam._score import Marked, marked_cases
from benchmarks.gap_exam._table import share_text
from drivers.base.errors import BenchError
from drivers.base.files import replace_file

AS_IT_STANDS = "as it stands"
_FOLDER = "rotation"
_WHERE: Mapping[str, Sequence[str]] = {
    "MISFIT": ("_fit", "_which", "_judged"),
    "TOLERANCE": ("_judged",),
    "PREVALENT": ("_causes",),
    "_UNKNOWN_PRIOR": ("_judged",),
    "_FURTHER_MEMBER": ("_evidence",),
    "_LEAST_HELD": ("_rate",),
}
"""Constants, and the modules of the diagnosis that read them when the second look is weighed."""
_TRIED: Mapping[str, Sequence[float]] = {
    "MISFIT": (0.18, 0.35),
    "TOLERANCE": (0.25, 0.5),
    "PREVALENT": (0.4, 0.75),
    "_UNKNOWN_PRIOR": (2.0, 10.0),
    "_FURTHER_MEMBER": (0.0, 6.0),
    "_LEAST_HELD": (0.25, 0.7),
}
SETTINGS: dict[str, tuple[str, float] | None] = {
    AS_IT_STANDS: None,
    **{f"{name.strip('_').lower()} {value:g}": (name, value) for name in _TRIED for value in _TRIED[name]},
}


@contextmanager
def _changed(setting: tuple[str, float] | None) -> Iterator[None]:
    """Change a constant of the diagnosis for a while."""
    name, value = setting or ("", 0.0)
    modules = [import_module(f"bench.analysis.gap.{where}") for where in _WHERE.get(name, ())]
    before = [getattr(module, name) for module in modules]
    for module in modules:
        setattr(module, name, value)
    try:
        yield
    finally:
        for module, own in zip(modules, before, strict=True):
            setattr(module, name, own)


def rotate(folder: Path) -> Iterator[str]:
    """Answer a folder's cases under every setting, each into a folder of its own below; yield their names."""
    for setting in SETTINGS:
        below = _below(folder, setting)
        (below / "answers").mkdir(parents=True, exist_ok=True)
        for name in ("cases", "sealed", "nominal.toml"):
            if not (below / name).exists():
                (below / name).symlink_to((folder / name).resolve())
    for name in open_cases(_below(folder, list(SETTINGS)[-1])):
        with threadpool_limits(1):
            for setting, facts in _answers(folder, name):
                target = _below(folder, setting) / "answers" / f"{name}.json"
                replace_file(target, json.dumps(facts))
        yield name


def _below(folder: Path, setting: str) -> Path:
    return folder / _FOLDER / setting.replace(" ", "_")


def _answers(folder: Path, name: str) -> Iterator[tuple[str, dict[str, object]]]:
    case = folder / "cases" / name
    model = read_model(folder / "nominal.toml")
    try:
        given = read_recordings([case / "runs.toml"], [Path(run_id) for run_id in held_out_ids(case)])
        runs, held_out = (
            [run for run in part if isinstance(run, GapRun)] for part in (given.runs, given.held_out)
        )
        signal = RateSignal()
        ready = signal.prepare(runs, model)
        named_hz = lines_hz((*model.disturbances, *ready.disturbed.terms))
        first = judged_sets(ready.data, model, ready.variants, lines_hz=named_hz)
        variants, again = second_look(first, model, ready.variants)
        for setting, changed in SETTINGS.items():
            with _changed(changed):
                sets = judged_sets(again, model, variants, first.hidden, named_hz), variants
                found = signal.judged(signal.finding(ready, sets), ready, sets, held_out)
            diagnosis = Diagnosis(runs[0].unit_id, found.model, (found,), {})
            yield setting, {"facts": diagnosis_facts(diagnosis), "error": "", "seconds": 0.0}
    except BenchError as refusal:
        for setting in SETTINGS:
            yield setting, {"facts": {}, "error": str(refusal), "seconds": 0.0}


def wholly_right(case: Marked) -> bool:
    """Return whether all that acts is named, or called unknown where it has no name, and nothing else."""
    if case.kind == "null":
        return not case.alarmed
    if case.kind in ("single", "pair"):
        return case.exact
    seen = case.answer.unknown or case.answer.differs
    return seen and all(case.found.values()) and all(case.right)


def _value(cases: Sequence[Marked]) -> int:
    return sum(wholly_right(case) - case.false_cause for case in cases)


def rotation_table(folders: Sequence[Path]) -> list[str]:
    """Return a row a family left out: the setting that is best on the others, and what it does on this one."""
    marks: dict[str, dict[str, list[Marked]]] = {}
    for folder in folders:
        name = folder.resolve().name
        marks[name] = {
            setting: [case for case in marked_cases(_below(folder, setting)) if case.kind != "noise"]
            for setting in SETTINGS
        }
    lines = [
        "| left out | best on the others | right with it | right as it stands | false cause with it "
        "| as it stands |",
        "|---|---|---|---|---|---|",
    ]
    total: dict[str, list[bool]] = {key: [] for key in ("right", "stands", "false", "false stands")}
    for name, own in marks.items():
        values = {
            setting: sum(_value(theirs[setting]) for other, theirs in marks.items() if other != name)
            for setting in SETTINGS
        }
        best = max(SETTINGS, key=lambda setting: (values[setting], setting == AS_IT_STANDS))
        cells = {
            "right": [wholly_right(case) for case in own[best]],
            "stands": [wholly_right(case) for case in own[AS_IT_STANDS]],
            "false": [case.false_cause for case in own[best]],
            "false stands": [case.false_cause for case in own[AS_IT_STANDS]],
        }
        for key, some in cells.items():
            total[key] += some
        lines.append(f"| {name} | {best} | " + " | ".join(share_text(some) for some in cells.values()) + " |")
    lines.append("| all | | " + " | ".join(share_text(some) for some in total.values()) + " |")
    lines += ["", "| setting | right | a false cause |", "|---|---|---|"]
    for setting in SETTINGS:
        cases = [case for own in marks.values() for case in own[setting]]
        right = share_text([wholly_right(case) for case in cases])
        lines.append(f"| {setting} | {right} | {share_text([case.false_cause for case in cases])} |")
    return lines
