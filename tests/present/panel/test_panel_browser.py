"""The panel in a real browser beside an emulated run: values move, a question is answered, an abort ends safe."""

import json
import os
import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from urllib.request import urlopen

import pytest

from bench.control.live import drop_answer, read_now
from bench.lab.emulated import EmulatedLab, Plant
from bench.record.benchfile import load_bench_file
from drivers.base.clock import utc_now
from tests.present.panel.browser import (
    BROWSER,
    DESK,
    FLAGS,
    NEEDED,
    PATIENCE_S,
    PHONE,
    Panel,
    browser_page,
    until,
    write_now,
)

DEMO = Path(__file__).parents[3] / "examples" / "demo.toml"
PROGRAM = Path(__file__).parents[2] / "reliability" / "runner_program.py"
pytestmark = [*NEEDED, pytest.mark.concurrent]


@pytest.fixture
def panel(tmp_path: Path) -> Iterator[Panel]:
    runs = tmp_path / "runs"
    runs.mkdir()
    found = Panel(runs)
    yield found
    found.kill()


@pytest.fixture
def session(panel: Panel, tmp_path: Path) -> Iterator[subprocess.Popen]:
    log = (tmp_path / "session.log").open("w")
    process = subprocess.Popen(
        [sys.executable, str(Path(__file__).with_name("session.py")), str(panel.runs)],
        stdout=log,
        env=os.environ | {"OMP_NUM_THREADS": "1", "XDG_STATE_HOME": str(tmp_path / "state")},
    )
    yield process
    if process.poll() is None:
        process.terminate()
        process.wait(PATIENCE_S)
    log.close()


@PHONE
def test_an_operator_sees_answers_and_aborts(panel: Panel, session: subprocess.Popen, width: int) -> None:
    from playwright.sync_api import expect, sync_playwright

    run = panel.runs / "turn"
    requested, wrong = [], []
    patience_ms = 1000.0 * PATIENCE_S
    expect.set_options(timeout=patience_ms)
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=BROWSER, args=FLAGS)
        context = browser.new_context(viewport={"width": width, "height": 900})
        context.set_default_timeout(patience_ms)
        context.on("request", lambda request: requested.append(request.url))
        page = context.new_page()
        page.on("pageerror", lambda error: wrong.append(str(error)))
        page.goto(panel.url)
        second = context.new_page()
        second.goto(panel.url)
        state = page.get_by_test_id("state")

        # the question, on both pages; answered on one
        for each in (page, second):
            expect(each.get_by_test_id("question")).to_contain_text("close the door")
        expect(state).to_have_text("Waiting for you")
        page.get_by_test_id("name").fill("Ada")
        page.get_by_test_id("answer-yes").click()
        for each in (page, second):
            expect(each.get_by_test_id("question")).to_have_count(0)
        expect(state).to_have_text("Running")

        # values move: the table turns, the chamber cools, the curves grow
        page.wait_for_function("document.querySelector('[data-live=rate]').textContent.startsWith('+5.0')")
        page.wait_for_function(
            "parseFloat(document.querySelector('[data-live=air]').textContent.replace('−', '-')) < 20"
        )
        before = page.evaluate("window.gyrobench.messages")
        page.wait_for_function(f"window.gyrobench.messages > {before + 5} && window.gyrobench.rows() > 5")
        assert page.locator("[data-lanes] canvas").count() == 1

        # a panel that dies does not touch the run, and the page comes back by itself
        page.evaluate("window.ofTheFirstPanel = true")
        panel.kill()
        page.wait_for_selector("body.cut-off")
        time_s = read_now(run)["time_s"]
        until(lambda: read_now(run)["time_s"] > time_s + 60.0, "the run to go on without the panel")
        panel.start()
        page.wait_for_function("!window.ofTheFirstPanel && window.gyrobench?.messages > 0")
        expect(state).to_have_text("Running")

        # abort asks once
        page.get_by_test_id("abort").click()
        page.get_by_text("Keep running").click()
        expect(page.get_by_test_id("abort-now")).to_be_hidden()
        assert read_now(run)["state"] == "running"
        page.get_by_test_id("name").fill("Ada")
        page.get_by_test_id("abort").click()
        page.get_by_test_id("abort-now").click()
        expect(state).to_have_text("Aborted")
        done = page.locator('[data-part="done"]')
        expect(done).to_contain_text("table at rest")
        expect(done).to_contain_text("chamber at rest")
        expect(page.get_by_test_id("abort")).to_be_disabled()
        assert session.wait(PATIENCE_S) == 0

        # the record says who, and the history has the report
        events = [json.loads(line) for line in (run / "events.jsonl").read_text().splitlines()]
        assert next(row for row in events if row["kind"] == "answer")["by"] == "Ada"
        assert next(row for row in events if row["kind"] == "request")["action"] == "abort"
        assert events[-1]["outcome"] == "aborted"
        link = page.locator('.history a[href="/report/turn"]')
        expect(link).to_be_visible()
        with urlopen(panel.url + "report/turn", timeout=PATIENCE_S) as report:
            assert "script" not in report.headers["Content-Security-Policy"]
            assert "Run aborted" in report.read().decode()
        browser.close()
    assert any(url.startswith(panel.url) for url in requested)
    outside = [url for url in requested if not url.startswith((panel.url, "data:", "blob:"))]
    assert outside == [] and wrong == []


