"""Pages of recorded runs: their curves over one another, notes and pictures, figures over time and by unit."""

from __future__ import annotations

import asyncio
import base64
import binascii
import json
from collections.abc import Mapping
from datetime import datetime
from pathlib import Path
from typing import Annotated, Any

import nicegui
from fastapi import Body, Query, Request
from fastapi.responses import JSONResponse, PlainTextResponse, Response

from bench.present.panel._access import visit_of
from bench.present.panel._benches import Benches
from bench.present.panel._figure_store import FigureStore
from bench.present.panel._folders import RunsFolder
from bench.present.panel._frame import Frame
from bench.present.panel._history import History
from bench.present.panel._listing import listed
from bench.present.panel._run_curves import check_stretch
from bench.present.panel._trend import trends
from bench.present.panel._workshop import Workshop
from bench.record.run_folder import MANIFEST_FILE
from bench.record.run_notes import (
    MEDIA_TYPES,
    MOST_PICTURE_BYTES,
    MOST_TEXT,
    add_note,
    note_picture,
    read_notes,
)
from drivers.base.errors import BenchError, ConfigurationError, RecordError

MOST_RUNS, MOST_UNITS = 8, 6
_KEPT_CURVES = 40
_MOST_BODY = 2 * MOST_PICTURE_BYTES
"""Of a note with its picture as base64."""
Names = Annotated[list[str], Query(default_factory=list)]


