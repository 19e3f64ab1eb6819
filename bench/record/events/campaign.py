"""What happens in a campaign, kind by kind: the journal of a campaign folder."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from bench.record.events._base import Event, Flag


@dataclass(frozen=True)
class CampaignBegun(Event):
    """The campaign begins; the first line."""

    title: str
    file_sha256: str
    bench_sha256: str
    runs: list[str]
    kind: ClassVar[str] = "campaign"


@dataclass(frozen=True)
class Started(Event):
    """A process begins to work on the campaign."""

    by: str
    emulated: Flag | None = None
    kind: ClassVar[str] = "started"


@dataclass(frozen=True)
class Continued(Event):
    """A process comes back to the campaign."""

    by: str
    emulated: Flag | None = None
    kind: ClassVar[str] = "continued"


@dataclass(frozen=True)
class RunStarted(Event):
    """A run begins; `folder` is relative to the campaign folder."""

    run: str
    folder: str
    kind: ClassVar[str] = "run_started"


@dataclass(frozen=True)
class RunEnded(Event):
    """A run ended."""

    run: str
    folder: str
    outcome: str
    reason: str
    kind: ClassVar[str] = "run_ended"


@dataclass(frozen=True)
class SetAside(Event):
    """A folder of an earlier attempt that does not count, and why."""

    run: str
    folder: str
    reason: str
    kind: ClassVar[str] = "set_aside"


@dataclass(frozen=True)
class Notified(Event):
    """Somebody was told of something; `problem` is empty if it arrived."""

    on: str
    to: str
    problem: str
    kind: ClassVar[str] = "notified"


@dataclass(frozen=True)
class Checked(Event):
    """The known-state check before going on."""

    folder: str
    outcome: str
    reason: str
    kind: ClassVar[str] = "checked"


@dataclass(frozen=True)
class Fitting(Event):
    """The runs are recorded, the model of a gyro is being fitted."""

    gyro: str
    kind: ClassVar[str] = "fitting"


@dataclass(frozen=True)
class Fitted(Event):
    """The model of a gyro is fitted; `folder` is relative to the campaign folder."""

    gyro: str
    folder: str
    kind: ClassVar[str] = "fitted"


@dataclass(frozen=True)
class CertificateMade(Event):
    """The certificate is written; `passed` None: no limits given, nothing was judged."""

    file: str
    passed: Flag | None
    kind: ClassVar[str] = "certificate"


@dataclass(frozen=True)
class Stopped(Event):
    """The process lets go: completed, failed, aborted."""

    outcome: str
    reason: str
    kind: ClassVar[str] = "stopped"