def test_every_page_has_the_strip_of_all_benches(panel: Panel) -> None:
    from playwright.sync_api import expect

    # what the server tells a page at its first word: a page that is held up for ten seconds is not given up
    with urlopen(panel.url + "_nicegui_ws/socket.io/?EIO=4&transport=polling") as told:
        assert json.loads(told.read()[1:])["pingTimeout"] >= 10_000

    write_now(panel.runs / "first", "Lot <12>")
    with browser_page() as page:
        page.goto(panel.url)
        title, strip = page.locator("[data-live=title]"), page.locator("[data-benches]")
        expect(title).to_contain_text("Lot <12>")
        write_now(panel.runs / "second lot", "Lot 13")
        expect(strip).to_contain_text("bench of Lot 13")
        expect(strip.get_by_role("link")).to_have_count(2)
        expect(title).to_contain_text("Lot <12>")
        page.get_by_role("link", name="bench of Lot 13").click()
        expect(title).to_contain_text("Lot 13")
        expect(page.get_by_role("link", name="bench of Lot <12>")).to_be_visible()
        page.wait_for_function("window.gyrobench?.messages > 0")
        page.get_by_test_id("name").fill("Ada")
        page.get_by_test_id("abort").click()
        page.get_by_test_id("abort-now").click()
        dropped = panel.runs / "second lot" / "live" / "requests"
        until(lambda: any(dropped.glob("*.json")), "the request")
        assert json.loads(next(dropped.glob("*.json")).read_text())["by"] == "Ada"
        assert not any((panel.runs / "first" / "live" / "requests").iterdir())
        page.goto(panel.url + "?session=../first")
        expect(page.get_by_test_id("state")).to_have_text("Not here")


@DESK
def test_one_benchs_malformed_live_file_stops_no_other_page(panel: Panel, width: int) -> None:
    """Twenty live files that no session writes, each of a bench of its own, beside one that goes on."""
    from playwright.sync_api import expect

    write_now(panel.runs / "well", "well", time_s=1.0)
    wrong = [
        {"chamber": 5}, {"chamber": {"air_temp_c": "x"}}, {"chamber": {"auxiliary_c": [1]}}, {"table": [1]},
        {"table": {"demands": 3}}, {"gyros": [1, 2]}, {"gyros": {"a": 5}}, {"gyros": {"a": {"rejected": 1}}},
        {"run": "r"}, {"run": {"units": ["u"]}}, {"campaign": 1}, {"campaign": {"count": "2", "number": {}}},
        {"alarms": {"a": 1}}, {"alarms": [1]}, {"prompts": 7}, {"state": ["running"]}, {"utc": 5},
        {"time_s": 1e300}, {"time_s": "now"}, {"safe": 3}, {"error": [1]}, {"left_s": {}}, {"step": None},
    ]  # fmt: skip
    ill = [panel.runs / f"ill-{number}" for number in range(len(wrong))]
    with browser_page(width) as page:
        page.goto(f"{panel.url}?session=well")
        strip = page.locator("[data-benches]")
        for session, fields in zip(ill, wrong, strict=True):
            write_now(session, session.name, **fields)
        expect(strip.get_by_text("Cannot be read")).to_have_count(len(wrong))
        write_now(panel.runs / "well", "well", time_s=60.0)
        expect(page.locator("[data-live=elapsed]")).to_have_text("0:01:00")
        for session in ill:
            write_now(session, session.name)
        expect(strip).not_to_contain_text("Cannot be read")
        write_now(panel.runs / "well", "well", time_s=120.0)
        expect(page.locator("[data-live=elapsed]")).to_have_text("0:02:00")


