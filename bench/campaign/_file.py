"""The campaign file (TOML): units, runs, answers, whom to tell. Data, checked before anything moves."""

from __future__ import annotations

import dataclasses
import difflib
import hashlib
import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Literal

from pydantic import (
    BaseModel,
    ConfigDict,
    Field,
    PrivateAttr,
    ValidationError,
    field_validator,
    model_validator,
)

from bench.control.procedure import Parameters, Procedure, find_procedure
from bench.control.questions import consents
from bench.record.benchfile import BenchFile, bench_file_from
from bench.record.figure_limits import SIMPLE, Decision, Limit, wrong_limits
from drivers.base.errors import BenchError, ConfigurationError
from drivers.base.files import SETTINGS_BYTES, parse_toml, read_bounded
from drivers.kit.config import GyroConfig

Role = Literal["training", "validation", "test", "record"]
Occasion = Literal["prompt", "run_ended", "completed", "failed"]


class _Part(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid")


class Unit(_Part):
    """A unit under test: its serial number and where it is connected.

    `gyro` names the bench file's [[gyro]] that describes it (default: the one whose `unit` it is); `port` takes
    the place of that section's port, or of its channel for a unit on CAN.
    """

    serial: str = Field(min_length=1, max_length=64)
    gyro: str | None = None
    port: str | None = Field(default=None, min_length=1)


class CampaignRun(_Part):
    """One run: what, with which parameters, how often, and what it is for. `name` is its folder."""

    name: str = Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9_-]{0,47}$")
    procedure: str
    role: Role = "record"
    repeats: int = Field(default=1, ge=1, le=1000)
    parameters: dict[str, Any] = Field(default_factory=dict)

    @property
    def test(self) -> Procedure:
        """The procedure itself."""
        return find_procedure(self.procedure)

    @property
    def values(self) -> Parameters:
        """The parameters, checked."""
        return self.test.parse(self.parameters)

    def toml(self) -> str:
        """Return the run as a [[run]] table of a campaign file."""
        keys = {"name": self.name, "procedure": self.procedure, "role": self.role}
        lines = ["[[run]]", *(f"{key} = {json.dumps(value)}" for key, value in keys.items())]
        lines += [f"repeats = {self.repeats}"] if self.repeats > 1 else []
        pairs = ", ".join(f"{name} = {json.dumps(value)}" for name, value in self.parameters.items())
        return "\n".join([*lines, f"parameters = {{ {pairs} }}"]) + "\n"


class PreparedAnswer(_Part):
    """An answer given beforehand to every question that matches (`*` and `?` as in file names)."""

    question: str = Field(min_length=1)
    answer: str = Field(min_length=1)

    @field_validator("answer")
    @classmethod
    def _says_yes_or_no(cls, answer: str) -> str:
        if consents(answer) is None:
            raise ValueError("an answer begins with yes, done, ok or ready, or with no, abort or stop")
        return answer


class Notice(_Part):
    """Whom to tell, and when: a program (arguments, never a shell), an address, or a file.

    The message is JSON: on the program's standard input, as the body posted, or as a line of the file.
    """

    on: tuple[Occasion, ...] = ("prompt", "completed", "failed")
    command: tuple[str, ...] | None = Field(default=None, min_length=1)
    webhook: str | None = Field(default=None, pattern=r"^https?://[^\s]+$")
    file: Path | None = None

    @model_validator(mode="after")
    def _one_way(self) -> Notice:
        if sum(way is not None for way in (self.command, self.webhook, self.file)) != 1:
            raise ValueError("needs one of command, webhook and file")
        return self


class Campaign(_Part):
    """Runs in order. `gyro` is the one whose compensation is fitted at the end; None fits nothing."""

    title: str = Field(min_length=1)
    gyro: str | None = None
    unit: tuple[Unit, ...] = ()
    run: tuple[CampaignRun, ...] = Field(min_length=1)
    answer: tuple[PreparedAnswer, ...] = ()
    notify: tuple[Notice, ...] = ()
    limits: dict[str, Limit] = Field(default_factory=dict)
    decision: Decision = SIMPLE
    _sha256: str = PrivateAttr(default="")

    @property
    def sha256(self) -> str:
        """SHA-256 of the file this was read from."""
        return self._sha256

    @property
    def runs(self) -> tuple[CampaignRun, ...]:
        """All runs in order, repeats counted out: `name-1`, `name-2`, ..."""
        return tuple(
            run.model_copy(update={"name": f"{run.name}-{number}" if run.repeats > 1 else run.name})
            for run in self.run
            for number in range(1, run.repeats + 1)
        )

    def expected_duration_s(self) -> float:
        """Return the bench time of all runs together."""
        return sum(run.test.expected_duration_s(run.values) for run in self.runs)


