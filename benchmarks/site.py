"""The documentation site: the pages of docs/, sorted, and those made from the code. It needs no network.

    python -m benchmarks.site OUT        HTML below OUT; a warning (a dead link, a page in no list) is an error

`commands.md` comes from the command line, `bench_file.md` from the models that check a bench file, `api.md` is
docs/api.md with the docstrings of what it lists, and `index.md` and the pages about the project are the files at
the top of the repository.
"""

from __future__ import annotations

import inspect
import os
import re
import shutil
import sys
import tempfile
from collections.abc import Iterable, Iterator
from importlib.metadata import version
from io import StringIO
from pathlib import Path
from typing import Any, get_args

import typer.main

import gyrobench
from bench.present.cli._app import app
from bench.record.benchfile import BenchFile
from drivers.base.plugins import entry_points_of
from drivers.kit.registry import config_class, roles

ROOT = Path(__file__).parents[1]
TOP = {
    "README.md": "index.md",
    "CONTRIBUTING.md": "contributing.md",
    "CHANGELOG.md": "changelog.md",
    "SECURITY.md": "security.md",
}
"""File at the top of the repository -> its page."""
SECTIONS = {
    "Tutorials": (
        *("tutorials/first_rehearsal", "tutorials/bench_file", "tutorials/own_gyro", "own_procedure"),
        *("tutorials/campaign_overnight", "tutorials/gap", "tutorials/own_log", "guide"),
    ),
    "How to": (
        *(
            "look",
            "exchange",
            "campaign",
            "panel",
            "metrics",
            "pytest",
            "reports",
            "faults",
            "frames",
            "can",
            "scale",
        ),
        *("add_a_driver", "add_an_effect", "add_a_command_or_report"),
    ),
    "Reference": ("commands", "json", "bench_file", "api", "instruments", "events", "glossary"),
    "Explanation": (
        *(
            "safety",
            "gap",
            "gap_exam",
            "standard_test",
            "uncertainty",
            "calibration",
            "rlg",
            "whirl",
            "heading",
        ),
        *("real_data", "measured", "architecture", "decisions/README", "beside_others"),
    ),
    "Project": ("contributing", "changelog", "security"),
}
"""The pages in the order in which they are listed; what stands nowhere here is listed last, as "More"."""
SETTINGS = {
    "project": "gyrobench",
    "copyright": "the gyrobench authors, Apache License 2.0",
    "extensions": ["myst_parser", "sphinx.ext.autodoc"],
    "html_theme": "furo",
    "html_title": f"gyrobench {version('gyrobench')}",
    "html_show_sphinx": False,
    "myst_heading_anchors": 4,
    "default_role": "code",
    "smartquotes": False,
    "add_module_names": False,
    "autodoc_typehints": "signature",
    "autodoc_member_order": "bysource",
    "python_use_unqualified_type_names": True,
    "suppress_warnings": ["myst.header", "misc.highlighting_failure"],
}


def build(out: Path) -> str:
    """Write the site below `out`; return the warnings, "" if it is as it should be."""
    with tempfile.TemporaryDirectory() as folder:
        source = Path(folder) / "docs"
        write_source(source)
        return html(source, out)


def html(source: Path, out: Path) -> str:
    """Write the pages of `source` as HTML below `out`; return the warnings."""
    from sphinx.application import Sphinx

    said = StringIO()
    with tempfile.TemporaryDirectory() as trees:
        Sphinx(source, None, out, trees, "html", SETTINGS, status=None, warning=said).build()
    return said.getvalue()


def write_source(place: Path) -> None:
    """Write all pages to `place`, as Sphinx reads them."""
    shutil.copytree(ROOT / "docs", place)
    for page in place.rglob("*.md"):
        page.write_text(_linked(page.read_text(encoding="utf-8"), place, page.parent), encoding="utf-8")
    for name, target in TOP.items():
        text = _linked(top_page(ROOT / name), place, place)
        (place / target).write_text(text, encoding="utf-8")
    (place / "commands.md").write_text(commands_page(), encoding="utf-8")
    (place / "bench_file.md").write_text(bench_file_page(), encoding="utf-8")
    api = place / "api.md"
    api.write_text(with_docstrings(api.read_text(encoding="utf-8")), encoding="utf-8")
    decisions = place / "decisions" / "README.md"
    with decisions.open("a", encoding="utf-8") as file:
        file.write("\n" + _toctree("", sorted(page.stem for page in decisions.parent.glob("0*.md"))))
    listed = {page for pages in SECTIONS.values() for page in pages} | {"index"}
    found = {str(page.relative_to(place).with_suffix("")) for page in place.rglob("*.md")}
    more = sorted(page for page in found - listed if not page.startswith("decisions/"))
    with (place / "index.md").open("a", encoding="utf-8") as file:
        for caption, pages in (*SECTIONS.items(), *([("More", more)] if more else [])):
            file.write(_toctree(caption, pages))


