"""Bench hours to the right answer: the search, the standard tests in a fixed order, runs drawn at random.

`python -m benchmarks.hunt [CASES] [SEED]` draws blind units (single effects, pairs, none) for the emulated bench
of `examples/demo.toml`'s kind, each effect between 20 and 120 standard deviations in the bench's best run for it,
and lets each of the three strategies search with the same stopping rule, through bytes. An end is right if
exactly the effects put in are named. It prints a line a search, then the table. Hours count to the end of the
search, or the whole budget where it came to none.
"""

from __future__ import annotations

import math
import random
import statistics
import sys
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from bench.analysis.gap import Choice, Model, Term, designs_for, model_text, outlook, read_model
from bench.analysis.gap._candidates import effects_beside
from bench.analysis.gap._outlook import Outlook
from bench.campaign import CampaignRunner
from bench.campaign.hunt import NO_GAP, HuntSettings, Order, begin_hunt, by_information, steps_of
from bench.lab.emulated import Plant
from bench.record.benchfile import BenchFile, load_bench_file
from drivers.base.clock import host_seconds
from drivers.base.errors import ConfigurationError

ROOT = Path(__file__).parents[1]
NOMINAL = ROOT / "examples" / "nominal" / "fog_on_its_bench.toml"
BUDGET_H, UNTIL = 60.0, 0.95
LEAST_SIGMA, MOST_SIGMA = 20.0, 120.0
FIXED = (
    ("zero-bias-cold-shock", "axis east, soak 75 min"),
    ("scale-factor-cold-shock", "rates +20, -20, 0 deg/s, soak 75 min"),
    ("standard-test", "rates up to 100 deg/s, room temperature only"),
    ("constant-rotation", "20 deg/s at room temperature, 400 turns, 0 reversals"),
    ("thermal-ramp", "-40 to 60 degC at 0.33 K/min"),
)
"""The standard tests as a laboratory makes them: thermal first, as the campaign of the demo."""


@dataclass(frozen=True)
class Case:
    """A unit: the effects put into it with values."""

    terms: tuple[Term, ...]

    @property
    def acts(self) -> str:
        """What a right search names."""
        return " + ".join(sorted(term.name for term in self.terms)) or NO_GAP


@dataclass(frozen=True)
class Searched:
    """How one search ended."""

    case: str
    strategy: str
    ended: str
    acts: str
    hours: float
    expected: float
    gained: float
    host_s: float

    @property
    def right(self) -> bool:
        """Whether it ended with exactly what acts."""
        return self.ended == "decided" and self.acts == self.case


def fixed_order() -> Order:
    """Return the order of the standard tests, one after the other, again from the first."""
    made: list[int] = []

    def order(choices: Sequence[Choice]) -> Sequence[Choice]:
        for step in range(len(FIXED)):
            wanted = FIXED[(len(made) + step) % len(FIXED)]
            for choice in choices:
                if (choice.design.procedure, choice.design.text) == wanted:
                    made.append(step)
                    return [choice]
        return []

    return order


def at_random(seed: int) -> Order:
    """Return an order drawn anew at each step."""
    draw = random.Random(seed)
    return lambda choices: draw.sample(list(choices), len(choices))


