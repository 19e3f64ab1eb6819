"""The page: what is on it and what its buttons do; numbers and curves come by the socket (assets/panel.js)."""

from __future__ import annotations

import asyncio
import json
import math
from collections.abc import Callable, Mapping
from contextlib import suppress
from functools import cache, partial
from pathlib import Path
from typing import Any
from urllib.parse import quote

from nicegui import ui

from bench.control.live import Action, drop_answer, drop_request
from bench.control.operators import Signature
from bench.present.panel._frame import HERE, template
from bench.present.panel._presence import Presence
from bench.present.panel._session import Session
from bench.present.panel._watch import LEVELS, Watch
from bench.record.events import Role
from drivers.base.errors import BenchError

_CONTROL_S = 0.25
_NAME_TIMEOUT_S = 20.0
_ORDER_TRIES = 12
"""How often an order looks for the question that asks for it, a quarter of a second apart."""
Asked = tuple[Path, int]
"""A question: the session that asks it and its number there; every process counts from 1."""


def build_page(watch: Watch, frame: Mapping[str, Any], presence: Presence) -> None:
    """Build the page of one browser: what it shows is plain HTML and there at once, its controls follow.

    `frame`: what its head is made of (`Frame.values`).
    """
    dark = ui.dark_mode(value=None)
    ui.add_head_html(f"<style>{style_sheet()}</style>")
    banner = watch.news()["banner"]
    ui.add_body_html(template("first_paint.html.j2").render(frame, values=watch.values(), banner=banner))
    for script in ("common", "charts", "expected", "noise", "panel"):
        ui.add_body_html(f'<script src="/panel/assets/{script}.js"></script>')
    ui.query(".nicegui-content").classes("panel")
    ui.colors(primary="#005f96", negative="#b3261e", dark="#161d25", dark_page="#0d1116")
    controls = Controls(watch, presence)
    ui.element("div").props('data-place="benches"')
    ui.element("div").props('data-place="pages"')
    with ui.element("header").classes("bar"):
        ui.element("div").classes("names").props('data-place="names"')
        controls.header(dark)
    ui.element("div").props('data-place="banner"')
    controls.questions()
    controls.orders()
    ui.element("div").props('data-place="cards"')
    with ui.element("section").classes("plots"):
        with ui.element("div").classes("plots-head"):
            ui.html("<h2>Curves</h2>", sanitize=False)
            ui.toggle(list(LEVELS), value="run", on_change=lambda event: _show(str(event.value))).props(
                'no-caps dense unelevated data-testid="window"'
            )
        ui.element("div").props("data-lanes")
    with ui.element("section").classes("plots").props("data-noise hidden"):
        ui.html("<h2>Noise of the last hour</h2>", sanitize=False)
        ui.element("div").props(
            'data-noise-chart role="img" aria-label="Allan deviation; the table has the values"'
        )
        ui.element("div").classes("wide").props("data-noise-words")
    ui.element("div").props('data-place="lists"')
    ui.element("div").props('data-place="runs"')
    ui.timer(_CONTROL_S, controls.refresh)
    controls.refresh()


