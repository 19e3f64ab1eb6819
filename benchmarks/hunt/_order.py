"""The best fixed order of the standard tests that a greedy search finds, on cases of its own.

What a unit records in a test does not depend on the tests before, so that one set of recordings serves all
orders. The next test is the one after which most further cases are answered rightly per hour that it takes: for
the mean time to an answer no order is more than four times better (Feige, Lovasz and Tetali, Algorithmica 40,
2004, on min sum set cover), and none that can be computed fast is surely better.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from pathlib import Path

from bench.analysis.gap import Design
from bench.campaign.hunt import DECIDED, Made, conclude
from benchmarks.hunt._cases import Case, is_right
from benchmarks.hunt._plants import HuntPlant
from benchmarks.hunt._seek import UNTIL
from benchmarks.hunt._strategies import DEFAULT_ORDER, standard_tests
from drivers.base.files import replace_file

ORDER_FILE = "order.json"


def find_order(cases: Sequence[tuple[HuntPlant, Case]]) -> Iterator[str]:
    """Yield the procedures in the order found; after the first that answers everything the rest as usual."""
    left = list(cases)
    order: list[str] = []
    records: dict[tuple[str, str], Made] = {}
    while len(order) < len(DEFAULT_ORDER):
        among = [name for name in DEFAULT_ORDER if name not in order]
        answered = {
            name: [pair for pair in left if _answered(*pair, [*order, name], records)] for name in among
        }
        hours = {name: _test(left[0][0] if left else cases[0][0], name).hours for name in among}
        best = max(among, key=lambda name: (len(answered[name]) / hours[name], -hours[name]))
        left = [pair for pair in left if pair not in answered[best]]
        order.append(best)
        yield best


def _answered(
    plant: HuntPlant, case: Case, names: Sequence[str], records: dict[tuple[str, str], Made]
) -> bool:
    for name in names:
        if (case.name, name) not in records:
            test, number = _test(plant, name), DEFAULT_ORDER.index(name)
            recorded = plant.recorded(test, case.gap, case.seed, number)
            records[case.name, name] = Made(test.key, recorded)
    now = conclude([records[case.name, name] for name in names], plant.model, plant.designs, UNTIL)
    return now.probability >= UNTIL and is_right(plant, case, DECIDED, now.acts)


def _test(plant: HuntPlant, procedure: str) -> Design:
    return next(each for each in standard_tests(plant) if each.procedure == procedure)


def keep_order(folder: Path, order: Sequence[str]) -> None:
    """Write the order to the folder of the journal, where `search` takes it from."""
    folder.mkdir(parents=True, exist_ok=True)
    replace_file(folder / ORDER_FILE, json.dumps(list(order)))


def order_of(folder: Path) -> Sequence[str]:
    """Return the order that was found in a folder, else the usual one."""
    path = folder / ORDER_FILE
    return json.loads(path.read_text(encoding="utf-8")) if path.exists() else DEFAULT_ORDER
