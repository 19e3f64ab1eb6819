"""The pictures of docs/panel.md, taken of a panel beside the demo's emulated bench; needs Chromium.

Run as `python -m benchmarks.panel_pictures`. The lab has a fixed seed and virtual time; the host's dates differ
from picture to picture.
"""

from __future__ import annotations

import shutil
import sys
import tempfile
from pathlib import Path
from typing import Any

from bench.campaign.queue import BenchQueue, RunOrder
from bench.control.live import drop_answer, drop_request, read_now
from bench.lab.emulated import EmulatedLab, Plant
from bench.record.benchfile import bench_file_text, load_bench_file
from benchmarks.panel import panel
from drivers.base.clock import WallClock

ROOT = Path(__file__).parents[1]
IMAGES = ROOT / "docs" / "images"
_FLAGS = ["--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run", "--disable-sync"]
_BY = "Ada"
_TURNED_S = 400.0
_PATIENCE_S = 120.0


def main() -> int:
    """Take the pictures; 1 without a browser."""
    browser = shutil.which("chromium") or shutil.which("google-chrome")
    if browser is None:
        print("no Chromium: `apt-get install chromium`")
        return 1
    from playwright.sync_api import sync_playwright

    with tempfile.TemporaryDirectory(prefix="gyrobench-pictures-") as scratch, sync_playwright() as player:
        chromium = player.chromium.launch(executable_path=browser, args=_FLAGS)
        runs, bench = Path(scratch) / "runs", Path(scratch) / "bench.toml"
        file = load_bench_file(ROOT / "examples" / "demo.toml")
        shutil.copy(ROOT / "examples" / "cold_shock_campaign.toml", scratch)
        with EmulatedLab(file, Plant(seed=5), clock="virtual", apart=True) as lab:
            bench.write_text(bench_file_text(lab.file), encoding="utf-8")
            with panel(runs, "--bench", str(bench)) as (_, url):
                _take(chromium, url, BenchQueue(runs, bench))
        chromium.close()
    return 0


def _take(chromium: Any, url: str, queue: BenchQueue) -> None:
    queue.add(RunOrder(procedure="zero-bias-cold-shock"), _BY)
    queue.add(RunOrder(procedure="known-state", parameters={"air_c": 30.0}), _BY)
    item = queue.add(RunOrder(procedure="constant-rotation", parameters={"turns": 400.0}), _BY)
    queue.start(item.id, _BY)
    _until(lambda: any(queue.runs.glob("*/live/now.json")))
    run = next(queue.runs.glob("*/live/now.json")).parents[1]
    _until(lambda: bool((read_now(run) or {}).get("prompts")))
    now = read_now(run)
    assert now is not None
    drop_answer(run, int(now["prompts"][0]["id"]), "yes", _BY)
    _until(lambda: ((read_now(run) or {}).get("time_s") or 0.0) > _TURNED_S)
    form = f"{url}queue/{queue.name}?procedure=constant-rotation"
    for name, address, width, scheme in (
        ("panel", url, 1280, "light"),
        ("panel_dark", url, 1280, "dark"),
        ("panel_queue", form, 1280, "light"),
        ("panel_phone", form, 390, "dark"),
    ):
        context = chromium.new_context(viewport={"width": width, "height": 860}, color_scheme=scheme)
        page = context.new_page()
        page.add_init_script(f"localStorage.setItem('gyrobench-name', '{_BY}')")
        page.goto(address)
        live = "window.gyrobench?.messages > 20 && window.gyrobench.rows() > 20"
        if address == url:
            page.wait_for_function(live)
        else:
            page.wait_for_selector(".facts")
            page.wait_for_selector(".waiting .about")
        page.screenshot(path=IMAGES / f"{name}.png", full_page=width < 1000 or address != url)
        context.close()
    drop_request(run, "abort", _BY)
    _until(lambda: not (read_now(run) or {}).get("alive"))


def _until(condition: Any) -> None:
    clock = WallClock()
    try:
        while not condition():
            if clock.now() > _PATIENCE_S:
                raise TimeoutError("the run did not come so far")
            clock.sleep(0.1)
    finally:
        clock.close()


if __name__ == "__main__":
    sys.exit(main())