class Controls:
    """Buttons and questions of one page; every press becomes a file that the session takes."""

    def __init__(self, watch: Watch, presence: Presence) -> None:
        self._watch = watch
        self._presence = presence
        self._client = ui.context.client
        self._answered: set[Asked] = set()
        self._named = presence.signs_in  # whether the browser has said whose name it keeps
        self._shown: tuple[list[Asked], bool] = ([], self._named)
        self._aborting: Session | None = None
        self._bounded: dict[str, ui.label] = {}

    def header(self, dark: ui.dark_mode) -> None:
        """Build name, pause, resume, abort and the switch between light and dark."""
        with ui.element("div").classes("controls"):
            keep = None if self._presence.signs_in else _keep_name
            self._name = ui.input(placeholder="your name", on_change=keep).props(
                'dense outlined maxlength=40 aria-label="your name, for the record" data-testid="name"'
            )
            if self._presence.signs_in:
                self._sign_in_shown()
            else:
                ui.timer(0.1, self._recall_name, once=True)
            self._pause = self._button("Pause", "pause", lambda: self._request("pause"))
            self._resume = self._button("Resume", "play_arrow", lambda: self._request("resume"))
            self._abort = self._button("Abort", "dangerous", self._ask_abort, color="negative")
            ui.button(icon="contrast", on_click=lambda: _toggle(dark)).props(
                'flat round dense aria-label="light or dark"'
            ).classes("contrast")
        self._dialog = ui.dialog().props('aria-label="Abort the run?"')
        with self._dialog, ui.element("div").classes("dialog"):
            ui.html("<h2>Abort the run?</h2>", sanitize=False)
            self._doomed = ui.label().classes("doomed").props('data-testid="abort-what"')
            ui.html(
                "<p>The table stops, the chamber goes to its safe set point, and what was recorded is kept. "
                "The run cannot be continued; a campaign can be resumed later.</p>",
                sanitize=False,
            )
            self._aborter = ui.input(label="your name, for the record").props(
                'dense outlined autofocus maxlength=40 data-testid="abort-name"'
                + (" readonly" if self._presence.signs_in else "")
            )
            with ui.element("div").classes("choices"):
                ui.button("Keep running", on_click=self._dialog.close).props("outline no-caps")
                ui.button("Abort now", on_click=self._abort_now, color="negative").props(
                    'no-caps unelevated data-testid="abort-now"'
                )

    def _sign_in_shown(self) -> None:
        """Show who is signed in instead of a field to type in."""
        self._name.value = self._presence.name
        self._name.props(f'readonly label="signed in to {self._presence.role}"')
        ui.button(icon="logout", on_click=_sign_out).props('flat round dense aria-label="sign out"').classes(
            "contrast"
        )

    def questions(self) -> None:
        """Make the place where questions appear."""
        self._place = ui.element("section").classes("questions")

    def orders(self) -> None:
        """Make the buttons of a run by hand."""
        with ui.element("section").classes("question by-hand") as self._hand:
            ui.html('<h2>By hand</h2><p class="last" data-live="last" role="status"></p>', sanitize=False)
            with ui.element("div").classes("choices"):
                self._ordering("Stop the table", lambda: "stop", "negative")
                self._ordering("Chamber off", lambda: "chamber off")
                self._ordering("End", lambda: "done")
            for verb, label, word in (
                ("spin", "Rate, °/s", "Spin"),
                ("point", "Angle, °", "Point"),
                ("air", "Set point, °C", "Go to"),
            ):
                with ui.element("div").classes("choices"):
                    field = ui.input(label=label).props(
                        f'dense outlined maxlength=12 data-testid="order-{verb}"'
                    )
                    self._bounded[verb] = ui.label().classes("bounds")
                    text = partial(_order_text, verb, label, field)
                    field.on("keydown.enter", partial(self._order, text))
                    self._ordering(word, text)
        self._hand.set_visibility(False)

    def _show_hand(self, by_hand: bool) -> None:
        """Show the buttons of a run by hand with what this run may order, or hide them."""
        self._hand.set_visibility(by_hand)
        if not by_hand:
            return
        known = self._watch.parameters
        with suppress(KeyError):
            self._bounded["spin"].text = f"at most {known['max_rate_dps']:g} either way"
            self._bounded["air"].text = f"{known['low_c']:g} to {known['high_c']:g}"

    def _ordering(self, word: str, text: Callable[[], str], color: str = "primary") -> None:
        props = f"no-caps {'unelevated' if color == 'negative' else 'outline'}"
        ui.button(word, on_click=partial(self._order, text), color=color).props(props)

    async def _order(self, text: Callable[[], str]) -> None:
        """Answer the open question with an order; between two questions wait a moment for the next."""
        try:
            order = text()
        except ValueError as error:
            ui.notify(str(error), type="warning")
            return
        session, by = self._watch.session, self._signed("run")
        if by is None:
            return
        for _ in range(_ORDER_TRIES):
            if session is None or self._watch.session is not session:
                break
            open_ = [(session.path, row["id"]) for row in self._watch.prompts]
            asked = next((one for one in open_ if one not in self._answered), None)
            if asked is not None:
                counted = self._dropped(asked, order, by)
                if counted is None or counted == (by.name, order):
                    return
            await asyncio.sleep(_CONTROL_S)
        ui.notify("The bench takes no order now. To stop it: Abort.", type="negative")

    def refresh(self) -> None:
        """Bring buttons and questions up to date."""
        watch = self._watch
        now, steerable = watch.now, watch.steerable
        paused = bool(now.get("pause_wanted")) or now.get("state") == "paused"
        self._pause.set_visibility(not paused)
        self._resume.set_visibility(paused)
        pressable = steerable and self._presence.may("answer")
        for button in (self._pause, self._resume, self._abort):
            enabled = pressable and (self._named or button is self._abort)
            if button.enabled != enabled:
                button.set_enabled(enabled)
        by_hand = watch.by_hand
        if self._hand.visible != by_hand:
            self._show_hand(by_hand)
        session = watch.session
        open_ = () if by_hand or session is None else watch.prompts
        prompts = {(session.path, row["id"]): row for row in open_ if session is not None}
        asked = [one for one in prompts if one not in self._answered]
        if self._shown != (asked, self._named):
            self._shown = (asked, self._named)
            self._place.clear()
            with self._place:
                for one in asked:
                    self._question(one, str(prompts[one].get("question", "")), self._picture(prompts[one]))

    def _picture(self, prompt: Mapping[str, Any]) -> str:
        """Return the address of a question's picture, empty without one."""
        session, name = self._watch.session, str(prompt.get("picture") or "")
        if session is None or session.run is None or not name:
            return ""
        return f"/picture/{quote(str(session.run.relative_to(self._watch.folder.root) / name))}"

    def _question(self, asked: Asked, text: str, picture: str) -> None:
        with ui.element("div").classes("question"):
            ui.label(text).classes("text").props('data-testid="question"')
            if picture:
                alt = "what the question means, as a picture"
                ui.element("img").classes("shows").props(f'src="{picture}" alt="{alt}"')
            if not self._presence.may("answer"):
                ui.label(f"You are signed in to {self._presence.role}: somebody else answers this.")
                return
            with ui.element("div").classes("choices"):
                yes = ui.button("Done, go on", on_click=lambda: self._answer(asked, "yes")).props(
                    'no-caps unelevated data-testid="answer-yes"'
                )
                other = ui.input(placeholder="yes or no, with a remark").props("dense outlined maxlength=200")
                other.on("keydown.enter", lambda: self._answer(asked, str(other.value or "")))
                no = ui.button("No: abort", on_click=lambda: self._answer(asked, "no"))
                no.props("no-caps outline")
            for each in (yes, other, no):
                each.set_enabled(self._named)

    def _ask_abort(self) -> None:
        """Ask once, for the session that is shown now: the page may show another one when it is pressed."""
        self._aborting = session = self._watch.session
        if session is None:
            return
        self._doomed.text = f"{session.title()} on {session.bench or session.name}"
        self._aborter.value = self._name.value
        self._dialog.open()

    def _answer(self, asked: Asked, answer: str) -> None:
        by = self._signed("answer")
        if not answer.strip() or by is None:
            return
        counted = self._dropped(asked, answer, by)
        if counted is not None and counted[0] != by.name:
            ui.notify(f"{counted[0]} was first and answered {counted[1]!r}", type="warning")
        self.refresh()

    def _dropped(self, asked: Asked, answer: str, by: Signature) -> tuple[str, str] | None:
        """Answer a question; return who gave the answer that counts, and it; None, and said, if none could be."""
        try:
            counted = drop_answer(*asked, answer, by.name, by.role)
        except BenchError as error:
            ui.notify(str(error), type="negative")
            return None
        self._answered.add(asked)
        return counted.by, counted.answer

    def _request(self, action: Action, session: Session | None = None, nameless: str = "") -> None:
        """Ask the session that is shown, or `session`, for something."""
        session = session or self._watch.session
        if session is None or not session.alive:
            ui.notify("Nothing runs.", type="warning")
            return
        if (by := self._signed("answer", nameless)) is None:
            return
        try:
            drop_request(session.path, action, by.name, by.role)
        except BenchError as error:
            ui.notify(str(error), type="negative")
            return
        ui.notify(f"asked for {action}")

    def _abort_now(self) -> None:
        """An abort waits for nobody: without a name the record says so."""
        self._dialog.close()
        name = str(self._aborter.value or "").strip()
        if name and not self._presence.signs_in:
            self._name.value = name
        self._request("abort", self._aborting, f"somebody without a name at {self._client.ip}")

    def _signed(self, needs: Role, nameless: str = "") -> Signature | None:
        """Return who presses; None, and said, for nobody and for somebody who may not do that.

        `nameless`: what the record says where names are typed and none was.
        """
        if not self._presence.may(needs):
            role = self._presence.role
            has = f"you are signed in to {role}" if role else "you are signed out: load the page anew"
            ui.notify(f"This needs the role {needs}: {has}.", type="warning")
            return None
        signature = self._presence.signature(str(self._name.value or "").strip() or nameless)
        if not signature.name:
            ui.notify("Type your name at the top of the page first: it goes into the record.", type="warning")
            return None
        return signature

    async def _recall_name(self) -> None:
        """Fill in the name that the browser keeps; until then nothing that needs one can be pressed."""
        try:
            name = await ui.run_javascript("localStorage.getItem('gyrobench-name')", timeout=_NAME_TIMEOUT_S)
        except TimeoutError:  # the page was closed again, or its browser is very busy
            name = None
        if name and not self._name.value:
            self._name.value = str(name)[:40]
        self._named = True

    @staticmethod
    def _button(text: str, icon: str, act: Callable[[], object], color: str = "primary") -> ui.button:
        props = f'no-caps unelevated data-testid="{text.lower()}"'
        return ui.button(text, icon=icon, on_click=act, color=color).props(props)


