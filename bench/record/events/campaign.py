"""What happens in a campaign, kind by kind: the journal of a campaign folder."""

from __future__ import annotations

from bench.record.events._base import Event, Flag
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
