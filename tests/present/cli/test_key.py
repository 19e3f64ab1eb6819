"""`gyrobench key` and `runs verify --signed-by`, from outside."""

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[3]


def said(folder: Path, *words: str) -> tuple[int, str]:
    environment = os.environ | {"XDG_STATE_HOME": str(folder / "state"), "COLUMNS": "200"}
    command = [sys.executable, "-m", "gyrobench", *words]
    ended = subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True, check=False)
    return ended.returncode, ended.stdout + ended.stderr


@pytest.mark.slow
def test_a_key_is_made_signs_a_run_and_a_file_and_is_asked_for(tmp_path: Path) -> None:
    shutil.copy(ROOT / "examples" / "demo.toml", tmp_path / "lab.toml")
    assert "no key: nothing is signed" in said(tmp_path, "key", "show")[1]
    status, text = said(tmp_path, "key", "make", "Bench 3", "--json")
    made = json.loads(text)
    assert status == 0 and made["key"].startswith("RW") and Path(made["file"]).stat().st_mode & 0o077 == 0
    assert said(tmp_path, "key", "make", "Bench 4")[0] == 2
    said(tmp_path, "new", "procedure", "mine")
    status, text = said(tmp_path, "rehearse", "./mine.py", "--json")
    run = json.loads(text.splitlines()[-1])["folder"]
    assert "signed by Bench 3 (run:" in said(tmp_path, "runs", "verify", run)[1]
    public = made["public_file"]
    assert said(tmp_path, "runs", "verify", run, "--signed-by", public)[0] == 0

    (tmp_path / "note.txt").write_text("passed")
    assert said(tmp_path, "key", "check", "note.txt", "--signed-by", public)[0] == 1
    assert said(tmp_path, "key", "sign", "note.txt")[0] == 0
    assert "by Bench 3" in said(tmp_path, "key", "check", "note.txt", "--signed-by", public)[1]
    (tmp_path / "limits.toml").write_text('[limits]\n"bias" = { unit = "deg/h", low = -1, high = 1 }\n')
    status, text = said(tmp_path, "report", run, "--limits", "limits.toml", "--out", "certificate.html")
    assert status in (0, 4), text
    assert said(tmp_path, "key", "check", "certificate.html")[0] == 0
    twice = said(tmp_path, "report", run, run, "--out", "certificate.html")
    assert twice[0] == 2 and "each run once" in twice[1]

    Path(made["file"]).rename(tmp_path / "older.key")
    Path(public).rename(tmp_path / "older.pub")
    said(tmp_path, "key", "make", "Bench 3")
    status, text = said(tmp_path, "runs", "verify", run, "--signed-by", public)
    assert status == 1 and "manifest.json.minisig" in text
    assert "a key that is not known here" in said(tmp_path, "runs", "verify", run)[1]
    assert said(tmp_path, "runs", "verify", run, "--signed-by", "older.pub")[0] == 0
