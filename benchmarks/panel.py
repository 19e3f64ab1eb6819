"""The live panel: first paint, server load and memory at 10 Hz beside a run of 24 h, what it costs the recorder.

Run as `python -m benchmarks panel`; needs Chromium. The yardsticks are the limits that the panel was designed to.

* first paint: from opening the address to the first contentful paint and to live values on the page, warm server.
* server load: a session 24 h into its run (86,400 lines of history), `now.json` replaced ten times a second, one
  page open in Chromium with six traces; CPU time of the server's process over wall time.
* crowd: a second bench whose `now.json` is replaced as often, and five browsers, three on one bench and two on
  the other; then from opening to live values in a sixth.
* memory: growth of the server's resident memory over that time, and of the curves' over 24 h of updates at 10 Hz.
* recorder: one emulated run that records in blocks of equally many frames, in the order A B B A beside a panel
  with a page open (A) and beside the same panel stopped by SIGSTOP (B), in turns with four blocks without it, the
  control; the median over the turns with its interval by bootstrap. CPU time of the threads that drive and
  record, a frame, and of the one that writes the live files, a host second. The recorder has a processor of its
  own if there are two.
"""

from __future__ import annotations

import json
import math
import os
import resource
import signal
import socket
import statistics
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from urllib.request import urlopen

import numpy as np

from bench.present.panel._series import MinMax
from bench.present.report._file import find_browser
from benchmarks._measure import Row, Work, cost, figure, usual
from drivers.base.clock import WallClock, host_seconds, utc_now

_LIMIT = "limit of the design"
_OPENINGS = 5
_BROWSERS = 5
_WATCHED_S = 30.0
_TURNS = 48
_BLOCK_S = 100.0
_SETTLE_S = 0.1
_ABBA = (True, False, False, True)
CHROMIUM_FLAGS = [
    "--no-sandbox",
    "--disable-gpu",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
]
"""How every Chromium of ours is started: asks nobody outside for anything."""
_processors = sorted(os.sched_getaffinity(0))
_TICKS_S = os.sysconf("SC_CLK_TCK")
_CLI = "from bench.present.cli import main; main()"


def rows() -> Iterator[Row]:
    """Yield the figures, each against its limit."""
    browser = find_browser()
    if not browser:
        print("skipped: no Chromium")
        return
    from playwright.sync_api import sync_playwright

    growth_mb = curves_growth_mb()
    yield figure("curves' memory growth over 24 h at 10 Hz", growth_mb, 1.0, _LIMIT, "MB", least=True)
    with tempfile.TemporaryDirectory(prefix="gyrobench-panel-bench-") as scratch, sync_playwright() as player:
        with _on(_spare()):
            chromium = player.chromium.launch(executable_path=browser, args=CHROMIUM_FLAGS)
        runs = Path(scratch) / "runs"
        write_day(runs / "day")
        with panel(runs) as (process, url):
            paints, lives = [], []
            for _ in range(_OPENINGS):
                page = chromium.new_context().new_page()
                start = host_seconds()
                page.goto(url, wait_until="commit")
                page.wait_for_function("window.gyrobench?.messages > 0")
                lives.append(host_seconds() - start)
                page.wait_for_function("performance.getEntriesByName('first-contentful-paint').length > 0")
                paint_ms = page.evaluate(
                    "performance.getEntriesByName('first-contentful-paint')[0].startTime"
                )
                paints.append(paint_ms / 1000.0)
                page.context.close()
            for name, times in (("first contentful paint", paints), ("live values on the page", lives)):
                title = f"{name}, median of {_OPENINGS}"
                yield figure(title, statistics.median(times), 1.0, _LIMIT, "s", least=True)
            page = chromium.new_page()
            page.goto(url)
            page.wait_for_function("window.gyrobench?.messages > 3")
            watched_s = usual(_WATCHED_S, 10.0)
            load, growth_mb, updates = watch(process.pid, [runs / "day"], page, watched_s)
            yield figure("updates a second on the page", updates, 10.0, "asked for", "1/s")
            share = 100.0 * load
            yield figure(
                "server load at 10 Hz, six traces, one page", share, 5.0, _LIMIT, "% of a core", least=True
            )
            yield figure(f"server memory growth in {watched_s:g} s", growth_mb, 1.0, _LIMIT, "MB", least=True)
            page.close()
            yield from crowd(chromium, process.pid, url, runs, watched_s)
        turns = usual(_TURNS, 4)
        for what, (found, control) in recorder_ratios(Path(scratch), chromium, turns).items():
            name = f"recorder's CPU without / with panel, {what}, median of {turns} turns"
            yield figure(name, found.median, 0.98, _LIMIT, "ratio")
            yield figure(f"{what}: low end of its 95 % interval", found.low, 0.98, _LIMIT, "ratio")
            name = f"{what}: without a panel at all (control)"
            yield figure(name, control.median, 1.0, "no difference", "ratio")
            for end, value in (("low", control.low), ("high", control.high)):
                yield figure(f"{what}: {end} end of the control's", value, 1.0, "no difference", "ratio")
        chromium.close()


