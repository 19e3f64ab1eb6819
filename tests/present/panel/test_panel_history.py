"""All runs, found by unit, procedure, date and outcome: against a list made here, and in a real browser."""

import json
import random
from html import unescape
from pathlib import Path
from typing import ClassVar
from urllib.error import HTTPError
from urllib.parse import urlencode
from urllib.request import urlopen

import pytest

from bench.present.panel._benches import Benches
from bench.present.panel._folders import RunsFolder
from bench.present.panel._history import History
from bench.present.panel._listing import listed
from drivers.base.errors import ConfigurationError
from tests.present.panel.browser import DESK, NEEDED, PATIENCE_S, Panel, browser_page, write_now

UNITS, PROCEDURES = ("FOG-001", "FOG-002", "<b>7"), ("known-state", "thermal-ramp")
OUTCOMES = ("completed", "invalid", "aborted")
FIGURES = ("scale_factor_error", "hysteresis")


def measured(name: str, value: float) -> dict:
    """Return a measurement as a manifest has it, with a limit of 10."""
    return {"name": name, "value": value, "unit": "ppm", "low": None, "high": 10.0, "passed": value <= 10.0}


def broken(row: dict) -> set[str]:
    return {one["name"] for one in row["measurements"] if one["value"] > 10.0}


def make_runs(root: Path, count: int) -> list[dict]:
    """Write run folders, every third in a campaign; return what they are."""
    chance, made = random.Random(4), []
    for number in range(count):
        place = root if number % 3 else root / f"lot-{number % 2}" / "runs"
        unit, day = chance.choice(UNITS), f"2026-{chance.randint(1, 12):02d}-{chance.randint(1, 28):02d}"
        row = {
            "run_id": f"run-{number}", "procedure": chance.choice(PROCEDURES), "outcome": chance.choice(OUTCOMES),
            "started_utc": f"{day}T{number % 24:02d}:00:00+00:00", "units": {"g": unit}, "reason": "why <not>",
            "duration_s": 60.0, "format": 1, "bench": {"bench": {"name": "one"}},
            "measurements": [measured(FIGURES[number % 2], chance.uniform(0.0, 20.0))],
        }  # fmt: skip
        (place / f"run-{number}").mkdir(parents=True)
        (place / f"run-{number}" / "manifest.json").write_text(json.dumps(row))
        made.append(
            row | {"unit": unit, "day": day, "name": str((place / f"run-{number}").relative_to(root))}
        )
    return made


@pytest.mark.parametrize(
    ("asked", "fits"),
    [
        ({}, lambda row: True),
        ({"unit": "FOG-001"}, lambda row: row["unit"] == "FOG-001"),
        (
            {"unit": " <b>7 ", "outcome": "aborted"},
            lambda row: (row["unit"], row["outcome"]) == ("<b>7", "aborted"),
        ),
        ({"procedure": "thermal-ramp"}, lambda row: row["procedure"] == "thermal-ramp"),
        ({"since": "2026-03", "until": "2026-05-10"}, lambda row: "2026-03-01" <= row["day"] <= "2026-05-10"),
        ({"unit": "none"}, lambda row: False),
        ({"limit": "any"}, broken),
        (
            {"limit": "hysteresis", "unit": "FOG-002"},
            lambda row: "hysteresis" in broken(row) and row["unit"] == "FOG-002",
        ),
        ({"limit": "no_such_figure"}, lambda row: False),
    ],
)
def test_what_is_found_is_what_fits_newest_first(tmp_path: Path, asked, fits) -> None:
    made = make_runs(tmp_path / "runs", 90)
    (tmp_path / "scratch").mkdir()
    folder = RunsFolder(tmp_path / "runs")
    found, count = History(folder, Benches(folder), tmp_path / "scratch").entries(asked, 1000)
    rows = [listed(entry, folder, Benches(folder)) for entry in found]
    wanted = sorted((row for row in made if fits(row)), key=lambda row: row["started_utc"], reverse=True)
    assert count == len(wanted) == len(rows)
    assert [row["started"] for row in rows] == [row["started_utc"][:16].replace("T", " ") for row in wanted]
    assert {row["run"] for row in rows} == {row["name"] for row in wanted}


