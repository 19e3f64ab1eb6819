"""A result file is replaced whole or not at all, and a disk that is full is told in one paragraph."""

import errno
import os

import pytest

from bench.state_file import read_state, save_file, write_state
from drivers.errors import RecordError
from drivers.files import replace_file


@pytest.mark.parametrize("call", ["fsync", "replace"])
def test_a_disk_that_fills_up_leaves_the_old_file_and_no_remains(tmp_path, monkeypatch, call):
    path = tmp_path / "compensation.gyrocomp"
    write_state(path, {"number": 1})

    def full(*_):
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(os, call, full)
    with pytest.raises(RecordError, match="No space left on device") as told:
        write_state(path, {"number": 2})
    assert str(path) in str(told.value) and "free space" in str(told.value)
    monkeypatch.undo()
    assert read_state(path) == {"number": 1}
    assert [each.name for each in tmp_path.iterdir()] == [path.name]


def test_a_file_takes_the_old_ones_place_only_when_it_is_on_the_disk(tmp_path, monkeypatch):
    path, order = tmp_path / "compensation.h", []
    path.write_text("old")
    sync = os.fsync

    def noted(descriptor):
        order.append(path.read_text())
        sync(descriptor)

    monkeypatch.setattr(os, "fsync", noted)
    save_file(path, "new")
    assert order == ["old"] and path.read_text() == "new"
    replace_file(path, b"newer", sync=False)
    assert order == ["old"] and path.read_text() == "newer"


def test_a_folder_that_is_not_there_is_told(tmp_path):
    with pytest.raises(RecordError, match="could not be saved"):
        save_file(tmp_path / "gone" / "compensation.h", "x")
