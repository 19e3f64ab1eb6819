"""What the documents tell a reader to type exists: commands, their options, benchmarks, make targets, files."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import typer.main

from bench.control.procedure import load_procedures
from bench.present.cli._app import app

ROOT = Path(__file__).parents[2]
PAGES = [
    ROOT / "README.md",
    ROOT / "CONTRIBUTING.md",
    *sorted((ROOT / "docs").rglob("*.md")),
    *sorted((ROOT / "benchmarks").glob("*.md")),
]
COMMAND = typer.main.get_command(app)
PROCEDURES = load_procedures()
CODE = re.compile(r"`([^`\n]+)`|^ {4,}(\S.*)$", re.MULTILINE)


def typed(page: Path, program: str) -> list[str]:
    """Return the command lines of a page's code that begin with a program's name, comments taken off."""
    text = re.sub(r"\\\n\s*", "", page.read_text())
    text = re.sub(
        r"^```.*?$(.*?)^```$", lambda block: block[1].replace("\n", "\n    "), text, flags=re.M | re.S
    )
    code = (inline or block for inline, block in CODE.findall(text))
    found = (re.match(rf"(?:\S+/)?{program} (.*)", line) for line in code)
    return [re.split(r"\s#| {2,}", match[1])[0].replace("\\|", "|") for match in found if match]


def command_of(words: list[str]) -> tuple[list[str], set[str]]:
    """Return the command at the head of `words` and the options it knows; LookupError where there is none."""
    command: Any = COMMAND
    path: list[str] = []
    for word in words:
        if not hasattr(command, "get_command"):
            break
        if word.startswith("-"):
            return path, {"--help"}
        command = command.get_command(None, word)
        if command is None:
            raise LookupError(f"no command {' '.join(['gyrobench', *path, word])}")
        path.append(word)
    known = {name for parameter in command.params for name in (*parameter.opts, *parameter.secondary_opts)}
    procedure = words[len(path)] if len(words) > len(path) else ""
    if path in (["run"], ["rehearse"], ["foretell"]) and procedure in PROCEDURES:
        fields = PROCEDURES[procedure].parameters.model_fields
        known |= {"--" + name.replace("_", "-") for name in fields}
    return path, known | {"--help"}


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_every_command_and_option_exists(page: Path) -> None:
    for line in typed(page, "gyrobench"):
        first, *others = [part.split() for part in line.replace("[", " ").replace("]", " ").split("|")]
        if not re.fullmatch(r"-*[a-z-]+", first[0]):
            continue  # prose: "gyrobench 1.0"
        path, known = command_of(first)
        for (
            other
        ) in others:  # "campaign plan | run": of the same group; "frames check FILE | can check": by itself
            if other[0].islower():
                same = [*path[:-1], other[0]]
                known |= command_of(same if len(other) == 1 or other[1].isupper() else other)[1]
        for word in [*first, *(word for other in others for word in other)]:
            if word.startswith("--"):
                assert word.split("=")[0] in known, f"{page.name}: gyrobench {line}: no option {word}"


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_every_benchmark_and_target_exists(page: Path) -> None:
    for line in typed(page, "python -m"):
        module, *words = line.split()
        if module == "benchmarks":
            for name in (word for word in words if word[0].islower()):
                script = ROOT / "benchmarks" / f"{name}.py"
                script = script if script.exists() else ROOT / "benchmarks" / name / "__init__.py"
                assert script.exists() and "def rows(" in script.read_text(), f"{page.name}: python -m {line}"
        elif module.startswith("benchmarks."):
            path = ROOT / module.replace(".", "/")
            assert path.with_suffix(".py").exists() or (path / "__main__.py").exists(), (
                f"{page.name}: python -m {line}"
            )
    targets = set(re.findall(r"^([a-z-]+):", (ROOT / "Makefile").read_text(), re.MULTILINE))
    for line in typed(page, "make"):
        assert line.split()[0] in targets, f"{page.name}: no target: make {line}"


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_every_file_named_exists(page: Path) -> None:
    named = re.findall(
        r"`((?:docs|examples|benchmarks|tests|bench|drivers|simulators)/[\w./-]+)`", page.read_text()
    )
    for name in named:
        assert (ROOT / name).exists(), f"{page.name}: no {name}"


def remedies() -> Iterator[tuple[str, str]]:
    """Yield (place, text) of every remedy in the sources; what is filled in stands as X."""
    for room in ("bench", "drivers", "gyrobench", "procedures", "simulators"):
        for path in sorted((ROOT / room).rglob("*.py")):
            for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
                if isinstance(node, ast.keyword) and node.arg == "remedy":
                    for text in (
                        n for n in ast.walk(node.value) if isinstance(n, ast.JoinedStr | ast.Constant)
                    ):
                        parts = text.values if isinstance(text, ast.JoinedStr) else [text]
                        said = "".join(str(p.value) if isinstance(p, ast.Constant) else "X" for p in parts)
                        yield f"{path.relative_to(ROOT)}:{node.value.lineno}", said


def options_of(command: Any) -> set[str]:
    """Return the options of a command, or of all commands of a group."""
    if hasattr(command, "list_commands"):
        return set().union(*(options_of(command.get_command(None, n)) for n in command.list_commands(None)))
    return {name for parameter in command.params for name in parameter.opts}


def test_every_remedy_names_commands_and_options_that_there_are() -> None:
    every = options_of(COMMAND) | {"--bench-yes"}
    for place, text in remedies():
        for line in re.findall(r"`gyrobench ([^`]+)`", text):
            path, known = command_of(line.split())
            command: Any = COMMAND
            for word in path:
                command = command.get_command(None, word)
            assert not hasattr(command, "list_commands") or path in (["fit"], ["new"]), (
                f"{place}: {line}: a group"
            )
            for word in line.split():
                assert not word.startswith("--") or word in known, f"{place}: {line}: no option {word}"
        for option in re.findall(r"(?<![\w-])--[a-z][a-z-]+", text):
            assert option in every, f"{place}: no command has {option}"


def test_the_readme_is_a_page() -> None:
    assert len((ROOT / "README.md").read_text().split()) <= 700


def test_the_version_is_the_same_everywhere() -> None:
    version = re.search(r'^version = "(.+)"', (ROOT / "pyproject.toml").read_text(), re.MULTILINE)
    assert version is not None
    assert f"\nversion: {version[1]}\n" in (ROOT / "CITATION.cff").read_text()
    assert f"\n## {version[1]}\n" in (ROOT / "CHANGELOG.md").read_text()