def test_runs_that_come_and_go_are_seen(tmp_path: Path) -> None:
    make_runs(tmp_path / "runs", 6)
    (tmp_path / "scratch").mkdir()
    folder = RunsFolder(tmp_path / "runs")
    history = History(folder, Benches(folder), tmp_path / "scratch")
    assert history.entries({}, 1000)[1] == 6
    (tmp_path / "runs" / "run-1").rename(tmp_path / "gone")
    assert "run-1" not in {entry.name for entry in history.entries({}, 1000)[0]}
    (tmp_path / "gone").rename(tmp_path / "runs" / "run-1")
    assert "run-1" in {entry.name for entry in history.entries({}, 1000)[0]}
    with pytest.raises(ConfigurationError, match="no date"):
        history.entries({"since": "soon"}, 10)
    with pytest.raises(ConfigurationError, match="no outcome"):
        history.entries({"outcome": "fine"}, 10)


def test_a_certificate_that_is_not_passed_is_a_limit_broken(tmp_path: Path) -> None:
    for lot, passed in (("good", "true"), ("bad", "false"), ("open", "null")):
        make_runs(tmp_path / "made" / lot, 2)
        (tmp_path / "runs" / lot / "runs").mkdir(parents=True)
        (tmp_path / "made" / lot / "run-1").rename(tmp_path / "runs" / lot / "runs" / "one")
        line = f'{{"kind": "certificate", "utc": "", "file": "certificate.html", "passed": {passed}}}\n'
        (tmp_path / "runs" / lot / "events.jsonl").write_text(line)
    (tmp_path / "scratch").mkdir()
    folder = RunsFolder(tmp_path / "runs")
    history = History(folder, Benches(folder), tmp_path / "scratch")
    found, count = history.entries({"limit": "certificate"}, 10)
    assert [entry.name for entry in found] == ["bad/runs/one"] and count == 1
    assert "not passed" in listed(found[0], folder, Benches(folder))["outside"]


class TestInABrowser:
    pytestmark: ClassVar = [*NEEDED, pytest.mark.concurrent]

    @DESK
    def test_a_run_is_found_with_its_report_and_certificate(self, tmp_path: Path, width: int) -> None:
        from playwright.sync_api import expect

        made = make_runs(tmp_path / "runs", 70)
        write_now(tmp_path / "runs" / "lot-1", "Lot <1>")
        (tmp_path / "runs" / "lot-0" / "certificate.html").write_text("<p>Certificate of lot 0</p>")
        panel = Panel(tmp_path / "runs")
        try:
            with browser_page(width) as page:
                page.goto(panel.url)
                page.get_by_role("link", name="Runs", exact=True).click()
                expect(page.get_by_role("heading", name="70 runs")).to_be_visible()
                expect(page.get_by_role("navigation", name="Benches")).to_contain_text("bench of Lot <1>")
                assert page.evaluate("document.documentElement.scrollWidth") <= width
                page.get_by_label("Unit").fill("<b>7")
                page.get_by_label("Outcome").select_option("aborted")
                page.get_by_test_id("search").click()
                wanted = [row for row in made if (row["unit"], row["outcome"]) == ("<b>7", "aborted")]
                expect(page.locator(".run-row")).to_have_count(len(wanted))
                expect(page.locator(".run-row .why").first).to_have_text("why <not>")
                expect(page.get_by_label("Unit")).to_have_value("<b>7")
                page.goto(f"{panel.url}history")
                page.get_by_label("Limit broken").select_option("hysteresis")
                page.get_by_test_id("search").click()
                wanted = [row for row in made if "hysteresis" in broken(row)]
                expect(page.locator(".run-row")).to_have_count(len(wanted))
                expect(page.locator(".outside").first).to_contain_text("at most 10")
                page.goto(f"{panel.url}history")
                expect(page.locator(".run-row")).to_have_count(50)
                page.get_by_role("link", name="Show more").click()
                expect(page.locator(".run-row")).to_have_count(70)
                page.get_by_role("link", name="certificate").first.click()
                expect(page.locator("body")).to_have_text("Certificate of lot 0")
            with pytest.raises(HTTPError) as refused:
                urlopen(f"{panel.url}history?{urlencode({'since': '<i>'})}", timeout=PATIENCE_S)
            text = refused.value.read().decode()
            assert refused.value.code == 400 and "<i>" not in text and "no date" in unescape(text)
        finally:
            panel.kill()