def drawn(count: int, seed: int, start: Outlook, energies: Mapping[str, float]) -> list[Case]:
    """Return so many cases: of each four two singles, a pair and none."""
    draw = random.Random(seed)
    effects = effects_beside(start.model)
    names = sorted(name for name in energies if _plant_has(effects[name]))
    cases = []
    for number in range(count):
        wanted = (1, 0, 1, 2)[number % 4]
        terms = []
        for name in draw.sample(names, wanted):
            effect = effects[name]
            variant = effect.variants()[len(effect.variants()) // 2]
            sigma = math.exp(draw.uniform(math.log(LEAST_SIGMA), math.log(MOST_SIGMA)))
            size = sigma / math.sqrt(energies[name]) * draw.choice((-1.0, 1.0))
            low, high = effect.parameters[0].bounds(start.model.noise.coarseness)
            values = (min(max(size, low), high), *(0.0 for _ in effect.parameters[1:]))
            terms.append(Term(variant, values, tuple(abs(size) for _ in values)))
        cases.append(Case(tuple(terms)))
    return cases


def _plant_has(effect: object) -> bool:
    try:
        return bool(effect.causal)  # type: ignore[attr-defined]
    except ConfigurationError:
        return False


def search(case: Case, strategy: str, file: BenchFile, root: Path, seed: int) -> Searched:
    """Let one strategy search for what one unit has."""
    nominal = read_model(NOMINAL)
    kept = tuple(
        term for term in nominal.terms if _plant_has(term.effect) and term.name != "table_wobble_once"
    )
    (root / "truth.toml").write_text(model_text(Model("truth", (*kept, *case.terms), nominal.noise)))
    plant = Plant(seed=seed, mount_azimuth_error_deg=0.0, gap_model={file.gyro[0].unit: root / "truth.toml"})
    orders = {"search": by_information, "fixed": fixed_order(), "random": at_random(seed)}
    settings = HuntSettings(budget_h=BUDGET_H, until=UNTIL)
    hunt = begin_hunt(root / "out", file, NOMINAL, settings, plant=plant, order=orders[strategy])
    began = host_seconds()
    CampaignRunner(hunt.folder, further=hunt.next_run).run()
    end, steps = hunt.end, [step for step in steps_of(hunt) if step.after is not None]
    gained = [step.after.gained_nats or 0.0 for step in steps if step.after is not None]
    expected = sum(step.chosen.expected_nats for step in steps)
    return Searched(
        case.acts,
        strategy,
        "" if end is None else end.ended,
        "" if end is None else end.acts,
        BUDGET_H if end is None or end.ended != "decided" else end.used_h,
        expected,
        sum(gained),
        host_seconds() - began,
    )


def main(arguments: Sequence[str]) -> int:
    """Search, print each end and the table."""
    count = int(arguments[0]) if arguments else 4
    seed = int(arguments[1]) if len(arguments) > 1 else 1
    file = _bench()
    designs = designs_for(file)
    start = outlook(None, read_model(NOMINAL), [], designs)
    found = []
    for number, case in enumerate(drawn(count, seed, start, start.energies)):
        for strategy in ("search", "fixed", "random"):
            with tempfile.TemporaryDirectory() as place:
                one = search(case, strategy, file, Path(place), 1000 * seed + 50 * number)
            print(
                f"{one.case} | {one.strategy}: {one.ended or 'stopped'}, {one.acts}, {one.hours:.1f} h, "
                f"{one.gained:.2f} nats of {one.expected:.2f} expected, {one.host_s:.0f} s",
                flush=True,
            )
            found.append(one)
    print(table(found))
    return 0


def table(found: Sequence[Searched]) -> str:
    """Return the comparison as a Markdown table."""
    rows = [
        "| strategy | right | wrong ends | bench hours, median | nats gained over expected |",
        "|---|---|---|---|---|",
    ]
    for strategy in ("search", "fixed", "random"):
        own = [end for end in found if end.strategy == strategy]
        right = sum(end.right for end in own)
        wrong = sum(end.ended == "decided" and not end.right for end in own)
        hours = statistics.median(end.hours for end in own)
        ratio = sum(end.gained for end in own) / max(sum(end.expected for end in own), 1e-9)
        rows.append(f"| {strategy} | {right} of {len(own)} | {wrong} | {hours:.1f} | {ratio:.2f} |")
    return "\n".join(rows)


def _bench() -> BenchFile:
    file = load_bench_file(ROOT / "examples" / "demo.toml")
    limits = file.limits.model_copy(update={"max_rate_dps": 100.0, "max_temp_c": 85.0})
    return file.model_copy(update={"limits": limits, "gyro": file.gyro[:1]})


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
