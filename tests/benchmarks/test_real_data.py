"""The page of real recordings: what is fetched is checked, what is missing named, what is wrong shown."""

from __future__ import annotations

import hashlib
from io import BytesIO
from pathlib import Path

import pytest

from benchmarks import real_data
from benchmarks.real_data import RECORDINGS, Recording, Said, page


def test_what_is_fetched_is_what_was_looked_at_before(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked = []

    def answer(url: str, timeout: float) -> BytesIO:
        asked.append(url)
        return BytesIO(b"rows")

    monkeypatch.setattr("urllib.request.urlopen", answer)
    sha256 = hashlib.sha256(b"rows").hexdigest()
    recording = Recording("one", "who/what@abc:a folder/log.csv", "MIT", lambda path: iter(()), sha256)
    assert recording.path(tmp_path, tmp_path / "cache").read_bytes() == b"rows"
    assert asked == ["https://raw.githubusercontent.com/who/what/abc/a folder/log.csv"]
    recording.path(tmp_path, tmp_path / "cache")
    assert len(asked) == 1  # kept
    other = Recording("other", recording.place, "MIT", recording.check, "0" * 64)
    with pytest.raises(OSError, match="SHA-256 differs"):
        other.path(tmp_path, tmp_path / "cache")


def test_the_page_counts_what_is_wrong_and_names_what_is_missing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    rows = [Said("a", "b", "c|d", True), Said("e", "f", "g", False)]
    here = Recording("here", "log.csv", "MIT", lambda path: iter(rows))
    gone = Recording("gone", "none.csv", "MIT", lambda path: iter([Said("", "", path.read_text(), True)]))
    monkeypatch.setattr(real_data, "RECORDINGS", (here, gone))
    text = page(tmp_path, tmp_path)
    assert "1 of 2 statements right, 1 recordings." in text and "Not had: gone:" in text
    assert "| a | b | c/d | yes |" in text and "| e | f | g | **no** |" in text


def test_of_recordings_not_asked_for_the_page_keeps_its_sections(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    first, second = (
        Recording(name, "log.csv", "MIT", lambda path, name=name: iter([Said(name, "b", "new", True)]))
        for name in ("first", "second")
    )
    monkeypatch.setattr(real_data, "RECORDINGS", (first, second))
    old = page(tmp_path, tmp_path).replace("| b | new | yes |", "| b | old | **no** |")
    text = page(tmp_path, tmp_path, ["second"], old)
    assert "| first | b | old | **no** |" in text and "| second | b | new | yes |" in text
    assert "1 of 2 statements right, 2 recordings." in text
    assert page(tmp_path, tmp_path, ["first", "second"], old) == page(tmp_path, tmp_path)
    assert "Not had: first: not in the page" in page(tmp_path, tmp_path, ["second"], "")


def test_every_recording_has_a_source_and_a_licence() -> None:
    for recording in RECORDINGS:
        assert recording.licence and ("@" in recording.place) == bool(recording.sha256)