class Past:
    """Answers for runs that are over; what costs seconds is done by a worker, once a change."""

    def __init__(self, folder: RunsFolder, benches: Benches, history: History, scratch: Path) -> None:
        self._folder = folder
        self._benches = benches
        self._history = history
        self._frame = Frame(folder, benches)
        self._figures = FigureStore(folder.root, scratch)
        self._workshop, self._rehearsing = Workshop(), Workshop()
        self._curves: dict[tuple[object, ...], dict[str, Any]] = {}
        self._trends: dict[tuple[str, ...], tuple[object, dict[str, Any]]] = {}
        self._tasks: set[asyncio.Task[None]] = set()

    def serve(self, app: Any) -> None:
        """Have a server answer for these pages."""
        app.get("/curves")(self.curves_page)
        app.get("/panel/curves")(self.curves)
        app.get("/panel/expected")(self.expected)
        app.post("/panel/notes/{name:path}")(self.note)
        app.post("/panel/recover/{name:path}")(self.recover)
        app.get("/panel/picture/{picture}")(self.picture)
        app.get("/trends")(self.trends_page)
        app.get("/panel/trends")(self.trends)
        app.add_static_files("/panel/echarts", Path(nicegui.__file__).parent / "elements" / "echart" / "dist")

    # Curves and notes

    def curves_page(self, request: Request, run: Names) -> Response:
        """Return the page of one run, or of several laid over one another."""
        names = list(dict.fromkeys(run))
        found = [name for name in names if self._run(name) is not None]
        problem = "" if found else "Choose runs in the list first."
        if len(found) < len(names):
            problem = f"There is no run {', '.join(name for name in names if name not in found)} here."
        if len(found) > MOST_RUNS:
            problem = f"The first {MOST_RUNS} of {len(found)} runs are shown."
        shown = [self._shown(name) for name in found[:MOST_RUNS]]
        return self._frame.page(
            "curves.html.j2", visit_of(request), "/curves", runs=shown, problem=problem, most_text=MOST_TEXT
        )

    async def curves(self, run: str, from_s: float | None = None, to_s: float | None = None) -> Response:
        """Return the curves of a run, or of a stretch of it, as `run_curves` has them."""
        folder = self._run(run)
        if folder is None:
            return JSONResponse({"problem": "There is no such run."}, status_code=404)
        try:
            check_stretch(from_s, to_s)
        except RecordError as error:
            return JSONResponse({"problem": str(error)}, status_code=400)
        key = (run, (folder / MANIFEST_FILE).stat().st_mtime_ns, from_s, to_s)
        if key not in self._curves:
            self._keep(key, await self._workshop.ask("curves", run=str(folder), from_s=from_s, to_s=to_s))
        return JSONResponse(self._curves[key])

    async def expected(self, run: str) -> Response:
        """Return the plan's curves of a run, as `run_expected` has them."""
        folder = self._run(run)
        if folder is None:
            return JSONResponse({"problem": "There is no such run."}, status_code=404)
        key = (run, "expected")
        if key not in self._curves:
            answer = await self._rehearsing.ask("expected", run=str(folder))
            if "problem" in answer:
                return JSONResponse(answer)
            self._keep(key, answer)
        return JSONResponse(self._curves[key])

    def _keep(self, key: tuple[object, ...], answer: dict[str, Any]) -> None:
        while len(self._curves) >= _KEPT_CURVES:
            del self._curves[next(iter(self._curves))]
        self._curves[key] = answer

    async def note(self, name: str, request: Request) -> Response:
        """Attach a note that a page sends: {"by", "text", "picture": base64 or empty}."""
        folder = self._run(name)
        if folder is None:
            return PlainTextResponse("There is no such run.", status_code=404)
        body = bytearray()
        async for part in request.stream():
            body += part
            if len(body) > _MOST_BODY:
                return PlainTextResponse("The picture is too large: at most 8 MiB.", status_code=413)
        try:
            asked = json.loads(bytes(body))
            picture = base64.b64decode(str(asked.get("picture") or ""), validate=True)
            by, text = str(asked.get("by") or ""), str(asked.get("text") or "")
        except (ValueError, AttributeError, binascii.Error):
            return PlainTextResponse("This is no note.", status_code=400)
        try:
            by = visit_of(request).signature(by).name
            await asyncio.to_thread(add_note, folder, by, text, picture)
        except BenchError as error:
            return PlainTextResponse(str(error), status_code=400)
        return JSONResponse(self._notes(name, folder))

    async def recover(self, request: Request, name: str, by: Annotated[str, Body(embed=True)]) -> Response:
        """Complete the record of a run that a crash left open; the answer is how it stands now."""
        folder = self._run(name)
        if folder is None:
            return PlainTextResponse("There is no such run.", status_code=404)
        by = visit_of(request).signature(by).name
        if not by:
            return PlainTextResponse("Type your name first: it goes into the record.", status_code=400)
        answer = await self._workshop.ask("recover", run=str(folder), by=by)
        if problem := answer.get("problem"):
            return PlainTextResponse(str(problem), status_code=409)
        return JSONResponse(answer)

    def picture(self, picture: str, name: str) -> Response:
        """Return a picture attached to a run."""
        folder = self._run(name)
        try:
            if folder is None:
                raise RecordError("there is no such run")
            content = note_picture(folder, picture)
        except RecordError:
            return PlainTextResponse("There is no such picture.", status_code=404)
        headers = {
            "X-Content-Type-Options": "nosniff",
            "Cache-Control": "private, max-age=31536000, immutable",
        }
        return Response(content, media_type=MEDIA_TYPES[picture.rpartition(".")[2]], headers=headers)

    # Figures

    def trends_page(self, request: Request, unit: Names, figure: str = "") -> Response:
        """Return the page of figures over time; its numbers come as `trends`."""
        units = [text for one in unit for part in one.split(",") if (text := part.strip())]
        return self._frame.page(
            "trends.html.j2",
            visit_of(request),
            "/trends",
            units=list(dict.fromkeys(units))[:MOST_UNITS],
            figure=figure,
            known=self._history.units(),
        )

    async def trends(self, unit: Names) -> Response:
        """Return all figures of units, as `trends` has them, and how many runs are still to be read."""
        units = tuple(dict.fromkeys(unit))[:MOST_UNITS]
        runs: dict[str, float] = {}
        for one in units:
            runs |= await asyncio.to_thread(self._completed, one)
        known = self._figures.known(runs)
        if len(known) < len(runs):
            task = asyncio.create_task(self._figures.work())
            self._tasks.add(task)
            task.add_done_callback(self._tasks.discard)
        state = (self._figures.version, tuple(runs))
        if units not in self._trends or self._trends[units][0] != state:
            points = [
                row | {"run": name, "time_s": runs[name]}
                for name, answer in known.items()
                for row in answer.get("figures", ())
                if row["unit"] in units
            ]
            problems = [[name, answer["problem"]] for name, answer in known.items() if "problem" in answer]
            figures = await asyncio.to_thread(trends, points, units)
            while len(self._trends) >= _KEPT_CURVES:
                del self._trends[next(iter(self._trends))]
            self._trends[units] = (state, {"figures": figures, "problems": problems})
        counts = {"runs": len(runs), "missing": len(runs) - len(known)}
        return JSONResponse(self._trends[units][1] | counts)

    def _completed(self, unit: str) -> dict[str, float]:
        """Return the completed runs of a unit that count, by name, with their start, s since 1970."""
        found = {}
        for entry in self._history.entries({"unit": unit, "outcome": "completed"})[0]:
            if entry.manifest is not None and not self._folder.set_aside(self._folder.root / entry.name):
                found[entry.name] = datetime.fromisoformat(entry.manifest.started_utc).timestamp()
        return found

    # Parts

    def _run(self, name: str) -> Path | None:
        folder = self._folder.inside(name)
        return folder if folder is not None and (folder / MANIFEST_FILE).is_file() else None

    def _shown(self, name: str) -> Mapping[str, Any]:
        folder = self._run(name)
        entry = None if folder is None else self._folder.entry(folder)
        if folder is None or entry is None:
            raise ConfigurationError("there is no such run", found=name)
        return listed(entry, self._folder, self._benches) | {"notes": self._notes(name, folder)}

    def _notes(self, name: str, folder: Path) -> list[dict[str, str]]:
        return [
            {
                "utc": note.utc[:16].replace("T", " "),
                "by": note.by,
                "text": note.text,
                "picture": note.picture,
            }
            for note in read_notes(folder)
        ]
