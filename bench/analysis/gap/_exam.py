"""The blind exam: cases from plants whose physics is not the catalogue's, and the examined diagnosis."""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace

import numpy as np

from bench.analysis.gap._cells import BANDS, group_cells
from bench.analysis.gap._close import judged_cells, shrinkage
from bench.analysis.gap._data import GapRun, group_runs
from bench.analysis.gap._diagnose import closed_model, diagnose
from bench.analysis.gap._findings import Shrinkage
from bench.analysis.gap._fit import Floor, nominal_energies
from bench.analysis.gap._model_file import Model, Term, model_text, parse_model
from bench.analysis.gap._noise import Noise
from bench.analysis.gap._signature import signature_norm, with_nominal
from drivers.base.arrays import Array
from simulators.effects import Effect, Stimulus, Variant, catalogue
from simulators.exam import (
    LATITUDE_DEG,
    SF_SIGMA_PPM,
    SHEET,
    SLOPE_SIGMA_DPH,
    ExamCase,
    RunTruth,
    draw_case,
    outputs_dph,
    read_temperature,
    signal_dph,
    simulate_campaign,
)

REPEATS = 3
"""Two repeats to diagnose, the third sealed for closing."""


@dataclass(frozen=True)
class Sealed:
    """The answer of a case; its hash is given out before the diagnosis starts."""

    case: ExamCase
    amplitudes: Mapping[str, float]
    snr: Mapping[str, float]
    region: tuple[tuple[str, str, str], ...]
    """Cells (profile, runs, band) that hold 80 % of the effects' true energy, strongest first."""

    @property
    def text(self) -> str:
        """The answer as JSON."""
        return json.dumps(
            {
                "case": asdict(self.case),
                "amplitudes": dict(self.amplitudes),
                "snr": dict(self.snr),
                "region": [list(cell) for cell in self.region],
            },
            sort_keys=True,
        )

    @property
    def sha256(self) -> str:
        """The seal."""
        return hashlib.sha256(self.text.encode()).hexdigest()


@dataclass(frozen=True)
class Answer:
    """What an examined diagnosis hands in; models are the text of their files."""

    alternatives: Mapping[str, Mapping[str, float]]
    probabilities: Mapping[str, float]
    unknown_probability: float
    stochastic: tuple[str, ...]
    strongest: tuple[str, str, str]
    before: str
    after: str
    floor: Floor


@dataclass(frozen=True)
class Closed:
    """Shrinkage on the sealed runs as stated, and as it truly is without noise."""

    stated: Shrinkage
    true_share: float


def nominal_model() -> Model:
    """Return the nominal model that an examined diagnosis is given."""
    effects = catalogue()
    scale, slope = effects["scale_factor"], effects["bias_linear"]
    assert isinstance(scale, Effect) and isinstance(slope, Effect)
    terms = (
        Term(Variant(scale, {}), (0.0,), (SF_SIGMA_PPM,)),
        Term(Variant(slope, dict(slope.shapes[0])), (0.0,), (SLOPE_SIGMA_DPH,)),
    )
    noise = Noise(SHEET["arw"], SHEET["flicker"], SHEET["walk"], SHEET["quantum"])
    return Model("nominal", terms, noise)


