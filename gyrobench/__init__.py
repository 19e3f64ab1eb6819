"""The public face of gyrobench: what a script, a notebook or a package of your own imports. See docs/api.md.

    import gyrobench

    result = gyrobench.rehearse("zero-bias-cold-shock", "examples/demo.toml", soak_min=30)
    run = gyrobench.open_run(result.folder)
    rate_dps = run.gyro("fog_1")["rate_dps"]

Everything here is handed on from the rooms (`bench`, `drivers`, `simulators`), which is where it is built.
A name is loaded when it is first used, so that `import gyrobench` costs nothing.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

from gyrobench._rooms import check_rooms

if TYPE_CHECKING:
    from bench import __version__ as __version__
    from bench.analysis.calibration import Noise as Noise
    from bench.analysis.compensations import load_compensation as load_compensation
    from bench.analysis.gap import Diagnosis as Diagnosis
    from bench.analysis.look import Look as Look
    from bench.analysis.look import LookOptions as LookOptions
    from bench.analysis.thermal import Compensation as Compensation
    from bench.analysis.thermal import Study as Study
    from bench.campaign import CampaignFolder as CampaignFolder
    from bench.control.procedure import Demands as Demands
    from bench.control.procedure import Parameters as Parameters
    from bench.control.procedure import Procedure as Procedure
    from bench.control.procedure import find_procedure as find_procedure
    from bench.control.procedure import parameter as parameter
    from bench.control.runner import RunResult as RunResult
    from bench.control.session import Bench as Bench
    from bench.lab.emulated import Plant as Plant
    from bench.record.benchfile import BenchFile as BenchFile
    from bench.record.events.run import Basis as Basis
    from bench.record.events.run import Interval as Interval
    from bench.record.events.run import Series as Series
    from bench.record.exchange import import_log as import_log
    from bench.record.recording import Run as Run
    from drivers.base.errors import BenchError as BenchError
    from drivers.base.errors import BenchInUse as BenchInUse
    from drivers.base.errors import ConfigurationError as ConfigurationError
    from drivers.base.errors import LimitExceeded as LimitExceeded
    from drivers.base.errors import RecordError as RecordError
    from drivers.base.errors import RunAborted as RunAborted
    from gyrobench._analyse import diagnose as diagnose
    from gyrobench._analyse import fit_calibration as fit_calibration
    from gyrobench._analyse import fit_cold_shock as fit_cold_shock
    from gyrobench._analyse import fit_heading_effect as fit_heading_effect
    from gyrobench._analyse import fit_standard_test as fit_standard_test
    from gyrobench._analyse import fit_stepwise as fit_stepwise
    from gyrobench._analyse import fit_whirl as fit_whirl
    from gyrobench._analyse import foretell as foretell
    from gyrobench._analyse import look as look
    from gyrobench._analyse import procedure_budgets as procedure_budgets
    from gyrobench._open import load_bench as load_bench
    from gyrobench._open import open_run as open_run
    from gyrobench._operate import open_campaign as open_campaign
    from gyrobench._operate import rehearse as rehearse
    from gyrobench._operate import run as run
    from gyrobench._operate import write_unit_fmu as write_unit_fmu
    from gyrobench._show import Plots as Plots
    from gyrobench._show import plot as plot

_HOMES = {
    "bench": ("__version__",),
    "bench.analysis.calibration": ("Noise",),
    "bench.analysis.compensations": ("load_compensation",),
    "bench.analysis.gap": ("Diagnosis",),
    "bench.analysis.look": ("Look", "LookOptions"),
    "bench.analysis.thermal": ("Compensation", "Study"),
    "bench.campaign": ("CampaignFolder",),
    "bench.control.procedure": ("Demands", "Parameters", "Procedure", "find_procedure", "parameter"),
    "bench.control.runner": ("RunResult",),
    "bench.control.session": ("Bench",),
    "bench.lab.emulated": ("Plant",),
    "bench.record.benchfile": ("BenchFile",),
    "bench.record.events.run": ("Basis", "Interval", "Series"),
    "bench.record.exchange": ("import_log",),
    "bench.record.recording": ("Run",),
    "drivers.base.errors": (
        "BenchError",
        "BenchInUse",
        "ConfigurationError",
        "LimitExceeded",
        "RecordError",
        "RunAborted",
    ),
    "gyrobench._analyse": (
        "diagnose",
        "fit_calibration",
        "fit_cold_shock",
        "fit_heading_effect",
        "fit_standard_test",
        "fit_stepwise",
        "fit_whirl",
        "foretell",
        "look",
        "procedure_budgets",
    ),
    "gyrobench._open": ("load_bench", "open_run"),
    "gyrobench._operate": ("open_campaign", "rehearse", "run", "write_unit_fmu"),
    "gyrobench._show": ("Plots", "plot"),
}
"""Module -> the public names that it holds."""
_HOME_OF = {name: module for module, names in _HOMES.items() for name in names}

__all__ = sorted(_HOME_OF)


def __getattr__(name: str) -> Any:
    if name not in _HOME_OF:
        raise AttributeError(f"gyrobench has no {name!r}; docs/api.md lists what it has")
    check_rooms()
    try:
        value = getattr(import_module(_HOME_OF[name]), name)
    except ModuleNotFoundError as error:
        from drivers.base.plugins import needs_extra

        raise needs_extra(error, f"gyrobench.{name}") or error from error
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return list(__all__)
