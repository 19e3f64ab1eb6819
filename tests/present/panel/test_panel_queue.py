"""Runs planned, queued and started from a real browser: what an operator does in a day, on an emulated bench."""

import json
import os
import re
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from urllib.error import HTTPError
from urllib.request import Request, urlopen

import pytest

from bench.campaign.queue import BenchQueue
from bench.control.live import read_now
from bench.lab.emulated import EmulatedLab, Plant
from bench.record.benchfile import bench_file_from, bench_file_text, load_bench_file
from bench.record.recording import read_manifest
from tests.benches import FOG_BENCH
from tests.campaign.test_queue import same_bytes
from tests.present.panel.browser import DESK, NEEDED, PATIENCE_S, PHONE, Panel, browser_page, until

pytestmark = [*NEEDED, pytest.mark.concurrent]
CAMPAIGN = """
title = "Short turns"
[[run]]
name = "turn"
procedure = "constant-rotation"
parameters = { rate_dps = 12, turns = 2, rest_s = 10 }
"""


class Bench:
    """An emulated bench with a panel that may start runs on it."""

    def __init__(self, panel: Panel, bench_file: Path, lab: EmulatedLab) -> None:
        self.panel, self.bench_file, self.lab = panel, bench_file, lab
        self.queue = BenchQueue(panel.runs, bench_file)
        self.address = f"{panel.url}queue/{self.queue.name}"

    def form(self, procedure: str) -> str:
        return f"{self.address}?procedure={procedure}"

    def send(self, what: str, body: object, **headers: str) -> dict:
        """Send a request as the page does; return the answer, with its status if it was refused."""
        request = Request(
            f"{self.panel.url}panel/queue/{self.queue.name}/{what}",
            json.dumps(body).encode(),
            {"content-type": "application/json"} | headers,
        )
        try:
            with urlopen(request, timeout=PATIENCE_S) as answer:
                return json.loads(answer.read())
        except HTTPError as refused:
            text = refused.read().decode()
            return {"status": refused.code, "text": text} | (json.loads(text) if text[:1] == "{" else {})


@contextmanager
def bench_with_panel(folder: Path, *options: object, **limits: float) -> Iterator[Bench]:
    """A bench on an emulated lab with a panel of those options, within those limits."""
    (folder / "files").mkdir()
    plain = folder / "plain.toml"
    text = "".join(f"{name} = {value}\n" for name, value in limits.items())
    plain.write_text(FOG_BENCH + f"[limits]\n{text}")
    with EmulatedLab(load_bench_file(plain), Plant(seed=5), clock="virtual", apart=True) as lab:
        bench_file = folder / "files" / "bench.toml"
        bench_file.write_text(bench_file_text(bench_file_from(lab.file.model_dump(mode="json"))))
        (folder / "files" / "turns.toml").write_text(CAMPAIGN)
        panel = Panel(folder / "runs", "--bench", bench_file, *options)
        found = Bench(panel, bench_file, lab)
        try:
            yield found
        finally:
            panel.kill()
            current = found.queue.state().current
            if current is not None and current.started is not None:
                os.kill(current.started.pid, 15)


@pytest.fixture
def bench(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Bench]:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    with bench_with_panel(tmp_path, max_rate_dps=15, min_temp_c=-50) as found:
        yield found


def fits_the_screen(page) -> None:
    """Nothing sticks out, everything to press is as large as a finger, every field has a name."""
    width = page.viewport_size["width"]
    assert page.evaluate("document.documentElement.scrollWidth") <= width
    small = page.evaluate(
        "[...document.querySelectorAll('button, .do, input, select')].filter((n) => n.offsetParent)"
        ".filter((n) => n.getBoundingClientRect().height < 43.5).map((n) => n.outerHTML)"
    )
    nameless = page.evaluate(
        "[...document.querySelectorAll('input, select')].filter((n) => !n.labels.length).map((n) => n.outerHTML)"
    )
    assert small == [] and nameless == []


