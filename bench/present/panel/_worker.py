"""A process of the lowest priority that reads runs for the panel: curves and figures cost seconds.

Started by `Workshop`. A request is a line of JSON, `{"job", ...}`, its answer too: the result, or `{"problem"}`.
It ends when nobody can ask any more.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

from bench.control.recover import recover
from bench.present.panel._run_curves import run_curves
from bench.present.panel._run_expected import run_expected
from bench.present.panel._run_figures import run_figures
from drivers.base.errors import BenchError
from drivers.base.system import give_way


def _curves(asked: dict[str, Any]) -> dict[str, Any]:
    return run_curves(Path(asked["run"]), asked.get("from_s"), asked.get("to_s"))


def _figures(asked: dict[str, Any]) -> dict[str, Any]:
    return {"figures": run_figures(Path(asked["run"]))}


def _expected(asked: dict[str, Any]) -> dict[str, Any]:
    return run_expected(Path(asked["run"]))


def _recover(asked: dict[str, Any]) -> dict[str, Any]:
    manifest = recover(Path(asked["run"]), str(asked["by"]))
    return {"outcome": manifest.outcome, "reason": manifest.reason}


JOBS: dict[str, Callable[[dict[str, Any]], dict[str, Any]]] = {
    "curves": _curves,
    "figures": _figures,
    "expected": _expected,
    "recover": _recover,
}


def answer(line: str) -> str:
    """Return the answer to a request; whatever is wrong with a run is told of that run and ends nothing."""
    try:
        asked = json.loads(line)
        return json.dumps(JOBS[asked["job"]](asked), allow_nan=False, separators=(",", ":"))
    except BenchError as error:
        return json.dumps({"problem": str(error)})
    except Exception as error:  # a malformed file of one run must not stop the pages of others
        return json.dumps({"problem": f"the run cannot be read: {type(error).__name__}: {error}"})


def main() -> None:
    """Answer until the other end closes."""
    give_way()
    for line in sys.stdin:
        sys.stdout.write(answer(line) + "\n")
        sys.stdout.flush()


if __name__ == "__main__":
    main()