def _sign_out() -> None:
    ui.run_javascript("fetch('/sign-out', {method: 'POST'}).then(() => location.assign('/sign-in'))")


def _order_text(verb: str, label: str, field: ui.input) -> str:
    """Return an order with the number that was typed; ValueError, in words, if none was."""
    number = str(field.value or "").strip().replace(",", ".").replace("−", "-")
    try:
        known = math.isfinite(float(number))
    except ValueError:
        known = False
    if not known:
        raise ValueError(f"{label}: type a number first. Nothing was ordered.")
    return f"{verb} {number}"


def _keep_name(event: object) -> None:
    ui.run_javascript(
        f"localStorage.setItem('gyrobench-name', {_js_text(str(getattr(event, 'value', '') or ''))})"
    )


def _js_text(text: str) -> str:
    return json.dumps(text).replace("<", "\\u003c")


def _show(level: str) -> None:
    ui.run_javascript(f"window.gyrobench && window.gyrobench.show({_js_text(level)})")


def _toggle(dark: ui.dark_mode) -> None:
    ui.run_javascript("Quasar.Dark.toggle(); window.gyrobench && window.gyrobench.repaint()")


@cache
def style_sheet() -> str:
    """Return the style sheet; dark by the page's own switch, or by the browser's wish until that is there."""
    dark = (HERE / "assets" / "dark.css").read_text(encoding="utf-8")
    return (
        "".join((HERE / "assets" / name).read_text(encoding="utf-8") for name in ("panel.css", "charts.css"))
        + f"body.body--dark {{ {dark} }}\n"
        + f"@media (prefers-color-scheme: dark) {{ body:not(.body--light) {{ {dark} }} }}\n"
    )
