"""The exported C, compiled as firmware would compile it, against the Python stream it stands for."""

from __future__ import annotations

import shutil
import subprocess
import zlib
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest

from bench.analysis.export._c_header import c_header
from bench.analysis.export._c_program import CConstant, CProgram
from bench.analysis.thermal import FeatureRun, Prediction, ThermalRun
from bench.analysis.thermal._compensation import Compensation
from bench.analysis.thermal._stream import Flag
from bench.analysis.thermal._width import PredictionWidth
from drivers.base.arrays import Array
from drivers.base.errors import ConfigurationError

COMPILER = shutil.which("gcc") or shutil.which("cc") or shutil.which("clang")
needs_compiler = pytest.mark.skipif(COMPILER is None, reason="no C compiler")
NAMES = (
    *("poly3", "multilinear", "stepwise", "lag_ridge", "lag_ridge_x_temp", "grey_box", "grey_box_residual"),
    *("lstm", "lstm_of_case", "hybrid", "mean"),
)

MAIN = """
#include <stdio.h>
#include <string.h>
#include "gyrocomp.h"
int main(int argc, char **argv)
{
    static gyrocomp_state s;
    double a, b, c, d, f;
    if (argc > 1 && !strcmp(argv[1], "check")) {
        printf("%d %08X\\n", gyrocomp_self_test(&s), (unsigned)gyrocomp_crc());
        return 0;
    }
    gyrocomp_init(&s);
    while (scanf("%lf %lf %lf %lf %lf", &a, &b, &c, &d, &f) == 5) {
        gyrocomp_drift r;
        if (argc > 1) r = gyrocomp_step(&s, (float)a, (float)b, (float)c, (float)d);
        else r = gyrocomp_push(&s, (uint32_t)a, (float)b, (float)c);
        printf("%.9g %.9g %.17g %u\\n", r.bias_dph, r.sf_error_ppm, gyrocomp_rate_dps(&r, f), r.flags);
    }
    return 0;
}
"""


@dataclass(frozen=True)
class Compiled:
    program: Path

    def run(self, rows: Array, *arguments: str) -> Array:
        """Feed rows of five numbers; return (n, 4): bias, scale factor, corrected rate, flags."""
        text = "\n".join(" ".join(f"{value:.17g}" for value in row) for row in rows)
        done = subprocess.run(
            [self.program, *arguments], input=text, capture_output=True, text=True, check=True
        )
        return np.array([[float(word) for word in line.split()] for line in done.stdout.splitlines()])

    def check(self) -> tuple[int, int]:
        done = subprocess.run([self.program, "check"], capture_output=True, text=True, check=True)
        result, crc = done.stdout.split()
        return int(result), int(crc, 16)


def build(folder: Path, header: str, main: str = MAIN) -> Compiled:
    assert COMPILER is not None
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "gyrocomp.h").write_text(header)
    (folder / "main.c").write_text(main)
    flags = ["-std=c99", "-Wall", "-Wextra", "-Wshadow", "-Werror", "-O2"]
    command = [COMPILER, *flags, "main.c", "-o", "main", "-lm"]
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return Compiled(folder / "main")


@pytest.fixture(scope="module")
def live(test_run: ThermalRun) -> Array:
    """Seconds of a live stream: gaps, a dead sensor, a repeat, a long silence, an excursion."""
    run = test_run
    output = 1.25 * 20.0 * np.ones(run.time_s.size)
    rows = np.column_stack([run.time_s, run.gyro_temp_c, run.case_temp_c, np.zeros(run.time_s.size), output])
    rows[:5, 1] = np.nan
    rows[400:404, 2] = np.nan
    rows[2000:2130, 1] = np.nan
    rows[6000:6100, 1:3] += 40.0
    keep = np.ones(len(rows), dtype=bool)
    keep[3000:3007] = keep[3500:3800] = keep[7000:7700] = False
    rows = rows[keep]
    rows = np.insert(rows, 1000, rows[990], axis=0)
    rows[:, 1:3] = rows[:, 1:3].astype(np.float32)
    return rows


