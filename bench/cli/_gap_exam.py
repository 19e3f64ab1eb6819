"""`gyrobench gap exam`: the blind exam of the diagnosis, its table and its reliability plot."""

from __future__ import annotations

import json
import tempfile
from collections import Counter
from collections.abc import Sequence
from pathlib import Path

from rich.console import Console

from bench.fan_out import FanOut, fan_out
from bench.gap import Marked, examine, reliability, shrinkage_quantiles, table
from drivers.errors import ConfigurationError

RESULTS_FILE = "results.jsonl"
TABLE_FILE = "table.md"
_BAR = 40


def gap_exam_command(
    cases: int, seed: int, out: Path | None, jobs: int | None = None, cluster: str | None = None
) -> None:
    """Hold a blind exam; print seals before answers, then the table."""
    if cases < 1 or seed < 0:
        raise ConfigurationError(
            "an exam needs cases", found=f"{cases} cases, seed {seed}", expected="at least 1"
        )
    with tempfile.TemporaryDirectory() as spare:
        folder = out or Path(spare)
        if (folder / RESULTS_FILE).exists():
            raise ConfigurationError(
                "the folder holds an exam already", where=str(folder), expected="a new folder"
            )
        folder.mkdir(parents=True, exist_ok=True)
        with fan_out(jobs, cluster) as fan:
            marked = _held(cases, seed, folder, fan)
    text = exam_text(marked, seed)
    if out is not None:
        (out / TABLE_FILE).write_text(text, encoding="utf-8")
    Console().print(text, highlight=False, markup=False, soft_wrap=True)


def _held(cases: int, seed: int, folder: Path, fan: FanOut) -> list[Marked]:
    console = Console()
    marked: list[Marked] = []
    try:
        for shown, one in examine(cases, seed, folder, fan):
            if one is None:
                console.print(f"{shown} sealed", style="dim", highlight=False)
                continue
            marked.append(one)
            console.print(f"{shown} {_line(one)}", highlight=False, soft_wrap=True)
            with (folder / RESULTS_FILE).open("a", encoding="utf-8") as lines:
                lines.write(json.dumps(_facts(one)) + "\n")
    except KeyboardInterrupt:
        if not marked:
            raise
        console.print(f"stopped after {len(marked)} of {cases} cases", style="yellow")
    return marked


def _line(one: Marked) -> str:
    case, answer = one.sealed.case, one.answer
    truth = " + ".join(case.effects) or case.stochastic or "nothing"
    said = " + ".join([*answer.causes, *answer.stochastic, *(["unknown"] if one.unknown else [])]) or "no gap"
    shares = f"{one.closed.stated.share:.3f} ({one.closed.true_share:.3f})"
    return f"SNR {case.snr:.2f} {truth} -> {said}; closed {shares} {one.seconds:.1f} s"


def _facts(one: Marked) -> dict[str, object]:
    case = one.sealed.case
    return {
        "seed": case.seed,
        "kind": case.kind,
        "effects": list(case.effects),
        "stochastic": case.stochastic,
        "snr": case.snr,
        "sha256": one.sealed.sha256,
        "causes": dict(one.answer.probabilities),
        "alternatives": {name: dict(own) for name, own in one.answer.alternatives.items()},
        "stochastic_named": list(one.answer.stochastic),
        "unknown": one.answer.unknown_probability,
        "placed": one.placed,
        "stated_share": [one.closed.stated.share, one.closed.stated.low, one.closed.stated.high],
        "true_share": one.closed.true_share,
        "seconds": one.seconds,
    }


def exam_text(marked: Sequence[Marked], seed: int) -> str:
    """Return the exam's result as Markdown: counts, table with Wilson intervals, reliability, time."""
    kinds = Counter(each.sealed.case.kind for each in marked)
    lines = [
        f"Seed {seed}, {len(marked)} cases: " + ", ".join(f"{n} {kind}" for kind, n in kinds.most_common()),
        "",
        "| | SNR | right | % | 95 % interval |",
        "|---|---|---|---|---|",
    ]
    for line in table(marked):
        low, high = line.interval
        lines.append(
            f"| {line.what} | {line.snr} | {line.right}/{line.of} | {100 * line.right / line.of:.1f} "
            f"| {100 * low:.0f}..{100 * high:.0f} |"
        )
    median, tenth = shrinkage_quantiles(marked)
    bins, error = reliability(marked)
    lines += [
        "",
        f"Shrinkage over the oracle's, SNR 1 and up: median {median:.3f}, 10th percentile {tenth:.3f}",
        "",
        f"Reliability (expected calibration error {error:.3f}): stated probability, came true, of how many",
        "",
        "```",
    ]
    for each in bins:
        came = each.true / each.count
        bar = "".join(
            "|" if k == round(each.stated * _BAR) else "#" if k < round(came * _BAR) else "."
            for k in range(_BAR + 1)
        )
        lines.append(f"stated {100 * each.stated:5.1f} %  true {100 * came:5.1f} %  {bar}  {each.count}")
    times = sorted(each.seconds for each in marked)
    lines += ["```", "", f"Seconds a case: median {times[len(times) // 2]:.1f}, longest {times[-1]:.1f}"]
    return "\n".join(lines) + "\n"
