"""The pictures of docs/panel.md, taken of a panel beside the demo's emulated bench; needs Chromium.

Run as `python -m benchmarks.panel_pictures`. The lab has a fixed seed and virtual time; the host's dates differ
from picture to picture.
"""

from __future__ import annotations

import shutil
import sys
import tempfile
from dataclasses import replace
from pathlib import Path
from typing import Any

from bench.campaign.queue import BenchQueue, RunOrder
from bench.control.live import drop_answer, drop_request, read_now
from bench.control.procedure import find_procedure
from bench.control.questions import EmulatedOperator
from bench.control.runner import RunRequest, run_procedure
from bench.lab.emulated import EmulatedLab, Plant
from bench.present.report._file import find_browser
from bench.record.benchfile import BenchFile, bench_file_text, load_bench_file
from bench.record.recording import read_manifest, seal
from bench.record.run_notes import add_note
from benchmarks.panel import CHROMIUM_FLAGS, panel
from drivers.base.clock import WallClock

ROOT = Path(__file__).parents[1]
IMAGES = ROOT / "docs" / "images"
_BY = "Ada"
_UNITS = ("FOG-001", "FOG-002")
_SHORT = {
    "bias_min": 10.0, "noise_h": 0.5, "temperatures": False, "power_cycles": 1, "step_dwell_s": 60.0,
    "east_dwell_s": 60.0,
    "rates_per_sign": 3, "max_rate_dps": 10.0, "smallest_step_dph": 0.5,
}  # fmt: skip
_TURNED_S = 400.0
_PATIENCE_S = 120.0


def main() -> int:
    """Take the pictures; 1 without a browser."""
    browser = find_browser()
    if not browser:
        print("no Chromium: `apt-get install chromium`")
        return 1
    from playwright.sync_api import sync_playwright

    with tempfile.TemporaryDirectory(prefix="gyrobench-pictures-") as scratch, sync_playwright() as player:
        chromium = player.chromium.launch(executable_path=browser, args=CHROMIUM_FLAGS)
        runs, bench = Path(scratch) / "runs", Path(scratch) / "bench.toml"
        file = load_bench_file(ROOT / "examples" / "demo.toml")
        shutil.copy(ROOT / "examples" / "cold_shock_campaign.toml", scratch)
        _record_earlier(runs, file)
        with EmulatedLab(file, Plant(seed=5), clock="virtual", apart=True) as lab:
            bench.write_text(bench_file_text(lab.file), encoding="utf-8")
            with panel(runs, "--bench", str(bench)) as (_, url):
                _take(chromium, url, BenchQueue(runs, bench))
        chromium.close()
    return 0


def _record_earlier(runs: Path, file: BenchFile) -> None:
    """Record a short standard test three times a unit, a month apart by the dates that are sealed with them."""
    procedure = find_procedure("standard-test")
    for number in range(6):
        unit, month = _UNITS[number % 2], 3 + number // 2
        gyros = [replace(gyro, unit=unit) for gyro in file.gyro[:1]]
        plant = Plant(seed=20 + number)
        with EmulatedLab(file.model_copy(update={"gyro": gyros}), plant, clock="virtual") as lab:
            request = RunRequest(
                procedure,
                procedure.parse(_SHORT | {"warm_up_min": 10.0 + 5.0 * number}),
                lab.file,
                runs,
                EmulatedOperator(lab.perform),
                run_id=f"test-{unit}-{month:02d}",
                emulated={"seed": plant.seed, "model": "demo"},
            )
            folder = run_procedure(request).folder
        began = f"2026-{month:02d}-{5 + number:02d}T09:00:00.000+00:00"
        seal(folder, read_manifest(folder), started_utc=began)
    add_note(folder, _BY, "Bolt of the mount was loose; tightened before the run.")


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
    laid = "&".join(f"run=test-FOG-001-{month:02d}" for month in (3, 4, 5))
    curves, figures = f"{url}curves?{laid}", f"{url}trends?unit=FOG-001&unit=FOG-002&figure=bias [deg/h]"
    for name, address, width, scheme in (
        ("panel", url, 1280, "light"),
        ("panel_dark", url, 1280, "dark"),
        ("panel_queue", form, 1280, "light"),
        ("panel_phone", form, 390, "dark"),
        ("panel_curves", curves, 1280, "light"),
        ("panel_curves_phone", curves, 390, "dark"),
        ("panel_trends", figures, 1280, "light"),
        ("panel_trends_phone", figures, 390, "dark"),
    ):
        context = chromium.new_context(viewport={"width": width, "height": 860}, color_scheme=scheme)
        page = context.new_page()
        page.add_init_script(f"localStorage.setItem('gyrobench-name', '{_BY}')")
        page.goto(address)
        live = "window.gyrobench?.messages > 20 && window.gyrobench.rows() > 20"
        if address == url:
            page.wait_for_function(live)
        elif address == form:
            page.wait_for_selector(".facts")
            page.wait_for_selector(".waiting .about")
        else:
            page.wait_for_selector("[data-loaded=true] canvas", timeout=1000.0 * _PATIENCE_S)
        if address == curves:
            page.get_by_test_id("align").select_option("bias")
            page.wait_for_selector("[data-finer]")
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
