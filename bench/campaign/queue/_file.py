"""The file of a bench's queue: what waits, what goes on, what has ended; changed by one process at a time."""

from __future__ import annotations

import os
import secrets
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated, Any, Literal, TypeVar

from pydantic import AwareDatetime, BaseModel, ConfigDict, Field, ValidationError

from bench.record.events import Role
from drivers.base.errors import RecordError
from drivers.base.files import SETTINGS_BYTES, read_bounded, replace_file
from drivers.base.locks import take_lock
from drivers.base.system import open_flags

FOLDER = ".queue"
"""Where queues lie in a runs folder: hidden, so that nobody takes it for a run."""
MOST_WAITING = 200
_KEPT = 20
Model = TypeVar("Model", bound=BaseModel)


class _Part(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid")


class RunOrder(_Part):
    """One run. `parameters`: those that are not the procedure's defaults."""

    kind: Literal["run"] = "run"
    procedure: str = Field(min_length=1)
    parameters: dict[str, Any] = Field(default_factory=dict)


class CampaignOrder(_Part):
    """A campaign from its file, in a new folder `out` of the runs folder."""

    kind: Literal["campaign"] = "campaign"
    file: Path
    title: str
    out: str = Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9_-]*$")


class ResumeOrder(_Part):
    """A campaign that was begun goes on; `folder` lies in the runs folder."""

    kind: Literal["resume"] = "resume"
    folder: Path
    title: str


class HuntOrder(_Part):
    """A search for a missing effect in the runs folder's folder `out`; `model` None: it was begun and goes on.

    `budget_h`: bench time that it may spend. `until`: probability from which an explanation counts as found.
    """

    kind: Literal["hunt"] = "hunt"
    model: Path | None
    title: str
    out: str = Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9._-]*$")
    budget_h: float = Field(gt=0.0, le=10_000.0)
    until: float = Field(gt=0.5, lt=1.0)


Order = Annotated[RunOrder | CampaignOrder | ResumeOrder | HuntOrder, Field(discriminator="kind")]


class Started(_Part):
    """Who started an item, and its process; `pid` 0: whoever started it was killed before it could say."""

    by: str
    role: Role | None = None
    utc: AwareDatetime
    pid: int = 0
    process_start: int = 0


class Ended(_Part):
    """How an item ended.

    `refused`: the command said no before anything was recorded. `lost`: its process ended without a word.
    `unclear`: it may or may not have been started. `detail`: its own reason, for people.
    """

    outcome: Literal["completed", "invalid", "aborted", "failed", "refused", "lost", "unclear"]
    detail: str = ""
    folder: str = ""


class Item(_Part):
    """An order in the queue, by whom, and not before when.

    `role`: as which they were signed in at the panel, None for a name that nobody has checked.
    """

    id: str = Field(pattern=r"^[0-9a-f]{12}$", default_factory=lambda: secrets.token_hex(6))
    order: Order
    by: str = Field(min_length=1)
    role: Role | None = None
    added: AwareDatetime
    not_before: AwareDatetime | None = None
    started: Started | None = None
    ended: Ended | None = None


class Hold(_Part):
    """Why nothing is started by itself.

    `new`: nobody has let the queue go yet. `operator`: `by` holds it. `ended_badly`: the last item did not do
    what it was for. `left_alone`: no panel has attended to the queue for a while, so nobody at the bench may
    expect it to move.
    """

    why: Literal["new", "operator", "ended_badly", "left_alone"]
    by: str = ""


class QueueState(_Part):
    """A queue as its file has it; `attended`: when somebody last looked whether something is due."""

    format: Literal[1] = 1
    bench: str
    held: Hold | None = Hold(why="new")
    attended: AwareDatetime | None = None
    current: Item | None = None
    waiting: tuple[Item, ...] = ()
    ended: tuple[Item, ...] = ()

    def item(self, item_id: str) -> Item | None:
        """Return the waiting item of that id."""
        return next((item for item in self.waiting if item.id == item_id), None)

    def but(self, **changes: Any) -> QueueState:
        """Return it with changes; of those that have ended the newest stay."""
        state = self.model_copy(update=changes)
        return state.model_copy(update={"ended": state.ended[:_KEPT]})


def read_model(path: Path, kind: type[Model], what: str) -> Model | None:
    """Return what a file of the queue's folder holds, None if it is not there; RecordError if it is not that."""
    try:
        return kind.model_validate_json(read_bounded(path, SETTINGS_BYTES))
    except FileNotFoundError:
        return None
    except (OSError, ValidationError) as error:
        found = f"{error.error_count()} mistakes" if isinstance(error, ValidationError) else str(error)
        raise RecordError(
            f"{what} cannot be read",
            where=str(path),
            found=found,
            expected="the file as the panel wrote it",
            remedy="move it aside: a new one is begun, and nothing that it lists is started",
        ) from error


def write_model(path: Path, model: BaseModel) -> None:
    """Write a file of the queue's folder, on the disk when this returns; RecordError if it cannot be."""
    try:
        replace_file(path, model.model_dump_json(indent=1))
    except OSError as error:
        raise RecordError("the queue cannot be written", where=str(path), found=str(error)) from error


@contextmanager
def alone(path: Path) -> Iterator[None]:
    """Be the one process that changes a file, for some milliseconds; the kernel ends it with the process."""
    lock = path.with_suffix(".lock")
    try:
        lock.parent.mkdir(parents=True, exist_ok=True)
        descriptor = os.open(lock, open_flags("O_RDWR", "O_CREAT"), 0o644)
    except OSError as error:
        raise RecordError("the queue cannot be written", where=str(lock), found=str(error)) from error
    try:
        take_lock(descriptor, wait=True)
        yield
    finally:
        os.close(descriptor)
