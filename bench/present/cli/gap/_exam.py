"""`gyrobench gap exam`: the blind exam of the diagnosis, its table and its reliability plot."""

from __future__ import annotations

import tempfile
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from typer import BadParameter, Option

from bench.present.cli._console import Terminal
from bench.present.cli._options import Cluster, Jobs, Json

if TYPE_CHECKING:
    from bench.analysis.gap import Exam, Marked

TABLE_FILE = "table.md"
_BAR = 40


def exam(
    seed: Annotated[
        int | None, Option(help="fresh seed; every case of a seed once looked at is spent")
    ] = None,
    cases: Annotated[int, Option(help="number of cases, a quarter of them without any effect")] = 600,
    out: Annotated[
        Path | None, Option(help="new folder for cases, seals, results; default: nothing is kept")
    ] = None,
    jobs: Jobs = None,
    cluster: Cluster = None,
    held: Annotated[
        Path | None,
        Option("--from", help="folder of an exam held, finished or not: print its table, hold none"),
    ] = None,
    table: Annotated[Path | None, Option(help="with --from: file for the table (Markdown)")] = None,
    note: Annotated[str, Option(help="with --from: words for its first line, e.g. the commit")] = "",
    as_json: Json = False,
) -> None:
    """Examine the diagnosis on plants of other physics.

    The plants do not use the catalogue, and their answers are sealed beforehand.
    """
    from bench.analysis.common.fan_out import fan_out
    from bench.analysis.gap import Exam, hold_exam, read_exam

    console = Terminal(as_json=as_json)
    if held is not None:
        result = read_exam(held)
        text = exam_text(result, note)
        if table is not None:
            table.write_text(f"# Result of the blind exam\n\n{text}", encoding="utf-8")
            text = f"{table}"
    elif seed is None:
        raise BadParameter("an exam needs --seed, or --from with the folder of one that was held")
    else:
        with tempfile.TemporaryDirectory() as spare, fan_out(jobs, cluster) as fan:
            marked = _watched(console, hold_exam(cases, seed, out or Path(spare), fan), cases)
        result = Exam(seed, cases, tuple(marked))
        text = exam_text(result)
        if out is not None:
            (out / TABLE_FILE).write_text(text, encoding="utf-8")
    console.say(text, soft_wrap=True)
    counts = {"seed": result.seed, "cases": result.cases, "marked": len(result.marked)}
    console.say_json("result", **counts, lines=result.lines)


def _watched(console: Terminal, exam: Iterator[tuple[str, Marked | None]], cases: int) -> list[Marked]:
    marked: list[Marked] = []
    try:
        for name, case in exam:
            if case is None:
                console.say(f"{name} sealed", style="dim")
                continue
            marked.append(case)
            console.say(f"{name} {_line(case)}", soft_wrap=True)
    except KeyboardInterrupt:
        if not marked:
            raise
        console.print(f"stopped after {len(marked)} of {cases} cases", style="yellow")
    return marked


def _line(case: Marked) -> str:
    truth = " + ".join(case.effects) or case.stochastic or "nothing"
    said = [*case.causes, *case.stochastic_named, *(["unknown"] if case.called_unknown else [])]
    shares = f"{case.stated_share[0]:.3f} ({case.true_share:.3f})"
    return (
        f"SNR {case.snr:.2f} {truth} -> {' + '.join(said) or 'no gap'}; closed {shares} {case.seconds:.1f} s"
    )


def exam_text(exam: Exam, note: str = "") -> str:
    """Return the exam's result as Markdown: counts, table with Wilson intervals, reliability, time."""
    marked, planned = exam.marked, exam.cases
    kinds = ", ".join(f"{n} {kind}" for kind, n in Counter(case.kind for case in marked).most_common())
    median, tenth = exam.shrinkage_quantiles
    bins, error = exam.reliability
    times = sorted(case.seconds for case in marked)
    rows = [
        f"| {line.what} | {line.snr} | {line.right}/{line.of} | {100 * line.right / line.of:.1f} "
        f"| {100 * line.interval[0]:.0f}..{100 * line.interval[1]:.0f} |"
        for line in exam.lines
    ]
    bars = []
    for group in bins:
        came = group.true / group.count
        bar = "".join(
            "|" if k == round(group.stated * _BAR) else "#" if k < round(came * _BAR) else "."
            for k in range(_BAR + 1)
        )
        bars.append(f"stated {100 * group.stated:5.1f} %  true {100 * came:5.1f} %  {bar}  {group.count}")
    lines = [
        f"`gyrobench gap exam --cases {planned} --seed {exam.seed}`{f', {note}' if note else ''}.\n",
        f"{_extent(len(marked), planned)}: {kinds}.\n",
        "| | SNR | right | % | 95 % interval |",
        "|---|---|---|---|---|",
        *rows,
        f"\nShrinkage over the oracle's, SNR 1 and up: median {median:.3f}, 10th percentile {tenth:.3f}\n",
        f"Reliability (expected calibration error {error:.3f}): stated probability, came true, of how many\n",
        "```",
        *bars,
        "```\n",
        f"Seconds a case: median {times[len(times) // 2]:.1f}, longest {times[-1]:.1f}\n",
    ]
    return "\n".join(lines)


def _extent(held: int, planned: int) -> str:
    if held >= planned:
        return f"All {planned} cases"
    return f"Partial: {held} of {planned} cases (kinds come in random order, so a part is a fair sample)"
