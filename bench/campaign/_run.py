"""A campaign begun, being run or resumed: what is left of it, in order, each run recorded whole before the next.

What can be refused is refused before anything is written.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, ExitStack, nullcontext
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from bench.campaign._file import CampaignRun, bench_of, load_campaign
from bench.campaign._folder import CampaignFolder, RunState
from bench.campaign._notify import Announcing, Notifier
from bench.campaign._plan import check_limits
from bench.control.disk import check_disk, estimated_bytes
from bench.control.lease import Lease, take_lease
from bench.control.live import Live
from bench.control.operators import Signature
from bench.control.procedure import Procedure, find_procedure
from bench.control.progress import Progress
from bench.control.questions import Assisted, AssumeYes, EmulatedOperator, Operator, Prepared
from bench.control.runner import RunRequest, RunResult
from bench.control.signals import raising
from bench.lab.emulated import EmulatedLab, Plant
from bench.lab.rehearsal import run_in_lab
from bench.record.benchfile import BenchFile
from bench.record.events.campaign import Checked, Continued, RunEnded, RunStarted, SetAside, Started, Stopped
from bench.record.events.run import Paused, Requested, Resumed
from drivers.base.errors import BenchError, RunAborted

KNOWN_STATE = "known-state"
"""The procedure that brings the bench to a known state and says whether it got there."""


def begin_campaign(
    campaign_file: Path, file: BenchFile, out: Path, *, plant: Plant | None = None, ask: bool = False
) -> CampaignFolder:
    """Begin a campaign on the bench, or with `plant` on emulated labs; nothing has moved yet.

    Refused: a demand beyond the limits, a disk without room, a bench in use, a folder that is not empty.
    """
    campaign = load_campaign(campaign_file, file)
    bench = bench_of(campaign, file)
    check_limits(campaign, bench)
    check_disk(estimated_bytes(campaign.expected_duration_s(), bench), out, "the campaign", "--out")
    if plant is None:
        take_lease(bench, f"campaign {campaign.title}").release()  # only to see that the bench is free
    return CampaignFolder.create(out, campaign_file, file, plant, ask)


def resume_campaign(path: Path) -> CampaignFolder:
    """Open a campaign that was begun, to go on with it; refused if the disk has no room for the runs left."""
    folder = CampaignFolder(path)
    open_runs = [state.run for state in folder.states() if state.state == "open"]
    left_s = sum(run.test.expected_duration_s(run.values) for run in open_runs)
    needed = estimated_bytes(left_s, bench_of(folder.campaign, folder.file))
    check_disk(needed, path, "what is left of the campaign", "--out of a new campaign")
    return folder


@dataclass(frozen=True)
class CampaignEnding:
    """How a campaign's process ended: "completed" if every run is recorded, else "aborted" or "failed"."""

    outcome: str
    reason: str
    states: tuple[RunState, ...]

    @property
    def folders(self) -> dict[str, Path]:
        """Run name -> folder of the runs that are done."""
        return {
            state.run.name: state.folder for state in self.states if state.folder and state.state == "done"
        }


def _shows_nothing(name: str, expected_s: float) -> AbstractContextManager[None]:
    return nullcontext()