def load_campaign(path: Path, file: BenchFile) -> Campaign:
    """Read a campaign file and check it against the bench; ConfigurationError names every mistake."""
    try:
        content = read_bounded(path, SETTINGS_BYTES)
        data = parse_toml(content)
        campaign = Campaign.model_validate(data)
    except ValidationError as error:
        raise _unusable(path, [_mistake(dict(item)) for item in error.errors()]) from error
    except (OSError, ValueError) as error:
        raise _unusable(path, [str(error)]) from error
    mistakes = [*_wrong_units(campaign, file), *_wrong_runs(campaign), *wrong_limits(campaign.limits)]
    if not mistakes:
        mistakes += _wrong_fit(campaign, bench_of(campaign, file, str(path)))
    if mistakes:
        raise _unusable(path, mistakes)
    campaign._sha256 = hashlib.sha256(content).hexdigest()  # noqa: SLF001  (a frozen model)
    return campaign


def bench_of(campaign: Campaign, file: BenchFile, where: str = "the campaign's units") -> BenchFile:
    """Return the bench with the campaign's units in place: their serial numbers and ports, in their order.

    Without [[unit]] all gyros of the bench are under test. ConfigurationError for ports that clash.
    """
    if not campaign.unit:
        return file
    sections = []
    for unit in campaign.unit:
        section = _section_of(unit, file)
        if section is None:
            raise ConfigurationError("a unit that is not on the bench", where=where, found=unit.serial)
        place: dict[str, Any] = (
            {} if unit.port is None else {"channel" if section.on_can else "port": unit.port}
        )
        sections.append(dataclasses.replace(section, unit=unit.serial, **place))
    changed = file.model_copy(update={"gyro": tuple(sections)})
    bench_file_from(changed.model_dump(mode="json", exclude_none=True), where)
    return changed


def _section_of(unit: Unit, file: BenchFile) -> GyroConfig | None:
    by_name = {gyro.name: gyro for gyro in file.gyro}
    if unit.gyro is not None:
        return by_name.get(unit.gyro)
    return next((gyro for gyro in file.gyro if gyro.unit == unit.serial), None)


def _wrong_units(campaign: Campaign, file: BenchFile) -> Iterator[str]:
    have = ", ".join(f"{gyro.name} ({gyro.unit})" for gyro in file.gyro)
    used: dict[str, str] = {}
    serials = [unit.serial for unit in campaign.unit]
    for twice in sorted({serial for serial in serials if serials.count(serial) > 1}):
        yield f"unit {twice} is listed twice"
    for unit in campaign.unit:
        section = _section_of(unit, file)
        if section is None and unit.gyro is not None:
            yield f"unit {unit.serial}: there is no gyro {unit.gyro!r} on the bench, which has {have}"
        elif section is None:
            near = difflib.get_close_matches(unit.serial, [gyro.unit for gyro in file.gyro], n=1)
            hint = f"; did you mean {near[0]}" if near else "; say which it is on with gyro = 'name'"
            yield f"unit {unit.serial} is not on the bench, which has {have}{hint}"
        elif section.name in used:
            yield f"units {used[section.name]} and {unit.serial} are both on gyro {section.name!r}"
        else:
            used[section.name] = unit.serial


def _wrong_runs(campaign: Campaign) -> Iterator[str]:
    names = [run.name for run in campaign.runs]
    if twice := sorted({name for name in names if names.count(name) > 1}):
        yield f"runs of the same name: {', '.join(twice)}"
    for run in campaign.run:
        try:
            _ = run.values
        except BenchError as error:
            yield f"run {run.name}: {error}"


def _wrong_fit(campaign: Campaign, file: BenchFile) -> Iterator[str]:
    if campaign.gyro is None:
        return
    if campaign.gyro not in (names := [gyro.name for gyro in file.gyro]):
        yield f"gyro {campaign.gyro!r} is not under test: {', '.join(names)}"
    if not any(run.role == "training" for run in campaign.run):
        yield f"the compensation of {campaign.gyro} is to be fitted, and no run has role = 'training'"


def _mistake(item: dict[str, Any]) -> str:
    """Return `run 2: procedure: field required`: entries counted from 1, as a human does."""
    place = " ".join(str(part + 1) if isinstance(part, int) else str(part) for part in item["loc"])
    if item["type"] == "extra_forbidden":
        return f"{place}: an unknown key"
    found = "" if item["type"] == "missing" else f", found {str(item['input'])[:60]!r}"
    return f"{place}: {str(item['msg']).lower()}{found}"


def _unusable(path: Path, mistakes: list[str]) -> ConfigurationError:
    return ConfigurationError(
        "the campaign file cannot be used",
        where=str(path),
        found="; ".join(mistakes),
        expected="title and [[run]] tables with name, procedure and parameters; see docs/campaign.md",
        remedy="examples/cold_shock_campaign.toml is one that works",
    )
