"""NIST's Statistical Reference Datasets (linear) through the project's regression: at least seven digits.

The reference is solved in fractions, exactly, from the data as printed; it is checked against NIST's certified
values. NoInt1 and NoInt2 have no intercept, as no regression of the project: they check the reference only.
"""

from __future__ import annotations

from collections.abc import Sequence
from fractions import Fraction
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from bench.analysis.common.stepwise import stepwise
from bench.analysis.figures._scale_factor import fit_rate_sequence
from drivers.base.errors import ConfigurationError

DEGREE = {"pontius": 2, "filip": 10} | {f"wampler{number}": 5 for number in range(1, 6)}
CERTIFIED = {
    "norris": ((-0.262323073774029, 1.00211681802045), (0.232818234301152, 0.429796848199937e-3)),
    "pontius": (
        (0.673565789473684e-3, 0.732059160401003e-6, -0.316081871345029e-14),
        (0.107938612033077e-3, 0.157817399981659e-9, 0.486652849992036e-16),
    ),
    "noint1": ((2.07438016528926,), (0.165289256198347e-1,)),
    "noint2": ((0.727272727272727,), (0.420827318078432e-1,)),
    "filip": (
        (-1467.48961422980, -2772.17959193342, -2316.37108160893, -1127.97394098372, -354.478233703349,
         -75.1242017393757, -10.8753180355343, -1.06221498588947, -0.670191154593408e-1,
         -0.246781078275479e-2, -0.402962525080404e-4),
        (298.084530995537, 559.779865474950, 466.477572127796, 227.204274477751, 71.6478660875927,
         15.2897178747400, 2.23691159816033, 0.221624321934227, 0.142363763154724e-1,
         0.535617408889821e-3, 0.896632837373868e-5),
    ),
    "longley": (
        (-3482258.63459582, 15.0618722713733, -0.358191792925910e-1, -2.02022980381683, -1.03322686717359,
         -0.511041056535807e-1, 1829.15146461355),
        (890420.383607373, 84.9149257747669, 0.334910077722432e-1, 0.488399681651699, 0.214274163161675,
         0.226073200069370, 455.478499142212),
    ),
    "wampler1": ((1.0,) * 6, (0.0,) * 6),
    "wampler2": ((1.0, 0.1, 0.01, 0.001, 1e-4, 1e-5), (0.0,) * 6),
    "wampler3": ((1.0,) * 6, (2152.32624678170, 2363.55173469681, 779.343524331583, 101.475507550350,
                              5.64566512170752, 0.112324854679312)),
    "wampler4": ((1.0,) * 6, (215232.624678170, 236355.173469681, 77934.3524331583, 10147.5507550350,
                              564.566512170752, 11.2324854679312)),
    "wampler5": ((1.0,) * 6, (21523262.4678170, 23635517.3469681, 7793435.24331583, 1014755.07550350,
                              56456.6512170752, 1123.24854679312)),
}  # fmt: skip
"""Coefficients, the intercept first, and their standard deviations."""
INTERCEPT = [name for name in CERTIFIED if not name.startswith("noint")]


@cache
def data(name: str) -> tuple[list[list[Fraction]], list[Fraction]]:
    """Regressors without the intercept and y."""
    lines = (Path(__file__).parent / "strd.csv").read_text().splitlines()[2:]
    rows = [line.split(",")[1:] for line in lines if line.startswith(name + ",")]
    x = [[Fraction(cell) for cell in row[1:]] for row in rows]
    if name != "longley":
        x = [[row[0] ** power for power in range(1, DEGREE.get(name, 1) + 1)] for row in x]
    return x, [Fraction(row[0]) for row in rows]


@cache
def exact(name: str) -> tuple[list[float], list[float]]:
    """Coefficients and standard deviations by Gauss and Jordan in fractions."""
    x, y = data(name)
    rows = x if name.startswith("noint") else [[Fraction(1), *row] for row in x]
    size, freedom = len(rows[0]), len(rows) - len(rows[0])
    system = [
        [sum(row[i] * row[j] for row in rows) for j in range(size)]
        + [sum(row[i] * value for row, value in zip(rows, y, strict=True))]
        + [Fraction(i == j) for j in range(size)]
        for i in range(size)
    ]
    for i in range(size):
        system[i] = [cell / system[i][i] for cell in system[i]]
        for j in range(size):
            if j != i:
                factor = system[j][i]
                system[j] = [a - factor * b for a, b in zip(system[j], system[i], strict=True)]
    found = [row[size] for row in system]
    left = (v - sum(c * a for c, a in zip(found, row, strict=True)) for row, v in zip(rows, y, strict=True))
    square = sum((value**2 for value in left), Fraction(0)) / freedom
    return [float(value) for value in found], [
        float(square * system[i][size + 1 + i]) ** 0.5 for i in range(size)
    ]


def digits(found: Sequence[float], true: Sequence[float]) -> float:
    error = max(abs(a - b) / abs(b) if b else abs(a) for a, b in zip(found, true, strict=True))
    return float(-np.log10(max(error, 1e-16)))


@pytest.mark.parametrize("name", CERTIFIED)
def test_the_reference_is_nists(name: str) -> None:
    for found, certified in zip(exact(name), CERTIFIED[name], strict=True):
        assert digits(found, certified) > 13.0


@pytest.mark.parametrize("name", INTERCEPT)
def test_a_regression_with_all_terms_in_has_seven_digits(name: str) -> None:
    rows, values = data(name)
    x, y = (np.array(part, dtype=np.float64) for part in (rows, values))
    names = [f"x{number}" for number in range(x.shape[1])]
    final = stepwise(x, y, names=names, start=names, p_enter=0.0, p_remove=1.0).final
    coefficients, deviations = exact(name)
    assert digits([final.intercept, *final.coefficient], coefficients) > 7.0
    if max(deviations) > 0.0:
        assert digits(list(final.standard_error), deviations[1:]) > 7.0


def test_the_line_of_the_scale_factor_has_seven_digits() -> None:
    rows, values = data("norris")
    fit = fit_rate_sequence([float(row[0]) for row in rows], [float(value) for value in values])
    assert digits([fit.offset, fit.scale_factor], exact("norris")[0]) > 7.0


def test_terms_beyond_seven_digits_are_refused_not_fitted() -> None:
    x = np.vander(np.linspace(-8.8, -3.1, 82), 16, increasing=True)[:, 1:]
    names = [f"x{number}" for number in range(15)]
    with pytest.raises(ConfigurationError, match="seven digits"):
        stepwise(x, np.cos(x[:, 0]), names=names, start=names, p_enter=0.0, p_remove=1.0)