@PHONE
def test_an_operator_plans_starts_leaves_comes_back_aborts_and_repeats(bench: Bench, width: int) -> None:
    from playwright.sync_api import expect

    with browser_page(width) as page:
        page.goto(bench.panel.url)
        expect(page.locator("[data-banner]")).to_contain_text("Queue, above")
        page.get_by_role("link", name="Queue").click()
        page.get_by_test_id("procedure").select_option("constant-rotation")
        rate, plan = page.locator("#p-rate_dps"), page.locator("[data-plan-body]")
        expect(page.locator('[data-field="rate_dps"]')).to_contain_text("This bench allows -15 to 15")

        # what cannot be run is said while it is typed, and cannot be started
        rate.fill("16")
        expect(plan).to_contain_text("this bench does not allow 16 deg/s")
        expect(page.get_by_test_id("start-now")).to_be_disabled()
        rate.fill("fast")
        expect(page.locator('[data-field="rate_dps"] [data-wrong]')).to_have_text("should be a number")
        rate.fill("12")
        page.locator("#p-turns").fill("2")
        expect(plan).to_contain_text("12 °/s (this bench allows at most 15)")
        page.get_by_test_id("rehearse").click()
        expect(plan).to_contain_text("Asks one question")
        expect(plan).to_contain_text("R2 Rotation at +12 deg/s, 2 turns")

        # a start needs a name and a second press
        page.locator("#p-turns").fill("10000")
        expect(plan).to_contain_text("about 83:")
        page.get_by_test_id("start-now").click()
        page.get_by_test_id("start-yes").click()
        expect(page.locator("[data-said]")).to_contain_text("Type your name")
        page.get_by_test_id("name").fill("Ada")
        page.get_by_test_id("start-now").click()
        expect(page.locator("#sure-head")).to_have_text(f"Start constant-rotation on {bench.queue.bench}?")
        expect(page.locator("[data-sure-body]")).to_contain_text("nothing real moves")
        page.get_by_test_id("start-yes").click()
        page.get_by_role("link", name="Watch it").click()
        expect(page.get_by_test_id("question")).to_contain_text("Mount")
        page.get_by_test_id("answer-yes").click()
        page.wait_for_function("document.querySelector('[data-live=rate]').textContent.startsWith('+12.0')")

    # browser and panel are gone; the run goes on
    (run,) = (path.parent for path in bench.panel.runs.glob("*/manifest.json"))
    bench.panel.kill()
    time_s = read_now(run)["time_s"]
    until(lambda: read_now(run)["time_s"] > time_s + 60.0, "the run to go on without browser and panel")
    bench.panel.start()
    started = bench.queue.state().current.started
    assert (started.by, started.pid) == ("Ada", read_now(run)["pid"])

    with browser_page(width) as page:
        page.goto(bench.address)
        page.get_by_role("link", name="Watch it").click()
        page.wait_for_function("window.gyrobench?.messages > 0")
        page.get_by_test_id("name").fill("Ada")
        page.get_by_test_id("abort").click()
        page.get_by_test_id("abort-now").click()
        expect(page.get_by_test_id("state")).to_have_text("Aborted")
        page.goto(bench.address)
        expect(page.locator("[data-ended]")).to_be_visible()  # it says why the queue is held
        expect(page.locator("[data-ended]")).to_contain_text("aborted")
        expect(page.locator("[data-held]")).to_contain_text("did not end well")
        with page.expect_navigation():
            page.locator("[data-ended]").get_by_role("link", name="Report").click()
        expect(page.locator("body")).to_contain_text("Run aborted")
        page.goto(bench.address)
        page.locator("[data-ended]").get_by_role("link", name="Repeat").click()
        expect(page.locator("#p-rate_dps")).to_have_value("12")
        expect(page.locator("#p-turns")).to_have_value("10000")
    manifest = read_manifest(run)
    assert (manifest.outcome, manifest.parameters["turns"], manifest.parameters["rest_s"]) == (
        "aborted",
        1e4,
        60.0,
    )


@DESK
def test_a_run_started_in_the_browser_is_byte_for_byte_the_typed_one(
    bench: Bench, tmp_path: Path, width: int
) -> None:
    """Two fresh labs of the same seed: one run is typed in the form, the other on the command line."""
    from playwright.sync_api import expect

    with browser_page(width) as page:
        page.goto(bench.form("known-state"))
        page.get_by_test_id("name").fill("Ada")
        page.locator("#p-angle_deg").fill("30")
        page.locator("#p-air_c").fill("31.5")
        expect(page.locator("[data-plan-body]")).to_contain_text("31.5 °C")
        page.get_by_test_id("start-now").click()
        page.get_by_test_id("start-yes").click()
        expect(page.locator("[data-ended]")).to_contain_text("completed")
    typed = tmp_path / "typed.toml"
    with EmulatedLab(
        load_bench_file(tmp_path / "plain.toml"), Plant(seed=5), clock="virtual", apart=True
    ) as lab:
        typed.write_text(bench_file_text(bench_file_from(lab.file.model_dump(mode="json"))))
        words = (
            "run",
            "known-state",
            "--bench",
            str(typed),
            "--runs",
            str(tmp_path / "typed"),
            "--by",
            "Ada",
        )
        command = [
            sys.executable,
            "-P",
            "-m",
            "gyrobench",
            *words,
            "--set",
            "angle_deg=30",
            "--set",
            "air_c=31.5",
        ]
        subprocess.run([*command, "--json"], check=True, stdout=subprocess.DEVNULL, timeout=PATIENCE_S)
    same_bytes(bench.panel.runs, tmp_path / "typed")