@dataclass
class CampaignRunner:
    """Runs what is left of the campaign in `folder`.

    `operator` answers what was not answered beforehand, None asks in the live files only; `yes` answers all.
    `display` is given each run's name and expected duration, and returns what shows its progress while entered.
    `say` hears how each run ended. `started_by`: who, for the record; None: the user who holds the bench.
    `further` is asked for one more run when all are recorded.
    """

    folder: CampaignFolder
    operator: Operator | None = None
    yes: bool = False
    display: Callable[[str, float], AbstractContextManager[Callable[[Progress], None] | None]] = (
        _shows_nothing
    )
    say: Callable[[RunResult], None] = lambda result: None
    started_by: Signature | None = None
    further: Callable[[], CampaignRun | None] = lambda: None
    _file: BenchFile = field(init=False, repr=False)
    _notifier: Notifier = field(init=False, repr=False)
    _lease: Lease | None = field(init=False, repr=False, default=None)
    _live: Live = field(init=False, repr=False)
    _last_by: str = field(init=False, repr=False, default="")

    def run(self) -> CampaignEnding:
        """Work until all is done or something stops it. The bench is this campaign's from first to last.

        Raises BenchInUse, LimitExceeded, ConfigurationError before anything moves, RecordError if the journal
        cannot be written.
        """
        folder, campaign = self.folder, self.folder.campaign
        self._file = bench_of(campaign, folder.file, str(folder.path))
        check_limits(campaign, self._file)
        notifier = self._notifier = Notifier(campaign.notify, campaign.title)
        with ExitStack() as stack:
            stack.enter_context(folder.lock())
            if folder.plant is None:
                self._lease = stack.enter_context(take_lease(self._file, f"campaign {campaign.title}"))
            live = self._live = stack.enter_context(Live(folder.path))
            outcome, reason = "failed", "the process was stopped"
            try:
                with raising():
                    outcome, reason = self._work()
            except KeyboardInterrupt as stop:
                outcome, reason = "aborted", f"stopped by {stop if stop.args else 'Ctrl-C'}"
            except BenchError as error:
                outcome = "aborted" if live.abort is not None else "failed"
                reason = str(error)
            finally:
                live.end(outcome, reason)
                occasion = "completed" if outcome == "completed" else "failed"
                notifier.tell(occasion, reason or "all runs are recorded", outcome=outcome)
                notifier.wait()
                self._note_sent()
                folder.event(Stopped(outcome, reason))
            return CampaignEnding(outcome, reason, tuple(folder.states()))

    def _work(self) -> tuple[str, str]:
        """Do what is left; return the outcome and its reason."""
        folder = self.folder
        states = folder.states(thorough=True)
        before = [event for _, event in folder.events() if isinstance(event, Started | Continued)]
        moved = folder.moved()
        user = self._lease.holder.user if self._lease is not None else "emulated"
        starter = self.started_by or Signature(user)
        begun = Continued if before else Started
        folder.event(begun(starter.name, folder.plant is not None, starter.role))
        for state in states:
            if state.state == "open" and state.folder is not None:
                where = state.folder.relative_to(folder.path).as_posix()
                folder.event(SetAside(state.run.name, where, state.reason))
        left = [(number, state.run) for number, state in enumerate(states) if state.state == "open"]
        if left and moved:
            self._check_known_state(len(before))
        for number, run in self._ahead(left):
            self._pause_between(run)
            runs = folder.campaign.runs
            left_s = sum(later.test.expected_duration_s(later.values) for at, later in left if at > number)
            self._live.campaign(
                title=folder.campaign.title,
                folder=str(folder.path.absolute()),
                number=number + 1,
                count=len(runs),
                run=run.name,
                left_s=left_s,
                bench=self._file.bench.name,
                emulated=folder.plant is not None,
            )
            result = self._run_one(run, number)
            if result.outcome == "aborted":
                return "aborted" if isinstance(result.error, RunAborted) else "failed", result.reason
        still_open = [state for state in folder.states() if state.state == "open"]
        if still_open:
            names = "; ".join(f"{state.run.name} ({state.reason})" for state in still_open)
            return "failed", f"not recorded: {names}"
        return "completed", ""

    def _ahead(self, left: Sequence[tuple[int, CampaignRun]]) -> Iterator[tuple[int, CampaignRun]]:
        """Yield the open runs with their numbers, then what `further` adds to the campaign."""
        yield from left
        while (run := self.further()) is not None:
            check_limits(self.folder.campaign.model_copy(update={"run": (run,)}), self._file)
            self.folder.add(run)
            yield len(self.folder.campaign.runs) - 1, run

    def _note_sent(self) -> None:
        """Write to the journal what became of the messages so far."""
        while self._notifier.sent:
            self.folder.event(self._notifier.sent.popleft())

    def _run_one(self, run: CampaignRun, number: int) -> RunResult:
        run_id = self.folder.next_id(run)
        self.folder.event(RunStarted(run.name, f"runs/{run_id}"))
        result = self._perform(run.test, run.values, number, self.folder.runs, run_id)
        damage, _ = self.folder.judge(run, result.folder)
        if damage and result.outcome != "aborted":
            result.outcome, result.reason = "aborted", f"the record is not sound: {damage}"
        where = f"runs/{result.folder.name}"
        self.folder.event(RunEnded(run.name, where, result.outcome, result.reason))
        self.say(result)
        self._notifier.tell("run_ended", f"{run.name}: {result.outcome}", reason=result.reason)
        self._note_sent()
        return result

    def _check_known_state(self, attempt: int) -> None:
        """Bring table and chamber to a known state before anything that an interruption left is trusted."""
        procedure = find_procedure(KNOWN_STATE)
        file = self.folder.file
        checks = self.folder.path / "checks"
        values = procedure.parse({"air_c": file.safe.chamber_set_point_c})
        ramp = min(values.model_dump()["ramp_k_per_min"], file.limits.max_ramp_k_per_min)
        values = values.model_copy(update={"ramp_k_per_min": ramp})
        result = self._perform(procedure, values, 0, checks, f"{KNOWN_STATE}-{attempt}")
        where = result.folder.relative_to(self.folder.path).as_posix()
        self.folder.event(Checked(where, result.outcome, result.reason))
        self.say(result)
        if result.outcome != "completed":
            raise RunAborted(
                "the bench is not in a known state, so the campaign does not go on",
                where=where,
                found=result.reason,
                expected="table at rest where it was sent, air and units at the safe set point",
                remedy="put right what it found, then resume again",
            )

    def _perform(self, procedure: Procedure, values: Any, number: int, runs: Path, run_id: str) -> RunResult:
        """Run a procedure on the bench; on emulated ones on a fresh lab, the one of run `number`."""
        plant = self.folder.plant
        with ExitStack() as stack:
            lab = (
                None if plant is None else stack.enter_context(EmulatedLab(self._file, plant.for_run(number)))
            )
            show = stack.enter_context(self.display(run_id, procedure.expected_duration_s(values)))
            request = RunRequest(procedure, values, self._file, runs, self._operator(lab), show, run_id)
            shared = replace(request, lease=self._lease, live=self._live, started_by=self.started_by)
            return run_in_lab(shared, lab)

    def _operator(self, lab: EmulatedLab | None) -> Operator:
        if lab is not None and not self.folder.ask:
            return EmulatedOperator(lab.perform)
        human: Operator = self._live
        if self.operator is not None:
            human = self._live.beside(self.operator)
        asked: Operator = AssumeYes() if self.yes else Announcing(human, self._notifier)
        answers = [(prepared.question, prepared.answer) for prepared in self.folder.campaign.answer]
        operator: Operator = Prepared(answers, "campaign file", asked)
        return operator if lab is None else Assisted(operator, lab.perform)

    def _pause_between(self, run: CampaignRun) -> None:
        """Stand still before a run as long as somebody wants a pause; an abort ends the campaign here."""
        live, paused = self._live, False
        while True:
            self._note_requests()
            if live.abort is not None:
                raise RunAborted(f"stopped by {live.abort.by} before run {run.name}")
            if bool(live.pause_wanted) != paused:
                paused = bool(live.pause_wanted)
                live.paused_between_runs = paused
                by = live.pause_wanted or self._last_by
                self.folder.event(Paused(by) if paused else Resumed(by))
            if not paused:
                return
            live.wait_host()

    def _note_requests(self) -> None:
        for request in self._live.take():
            self.folder.event(request)
            if isinstance(request, Requested):
                self._last_by = request.by
