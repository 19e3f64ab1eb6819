"""What every compensation file has, whatever it corrects: unit, runs, software, date; it refuses another unit.

A kind of compensation is a frozen dataclass derived from `FittedCompensation`; `bench.analysis.compensations` has
the table of them.
"""

from __future__ import annotations

import platform
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, fields
from importlib.metadata import version
from operator import attrgetter
from pathlib import Path
from typing import Any, ClassVar, Self, get_origin, get_type_hints

import numpy as np
from numpy.typing import NDArray

from bench.analysis.common.state_file import read_state, unreadable, write_state
from bench.record.shown import Shown
from drivers.base.arrays import Array
from drivers.base.clock import utc_now
from drivers.base.errors import ConfigurationError, RecordError

_NOT_RESTORED = (LookupError, TypeError, ValueError, AttributeError, ArithmeticError)


class UnitMismatch(ConfigurationError):
    """A compensation of one unit, asked to correct another."""


@dataclass(frozen=True, eq=False, repr=False)
class FittedCompensation(Shown):
    """A fitted correction of one unit. `runs`: ids of the runs it was fitted on, with their checksums.

    `unit_id` is empty where the record did not say (a log of other software): then no unit is refused.
    """

    KIND: ClassVar[str | None]
    """What the file says it is; None: thermal drift, the first kind there was."""
    WHAT: ClassVar[str]
    """What it corrects, in words."""
    FORMAT: ClassVar[int] = 1
    """The newest format; `file_format` says which one a compensation needs."""
    OLDER: ClassVar[tuple[int, ...]] = ()
    """Formats before it that are read as well."""
    SHAPES: ClassVar[Mapping[str, tuple[int | str, ...]]] = {}
    """Arrays among the attributes and their shapes; a word stands for a length, equal wherever it is said."""
    POSITIVE: ClassVar[tuple[str, ...]] = ()
    """Attributes that are divided by, or are times: above zero, all of them."""
    NAMES: ClassVar[Mapping[str, str]] = {}
    """Attributes that have another name in the file, and which."""

    unit_id: str
    runs: Mapping[str, str] = field(default_factory=dict, kw_only=True)
    software: Mapping[str, str] = field(default_factory=dict, kw_only=True)
    created_utc: str = field(default="", kw_only=True)

    def shown(self) -> dict[str, object]:
        """Return what it corrects, of which unit, and the runs that it was fitted on."""
        return {"corrects": self.WHAT, "unit": self.unit_id or "not said", "fitted on": list(self.runs)}

    def _described(self) -> dict[str, Any]:
        """Return what this kind says in words and numbers, JSON-able: its own attributes, if no more is said."""
        return {name: _plain(getattr(self, name)) for name in self._own()}

    def _arrays(self) -> dict[str, Any]:
        """Return what else goes into the file: arrays at full precision."""
        return {}

    @classmethod
    def _restored(cls, state: dict[str, Any], metadata: dict[str, Any]) -> Self:
        """Return the compensation of a file's content; `metadata` are the keywords that all have."""
        kinds = get_type_hints(cls)
        own = {name: _typed(state[cls.NAMES.get(name, name)], kinds[name]) for name in cls._own()}
        return cls(unit_id=state["unit_id"], **own, **metadata)

    def _trial(self) -> Any:
        """Return what this kind makes of an ordinary input; a file that makes no finite numbers is refused."""
        return 0.0

    @classmethod
    def _own(cls) -> list[str]:
        """Return the names of the attributes that this kind adds."""
        return [item.name for item in fields(cls) if item.name not in FittedCompensation.__dataclass_fields__]

    @property
    def file_format(self) -> int:
        """The oldest format that says all of it: what reads that format reads the file."""
        return self.FORMAT

    def describe(self) -> dict[str, Any]:
        """Return what the file says as JSON-able values."""
        return {
            "format": self.file_format,
            **({} if self.KIND is None else {"kind": self.KIND}),
            "unit_id": self.unit_id,
            **self._described(),
            "runs": dict(self.runs),
            "software": dict(self.software),
            "created_utc": self.created_utc,
        }

    def require_unit(self, unit_id: str, *, force: bool = False) -> None:
        """Raise UnitMismatch if this compensation is of another unit than `unit_id`, unless forced."""
        if self.unit_id and unit_id != self.unit_id and not force:
            raise UnitMismatch(
                "this compensation is of another unit",
                where=f"{self.WHAT}, compensation of unit {self.unit_id}",
                found=f"unit {unit_id}",
                expected=f"unit {self.unit_id}",
                remedy="use this unit's own compensation: on another unit the error can grow instead of shrink",
            )

    def save(self, path: Path) -> None:
        """Write the file, whole or not at all and without pickle; RecordError for what is no number."""
        state = {**self.describe(), **self._arrays()}
        _require_numbers(state, path)
        self.require_usable(path)
        write_state(path, state)

    @classmethod
    def load(cls, path: Path) -> Self:
        """Read a file; RecordError if it is damaged, of another kind or format, or corrects nothing.

        All its numbers are finite, its arrays of their shapes, and what it gives on an ordinary input is finite.
        """
        state = read_state(path)
        if state.get("kind") != cls.KIND or state.get("format") not in (cls.FORMAT, *cls.OLDER):
            raise RecordError(
                "this compensation file is of another kind or format",
                where=str(path),
                found=f"kind {state.get('kind') or 'thermal drift'}, format {state.get('format')}",
                expected=f"kind {cls.KIND or 'thermal drift'}, format {cls.FORMAT}",
                remedy="`bench.analysis.compensations.load_compensation` reads every kind; of an older format, "
                "fit again",
            )
        _require_numbers(state, path)
        try:
            named = {name: dict(state.get(name, {})) for name in ("runs", "software")}
            made = cls._restored(state, {**named, "created_utc": str(state.get("created_utc", ""))})
        except _NOT_RESTORED as error:
            raise unreadable(path, f"{type(error).__name__}: {error}") from error
        made.require_usable(path)
        return made

    def require_usable(self, path: Path) -> None:
        """Raise RecordError for another shape than `SHAPES`, what is not `POSITIVE`, a trial that fails."""
        lengths: dict[str, int] = {}
        for name, shape in self.SHAPES.items():
            found = np.shape(attrgetter(name)(self))
            wanted = tuple(
                lengths.setdefault(length, size) if isinstance(length, str) else length
                for length, size in zip(shape, found, strict=False)
            )
            if len(found) != len(shape) or found != wanted:
                raise unreadable(path, f"{name} of shape {found}, not {shape}")
        for name in self.POSITIVE:
            if not (value := attrgetter(name)(self)) > 0.0:
                raise unreadable(path, f"{name} is {value}, not above zero")
        try:
            with np.errstate(all="ignore"):
                usable = np.isfinite(self._trial()).all()
        except _NOT_RESTORED as error:
            raise unreadable(path, f"{type(error).__name__} where it is used: {error}") from error
        if not usable:
            raise unreadable(path, "it gives no finite correction of an ordinary input")


