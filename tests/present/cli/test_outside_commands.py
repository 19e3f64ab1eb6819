"""Commands that another package brings by entry point stand beside ours, and cannot replace them."""

from importlib.metadata import EntryPoint, version

import pytest
import typer
from typer.testing import CliRunner

from bench.present.cli import _app

group = typer.Typer(name="weather", help="What the sky does.")


@group.command()
def say(word: str = "rain") -> None:
    """Say it."""
    typer.echo(f"{word}!")


@pytest.fixture
def cli(monkeypatch):
    def point(name):
        return EntryPoint(name, f"{__name__}:group", _app.ENTRY_POINTS)

    brought = {name: point(name) for name in ("weather", "runs")}
    monkeypatch.setattr(EntryPoint, "load", lambda self: group)
    monkeypatch.setattr(_app, "_brought", lambda: brought)
    return lambda *words: CliRunner().invoke(_app.app, list(words))


def test_a_group_of_another_package_is_listed_and_runs(cli):
    listed = cli("--help").output
    assert "weather" in listed and "What the sky does." in listed
    assert listed.count("\n  runs ") == 1
    assert cli("weather", "say", "--word", "snow").output == "snow!\n"


def test_ours_cannot_be_replaced(cli):
    assert "recorded runs" in cli("runs", "--help").output


def test_a_name_that_there_is_not_is_told_from_what_is_near(cli):
    result = cli("wether")
    assert result.exit_code == 2 and "Did you mean 'weather'" in result.output


def test_version_and_completion_are_told(cli):
    assert cli("--version").output == f"gyrobench {version('gyrobench')}\n"
    completed = CliRunner().invoke(
        _app.app,
        [],
        prog_name="gyrobench",
        env={"_GYROBENCH_COMPLETE": "complete_bash", "COMP_WORDS": "gyrobench ru", "COMP_CWORD": "1"},
    )
    assert completed.output.split() == ["run", "runs"]
    completed = CliRunner().invoke(
        _app.app,
        [],
        prog_name="gyrobench",
        env={
            "_GYROBENCH_COMPLETE": "complete_bash",
            "COMP_WORDS": "gyrobench rehearse k",
            "COMP_CWORD": "2",
        },
    )
    assert completed.output.split() == ["known-state"]


GROUPS = ("", *_app.GROUPS)


@pytest.mark.parametrize("group", GROUPS)
def test_what_a_command_does_is_said_whole_in_a_list_of_80_columns(cli, group):
    listed = cli(*group.split(), "--help").output.partition("Commands:")[2]
    assert listed and "..." not in listed
