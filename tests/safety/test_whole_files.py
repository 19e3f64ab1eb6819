"""A result file is replaced whole or not at all, and a disk that is full is told in one paragraph."""

import errno
import os

import pytest

from bench.analysis.common.state_file import read_state, save_file, saved_together, write_state
from drivers.base.errors import RecordError
from drivers.base.files import replace_file


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
    assert [file.name for file in tmp_path.iterdir()] == [path.name]


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


def test_files_of_one_result_are_never_seen_beside_those_of_another(tmp_path, monkeypatch):
    """Killed before any of the calls that put them in place; the last time nothing comes between."""
    calls, allowed = [], 0

    def until_killed(call):
        def counted(*words, **named):
            calls.append(call)
            if len(calls) > allowed:
                raise KeyboardInterrupt  # no handler of errors may see to what is left
            return call(*words, **named)

        return counted

    names, seen = ("fit.gyrocomp", "fit.h", "fit.onnx", "report.html"), set()
    for allowed in range(60):
        folder = tmp_path / str(allowed)
        folder.mkdir()
        for name in names:
            (folder / name).write_text("old")
        calls.clear()
        with monkeypatch.context() as patch:
            for call in ("unlink", "replace", "fsync", "rename", "mkdir"):
                patch.setattr(os, call, until_killed(getattr(os, call)))
            try:
                with saved_together(folder, "fit.onnx") as part:
                    for name in names[:2] + names[3:]:
                        save_file(part / name, "new")
                ended = True
            except KeyboardInterrupt:
                ended = False
        found = {name: (folder / name).read_text() for name in names if (folder / name).exists()}
        assert len(set(found.values())) <= 1, found
        seen.add((tuple(found), *set(found.values())))
        with saved_together(folder, "fit.onnx") as part:
            save_file(part / "fit.h", "again")
        assert not (folder / ".part").exists()
        if ended:
            break
    assert ended and (names, "old") in seen and ((*names[:2], names[3]), "new") in seen and len(seen) > 4


def test_a_failure_on_the_way_leaves_the_earlier_result(tmp_path):
    for name in ("fit.h", "fit.onnx"):
        (tmp_path / name).write_text("old")
    with pytest.raises(RecordError, match="could not be saved"), saved_together(tmp_path, "fit.onnx") as part:
        save_file(part / "fit.h", "new")
        raise OSError(errno.ENOSPC, "No space left on device")
    assert {path.name: path.read_text() for path in tmp_path.iterdir()} == {"fit.h": "old", "fit.onnx": "old"}
