"""The panel's server: the page, a socket that sends what is new ten times a second, reports."""

from __future__ import annotations

import asyncio
import json
import secrets
import signal
import sys
import tempfile
from pathlib import Path
from typing import Any

from fastapi import Body, Request, WebSocket
from fastapi.responses import FileResponse, JSONResponse, PlainTextResponse, Response
from nicegui import app, ui

from bench.control.operators import OperatorsFile
from bench.present.panel._access import Access, visit_of
from bench.present.panel._benches import Benches
from bench.present.panel._desk_routes import Desks
from bench.present.panel._folders import PAPERS, RunsFolder
from bench.present.panel._frame import Frame
from bench.present.panel._history import History
from bench.present.panel._metrics import Metrics
from bench.present.panel._page import build_page, style_sheet
from bench.present.panel._past import Past
from bench.present.panel._presence import Presence
from bench.present.panel._settings import PanelSettings, tls
from bench.present.panel._sign_in import Sessions
from bench.present.panel._sign_in_routes import SignIn
from bench.present.panel._visitors import SERVER_LIMITS, Visitor
from bench.present.panel._watch import Watch
from bench.record.run_folder import MANIFEST_FILE, PICTURES_FOLDER
from bench.record.run_notes import notes_changed_ns
from drivers.base.errors import BenchError

_TICK_S = 0.1
_REPORT_TIMEOUT_S = 300.0
_WORK_S = 1.0
_UNWATCHED_TICKS = 10
"""Ticks from one reading of what the panel chooses to the next while nobody looks at it."""
_LOST_S = 30.0
"""A page is given up after that, and counts as cut off after 0.4 of it without a sign of life.

With NiceGUI's own 3 s, a page that a busy machine held up for 4 s was loaded anew, and what was typed was gone.
"""
_SIGNED_OUT = 4401
_WAITING = 8
"""Ticks a slow browser may be behind before it is given everything anew."""
_IDLE_HUBS = 4
"""Sessions that nobody looks at any more and that are kept all the same: a page comes back within seconds."""
_CHOSEN = ("", "")
"""What the panel shows to whoever asks for no session and no bench."""
_PICTURES = {".png": "image/png", ".jpg": "image/jpeg"}
_NO_SCRIPTS = {
    "Content-Security-Policy": "default-src 'none'; style-src 'unsafe-inline'; img-src data:",
    "X-Content-Type-Options": "nosniff",
    "Cache-Control": "no-store",
}


def serve(settings: PanelSettings) -> None:
    """Serve the panel until Ctrl-C; raises ConfigurationError for settings that cannot be used."""
    settings.check()
    folder = RunsFolder(settings.runs)
    sessions = None if settings.operators is None else Sessions(OperatorsFile(settings.operators))
    hubs = Hubs(folder, sessions)
    frame = Frame(folder, hubs.benches)
    desks = Desks(folder, frame, settings.desks(hubs.benches))
    desks.work()
    app.add_middleware(Access, token=settings.token, sessions=sessions)
    if sessions is not None:
        _serve_sign_in(SignIn(sessions, frame))
    app.websocket("/panel/live")(hubs.attend)
    app.timer(_TICK_S, hubs.tick)
    app.timer(_WORK_S, desks.work)
    scratch = tempfile.TemporaryDirectory(prefix="gyrobench-panel-")
    reports = Reports(folder, Path(scratch.name))
    app.get("/panel/who")(_who)
    app.get("/panel/benches")(frame.strip)
    app.get("/metrics")(Metrics(folder, hubs.benches, desks).page)
    app.get("/picture/{name:path}")(reports.picture)
    app.get("/report/{name:path}")(reports.get)
    app.get("/certificate/{name:path}")(reports.certificate)
    history = History(folder, hubs.benches, Path(scratch.name))
    app.get("/history")(history.page)
    Past(folder, hubs.benches, history, Path(scratch.name)).serve(app)
    app.get("/panel/window")(hubs.window)
    app.post("/panel/acknowledge")(hubs.acknowledge)
    app.get("/queue/{name}")(desks.page)
    app.get("/panel/queue/{name}")(desks.view)
    app.post("/panel/queue/{name}/plan")(desks.plan)
    app.post("/panel/queue/{name}/rehearse")(desks.rehearse)
    app.post("/panel/queue/{name}/change")(desks.change)
    app.get("/panel/style.css")(lambda: Response(style_sheet(), media_type="text/css"))
    app.add_static_files("/panel/assets", Path(__file__).parent / "assets")
    ui.page("/", title="gyrobench panel", favicon=Path(__file__).parent / "assets" / "icon.svg")(hubs.page)
    signal.signal(signal.SIGTERM, signal.default_int_handler)  # services are stopped so; clean up then too
    try:
        ui.run(
            host=settings.host,
            port=settings.port,
            title="gyrobench panel",
            dark=None,
            show=False,
            reload=False,
            tailwind=False,
            binding_refresh_interval=None,
            show_welcome_message=False,
            message_history_length=100,
            reconnect_timeout=_LOST_S,
            http=Visitor,
            **SERVER_LIMITS,
            **(tls(settings.certificate, settings.key) if settings.certificate is not None else {}),
        )
    finally:
        scratch.cleanup()