def crowd(chromium: Any, pid: int, url: str, runs: Path, watched_s: float) -> Iterator[Row]:
    """Yield the server's load with two benches and five browsers, and how soon a sixth shows live values."""
    write_day(runs / "other")
    sessions, pages, live = ["day", "other"], [], "window.gyrobench?.messages > 3"
    for number in range(_BROWSERS):
        page = chromium.new_context().new_page()
        page.goto(f"{url}?session={sessions[number % 2]}")
        page.wait_for_function(live)
        pages.append(page)
    load, growth_mb, updates = watch(pid, [runs / name for name in sessions], pages[-1], watched_s)
    what = f"two benches, {_BROWSERS} browsers"
    yield figure(f"updates a second on the last page, {what}", updates, 10.0, "asked for", "1/s")
    yield figure(f"server load at 10 Hz, {what}", 100.0 * load, 5.0, _LIMIT, "% of a core", least=True)
    yield figure(f"server memory growth in {watched_s:g} s, {what}", growth_mb, 1.0, _LIMIT, "MB", least=True)
    waits = []
    for _ in range(_OPENINGS):
        page = chromium.new_context().new_page()
        start = host_seconds()
        page.goto(url, wait_until="commit")
        page.wait_for_function("document.querySelector('[data-live=air]')?.textContent.startsWith('−')")
        waits.append(host_seconds() - start)
        page.close()
    wait_s = statistics.median(waits)
    yield figure(f"from opening to values on the page, {what}", wait_s, 1.0, _LIMIT, "s", least=True)
    for page in pages:
        page.close()


def write_day(session: Path, hours: float = 24.0) -> None:
    """Write the live files of a run that is `hours` into its day: two gyros, chamber, table."""
    (session / "live").mkdir(parents=True)
    (session / "events.jsonl").write_text('{"time_s": 0, "kind": "step", "code": "1", "title": "Soak"}\n')
    with (session / "live" / "history.jsonl").open("w") as file:
        for second in range(round(3600.0 * hours)):
            row: dict[str, object] = {
                "time_s": second,
                "air_temp_c": _air(second),
                "set_point_c": -40.0,
                "angle_deg": 1.0,
            }
            row |= {"rate_dps": 0.0, "gyros": {"a": [0.003, _air(second)], "b": [0.004, _air(second)]}}
            file.write(json.dumps(row) + "\n")
    write_now(session, 3600.0 * hours)