@DESK
def test_a_queue_is_put_in_order_held_and_let_go(bench: Bench, width: int) -> None:
    from playwright.sync_api import expect

    with browser_page(width) as page:
        page.goto(bench.form("constant-rotation"))
        fits_the_screen(page)
        page.get_by_test_id("name").fill("Bob")
        for turns in ("1", "2", "3"):
            page.locator("#p-turns").fill(turns)
            expect(page.get_by_test_id("add")).to_be_enabled()
            page.get_by_test_id("add").click()
            expect(page.locator("[data-waiting] .detail").last).to_have_text(f"turns {turns}")
        fits_the_screen(page)
        rows = page.locator("[data-waiting] .detail")
        page.locator("[data-waiting] li").nth(2).get_by_role("button", name="up").click()
        expect(rows).to_have_text(["turns 1", "turns 3", "turns 2"])
        page.locator("[data-waiting] li").nth(0).get_by_role("button", name="Take").click()
        expect(rows).to_have_text(["turns 3", "turns 2"])
        page.locator("[data-waiting] li").nth(0).get_by_role("link", name="Change").click()
        expect(page.locator("#p-turns")).to_have_value("3")
        page.locator("#p-rate_dps").fill("14")
        expect(page.locator("[data-plan-body]")).to_contain_text("14 °/s")
        page.get_by_test_id("not-before").fill("2099-01-01T12:00")
        page.get_by_test_id("add").click()
        expect(rows).to_have_text(["rate 14 °/s, turns 3", "turns 2"])
        expect(page.locator("[data-waiting] .when").first).to_contain_text("not before")
        page.get_by_test_id("hold").click()
        expect(page.locator("[data-held]")).to_contain_text("The queue goes")
        page.reload()
        expect(rows).to_have_text(["rate 14 °/s, turns 3", "turns 2"])
        page.get_by_test_id("hold").click()
        expect(page.locator("[data-held]")).to_contain_text("Bob holds the queue")
        fits_the_screen(page)
    assert not list(bench.panel.runs.glob("*/manifest.json"))


@DESK
def test_presets_keep_parameters_under_a_name(bench: Bench, width: int) -> None:
    from playwright.sync_api import expect

    with browser_page(width) as page:
        page.goto(bench.form("known-state"))
        page.get_by_test_id("name").fill("Ada")
        page.locator("#p-angle_deg").fill("45")
        page.get_by_label("Keep these parameters").fill("door side")
        page.get_by_role("button", name="Keep").click()
        preset = page.get_by_role("link", name="door side")
        expect(preset).to_be_visible()
        page.goto(bench.form("known-state"))
        expect(page.locator("#p-angle_deg")).to_have_value("0")
        preset.click()
        expect(page.locator("#p-angle_deg")).to_have_value("45")
        page.get_by_role("button", name="Remove preset door side").click()
        expect(preset).to_have_count(0)


@DESK
def test_a_campaign_is_planned_run_and_certified_from_the_browser(bench: Bench, width: int) -> None:
    from playwright.sync_api import expect

    with browser_page(width) as page:
        page.goto(bench.address)
        page.get_by_test_id("name").fill("Ada")
        page.get_by_test_id("campaign").select_option("turns.toml")
        expect(page.locator("[data-plan-body]")).to_contain_text("12 °/s")
        page.get_by_test_id("add").click()
        expect(page.locator("[data-waiting]")).to_contain_text("Short turns")
        page.get_by_test_id("hold").click()
        page.get_by_role("link", name="Watch it").click()
        expect(page.locator("[data-live=title]")).to_have_text("Short turns")
        expect(page.get_by_test_id("name")).to_have_value("Ada")
        page.get_by_test_id("answer-yes").click()
        expect(page.get_by_test_id("state")).to_have_text("Completed")
        certificate = page.get_by_role("link", name="certificate").first
        expect(certificate).to_be_visible()
        with page.expect_popup() as opened:
            certificate.click()
        expect(opened.value.locator("body")).to_contain_text(re.compile("certificate", re.IGNORECASE))
    (folder,) = (path.parent for path in bench.panel.runs.glob("turns-*/campaign.toml"))
    assert read_manifest(folder / "runs" / "turn").outcome == "completed"