def _serve_sign_in(sign_in: SignIn) -> None:
    app.get("/sign-in")(sign_in.page)
    app.post("/sign-in")(sign_in.enter)
    app.post("/sign-out")(sign_in.leave)
    app.get("/operators")(sign_in.operators)
    app.post("/operators")(sign_in.change)


class Hubs:
    """A hub for all that pages look at: a session by its name, a bench by its own, or what the panel chooses."""

    def __init__(self, folder: RunsFolder, sessions: Sessions | None = None) -> None:
        self._folder = folder
        self._sessions = sessions
        self.benches = self._benches = Benches(folder)
        self._frame = Frame(folder, self._benches)
        self._hubs = {_CHOSEN: Hub(Watch(folder, self._benches))}
        self._ticks = 0

    def page(self, request: Request, session: str = "", bench: str = "") -> None:
        """Build the page of one browser."""
        hub, visit = self._of(session, bench), visit_of(request)
        hub.tick()
        build_page(hub.watch, self._frame.values(visit, "/"), Presence(visit, self._sessions))

    async def attend(self, page: WebSocket, session: str = "", bench: str = "") -> None:
        """Send to one page until it goes, or whoever looks at it is signed out."""
        await self._of(session, bench).attend(page, Presence(visit_of(page), self._sessions))

    def window(self, from_s: float, to_s: float, session: str = "", bench: str = "") -> Response:
        """Return the curves of a stretch that a page has zoomed into."""
        return JSONResponse(self._of(session, bench).watch.window(from_s, to_s))

    def acknowledge(self, request: Request, session: str = Body(), by: str = Body()) -> Response:
        """Write down that somebody has seen the alarms of a session's bench."""
        found = next((one for one in self._benches.sessions if one.name == session), None)
        if found is None:
            return PlainTextResponse("There is no such session.", status_code=404)
        try:
            name = visit_of(request).signature(by).name
            return PlainTextResponse(str(self._benches.acknowledge(found, name)))
        except BenchError as error:
            return PlainTextResponse(str(error), status_code=400)

    def tick(self) -> None:
        """Send news to all pages. What nobody looks at is not read; what the panel chooses, once a second."""
        self._ticks += 1
        seldom = self._ticks % _UNWATCHED_TICKS == 0
        for what, hub in list(self._hubs.items()):
            if hub.watched or (what == _CHOSEN and seldom):
                hub.tick()

    def _of(self, session: str, bench: str) -> Hub:
        what = session, bench
        if what not in self._hubs:
            idle = [other for other, hub in self._hubs.items() if other != _CHOSEN and not hub.watched]
            for other in idle[_IDLE_HUBS:]:
                del self._hubs[other]
            self._hubs[what] = Hub(Watch(self._folder, self._benches, session, bench))
        return self._hubs[what]


