"""The diagnosis of all signals of one unit's runs, and the nominal model with its causes in it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from threadpoolctl import threadpool_limits

from bench.analysis.gap._channel_data import ChannelSeries
from bench.analysis.gap._channels import ChannelFinding, ChannelSignal
from bench.analysis.gap._data import GapRun, beside, long_enough
from bench.analysis.gap._fast import FastFinding, FastSignal
from bench.analysis.gap._findings import Cause, Finding, refuse_judges, refuse_several_units
from bench.analysis.gap._model_file import ChannelTerm, DisturbanceTerm, Model, Term
from bench.analysis.gap._position import PositionFinding, PositionRun, PositionSignal
from bench.analysis.gap._rate import RateFinding, RateSignal
from bench.record.shown import Shown
from simulators.effects import CHANNEL_UNITS

Recording = GapRun | ChannelSeries | PositionRun
_WORST = ("unknown", "explained in part", "explained", "within the model's accuracy", "no gap")


@dataclass(frozen=True, eq=False, repr=False)
class Diagnosis(Shown):
    """What was found in each signal of a unit's runs, and the runs by checksum.

    `model` is the nominal one, its parameters for the rate as fitted beside the causes, without the causes.
    """

    unit_id: str
    model: Model
    findings: tuple[Finding[Any], ...]
    run_checksums: Mapping[str, str]

    @property
    def rate(self) -> RateFinding:
        """What was found in the rate; LookupError for runs without one."""
        if self.of_rate is None:
            raise LookupError("these runs have no rate")
        return self.of_rate

    @property
    def of_rate(self) -> RateFinding | None:
        """What was found in the rate, None for runs of a platform and logs without a gyro."""
        return next((finding for finding in self.findings if isinstance(finding, RateFinding)), None)

    @property
    def channels(self) -> tuple[ChannelFinding, ...]:
        """What was found in the channels beside the rate."""
        return tuple(finding for finding in self.findings if isinstance(finding, ChannelFinding))

    @property
    def fast(self) -> FastFinding | None:
        """What was found in the rate above 0.5 Hz, None for logs that are no finer than their means."""
        return next((finding for finding in self.findings if isinstance(finding, FastFinding)), None)

    @property
    def position(self) -> PositionFinding | None:
        """What was found in a platform's position, None for runs of a gyro."""
        return next((finding for finding in self.findings if isinstance(finding, PositionFinding)), None)

    @property
    def verdict(self) -> str:
        """The verdict on the rate or the position; of runs without both the worst on a channel that was seen."""
        of_channels = [channel.verdict for channel in self.channels if not channel.reason]
        if self.of_rate is not None or self.position is not None or not of_channels:
            return self.findings[0].verdict
        return min(of_channels, key=_WORST.index)

    @property
    def causes(self) -> tuple[Cause[Any], ...]:
        """The causes named in any signal."""
        return tuple(cause for finding in self.findings for cause in finding.causes)

    @property
    def closing(self) -> tuple[str, ...]:
        """Names of the effects that the closed model has and the nominal one has not."""
        return tuple(dict.fromkeys(name for finding in self.findings for name in finding.closing))

    def shown(self) -> dict[str, object]:
        """Return the verdict, and the causes named."""
        return {
            "unit": self.unit_id,
            "model": self.model.name,
            "runs": list(self.run_checksums),
            "verdict": self.verdict,
            "causes": [cause.name for cause in self.causes],
        }


def diagnose(
    runs: Sequence[Recording],
    model: Model,
    held_out: Sequence[Recording] = (),
    missing: Mapping[str, str] | None = None,
) -> Diagnosis:
    """Diagnose the gap between recordings of one unit and its nominal model, signal by signal.

    What was found is judged on `held_out` recordings of the same signal. `missing` says by channel why the runs
    lack it. ConfigurationError if a run is to judge that the model was fitted on.
    """
    # its matrices are many and small: threads of BLAS would wait for each other, most of all on a busy machine
    with threadpool_limits(1, "blas"):
        return _diagnosis(runs, model, held_out, missing or {})


def _diagnosis(
    runs: Sequence[Recording], model: Model, held_out: Sequence[Recording], missing: Mapping[str, str]
) -> Diagnosis:
    runs, held_out = beside(model.simulation, runs), beside(model.simulation, held_out)
    rates = [run for run in runs if isinstance(run, GapRun)]
    series = [run for run in runs if isinstance(run, ChannelSeries)]
    positions = [run for run in runs if isinstance(run, PositionRun)]
    used = [*((run.run_id, run.checksum) for run in runs), *model.fitted_on.items()]
    refuse_judges(((run.run_id, run.checksum) for run in held_out), used)
    # of an IMU's axis the rate has a unit of its own
    units = [run.unit_id for run in (*rates, *positions, *held_out) if not isinstance(run, ChannelSeries)]
    units = units or [run.unit_id for run in (*series, *held_out) if run.unit_id]
    refuse_several_units(units)
    findings: list[Finding[Any]] = []
    nominal = model
    if rates or not runs:
        rates, short = long_enough(rates)
        judges_of_rate, few = long_enough([run for run in held_out if isinstance(run, GapRun)])
        rate = RateSignal().find(rates, model, judges_of_rate)
        model = rate.model
        findings.append(replace(rate, warnings=(*rate.warnings, *short, *few)))
        if any(run.fast for run in rates):
            findings.append(FastSignal().find(rates, nominal, judges_of_rate))
    if positions:
        platforms = [run for run in held_out if isinstance(run, PositionRun)]
        findings.append(PositionSignal().find(positions, model, platforms))
    apart = [run for run in held_out if isinstance(run, ChannelSeries)]
    for channel in CHANNEL_UNITS if series or missing else ():
        own, kept = (
            [run for run in part if run.channel == channel and run.pieces()] for part in (series, apart)
        )
        findings.append(_channel(ChannelSignal(channel), own, model, kept, missing.get(channel, "")))
    checksums = {run.run_id: run.checksum for run in (rates or positions or series)}
    return Diagnosis(next(iter(units), ""), model, tuple(findings), checksums)


def _channel(
    signal: ChannelSignal,
    series: Sequence[ChannelSeries],
    model: Model,
    held_out: Sequence[ChannelSeries],
    missing: str,
) -> ChannelFinding:
    if reason := signal.refused(series, model):
        return signal.not_seen(reason if series else missing or reason)
    return signal.find(series, model, held_out)


def closed_model(found: Diagnosis, *, resembling: bool = False) -> Model:
    """Return the nominal model with the causes of all signals in it, and the runs that they were fitted on.

    A channel's own parameters are as fitted, too. `resembling` adds the effects that fit a part of what is called
    unknown in the rate: they shrink the gap without being its cause.
    """
    model = found.model
    rate = found.of_rate
    if rate is not None:
        model = replace(model, terms=rate.nominal.terms)
    alike = [term for cause in rate.resembles for term in cause.terms] if rate and resembling else []
    fitted = [*(term for finding in found.findings for term in finding.terms), *alike]
    channels = {term.name: term for term in fitted if isinstance(term, ChannelTerm)}
    return replace(
        model,
        name="+".join([model.name, *found.closing, *(term.name for term in alike)]),
        terms=(*model.terms, *(term for term in fitted if isinstance(term, Term))),
        disturbances=(*model.disturbances, *(term for term in fitted if isinstance(term, DisturbanceTerm))),
        channel_terms=(
            *(channels.pop(term.name, term) for term in model.channel_terms),
            *channels.values(),
        ),
        fitted_on={**model.fitted_on, **found.run_checksums},
    )
