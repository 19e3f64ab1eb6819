"""The command that runs the benchmarks: a row at a time, a failing one costs no other, results by section."""

import sys
from types import ModuleType

import pytest

from benchmarks import __main__ as command
from benchmarks import _guard
from benchmarks._measure import Pair, figure, row, speed_row
from benchmarks._sections import Page, write_section


def module(monkeypatch, name, rows):
    made = ModuleType(f"benchmarks.{name}")
    made.rows = rows
    monkeypatch.setitem(sys.modules, made.__name__, made)


@pytest.fixture
def page(tmp_path, monkeypatch):
    """Two benchmarks, the first of which fails after its first row, and a page of their results."""

    def failing():
        yield figure("first", 4.0, 2.0, "peer 1.0", "x")
        raise ValueError("no such port")

    module(monkeypatch, "failing", failing)
    module(monkeypatch, "sound", lambda: [row("work", Pair(1.0, 3.0, 3.0), "peer 2.0")])
    monkeypatch.setattr(command, "names", lambda: ["failing", "sound"])
    found = Page(tmp_path / "RESULTS.md", "# Results\n", ("Machine", "Guard"))
    monkeypatch.setattr(command, "RESULTS", found)
    kept = tmp_path / "ratios.json"
    kept.write_text('{"sound": {"work / peer": 3.9}}')
    monkeypatch.setattr(_guard, "FILE", kept)
    return found


def test_a_failing_benchmark_keeps_its_rows_and_the_others_and_the_exit_code(page, capsys):
    assert command.main(["--write"]) == 1
    said = capsys.readouterr().out
    assert said.index("## failing (1 of 2") < said.index("| first | 4 | 2 | 2 | x | peer 1.0 |")
    assert said.index("failing took") < said.index("## sound (2 of 2") < said.index("| work | 1 | 3 | 3 |")
    assert "- failed: failing: ValueError: no such port" in said
    text = page.path.read_text()
    assert [line for line in text.splitlines() if line.startswith("## ")] == [
        "## Machine",
        "## Guard",
        "## failing",
        "## sound",
    ]
    assert "- failed: failing: ValueError: no such port" in text and "| first | 4 | 2 | 2 |" in text
    assert "lost" not in text  # 3 is above three quarters of 3.9


def test_a_loss_made_up_is_measured_again_and_reported(page, monkeypatch, capsys):
    times = iter([2.8, 2.9])
    module(monkeypatch, "sound", lambda: [row("work", Pair(1.0, t := next(times), t), "peer 2.0")])
    assert command.main(["--write", "sound"]) == 1
    said = capsys.readouterr().out
    assert "1 ratios lower than kept: measured once more" in said
    assert "- lost more than a quarter: sound: work / peer: 2.9, kept 3.9" in said
    assert "## Guard" not in page.path.read_text()  # one benchmark says nothing of all


def test_a_loss_that_a_second_measurement_does_not_confirm_is_none(page, monkeypatch, capsys):
    times = iter([2.8, 3.8])
    module(monkeypatch, "sound", lambda: [row("work", Pair(1.0, t := next(times), t), "peer 2.0")])
    assert command.main(["sound"]) == 0
    assert "No ratio kept was lost, nothing failed." in capsys.readouterr().out
    assert not page.path.exists()


def test_keep_writes_what_was_found(page, capsys):
    assert command.main(["--keep", "sound"]) == 0
    assert _guard.lost("sound", [row("work", Pair(1.0, 2.2, 2.2), "peer 3.0")]) == [
        "sound: work / peer: 2.2, kept 3"
    ]


def test_an_unknown_name_is_refused_with_those_there_are(page, capsys):
    with pytest.raises(SystemExit) as ended:
        command.main(["sond"])
    assert ended.value.code == 2
    assert "no benchmark sond; there are failing, sound" in capsys.readouterr().err


def test_a_section_written_again_leaves_the_others(tmp_path):
    page = Page(tmp_path / "page.md", "# Head\n", ("Last",))
    write_section("b", "run b", ["old"], page)
    write_section("a", "run a", ["kept"], page)
    write_section("Last", "run", ["first of all"], page)
    write_section("b", "run b", ["new"], page)
    text = page.path.read_text()
    assert text.index("## Last") < text.index("## a") < text.index("## b")
    assert "kept" in text and "new" in text and "old" not in text and text.count("`run b`") == 1


def test_speeds_and_figures_have_ratios_the_right_way_round():
    faster = speed_row("work", 10.0, Pair(2.0, 6.0, 3.0), "peer", "x/s")
    assert (faster["ours"], faster["ratio"]) == (5.0, 3.0)
    assert faster["yardstick"] == pytest.approx(10.0 / 6.0)
    assert figure("s", 0.2, 0.4, "limit", "s", least=True)["ratio"] == 2.0
    assert figure("x", 0.2, 0.4, "limit", "x")["ratio"] == 0.5
