"""Plans by rehearsal: `gyrobench campaign plan` in a process of its own, which steps back for a run."""

from __future__ import annotations

import asyncio
import json
import sys
import tempfile
from contextlib import suppress
from pathlib import Path
from typing import Any

from bench.campaign.queue import CampaignOrder, RunOrder
from bench.present.panel._desk import chamber_words
from bench.present.panel._texts import duration
from drivers.base.errors import BenchError
from drivers.base.files import parse_json
from drivers.base.pipes import end_of_its_own, of_its_own
from drivers.base.system import give_way

_TIMEOUT_S = 600.0
_KEPT = 50


class Rehearsals:
    """Rehearses one order at a time, whoever asks; what was rehearsed is known until the panel ends."""

    def __init__(self, runs: Path) -> None:
        self._runs = runs
        self._one = asyncio.Lock()
        self._known: dict[str, dict[str, Any]] = {}

    async def plan(self, order: RunOrder | CampaignOrder, bench_file: Path) -> dict[str, Any]:
        """Return steps, questions, time and bytes of an order; BenchError if it cannot be rehearsed."""
        stamps = [path.stat().st_mtime_ns for path in (bench_file, *_files(order))]
        key = f"{bench_file} {stamps} {order.model_dump_json()}"
        async with self._one:
            if key not in self._known:
                while len(self._known) >= _KEPT:
                    del self._known[next(iter(self._known))]
                self._known[key] = await self._rehearse(order, bench_file)
        return self._known[key]

    async def _rehearse(self, order: RunOrder | CampaignOrder, bench_file: Path) -> dict[str, Any]:
        with tempfile.TemporaryDirectory(prefix="gyrobench-plan-") as scratch:
            campaign = order.file if isinstance(order, CampaignOrder) else Path(scratch) / "one.toml"
            if isinstance(order, RunOrder):
                campaign.write_text(campaign_text(order), encoding="utf-8")
            words = ("campaign", "plan", str(campaign), "--bench", str(bench_file), "--out", str(self._runs))
            process = await asyncio.create_subprocess_exec(
                *(sys.executable, "-P", "-m", "gyrobench", *words, "--json"),
                stdin=asyncio.subprocess.DEVNULL,
                stdout=asyncio.subprocess.PIPE,
                stderr=asyncio.subprocess.PIPE,
                **of_its_own(),
            )
            give_way(process.pid, group=True)
            try:
                output, errors = await asyncio.wait_for(process.communicate(), _TIMEOUT_S)
            except TimeoutError:
                raise BenchError("the rehearsal takes too long", found=f"{_TIMEOUT_S:g} s") from None
            finally:
                with suppress(ProcessLookupError):
                    end_of_its_own(process.pid)
        rows = [parse_json(line) for line in output.splitlines()]
        result = next((row for row in rows if row["kind"] == "result"), None)
        if result is None:
            raise BenchError(errors.decode("utf-8", "replace").strip().removeprefix("error: "))
        return rehearsed([row for row in rows if row["kind"] == "run"], result)


def rehearsed(runs: list[dict[str, Any]], result: dict[str, Any]) -> dict[str, Any]:
    """Return what the page shows of a rehearsed plan."""
    several = len(runs) > 1
    steps = [
        (duration(step["start_s"]), duration(step["end_s"] - step["start_s"]), title)
        for run in runs
        for step in run["steps"]
        for title in (f"{run['run']}: {step['title']}" if several else step["title"],)
    ]
    questions = [question for run in runs for question in run["questions"]]
    bad = [
        f"{run['run']}: rehearsed as {run['rehearsed']}: {run['reason']}"
        for run in runs
        if run["rehearsed"] != "completed"
    ]
    return {
        "duration_s": result["duration_s"],
        "length": duration(result["duration_s"]),
        "chamber": chamber_words(result["chamber_s"]),
        "bytes": result["bytes"],
        "steps": steps,
        "questions": list(dict.fromkeys(questions)),
        "asked": len(questions),
        "warnings": [*result["warnings"], *bad],
    }


def campaign_text(order: RunOrder) -> str:
    """Return a campaign file of one run."""
    lines = [
        f"title = {_toml(order.procedure)}",
        "[[run]]",
        'name = "run"',
        f"procedure = {_toml(order.procedure)}",
    ]
    lines += ["[run.parameters]", *(f"{name} = {_toml(value)}" for name, value in order.parameters.items())]
    return "\n".join(lines) + "\n"


def _toml(value: object) -> str:
    """Return a number, a truth value or a text as TOML: JSON's are that, save what stands for nothing."""
    return json.dumps(value, ensure_ascii=False, allow_nan=False)


def _files(order: RunOrder | CampaignOrder) -> tuple[Path, ...]:
    return (order.file,) if isinstance(order, CampaignOrder) else ()
