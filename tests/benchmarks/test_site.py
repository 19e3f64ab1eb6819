"""The documentation site is built without a warning and without a network; what is made of the code is whole."""

from __future__ import annotations

import re
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import pytest
import typer.main

from bench.present.cli._app import app
from bench.record.benchfile import load_bench_file
from benchmarks.site import bench_file_page, build, commands_page, html, top_page

ROOT = Path(__file__).parents[2]


@pytest.fixture
def no_network(monkeypatch: pytest.MonkeyPatch) -> None:
    def refused(*_: Any) -> None:
        raise AssertionError("the site asks for a network")

    monkeypatch.setattr("socket.socket.connect", refused)
    monkeypatch.setattr("socket.getaddrinfo", refused)


@pytest.mark.slow
@pytest.mark.usefixtures("no_network")
@pytest.mark.filterwarnings(
    "ignore"
)  # deprecations between Sphinx and its extensions: nothing here mends them
def test_the_site_is_built_without_a_warning_and_loads_nothing_from_elsewhere(tmp_path: Path) -> None:
    # a process of its own: what autodoc reads in the source stays in the classes as annotations
    with ProcessPoolExecutor(1, mp_context=get_context("fork")) as apart:
        assert apart.submit(build, tmp_path).result() == ""
    for page in ("index", "api", "bench_file", "commands", "own_procedure"):
        text = (tmp_path / f"{page}.html").read_text(encoding="utf-8")
        assert not re.findall(r"<(?:script|link|img)[^>]*(?:src|href)=\"(?:https?:)?//[^\"]*", text), page
    api = (tmp_path / "api.html").read_text(encoding="utf-8")
    assert "ConfigurationError for runs of several units" in api
    assert 'href="safety.html"' in (tmp_path / "index.html").read_text(encoding="utf-8")


@pytest.mark.usefixtures("no_network")
@pytest.mark.filterwarnings("ignore")
def test_a_dead_link_and_a_page_in_no_list_are_warnings(tmp_path: Path) -> None:
    source = tmp_path / "source"
    source.mkdir()
    (source / "index.md").write_text("# One\n\n[two](nowhere.md)\n")
    (source / "lost.md").write_text("# Lost\n")
    said = html(source, tmp_path / "site")
    assert "nowhere.md" in said and "isn't included in any toctree" in said


def commands(path: str, command: Any) -> Iterator[tuple[str, Any]]:
    if hasattr(command, "list_commands"):
        for name in command.list_commands(None):
            yield from commands(f"{path} {name}", command.get_command(None, name))
    else:
        yield path, command


def test_every_command_and_option_is_in_the_reference() -> None:
    page = commands_page()
    for path, command in commands("gyrobench", typer.main.get_command(app)):
        section = re.split(rf"^#+ {path}$", page, flags=re.MULTILINE)[1].split("\n#")[0]
        for part in command.params:
            names = part.opts if part.param_type_name == "option" and not part.hidden else []
            assert all(name in section for name in names), (path, names)


def test_every_key_of_the_examples_is_in_the_reference() -> None:
    page = bench_file_page()
    keys = set(re.findall(r"^\| `(\w+)` \|", page, re.MULTILINE))
    for file in ("demo", "lab", "rlg", "ins", "two_axis", "platform"):
        bench = load_bench_file(ROOT / "examples" / f"{file}.toml")
        for name, section in bench.model_dump(mode="json", exclude_none=True, exclude_unset=True).items():
            for part in section if isinstance(section, list) else [section]:
                assert set(part) <= keys, f"{file}: {name}: {set(part) - keys}"
    assert "| `latitude_deg` | the bench's latitude in degrees, north positive | required |" in page
    assert "number, at least -90, at most 90" in page


def test_a_page_from_the_top_of_the_repository_has_links_that_hold_in_the_site() -> None:
    assert "](docs/" not in top_page(ROOT / "README.md") and "](contributing.md)" in top_page(
        ROOT / "README.md"
    )
