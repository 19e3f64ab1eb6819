"""What was found as JSON values, for the commands' `--json`; a number that does not exist is null."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from bench.analysis.gap._batch import Batch
from bench.analysis.gap._channels import ChannelFinding
from bench.analysis.gap._diagnose import Diagnosis
from bench.analysis.gap._fast import FastFinding
from bench.analysis.gap._findings import Cause, Place, Shrinkage
from bench.analysis.gap._foretell import ForetoldSigmas
from bench.analysis.gap._identify import Identifiable
from bench.analysis.gap._learn import Learned
from bench.analysis.gap._model_file import AnyTerm, Term, by_parameter
from bench.analysis.gap._position import PositionFinding
from bench.analysis.gap._rate import RateFinding
from bench.analysis.gap._rehearsal import LogGaps
from bench.analysis.gap._suggest import Suggestion

_SHARE = {"share": "share", "low": "low", "high": "high"}
_OF_HELD_OUT = _SHARE | {"rms_before": "rms_before", "rms_after": "rms_after"}
_OF_HELD_OUT_RUN = (
    {"run_id": "run_id"} | _SHARE | {"rms_before_as": "rms_before", "rms_after_as": "rms_after"}
)
_OF_CELL = {"profile": "profile", "parity": "part", "band": "band", "rms_dph": "rms"}
_CLEARNESS = {"share": "share", "energy_ratio": "energy_ratio", "p_value": "p_value"}
_OF_PHASE = {"profile": "profile", "phase": "part", "band": "band", "rms_dph": "rms", "start_s": "start_s"}
_OF_CHANNEL = {"phase": "part", "band": "band", "rms": "rms", "start_s": "start_s"}


def diagnosis_facts(found: Diagnosis, following: Sequence[Suggestion] = ()) -> dict[str, Any]:
    """Return a diagnosis, and what is suggested next, as JSON values."""
    of_unit = {"unit": found.unit_id, "verdict": found.verdict, "runs": dict(found.run_checksums)}
    if found.position is not None:
        return of_unit | _finite(_position(found.position))
    of_rate: dict[str, Any] = {"causes": [], "held_out": None, "warnings": []}
    facts = (of_rate if found.of_rate is None else _rate(found.of_rate)) | {
        "next": [vars(each) for each in following],
        "fast": None if found.fast is None else _fast(found.fast),
        "channels": [_channel(channel) for channel in found.channels],
    }
    return of_unit | _finite(facts)


def batch_facts(batch: Batch) -> dict[str, Any]:
    """Return the diagnoses of a batch's units, and whose each effect is, as JSON values."""
    effects = [
        {
            "name": effect.name,
            "set": list(effect.one_of),
            "kind": effect.kind,
            "in_all": effect.in_all,
            "by_unit": dict(effect.by_unit),
            "terms": {unit: _fitted(term) for unit, term in effect.terms.items()},
            "one_value": dict(effect.one_value),
            "unseen": dict(effect.unseen),
        }
        for effect in batch.effects
    ]
    units = {unit: diagnosis_facts(found) for unit, found in batch.units.items()}
    return _finite({"units": units, "effects": effects})


def identifiable_facts(found: Sequence[Identifiable]) -> dict[str, Any]:
    """Return what runs can show of each effect as JSON values."""
    return {"effects": [_finite(vars(effect)) for effect in found]}


def foretold_facts(found: Sequence[ForetoldSigmas]) -> dict[str, Any]:
    """Return how well parameters are known, now and after each run, as JSON values."""
    now, *after = found
    runs = [
        _finite(
            {
                "procedure": each.design.procedure,
                "parameters": each.design.text,
                "settings": dict(each.design.settings),
                "hours": each.design.hours,
                "hours_as_good_as_best": each.hours,
                "sigma": each.sigmas,
            }
        )
        for each in after
        if each.design is not None
    ]
    return {"units": dict(now.units), "sigma": dict(now.sigmas), "runs": runs}


def log_gap_facts(gaps: LogGaps) -> dict[str, Any]:
    """Return gaps between a log and its rehearsals as JSON values."""
    if gaps.headings:
        return {"headings": [_finite(vars(heading)) for heading in gaps.headings]}
    parts = {"gaps": gaps.rate, "channels": gaps.channels}
    return {name: [_finite(vars(row)) for row in rows] for name, rows in parts.items()}


def _finite(facts: Mapping[str, Any]) -> dict[str, Any]:
    """Return facts with None for every number that does not exist: JSON has no NaN."""

    def known(value: Any) -> Any:
        if isinstance(value, Mapping):
            return _finite(value)
        if isinstance(value, (list, tuple)):
            return [known(each) for each in value]
        return None if isinstance(value, float) and not math.isfinite(value) else value

    return {key: known(value) for key, value in facts.items()}