def streamed(compensation: Compensation, rows: Array) -> Array:
    stream = compensation.stream(compensation.unit_id)
    samples = [stream.push(t, gyro, case, output) for t, gyro, case, _, output in rows.tolist()]
    return np.array([[s.bias_dph, s.sf_error_ppm, s.rate_dps, int(s.flags)] for s in samples])


@needs_compiler
@pytest.mark.parametrize("name", NAMES)
def test_c_is_the_python_stream(
    name: str, compensations: Callable[[str], Compensation], live: Array, tmp_path: Path
) -> None:
    compensation = compensations(name)
    compiled = build(tmp_path, c_header(compensation))
    assert compiled.check()[0] == 0
    ours, theirs = streamed(compensation, live), compiled.run(live)
    worst = np.abs(ours - theirs).max(axis=0)
    np.testing.assert_array_equal(theirs[:, 3], ours[:, 3])
    assert worst[0] < 1e-6, f"bias differs by {worst[0]:.2g} deg/h"
    assert worst[1] < 1e-3, f"scale factor differs by {worst[1]:.2g} ppm"
    assert worst[2] < 1e-3 * 1e-6 * 20 + 1e-6 / 3600, f"rate differs by {worst[2]:.2g} deg/s"
    seen = Flag(int(np.bitwise_or.reduce(ours[:, 3].astype(int))))
    assert seen & ~Flag.CLAMPED == ~Flag.CLAMPED & sum(Flag), "the stream must raise every flag"


@needs_compiler
def test_c_tells_how_far_off_the_drift_may_be(
    compensations: Callable[[str], Compensation], live: Array, tmp_path: Path
) -> None:
    width = PredictionWidth(np.array([[0.01, 0.02, 0.003], [1.0, 0.5, 0.1]]), 5)
    compensation = replace(compensations("poly3"), width=width)
    text = MAIN.replace('"%.9g %.9g %.17g %u\\n", r.bias_dph, r.sf_error_ppm, gyrocomp_rate_dps(&r, f), r.flags',
                        '"%.9g %.9g\\n", r.bias_half_dph, r.sf_half_ppm')  # fmt: skip
    theirs = build(tmp_path, c_header(compensation), text).run(live)
    stream = compensation.stream(compensation.unit_id)
    samples = [stream.push(t, gyro, case, output) for t, gyro, case, _, output in live.tolist()]
    ours = np.array([[sample.bias_half_dph, sample.sf_half_ppm] for sample in samples])
    np.testing.assert_allclose(theirs, ours, rtol=1e-6, equal_nan=True)
    outside = np.array([bool(sample.flags & Flag.OUT_OF_RANGE) for sample in samples])
    assert np.nanmax(ours[outside, 0]) > 1.5 * np.nanmax(ours[~outside, 0])


@needs_compiler
def test_a_changed_constant_fails_the_self_test(
    compensations: Callable[[str], Compensation], tmp_path: Path
) -> None:
    header = c_header(compensations("lag_ridge"))
    intact = build(tmp_path / "intact", header)
    start = header.index("gyrocomp_lag_gain[6] = {") + len("gyrocomp_lag_gain[6] = {")
    digit = next(i for i in range(start, len(header)) if header[i] in "123456789")
    swapped = header[:digit] + ("3" if header[digit] != "3" else "4") + header[digit + 1 :]
    damaged = build(tmp_path / "damaged", swapped)
    assert intact.check() == (0, int(header.split("GYROCOMP_CRC32 0x")[1][:8], 16))
    assert damaged.check()[0] == -1
    crc = f"0x{damaged.check()[1]:08X}u"
    resealed = swapped.replace(f"0x{intact.check()[1]:08X}u", crc)
    assert build(tmp_path / "resealed", resealed).check()[0] > 0, "the vector must catch what the CRC cannot"


