"""The plant of `gyrobench gap exam` in the format of the other families: its cases, put into folders as
theirs are.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from benchmarks.gap_exam._family import Family, Layout, Sheet
from benchmarks.gap_exam._files import Logged, Seal, write_case, write_seal
from benchmarks.gap_exam._make import Plan
from benchmarks.gap_exam._signals import drawn
from benchmarks.gap_exam._stage import Stage
from benchmarks.gap_exam._whitening import NoiseLevels, Part, deflection
from drivers.base.arrays import Array
from simulators.exam import (
    KNOWN,
    LATITUDE_DEG,
    SF_SIGMA_PPM,
    SHEET,
    SLOPE_SIGMA_DPH,
    UNKNOWN,
    ExamCase,
    RunTruth,
    draw_case,
    outputs_dph,
    read_temperature,
    signal_dph,
    simulate_campaign,
)

KINDS = {"outside": "unknown", "mixed": "known and unknown", "noise": "stochastic"}
"""What the exam calls a kind of case; the others have one name."""
_SAME = {
    "bias_quadratic": ("bias_quadratic", "bias_cubic"),
    "bias_cubic": ("bias_cubic", "bias_quadratic"),
    "azimuth_error": ("azimuth_error", "table_tilt"),
}
_NOISE = NoiseLevels(SHEET["arw"], SHEET["flicker"], SHEET["walk"], SHEET["quantum"])
_REPEATS = 3


def _never(*_: object) -> list[Stage]:
    raise TypeError("the exam's plant simulates its campaigns by itself")


EXAM_PLANT = Family(
    name="exam_plant",
    latitude_deg=LATITUDE_DEG,
    sheet=Sheet(
        SHEET["arw"], SHEET["flicker"], SHEET["walk"], SHEET["quantum"], SF_SIGMA_PPM, SLOPE_SIGMA_DPH, 0.01
    ),
    layout=Layout(".parquet", ("rate_dph", "deg/h"), ("angle_deg", "deg")),
    effects={},
    noisy={},
    campaign=_never,
    rows=_never,  # type: ignore[arg-type]
    read=_never,  # type: ignore[arg-type]
)


def plan_exam_cases(kinds: Sequence[str], seed: int) -> list[Plan]:
    """Return cases of the kinds given; the exam draws their effects itself."""
    return [
        Plan(f"{kind}_{seed}_{number}", kind, 10_000 * seed + number, ()) for number, kind in enumerate(kinds)
    ]


def make_exam_case(folder: Path, what: Plan) -> str:
    """Make a case, write it into cases/ and sealed/; return its name."""
    rng = drawn(what.seed, "exam plant")
    case = draw_case(what.seed, KINDS.get(what.kind, what.kind))
    # the other families draw from 1 to 30
    case = replace(case, snr=math.exp(rng.uniform(0.0, math.log(30.0))))
    truths = simulate_campaign(what.seed, _REPEATS)
    stages = [_stage(truth, number) for number, truth in enumerate(truths)]
    clean = outputs_dph(replace(case, sf_ppm=0.0, slope_dph=0.0), truths, {}, noisy=False)
    sizes = _sizes(case, truths, stages, clean)
    outputs = outputs_dph(case, truths, sizes)
    logs = [
        Logged(
            stage,
            output,
            read_temperature(truth.t_in_c, rng),
            read_temperature(truth.t_out_c, rng),
            truth.angle_deg,
        )
        for stage, truth, output in zip(stages, truths, outputs, strict=True)
    ]
    write_case(folder / "cases" / what.name, EXAM_PLANT, logs)
    parts = {
        f"{name}|{stage.key}": size * signal_dph(case, name, truth)
        for name, size in sizes.items()
        for stage, truth in zip(stages, truths, strict=True)
    }
    write_seal(folder / "sealed", what.name, _seal(what.kind, case, sizes, stages), parts)
    return what.name


def _stage(truth: RunTruth, number: int) -> Stage:
    n = len(truth.time_s)
    changes = [0, *(np.flatnonzero(truth.phase[1:] != truth.phase[:-1]) + 1).tolist()]
    everything = np.ones(n, dtype=bool)
    return Stage(
        code=f"{truth.profile} {truth.condition}".replace(" ", "_"),
        profile=truth.profile,
        condition=truth.condition,
        repeat=truth.repeat,
        number=number,
        step_s=1.0,
        angle_deg=truth.angle_deg,
        elevation_deg=truth.elevation_deg,
        bodies_c={},
        t_in_c=truth.t_in_c,
        t_out_c=truth.t_out_c,
        edges_s=np.arange(n + 1.0),
        valid=everything,
        kept=everything,
        phases=tuple((str(truth.phase[k]), float(k)) for k in changes),
        held_out=truth.repeat == _REPEATS - 1,
    )


def _sizes(
    case: ExamCase, truths: Sequence[RunTruth], stages: Sequence[Stage], clean: Sequence[Array]
) -> dict[str, float]:
    """Return the amplitude of each effect at which it has the case's ratio."""
    sizes = {}
    for index, effect in enumerate(case.effects):
        parts = [
            Part(signal_dph(case, effect, truth)[None], np.stack((rate, truth.t_in_c - 25.0)), stage.seen())
            for truth, stage, rate in zip(truths, stages, clean, strict=True)
            if not stage.held_out
        ]
        sign = -1.0 if (case.seed + index) % 2 else 1.0
        sizes[effect] = sign * 10.0 * case.snr / deflection(parts, _NOISE)
    return sizes


def _seal(kind: str, case: ExamCase, sizes: Mapping[str, float], stages: Sequence[Stage]) -> Seal:
    effects = [*sizes.items(), *([(case.stochastic, case.noise["arw"])] if case.stochastic else [])]
    names = {name: _SAME.get(name, (name,)) if name in KNOWN else () for name in sizes}
    if case.stochastic:
        names[case.stochastic] = (case.stochastic,)
    held_out = tuple(stage.run_id for stage in stages if stage.held_out)
    assert all(name in KNOWN or name in UNKNOWN for name in sizes)
    return Seal(kind, tuple(effects), dict.fromkeys(sizes, case.snr), held_out, names)