@PHONE
def test_a_question_is_not_answered_before_the_name_is_there(panel: Panel, width: int) -> None:
    """The browser keeps the name and says it a moment after the page: until then a press would be refused."""
    from playwright.sync_api import expect

    session = panel.runs / "lot"
    (session / "live" / "answers").mkdir(parents=True)
    write_now(session, "lot", prompts=[{"id": 7, "question": "Mounted?", "picture": "", "utc": utc_now()}])
    with browser_page(width) as page:
        page.goto(panel.url)
        expect(page.get_by_test_id("question")).to_be_visible()
        page.add_init_script(
            "localStorage.setItem('gyrobench-name', 'Ada'); window.seen = {};"
            "const look = () => {"
            "  const [name, yes, pause] = ['name', 'answer-yes', 'pause'].map("
            "    (id) => document.querySelector(`[data-testid=${id}]`));"
            "  if (yes) window.seen[`${name.value}: ${yes.disabled} ${pause.disabled}`] = true;"
            "};"
            "new MutationObserver(look).observe(document, { subtree: true, childList: true, attributes: true });"
        )
        page.reload()  # the panel knows the question now: it is there with the page
        yes = page.get_by_test_id("answer-yes")
        yes.click()
        expect(yes).to_have_count(0)
        seen = page.evaluate("Object.keys(window.seen)")
    assert seen[0] == ": true true" and "Ada: false false" in seen
    assert not [state for state in seen if state.startswith(":") and "false" in state]
    counts = drop_answer(session, 7, "no", "Eve")  # the first one does
    assert (counts.answer, counts.by) == ("yes", "Ada")


@PHONE
def test_alarms_stay_until_somebody_has_seen_them_by_name(panel: Panel, width: int) -> None:
    from playwright.sync_api import expect

    alarm = {"time_s": 5.0, "kind": "alarm", "device": "chamber", "text": "door open", "run": "one"}
    write_now(panel.runs / "lot", "lot", alarms=[alarm])
    with browser_page(width) as page:
        page.goto(panel.url)
        strip, list_ = page.locator("[data-benches]"), page.locator("[data-list=alarms]")
        expect(strip).to_contain_text("1 alarm not seen")
        write_now(panel.runs / "lot", "lot", alarms=[alarm], state="ended", outcome="completed")
        page.wait_for_function("window.gyrobench?.messages > 0")
        page.evaluate("window.ofTheFirstPanel = true")
        panel.kill()
        panel.start()
        page.wait_for_function("!window.ofTheFirstPanel && window.gyrobench?.messages > 0")
        expect(strip).to_contain_text("1 alarm not seen")
        page.get_by_test_id("acknowledge").click()
        expect(page.locator("[data-unseen]")).to_contain_text("Type your name")
        page.get_by_test_id("name").fill("Ada")
        page.get_by_test_id("acknowledge").click()
        expect(strip).not_to_contain_text("not seen")
        expect(list_).to_contain_text("seen by Ada")
        page.wait_for_function(f"document.documentElement.scrollWidth <= {width}")


def test_there_need_not_be_a_runs_folder_yet(tmp_path: Path) -> None:
    from playwright.sync_api import expect

    found = Panel(tmp_path / "later")
    try:
        with browser_page() as page:
            page.goto(found.url)
            banner = page.locator("[data-banner]")
            expect(banner).to_contain_text("There is no folder")
            expect(banner).to_contain_text("gyrobench run PROCEDURE")
            (tmp_path / "later").mkdir()
            expect(banner).to_contain_text("No run has begun")
            write_now(tmp_path / "later" / "one", "one")
            expect(page.locator("[data-live=title]")).to_have_text("one")
    finally:
        found.kill()


@PHONE
def test_after_a_kill_the_page_says_what_the_watchdog_has_done(
    panel: Panel, tmp_path: Path, monkeypatch, width: int
) -> None:
    """The runner is killed with the table at 10 deg/s; the watchdog brings it to rest, and the page says so."""
    from playwright.sync_api import expect

    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    with EmulatedLab(load_bench_file(DEMO), Plant(), clock="wall") as lab, browser_page(width) as page:
        command = [sys.executable, str(PROGRAM), str(panel.runs)]
        process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.DEVNULL)
        assert process.stdin is not None
        process.stdin.write(json.dumps(lab.file.model_dump(mode="json")).encode() + b"\n")
        process.stdin.flush()
        try:
            page.goto(panel.url)
            page.wait_for_function(
                "document.querySelector('[data-live=rate]').textContent.startsWith('+10.0')"
            )
            process.kill()
            expect(page.get_by_test_id("state")).to_have_text("Stopped by the watchdog")
            expect(page.locator("[data-live=rate]")).to_have_text(re.compile(r"^[+−]0\.00"))
            done = page.locator("[data-part=done]")
            expect(done).to_contain_text("table at rest: ")
            expect(done).to_contain_text("chamber at rest")
            expect(page.locator("[data-part=press]")).to_contain_text("Nothing is urgent")
            expect(page.locator(".history")).to_contain_text("not closed")
            expect(page.locator("body")).to_have_class(re.compile("emulated"))
        finally:
            process.kill()
            process.stdin.close()
            process.wait()
