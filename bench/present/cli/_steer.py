"""`gyrobench steer`: answer, pause, resume or abort a session from another shell."""

from __future__ import annotations

import getpass
from pathlib import Path
from typing import cast, get_args

from bench.control.live import Action, drop_answer, drop_request, read_now
from bench.present.cli._console import Terminal
from drivers.base.errors import ConfigurationError


def steer_command(session: Path, action: str, answer: str, by: str) -> int:
    """Drop an answer or a request; exit code 1 if somebody else had answered first."""
    console = Terminal()
    by = by or f"{getpass.getuser()} at another shell"
    now = read_now(session)
    if now is None or not now["alive"]:
        raise ConfigurationError(
            "no session goes on here",
            where=str(session),
            found="no live state" if now is None else "a session that has ended",
            expected="the campaign folder, or the run folder of a single run, of a process that works",
        )
    if action in get_args(Action):
        drop_request(session, cast(Action, action), by)
        console.print(f"{action} asked for", highlight=False)
        return 0
    if action != "answer":
        raise ConfigurationError(
            "an unknown action", found=action, expected="answer, " + ", ".join(get_args(Action))
        )
    if not now["prompts"]:
        raise ConfigurationError("no question is open", where=str(session))
    prompt = now["prompts"][0]
    counts = drop_answer(session, int(prompt["id"]), answer, by)
    console.print(f"{prompt['question']}\n{counts.answer} ({counts.by})", highlight=False)
    return 0 if counts.by == by else 1
