"""A campaign's verdict: what came out, in a word, a sentence and four figures."""

from __future__ import annotations

from collections.abc import Sequence

from bench.present.report._content import CampaignContent, CompensationSummary, ModelScore
from bench.present.report._numbers import fixed, known, mean, significant
from bench.present.report._page import Headline, Tone, Verdict
from bench.present.report._scores import attained


def campaign_verdict(content: CampaignContent) -> Verdict:
    """Return the verdict. Good: all runs valid and, with a compensation, less drift left on held-out runs."""
    valid = sum(run.valid for run in content.runs)
    runs_text = f"{valid} of {len(content.runs)} runs valid"
    headlines = [Headline("Valid runs", f"{valid} of {len(content.runs)}")]
    if not content.runs:
        return Verdict("No runs", "doubt", ["There is nothing to judge."])
    tone: Tone = "good" if valid == len(content.runs) else "doubt" if valid else "bad"
    word = "All runs valid" if tone == "good" else runs_text
    sentences = [] if tone == "good" else [_invalid_sentence(len(content.runs) - valid)]
    floor = significant(content.noise_floor_dph) if known(content.noise_floor_dph) else ""
    if content.compensation is None:
        headlines += [Headline("Noise floor of 100 s means", floor, "°/h", note="1σ")] if floor else []
        return Verdict(word, tone, sentences, headlines)
    scores = chosen_scores(content)
    word = f"Compensated by {content.compensation.model}" + ("" if tone == "good" else f"; {runs_text}")
    tone = _worse(tone, _judged(scores))
    sentences.insert(0, _compensation_sentence(content.compensation, scores))
    return Verdict(word, tone, sentences, [*headlines, *_headlines(scores, floor)])


def chosen_scores(content: CampaignContent) -> list[ModelScore]:
    """Return the scores of the chosen model; none without a compensation."""
    if content.compensation is None:
        return []
    return [score for score in content.scores if score.model == content.compensation.model]


def _judged(scores: Sequence[ModelScore]) -> Tone:
    improvement = mean(score.improvement_percent for score in scores)
    if improvement is None:
        raw, rms = mean(s.sf_raw_rms_ppm for s in scores), mean(s.sf_rms_ppm for s in scores)
        return "doubt" if raw is None or rms is None else "good" if rms < raw else "bad"
    return "good" if improvement > 0.0 else "bad"


def _worse(first: Tone, second: Tone) -> Tone:
    order: tuple[Tone, ...] = ("bad", "doubt", "plain", "good")
    return min(first, second, key=order.index)


def _invalid_sentence(runs: int) -> str:
    return (
        f"{'One run is' if runs == 1 else f'{runs} runs are'} not valid; the table of runs gives the reasons."
    )


def _compensation_sentence(compensation: CompensationSummary, scores: Sequence[ModelScore]) -> str:
    before, after = mean(s.stability_raw_dph for s in scores), mean(s.stability_comp_dph for s in scores)
    who = f"Model {compensation.model} for unit {compensation.unit_id}"
    if before is None or after is None:
        return f"{who} was not judged on a held-out bias run."
    judged = sum(known(score.stability_comp_dph) for score in scores)
    runs = "one held-out run" if judged == 1 else f"{judged} held-out runs, mean"
    verb = "lowers" if after < before else "does not lower"
    change = (
        f"from {significant(before)} to {significant(after)} °/h"
        if after < before
        else (f"({significant(before)} before, {significant(after)} °/h after)")
    )
    return f"{who} {verb} the bias stability (1σ of 100 s means; {runs}) {change}."


def _headlines(scores: Sequence[ModelScore], floor: str) -> list[Headline]:
    headlines = []
    before, after = mean(s.stability_raw_dph for s in scores), mean(s.stability_comp_dph for s in scores)
    if before is not None and after is not None:
        note = f"noise floor {floor} °/h" if floor else "1σ of 100 s means"
        headlines.append(
            Headline("Bias stability, mean", significant(after), "°/h", significant(before), note)
        )
    improvement = mean(score.improvement_percent for score in scores)
    if improvement is not None:
        limit, share = attained(scores)
        note = "" if share is None else f"{fixed(share, 1)} % of the attainable {fixed(limit, 1)} %"
        headlines.append(Headline("Improvement of bias stability", fixed(improvement, 1), "%", note=note))
    raw, rms = mean(s.sf_raw_rms_ppm for s in scores), mean(s.sf_rms_ppm for s in scores)
    if rms is not None:
        largest = max(
            (s.sf_max_ppm for s in scores if s.sf_max_ppm is not None and known(s.sf_max_ppm)), default=None
        )
        note = "rms" if largest is None else f"rms; largest {significant(largest, 2)} ppm"
        before_text = "" if raw is None else significant(raw)
        headlines.append(Headline("Scale-factor error, mean", significant(rms, 2), "ppm", before_text, note))
    return headlines
