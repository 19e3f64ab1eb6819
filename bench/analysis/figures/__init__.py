"""Figures of gyro test standards as plain functions: IEEE Std 647 (ring laser), 952 (fibre optic), GJB 2426A."""

from bench.analysis.figures._foretold import (
    Foretold,
    Outlook,
    foretell_procedure,
    noise_like,
    noise_named,
)
from bench.analysis.figures._from_run import (
    StandardFigures,
    figures_of_unit,
    figures_over_runs,
    standard_figures,
)
from bench.analysis.figures._of_procedure import procedure_budgets
from bench.analysis.figures._parts import Figure

__all__ = [
    "Figure",
    "Foretold",
    "Outlook",
    "StandardFigures",
    "figures_of_unit",
    "figures_over_runs",
    "foretell_procedure",
    "noise_like",
    "noise_named",
    "procedure_budgets",
    "standard_figures",
]