def _linked(text: str, place: Path, folder: Path) -> str:
    """Return a page in which `docs/x.md` in code is a link to that page, by its title."""

    def link(code: re.Match[str]) -> str:
        page = place / code[1]
        if not page.exists():
            return code[0]
        title = page.read_text(encoding="utf-8").partition("\n")[0].lstrip("# ")
        return f"[{title}]({os.path.relpath(page, folder)})"

    return re.sub(r"`docs/([\w/]+\.md)`", link, text)


def _toctree(caption: str, pages: Iterable[str]) -> str:
    options = f":caption: {caption}\n" if caption else ""
    return "\n```{toctree}\n:hidden:\n" + options + "".join(f"{page}\n" for page in pages) + "```\n"


def with_docstrings(page: str) -> str:
    """Return the page on the Python interface with signature and docstring of every name in a list of its."""

    def described(item: re.Match[str]) -> str:
        name = item[1]
        public = getattr(gyrobench, name)
        kind = "autofunction" if inspect.isfunction(public) else "autoclass"
        members = "\n   :members:" if kind == "autoclass" else ""
        return f"```{{eval-rst}}\n.. {kind}:: {public.__module__}.{public.__qualname__}{members}\n```\n"

    return re.sub(r"^\* `(\w+)`.*\n(?:  .*\n)*", described, page, flags=re.MULTILINE)


def top_page(file: Path) -> str:
    """Return a file from the top of the repository with its links as they are from within docs/."""
    text = file.read_text(encoding="utf-8").replace("](docs/", "](").replace("](CITATION.cff)", "]")
    text = text.replace("[CITATION.cff]", "`CITATION.cff`")
    for name, page in TOP.items():
        text = text.replace(f"]({name})", f"]({page})")
    return text


def commands_page() -> str:
    """Return the reference of all commands."""
    intro = "# Commands\n\nMade from the command line itself. `gyrobench COMMAND --help` says the same.\n"
    return intro + "".join(_command(["gyrobench"], typer.main.get_command(app)))


def _command(path: list[str], command: Any) -> Iterator[str]:
    if len(path) > 1:
        yield f"\n{'#' * min(len(path), 4)} {' '.join(path)}\n\n{_plain(command.help)}\n"
    if hasattr(command, "list_commands"):
        for name in command.list_commands(None):
            yield from _command([*path, name], command.get_command(None, name))
        return
    arguments = [part for part in command.params if part.param_type_name == "argument"]
    options = [part for part in command.params if part.param_type_name == "option" and not part.hidden]
    words = [_usage(part) for part in arguments]
    yield f"\n```text\n{' '.join([*path, *words, *(['[OPTIONS]'] if options else [])])}\n```\n"
    rows = [(_usage(part), _plain(getattr(part, "help", "")), _default(part)) for part in arguments]
    rows += [(_option(part), _plain(part.help), _default(part)) for part in options]
    if rows:
        yield "\n| | | default |\n|---|---|---|\n"
        yield "".join(f"| `{name}` | {text} | {default} |\n" for name, text, default in rows)


def _usage(argument: Any) -> str:
    name = (argument.metavar or argument.name).upper()
    name = f"{name}..." if argument.nargs == -1 and not name.endswith("...") else str(name)
    return name if argument.required else f"[{name}]"


def _option(option: Any) -> str:
    names = ", ".join([*option.opts, *option.secondary_opts])
    return names if option.is_flag else f"{names} {option.metavar or _kind(option)}"


def _kind(option: Any) -> str:
    annotation = option.type_descriptor.annotation
    kinds = {float: "NUMBER", int: "NUMBER", Path: "PATH"}
    return " ".join(kinds.get(inner, "TEXT") for inner in get_args(annotation) or (annotation,))


def _default(part: Any) -> str:
    if part.required:
        return "required"
    value = part.default() if callable(part.default) else part.default
    return "" if value in (None, False, "", (), []) else f"`{value}`"


