"""`--json` on every command, with the fields that docs/json.md says."""

from __future__ import annotations

import json
import re
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import typer.main

from bench.present.cli._app import app

ROOT = Path(__file__).parents[3]
PAGE = (ROOT / "docs" / "json.md").read_text(encoding="utf-8")
LINES = {
    name: fields.split(", ")
    for name, fields in re.findall(r"^\| `(.+?)` \| \w+ \| (.+) \|$", PAGE, re.MULTILINE)
}
"""Command -> the fields of its last line."""
TYPES = dict(
    re.findall(
        r"^\| (\w+) \| ([a-z ]+) \|",
        "| outcome" + PAGE.partition("|---|---|---|\n| outcome")[2],
        re.MULTILINE,
    )
)
"""Field -> its type in words."""
VALUES = re.findall(r"^\| `(.+?)` \| [^|]+ \|$", PAGE, re.MULTILINE)
SERVERS = {"panel"}


def leaves(command: Any, path: tuple[str, ...] = ()) -> Iterator[tuple[str, set[str]]]:
    """Yield every command's name and options."""
    if not hasattr(command, "list_commands"):
        yield " ".join(path), {name for parameter in command.params for name in parameter.opts}
        return
    for name in command.list_commands(None):
        yield from leaves(command.get_command(None, name), (*path, name))


def test_every_command_has_it_and_is_documented() -> None:
    every = dict(leaves(typer.main.get_command(app)))
    assert {name for name, options in every.items() if "--json" not in options} == SERVERS
    told = {re.sub(r" (NAME|--identify|--fmu|--by-hand|--batch)$", "", name) for name in (*LINES, *VALUES)}
    own = {name if not name.startswith("new ") else "new" for name in every if name not in SERVERS}
    assert own == told


def printed(folder: Path, *words: object) -> dict[str, Any]:
    """Run a command with --json in `folder`; return its last line."""
    command = [sys.executable, "-m", "gyrobench", *map(str, words), "--json"]
    ended = subprocess.run(command, cwd=folder, capture_output=True, text=True)
    assert ended.returncode in (0, 4), ended.stderr
    facts: dict[str, Any] = json.loads(ended.stdout.splitlines()[-1])
    return facts


def of_type(words: str, value: Any) -> bool:
    """Whether a value is what the page says of its field."""
    if words.endswith(" or null"):
        return value is None or of_type(words.removesuffix(" or null"), value)
    if words.startswith("list of "):
        one = {"text": "text", "objects": "object"}[words.removeprefix("list of ")]
        return isinstance(value, list) and all(of_type(one, entry) for entry in value)
    kinds = {"text": str, "object": dict, "true or false": bool, "whole number": int, "number": int | float}
    return isinstance(value, kinds[words]) and (not isinstance(value, bool) or words == "true or false")


def test_every_field_has_a_type_and_none_is_left_over() -> None:
    told = {field for name, listed in LINES.items() if name != "look" for field in listed}
    assert told == TYPES.keys()
    assert not of_type("list of text", [1]) and of_type("text or null", None) and not of_type("number", True)


def fields(name: str, facts: dict[str, Any]) -> None:
    assert set(facts) - {"kind"} == set(LINES[name]), name
    for field, value in facts.items():
        words = "text" if field == "kind" else TYPES[field]
        assert of_type(words, value) or (name, field) == ("fit stepwise", "units"), (
            name,
            field,
            words,
            value,
        )


@pytest.mark.slow
def test_a_run_and_all_that_is_made_of_it(tmp_path: Path) -> None:
    shutil.copy(ROOT / "examples" / "demo.toml", tmp_path / "lab.toml")
    made = printed(tmp_path, "new", "procedure", "mine")
    fields("new", made)
    assert made["files"] == ["mine.py"] and "gyrobench rehearse ./mine.py" in made["next"]
    ran = printed(tmp_path, "rehearse", "./mine.py")
    fields("rehearse", ran)
    assert ran["outcome"] == "completed" and ran["measurements"][0]["name"] == "scale_factor_error"
    run = ran["folder"]
    for name, words in (
        ("report", ("report", run)),
        ("runs index", ("runs", "index")),
        ("runs export", ("runs", "export", run, "--format", "csv")),
        ("runs show", ("runs", "show", run)),
        ("runs recover", ("runs", "recover", "--all")),
        ("runs verify", ("runs", "verify", run)),
    ):
        fields(name, printed(tmp_path, *words))
    (verified,) = printed(tmp_path, "runs", "verify", run)["verified"]
    assert verified["passed"] is True and verified["report"]["problems"] == []
    (tmp_path / run / "turntable.parquet").write_bytes(b"")
    command = [sys.executable, "-m", "gyrobench", "runs", "verify", run, "--json"]
    ended = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True)
    (verified,) = json.loads(ended.stdout)["verified"]
    assert ended.returncode == 1 and verified["report"]["problems"][0]["path"] == "turntable.parquet"


@pytest.mark.slow
def test_what_there_is_to_name(tmp_path: Path) -> None:
    shutil.copy(ROOT / "examples" / "demo.toml", tmp_path / "lab.toml")
    procedures = printed(tmp_path, "procedures")
    fields("procedures", procedures)
    assert {"name", "title", "source", "expected_s"} == set(procedures["procedures"][0])
    one = printed(tmp_path, "procedures", "known-state")
    fields("procedures NAME", one)
    assert one["parameters"][0]["parameter"] == "air_c"
    for name, words in (
        ("ports", ("ports",)),
        ("frames list", ("frames", "list")),
        ("foretell", ("foretell", "standard-test", "--noise", "angle_random_walk=0.2", "--grade", "mems")),
        ("frames check", ("frames", "check", "stim300")),
        ("can list", ("can", "list")),
        ("can check", ("can", "check", "sbg_ellipse")),
    ):
        facts = printed(tmp_path, *words)
        fields(name, facts)
        assert name == "ports" or all(facts[key] for key in facts if key != "capture"), facts


@pytest.mark.slow
def test_a_search(tmp_path: Path) -> None:
    found = printed(tmp_path, "scheme", "search", 4, "--out", "mine.toml")
    fields("scheme search", found)
    assert len(found["schemes"]) == 4 and found["file"] == "mine.toml"