@needs_compiler
def test_crc_is_zlibs_over_the_printed_values(
    compensations: Callable[[str], Compensation], tmp_path: Path
) -> None:
    """Read the numbers back out of the C text and seal them with another CRC-32."""
    header = c_header(compensations("grey_box"))
    crc = 0
    for block in header.split("static const ")[1:]:
        kind, body = block.split(" ", 1)
        text = body.split("{", 1)[1].split("}", 1)[0].replace("f", "")
        values = np.array([float(word) for word in text.split(",") if word.strip()])
        crc = zlib.crc32(values.astype("<f4" if kind == "float" else "<f8").tobytes(), crc)
        if "inline" in body.split("};", 1)[1][:400]:
            break
    assert build(tmp_path, header).check() == (0, crc)


@needs_compiler
def test_step_holds_what_is_not_a_number_and_cuts_the_output(
    compensations: Callable[[str], Compensation], tmp_path: Path
) -> None:
    compensation = compensations("poly3")
    tight = replace(compensation, limits=replace(compensation.limits, sf_error_ppm=(-150.0, 50.0)))
    compiled = build(tmp_path, c_header(tight))
    nan, inf = np.nan, np.inf
    rows = np.array([[nan, 25, 0, 0, 0], [20, 20, 0, 0, 0], [nan, 20, inf, 0, 0], [-40, -40, 0, 0, 0]])
    out = compiled.run(rows, "step")
    assert out[0, 3] == Flag.MISSING | Flag.NO_DRIFT and out[0, 0] == out[0, 1] == 0.0
    np.testing.assert_array_equal(out[2, :2], out[1, :2])
    assert out[2, 3] == Flag.MISSING and out[1, 3] == 0
    assert out[3, 3] == Flag.CLAMPED and out[3, 1] == -150.0


class ConstantModel:
    """A model of another maker: 0.5 deg/h and 3 ppm per degC, with a C form of its own."""

    name = "constant"

    def fit(self, train: object, validation: object) -> None: ...

    def predict(self, run: FeatureRun) -> Prediction:
        return Prediction(np.full(run.t_in.size, 0.1), 3.0 * run.t_in)

    def stepper(self) -> ConstantModel:
        return self

    def step(self, t_in: float, t_out: float, dt_60: float, gradient: float) -> tuple[float, float]:
        return 0.1, 3.0 * t_in

    def to_state(self) -> dict[str, object]:
        return {}

    def c_programs(self) -> list[CProgram]:
        source = (
            "{% macro state() %}int {{ s }}unused;{% endmacro %}"
            "{% macro start() %}s->{{ s }}unused = 0;{% endmacro %}"
            "{% macro step() %}bias += {{ k }}gain[0]; sf += {{ k }}gain[1] * t_in;{% endmacro %}"
        )
        return [CProgram("other", source, (CConstant("gain", np.array([0.1, 3.0])),))]


@needs_compiler
def test_another_makers_model_exports_through_its_own_method(
    compensations: Callable[[str], Compensation], tmp_path: Path
) -> None:
    compensation = replace(compensations("poly3"), model=ConstantModel())
    compiled = build(tmp_path, c_header(compensation))
    assert compiled.check()[0] == 0
    out = compiled.run(np.array([[10.0, 10.0, 0.0, 0.0, 0.0]]), "step")
    np.testing.assert_allclose(out[0, :2], [0.1, 30.0], rtol=1e-6)


def test_header_names_its_papers(compensations: Callable[[str], Compensation]) -> None:
    compensation = replace(compensations("poly3"), unit_id='evil"*/ id')
    header = c_header(compensation)
    assert '#define GYROCOMP_UNIT_ID "evil_*_ id"' not in header
    assert '#define GYROCOMP_UNIT_ID "evil___ id"' in header
    assert "#define GYROCOMP_K_REF 1.25" in header and "bias-1, bias-2, sf-3, sf-4" in header
    assert "malloc" not in header


def test_refusals(compensations: Callable[[str], Compensation]) -> None:
    compensation = compensations("poly3")
    with pytest.raises(ConfigurationError, match="beyond the range"):
        c_header(replace(compensation, reference_temp_c=1e39))

    class Unknown(ConstantModel):
        name = "unknown"
        c_programs = None  # type: ignore[assignment]  # hides the method: a model without a C form

    with pytest.raises(ConfigurationError, match="no C form"):
        c_header(replace(compensation, model=Unknown()))
