"""Ctrl-C beside a run, through the same `main` that the command line calls: a word, and nothing lost."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

from bench.present import report
from bench.present.cli._app import main

DEMO = Path("examples/demo.toml")


def stopped(*_: object, **__: object) -> None:
    raise KeyboardInterrupt


def ended(monkeypatch: pytest.MonkeyPatch, *words: str) -> object:
    """Return the exit code of a command."""
    monkeypatch.setattr(sys, "argv", ["gyrobench", *words])
    with pytest.raises(SystemExit) as end:
        main()
    return end.value.code


def test_a_command_that_ctrl_c_stops_says_so(monkeypatch, capsys):
    monkeypatch.setattr("bench.control.procedure.read_procedure", stopped)
    assert ended(monkeypatch, "procedures", "known-state") == 130
    assert "stopped by Ctrl-C" in capsys.readouterr().err


def test_ctrl_c_while_the_plots_are_drawn_costs_the_plots_only(monkeypatch, capsys, tmp_path):
    monkeypatch.setattr(report, "write_report", stopped)
    words = ("known-state", "--bench", str(DEMO), "--runs", str(tmp_path))
    assert ended(monkeypatch, "rehearse", *words) == 130
    said = capsys.readouterr()
    assert "completed" in said.out and "the run folder takes" in said.out and "plots:" not in said.out
    assert "stopped by Ctrl-C" in said.err
