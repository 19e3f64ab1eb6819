"""`gyrobench gap exam`: the blind exam of the diagnosis, its table and its reliability plot."""

from __future__ import annotations

import json
import tempfile
from collections import Counter
from collections.abc import Sequence
from pathlib import Path

from bench.analysis.common.fan_out import FanOut, fan_out
from bench.analysis.gap import Marked, examine, reliability, shrinkage_quantiles, table
from bench.present.cli._console import Terminal
from drivers.base.errors import ConfigurationError

RESULTS_FILE = "results.jsonl"
TABLE_FILE = "table.md"
PLAN_FILE = "exam.json"
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
                "the folder holds an exam already",
                where=str(folder),
                expected="a new folder",
                remedy="--from FOLDER prints the table of an exam held before",
            )
        folder.mkdir(parents=True, exist_ok=True)
        (folder / PLAN_FILE).write_text(json.dumps({"seed": seed, "cases": cases}) + "\n", encoding="utf-8")
        with fan_out(jobs, cluster) as fan:
            marked = _held(cases, seed, folder, fan)
    text = exam_text(marked, seed, cases)
    if out is not None:
        (out / TABLE_FILE).write_text(text, encoding="utf-8")
    Terminal().print(text, highlight=False, soft_wrap=True)


def gap_exam_table_command(folder: Path, file: Path | None, note: str) -> None:
    """Print, or write to a file, the table of an exam's folder: of as many cases as it holds so far."""
    lines = []
    for name in (PLAN_FILE, RESULTS_FILE):
        try:
            lines.append((folder / name).read_text(encoding="utf-8").splitlines())
        except OSError as error:
            raise ConfigurationError(
                "the folder holds no exam's results",
                where=str(folder),
                found=f"{name}: {error.strerror}",
                expected="the folder that `gyrobench gap exam --out` writes, one case finished at least",
            ) from error
    plan = json.loads("".join(lines[0]))
    text = exam_text([Marked.from_line(line) for line in lines[1]], plan["seed"], plan["cases"], note)
    if file is None:
        Terminal().print(text, highlight=False, soft_wrap=True)
    else:
        file.write_text(f"# Result of the blind exam\n\n{text}", encoding="utf-8")


def _held(cases: int, seed: int, folder: Path, fan: FanOut) -> list[Marked]:
    console = Terminal()
    marked: list[Marked] = []
    try:
        for shown, one in examine(cases, seed, folder, fan):
            if one is None:
                console.print(f"{shown} sealed", style="dim", highlight=False)
                continue
            marked.append(one)
            console.print(f"{shown} {_line(one)}", highlight=False, soft_wrap=True)
            with (folder / RESULTS_FILE).open("a", encoding="utf-8") as lines:
                lines.write(one.line + "\n")
    except KeyboardInterrupt:
        if not marked:
            raise
        console.print(f"stopped after {len(marked)} of {cases} cases", style="yellow")
    return marked


def _line(one: Marked) -> str:
    truth = " + ".join(one.effects) or one.stochastic or "nothing"
    said = [*one.causes, *one.stochastic_named, *(["unknown"] if one.called_unknown else [])]
    shares = f"{one.stated_share[0]:.3f} ({one.true_share:.3f})"
    return f"SNR {one.snr:.2f} {truth} -> {' + '.join(said) or 'no gap'}; closed {shares} {one.seconds:.1f} s"


def exam_text(marked: Sequence[Marked], seed: int, planned: int, note: str = "") -> str:
    """Return the exam's result as Markdown: counts, table with Wilson intervals, reliability, time."""
    kinds = Counter(each.kind for each in marked)
    lines = [
        f"`gyrobench gap exam --cases {planned} --seed {seed}`{f', {note}' if note else ''}.",
        "",
        f"{_extent(len(marked), planned)}: "
        + ", ".join(f"{n} {kind}" for kind, n in kinds.most_common())
        + ".",
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


def _extent(held: int, planned: int) -> str:
    if held >= planned:
        return f"All {planned} cases"
    return f"Partial: {held} of {planned} cases (kinds come in random order, so a part is a fair sample)"
