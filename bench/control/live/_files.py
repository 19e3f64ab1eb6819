"""The live files themselves: written whole or not at all, read with suspicion."""

from __future__ import annotations

import itertools
import json
import os
import secrets
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Literal, get_args

from bench.control.live._shape import checked_now
from bench.control.process import process_start
from bench.record.events.run import Note, Requested, Role
from drivers.base.clock import epoch_seconds, utc_now
from drivers.base.errors import ConfigurationError, RecordError
from drivers.base.files import SETTINGS_BYTES, encodable, parse_json, read_bounded, replace_file
from drivers.base.system import open_flags
from drivers.base.windows import HOLDS_PROCESSES, process_runs

ACKNOWLEDGED_FILE = "acknowledged.jsonl"
LIVE_FOLDER = "live"
NOW_FILE = "now.json"
HISTORY_FILE = "history.jsonl"
Action = Literal["pause", "resume", "abort"]
_LONGEST = 4096
"""Bytes of an answer or a request; a longer file is not one."""
_LONGEST_NAME, _LONGEST_KEY = 200, 400
_BLOCK_BYTES = 4 << 20
"""Read at once; the caller comes again for the rest."""
_order = itertools.count()


@dataclass(frozen=True)
class Answer:
    """What somebody answered; `role`: as which they were signed in, None for a name that was typed."""

    answer: str
    by: str
    utc: str
    role: Role | None = None


def read_now(session: Path) -> dict[str, Any] | None:
    """Return now.json of a session folder with `alive` (whether its process still runs), None if there is none.

    What is in it has the types of docs/events.md. Raises RecordError for a file that is not one.
    """
    path = session / LIVE_FOLDER / NOW_FILE
    try:
        found = checked_now(parse_json(read_bounded(path, SETTINGS_BYTES)))
    except FileNotFoundError:
        return None
    except (OSError, ValueError) as error:
        raise RecordError("the live state cannot be read", where=str(path), found=str(error)) from error
    return found | {
        "alive": found.get("state") != "ended" and _runs(found.get("pid"), found.get("process_start"))
    }


def read_lines(path: Path, offset: int = 0) -> tuple[list[dict[str, Any]], int]:
    """Return the whole lines of a growing file from byte `offset` on, and the offset to read on from.

    A line that is no JSON object is left out; a file that cannot be read has none.
    """
    try:
        with path.open("rb") as file:
            file.seek(offset)
            block = file.read(_BLOCK_BYTES)
    except OSError:
        return [], offset
    whole, newline, _ = block.rpartition(b"\n")
    if not newline and len(block) == _BLOCK_BYTES:
        return [], offset + len(block)  # no line of ours is so long
    rows = []
    for line in whole.split(b"\n") if whole else []:
        with suppress(ValueError):
            row = parse_json(line)
            if isinstance(row, dict):
                rows.append(row)
    return rows, offset + len(whole) + len(newline)


def drop_answer(session: Path, prompt_id: int, answer: str, by: str, role: Role | None = None) -> Answer:
    """Answer a question; the first answer stays. Returns the one that counts, which may be somebody else's.

    Raises ConfigurationError for an answer that is empty or too long.
    """
    given = Answer(encodable(answer).strip(), encodable(by).strip() or "unknown", utc_now(), role)
    text = json.dumps(asdict(given), ensure_ascii=False)
    if not given.answer or len(text.encode()) > _LONGEST:
        raise ConfigurationError(
            "an answer that cannot be kept", found=f"{len(answer)} characters", expected="1 to some hundred"
        )
    path = _answer_path(session, prompt_id)
    part = path.with_name(f".{secrets.token_hex(8)}.part")
    try:
        part.write_text(text, encoding="utf-8")
        os.link(part, path)
    except FileExistsError:
        return read_answer(session, prompt_id) or given
    except OSError as error:
        raise _unwritable(path, error) from error
    finally:
        part.unlink(missing_ok=True)
    return given


def read_answer(session: Path, prompt_id: int) -> Answer | None:
    """Return the answer to a question, None if there is none yet; RecordError if the file is not one."""
    path = _answer_path(session, prompt_id)
    found = _read_small(path)
    if found is None:
        return None
    try:
        words = {name: encodable(str(found[name])) for name in ("answer", "by", "utc")}
        return Answer(**words, role=_role(found))
    except KeyError as error:
        raise RecordError("this is not an answer", where=str(path), found=f"no {error}") from error


def drop_request(session: Path, action: Action, by: str, role: Role | None = None) -> Requested:
    """Ask a session for pause, resume or abort."""
    if action not in get_args(Action):
        raise ConfigurationError("an unknown request", found=action, expected=", ".join(get_args(Action)))
    request = Requested(action, encodable(by).strip()[:_LONGEST_NAME] or "unknown", utc_now(), role)
    # the name sorts by time, then by the order in this process, so that requests are taken in order
    name = f"{epoch_seconds() * 1e3:.0f}-{next(_order):06d}-{secrets.token_hex(4)}.json"
    path = session / LIVE_FOLDER / "requests" / name
    try:
        replace_file(path, json.dumps(request.fields(), ensure_ascii=False), sync=False)
    except OSError as error:
        raise _unwritable(path.parent, error) from error
    return request


