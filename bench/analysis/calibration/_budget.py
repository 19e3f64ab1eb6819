"""The uncertainty budgets of a calibration's parameters: what the record's noise leaves, and what the bench adds.

A scheme has gravity and the Earth's rate as its references, so an error of gravity is one of the accelerometers'
scale factors, -dg / g, and of nothing else. An error of the time base is one of the gyros' scale factors where
a unit sends rates, and of the accelerometers' where it sends increments; which of both is not in the record, so
each has it, and a known one is not taken off. What an error of the latitude does depends on the scheme, and is
found by estimating again. Angles of the table are no references.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from bench.analysis.calibration._conventions import PARAMETER_NAMES, PARAMETERS, STATE_UNITS, UNIT_SIZE
from bench.analysis.calibration._estimator import Estimate
from bench.analysis.common.bench_errors import BenchErrors
from bench.analysis.common.uncertainty import Budget, Contribution
from bench.record.benchfile import Calibration as Certificate
from drivers.base.arrays import Array

_PPM = 1e-6


def parameter_budgets(
    estimate: Estimate, gravity_mps2: float, per_latitude_deg: Array, certificates: Sequence[Certificate] = ()
) -> dict[str, Budget]:
    """Return the budget of each of the 24 parameters, by its name, in its printed unit.

    `per_latitude_deg`: change of the estimate with the latitude told, SI a degree, (24,).
    """
    bench = BenchErrors(certificates)
    return {
        name: Budget(
            float(estimate.parameters[number] / size),
            (
                Contribution(
                    "noise", float(estimate.sigma[number] / size), unit=unit, kind="A", origin="filter"
                ),
                bench.of("latitude_deg", -float(per_latitude_deg[number] / size)),
                *_of_bench(name, size, gravity_mps2, bench),
            ),
        )
        for number, (name, size, unit) in enumerate(
            zip(PARAMETER_NAMES, UNIT_SIZE[PARAMETERS], STATE_UNITS[PARAMETERS], strict=True)
        )
    }


def _of_bench(name: str, size: float, gravity_mps2: float, bench: BenchErrors) -> Iterator[Contribution]:
    if name[:2] not in ("Kg", "Ka") or name[-1] != name[-2]:
        return
    yield bench.of("time_base_ppm", _PPM / size, signed=False)
    if name.startswith("Ka"):
        yield bench.of("gravity_mps2", 1.0 / gravity_mps2 / size)
