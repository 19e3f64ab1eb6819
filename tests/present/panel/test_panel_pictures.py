"""A question with a picture: shown on the page, kept in the run folder, sealed with it; a run needs none."""

import json
import os
import subprocess
import sys
from io import BytesIO
from pathlib import Path
from types import SimpleNamespace
from urllib.error import HTTPError
from urllib.request import urlopen

import pytest
from PIL import Image

from bench.control.live import drop_request
from bench.control.run_record import RunRecord, decode_run
from bench.record.recording import read_events, verify
from tests.present.panel.browser import NEEDED, PATIENCE_S, Panel, browser_page, until


def png(colour: str = "navy") -> bytes:
    made = BytesIO()
    Image.new("RGB", (320, 200), colour).save(made, "PNG")
    return made.getvalue()


@pytest.mark.parametrize(
    ("content", "kept"),
    [
        (png(), "png"), (b"\xff\xd8\xff\xe0 a JPEG", "jpg"), (b"<svg onload=alert(1)>", ""), (b"", ""),
        (None, ""), (b"\x89PNG\r\n\x1a\n" + bytes(4 << 20), ""),
    ],
    ids=["png", "jpeg", "svg", "empty", "not there", "too large"],
)  # fmt: skip
def test_a_picture_is_kept_by_its_content_or_said_to_be_none(tmp_path: Path, content, kept: str) -> None:
    picture, said = tmp_path / "mount.png", []
    if content is not None:
        picture.write_bytes(content)
    record = SimpleNamespace(folder=tmp_path / "run")
    record.folder.mkdir()
    name = RunRecord.keep_picture(record, picture, said.append)
    if kept:
        assert said == [] and name.startswith("pictures/") and name.endswith(f".{kept}")
        assert (record.folder / name).read_bytes() == content
        assert RunRecord.keep_picture(record, picture, said.append) == name
    else:
        assert name is None and len(said) == 1 and str(picture) in said[0]
    assert RunRecord.keep_picture(record, None, said.append) is None


@pytest.mark.concurrent
@pytest.mark.parametrize("width", [pytest.param(390, marks=NEEDED)])
def test_the_page_shows_the_picture_and_the_run_is_sealed_with_it(tmp_path: Path, width: int) -> None:
    picture = tmp_path / "mount.png"
    picture.write_bytes(png())
    (tmp_path / "runs").mkdir()
    panel = Panel(tmp_path / "runs")
    script = Path(__file__).with_name("session.py")
    process = subprocess.Popen(
        [sys.executable, script, panel.runs, "turn", f"picture={picture}"],
        stdout=subprocess.DEVNULL,
        env=os.environ | {"OMP_NUM_THREADS": "1", "XDG_STATE_HOME": str(tmp_path / "state")},
    )
    run = panel.runs / "turn"
    try:
        with browser_page(width) as page:
            page.goto(panel.url)
            shown = page.get_by_alt_text("what the question means")
            shown.wait_for()
            page.wait_for_function("[...document.images].some((one) => one.naturalWidth === 320)")
            assert page.evaluate("document.documentElement.scrollWidth") <= width
            address = shown.get_attribute("src")
            with urlopen(panel.url + address[1:], timeout=PATIENCE_S) as answer:
                assert answer.headers["content-type"] == "image/png" and answer.read() == picture.read_bytes()
                assert "default-src 'none'" in answer.headers["content-security-policy"]
            for other in (
                "turn/manifest.json",
                "turn/pictures",
                "turn/pictures/../manifest.json",
                "../mount.png",
            ):
                with pytest.raises(HTTPError, match="404"):
                    urlopen(f"{panel.url}picture/{other}", timeout=PATIENCE_S)
        drop_request(run, "abort", "Ada")
        process.wait(PATIENCE_S)
    finally:
        process.kill()
        process.wait()
        panel.kill()
    until(lambda: "aborted" in (run / "manifest.json").read_text(), "the end of the run")
    (asked,) = [row for row in read_events(run).rows if row["kind"] == "prompt"]
    manifest = json.loads((run / "manifest.json").read_text())
    assert asked["picture"] in manifest["files"] and verify(run, decode_run).passed
    (run / asked["picture"]).write_bytes(png("red"))
    (run / "pictures" / "more.png").write_bytes(png())
    told = {problem.path: problem.text for problem in verify(run, decode_run).problems}
    assert "differs" in told[asked["picture"]] and told["pictures/more.png"] == "not in the manifest"
