"""What tests of plant families share: runs at rest, a run's inputs by the second, truths against the catalogue,
nulls against the noise of the data sheet.
"""

import allantools
import numpy as np
from scipy.fft import dct

from bench.analysis.gap import read_recordings
from benchmarks.gap_exam._make import Plan, draw_unit, make_case, prepare_folder
from benchmarks.gap_exam._signals import drawn
from benchmarks.gap_exam._stage import Stage
from benchmarks.gap_exam._whitening import NoiseLevels
from simulators.effects import Stimulus, Variant, catalogue


def still(n, step_s=1.0, **changed):
    """A run at rest, axis level west, a row a step; `changed` are fields of it."""
    fields = {
        "code": "X", "profile": "x", "condition": "x", "repeat": 0, "number": 0, "step_s": step_s,
        "angle_deg": np.full(n + 1, 90.0), "elevation_deg": np.zeros(n), "bodies_c": {},
        "t_in_c": np.full(n, 25.0), "t_out_c": np.full(n, 25.0), "edges_s": step_s * np.arange(n + 1.0),
        "valid": np.ones(n, bool), "kept": np.ones(n, bool), "phases": (("run", 0.0),),
    }  # fmt: skip
    return Stage(**{**fields, **changed})


def run(stages, code, repeat=0):
    """The run of a campaign by its code and repeat."""
    return next(stage for stage in stages if (stage.code, stage.repeat) == (code, repeat))


def deviations(family, taus, n, step_s=1.0, units=6):
    """Root of the mean square of the Allan deviations of null units at rest, deg/h."""
    squares = []
    for seed in range(units):
        output = family.rows(draw_unit(family, seed, {}), still(n, step_s), np.zeros(n), drawn(seed, "noise"))
        _, found, _, _ = allantools.oadev(output, rate=1.0 / step_s, data_type="freq", taus=taus)
        squares.append(found**2)
    return np.sqrt(np.mean(squares, axis=0))


def stimulus(family, stage):
    """A run's inputs by the second."""
    seconds = stage.edges_s[0] + np.arange(stage.seconds + 1.0)
    angle = np.interp(seconds, np.arange(stage.steps + 1) * stage.step_s, stage.angle_deg)
    middles = ((seconds[1:] - 0.5) / stage.step_s).astype(int)
    return Stimulus(
        seconds[1:] + stage.power_on_s,
        stage.in_seconds(stage.t_in_c),
        stage.in_seconds(stage.t_out_c),
        angle,
        stage.elevation_deg[middles],
        family.latitude_deg,
    )


def share_of_the_column(family, unit, stages, name, size=0.5):
    """How much of the catalogue's own column, with the true values stated, a signal has: 1 if they agree.

    The column has the form of its grid that is most like the signal. A bias of its own is each run's to fit.
    """
    effect = family.effects[name]
    truth, model = effect.truth(unit, size), catalogue()[effect.names[0]]
    assert truth.keys() <= {parameter.name for parameter in model.parameters}
    values = np.array([truth.get(parameter.name, 0.0) for parameter in model.parameters])
    shown = [(stage, stage.seen(), stimulus(family, stage)) for stage in stages if not stage.held_out]

    def joined(rows):
        return np.concatenate(
            [row[seen] - row[seen].mean() for row, (_, seen, _) in zip(rows, shown, strict=True)]
        )

    signal = joined([stage.in_seconds(effect.signal(unit, stage, size)) for stage, _, _ in shown])
    columns = [
        joined([values @ Variant(model, dict(shape)).columns(inputs) for _, _, inputs in shown])
        for shape in model.shapes or ({},)
    ]
    best = max(columns, key=lambda column: abs(signal @ column) / np.sqrt(column @ column))
    return float(signal @ best) / float(best @ best)


def sheet_noise(family):
    sheet = family.sheet
    return NoiseLevels(
        sheet.arw_deg_per_sqrt_h,
        sheet.bias_instability_dph,
        sheet.rate_random_walk_dph_per_sqrt_h,
        sheet.quantum_arcsec,
    )


def null_residual(family, folder, seed, without=(), period_s=30.0, seen_share=0.97):
    """What is left of a null case's files over the noise of the sheet, beyond scale factor, slope and biases.

    Spectra by run above a period that bridged rows do not touch; profiles `without` are left out.
    """
    prepare_folder(family, folder)
    make_case(family, folder, Plan("null_1", "null", seed, ()))
    noise = sheet_noise(family)
    whitened, columns = [], []
    for run in read_recordings([folder / "cases" / "null_1" / "runs.toml"]).shown:
        step_s = run.stimulus.period_s
        seen = np.isfinite(run.output_dph)
        if seen.mean() < seen_share or run.profile in without:
            continue
        index = np.arange(len(seen))
        rate, t_in = run.stimulus.input_rate_dph, run.stimulus.t_in_c
        rows = [np.interp(index, index[seen], v[seen]) for v in (run.output_dph - rate, rate, t_in)]
        slow = round(2.0 * len(seen) * step_s / period_s)
        spectra = dct(np.stack(rows), norm="ortho")[:, 1:slow]
        spectra /= np.sqrt(noise.power(len(seen), step_s)[: slow - 1])
        whitened.append(spectra[0])
        columns.append(spectra[1:])
    assert len(whitened) > 10
    values, known = np.concatenate(whitened), np.concatenate(columns, axis=1)
    return np.asarray(values - np.linalg.lstsq(known.T, values, rcond=None)[0] @ known)


def repeats_apart(family, unit, stages, name, without=()):
    """The share of an effect's variance that two repeats of one run differ by, and its variance in all."""
    effect = family.effects[name]
    runs = {stage.key: stage for stage in stages}
    size = effect.sizes[1] if effect.curved else 1.0
    signals = {key: stage.in_seconds(effect.signal(unit, stage, size)) for key, stage in runs.items()}
    assert all(np.isfinite(signal).all() for signal in signals.values()), name
    whole = sum(float(np.var(signal)) for signal in signals.values())
    apart = 0.0
    for key, stage in runs.items():
        twin = signals.get(f"{stage.code}|{stage.repeat - 1}")
        if twin is not None and stage.code not in without:
            n = min(len(twin), len(signals[key]))
            apart += float(np.var(signals[key][:n] - twin[:n]))
    return apart / max(whole, 1e-30), whole