def _rate(found: RateFinding) -> dict[str, Any]:
    return {
        "causes": [_rate_cause(cause) for cause in found.causes],
        "resembles": [_rate_cause(cause) for cause in found.resembles],
        "stochastic": dict(found.stochastic),
        "stochastic_coefficients": {
            name: found.noise.rises[name] for name in found.stochastic if name in found.noise.rises
        },
        "disturbances": [{"name": term.name, **_fitted(term)} for term in found.disturbed.terms],
        "unknown_probability": found.unknown_probability,
        "no_gap_probability": found.null_probability,
        "sets": {" + ".join(sorted(names)): value for names, value in found.set_probabilities.items()},
        "places": _picked(found.places, _OF_CELL | _CLEARNESS),
        "phases": _picked(found.phases, _OF_PHASE | _CLEARNESS),
        "regimes": [vars(place) for place in found.regimes],
        "unknown_parts": [
            {key: value for key, value in vars(part).items() if key != "term"} for part in found.unknown_parts
        ],
        "learned": None if found.learned is None else _learned(found.learned),
        "left": _picked(found.left, _OF_CELL | _CLEARNESS),
        "unidentifiable": dict(found.unidentifiable),
        "warnings": list(found.warnings),
        "held_out": next((_rate_shrinkage(each) for each in found.held_out if each.cells), None),
    }


def _fast(found: FastFinding) -> dict[str, Any]:
    floor = found.floor
    return {
        "verdict": found.verdict,
        "rows_hz": found.rows_hz,
        "arw_deg_per_sqrt_h": floor.arw_deg_per_sqrt_h,
        "low_pass_hz": floor.corner_hz,
        "low_pass_order": floor.order,
        "damping": floor.damping,
        "angle_noise_arcsec": floor.angle_arcsec,
        "lines": [
            {
                "frequency_hz": line.frequency_hz,
                "amplitude_dph": line.amplitude_dph,
                "amplitudes_dph": dict(line.amplitudes_dph),
                "band_width_hz": line.width_hz if line.broad else None,
                "times_a_turn": line.order,
                "everywhere": line.everywhere,
                "while_turning": line.turning,
            }
            for line in found.lines
        ],
        "places": _picked(found.places, _OF_PHASE | _CLEARNESS),
        "left": _picked(found.left, _OF_PHASE | _CLEARNESS),
        "notes": list(found.notes),
        "held_out": next(iter(_picked(found.held_out, _OF_HELD_OUT)), None),
    }


def _learned(learned: Learned) -> dict[str, Any]:
    return {
        "terms": [{"name": term.name, **_fitted(term)} for term in learned.terms],
        "share_left_out": learned.share if learned.terms else None,
        "by_profile": dict(learned.by_profile),
        "valid": {name: list(span) for name, span in learned.valid.items()},
        "reason": learned.reason,
    }


def _rate_cause(cause: Cause[Term]) -> dict[str, Any]:
    return {
        "name": cause.name,
        "probability": cause.probability,
        "set": list(cause.one_of),
        "set_probability": cause.set_probability,
        "alternatives": dict(cause.alternatives),
        **_fitted(cause.term),
        "shape": dict(cause.term.variant.shape),
        "form": [
            {"name": term.name, **_fitted(term), "shape": dict(term.variant.shape)} for term in cause.form
        ],
        "explained_where_it_acts": cause.credibility,
    }


def _rate_shrinkage(held: Shrinkage) -> dict[str, Any]:
    parts = {"by_profile": held.by_profile, "by_runs": held.by_runs, "by_phase": held.by_phase}
    return {
        "share": held.share,
        "caution": held.caution,
        "interval_95": [held.low, held.high],
        "rms_before_dph": held.rms_before,
        "rms_after_dph": held.rms_after,
        **{
            key: {name: value for name, value in shares.items() if math.isfinite(value)}
            for key, shares in parts.items()
        },
    }


def _channel(found: ChannelFinding) -> dict[str, Any]:
    if found.reason:
        return {"channel": found.signal, "verdict": found.verdict, "reason": found.reason}
    return {
        "channel": found.signal,
        "unit": found.unit,
        "verdict": found.verdict,
        "rms": found.rms,
        "floor_rms": found.floor_rms,
        "floor_from": found.floor_source,
        "explained": found.explained,
        "causes": [
            {
                "name": cause.name,
                "probability": cause.probability,
                "alternatives": dict(cause.alternatives),
                **_fitted(cause.term),
                "nominal": by_parameter(cause.term, cause.nominal),
            }
            for cause in found.causes
        ],
        "places": _picked(found.places, _OF_CHANNEL | _CLEARNESS),
        "left": _picked(found.left, _OF_CHANNEL | _CLEARNESS),
        "stochastic": dict(found.stochastic),
        "held_out": next(iter(_picked(found.held_out, _OF_HELD_OUT)), None),
        "caution": found.caution,
    }


def _position(found: PositionFinding) -> dict[str, Any]:
    fitted = [_fitted(cause.term) for cause in found.causes if cause.term is not None]
    return {
        "causes": {cause.name: cause.probability for cause in found.causes},
        "alternatives": {name: p for cause in found.causes for name, p in cause.alternatives.items()},
        "no_gap_probability": found.null_probability,
        "steps_beside": found.unknown,
        **(fitted[0] if fitted else {"parameters": {}, "sigma": {}}),
        "places": [vars(place) for place in found.stays],
        "held_out": _picked(found.held_out, _OF_HELD_OUT_RUN),
        "warnings": list(found.warnings),
    }


def _fitted(term: AnyTerm) -> dict[str, dict[str, float]]:
    return {"parameters": by_parameter(term, term.values), "sigma": by_parameter(term, term.sigmas)}


def _picked(rows: Sequence[Place | Shrinkage], names: Mapping[str, str]) -> list[dict[str, Any]]:
    """Return fields of rows under the names that JSON has for them."""
    return [{name: getattr(row, field) for name, field in names.items()} for row in rows]
