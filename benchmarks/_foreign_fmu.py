"""FMUs that other tools made, as the nominal model of a gap diagnosis, by the command line."""

from __future__ import annotations

import json
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from typer.testing import CliRunner

from bench.present.cli._app import app
from benchmarks._fetched import fetched
from benchmarks._said import Recording, Said
from drivers.base.arrays import Array

_FMPY = "CATIA-Systems/FMPy@"
CONTROLLER = (
    f"{_FMPY}e8b71b702fb4a5b6b63db9ef934f6dbb29816be6:tests/resources/Controller.fmu",
    "83c748e4b2ce6bb501fdd31d16b8cab8e9f71e1f7358edb07bc2b52570b7a619",
)
_FEEDTHROUGH = (
    f"{_FMPY}7dbc882f52d0ee59ada47c81f35584cda91f2c21:tests/resources/Feedthrough.fmu",
    "d1745906c37ef370e24a86dc41f7304d2296fe88115e372d8dd74744aa348446",
)
_SCALE, _SLOPE_DPH_PER_K, _STEPS = 1.002, 0.8, 4000
"""What the gyro has: a scale factor, which the FMU knows, and a bias over temperature, which it does not."""


def _warm_k() -> Array:
    return np.asarray(20.0 * np.sin(2.0 * np.pi * np.arange(1, _STEPS + 1) / _STEPS) ** 3)


def _campaign(folder: Path) -> Path:
    """Write four runs of a gyro at +20 and -20 deg/s, axis upright at 48 deg, and their mapping."""
    rng, time_s = np.random.default_rng(11), np.arange(1.0, _STEPS + 1.0)
    text = (
        'format = 1\nunit_id = "gyro"\nlatitude_deg = 48\n[columns]\ntime = { name = "t", unit = "s" }\n'
        'output = { name = "rate", unit = "deg/s" }\nt_in = { name = "temp", unit = "degC" }\n'
        'angle = { name = "angle", unit = "deg" }\n'
    )
    for number, rate in enumerate((20.0, -20.0, 20.0, -20.0)):
        true = rate + 15.041067 / 3600.0 * np.sin(np.radians(48.0))
        noise = 0.02 * 60.0 / 3600.0 * rng.standard_normal(_STEPS)
        output = _SCALE * true + _SLOPE_DPH_PER_K / 3600.0 * _warm_k() + noise
        rows = np.stack((time_s, output, 25.0 + _warm_k(), rate * time_s), axis=1)
        np.savetxt(folder / f"{number}.csv", rows, "%.9f", ",", header="t,rate,temp,angle", comments="")
        text += (
            f'[[run]]\nfile = "{number}.csv"\nprofile = "warm"\ncondition = "{rate:+g}"\nelevation_deg = 90\n'
        )
    (folder / "map.toml").write_text(text)
    return folder / "map.toml"


def _nominal(folder: Path, fmu: Path, more: str) -> Path:
    file = folder / "nominal.toml"
    file.write_text(
        "format = 1\n[noise]\narw_deg_per_sqrt_h = 0.02\n[simulation]\n" + f'fmu = "{fmu.resolve()}"\n{more}'
    )
    return file


def _asked(*arguments: str) -> dict[str, Any]:
    said = CliRunner().invoke(app, ["gap", *arguments, "--json"])
    if said.exception is not None and not isinstance(said.exception, SystemExit):
        raise said.exception
    return dict(json.loads(said.output.strip().splitlines()[-1] if arguments[0] == "close" else said.output))


def controller_of_dymola(path: Path) -> Iterator[Said]:
    """A limited PI controller, compiled by Dymola: with a slow integral it foretells 1.002 times the rate."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        runs, closed = _campaign(folder), folder / "closed.toml"
        nominal = _nominal(
            folder, path,
            'inputs = { u_s = "rate_dps" }\noutput = { name = "y", unit = "deg/s" }\n'
            f'start_values = {{ "PI.k" = {_SCALE}, "PI.Ti" = 1e9, "PI.yMax" = 1000.0 }}\n',
        )  # fmt: skip
        found = _asked("diagnose", str(runs), "--model", str(nominal))
        names = [cause["name"] for cause in found["causes"]]
        slope = (
            0.02 * found["causes"][0]["parameters"]["bias_dph_per_50k"] if names == ["bias_linear"] else 0.0
        )
        yield Said(
            f"it knows a scale factor of {_SCALE}; the gyro has {_SLOPE_DPH_PER_K} deg/h/K beside",
            "how the runs were made", f"{', '.join(names)}, {slope:.3f} deg/h/K",
            abs(slope / _SLOPE_DPH_PER_K - 1.0) < 0.02,
        )  # fmt: skip
        _asked("close", str(runs), "--model", str(nominal), "--out", str(closed))
        again = _asked("diagnose", str(runs), "--model", str(closed))
        yield Said("nothing is left when that is closed", "how the runs were made", again["verdict"],
                   again["verdict"] == "no gap")  # fmt: skip
        other = _nominal(
            folder, fetched(*_FEEDTHROUGH, path.parent),
            'inputs = { real_in = "rate_dps" }\noutput = { name = "real_out", unit = "deg/s" }\n',
        )  # fmt: skip
        try:
            refused = str(_asked("diagnose", str(runs), "--model", str(other))["verdict"])
        except Exception as error:  # what is said is the statement
            refused = f"refused: {error}"
        yield Said(
            "another of its FMUs has a binary for Windows alone", "its archive",
            refused.replace(f"{path.parent}/", "")[:160],
            "binary for this machine" in refused,
        )  # fmt: skip


RECORDINGS = (
    Recording("FMU of a controller by Dymola", CONTROLLER[0], "BSD-2", controller_of_dymola, CONTROLLER[1]),
)
