"""`gyrobench key`: the key that a bench signs with, and signatures of any file."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

from typer import Argument, Option, Typer

from bench.present.cli import _options as options

app = Typer(name="key")


@app.command()
def make(
    name: Annotated[str, Argument(help="whose key it is: bench and laboratory")],
    as_json: options.Json = False,
) -> None:
    """Make the key of this bench.

    Every run that is sealed from then on is signed, and every certificate. The file of the public key is for
    those who check.
    """
    from bench.present.cli._console import Terminal
    from bench.record.signing import SigningKey, key_file, public_key_file

    console, path = Terminal(as_json=as_json), key_file()
    key = SigningKey.new(name)
    key.save(path)
    console.say(f"{path}: the key; who can read it can sign", soft_wrap=True)
    console.say(
        f"{public_key_file(path)}: the public key, for those who check: {key.public.line}", soft_wrap=True
    )
    console.say_json(
        "result", name=key.public.name, file=path, public_file=public_key_file(path), key=key.public.line
    )


@app.command()
def show(as_json: options.Json = False) -> None:
    """Show the public key of this bench."""
    from bench.present.cli._console import Terminal
    from bench.record.signing import bench_key, key_file

    console, key = Terminal(as_json=as_json), bench_key()
    if key is None:
        console.say(f"no key: nothing is signed. `gyrobench key make` makes {key_file()}", soft_wrap=True)
    else:
        console.say(f"{key.public.name}: {key.public.line}", soft_wrap=True)
    line, name = (key.public.line, key.public.name) if key is not None else (None, None)
    console.say_json("result", name=name, file=key_file(), key=line)


@app.command()
def sign(file: Annotated[list[Path], Argument(help="files")], as_json: options.Json = False) -> None:
    """Sign files with the key of this bench: FILE.minisig lies beside FILE."""
    from bench.present.cli._console import Terminal
    from bench.record.signing import bench_key, key_file, sign_file
    from drivers.base.errors import ConfigurationError

    console, key = Terminal(as_json=as_json), bench_key()
    if key is None:
        raise ConfigurationError(
            "this bench has no key", where=str(key_file()), remedy="make one with `gyrobench key make`"
        )
    made = [sign_file(path, key) for path in file]
    console.say_all(made, soft_wrap=True)
    console.say_json("result", files=made, key=key.public.line)


@app.command()
def check(
    file: Annotated[list[Path], Argument(help="files with their signatures beside them")],
    signed_by: Annotated[
        list[Path] | None,
        Option("--signed-by", metavar="FILE", help="a public key; without one the key of this bench"),
    ] = None,
    as_json: options.Json = False,
) -> None:
    """Check signatures of files. Exit code 1 if one is missing or of another key or other bytes."""
    from bench.present.cli._console import Terminal
    from bench.record.signing import NotSigned, check_file, known_keys

    console, found, keys = Terminal(as_json=as_json), [], known_keys(signed_by)
    for path in file:
        try:
            key, comment = check_file(path, keys)
        except NotSigned as error:
            console.parts(("not signed", "red"), f"  {path}: {error}")
            found.append({"file": path, "signed_by": None, "signed": str(error)})
        else:
            console.parts(("signed", "green"), f"  {path}: by {key.name} ({comment.replace(chr(9), ', ')})")
            found.append({"file": path, "signed_by": key.name, "signed": comment})
    console.say_json("result", checked=found)
    sys.exit(0 if all(row["signed_by"] is not None for row in found) else 1)
