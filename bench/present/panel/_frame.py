"""What every page has: the strip of all benches, the way to the other pages, its headers."""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import Any

from fastapi.responses import HTMLResponse, JSONResponse, Response
from jinja2 import Environment, FileSystemLoader, StrictUndefined, Template

from bench.control.operators import may
from bench.present.panel._access import Visit
from bench.present.panel._benches import Benches
from bench.present.panel._folders import RunsFolder

HERE = Path(__file__).parent
PAGE_HEADERS = {
    "Content-Security-Policy": "default-src 'self'; img-src 'self' data:; frame-ancestors 'none'",
    "X-Content-Type-Options": "nosniff",
    "Cache-Control": "no-store",
}


class Frame:
    """Makes pages; `Visit` says who looks at one."""

    def __init__(self, folder: RunsFolder, benches: Benches) -> None:
        self._folder = folder
        self._benches = benches

    def page(self, name: str, visit: Visit, here: str, status: int = 200, **values: Any) -> Response:
        """Return the page of the template `name`; `here`: its own address, as `links` has it."""
        text = template(name).render(self.values(visit, here), visit=visit, **values)
        return HTMLResponse(text, status, PAGE_HEADERS)

    def values(self, visit: Visit, here: str) -> dict[str, Any]:
        """Return what the head of a page is made of: `benches` and `links`."""
        return {"benches": self._benches.strip(), "links": self.links(visit, here)}

    def links(self, visit: Visit, here: str) -> list[tuple[str, str, bool]]:
        """Return text and address of every page, and whether it is the one that is looked at."""
        queues = self._folder.queues
        found = [("Live", "/")]
        found += [
            (f"Queue of {name}" if len(queues) > 1 else "Queue", queue.address)
            for name, queue in queues.items()
        ]
        found += [("Runs", "/history"), ("Trends", "/trends")]
        if visit.name and may(visit.role, "configure"):
            found.append(("Operators", "/operators"))
        return [(text, address, address == here) for text, address in found]

    def strip(self) -> Response:
        """Answer a page that has been open for a while with the benches as they are now."""
        self._benches.update()
        return JSONResponse(self._benches.strip(), headers={"cache-control": "no-store"})


@cache
def _environment() -> Environment:
    return Environment(
        autoescape=True, undefined=StrictUndefined, loader=FileSystemLoader(HERE), trim_blocks=True
    )


def template(name: str) -> Template:
    """Return a page's template."""
    return _environment().get_template(name)