def acknowledge(session: Path, keys: Sequence[str], by: str) -> None:
    """Write down who has seen alarms: their keys are the readers' own. ConfigurationError without a name."""
    if not by.strip():
        raise ConfigurationError(
            "nobody acknowledges", found="no name", expected="the name of whoever has seen the alarm"
        )
    path = session / LIVE_FOLDER / ACKNOWLEDGED_FILE
    line = {"keys": [key[:_LONGEST_KEY] for key in keys], "by": by.strip()[:_LONGEST_NAME], "utc": utc_now()}
    try:
        descriptor = os.open(path, open_flags("O_WRONLY", "O_APPEND", "O_CREAT"), 0o644)
        try:
            os.write(descriptor, json.dumps(line).encode() + b"\n")
        finally:
            os.close(descriptor)
    except OSError as error:
        raise _unwritable(path, error) from error


def read_acknowledged(session: Path) -> dict[str, tuple[str, str]]:
    """Return who has acknowledged which alarm of a session, and when (UTC), by its key."""
    found: dict[str, tuple[str, str]] = {}
    for row in read_lines(session / LIVE_FOLDER / ACKNOWLEDGED_FILE)[0]:
        keys = row.get("keys")
        for key in keys if isinstance(keys, list) else ():
            found.setdefault(str(key), (str(row.get("by", ""))[:_LONGEST_NAME], str(row.get("utc", ""))[:40]))
    return found


def take_requests(session: Path) -> Iterator[Requested | Note]:
    """Yield the requests there are, oldest first, deleting each; a note says what is wrong with a file."""
    folder = session / LIVE_FOLDER / "requests"
    with suppress(OSError):
        for name in sorted(entry.name for entry in os.scandir(folder) if entry.name.endswith(".json")):
            path = folder / name
            try:
                found = _read_small(path) or {}
                action, by, utc = (encodable(str(found.get(key, ""))) for key in ("action", "by", "utc"))
                if action not in get_args(Action):
                    raise RecordError("this is not a request", where=str(path), found=repr(action[:40]))
                yield Requested(action, by[:_LONGEST_NAME] or "unknown", utc[:40], _role(found))
            except RecordError as error:
                yield Note(str(error))
            finally:
                path.unlink(missing_ok=True)


def clear(session: Path) -> None:
    """Remove answers and requests that an earlier session left: they were for other questions."""
    for name in ("answers", "requests"):
        folder = session / LIVE_FOLDER / name
        folder.mkdir(parents=True, exist_ok=True)
        for path in folder.iterdir():
            path.unlink(missing_ok=True)


def _answer_path(session: Path, prompt_id: int) -> Path:
    return session / LIVE_FOLDER / "answers" / f"{int(prompt_id)}.json"


def _read_small(path: Path) -> dict[str, Any] | None:
    try:
        descriptor = os.open(path, open_flags("O_RDONLY", "O_NOFOLLOW", "O_NONBLOCK"))
    except FileNotFoundError:
        return None
    except OSError as error:
        raise RecordError("a live file cannot be read", where=str(path), found=str(error)) from error
    try:
        content = os.read(descriptor, _LONGEST + 1)
        found = parse_json(content) if len(content) <= _LONGEST else None
    except (OSError, ValueError) as error:
        raise RecordError("a live file cannot be read", where=str(path), found=str(error)) from error
    finally:
        os.close(descriptor)
    if not isinstance(found, dict):
        raise RecordError("a live file cannot be read", where=str(path), found="no short JSON object")
    return found


def _role(found: Mapping[str, Any]) -> Role | None:
    return next((role for role in get_args(Role) if role == found.get("role")), None)


def _runs(pid: object, started: object) -> bool:
    """Return whether a process still runs; one of its number that began at another time is another."""
    if not isinstance(pid, int) or pid <= 0:
        return False
    if isinstance(started, int) and started > 0 and process_start(pid) != started:
        return False
    if HOLDS_PROCESSES:  # there, 0 is the number of Ctrl-C
        return process_runs(pid)
    try:
        os.kill(pid, 0)
    except (ProcessLookupError, OverflowError):
        return False
    except PermissionError:
        return True
    return True


def _unwritable(path: Path, error: OSError) -> RecordError:
    return RecordError(
        "the session cannot be reached",
        where=str(path),
        found=error.strerror or str(error),
        expected="the folder of a session that goes on, which you may write to",
        remedy="`gyrobench campaign status` says whether it does",
    )