def bench_file_page() -> str:
    """Return the reference of the keys of a bench file."""
    schema = BenchFile.model_json_schema(mode="validation")
    parts = [
        "# Keys of a bench file\n\nMade from the models that check the file. `gyrobench new bench` writes one, "
        "and `examples/lab.toml` is another. A key that is not listed here is refused.\n"
    ]
    for name in ("bench", "limits", "safe", "recording"):
        parts += _section(f"[{name}]", _resolved(schema["properties"][name], schema), schema)
    calibration = _resolved(schema["properties"]["calibration"]["items"], schema)
    parts += _section("[[calibration]]", calibration, schema)
    for role, model in sorted(roles().items(), key=lambda pair: _ORDER.index(pair[0])):
        schema = model.adapter().json_schema()
        heading = f"[{role}]" if role in ("table", "chamber") else f"[[{role}]]"
        common = _resolved(schema, schema)
        parts += _section(heading, common, schema)
        drivers = sorted(point.name for point in entry_points_of("gyrobench.drivers"))
        for kind in (name.partition(".")[2] for name in drivers if name.startswith(f"{role}.")):
            own = config_class(role, kind).adapter().json_schema()
            body = _resolved(own, own)
            keys = {
                key: value
                for key, value in body["properties"].items()
                if value != common["properties"].get(key)
            }
            parts += _section(f'{heading}, driver = "{kind}"', {**body, "properties": keys}, own, level=3)
    return "".join(parts)


_ORDER = ("table", "chamber", "gyro", "platform", "supply", "logger")


def _resolved(part: dict[str, Any], schema: dict[str, Any]) -> dict[str, Any]:
    """Return a part of a JSON schema, what it refers to in its place."""
    for holder in (part, *part.get("allOf", []), *part.get("anyOf", []), part.get("items", {})):
        if reference := holder.get("$ref"):
            return {
                **schema["$defs"][reference.rpartition("/")[2]],
                **{k: v for k, v in part.items() if k == "default"},
            }
    return part


def _section(heading: str, body: dict[str, Any], schema: dict[str, Any], level: int = 2) -> Iterator[str]:
    yield f"\n{'#' * level} `{heading}`\n\n{_plain(body.get('description'))}\n"
    if not body["properties"]:
        yield "\nNo keys of its own.\n"
        return
    yield "\n| key | | default | allowed |\n|---|---|---|---|\n"
    needed = body.get("required", [])
    inner = []
    for name, value in body["properties"].items():
        default = "required" if name in needed else _value(value.get("default"))
        yield f"| `{name}` | {_plain(value.get('description'))} | {default} | {_allowed(value, schema)} |\n"
        deeper = _resolved(value, schema)
        if "properties" in deeper:
            many = value.get("type") == "array"
            stem = heading.strip("[]")
            inner.append((f"[[{stem}.{name}]]" if many else f"{stem}.{name} = {{ }}", deeper))
    for name, deeper in inner:
        yield from _section(name, deeper, schema, level=3)


def _value(value: Any) -> str:
    return (
        ""
        if value in (None, [], {}) or isinstance(value, dict)
        else f"`{str(value).lower() if isinstance(value, bool) else value}`"
    )


def _allowed(value: dict[str, Any], schema: dict[str, Any]) -> str:
    ways = [way for way in value.get("anyOf", [value]) if way.get("type") != "null"]
    return " or ".join(filter(None, (_one(way, schema) for way in ways)))


_BOUNDS = (
    ("minimum", "at least"),
    ("exclusiveMinimum", "above"),
    ("maximum", "at most"),
    ("exclusiveMaximum", "below"),
)


def _one(way: dict[str, Any], schema: dict[str, Any]) -> str:
    if "$ref" in way:
        way = _resolved(way, schema)
    if "enum" in way:
        return ", ".join(f"`{choice}`" for choice in way["enum"])
    if "const" in way:
        return f"`{way['const']}`"
    names = {"string": "text", "integer": "whole number", "number": "number", "boolean": "true, false"}
    bounds = [f"{word} {way[key]:g}" for key, word in _BOUNDS if key in way]
    return ", ".join(
        [names.get(way.get("type", ""), "table" if way.get("type") == "object" else "list"), *bounds]
    )


def _plain(text: str | None) -> str:
    """Return a text as one line of a Markdown table: brackets and bars are no markup."""
    line = re.sub(r"\s+", " ", text or "").strip()
    parts = re.split(r"(`[^`]*`)", line)
    marks = str.maketrans({"[": r"\[", "]": r"\]", "<": "&lt;", "*": r"\*", "_": r"\_"})
    return "".join(p if p.startswith("`") else p.translate(marks) for p in parts).replace("|", r"\|")


def main() -> int:
    """Build the site; return the exit code."""
    wrong = build(Path(sys.argv[1]))
    print(wrong, end="")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
