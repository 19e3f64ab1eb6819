"""Notes and pictures beside a run: its seal stays whole, and nothing that lies there can stop a reader."""

import hashlib
import json
from concurrent.futures import ThreadPoolExecutor

import pytest

from bench.present.cli import main
from bench.present.report import render_page, run_content, run_page
from bench.record.events.run import Outcome
from bench.record.recording import EventLog, Manifest, Run, seal, verify, write_manifest
from bench.record.run_notes import add_note, note_picture, notes_changed_ns, read_notes
from drivers.base.errors import ConfigurationError, RecordError

pytestmark = pytest.mark.concurrent
PNG = bytes.fromhex(
    "89504e470d0a1a0a0000000d4948445200000001000000010802000000907753de0000000c49444154789c63f8cf"
    "c0000003010100c9fe92ef0000000049454e44ae426082"
)


@pytest.fixture
def run(tmp_path):
    folder = tmp_path / "run"
    folder.mkdir()
    manifest = Manifest(run_id="run", procedure="known-state", started_utc="2026-11-21T00:00:00.000+00:00")
    write_manifest(folder, manifest)
    log = EventLog(folder)
    log.event(20.0, Outcome("completed", "", True))
    log.close()
    seal(folder, manifest, outcome="completed", duration_s=20.0)
    return folder


def test_a_note_is_kept_in_order_and_the_seal_stays_whole(run):
    assert read_notes(run) == [] and notes_changed_ns(run) == 0
    before = {path: path.read_bytes() for path in run.rglob("*") if path.is_file()}
    add_note(run, " Ada ", "cable touched at 300 s")
    add_note(run, "Ben", "", PNG)
    first, second = read_notes(run)
    assert (first.by, first.text, first.picture) == ("Ada", "cable touched at 300 s", "")
    assert second.picture == hashlib.sha256(PNG).hexdigest() + ".png"
    assert note_picture(run, second.picture) == PNG and notes_changed_ns(run) > 0
    assert all(path.read_bytes() == content for path, content in before.items())
    report = verify(run, lambda folder, out: None)
    assert report.passed and report.sealed and Run.open(run).seal == "whole"


@pytest.mark.parametrize(
    ("by", "text", "picture", "what"),
    [
        ("", "text", b"", "without a name"),
        ("Ada", "  ", b"", "empty note"),
        ("Ada", "x" * 4001, b"", "too long"),
        ("Ada", "", b"<svg onload='alert(1)'/>", "cannot be attached"),
        ("Ada", "", PNG + bytes(8 << 20), "cannot be attached"),
    ],
)
def test_what_is_no_note_is_refused_and_leaves_nothing(run, by, text, picture, what):
    with pytest.raises(ConfigurationError, match=what):
        add_note(run, by, text, picture)
    assert not (run / "notes").exists()


def test_torn_and_foreign_lines_cost_no_note_and_open_no_file_outside(run):
    add_note(run, "Ada", "first")
    path = run / "notes" / "notes.jsonl"
    wrong = [b"7", b"[]", b'{"by": 5}', b'{"utc": "", "by": "A", "text": "", "picture": "../manifest.json"}']
    path.write_bytes(path.read_bytes() + b"\n".join([*wrong, b'{"utc": "2026", "by": "B", "te']))
    add_note(run, "Ben", "second")
    assert [note.text for note in read_notes(run)] == ["first", "second"]
    for name in ("../manifest.json", "/etc/passwd", "a.png", "0" * 64 + ".png"):
        with pytest.raises(RecordError, match="cannot be shown"):
            note_picture(run, name)


def test_notes_of_many_at_once_are_all_there(run):
    with ThreadPoolExecutor(8) as pool:
        list(pool.map(lambda number: add_note(run, "Ada", f"note {number}"), range(40)))
    assert sorted(note.text for note in read_notes(run)) == sorted(f"note {number}" for number in range(40))


def test_the_report_shows_notes_and_pictures_as_text(run):
    add_note(run, "Ada <b>", "door & <script>")
    add_note(run, "Ben", '"x', PNG)
    add_note(run, "Cid", "gone", PNG + b"2")
    (run / "notes" / read_notes(run)[2].picture).write_bytes(PNG + b"changed")
    page = render_page(run_page(run_content(Run.open(run))))
    assert "door &amp; &lt;script&gt;" in page and "Ada &lt;b&gt;" in page and "<script>" not in page
    assert page.count("data:image/png;base64,") == 1 and 'alt="&#34;x"' in page
    assert "a picture cannot be shown" in page and "checksum is not its name" in page


def test_a_note_from_the_command_line_is_shown_there(run, tmp_path, capsys, monkeypatch):
    picture = tmp_path / "mount.png"
    picture.write_bytes(PNG)

    def gyrobench(*words):
        monkeypatch.setattr("sys.argv", ["gyrobench", *words])
        with pytest.raises(SystemExit) as ended:
            main()
        return ended.value.code, capsys.readouterr().out

    code, out = gyrobench(
        "runs", "note", str(run), "new mount", "--by", "Ada", "--picture", str(picture), "--json"
    )
    assert code == 0 and json.loads(out.splitlines()[-1])["note"]["text"] == "new mount"
    assert "new mount" in gyrobench("runs", "show", str(run))[1]
    assert gyrobench("runs", "note", str(tmp_path), "x", "--by", "Ada")[0] != 0