def _plain(value: Any) -> Any:
    """Return an attribute as JSON has it; a complex number is a pair."""
    if isinstance(value, np.ndarray | tuple):
        return [_plain(part) for part in (value if isinstance(value, tuple) else value.tolist())]
    if isinstance(value, complex):
        return [value.real, value.imag]
    return dict(value) if isinstance(value, Mapping) else value


def _typed(value: Any, kind: Any) -> Any:
    """Return what `_plain` made of an attribute of type `kind`."""
    if kind == NDArray[np.complex128]:
        return np.array([complex(*pair) for pair in value])
    if kind == Array:
        return np.array(value, dtype=np.float64)
    if kind is complex:
        return complex(*value)
    return tuple(value) if get_origin(kind) is tuple else value


def provenance(runs: Mapping[str, str], *packages: str) -> dict[str, Any]:
    """Return the keywords that all compensations have, for one fitted on `runs` now; see `software_versions`."""
    return {"runs": dict(runs), "software": software_versions(*packages), "created_utc": utc_now()}


def software_versions(*names: str) -> dict[str, str]:
    """Return the versions of Python, gyrobench, numpy, scipy and of the packages `names`."""
    packages = {name: version(name) for name in ("gyrobench", "numpy", "scipy", *names)}
    return {**packages, "python": platform.python_version()}


def _require_numbers(state: Mapping[str, Any], path: Path) -> None:
    for place, array in _arrays_in(state):
        if array.dtype.kind not in "fciub" or not np.isfinite(array).all():
            raise unreadable(path, f"{place}: not all of it numbers")


def _arrays_in(value: Any, place: str = "") -> Iterator[tuple[str, NDArray[Any]]]:
    if isinstance(value, np.ndarray | float | int):
        yield place, np.asarray(value)
    elif isinstance(value, Mapping):
        for key, part in value.items():
            yield from _arrays_in(part, f"{place}/{key}")
    elif isinstance(value, list | tuple):
        for index, part in enumerate(value):
            yield from _arrays_in(part, f"{place}/{index}")
