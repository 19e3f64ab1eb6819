"""The blind exam of the gap diagnosis: `python -m benchmarks.gap_exam --cases N --seed S`.

Seals are printed before a case is diagnosed; the diagnosis runs in a process that is sent the runs and the
text of the nominal model and nothing else.
"""

from __future__ import annotations

import argparse
import time
from collections import Counter
from multiprocessing import get_context

from bench.gap import Marked, close, examined, make_case, model_text, nominal_model, table

SHARES = {
    "null": 0.25,
    "single": 0.35,
    "pair": 0.13,
    "unknown": 0.14,
    "known and unknown": 0.06,
    "stochastic": 0.07,
}


def case_kinds(cases: int) -> list[str]:
    kinds = [kind for kind, share in SHARES.items() for _ in range(round(share * cases))]
    return (kinds + ["null"] * cases)[:cases]


def run(cases: int, seed: int, *, quiet: bool = False) -> list[Marked]:
    nominal = model_text(nominal_model())
    marked = []
    with get_context("spawn").Pool(1) as pool:
        for number, kind in enumerate(case_kinds(cases)):
            sealed, given, kept, clean = make_case(seed * 100_000 + number, kind)
            if not quiet:
                print(f"{number:4d} seal {sealed.sha256[:16]}", end=" ", flush=True)
            started = time.perf_counter()
            answer = pool.apply(examined, (given, nominal))
            taken = time.perf_counter() - started
            one = Marked(sealed, answer, close(answer, kept, clean), taken)
            marked.append(one)
            if not quiet:
                print(_line(one), flush=True)
    return marked


def _line(one: Marked) -> str:
    case, answer = one.sealed.case, one.answer
    truth = " + ".join(case.effects) or case.stochastic or "nothing"
    said = " + ".join([*answer.causes, *answer.stochastic, *(["unknown"] if one.unknown else [])]) or "no gap"
    shares = f"{one.closed.stated.share:.3f} ({one.closed.true_share:.3f})"
    return f"{case.snr:5.2f} {truth} -> {said}; {shares} {one.seconds:.1f} s"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--cases", type=int, default=100)
    parser.add_argument("--seed", type=int, required=True)
    options = parser.parse_args()
    marked = run(options.cases, options.seed)
    print(Counter(each.sealed.case.kind for each in marked))
    print(f"{'':62s} {'snr':>8s} {'right':>9s}   %    95 % interval")
    for line in table(marked):
        low, high = line.interval
        share = 100.0 * line.right / line.of
        counts = f"{line.right}/{line.of}"
        print(
            f"{line.what:62s} {line.snr:>8s} {counts:>9s} {share:4.0f}   {100 * low:3.0f}..{100 * high:3.0f}"
        )
    times = sorted(each.seconds for each in marked)
    print(f"seconds a case: median {times[len(times) // 2]:.1f}, longest {times[-1]:.1f}")


if __name__ == "__main__":
    main()
