"""Every page for everybody: axe-core finds nothing serious, the keyboard alone goes from start to certificate."""

from collections.abc import Iterator
from pathlib import Path

import pytest

from bench.campaign.queue import RunOrder
from bench.control.operators import OperatorsFile
from tests.present.panel.browser import NEEDED, browser_page, serious, write_now
from tests.present.panel.test_panel_metrics import NOW
from tests.present.panel.test_panel_queue import Bench, bench_with_panel

pytestmark = [*NEEDED, pytest.mark.concurrent]
PASSWORD = "kettle violin harbour"
LOOKS = [(width, scheme) for width in (1280, 390) for scheme in ("light", "dark")]


@pytest.fixture
def bench(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Bench]:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    operators = tmp_path / "operators.json"
    OperatorsFile(operators).add("Ada Lovelace", "configure", PASSWORD)
    with bench_with_panel(tmp_path, "--operators", operators, max_rate_dps=15, min_temp_c=-50) as found:
        yield found


def test_axe_finds_nothing_serious_on_any_page(bench: Bench) -> None:
    """At 1280 and 390 px, light and dark: live with all that it shows, queue, plan, dialogs, runs, operators."""
    from playwright.sync_api import expect

    bench.queue.add(RunOrder(procedure="known-state"), "Ada")
    bench.queue.add(RunOrder(procedure="constant-rotation", parameters={"turns": 3.0}), "Bob")
    write_now(bench.panel.runs / "one", "one", **NOW)
    write_now(bench.panel.runs / "two", "two", chamber=5)
    found: dict[str, list[str]] = {}
    with browser_page() as page:

        def look(what: str, within: str = "html") -> None:
            for width, scheme in LOOKS:
                page.set_viewport_size({"width": width, "height": 900})
                page.emulate_media(color_scheme=scheme)
                if wrong := serious(page, within):
                    found[f"{what}, {width} px, {scheme}"] = wrong
                assert page.evaluate("document.documentElement.scrollWidth") <= width, f"{what}, {width} px"

        page.goto(bench.panel.url)
        look("sign in")
        page.get_by_label("Name").fill("Ada Lovelace")
        page.get_by_label("Password").fill("not the password")
        page.get_by_test_id("sign-in").click()
        expect(page.get_by_role("alert")).to_be_visible()
        look("sign in, refused")
        page.get_by_label("Password").fill(PASSWORD)
        page.get_by_test_id("sign-in").click()
        page.goto(f"{bench.panel.url}?session=one")
        expect(page.get_by_test_id("question")).to_contain_text("Ready?")
        page.wait_for_function("window.gyrobench?.messages > 3 && window.gyrobench.rows() > 0")
        look("live")
        page.get_by_test_id("abort").click()
        expect(page.get_by_test_id("abort-now")).to_be_visible()
        look("live, abort asked", ".q-dialog")
        page.goto(bench.form("constant-rotation"))
        page.locator("#p-rate_dps").fill("99")
        expect(page.locator("[data-plan-body] .wrong")).to_be_visible()
        expect(page.locator("[data-waiting] .about")).to_have_count(2)
        look("queue, a mistake")
        page.locator("#p-rate_dps").fill("9")
        expect(page.get_by_test_id("start-now")).to_be_enabled()
        page.get_by_test_id("start-now").click()
        look("queue, start asked", "dialog")
        for name in ("history", "trends", "operators", "?bench=none"):
            page.goto(bench.panel.url + name)
            look(name)
    assert not found, "\n".join(f"{where}: {text}" for where, texts in found.items() for text in texts)


def test_the_keyboard_alone_goes_from_signing_in_to_the_certificate(bench: Bench) -> None:
    """No mouse: every control is reached by Tab, is seen to have the focus, and is pressed by Enter or Space."""
    from playwright.sync_api import expect

    with browser_page(1280, "light") as page:

        def go_to(control) -> None:
            """Press Tab until the control has the focus; it must be seen to have it."""
            expect(control).to_be_visible()
            for _ in range(120):
                page.keyboard.press("Tab")
                if control.evaluate("node => node.contains(document.activeElement)"):
                    look = "(({ outlineStyle, boxShadow }) => [outlineStyle, boxShadow])"
                    seen = page.evaluate(f"{look}(getComputedStyle(document.activeElement))")
                    assert seen != ["none", "none"], f"{control} does not show that it has the focus"
                    return
            raise AssertionError(f"Tab does not lead to {control}")

        page.goto(bench.address)
        go_to(page.get_by_label("Name"))
        page.keyboard.type("ada lovelace")
        page.keyboard.press("Tab")
        page.keyboard.type(PASSWORD)
        page.keyboard.press("Enter")
        campaign = page.get_by_test_id("campaign")
        go_to(campaign)
        page.keyboard.press("ArrowDown")
        expect(campaign).to_have_value("turns.toml")
        expect(page.get_by_test_id("start-now")).to_be_enabled()
        go_to(page.get_by_test_id("start-now"))
        page.keyboard.press("Enter")
        go_to(page.get_by_test_id("start-yes"))
        page.keyboard.press("Space")
        watch = page.get_by_role("link", name="Watch it")
        go_to(watch)
        page.keyboard.press("Enter")
        expect(page.get_by_test_id("question")).to_contain_text("Mount")
        page.wait_for_function("window.gyrobench?.messages > 0")
        go_to(page.get_by_test_id("answer-yes"))
        page.keyboard.press("Enter")
        expect(page.get_by_test_id("state")).to_have_text("Completed")
        certificate = page.get_by_role("link", name="certificate").first
        go_to(certificate)
        with page.expect_popup() as opened:
            page.keyboard.press("Enter")
        paper = opened.value
        expect(paper.locator("h1").first).to_be_visible()
        assert serious(paper) == []
        page.bring_to_front()
        report = page.locator('.runs a[href^="/report/"]').first
        go_to(report)
        with page.expect_popup() as opened:
            page.keyboard.press("Enter")
        expect(opened.value.locator("h1").first).to_be_visible()
        assert serious(opened.value) == []