def write_now(session: Path, time_s: float) -> None:
    """Replace now.json as a session does."""
    gyro: dict[str, object] = {
        "rate_dps": 0.003,
        "latest_dps": 0.003 + 1e-4 * math.sin(time_s),
        "temp_c": _air(time_s),
    }
    gyro |= {"frames": round(100.0 * time_s), "lost": 0, "rejected": {}, "age_s": 0.1}
    now = {
        "format": 1,
        "utc": utc_now(),
        "pid": os.getpid(),
        "state": "running",
        "run": {"folder": str(session.resolve()), "run_id": "day", "units": {"a": "A-1", "b": "B-1"}},
        "time_s": time_s,
        "left_s": 3600.0,
        "step": "1 Soak",
        "chamber": {
            "air_temp_c": _air(time_s),
            "set_point_c": -40.0,
            "rate_k_per_min": 0.0,
            "auxiliary_c": {},
        },
        "table": {"angle_deg": time_s % 360.0, "rate_dps": 1e-4 * math.cos(time_s), "demand": "at rest"},
        "gyros": {"a": gyro, "b": gyro},
    }
    part = session / "live" / "now.json.part"
    part.write_text(json.dumps(now))
    part.replace(session / "live" / "now.json")


def _air(time_s: float) -> float:
    return -40.0 + 5.0 * math.sin(time_s / 3000.0)


@contextmanager
def panel(runs: Path, *options: str) -> Iterator[tuple[subprocess.Popen[bytes], str]]:
    """Serve a panel in a process of its own."""
    with socket.create_server(("127.0.0.1", 0)) as server:
        port = server.getsockname()[1]
    process = subprocess.Popen(
        [sys.executable, "-c", _CLI, "panel", str(runs), "--port", str(port), *options],
        stdout=subprocess.DEVNULL,
    )
    clock, url = WallClock(), f"http://127.0.0.1:{port}/"
    try:
        while True:
            with suppress(OSError), urlopen(url, timeout=10):
                break
            clock.sleep(0.1)
        yield process, url
    finally:
        process.terminate()
        process.wait()
        clock.close()


def watch(pid: int, sessions: Sequence[Path], page: object, watched_s: float) -> tuple[float, float, float]:
    """Return the server's load, memory growth in MB and the page's updates a second while now.json changes.

    The page looks at one of the sessions.
    """
    clock = WallClock()
    time_s, count = 86_400.0, "window.gyrobench.messages"
    for _ in range(50):  # caches and pools fill once
        clock.sleep(0.1)
        time_s += 0.1
        for session in sessions:
            write_now(session, time_s)
    start, cpu_s, memory = clock.now(), _cpu_s(pid), _resident_mb(pid)
    messages = page.evaluate(count)  # type: ignore[attr-defined]
    for tick in range(1, round(10.0 * watched_s) + 1):
        clock.sleep(max(0.0, start + 0.1 * tick - clock.now()))
        time_s += 0.1
        for session in sessions:
            write_now(session, time_s)
    wall_s = clock.now() - start
    seen = page.evaluate(count) - messages  # type: ignore[attr-defined]
    clock.close()
    return (_cpu_s(pid) - cpu_s) / wall_s, _resident_mb(pid) - memory, seen / wall_s


def server_load(watched_s: float = 10.0) -> float | None:
    """Return the share of a processor that a panel with one page open takes at 10 Hz; None without Chromium."""
    browser = find_browser()
    if not browser:
        return None
    from playwright.sync_api import sync_playwright

    with tempfile.TemporaryDirectory(prefix="gyrobench-panel-bench-") as scratch, sync_playwright() as player:
        chromium = player.chromium.launch(executable_path=browser, args=CHROMIUM_FLAGS)
        runs = Path(scratch) / "runs"
        write_day(runs / "day")
        with panel(runs) as (process, url):
            page = chromium.new_page()
            page.goto(url)
            page.wait_for_function("window.gyrobench?.messages > 3")
            load, _, _ = watch(process.pid, [runs / "day"], page, watched_s)
        chromium.close()
    return load