@PHONE
def test_the_bench_by_hand_turns_stops_refuses_and_ends(bench: Bench, width: int) -> None:
    from playwright.sync_api import expect

    with browser_page(width) as page:
        page.goto(bench.form("manual"))
        page.get_by_test_id("name").fill("Ada")
        page.get_by_test_id("start-now").click()
        page.get_by_test_id("start-yes").click()
        page.get_by_role("link", name="Watch it").click()
        expect(page.get_by_test_id("state")).to_have_text("By hand")
        expect(page.get_by_test_id("question")).to_have_count(0)
        expect(page.get_by_test_id("name")).to_have_value("Ada")
        for nothing in ("", "fast", "nan"):
            page.get_by_test_id("order-spin").fill(nothing)
            page.get_by_role("button", name="Spin").click()
            expect(page.get_by_text("type a number first").last).to_be_visible()
        expect(page.locator(".by-hand")).to_contain_text("at most 10 either way")
        page.get_by_test_id("order-spin").fill("5")
        page.get_by_role("button", name="Spin").click()
        page.wait_for_function("document.querySelector('[data-live=rate]').textContent.startsWith('+5.0')")
        page.get_by_test_id("order-spin").fill("12")
        page.get_by_test_id("order-spin").press("Enter")
        expect(page.locator("[data-live=last]")).to_contain_text("more than this run may order")
        expect(page.locator("[data-live=last]")).to_have_class(re.compile("wrong"))
        page.get_by_role("button", name="Stop the table").click()
        page.wait_for_function("/^[+−]0\\.00/.test(document.querySelector('[data-live=rate]').textContent)")
        assert page.evaluate("document.documentElement.scrollWidth") <= width
        page.get_by_role("button", name="End", exact=True).click()
        expect(page.get_by_test_id("state")).to_have_text("Completed")
        expect(page.locator(".by-hand")).to_be_hidden()
    (run,) = (path.parent for path in bench.panel.runs.glob("*/manifest.json"))
    events = [json.loads(line) for line in (run / "events.jsonl").read_text().splitlines()]
    ordered = [(row["answer"], row["by"]) for row in events if row["kind"] == "answer"]
    assert ordered == [(order, "Ada") for order in ("spin 5", "spin 12", "stop", "done")]
    assert [row["rate_dps"] for row in events if row["kind"] == "demand_rate"][:2] == [5.0, 0.0]


def test_what_no_page_sends_is_refused_and_changes_nothing(bench: Bench) -> None:
    turn = {"procedure": "constant-rotation", "typed": {"turns": "1"}}
    refused = [
        {}, {"action": "add"}, {"action": "add", "by": "Ada"}, {"action": "add", "by": "", **turn},
        {"action": "add", "by": "Ada", "procedure": "../x"}, {"action": "explode", "by": "Ada"},
        {"action": "add", "by": "Ada", "procedure": "constant-rotation", "typed": {"turns": "-1"}},
        {"action": "add", "by": "Ada", "procedure": "constant-rotation", "typed": {"no_such": "1"}},
        {"action": "add", "by": "Ada", "procedure": "constant-rotation", "typed": [1]},
        {"action": "add", "by": "Ada", "procedure": "constant-rotation", "typed": {"rate_dps": "99"}},
        {"action": "add", "by": "Ada", "campaign": "../plain.toml"},
        {"action": "add", "by": "Ada", "resume": "../files"}, {"action": "add", "by": "Ada", "resume": "none"},
        {"action": "add", "by": "Ada", "not_before": "2026-01-01T00:00", **turn},
        {"action": "add", "by": "Ada", "not_before": "soon", **turn},
        {"action": "move", "item": "x", "place": "first"}, {"action": "remove", "item": "../../x"},
        {"action": "save_preset", "by": "Ada", "preset": " ", **turn},
        {"action": "remove_preset", "by": "Ada", "preset": "none", "procedure": "known-state"},
    ]  # fmt: skip
    for body in refused:
        answer = bench.send("change", body)
        assert answer.get("status") in (400, 422) and answer["text"], (body, answer)
    assert bench.send("change", [1])["status"] == 422
    other = bench.send("change", {"action": "add", "by": "Eve", **turn}, origin="http://elsewhere.example")
    assert other["status"] == 403
    assert bench.queue.state().waiting == ()
    assert bench.send("change", {"action": "add", "by": "Ada", **turn})["waiting"][0]["detail"] == "turns 1"
