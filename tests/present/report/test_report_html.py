"""The HTML that comes out: well formed, self-contained, escaped, and with no number that the content lacks."""

from __future__ import annotations

import hashlib
import math
import re
import subprocess
import sys
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from html.parser import HTMLParser
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest

from bench.analysis.common.uncertainty import Budget, Contribution
from bench.analysis.thermal import Scores
from bench.analysis.thermal._selection import ModelScore
from bench.present.report import render_page, run_page
from bench.present.report._numbers import DASH
from bench.present.report._plots import Comparison
from bench.present.report._run_content import RunContent, Trace
from bench.record.recording import Manifest
from bench.record.recording._manifest import DeviceEntry

VOID = {"meta", "br", "link", "img", "hr", "input", "source"}
HOSTILE = "<script>alert('x')</script>\"&'\x00\x1b\ud800${{ 7*7 }}$\\frac"


@dataclass
class Reading(HTMLParser):
    """A parsed page: balance of tags, ids, references, tables, text."""

    page: str
    ids: list[str] = field(default_factory=list)
    references: list[str] = field(default_factory=list)
    tags: list[str] = field(default_factory=list)
    tables: list[list[list[str]]] = field(default_factory=list)
    headings: list[str] = field(default_factory=list)
    text: list[str] = field(default_factory=list)
    classes: list[str] = field(default_factory=list)
    captions: list[str] = field(default_factory=list)

    def __post_init__(self) -> None:
        super().__init__(convert_charrefs=True)
        self._open: list[str] = []
        self.feed(self.page)
        self.close()
        assert not self._open, f"left open: {self._open}"

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append(tag)
        named = dict(attrs)
        assert len(named) == len(attrs), f"an attribute twice in <{tag}>"
        self.ids += [value or "" for name, value in attrs if name == "id"]
        self.classes += (named.get("class") or "").split()
        self.references += [value or "" for name, value in attrs if name in ("href", "src", "xlink:href")]
        self.references += re.findall(r"url\(([^)]*)\)", " ".join(value or "" for _, value in attrs))
        if tag not in VOID:
            self._open.append(tag)
        if tag == "table":
            self.tables.append([])
        elif tag == "tr":
            self.tables[-1].append([])
        elif tag in ("td", "th"):
            self.tables[-1][-1].append("")
        elif tag == "h2":
            self.headings.append("")
        elif tag == "figcaption":
            self.captions.append("")

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.handle_starttag(tag, attrs)
        if tag not in VOID:
            self.handle_endtag(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self._open and self._open[-1] == tag, f"</{tag}> closes {self._open[-1:]}"
        self._open.pop()

    def handle_data(self, data: str) -> None:
        self.text.append(data)
        if "td" in self._open or "th" in self._open:
            self.tables[-1][-1][-1] += data
        if "h2" in self._open:
            self.headings[-1] += data
        if "figcaption" in self._open:
            self.captions[-1] += data

    @property
    def visible(self) -> str:
        return "".join(self.text)


@pytest.fixture(scope="module")
def reading(campaign_html: str) -> Reading:
    return Reading(campaign_html)


def rows(reading: Reading, head: str) -> dict[str, list[str]]:
    """Return a table found by a word of its head, rows by their first cell, marks taken off."""
    table = next(table for table in reading.tables if any(head in cell for cell in table[0]))
    clean = [[re.sub(r"^[✓✕!]\s*", "", cell.strip()) for cell in row] for row in table[1:]]
    return {row[0]: row[1:] for row in clean if len(row) > 1}


def found(pattern: str, text: str) -> re.Match[str]:
    match = re.search(pattern, text, re.S)
    assert match is not None, pattern
    return match


def number(text: str) -> float:
    return float(text.replace("−", "-").replace("\u202f", ""))


def plain_run(outcome: str) -> Manifest:
    return Manifest(run_id="r", procedure="p", outcome=outcome, started_utc="")


def test_well_formed_with_unique_ids_and_inner_references_only(reading: Reading) -> None:
    assert len(reading.ids) == len(set(reading.ids))
    assert reading.references
    for reference in reading.references:
        assert reference.startswith("#") and reference[1:] in reading.ids, reference
    assert reading.tags.count("svg") == 22
    assert not {"script", "link", "img", "iframe", "object", "image"} & set(reading.tags)


def test_self_contained_and_small(campaign_html: str) -> None:
    assert "http:" not in campaign_html and "https:" not in campaign_html
    assert "@import" not in campaign_html and "url(" not in campaign_html.split("</style>")[0]
    assert len(campaign_html.encode()) < 3_000_000


def test_svg_colours_follow_the_theme(campaign_html: str) -> None:
    for figure in re.findall(r"<svg.*?</svg>", campaign_html, re.S):
        outside = re.sub(r"var\(--[a-z]+, #[0-9a-f]{6}\)", "", figure)
        assert not re.search(r"(?:fill|stroke): #(?!000000)", outside), (
            "a colour that the dark theme cannot change"
        )
        assert "viewBox" in figure and 'aria-label="' in figure


def test_model_table_has_the_content_s_numbers(reading: Reading, campaign: Any) -> None:
    table = rows(reading, "Bias stability before")
    assert next(iter(table)) == "grey_box"
    for model, scores in campaign.study.scores.items():

        def average(name: str, scores: tuple[Scores, ...] = scores) -> float:
            return float(np.mean([getattr(score, name) for score in scores]))

        expected = [
            average("raw_stability_dph"),
            average("stability_dph"),
            average("improvement_pct"),
            min(score.improvement_pct or 0.0 for score in scores),
            100.0 * average("improvement_pct") / average("oracle_pct"),
            max(score.true_max_dph or 0.0 for score in scores),
            average("sf_true_rms_ppm"),
            max(score.sf_true_max_ppm or 0.0 for score in scores),
        ]
        for cell, value in zip(table[model], expected, strict=True):
            half_a_digit = 0.5 * 10.0 ** -len(cell.partition(".")[2])
            assert abs(number(cell) - value) <= 1.001 * half_a_digit, (model, cell, value)
            assert len(re.sub(r"^[−0.]*|\.", "", cell)) >= 2, "too few digits to mean anything"


def test_run_matrix_has_every_improvement(reading: Reading, campaign: Any) -> None:
    table = rows(reading, "bias-11")
    runs = list(dict.fromkeys(score.run_id for _, score in campaign.scores))
    for model, score in campaign.scores:
        assert number(table[model][runs.index(score.run_id)]) == pytest.approx(
            score.improvement_pct, abs=0.051
        )
        assert number(table["attainable"][runs.index(score.run_id)]) == score.oracle_pct


def test_runs_checks_and_streams_have_the_content_s_values(reading: Reading, campaign: Any) -> None:
    listed, checks, streams = rows(reading, "Used for"), rows(reading, "lowest air"), rows(reading, "Frames")
    for run in campaign.runs:
        assert listed[run.run_id][1] == run.role
        assert listed[run.run_id][3] == "2026-11-20 08:14 UTC"
        judged = [item for item in run.measurements if item.passed is not None]
        for cell, item in zip(checks[run.run_id], judged, strict=True):
            assert number(re.sub(r"^✕ ", "", cell)) == pytest.approx(item.value, rel=5e-3)
        assert [number(cell) for cell in streams[run.run_id][1:]] == pytest.approx(
            [1601187, 13, 1e6 * 13 / 1601200, 2, 100.0007, 7.1], rel=0.02
        )


def test_headlines_are_means_of_the_chosen_model(reading: Reading, campaign: Any) -> None:
    chosen = campaign.study.scores["grey_box"]
    head = reading.visible.split("Warnings")[0]
    before, after = found(r"from ([\d.]+) to ([\d.]+) °/h", head).groups()
    assert float(before) == pytest.approx(np.mean([s.raw_stability_dph for s in chosen]), rel=5e-3)
    assert float(after) == pytest.approx(np.mean([s.stability_dph for s in chosen]), rel=5e-3)
    share, limit = found(r"([\d.]+) % of the attainable ([\d.]+) %", head).groups()
    assert float(limit) == pytest.approx(np.mean([s.oracle_pct for s in chosen]), abs=0.051)
    assert float(share) == pytest.approx(
        100 * np.mean([s.improvement_pct for s in chosen]) / np.mean([s.oracle_pct for s in chosen]),
        abs=0.051,
    )
    assert "0.0241" in head and "11 of 12" in head and "emulated bench" in head


def test_checksums_are_printed_whole(reading: Reading, campaign: Any) -> None:
    for run in campaign.runs:
        assert run.checksum in reading.visible
    assert campaign.runs[0].manifest.bench_file_sha256 in reading.visible
    assert hashlib.sha256(b"a model").hexdigest() in reading.visible


def test_an_invalid_run_is_marked_with_its_reason(reading: Reading, campaign_html: str) -> None:
    assert rows(reading, "Used for")["bias-03"][-1] == "invalid"
    assert "shock rate 5.96 K/min" in reading.visible
    assert '<tr class="bad noted">' in campaign_html
    assert "✕" in reading.visible and 'class="verdict doubt"' in campaign_html


@pytest.mark.parametrize(
    ("outcome", "word", "tone"),
    [
        ("completed", "Run valid", "good"),
        ("invalid", "Run invalid", "bad"),
        ("aborted", "Run aborted", "bad"),
        ("running", "Run unfinished", "doubt"),
    ],
)
def test_the_verdict_of_a_single_run(
    single_run: Callable[..., RunContent], outcome: str, word: str, tone: str
) -> None:
    html = render_page(run_page(single_run(outcome, 11.79 if outcome == "completed" else 5.96)))
    assert f'class="verdict {tone}"' in html
    assert word in Reading(html).visible
    assert ("✕ outside its limits" in html) == (outcome != "completed")


def test_single_run_measurements_and_parameters(single_run: Callable[..., RunContent]) -> None:
    reading = Reading(render_page(run_page(single_run())))
    table = rows(reading, "Limits")
    assert number(table["shock rate, 10 to 90 %"][0]) == 11.79
    assert table["shock rate, 10 to 90 %"][1:] == [DASH, "K/min", "≥ 10", "inside"]
    assert table["azimuth error of the axis"][3] == "−2 … 2"
    assert table["reference output"][3:] == [DASH, DASH]
    assert "−45\u00a0°C" in reading.visible


def test_measurements_have_their_uncertainty_and_say_when_it_reaches_a_limit(
    single_run: Callable[..., RunContent],
) -> None:
    """11.79 K/min of at least 10 K/min: 0.13 is far from the limit, 2.0 is not."""
    for standard, result in ((0.0663, "inside"), (1.02, "inside, nearer to a limit than ±")):
        budgets = {"shock_rate_10_90": Budget(11.79, (Contribution("air_temp_c", standard, unit="c"),))}
        reading = Reading(render_page(run_page(replace(single_run(), budgets=budgets))))
        row = rows(reading, "Limits")["shock rate, 10 to 90 %"]
        assert row[1] == ("0.13" if standard < 1.0 else "2.0") and row[4] == result
        assert "air temp c" in rows(reading, "Sensitivity")
        assert f"U = {row[1]}" in reading.visible


def test_hostile_text_stays_text(campaign: Any) -> None:
    measured = {"name": HOSTILE, "value": 1.0, "unit": HOSTILE, "low": 0.0, "high": 2.0, "passed": True}
    manifest = campaign.runs[2].manifest.model_copy(
        update={
            "run_id": HOSTILE,
            "parameters": {HOSTILE: HOSTILE},
            "devices": {HOSTILE: DeviceEntry(kind="x", role=HOSTILE, maker=HOSTILE, model=HOSTILE)},
            "measurements": (measured,),
            "stream": {HOSTILE: {"frames": 1, "lost": 1, "rejected": {HOSTILE: 1}}},
            "units": {HOSTILE: HOSTILE},
            "software": {HOSTILE: HOSTILE},
            "bench": {"bench": {"name": HOSTILE}},
        }
    )
    traces = [
        replace(
            campaign.runs[-1].traces[0], run_id=name, phases=((0.0, HOSTILE), (9e3, "冷冲击")), gyro=HOSTILE
        )
        for name in (HOSTILE, r"$\frac$")
    ]
    bad_run = RunContent(
        manifest, traces, (HOSTILE,), (HOSTILE,), HOSTILE, campaign.runs[-1].checksum, HOSTILE
    )
    tests = (replace(campaign.study.tests[-1], meta={"gyro": HOSTILE}),)
    study = replace(
        campaign.study,
        tests=tests,
        selection=(ModelScore(HOSTILE, None, None, score=0.5),),
        scores={HOSTILE: tuple(replace(score, run_id=HOSTILE) for _, score in campaign.scores[:2])},
    )
    shown = [replace(campaign.comparisons[0], run_id=name, note=HOSTILE) for name in (HOSTILE, r"$\frac$")]
    bad = replace(campaign, title=HOSTILE, study=study, runs=[bad_run], comparisons=shown)
    for html in (render_page(bad.page()), render_page(run_page(bad_run))):
        reading = Reading(html)
        assert "script" not in reading.tags
        assert "<script" not in html
        assert "alert('x')" in reading.visible
        assert "{{ 7*7 }}" in reading.visible
        html.encode("utf-8")
        assert "\x00" not in html and "\x1b" not in html


def test_unknown_numbers_are_dashes_everywhere(campaign: Any) -> None:
    nothing = math.nan
    manifest = plain_run("completed").model_copy(
        update={
            "duration_s": nothing,
            "measurements": (
                {"name": "m", "value": nothing, "unit": "ppm", "low": 0.0, "passed": False},
                {"name": "n"},
            ),
            "stream": {"g": {"sample_rate_hz": nothing}},
            "parameters": {"x_c": nothing, "y_s": None},
        }
    )
    time_s = np.arange(100.0)
    blank = np.full(100, nothing)
    run = RunContent(
        manifest,
        [Trace("r1", time_s, air_temp_c=blank, output_time_s=time_s, output_dph=blank)],
        checksum=campaign.study.tests[0].checksum,
    )
    scores = {
        "m1": (Scores("r1", 0.1, nothing, None, nothing, oracle_pct=nothing, sf_rms_ppm=nothing),),
        "m2": (Scores("r1"),),
    }
    selection = tuple(ModelScore(name, None, None, score=0.5) for name in scores)
    content = replace(
        campaign,
        study=replace(campaign.study, scores=scores, selection=selection),
        runs=[run],
        comparisons=[Comparison("r1", time_s, "°/h", blank, blank, "", nothing)],
    )
    for html in (render_page(content.page()), render_page(run_page(run))):
        text = Reading(re.sub(r"<style>.*?</style>", "", html, flags=re.S)).visible
        assert not re.search(r"\b(nan|none|inf)\b", text, re.I)
        assert DASH in text
        assert not re.search(r"\bnan\b", html, re.I)


def test_missing_parts_leave_no_empty_sections() -> None:
    bare = Reading(render_page(run_page(RunContent(plain_run("aborted")))))
    assert bare.headings == [] and bare.tables == []


def test_a_compensation_that_makes_things_worse_is_not_praised(campaign: Any) -> None:
    html = render_page(campaign.with_scores("grey_box", stability_dph=0.2, improvement_pct=-50.0).page())
    assert 'class="verdict bad"' in html
    assert "does not lower the bias stability" in html


def test_without_a_truth_the_attainable_is_not_invented(campaign: Any) -> None:
    reading = Reading(render_page(campaign.with_scores(oracle_pct=None).page()))
    assert "of the attainable" not in reading.visible
    assert not any(cell == "of attainable%" for table in reading.tables for cell in table[0])
    assert not any(row and row[0] == "attainable" for table in reading.tables for row in table)
    assert "attainable 78.9" not in reading.visible


def test_curves_in_the_figures_have_the_extremes_of_the_data(single_run: Callable[..., RunContent]) -> None:
    """The lowest and highest point of every drawn curve are where the axis' own ticks put the data's."""
    content = single_run()
    figure = ElementTree.fromstring(found(r"<svg.*?</svg>", render_page(run_page(content))).group())
    axes = next(group for group in figure.iter("g") if group.get("id", "").endswith("-axes_1"))
    ticks = [group for group in axes.iter("g") if "-ytick_" in group.get("id", "")]
    assert len(ticks) >= 5
    values = [number(next(tick.iter("text")).text or "") for tick in ticks]
    heights = [float(next(tick.iter("path")).get("d", "").split()[2]) for tick in ticks]
    slope, offset = np.polyfit(values, heights, 1)
    curves = [
        np.array(re.findall(r"[ML] [\d.-]+ ([\d.-]+)", path.get("d", "")), dtype=float)
        for group in axes
        if "-line2d_" in group.get("id", "")
        for path in group.iter("path")
    ]
    trace = content.traces[0]
    for data in (trace.set_point_c, trace.air_temp_c, trace.case_temp_c, trace.gyro_temp_c):
        assert data is not None
        highest, lowest = slope * data.max() + offset, slope * data.min() + offset
        assert any(np.allclose([curve.min(), curve.max()], [highest, lowest], atol=0.02) for curve in curves)


def test_same_content_same_bytes(single_run: Callable[..., RunContent]) -> None:
    assert render_page(run_page(single_run())) == render_page(run_page(single_run()))


def test_importing_the_room_loads_no_matplotlib() -> None:
    code = (
        "import sys, bench.present.report; sys.exit('matplotlib' in sys.modules or 'pandas' in sys.modules)"
    )
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