def curves_growth_mb() -> float:
    """Return by how many MiB peak memory grows while curves take a day at 10 Hz, after its start."""
    levels = [MinMax(7, width_s, 480, growing=width_s == 1.0) for width_s in (300 / 480, 3600 / 480, 1.0)]

    def take(ticks: range) -> None:
        for tick in ticks:
            values = [math.sin(tick + column) for column in range(7)]
            for level in levels:
                level.add(0.1 * tick, values)

    def ready() -> Work:
        take(range(86_400))
        return lambda: take(range(86_400, 864_000))

    return cost(ready).memory_mib


@dataclass(frozen=True)
class Spread:
    """A median and its 95 % interval by bootstrap."""

    median: float
    low: float
    high: float


def recorder_ratios(scratch: Path, chromium: Any, turns: int) -> dict[str, tuple[Spread, Spread]]:
    """Return the recorder's CPU time without a panel over that with one, and the same without one at all.

    One run, recording in blocks: `turns` times A B B A with the panel going in A and stopped in B, each followed
    by four blocks without it. "recording": of the threads that drive and record, a frame; "live files": of the
    one that writes them, a host second.
    """
    runs, clock = scratch / "recorder", WallClock()
    runs.mkdir()
    ratios: dict[str, tuple[list[float], list[float]]] = {"recording": ([], []), "live files": ([], [])}
    with _on(_spare()), panel(runs) as (process, url):
        with _on(_processors[:1]):
            recorder = subprocess.Popen(
                [sys.executable, "-m", "benchmarks._recorder", str(runs)],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                text=True,
            )
        page = chromium.new_page()
        page.goto(url)

        def cost(going: bool) -> dict[str, float]:
            process.send_signal(signal.SIGCONT if going else signal.SIGSTOP)
            clock.sleep(_SETTLE_S)
            assert recorder.stdin is not None and recorder.stdout is not None
            recorder.stdin.write(f"{_BLOCK_S}\n")
            recorder.stdin.flush()
            found = json.loads(recorder.stdout.readline())
            return {
                "recording": found["record_s"] / found["frames"],
                "live files": found["live_s"] / found["host_s"],
            }

        try:
            cost(True)
            page.wait_for_function("window.gyrobench?.messages > 3")
            for _ in range(turns):
                watched, alone = ([cost(going) for going in order] for order in (_ABBA, (False,) * 4))
                for what, kept in ratios.items():
                    for blocks, into in zip((watched, alone), kept, strict=True):
                        outer_1, inner_1, inner_2, outer_2 = (block[what] for block in blocks)
                        into.append((inner_1 + inner_2) / (outer_1 + outer_2))
        finally:
            process.send_signal(signal.SIGCONT)
            page.close()
            recorder.communicate()
            clock.close()
    return {what: (spread(found), spread(control)) for what, (found, control) in ratios.items()}


def spread(values: Sequence[float]) -> Spread:
    """Return the median of `values` and its interval over 2,000 draws with replacement."""
    drawn = np.random.default_rng(1).choice(np.asarray(values), (2000, len(values)))
    low, high = np.percentile(np.median(drawn, axis=1), [2.5, 97.5])
    return Spread(statistics.median(values), float(low), float(high))


def _spare() -> list[int]:
    """Return the processors that are not the recorder's, all if there is one."""
    return _processors[1:] or _processors


@contextmanager
def _on(processors: Sequence[int]) -> Iterator[None]:
    """Have processes that are started meanwhile run on `processors`."""
    before = os.sched_getaffinity(0)
    os.sched_setaffinity(0, processors)
    try:
        yield
    finally:
        os.sched_setaffinity(0, before)


def _cpu_s(pid: int) -> float:
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / _TICKS_S


def _resident_mb(pid: int) -> float:
    return int(Path(f"/proc/{pid}/statm").read_text().split()[1]) * resource.getpagesize() / 1e6


if __name__ == "__main__":
    from benchmarks.__main__ import show

    show(rows())
