"""What the server answers of queues: a page for each bench, its state, and what operators ask of it."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import suppress
from datetime import datetime
from typing import Any, cast

from fastapi import Request
from fastapi.responses import JSONResponse, RedirectResponse, Response

from bench.campaign.queue import (
    BenchQueue,
    CampaignOrder,
    HuntOrder,
    Order,
    Preset,
    Presets,
    QueueState,
    RunOrder,
)
from bench.control.operators import Signature
from bench.control.procedure import find_procedure, load_procedures
from bench.present.panel._access import visit_of
from bench.present.panel._desk import Desk, repeated, resume_order
from bench.present.panel._folders import QueueLink, RunsFolder
from bench.present.panel._forms import Mistakes, fields, order_of
from bench.present.panel._frame import Frame
from bench.present.panel._rehearse import Rehearsals
from bench.present.panel._words import waiting_words
from bench.record.recording import read_manifest
from drivers.base.clock import host_seconds
from drivers.base.errors import BenchError, ConfigurationError

_VIEW_S = 0.5


class Desks:
    """The desks of all benches that the panel was given, by the name in their address."""

    def __init__(self, folder: RunsFolder, frame: Frame, desks: list[Desk]) -> None:
        self._folder = folder
        self._frame = frame
        self._desks = {desk.queue.name: desk for desk in desks}
        self._presets = Presets(folder.root)
        self._rehearsals = Rehearsals(folder.root)
        self._problems: dict[str, str] = {}
        self._views: dict[str, tuple[float, dict[str, Any]]] = {}

    def states(self) -> dict[str, QueueState]:
        """Return the queue of each bench, without those whose file cannot be read."""
        found = {}
        for desk in self._desks.values():
            with suppress(BenchError):
                found[desk.queue.bench] = desk.queue.state()
        return found

    def work(self) -> None:
        """Start what is due and tell other pages what waits; what is wrong with a queue is shown on its page."""
        for name, desk in self._desks.items():
            waits = "queue cannot be read"
            try:
                if desk.queue.work():
                    self._views.pop(name, None)
                self._problems.pop(name, None)
                waits = waiting_words(desk.queue.state())
            except (BenchError, OSError) as error:
                self._problems[name] = str(error)
            self._folder.queues[desk.queue.bench] = QueueLink(desk.address, desk.emulated, waits)

    def page(
        self,
        request: Request,
        name: str,
        procedure: str = "",
        item: str = "",
        edit: str = "",
        run: str = "",
        preset: str = "",
    ) -> Response:
        """Return a bench's page; its form is filled from a run, a preset, or an item of the queue."""
        if name not in self._desks:
            return RedirectResponse("/", 303)
        desk, problem = self._desks[name], ""
        values: dict[str, Any] = {}
        try:
            procedure, values = self._filled(desk, procedure, item or edit, run, preset)
            shown = fields(find_procedure(procedure), desk.file, values) if procedure else []
        except BenchError as error:
            procedure, shown, problem = "", [], str(error)
        return self._frame.page(
            "desk.html.j2",
            visit_of(request),
            desk.address,
            desk=desk,
            emulated=desk.emulated,
            procedures=[(one.name, one.title) for one in load_procedures().values()],
            procedure=find_procedure(procedure) if procedure else None,
            fields=shown,
            edit=edit,
            problem=problem,
            presets=self._of_procedure(procedure),
            campaigns=desk.campaign_files(),
            models=desk.model_files(),
            resumable=list(desk.open_campaigns()),
        )

    def view(self, name: str) -> Response:
        """Return the state of a queue."""
        if name not in self._desks:
            return _refused("There is no such bench.", 404)
        known = self._views.get(name)
        if known is None or host_seconds() - known[0] > _VIEW_S:
            try:
                view = self._desks[name].view() | {"problem": self._problems.get(name, "")}
            except (BenchError, OSError) as error:
                view = {"problem": str(error)}
            self._views[name] = known = host_seconds(), view
        return JSONResponse(known[1])

    def plan(self, name: str, asked: dict[str, Any]) -> Response:
        """Return an estimate of an order, or what is wrong with it."""
        try:
            desk, order = self._asked(name, asked)
            return JSONResponse(desk.estimate(order))
        except _WrongForm as wrong:
            return wrong.answer
        except BenchError as error:
            return _refused(str(error))

    async def rehearse(self, name: str, asked: dict[str, Any]) -> Response:
        """Return the plan of an order by rehearsal."""
        try:
            desk, order = self._asked(name, asked)
            if isinstance(order, HuntOrder):
                raise ConfigurationError(
                    "a search chooses each run from what the runs before it tell: it cannot be rehearsed"
                )
            known = desk.estimate(order)
            return JSONResponse(known | await self._rehearsals.plan(order, desk.queue.bench_file))
        except _WrongForm as wrong:
            return wrong.answer
        except (BenchError, OSError) as error:
            return _refused(str(error))

    def change(self, request: Request, name: str, asked: dict[str, Any]) -> Response:
        """Do what an operator asks of a queue."""
        try:
            self._change(name, asked, visit_of(request).signature(str(asked.get("by", ""))))
        except _WrongForm as wrong:
            return wrong.answer
        except (BenchError, OSError) as error:
            return _refused(str(error))
        self._views.pop(name, None)
        return self.view(name)

    def _change(self, name: str, asked: Mapping[str, Any], signature: Signature) -> None:
        action, item = (str(asked.get(key, "")) for key in ("action", "item"))
        by, role = signature
        queue = self._desk(name).queue
        if action in ("add", "edit", "start_now"):
            order, at = self._order(name, asked), _time(asked.get("not_before"))
            if action == "edit":
                queue.edit(item, order, by, at, role)
            elif action == "add":
                queue.add(order, by, at, role)
            else:
                self._start_now(queue, order, signature)
        elif action == "move":
            place = asked.get("place")
            queue.move(item, place if isinstance(place, int) else 0)
        elif action == "remove":
            queue.remove(item)
        elif action == "start":
            queue.start(item, by, role)
        elif action == "hold":
            queue.hold(by)
        elif action == "let_go":
            queue.let_go(by)
        elif action == "save_preset":
            order = cast(RunOrder, self._order(name, asked))
            title = str(asked.get("preset") or "").strip()[:60]
            if not title or not by.strip():
                raise ConfigurationError("a preset needs a name, and so does whoever saves it")
            self._presets.save(
                Preset(name=title, procedure=order.procedure, parameters=order.parameters, by=by)
            )
        elif action == "remove_preset":
            self._presets.remove(str(asked.get("procedure")), str(asked.get("preset")))
        else:
            raise ConfigurationError("this cannot be asked of a queue", found=action)

    @staticmethod
    def _start_now(queue: BenchQueue, order: Order, signature: Signature) -> None:
        """Start an order at once or not at all: one that is refused does not stay in the queue."""
        item = queue.add(order, signature.name, role=signature.role)
        try:
            queue.start(item.id, *signature)
        except BenchError:
            queue.remove(item.id)
            raise

    def _filled(
        self, desk: Desk, procedure: str, item: str, run: str, preset: str
    ) -> tuple[str, dict[str, Any]]:
        """Return procedure and values that a form begins with."""
        if item:
            state = desk.queue.state()
            every = (*state.waiting, *state.ended, *((state.current,) if state.current else ()))
            found = next((one for one in every if one.id == item), None)
            if found is None or not isinstance(found.order, RunOrder):
                raise ConfigurationError("this is not in the queue any more", found=item)
            return found.order.procedure, found.order.parameters
        if run:
            folder = self._folder.inside(run)
            if folder is None:
                raise ConfigurationError("there is no such run", found=run)
            manifest = read_manifest(folder)
            return manifest.procedure, repeated(manifest.parameters, manifest.procedure)
        if preset:
            saved = next((one for one in self._of_procedure(procedure) if one.name == preset), None)
            if saved is None:
                raise ConfigurationError("there is no such preset", found=preset)
            return procedure, saved.parameters
        return procedure, {}

    def _asked(
        self, name: str, asked: Mapping[str, Any]
    ) -> tuple[Desk, RunOrder | CampaignOrder | HuntOrder]:
        order = self._order(name, asked)
        if not isinstance(order, RunOrder | CampaignOrder | HuntOrder):
            raise ConfigurationError("a campaign that was begun has no plan any more", found=order.title)
        return self._desk(name), order

    def _order(self, name: str, asked: Mapping[str, Any]) -> Order:
        """Return the order that a page sends; _WrongForm for a form with mistakes."""
        desk = self._desk(name)
        if campaign := str(asked.get("campaign") or ""):
            return desk.campaign_order(campaign)
        if model := str(asked.get("model") or ""):
            return desk.hunt_order(model, asked.get("budget_h"), asked.get("until"))
        if resume := str(asked.get("resume") or ""):
            return resume_order(desk.queue.runs, resume)
        procedure, typed = find_procedure(str(asked.get("procedure"))), asked.get("typed")
        if not isinstance(typed, dict):
            raise ConfigurationError(
                "a run without its form", expected="typed: name and text of each parameter"
            )
        order = order_of(procedure, {str(key): str(text) for key, text in typed.items()})
        if isinstance(order, Mistakes):
            raise _WrongForm(order)
        if asked.get("action") != "save_preset":
            desk.estimate(order)  # refused here and now, not when its turn comes
        return order

    def _of_procedure(self, procedure: str) -> list[Preset]:
        return [one for one in self._presets.all() if one.procedure == procedure]

    def _desk(self, name: str) -> Desk:
        if name not in self._desks:
            raise ConfigurationError("there is no such bench", found=name)
        return self._desks[name]


class _WrongForm(Exception):
    """A form with mistakes, and the answer that tells them."""

    def __init__(self, mistakes: Mistakes) -> None:
        super().__init__()
        self.answer = JSONResponse(
            {"mistakes": dict(mistakes.fields), "error": "; ".join(mistakes.whole)}, status_code=422
        )


def _time(text: object) -> datetime | None:
    """Return a time that the browser sends, with its zone."""
    if not text:
        return None
    try:
        time = datetime.fromisoformat(str(text))
    except ValueError as error:
        raise ConfigurationError("this is no time", found=str(text)[:60]) from error
    if time.tzinfo is None:
        raise ConfigurationError("a time without its zone", found=str(text)[:60])
    return time


def _refused(text: str, status: int = 400) -> Response:
    return JSONResponse({"error": text}, status_code=status)
