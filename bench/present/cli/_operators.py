"""`gyrobench operators`: who may sign in at the panel, and as what."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

from typer import Argument, Option, Typer, prompt

from bench.present.cli import _options as options

app = Typer(name="operators")
_File = Annotated[Path, Option("--file", help="the operators' file, which `gyrobench panel` is given")]
_Name = Annotated[str, Argument(help="the operator's name, as it stands in the record")]
_Typed = Annotated[bool, Option("--stdin", help="read the password as one line from standard input")]
DEFAULT_FILE = Path("operators.json")


@app.command()
def add(
    name: _Name,
    role: Annotated[
        str, Option(help="look, answer, run or configure; each may do what those before it may")
    ] = ("run"),
    file: _File = DEFAULT_FILE,
    stdin: _Typed = False,
    as_json: options.Json = False,
) -> None:
    """Let somebody sign in at the panel.

    It asks for a password twice. The first operator makes the file.
    """
    from bench.control.operators import OperatorsFile, checked_name, checked_role
    from bench.present.cli._console import Terminal

    console = Terminal(as_json=as_json)
    name, known = checked_name(name), checked_role(role)
    added = OperatorsFile(file).add(name, known, _password(name, stdin))
    console.say(f"{added.name} may sign in ({added.role}): gyrobench panel --operators {file}")
    console.say_json("result", name=added.name, role=added.role, file=file)


@app.command("list")
def list_(file: _File = DEFAULT_FILE, as_json: options.Json = False) -> None:
    """Show who may sign in."""
    from bench.control.operators import OperatorsFile
    from bench.present.cli._console import Terminal

    console = Terminal(as_json=as_json)
    operators = OperatorsFile(file).all()
    rows = [{"name": one.name, "role": one.role, "since": one.since} for one in operators]
    console.say_json("result", operators=rows, file=file)
    console.table(("name", "role", "since"), [(one.name, one.role, one.since[:10]) for one in operators])


@app.command()
def change(
    name: _Name,
    role: Annotated[str, Option(help="the new role; without it the password is changed")] = "",
    file: _File = DEFAULT_FILE,
    stdin: _Typed = False,
    as_json: options.Json = False,
) -> None:
    """Give an operator another role or another password.

    Another password signs them out.
    """
    from bench.control.operators import OperatorsFile
    from bench.present.cli._console import Terminal

    console, operators = Terminal(as_json=as_json), OperatorsFile(file)
    changed = operators.set_role(name, role) if role else operators.set_password(name, _password(name, stdin))
    what = "role" if role else "password"
    console.say(f"{changed.name} has another {what} ({changed.role})")
    console.say_json("result", name=changed.name, role=changed.role, changed=what, file=file)


@app.command()
def remove(name: _Name, file: _File = DEFAULT_FILE, as_json: options.Json = False) -> None:
    """Let somebody sign in no more.

    They are signed out at once. What they did stays in the records.
    """
    from bench.control.operators import OperatorsFile
    from bench.present.cli._console import Terminal

    console = Terminal(as_json=as_json)
    OperatorsFile(file).remove(name)
    console.say(f"{name} cannot sign in any more")
    console.say_json("result", name=name, file=file)


def _password(name: str, stdin: bool) -> str:
    """Return the password that somebody types, twice on a terminal."""
    if stdin:
        return sys.stdin.readline().rstrip("\n")
    typed: str = prompt(f"password for {name}", hide_input=True, confirmation_prompt="once more")
    return typed
