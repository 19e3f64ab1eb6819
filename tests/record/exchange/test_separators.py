"""What separates the cells of a text, where dates have blanks and numbers have commas; when a log began."""

from __future__ import annotations

from pathlib import Path

import pytest

from bench.record.exchange import import_log
from bench.record.exchange._table import read_table
from bench.record.recording import Run
from drivers.base.errors import ConfigurationError

ROWS = 40
DATES = [f"2026-01-11 17:00:{k:02d}" for k in range(ROWS)]
VALUES = [(0.5 + 0.25 * k, -3.5 * k) for k in range(ROWS)]


def text(separator: str, decimal: str = ".", times: list[str] | None = None) -> str:
    lines = [separator.join(("Time", "Rate", "Temp"))]
    for time, pair in zip(times or DATES, VALUES, strict=True):
        lines.append(separator.join((time, *(f"{value:.3f}".replace(".", decimal) for value in pair))))
    return "\n".join(lines) + "\n"


@pytest.mark.parametrize(
    ("separator", "decimal"), [("\t", "."), ("\t", ","), (";", ","), (",", "."), ("|", ".")]
)
def test_a_blank_in_a_date_separates_nothing(tmp_path: Path, separator: str, decimal: str) -> None:
    (tmp_path / "log.txt").write_text(text(separator, decimal))
    table = read_table(tmp_path / "log.txt")
    assert list(table.columns) == ["Time", "Rate", "Temp"]
    assert table.columns["Rate"].tolist() == [value for value, _ in VALUES]
    assert table.columns["Temp"].tolist() == [value for _, value in VALUES]


def test_blanks_separate_numbers_with_decimal_commas(tmp_path: Path) -> None:
    (tmp_path / "log.txt").write_text("Rate Temp\n" + "".join(f"0,{k:02d} 1,5\n" for k in range(ROWS)))
    table = read_table(tmp_path / "log.txt")
    assert table.columns["Rate"].tolist() == [k / 100 for k in range(ROWS)]
    assert table.columns["Temp"].tolist() == [1.5] * ROWS


MAPPING = """
format = 1
unit_id = "G-1"
latitude_deg = 48.0
[columns]
time = { name = "Time", unit = "s" }
output = { name = "Rate", unit = "deg/h" }
t_in = { name = "Temp", unit = "degC" }
"""


def imported(folder: Path, log: str, mapping: str = MAPPING) -> Run:
    (folder / "log.txt").write_text(log)
    (folder / "map.toml").write_text(mapping)
    return Run.open(import_log(folder / "log.txt", folder / "map.toml", folder / "runs"))


def test_a_mapping_says_what_separates(tmp_path: Path) -> None:
    log = text("^")
    with pytest.raises(ConfigurationError):
        imported(tmp_path, log)
    run = imported(tmp_path, log, MAPPING.replace("[columns]", 'separator = "^"\n[columns]', 1))
    assert run.gyro("gyro")["temp_c"].tolist() == [value for _, value in VALUES]


@pytest.mark.parametrize(
    ("times", "began"),
    [
        (DATES, "2026-01-11T17:00:00.000+00:00"),
        ([f"{1768150800 + k}.25" for k in range(ROWS)], "2026-01-11T17:00:00.250+00:00"),
    ],
)
def test_a_run_began_when_its_log_says(tmp_path: Path, times: list[str], began: str) -> None:
    run = imported(tmp_path, text(",", times=times))
    assert run.manifest.started_utc == began
    assert run.manifest.ended_utc.startswith("2026-01-11T17:00:39")


@pytest.mark.parametrize(
    "times", [[f"{86_400 + k}" for k in range(ROWS)], [f"12:00:{k:02d}" for k in range(ROWS)]]
)
def test_seconds_since_somewhere_and_times_of_day_are_no_date(tmp_path: Path, times: list[str]) -> None:
    run = imported(tmp_path, text(",", times=times))
    assert not run.manifest.started_utc.startswith("1970")


@pytest.mark.parametrize(
    ("told", "cells"), [('"---"', ["---"]), ('["---", "OVLD", -99.0]', ["---", "OVLD", "-99", "-99.0"])]
)
def test_words_and_numbers_of_a_mapping_are_missing_values(
    tmp_path: Path, told: str, cells: list[str]
) -> None:
    lines = text(",").splitlines()
    for row, cell in enumerate(cells, 5):
        time, _, temp = lines[row].split(",")
        lines[row] = f"{time},{cell},{temp}"
    log = "\n".join(lines)
    if not cells[0].startswith("-9"):
        with pytest.raises(ConfigurationError, match="not one of numbers") as wrong:
            imported(tmp_path, log)
        assert "missing = 'OVLD'" in wrong.value.remedy
    run = imported(tmp_path, log, MAPPING.replace('unit = "deg/h" }', f'unit = "deg/h", missing = {told} }}'))
    valid = run.gyro("gyro")["valid"]
    assert [row for row in range(ROWS) if not valid[row]] == [4 + k for k in range(len(cells))]
