"""What happens in a campaign, kind by kind: the journal of a campaign folder."""

from __future__ import annotations

from bench.record.events._base import Event, Flag, Number, Whole
from bench.record.events.run import Role


class CampaignBegun(Event, kind="campaign"):
    """The campaign begins; the first line."""

    title: str
    file_sha256: str
    bench_sha256: str
    runs: list[str]


class Started(Event, kind="started"):
    """A process begins to work on a campaign, or a run begins; `by` has started it.

    `role`: as which they were signed in at the panel; None for a name that nobody has checked.
    """

    by: str
    emulated: Flag | None = None
    role: Role | None = None


class Continued(Event, kind="continued"):
    """A process comes back to the campaign."""

    by: str
    emulated: Flag | None = None
    role: Role | None = None


class RunStarted(Event, kind="run_started"):
    """A run begins; `folder` is relative to the campaign folder."""

    run: str
    folder: str


class RunEnded(Event, kind="run_ended"):
    """A run ended."""

    run: str
    folder: str
    outcome: str
    reason: str


class SetAside(Event, kind="set_aside"):
    """A folder of an earlier attempt that does not count, and why."""

    run: str
    folder: str
    reason: str


class Notified(Event, kind="notified"):
    """Somebody was told of something; `problem` is empty if it arrived."""

    on: str
    to: str
    problem: str


class Checked(Event, kind="checked"):
    """The known-state check before going on."""

    folder: str
    outcome: str
    reason: str


class RunAdded(Event, kind="run_added"):
    """A run was added at the campaign's end; `file_sha256` is that of its file with it."""

    run: str
    file_sha256: str


class Sought(Event, kind="sought"):
    """Where a search for the missing effect stands after some runs.

    `probabilities` are of what may act ("no gap", or names joined by " + "), `gained_nats` how far they moved
    with the newest run. `ended` is empty, or how the search ended: decided, alike (one of the
    fewest that together have the probability asked for), undecided, budget.
    """

    after: list[str]
    verdict: str
    acts: str
    probability: Number
    probabilities: dict[str, Number]
    used_h: Number
    gained_nats: Number | None = None
    confirmed: Flag | None = None
    ended: str = ""


class NextRun(Event, kind="next_run"):
    """The run that a search chose of `considered` ones, what it is expected to tell and to take."""

    run: str
    procedure: str
    parameters: str
    expected_nats: Number
    hours: Number
    considered: Whole
    to_confirm: Flag


class Fitting(Event, kind="fitting"):
    """The runs are recorded, the model of a gyro is being fitted."""

    gyro: str


class Fitted(Event, kind="fitted"):
    """The model of a gyro is fitted; `folder` is relative to the campaign folder."""

    gyro: str
    folder: str


class CertificateMade(Event, kind="certificate"):
    """The certificate is written; `passed` None: no limits given, nothing was judged."""

    file: str
    passed: Flag | None


class Stopped(Event, kind="stopped"):
    """The process lets go: completed, failed, aborted."""

    outcome: str
    reason: str
