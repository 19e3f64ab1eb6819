"""The session's side of the live files: a thread that writes where it is and takes what others drop."""

from __future__ import annotations

import json
import math
import os
import threading
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from bench.control.live._files import (
    HISTORY_FILE,
    LIVE_FOLDER,
    NOW_FILE,
    clear,
    drop_answer,
    read_answer,
    take_requests,
)
from bench.control.process import process_start
from bench.control.progress import GyroProgress, Progress
from bench.control.questions import Operator, Question, Reply
from bench.record.events import plain
from bench.record.events.run import Note, Requested
from bench.record.events.safe import SafeState
from drivers.base.clock import Interrupt, epoch_seconds, host_seconds, utc_now
from drivers.base.errors import BenchError
from drivers.base.files import replace_file

_EVERY_S = 0.1
_HISTORY_S = 0.95
_WAIT_S = 0.05
_MOST_ALARMS = 20
_AIR_COLUMNS = ("air_temp_c", "set_point_c")
_TABLE_COLUMNS = ("angle_deg", "rate_dps")
_ERROR_PARTS = ("what", "where", "found", "expected", "remedy")
_NO_END: dict[str, Any] = {"outcome": "", "reason": "", "error": None, "safe": [], "warnings": []}


class Live:
    """Shows a session in its live files and takes answers and requests from there.

    `session`: the campaign's folder; None for a single run, whose own folder it is. It is a display (call it with
    each `Progress`) and an operator (`ask`). Nothing that happens to the files raises into the run: `problem`
    says why they stopped.
    """

    def __init__(self, session: Path | None = None) -> None:
        self.problem = ""
        self.pause_wanted = ""
        """Who wants a pause; empty when nobody does."""
        self.abort: Requested | None = None
        self._session = session
        self._campaign: dict[str, Any] | None = None
        self._run: dict[str, Any] | None = None
        self._run_folder: Path | None = None
        self._run_started = host_seconds()
        self._progress: Progress | None = None
        self._process_start = process_start(os.getpid())
        self._prompts: dict[int, dict[str, Any]] = {}
        self._next_id = int(epoch_seconds() * 1000.0)
        self._taken: deque[Requested | Note] = deque()
        self._ending: dict[str, Any] = _NO_END
        self.paused_between_runs = False
        """Whether the session stands still between two runs."""
        self._ended = False
        self._interrupt: Interrupt | None = None
        self._paced = False
        self._lock = threading.Lock()
        self._news, self._stop = threading.Event(), threading.Event()
        self._history_from_s = -math.inf
        self._totals: dict[str, tuple[int, float]] = {}
        """Of each gyro at the last line of history: samples and the sum of their rates."""
        self._earlier: deque[dict[str, Any]] = deque(maxlen=_MOST_ALARMS)
        """Alarms of the session's earlier runs."""
        self._thread: threading.Thread | None = None

    def __enter__(self) -> Live:
        if self._session is not None:
            self._start()
        return self

    def __exit__(self, *_: object) -> None:
        if self._thread is not None:
            self._stop.set()
            self._thread.join()
            self._thread = None
            self._ended = True
            self._write()

    # What the session says

    def campaign(self, **fields: Any) -> None:
        """Say where the campaign is: title, folder, number, count, run, left_s, bench, emulated."""
        self._campaign = fields

    def begin_run(self, folder: Path, **fields: Any) -> None:
        """Say which run begins: run_id, procedure, expected_s, started_utc, units, bench, auxiliary, emulated."""
        self._earlier.extend(self._alarms())
        self._run_folder, self._progress = folder.absolute(), None
        self._history_from_s, self._totals = -math.inf, {}
        self._run_started = host_seconds()
        self._run = {"folder": str(folder.absolute())} | fields
        self._ending = _NO_END
        if self._session is None:
            self._session = folder.absolute()
        self._start()

    def end(
        self,
        outcome: str,
        reason: str,
        warnings: Sequence[str] = (),
        *,
        error: BaseException | None = None,
        safe: Sequence[SafeState] = (),
    ) -> None:
        """Say how the run, or with the last word the session, ended.

        `error` is what ended it early, `safe` what became of the devices.
        """
        parts = {key: getattr(error, key) for key in _ERROR_PARTS} if isinstance(error, BenchError) else None
        self._ending = {
            "outcome": outcome,
            "reason": reason,
            "error": parts,
            "safe": [state.fields() for state in safe],
            "warnings": list(warnings),
        }

    def __call__(self, progress: Progress) -> None:
        """Take where the run is; the thread writes it down."""
        self._progress = progress

    # What others say

    @contextmanager
    def steering(self, interrupt: Interrupt, *, paced: bool) -> Iterator[None]:
        """Have an abort interrupt `interrupt` meanwhile.

        `paced`: bench time is not the host's, so that whoever waits for a human has to wait on the host too.
        """
        with self._lock:
            self._interrupt, self._paced = interrupt, paced
            if self.abort is not None:
                interrupt.request(_aborted_by(self.abort))
        try:
            yield
        finally:
            with self._lock:
                self._interrupt, self._paced = None, False

    def take(self) -> list[Requested | Note]:
        """Return what has been asked for since the last call, for the record."""
        return [self._taken.popleft() for _ in range(len(self._taken))]

    def wait(self) -> None:
        """Called while waiting for a human: on a clock that is not the host's, wait a little on the host."""
        if self._paced:
            self._news.wait(_WAIT_S)
            self._news.clear()

    def wait_host(self) -> None:
        """Wait on the host for a moment or for news: for a pause between two runs, when there is no clock."""
        self._news.wait(2.0 * _EVERY_S)
        self._news.clear()

    def ask(self, question: Question) -> Callable[[], Reply | None]:
        """Put the question where others see it; whoever answers first, here or elsewhere, answers."""
        self._next_id += 1
        number = self._next_id
        prompt = {
            "id": number,
            "question": question.text,
            "picture": question.picture or "",
            "utc": utc_now(),
        }
        self._prompts = {**self._prompts, number: prompt}

        def answer() -> Reply | None:
            if self._session is None:
                return None
            try:
                found = read_answer(self._session, number)
            except BenchError as error:
                self._taken.append(Note(str(error)))
                (self._session / LIVE_FOLDER / "answers" / f"{number}.json").unlink(missing_ok=True)
                return None
            if found is None:
                self.wait()
                return None
            self._close(number)
            return Reply(found.answer, found.by, found.role)

        return answer

    def beside(self, operator: Operator) -> Operator:
        """Return the operator that is this one and `operator`: whoever answers first."""
        return _Either(self, operator)

    def settle(self, reply: Reply) -> Reply:
        """Close the open question with an answer from elsewhere; return the answer that was first."""
        for number in list(self._prompts):
            if self._session is not None:
                try:
                    first = drop_answer(self._session, number, *reply)
                    reply = Reply(first.answer, first.by, first.role)
                except BenchError as error:
                    self.problem = str(error)
            self._close(number)
        return reply

    def _close(self, number: int) -> None:
        # a new dict, since the thread may be reading the old one
        self._prompts = {key: prompt for key, prompt in self._prompts.items() if key != number}

    # The thread

    def _start(self) -> None:
        if self._thread is not None or self._session is None:
            return
        try:
            clear(self._session)
        except OSError as error:
            self.problem = str(error)
            return
        self._thread = threading.Thread(target=self._work, name="live files", daemon=True)
        self._thread.start()

    def _work(self) -> None:
        while not self._stop.wait(_EVERY_S):
            self._take_requests()
            self._write()

    def _take_requests(self) -> None:
        for request in take_requests(self._session) if self._session is not None else ():
            self._taken.append(request)
            if isinstance(request, Requested):
                self._obey(request)
            self._news.set()

    def _obey(self, request: Requested) -> None:
        if request.action == "pause":
            self.pause_wanted = request.by
        elif request.action == "resume":
            self.pause_wanted = ""
        elif self.abort is None:  # a second one must not disturb the bench being made safe
            with self._lock:
                self.abort = request
                if self._interrupt is not None:
                    self._interrupt.request(_aborted_by(request))

    def _write(self) -> None:
        """Write now.json and a line of history; a failure is kept in `problem`."""
        if self._session is None:
            return
        try:
            text = json.dumps(plain(self._now()), ensure_ascii=False, allow_nan=False)
            replace_file(self._session / LIVE_FOLDER / NOW_FILE, text, sync=False)
            self._write_history()
            self.problem = ""
        except (
            OSError,
            ValueError,
        ) as error:  # the thread also takes what others ask, an abort: it must go on
            self.problem = str(error)

    def _write_history(self) -> None:
        progress = self._progress
        if progress is None or self._run_folder is None or progress.time_s < self._history_from_s:
            return
        # a little less than a second: polls once a second must not be left out in turns for being early
        self._history_from_s = progress.time_s + _HISTORY_S
        ages_s = dict.fromkeys(_AIR_COLUMNS, progress.air_age_s)
        ages_s |= dict.fromkeys(_TABLE_COLUMNS, progress.table_age_s)
        no_air = progress.stale(progress.air_age_s)
        row = {
            "time_s": round(progress.time_s, 3),
            **{
                name: None if progress.stale(age_s) else getattr(progress, name)
                for name, age_s in ages_s.items()
            },
            "auxiliary_c": {} if no_air else progress.auxiliary_c,
            "gyros": {
                name: [None] * 3
                if gyro.silent
                else [gyro.latest_dps, gyro.temp_c, self._mean_dps(name, gyro)]
                for name, gyro in progress.gyros.items()
            },
        }
        self._totals = {name: (gyro.samples, gyro.sum_dps) for name, gyro in progress.gyros.items()}
        folder = self._run_folder / LIVE_FOLDER
        folder.mkdir(exist_ok=True)
        with (folder / HISTORY_FILE).open("a", encoding="utf-8") as file:
            file.write(json.dumps(plain(row), ensure_ascii=False, allow_nan=False) + "\n")

    def _mean_dps(self, name: str, gyro: GyroProgress) -> float | None:
        """Return the mean of all samples since the last line of history, None without any."""
        samples, sum_dps = self._totals.get(name, (0, 0.0))
        count = gyro.samples - samples
        return (gyro.sum_dps - sum_dps) / count if count > 0 else None

    def _now(self) -> dict[str, Any]:
        progress, run = self._progress, self._run
        now: dict[str, Any] = {
            "format": 1,
            "utc": utc_now(),
            "pid": os.getpid(),
            "process_start": self._process_start,
            "state": self._state(progress),
            **self._ending,
            "pause_wanted": bool(self.pause_wanted),
            "campaign": self._campaign,
            "run": run,
            "prompts": list(self._prompts.values()),
        }
        if progress is None:
            return {**now, **_NOTHING_YET, "alarms": list(self._earlier)}
        expected_s = float((run or {}).get("expected_s") or 0.0)
        host_s = max(1e-3, host_seconds() - self._run_started)
        ages = {
            "chamber": {"age_s": progress.air_age_s, "stale": progress.stale(progress.air_age_s)},
            "table": {"age_s": progress.table_age_s, "stale": progress.stale(progress.table_age_s)},
        }
        shown = vars(progress) | {
            "alarms": [*self._earlier, *self._alarms()][-_MOST_ALARMS:],
            "left_s": progress.left_s(expected_s),
            "speed": progress.time_s / host_s,
            "chamber": {
                "air_temp_c": progress.air_temp_c,
                "set_point_c": progress.set_point_c,
                "rate_k_per_min": progress.air_rate_k_per_min,
                "auxiliary_c": progress.auxiliary_c,
                **ages["chamber"],
            },
            "table": {name: getattr(progress, name) for name in (*_TABLE_COLUMNS, "demands")} | ages["table"],
            "gyros": {name: {**plain(gyro), "stale": gyro.silent} for name, gyro in progress.gyros.items()},
        }
        return now | {name: shown[name] for name in _NOTHING_YET}

    def _alarms(self) -> list[dict[str, Any]]:
        """Return the alarms of the run that goes on, each with the run it belongs to."""
        run_id = str((self._run or {}).get("run_id", ""))
        return [{**row, "run": run_id} for row in (self._progress.alarms if self._progress else ())]

    def _state(self, progress: Progress | None) -> str:
        if self._ended:
            return "ended"
        if self._prompts:
            return "asking"
        if self.paused_between_runs or (progress is not None and progress.paused):
            return "paused"
        return "starting" if progress is None else "running"


class _Either:
    """Puts a question in the live files and to another operator."""

    def __init__(self, live: Live, other: Operator) -> None:
        self._live, self._other = live, other

    def ask(self, question: Question) -> Callable[[], Reply | None]:
        """Put the question to both; the answer is the first one's."""
        there, here = self._live.ask(question), self._other.ask(question)

        def answer() -> Reply | None:
            reply = here()
            return there() if reply is None else self._live.settle(reply)

        return answer


_NOTHING_YET: dict[str, Any] = {
    **dict.fromkeys(("time_s", "left_s", "speed")),
    **dict.fromkeys(("step", "doing", "phase"), ""),
    "chamber": None,
    "table": None,
    "gyros": {},
    "readings": {},
    "alarms": [],
    "log": [],
}


def _aborted_by(request: Requested) -> str:
    return f"stopped by {request.by}"