def make_case(seed: int, kind: str) -> tuple[Sealed, list[GapRun], list[GapRun], list[Array]]:
    """Return the sealed answer, the runs to diagnose, the sealed runs and the latter without gap and noise."""
    case = draw_case(seed, kind)
    truths = simulate_campaign(seed, REPEATS)
    rng = np.random.default_rng((seed, 9))
    stimuli = [
        Stimulus(
            truth.time_s,
            read_temperature(truth.t_in_c, rng),
            read_temperature(truth.t_out_c, rng),
            truth.angle_deg,
            truth.elevation_deg,
            LATITUDE_DEG,
        )
        for truth in truths
    ]
    model = nominal_model()
    shown = [k for k, truth in enumerate(truths) if truth.repeat < REPEATS - 1]
    apart = [k for k, truth in enumerate(truths) if truth.repeat == REPEATS - 1]
    amplitudes, pure = {}, [np.zeros(len(truths[k].time_s)) for k in shown]
    for index, effect in enumerate(case.effects):
        signals = [signal_dph(case, effect, truths[k]) for k in shown]
        alone = [_run(truths[k], stimuli[k], signal) for k, signal in zip(shown, signals, strict=True)]
        # a whitened signature, nominal columns projected out, has norm 10 snr
        sign = -1.0 if (case.seed + index) % 2 else 1.0
        amplitudes[effect] = sign * 10.0 * case.snr / signature_norm(alone, model)
        pure = [gap + amplitudes[effect] * signal for gap, signal in zip(pure, signals, strict=True)]
    outputs = outputs_dph(case, truths, amplitudes)
    runs = [_run(*of_run) for of_run in zip(truths, stimuli, outputs, strict=True)]
    given, kept = [runs[k] for k in shown], [runs[k] for k in apart]
    clean = outputs_dph(case, [truths[k] for k in apart], amplitudes, noisy=False)
    gaps = [replace(run, output_dph=gap) for run, gap in zip(given, pure, strict=True)]
    return (
        Sealed(case, amplitudes, dict.fromkeys(case.effects, case.snr), true_region(gaps, model)),
        given,
        kept,
        clean,
    )


def _run(truth: RunTruth, stimulus: Stimulus, output: Array) -> GapRun:
    name = f"{truth.profile} {truth.condition} {truth.repeat + 1}"
    return GapRun(name, "unit", truth.profile, truth.condition, stimulus, output, truth.phase)


def true_region(runs: Sequence[GapRun], model: Model) -> tuple[tuple[str, str, str], ...]:
    """Return the repeatable cells with 80 % of the energy of outputs taken as a gap, nominal model out."""
    cells = []
    for group in group_runs(runs):
        cells += group_cells(group, with_nominal(group, model), model.noise)
    left = zip(nominal_energies(cells, model.sigmas), cells, strict=True)
    energy = sorted(
        ((own, (cell.profile, cell.parity, BANDS[cell.band])) for own, cell in left if cell.repeatable),
        reverse=True,
    )
    total, gathered, region = sum(own for own, _ in energy), 0.0, []
    for own, cell in energy:
        if total <= 0.0 or gathered >= 0.8 * total:
            break
        gathered += own
        region.append(cell)
    return tuple(region)


def examined(runs: Sequence[GapRun], nominal: str) -> Answer:
    """Diagnose runs with the text of a nominal model; all that the examined process is given."""
    diagnosis = diagnose(runs, parse_model(nominal, "nominal"))
    found = diagnosis.rate
    strongest = found.places[0]
    return Answer(
        {cause.name: dict(cause.alternatives) for cause in found.causes},
        {cause.name: cause.probability for cause in found.causes},
        found.unknown_probability,
        tuple(found.stochastic),
        (strongest.profile, strongest.part, strongest.band),
        model_text(found.model),
        model_text(closed_model(diagnosis, resembling=True)),
        found.floor,
    )


def close(handed: Answer, sealed_runs: Sequence[GapRun], clean: Sequence[Array]) -> Closed:
    """Judge the models handed in on the sealed runs, and on the same without noise (`clean`, (n,) a run)."""
    before, after = parse_model(handed.before, "before"), parse_model(handed.after, "after")
    stated = shrinkage(before, after, sealed_runs, handed.floor)
    quiet = [replace(run, output_dph=own) for run, own in zip(sealed_runs, clean, strict=True)]
    cells = [cell for cell, on in zip(judged_cells((before, after), quiet), stated.active, strict=True) if on]
    first, then = (sum(float(cell.products(np.array([k]))[0, 0]) for cell in cells) for k in (0, 1))
    return Closed(stated, 1.0 - then / first if first > 0.0 else math.nan)
