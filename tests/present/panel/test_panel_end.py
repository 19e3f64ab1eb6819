"""A panel that is stopped as a service is: nothing of it stays behind."""

import os
from pathlib import Path

import pytest

from tests.present.panel.browser import PATIENCE_S, Panel

LEFT = "gyrobench-panel-*"


@pytest.mark.skipif(os.name == "nt", reason="Windows ends a process without asking it")
@pytest.mark.timeout(300)
def test_a_panel_that_is_terminated_takes_its_scratch_folder_along(tmp_path: Path) -> None:
    runs = tmp_path / "runs"
    runs.mkdir()
    panel = Panel(runs)
    try:
        assert list(tmp_path.glob(LEFT))
        panel.process.terminate()
        panel.process.wait(PATIENCE_S)
    finally:
        panel.kill()
    assert not list(tmp_path.glob(LEFT))