class Hub:
    """Sends every page that looks at a session what is new. One reading of the files serves all of them."""

    def __init__(self, watch: Watch) -> None:
        self.watch = watch
        self._name = secrets.token_hex(8)
        self._pages: dict[WebSocket, asyncio.Queue[str]] = {}
        self._values: dict[str, str] = {}
        self._news: dict[str, Any] = {}
        self._runs: list[dict[str, Any]] = []
        self._tails: dict[str, Any] = {}
        self._noise: list[dict[str, Any]] = []
        self._versions: tuple[int, ...] = ()

    @property
    def watched(self) -> bool:
        """Whether a page looks at it."""
        return bool(self._pages)

    def tick(self) -> None:
        """Read, and hand every page what has changed since the last tick."""
        watch = self.watch
        watch.update()
        values, news, tails = watch.values(), watch.news(), watch.tails()
        message: dict[str, Any] = {}
        if changed := {key: text for key, text in values.items() if self._values.get(key) != text}:
            message["values"] = changed
        if news != self._news:
            message["news"] = news
        if watch.runs() != self._runs:
            message["runs"] = self._runs = watch.runs()
        if watch.noise() != self._noise:
            message["noise"] = self._noise = watch.noise()
        if watch.versions() != self._versions:
            message["curves"] = watch.snapshot()
        elif tails != self._tails:
            message["rows"] = tails
        self._values, self._news, self._tails = values, news, tails
        self._versions = watch.versions()
        if message and self._pages:
            text = _encoded(message)
            for page, queue in self._pages.items():
                if queue.full():
                    self._begin(page)
                else:
                    queue.put_nowait(text)

    async def attend(self, page: WebSocket, presence: Presence) -> None:
        """Send to one page until it goes; it says nothing itself."""
        await page.accept()
        self._begin(page)
        leaving = asyncio.create_task(_until_gone(page))
        try:
            while not leaving.done():
                if not presence.may("look"):
                    await page.close(_SIGNED_OUT)
                    break
                getting = asyncio.create_task(self._pages[page].get())
                await asyncio.wait({getting, leaving}, return_when=asyncio.FIRST_COMPLETED)
                if not getting.done():
                    getting.cancel()
                    break
                await page.send_text(getting.result())
        except Exception:
            pass  # the browser is gone in one of the many ways a connection ends
        finally:
            leaving.cancel()
            self._pages.pop(page, None)

    def _begin(self, page: WebSocket) -> None:
        """Send everything, in place of what still waits."""
        queue = self._pages.setdefault(page, asyncio.Queue(_WAITING))
        while not queue.empty():
            queue.get_nowait()
        everything: dict[str, Any] = {"values": self._values, "news": self._news, "runs": self._runs}
        everything["noise"] = self._noise
        everything["curves"] = self.watch.snapshot()
        queue.put_nowait(_encoded({"panel": self._name} | everything))


class Reports:
    """Serves the report of a run: the one in its folder, or one made for the occasion outside of it."""

    def __init__(self, folder: RunsFolder, scratch: Path) -> None:
        self._folder = folder
        self._scratch = scratch
        self._making: dict[str, asyncio.Lock] = {}

    async def get(self, name: str) -> Response:
        """Answer a request for the report of the run or campaign folder of that name."""
        page = self._folder.page_in(name, PAPERS["report"])
        if page is None or _older_than_notes(page):
            run = self._folder.inside(name)
            if run is None or not (run / MANIFEST_FILE).is_file():
                return PlainTextResponse("There is no such run.", status_code=404)
            page = await self._make(run)
        if page is None:
            return PlainTextResponse(f"No report could be made of {name}.", status_code=500)
        return FileResponse(page, headers=_NO_SCRIPTS, media_type="text/html; charset=utf-8")

    def certificate(self, name: str) -> Response:
        """Answer a request for the certificate that lies in a folder."""
        page = self._folder.page_in(name, PAPERS["certificate"])
        if page is None:
            return PlainTextResponse("There is no certificate here.", status_code=404)
        return FileResponse(page, headers=_NO_SCRIPTS, media_type="text/html; charset=utf-8")

    def picture(self, name: str) -> Response:
        """Answer a request for the picture of a question."""
        path = self._folder.inside(name)
        kind = None if path is None else _PICTURES.get(path.suffix)
        if path is None or kind is None or path.parent.name != PICTURES_FOLDER or not path.is_file():
            return PlainTextResponse("There is no such picture.", status_code=404)
        return FileResponse(path, headers=_NO_SCRIPTS, media_type=kind)

    async def _make(self, run: Path) -> Path | None:
        """Have a process of its own make it: numbers and plots cost seconds, and the panel stays smooth."""
        stamp = ((run / MANIFEST_FILE).stat().st_mtime_ns, notes_changed_ns(run))
        target = self._scratch / f"{abs(hash((str(run), stamp)))}.html"
        async with self._making.setdefault(target.name, asyncio.Lock()):
            if not target.exists():
                command = "from bench.present.cli import main; main()"
                process = await asyncio.create_subprocess_exec(
                    *(sys.executable, "-c", command, "report", str(run), "--out", str(target)),
                    stdout=asyncio.subprocess.DEVNULL,
                    stderr=asyncio.subprocess.DEVNULL,
                )
                try:
                    await asyncio.wait_for(process.wait(), _REPORT_TIMEOUT_S)
                except TimeoutError:
                    process.kill()
                    await process.wait()
        return target if target.exists() else None


def _who(request: Request) -> JSONResponse:
    """Tell a page who looks at it."""
    visit = visit_of(request)
    return JSONResponse({"name": visit.name, "role": visit.role}, headers={"cache-control": "no-store"})


def _older_than_notes(report: Path) -> bool:
    return report.stat().st_mtime_ns < notes_changed_ns(report.parent)


async def _until_gone(page: WebSocket) -> None:
    while (await page.receive())["type"] != "websocket.disconnect":
        pass


def _encoded(message: dict[str, Any]) -> str:
    return json.dumps(message, ensure_ascii=False, allow_nan=False, separators=(",", ":"))
